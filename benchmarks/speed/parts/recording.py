"""The virtual recording that commands and monitor are given."""

from pathlib import Path

from monitor.real_monitor import scleraforce
from speed.children import command_seconds
from speed.run import ROOT, Run


def made_recording(run: Run) -> Path:
    """Return the run's recording, 100 frames a second up to 20 mN; make it where no
    other part has.
    """
    path = run.folder / "recording"
    if not path.exists():
        options = {
            "--study": str(ROOT / "docs" / "quick.toml"),
            "--thickness-um": "650",
            "--youngs-modulus-mpa": "0.3",
            "--mechanics": "finite-strain",
            "--rate-hz": "100",
            "--forces-mn": "20",
            "--hold-s": "0.5" if run.quick else "2",
        }
        words = [word for option in options.items() for word in option]
        command_seconds(scleraforce("phantom", "--out", str(path), *words))

    return path
