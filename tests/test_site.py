"""The pages as a site: `make docs` builds it without a warning, and it is read and
searched without a network.
"""

import html
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from chromium import NEEDS_CHROMIUM
from playwright.sync_api import Browser, BrowserContext

import scleraforce
from scleraforce.front.cli.main import COMMANDS

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
SHOWN = [*(ROOT / "docs").rglob("*.md"), *NOTEBOOKS]
PAGES = sorted(path.relative_to(ROOT / "docs").with_suffix(".html") for path in SHOWN)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as `make docs` builds it."""
    folder = tmp_path_factory.mktemp("site")
    recipe = re.search(
        r"^docs:.*\n\t\.venv/bin/python (-m sphinx .*) docs \$\(SITE\)$",
        (ROOT / "Makefile").read_text(encoding="utf-8"),
        flags=re.MULTILINE,
    )
    assert recipe is not None
    done = subprocess.run(
        [sys.executable, *recipe[1].split(), "docs", str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr

    return folder


@pytest.fixture(scope="module")
def offline(browser: Browser) -> BrowserContext:
    """A browser without a network."""
    return browser.new_context(offline=True)


def test_every_page_of_the_folder_is_in_the_side_bar(site: Path) -> None:
    links = re.findall(
        r'class="toctree-l1[^"]*"><a class="reference internal" href="([^"]+)"',
        (site / "search.html").read_text(encoding="utf-8"),
    )
    assert sorted(map(Path, links)) == [
        page for page in PAGES if page != Path("index.html")
    ]


def test_every_page_states_version_commit_and_date(site: Path) -> None:
    git = ["git", "log", "-1", "--abbrev=8", "--format=%cs %h"]
    date, commit = subprocess.run(
        git, cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.split()
    stamp = (
        f"Last updated on {date} (scleraforce {scleraforce.__version__}, commit"
        f" {commit})"
    )
    assert [
        page for page in PAGES if stamp not in (site / page).read_text(encoding="utf-8")
    ] == []


def test_the_reference_has_every_public_function_and_every_command(site: Path) -> None:
    functions = (site / "reference" / "functions.html").read_text(encoding="utf-8")
    for name in set(scleraforce.__all__) - {"__version__"}:
        assert f'id="scleraforce.{name}"' in functions, name

    commands = (site / "reference" / "commands.html").read_text(encoding="utf-8")
    assert [
        name for name in COMMANDS if f'id="scleraforce-{name}"' not in commands
    ] == []


def test_the_notebooks_run_and_their_pages_show_what_they_print_and_draw(
    site: Path,
) -> None:
    printed = {
        "first_reading": [
            "known E:   <Answer: class 1, 18",
            "class 2, 4",
            "3 in ",
            "force18",
        ],
        "my_own_recording": ["0.31 MPa", "classes right3 of 3", "predicted_force_mn"],
        "simulate_and_plot": ["SimulatedEye: 50.0 mN"],
    }
    assert [path.stem for path in NOTEBOOKS] == list(printed)

    for path in NOTEBOOKS:
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        assert not any(
            cell.get("outputs") or cell.get("execution_count") for cell in cells
        ), "commit without outputs"
        page = (site / "notebooks" / path.with_suffix(".html").name).read_text(
            encoding="utf-8"
        )
        assert page.count('<img alt="../_images/') >= 1, path
        text = html.unescape(re.sub(r"<[^>]+>", "", page))
        assert [words for words in printed[path.stem] if words not in text] == []


def test_no_page_asks_another_machine_for_anything(site: Path) -> None:
    for page in site.rglob("*.html"):
        fetched = re.findall(
            r'<(?:script|link|img|iframe)\b[^>]*(?:src|href)="(?:https?:)?//[^"]*"',
            page.read_text(),
        )
        assert not fetched, f"{page.name}: {fetched}"


def test_equations_are_drawn_by_the_browser_and_the_state_diagram_is_a_table(
    site: Path,
) -> None:
    physics = (site / "physics.html").read_text(encoding="utf-8")
    assert (
        physics.count("<math")
        >= (ROOT / "docs" / "physics.md").read_text(encoding="utf-8").count("$$") // 2
        > 5
    )
    assert "<mfrac>" in physics
    states = (site / "monitor_decision.html").read_text(encoding="utf-8")
    assert re.search(
        r"<p>WITHDRAW</p></td>\s*<td><p>WATCHING</p></td>\s*<td><p>reset after fresh"
        r" harmless",
        states,
    )


@pytest.mark.skipif(*NEEDS_CHROMIUM[1].args, **NEEDS_CHROMIUM[1].kwargs)
@pytest.mark.parametrize(
    ("query", "page"),
    [("Friedenwald rigidity", "physics.html"), ("open_library", "functions")],
)
def test_a_query_finds_its_page_with_an_excerpt_without_a_network(
    site: Path, offline: BrowserContext, query: str, page: str
) -> None:
    opened = offline.new_page()
    opened.goto(f"{(site / 'index.html').as_uri()}")
    opened.get_by_placeholder("Search").fill(query)
    opened.keyboard.press("Enter")
    opened.wait_for_selector("ul.search li a")
    links = opened.locator("ul.search li a").evaluate_all(
        "links => links.map((link) => link.getAttribute('href'))"
    )
    assert any(page in link for link in links), links

    if page.endswith(".html"):
        opened.wait_for_selector("ul.search li p.context")
        assert query.split()[0] in "".join(
            opened.locator("ul.search li p.context").all_inner_texts()
        )

    opened.close()


@pytest.mark.skipif(*NEEDS_CHROMIUM[1].args, **NEEDS_CHROMIUM[1].kwargs)
@pytest.mark.parametrize("width", [1280, 400])
def test_no_page_is_wider_than_the_screen_and_the_banner_is_whole(
    site: Path, offline: BrowserContext, width: int
) -> None:
    opened = offline.new_page()
    opened.set_viewport_size({"width": width, "height": 900})

    for page in PAGES:
        opened.goto((site / page).as_uri())
        wide = "document.documentElement.scrollWidth > window.innerWidth"
        cut = (
            "(e => e.scrollWidth >"
            " e.clientWidth)(document.querySelector('.announcement-content'))"
        )
        assert opened.evaluate(f"[{wide}, {cut}]") == [False, False], page

    opened.close()
