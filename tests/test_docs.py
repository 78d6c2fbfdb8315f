"""What the documentation says is true: its commands run and print what it shows, its Python is run by doctest.

A `console` block has lines `$ command`, each followed by what it prints; `...` stands for anything. The blocks of a
page run in order in one temporary folder. `make` targets are looked up only: CI runs them.
"""

import doctest
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from small_recordings import write_notebook_folder

import scleraforce
from scleraforce.cli.main import COMMANDS

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
LONG_COMMANDS = {"demo", "doctor", "simulate", "reproduce", "library", "generate", "train", "phantom", "calibrate"}
SLOW_COMMANDS = {*LONG_COMMANDS, "import"}
SLOW_CALLS = re.compile(r"\b(sf\.train|sf\.calibrate|linear_sections|FiniteWall|adaptive_bound_n)\(")
# Whose examples train and solve.
SLOW_MODULES = {f"scleraforce.notebook.{name}" for name in ("calibrating", "training", "virtual")}
LANGUAGES = {"console", "python", "toml", "json", "text", "csv", "mermaid", "{eval-rst}", ""}
FENCE = re.compile(r"^```([\w{}-]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PACKAGE = Path(scleraforce.__file__).parent
MODULES = sorted(
    "scleraforce." + ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
    for path in PACKAGE.rglob("*.py")
    if path.name != "__init__.py"
)

PUBLIC = [name for name in scleraforce.__all__ if not name.startswith("__")]
PUBLIC_MODULES = sorted({getattr(scleraforce, name).__module__ for name in PUBLIC})


@dataclass(frozen=True)
class Example:
    """A command and what it is said to print."""

    command: str
    output: str


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT).as_posix()).removeprefix("docs/")


def blocks(page: Path, language: str) -> list[str]:
    return [body for name, body in FENCE.findall(page.read_text(encoding="utf-8")) if name == language]


def examples(page: Path) -> Iterator[Example]:
    """The commands of a page's console blocks; a backslash at the end of a line continues it."""
    for body in blocks(page, "console"):
        assert body.startswith("$ "), f"{page.name}: a console block starts with `$ command`:\n{body}"
        for part in re.split(r"^\$ ", body, flags=re.MULTILINE)[1:]:
            lines = part.splitlines()
            ends = next(n for n, line in enumerate(lines) if not line.endswith("\\"))
            yield Example("\n".join(lines[: ends + 1]), "\n".join(lines[ends + 1 :]).strip())


def pages_with_commands() -> list[object]:
    """Pages whose commands take long are marked slow."""
    found = []
    for page in PAGES:
        used = {name for example in examples(page) for name in COMMANDS if f"scleraforce {name}" in example.command}
        if any(not example.command.startswith(("make", "cd ", "git ")) for example in examples(page)):
            long = pytest.mark.first if page.name == "README.md" else pytest.mark.long
            marks = [*[pytest.mark.slow] * bool(used & SLOW_COMMANDS), *[long] * bool(used & LONG_COMMANDS)]
            found.append(pytest.param(page, id=name_of(page), marks=marks))
    return found


WRITTEN = re.compile(r"(?:--(?:out|html|plot|black-box)[ =]|(?<![0-9&]) > )([^\s&]+)")


def ignored(name: str) -> bool:
    """Whether git ignores a file of this name in the project's folder."""
    return subprocess.run(["git", "check-ignore", "-q", name], cwd=ROOT, check=False).returncode == 0


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="not a git checkout")
def test_what_the_examples_of_the_readme_write_is_ignored_by_git() -> None:
    commands = [example.command for example in examples(ROOT / "README.md")]
    names = {name.split("/")[0] for command in commands for name in WRITTEN.findall(command)}
    assert {"eye-a", "modulus.json", "answers.html", "browse.html"} <= names
    assert [name for name in sorted(names) if not ignored(name)] == []
    assert not ignored("src/scleraforce/reader/model.py")


