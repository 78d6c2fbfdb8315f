"""The page that browses a recording: the data of each frame, nothing fetched, keys and clicks."""

import json
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from chromium import NEEDS_CHROMIUM, started_chromium
from playwright.sync_api import Page
from small_recordings import read_frames

from scleraforce.report import evaluation_page
from scleraforce.report.evaluation_page import write_browser_html

MADE_AT = datetime(2026, 3, 1, tzinfo=UTC)


def written(folder: Path) -> Path:
    counted: list[int] = []
    _, evaluation = read_frames(folder / "rec", "</script><b>no wall</b>")  # a reason that ends a script
    write_browser_html(evaluation, folder / "page.html", MADE_AT, counted.append)
    assert sum(counted) == 4
    return folder / "page.html"


def data_of(path: Path) -> dict[str, list[dict[str, object]]]:
    found = re.search(r'id="frames">(.*?)</script>', path.read_text(encoding="utf-8"))
    assert found is not None
    return json.loads(found[1])


def test_the_page_has_every_frame_with_its_answer_fetches_nothing_and_no_word_is_markup(tmp_path: Path) -> None:
    path = written(tmp_path)
    frames = data_of(path)["frames"]
    assert [frame["file"] for frame in frames] == ["0001.png", "0002.png", "0003.png", "0004.png"]
    assert frames[0]["measured_mn"] == pytest.approx(20)
    assert frames[0]["interval_mn"] == pytest.approx([18.7, 23.4])
    assert frames[1]["remarks"] == ["the methods differ"]
    assert (frames[2]["usable"], frames[2]["read_mn"]) == (False, None)
    assert all(str(frame["picture"]).startswith("data:image/jpeg;base64,/9j/") for frame in frames)
    text = path.read_text(encoding="utf-8")
    assert not re.search(r'(?:src|href)="(?!data:)', text)
    assert "<b>no wall" not in text.replace("\\/", "/").split('id="frames">')[0]
    assert text.count("</script>") == 2
    assert "a gap of 0.9 mm" in text


def test_of_a_long_recording_misread_frames_keep_their_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluation_page, "MOST_PICTURES", 2)
    frames = data_of(written(tmp_path))["frames"]
    assert [frame["picture"] is not None for frame in frames] == [False, True, True, False]


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    path = written(tmp_path_factory.mktemp("browser"))
    with started_chromium() as browser:
        page = browser.new_context(offline=True, viewport={"width": 900, "height": 800}).new_page()
        faults: list[str] = []
        page.on("pageerror", lambda fault: faults.append(str(fault)))
        page.goto(path.as_uri())
        yield page
        assert faults == []


def shown(page: Page) -> tuple[str, str]:
    return page.locator("#said dd").first.inner_text().split(",")[0], page.locator("#verdict").inner_text()


READ, MISREAD = "class 1: 5 to 30 mN", "class 2: above 30 mN, withdraw (misread)"


@pytest.mark.slow
@pytest.mark.skipif(*NEEDS_CHROMIUM[1].args, **NEEDS_CHROMIUM[1].kwargs)
def test_keys_go_through_the_frames_and_a_click_in_the_curve_to_the_nearest(opened: Page) -> None:
    visited = [shown(opened)]
    for key in ("ArrowLeft", "ArrowRight", "ArrowRight", "End", "ArrowRight", "Home", "PageDown"):
        opened.keyboard.press(key)
        visited.append(shown(opened))
    files = [1, 1, 2, 3, 4, 4, 1, 4]
    assert visited == [(f"000{n}.png", MISREAD if n in (2, 3) else READ) for n in files]
    box = opened.locator("#curve").bounding_box()
    assert box is not None
    opened.mouse.click(box["x"] + 0.39 * box["width"], box["y"] + 0.5 * box["height"])
    assert shown(opened)[0] == "0002.png"
    opened.keyboard.press("ArrowRight")
    assert "</script><b>no wall</b>" in opened.locator("#said").inner_text()
