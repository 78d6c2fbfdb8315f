"""The documentation is true: its commands run and print what it shows, its Python is
run by doctest.

A `console` block has lines `$ command`, each followed by its output; `...` stands for
anything. The blocks of a page run in order in one temporary folder. `make` targets are
only looked up: CI runs them.
"""

import doctest
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from effects import cache_of_its_own
from small_recordings import write_notebook_folder

import scleraforce
from reading_ranges import boxed
from requirements_trace import STATED, trace_page
from scleraforce.front.cli.main import COMMANDS

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
LONG_COMMANDS = {
    "demo",
    "doctor",
    "simulate",
    "reproduce",
    "library",
    "generate",
    "train",
    "phantom",
    "calibrate",
}
SLOW_COMMANDS = {*LONG_COMMANDS, "import"}
SLOW_CALLS = re.compile(r"\b(sf\.train|sf\.calibrate|LinearSections|FiniteWall)\(")
# Modules whose examples train and solve.
LANGUAGES = {
    "console",
    "python",
    "toml",
    "json",
    "text",
    "csv",
    "mermaid",
    "{eval-rst}",
    "",
}
FENCE = re.compile(r"^```([\w{}-]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PACKAGE = Path(scleraforce.__file__).parent
SOURCES = [
    path.relative_to(PACKAGE)
    for path in PACKAGE.rglob("*.py")
    if path.name != "__init__.py"
]
MODULES = sorted(
    ".".join(["scleraforce", *path.with_suffix("").parts]) for path in SOURCES
)

PUBLIC = [name for name in scleraforce.__all__ if not name.startswith("__")]
PUBLIC_MODULES = sorted({getattr(scleraforce, name).__module__ for name in PUBLIC})


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT).as_posix()).removeprefix("docs/")


def blocks(page: Path, language: str) -> list[str]:
    return [
        body
        for name, body in FENCE.findall(page.read_text(encoding="utf-8"))
        if name == language
    ]


def examples(page: Path) -> Iterator[tuple[str, str]]:
    """Yield the commands of a page's console blocks with their output; a backslash at
    the end continues a line.
    """
    for body in blocks(page, "console"):
        assert body.startswith("$ "), (
            f"{page.name}: a console block starts with `$ command`:\n{body}"
        )
        for part in re.split(r"^\$ ", body, flags=re.MULTILINE)[1:]:
            lines = part.splitlines()
            ends = next(n for n, line in enumerate(lines) if not line.endswith("\\"))
            yield "\n".join(lines[: ends + 1]), "\n".join(lines[ends + 1 :]).strip()


def pages_with_commands() -> list[object]:
    """Return the pages with commands; slow if these take long."""
    found = []
    for page in PAGES:
        shown = [
            command for command, _ in examples(page) if not command.startswith("make ")
        ]
        used = {
            name
            for command in shown
            for name in COMMANDS
            if f"scleraforce {name}" in command
        }

        if shown:
            long = pytest.mark.first if page.name == "README.md" else pytest.mark.long
            marks = [
                *[pytest.mark.slow] * bool(used & SLOW_COMMANDS),
                *[long] * bool(used & LONG_COMMANDS),
            ]
            found.append(pytest.param(page, id=name_of(page), marks=marks))

    return found


def ignored(name: str) -> bool:
    """Return True if git ignores a file of this name in the project's folder."""
    return (
        subprocess.run(
            ["git", "check-ignore", "-q", name], cwd=ROOT, check=False
        ).returncode
        == 0
    )


