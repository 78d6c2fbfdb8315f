"""Every command at 80 columns, in a pipe, with --json, with --quiet, on a terminal with
and without NO_COLOR.
"""

import json
import os
import pty
import re
import subprocess
import termios
from contextlib import suppress
from pathlib import Path

import cv2
import pytest
from analytic_frames import drawn_counts
from effects import SCLERAFORCE, cache_of_its_own
from small_recordings import write_eye_and_reader, write_stores
from waiting import ends

from scleraforce.front.cli.main import COMMANDS
from scleraforce.library import library_store

pytest.importorskip("torch")

CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")  # all but tab and newline
COLOUR = re.compile(r"\x1b\[[0-9;]*m")
SMALL = (
    "[mesh]\ndivisions = 4\n[dataset]\ncontacts = 2\n[[dataset.group]]\nthickness_um ="
    " 500.0\nimages = 20\n"
)
FRAME = "eye-a/frames/0001.png"
# The arguments of each command, in the folder below; {out} is new for each run.
RUNS = {
    "init": "{out}",
    "cite": "",
    "simulate": "--study small.toml --thickness-um 600 --force-mn 10",
    "phantom": "--study small.toml --out {out} --forces-mn 2,20 --thickness-um 600",
    "segment": FRAME + " --out {out}",
    "scanner": (
        "drawn/0.png drawn/1.png --width-mm 15 --depth-mm 4 --bits 12 --out {out}.toml"
    ),
    "library": "--study study.toml --out {out}",
    "calibrate": "eye-a --study study.toml --frames 2 --out {out}",
    "generate": "--study small.toml --out {out} --workers 1",
    "train": "dataset --out {out}",
    "read": "./reader " + FRAME,
    "evaluate": "./reader eye-a",
    "import": (
        FRAME + " --out {out} --width-mm 15 --depth-mm 4 --bits 12 --rate-hz 1"
        " --refractive-index 1 --gauge 22 --gap-mm 0.6 --eye eye-b"
    ),
    "export": "eye-a --out {out}.csv",
    "show": "eye-a",
    "doctor": "",
    "demo": "--out {out}",
}
# They need a monitor, or a quarter of an hour; these calls cannot begin.
REFUSED = {
    "app": "nowhere",
    "monitor": "nowhere",
    "monitor-reset": "--port 1 --token-file study.toml",
    "replay": "eye-a --port 1",
    "reproduce": "--out study.toml",
}
SLOW = {
    "calibrate",
    "demo",
    "doctor",
    "generate",
    "phantom",
    "scanner",
    "simulate",
    "train",
}
NEVER_QUIET = {"monitor"}  # its operator has to see its lines
# of these: each runs them four times; `.ci/run` has tests of their own
LONG = {
    "demo",
    "doctor",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("manners")
    write_eye_and_reader(path)
    (path / "small.toml").write_text(SMALL)
    (path / "drawn").mkdir()

    for number in range(2):
        cv2.imwrite(str(path / "drawn" / f"{number}.png"), drawn_counts(7700 + number))

    cache_of_its_own(path / "cache")
    return path


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.setenv("COLUMNS", "80")
    return folder


def words(name: str, tmp_path: Path, number: int = 0) -> list[str]:
    line = {**RUNS, **REFUSED}[name].format(out=tmp_path / f"new-{number}")
    return [name, *line.split()]


def marks_of(name: str) -> list[pytest.MarkDecorator]:
    return [pytest.mark.slow] * (name in SLOW) + [pytest.mark.long] * (name in LONG)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself_within_80_columns(shell, name: str) -> None:
    assert name in {*RUNS, *REFUSED}  # and is tried below
    out, _ = shell.run(name, "--help")
    assert out.startswith(f"Usage: scleraforce {name}")
    assert max(map(len, out.splitlines())) <= 80
    assert not CONTROL.search(out)
    # click's mark for verbatim text, typed into a raw docstring
    assert "\\b" not in out
    assert ("--quiet" in out) == (name not in NEVER_QUIET)
    assert "--json" in out


@pytest.mark.parametrize("name", [pytest.param(n, marks=marks_of(n)) for n in RUNS])
def test_a_command_is_readable_in_a_pipe_one_object_with_json_and_silent_with_quiet(
    here: Path, name: str, tmp_path, shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name in SLOW and not (here / "dataset").exists():
        write_stores(here)
    built = library_store.LibraryBuild(144, 144, 1.0)
    monkeypatch.setattr(library_store, "build_library", lambda *_, **__: built)
    out, err = shell.run(*words(name, tmp_path))
    assert out
    assert not CONTROL.search(out + err)

    for line in out.splitlines():
        # A record stays one line, so that it can be searched for; tables and prose fit.
        assert (
            len(line) <= 80 or line.startswith(FRAME) or str(tmp_path.parent) in line
        ), line

    for number, options in enumerate((["--json"], ["--quiet", "--json"]), start=1):
        out, err = shell.run(*words(name, tmp_path, number), *options)
        assert isinstance(json.loads(out), dict)
        assert err == ""

    assert shell.run(*words(name, tmp_path, 3), "--quiet") == ("", "")


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize("option", ["", "--json", "--quiet"])
@pytest.mark.parametrize("name", REFUSED)
def test_a_command_that_cannot_begin_prints_one_line_with_any_option(
    tmp_path: Path, shell, name: str, option: str
) -> None:
    if option != "--quiet" or name not in NEVER_QUIET:
        said = shell.refused(*words(name, tmp_path), option, codes=(1, 2))
        assert not CONTROL.search(said)


@pytest.mark.parametrize(
    ("encoding", "sheet"),
    [
        ("ascii", []),
        pytest.param("cp932", ["--sheet", "s.png"], marks=pytest.mark.slow),
    ],
)
def test_a_process_prints_in_any_encoding_and_draws_without_jupyters_backend(
    here: Path, encoding: str, sheet: list[str], tmp_path: Path
) -> None:
    """Jupyter's backend is of a package that may not be installed where a notebook
    calls a command, and Matplotlib refuses it at its import.
    """
    missing = "5 µm ± 1°, 眼 ﬁ 😀.png"
    done = subprocess.run(
        [*SCLERAFORCE, *words("segment", tmp_path), missing, *sheet],
        cwd=here,
        env=os.environ | {"PYTHONIOENCODING": encoding, "MPLBACKEND": "refused"},
        capture_output=True,
        check=False,
    )
    # Click writes UTF-8 where it is told ASCII
    captured = "utf-8" if encoding == "ascii" else encoding
    said = done.stderr.decode(captured)
    assert done.returncode == 2, said
    assert "No such file" in said
    assert "fault" not in said
    assert re.search(r"wall of \d+ [µμu]m", done.stdout.decode(captured))
    assert all((here / name).exists() for name in sheet[1:])


def on_a_terminal(
    arguments: list[str], folder: Path, **environment: str
) -> tuple[str, str]:
    """Run a command whose standard error is a terminal; return what it wrote to its
    output and to that.
    """
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    given = {"cwd": folder, "env": os.environ | environment, "stderr": theirs}

    with subprocess.Popen(
        [*SCLERAFORCE, *arguments], stdout=subprocess.PIPE, text=True, **given
    ) as process:
        os.close(theirs)
        assert process.stdout is not None
        shown = b""
        with ends(process.stdout), suppress(OSError):  # the other end is closed
            while True:
                shown += os.read(ours, 4096)

        printed = process.stdout.read()

    os.close(ours)
    assert process.returncode == 0, shown
    return printed, shown.decode()


@pytest.mark.parametrize(
    "environment", [{"NO_COLOR": "1"}, pytest.param({}, marks=pytest.mark.slow)]
)
def test_a_bar_on_a_terminal_has_no_colour_and_disappears(
    here: Path, environment: dict[str, str]
) -> None:
    printed, shown = on_a_terminal(["classify", "./reader", FRAME], here, **environment)
    assert "class 1" in printed
    assert "frames" in shown  # the bar's title
    assert not COLOUR.search(printed + shown)
    assert shown.rstrip(" ").endswith("\r")  # wiped

    if not environment:
        assert on_a_terminal(["classify", "./reader", FRAME, "--quiet"], here) == (
            "",
            "",
        )
