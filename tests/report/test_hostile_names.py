"""Names from files, on every page and in every picture: they are letters, never markup, scripts or formulas."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from chromium import in_chromium, started_chromium
from small_recordings import looked_at_frames

import scleraforce
from scleraforce.cli.main import run
from scleraforce.report.html import embedded

ROOT = Path(scleraforce.__file__).parent
NAMES = ["<!--<script>.png", "<img src=x onerror=boom()>.png", "$^{$.png", "&lt;b&gt;.png"]
EYE = "<!--<script>boom()</script>"


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording whose frames and eye have such names, with the pages of its readings beside it."""
    folder = tmp_path_factory.mktemp("hostile")
    looked_at_frames(folder / "<r>", len(NAMES))
    frames = sorted((folder / "<r>" / "frames").iterdir())
    for frame, name in zip(frames, NAMES, strict=True):
        frame.rename(frame.with_name(name))
    lines = ["file,time_s", *(f"{name},{nth}" for nth, name in enumerate(NAMES))]
    (folder / "<r>" / "frames.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    info = folder / "<r>" / "recording.toml"
    info.write_text(info.read_text().replace('id = "eye"', f"id = '{EYE}'"))
    recording = str(folder / "<r>")
    assert run(["evaluate", "default", recording, "--html", str(folder / "evaluate.html")]) == 0
    shown = ["--html", str(folder / "show.html"), "--model", "default"]
    assert run(["show", recording, "--plot", str(folder / "r.svg"), *shown]) == 0
    return folder


class _Tags(HTMLParser):
    """The tags of a page, and its text outside of scripts."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text = ""
        self.feed(re.sub(r"(?s)(<script[^>]*>).*?</script>", r"\1</script>", source))
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        assert not any(name.startswith("on") for name, _ in attrs)

    def handle_data(self, data: str) -> None:
        self.text += data


def test_no_name_is_markup_on_a_page_or_a_formula_in_a_picture(hostile: Path) -> None:
    for page, scripts in (("evaluate", 0), ("show", 2)):
        source = (hostile / f"{page}.html").read_text(encoding="utf-8")
        found = _Tags(source)
        assert EYE in found.text
        assert not re.search(r"<!--(?!\[)", source)
        assert found.tags.count("script") == scripts
    (data,) = re.findall(r'(?s)<script type="application/json"[^>]*>(.*?)</script>', source)
    assert not set("<>&\u2028\u2029") & set(data)
    assert [frame["file"] for frame in json.loads(data)["frames"]] == NAMES
    said = {"words": [*NAMES, EYE, "\u2028\u2029"]}
    assert json.loads(re.sub(r"<[^>]*>", "", embedded("said", said))) == said
    assert (hostile / "r.svg").stat().st_size > 0


def test_no_script_of_a_page_makes_markup_of_texts() -> None:
    scripts = [*(ROOT / "report").rglob("*.js"), *(ROOT / "service").rglob("*.js")]
    assert len(scripts) >= 3
    for script in scripts:
        found = re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(", script.read_text("utf-8"))
        assert found is None, script


@in_chromium
def test_a_browser_shows_the_names_and_runs_none(hostile: Path) -> None:
    with started_chromium() as browser:
        page = browser.new_context(offline=True).new_page()
        faults: list[str] = []
        page.on("pageerror", lambda fault: faults.append(str(fault)))
        page.goto((hostile / "show.html").as_uri())
        shown = [page.locator("#said dd").first.inner_text()]
        page.keyboard.press("ArrowRight")
        shown.append(page.locator("#said dd").first.inner_text())
        assert [NAMES[nth] in text for nth, text in enumerate(shown)] == [True, True]
        assert faults == []