@pytest.mark.parametrize("page", pages_with_commands())
def test_the_commands_of_a_page_run_and_print_what_it_shows(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "COLUMNS": "80"}
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    checker = doctest.OutputChecker()
    for example in examples(page):
        if example.command.startswith(("make", "cd ", "git ")):
            continue
        given = {"cwd": tmp_path, "env": environment, "timeout": 600.0}
        done = subprocess.run(["bash", "-c", example.command], capture_output=True, text=True, check=False, **given)
        assert done.returncode == 0, f"{page.name}: $ {example.command}\n{done.stdout}{done.stderr}"
        if example.output:
            flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
            assert checker.check_output(example.output + "\n", done.stdout, flags), (
                f"{page.name}: $ {example.command}\nprinted:\n{done.stdout}\nthe page shows:\n{example.output}"
            )
    if page.name != "README.md":
        return
    monkeypatch.chdir(tmp_path)
    run_python(page)
    if (ROOT / ".git").exists():
        assert [path.name for path in tmp_path.iterdir() if path.name != "docs" and not ignored(path.name)] == []


def test_every_make_target_and_link_of_a_page_exists() -> None:
    for page in PAGES:
        check_targets_and_links(page)


def check_targets_and_links(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(), flags=re.MULTILINE))
    for example in examples(page):
        if example.command.startswith("make "):
            assert example.command.split()[1] in targets
    for link in re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", text):
        if "://" not in link:
            assert (page.parent / link).exists(), f"{page.name} links to {link}, which is not there"


def test_every_block_of_a_page_has_a_language_that_is_checked_here() -> None:
    for page in PAGES:
        unknown = {name for name, _ in FENCE.findall(page.read_text(encoding="utf-8"))} - LANGUAGES
        assert not unknown, f"{page}: blocks in {unknown}"


def run_python(page: Path) -> None:
    """Run the Python of a page in the current folder."""
    parser = doctest.DocTestParser()
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    source = "\n".join(blocks(page, "python"))
    assert ">>>" in source, f"{page.name}: write Python as a doctest"
    test = parser.get_doctest(source, {}, page.name, str(page), 0)
    assert runner.run(test).failed == 0


def pages_with_python() -> list[object]:
    """Pages whose Python trains or solves are slow; that of the README runs after its commands, on what they write."""
    found = [(page, "\n".join(blocks(page, "python"))) for page in PAGES if page.name != "README.md"]
    return [
        pytest.param(page, id=name_of(page), marks=[pytest.mark.slow] if SLOW_CALLS.search(python) else [])
        for page, python in found
        if python
    ]


@pytest.mark.parametrize("page", pages_with_python())
def test_the_python_of_a_page_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    run_python(page)


@pytest.fixture(scope="module")
def notebook_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the examples of the public functions read."""
    folder = tmp_path_factory.mktemp("notebook")
    write_notebook_folder(folder)
    return folder


def test_the_examples_in_docstrings_are_true() -> None:
    for name in MODULES:
        if name not in PUBLIC_MODULES and ">>>" in Path(str(find_spec(name).origin)).read_text(encoding="utf-8"):
            assert doctest.testmod(import_module(name), optionflags=doctest.ELLIPSIS).failed == 0, name


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW_MODULES else [], id=name) for name in PUBLIC_MODULES],
)
def test_the_examples_of_what_is_public_are_true(
    name: str, notebook_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(notebook_folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(notebook_folder / "cache"))
    assert doctest.testmod(import_module(name), optionflags=doctest.ELLIPSIS).failed == 0


def test_the_toml_of_the_pages_is_toml() -> None:
    for page in PAGES:
        for body in blocks(page, "toml"):
            tomllib.loads(body)


def test_make_help_lists_every_target_that_is_a_task() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    tasks = set(re.search(r"^\.PHONY: (.*)$", makefile, flags=re.MULTILINE).group(1).split())
    listed = subprocess.run(["make", "-s", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert {line.split()[1] for line in listed.splitlines()} == tasks
    assert "$" not in listed


def test_the_readme_shows_every_command() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for name in COMMANDS:
        assert f"scleraforce {name}" in readme, f"README.md does not show `scleraforce {name}`"
