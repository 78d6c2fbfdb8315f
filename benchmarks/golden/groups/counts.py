"""Counts that noise does not touch: modules imported, loops compiled, files opened,
passes over a frame, memory allocated, factorizations and solves.
"""

import json
import subprocess
import sys
from pathlib import Path

from golden.answers import Answers
from golden.inputs import frame_files

EYE = "plain"  # that is read
MODEL = "default"


def answers(name: str, recordings: dict[str, Path], folder: Path) -> Answers:
    """Return all counts, each from a process of its own."""
    recording = recordings[name]
    frames = [str(file) for file in frame_files(recording)]
    frame = frames[0]
    pieces = {
        "import scleraforce": ["import"],
        "scleraforce --help": ["command", "--help"],
        "scleraforce read --help": ["command", "read", "--help"],
        "scleraforce read FRAME": ["command", "read", MODEL, frame],
        "scleraforce segment FRAME": [
            "command",
            "segment",
            frame,
            "--out",
            str(folder / "masks"),
        ],
        "scleraforce evaluate RECORDING": [
            "command",
            "evaluate",
            MODEL,
            str(recording),
        ],
        "scleraforce calibrate RECORDING": [
            "command",
            "calibrate",
            str(recording),
            "--frames",
            "3",
            "--out",
            str(folder / "calibration.json"),
        ],
        "scleraforce show RECORDING": ["command", "show", str(recording)],
        "sf.read, second time": ["read", frame],
        "sf.segment, second time": ["segment", frame],
        "monitor, last frame": ["monitor", *frames],
        "solves, linear": ["solves", "linear"],
        "solves, finite strain": ["solves", "finite-strain"],
        "solves, sealed": ["solves", "sealed"],
        "solves, load path of a library": ["solves", "load path"],
    }
    return {name: dict(_counted(words)) for name, words in pieces.items()}


def _counted(words: list[str]) -> dict[str, int]:
    done = subprocess.run(
        [sys.executable, "-m", "golden.counted", *words],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise RuntimeError(f"golden.counted {words[0]}: {done.stderr}")
    counts: dict[str, int] = json.loads(done.stdout.splitlines()[-1])
    return counts
