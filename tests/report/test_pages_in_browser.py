"""The pages in a real browser: nothing is cut on a telephone or on paper, and dark mode follows the system."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import pytest
from chromium import NEEDS_CHROMIUM, started_chromium
from playwright.sync_api import Browser, Page
from small_recordings import read_frames

from scleraforce.report.evaluation_page import write_evaluation_html

pytestmark = NEEDS_CHROMIUM

# Elements that reach beyond the window or that hide a part of what they hold.
CUT = """() => [...document.querySelectorAll("body *")].filter((element) => {
  const box = element.getBoundingClientRect();
  return box.right > document.documentElement.clientWidth + 0.5 || element.scrollWidth > element.clientWidth + 1
    && getComputedStyle(element).overflowX !== "visible";
}).map((element) => element.outerHTML.slice(0, 80))"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with started_chromium() as started:
        yield started


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a reader's evaluation with every column, a long remark, a long name and pictures."""
    folder = tmp_path_factory.mktemp("page")
    reason = "the dent leaves the window of the slice, and its flanks leave the force uncertain by 23 mN"
    name = "a-recording-with-a-name-as-long-as-they-are" * 2
    looks, evaluation = read_frames(folder / name, reason, modulus_source="population")
    write_evaluation_html(evaluation, looks, folder / "page.html", datetime(2026, 3, 1, tzinfo=UTC))
    return folder / "page.html"


def opened(browser: Browser, path: Path, width: int, scheme: str = "light") -> Page:
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page.goto(path.as_uri())
    return page


def test_nothing_is_cut_at_any_width_or_on_paper(browser: Browser, written: Path) -> None:
    for width in (360, 400, 760, 761, 1300):
        page = opened(browser, written, width)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(CUT) == [], width
        page.close()
    page = opened(browser, written, 680)  # A4 between margins of 15 mm
    page.emulate_media(media="print")
    assert page.evaluate(CUT) == []
    page.close()


def test_on_a_telephone_each_figure_of_a_row_has_its_title_and_the_remark_is_seen(
    browser: Browser, written: Path
) -> None:
    page = opened(browser, written, 400)
    title = "(cell) => getComputedStyle(cell, '::before').content"
    cells = page.locator("table.stacked tbody tr").nth(2).locator("td")
    assert [cells.nth(n).evaluate(title) for n in (0, 3, 4)] == ['"force [mN]"', '"read [mN]"', '"90 % [mN]"']
    box = page.get_by_role("cell", name="leaves the window of the slice").bounding_box()
    assert box is not None
    assert box["x"] + box["width"] <= 400
    assert box["width"] > 300
    page.close()


def lightness(page: Page, selector: str, value: str) -> float:
    """Mean of red, green and blue of an element's colour."""
    return float(
        page.locator(selector).first.evaluate(
            "(e, value) => getComputedStyle(e)[value].match(/[0-9.]+/g).slice(0, 3).reduce((a, b) => a + +b, 0) / 3",
            value,
        )
    )


def test_dark_mode_follows_the_system_and_figures_keep_their_white_paper(browser: Browser, written: Path) -> None:
    for scheme, dark in (("light", False), ("dark", True)):
        page = opened(browser, written, 1300, scheme)
        paper = lightness(page, "body", "backgroundColor")
        assert (paper < 60) == dark
        for selector in ("body", "figcaption", "caption", ".card b", "td.marked"):
            assert abs(lightness(page, selector, "color") - paper) > 70, (scheme, selector)
        assert lightness(page, "figure img", "backgroundColor") == 255
        page.emulate_media(media="print", color_scheme=scheme)
        assert lightness(page, "body", "backgroundColor") == 255
        page.close()
