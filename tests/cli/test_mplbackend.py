"""MPLBACKEND, which Jupyter sets to a backend that Matplotlib refuses without it, matters to no command that draws."""

import os
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from foreign_files import FRAMES, told
from small_recordings import looked_at_frames

SCLERAFORCE = Path(sys.executable).with_name("scleraforce")
BACKEND = "refused"  # as module://matplotlib_inline.backend_inline is where Jupyter is not installed


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("backend")
    looked_at_frames(folder / "r", 1)
    cv2.imwrite(str(folder / "a.png"), FRAMES[0])
    return folder


def in_jupyter(place: Path, *command: object) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "MPLBACKEND": BACKEND}
    return subprocess.run(list(map(str, command)), cwd=place, env=environment, capture_output=True, text=True)


COMMANDS = [
    ["import", "a.png", "--out", "i", *told("--bits", 13), "--width-mm", "10", "--depth-mm", "4"],
    *(
        pytest.param(command, marks=pytest.mark.slow)
        for command in (
            ["show", "r", "--plot", "r.svg"],
            ["evaluate", "default", "r", "--html", "evaluate.html"],
            ["demo", "--out", "demo"],
        )
    ),
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: " ".join(command[:4]))
def test_the_variable_does_not_matter_to_a_command(place: Path, command: list[str]) -> None:
    done = in_jupyter(place, SCLERAFORCE, *command)
    assert (done.returncode, "internal fault" in done.stderr) == (0, False), done.stderr


def test_the_variable_of_a_notebook_stays_as_it_is(place: Path) -> None:
    lines = [
        "import os, scleraforce as sf, scleraforce.cli.main",
        "model, frame = sf.load_model('default'), 'r/frames/0001.png'",
        "sf.read(model, frame)",
        f"assert os.environ['MPLBACKEND'] == {BACKEND!r}",
    ]
    done = in_jupyter(place, sys.executable, "-c", "\n".join(lines))
    assert done.returncode == 0, done.stderr


def test_matplotlib_itself_refuses_such_a_variable(place: Path) -> None:
    assert in_jupyter(place, sys.executable, "-c", "import matplotlib").returncode != 0