@pytest.mark.parametrize("page", pages_with_commands())
def test_the_commands_of_a_page_run_and_print_what_it_shows(
    page: Path, tmp_path: Path, monkeypatch
) -> None:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "COLUMNS": "80"}
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    checker = doctest.OutputChecker()

    for command, output in examples(page):
        if command.startswith("make "):
            continue

        given = {"cwd": tmp_path, "env": environment, "timeout": 600.0}
        done = subprocess.run(
            ["bash", "-c", command],
            capture_output=True,
            text=True,
            check=False,
            **given,
        )
        assert done.returncode == 0, (
            f"{page.name}: $ {command}\n{done.stdout}{done.stderr}"
        )

        if output:
            flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
            assert checker.check_output(output + "\n", done.stdout, flags), (
                f"{page.name}: $ {command}\nprinted:\n{done.stdout}\nthe page"
                f" shows:\n{output}"
            )

    if page.name != "README.md":
        return

    monkeypatch.chdir(tmp_path)
    run_python(page)

    if (ROOT / ".git").exists():
        assert [
            path.name
            for path in tmp_path.iterdir()
            if path.name != "docs" and not ignored(path.name)
        ] == []


def test_every_make_target_link_language_and_toml_of_a_page_exists() -> None:
    targets = set(
        re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE)
    )
    for page in (*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"):
        text = page.read_text(encoding="utf-8")
        links = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text)
        missing = [
            link
            for link in links
            if "://" not in link and not (page.parent / link).exists()
        ]
        assert not missing, f"{page.name} links to {missing}, which do not exist"

        if page in PAGES:
            called = {
                command.split()[1]
                for command, _ in examples(page)
                if command.startswith("make ")
            }
            assert called <= targets, page
            unknown = {name for name, _ in FENCE.findall(text)} - LANGUAGES
            assert not unknown, f"{page}: blocks in {unknown}"

            for body in blocks(page, "toml"):
                tomllib.loads(body)


def run_python(page: Path) -> None:
    """Run the Python of a page in the current folder."""
    parser = doctest.DocTestParser()
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    source = "\n".join(blocks(page, "python"))
    assert ">>>" in source, f"{page.name}: write Python as a doctest"
    test = parser.get_doctest(source, {}, page.name, str(page), 0)
    assert runner.run(test).failed == 0


def pages_with_python() -> list[object]:
    """Pages whose Python trains or solves are slow; that of the README runs after its
    commands, on what they write.
    """
    found = [
        (page, "\n".join(blocks(page, "python")))
        for page in PAGES
        if page.name != "README.md"
    ]
    return [
        pytest.param(
            page,
            id=name_of(page),
            marks=[pytest.mark.slow] if SLOW_CALLS.search(python) else [],
        )
        for page, python in found
        if python
    ]


@pytest.mark.parametrize("page", pages_with_python())
def test_the_python_of_a_page_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    run_python(page)


@pytest.fixture(scope="module")
def notebook_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the inputs of the public functions' examples."""
    folder = tmp_path_factory.mktemp("notebook")
    write_notebook_folder(folder)
    cache_of_its_own(folder / "cache")
    return folder


def test_the_examples_in_docstrings_are_true() -> None:
    for name in MODULES:
        if name not in PUBLIC_MODULES and ">>>" in Path(
            str(find_spec(name).origin)
        ).read_text(encoding="utf-8"):
            assert (
                doctest.testmod(
                    import_module(name), optionflags=doctest.ELLIPSIS
                ).failed
                == 0
            ), name


@pytest.mark.parametrize("name", PUBLIC_MODULES)
def test_the_examples_of_the_public_functions_are_true(
    name: str, notebook_folder: Path, monkeypatch
) -> None:
    monkeypatch.chdir(notebook_folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(notebook_folder / "cache"))
    assert (
        doctest.testmod(import_module(name), optionflags=doctest.ELLIPSIS).failed == 0
    )


TEXTS = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted(PACKAGE.rglob("*.py")),
    *sorted((ROOT / "benchmarks").rglob("*.py")),
]
# in which `package/module.py` may be
FOLDERS = (
    ROOT,
    PACKAGE,
    PACKAGE.parent,
    ROOT / "benchmarks",
)
FILE = re.compile(r"(?<![\w./])(\w+(?:/\w+)+\.py)\b")


