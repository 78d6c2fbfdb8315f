"""Names from files, on every page and in every picture: they are letters, never markup, scripts or formulas."""

import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from chromium import in_chromium
from playwright.sync_api import Browser
from small_recordings import looked_at_frames

import scleraforce
from scleraforce.cli.main import run

ROOT = Path(scleraforce.__file__).parent
NAMES = ["<!--<script>.png", "<img src=x onerror=boom()>.png", "$^{$.png", "&lt;b&gt;.png"]
EYE = "<!--<script>boom()</script>"


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording whose frames and eye have such names, with the page of its readings and its picture beside it."""
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
    assert run(["show", recording, "--plot", str(folder / "r.svg")]) == 0
    return folder


class _Tags(HTMLParser):
    """The tags of a page, and its text."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.text = ""
        self.feed(source)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        assert not any(name.startswith("on") for name, _ in attrs)

    def handle_data(self, data: str) -> None:
        self.text += data


def test_no_name_is_markup_on_a_page_or_a_formula_in_a_picture(hostile: Path) -> None:
    source = (hostile / "evaluate.html").read_text(encoding="utf-8")
    found = _Tags(source)
    assert all(name in found.text for name in (EYE, *NAMES))
    assert not re.search(r"<!--(?!\[)", source)
    assert "script" not in found.tags
    assert (hostile / "r.svg").stat().st_size > 0


def test_no_script_of_a_page_makes_markup_of_texts() -> None:
    scripts = [*ROOT.rglob("*.js")]
    assert scripts
    for script in scripts:
        found = re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(", script.read_text("utf-8"))
        assert found is None, script


@in_chromium
def test_a_browser_shows_the_names_and_runs_none(hostile: Path, browser: Browser) -> None:
    page = browser.new_context(offline=True).new_page()
    faults: list[str] = []
    page.on("pageerror", lambda fault: faults.append(str(fault)))
    page.goto((hostile / "evaluate.html").as_uri())
    shown = page.locator("body").inner_text()
    assert all(name in shown for name in (EYE, *NAMES))
    assert faults == []