def test_every_module_that_a_text_names_exists() -> None:
    missing: dict[str, list[str]] = {}
    for path in TEXTS:
        text = path.read_text(encoding="utf-8")
        if found := [
            name
            for name in FILE.findall(text)
            if not any((folder / name).is_file() for folder in FOLDERS)
        ]:
            missing[str(path.relative_to(ROOT))] = found

    assert not missing, f"named, but missing: {missing}"


FIT = "The reader's fit (default), the eye's E"
PAPERS = "The paper's: linear, E of the population"
QUOTED = ("right class, %", "force error, mN", "intervals hold, %", "class 2 read as 0")


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip("|").split("|")]


def figures() -> dict[str, dict[str, dict[str, str]]]:
    """Return the tables of docs/figures.md: method -> group -> heading -> cell, without
    goals.
    """
    found: dict[str, dict[str, dict[str, str]]] = {}
    rows = {}
    head = []

    for line in (ROOT / "docs" / "figures.md").read_text(encoding="utf-8").splitlines():
        if title := re.fullmatch(r"\*\*(.+)\*\*", line):
            rows = found.setdefault(title[1], {})
            head = []
        elif not line and head:  # the end of a table
            rows = {}
            head = []
        elif line.startswith("| ") and not line.startswith("| ---"):
            head = head or cells(line)
            rows[cells(line)[0]] = dict(
                zip(
                    head,
                    (re.sub(r" \(.*", "", cell) for cell in cells(line)),
                    strict=False,
                )
            )

    return found


def test_the_readme_quotes_the_figures_of_the_page() -> None:
    fit = figures()[FIT]
    paper = figures()[PAPERS]
    readme = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    quoted = {
        row[0].split(":")[0]: row[1:]
        for row in map(cells, readme)
        if len(row) == 6 and row[0].split(":")[0] in fit
    }
    assert len(quoted) >= 3

    for group, (right, error, held, harmless, papers) in quoted.items():
        stated = [
            right.removesuffix(" %"),
            error.removesuffix(" mN"),
            held.removesuffix(" %"),
            harmless,
        ]
        assert stated == [fit[group][column] for column in QUOTED], group
        assert papers.removesuffix(" %") == paper[group][QUOTED[0]], group


def test_the_readme_has_the_ranges_of_the_bundled_reader() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert boxed(text) == text, "run `make ranges`"
    with pytest.raises(ValueError, match="the marks"):
        boxed("# a page\n")


REQUIREMENTS = tomllib.loads(STATED.read_text(encoding="utf-8"))["requirement"]


def test_every_hazard_cites_requirements_and_every_requirement_belongs_to_one() -> None:
    page = (ROOT / "docs" / "hazards.md").read_text(encoding="utf-8")
    hazards = [cells(line) for line in page.splitlines() if line.startswith("| H")]
    cited = [re.findall(r"\bR\d+\b", row[-2]) for row in hazards]
    assert all(cited)
    assert {name for names in cited for name in names} == {
        requirement["id"] for requirement in REQUIREMENTS
    }


def test_the_trace_is_of_todays_tests_and_a_requirement_without_one_is_found(
    tmp_path: Path,
) -> None:
    page = trace_page()
    assert (ROOT / "docs" / "requirements.md").read_text(encoding="utf-8") == page, (
        "run `make trace`"
    )
    assert re.search(r"::test_a_lower_bound_withdraws\w+` \*\(slow\)\*", page)
    assert re.search(r"::test_a_steep_ramp_is_foreseen`$", page, flags=re.MULTILINE)
    stated = tmp_path / "requirements.toml"
    absent = "there is no such test"
    faults = {
        '["tests/live/decision/test_decide.py::test_that_is_not_there"]': absent,
        '["tests/nowhere.py::test_the_table_is_total"]': absent,
        "[]": "R1: no test",
    }

    for tests, fault in faults.items():
        stated.write_text(
            f'[[requirement]]\nid = "R1"\ntext = "..."\ntests = {tests}\n'
        )
        with pytest.raises(ValueError, match=fault):
            trace_page(stated)
