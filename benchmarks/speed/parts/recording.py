"""The virtual recording that commands and monitor are given."""

from pathlib import Path

from speed.children import command_seconds, scleraforce
from speed.run import ROOT, Run


def made_recording(run: Run) -> Path:
    """Return the run's recording, 100 frames a second up to 20 mN; make it where no
    other part has.
    """
    path = run.folder / "recording"
    if not path.exists():
        eye = [
            "--thickness-um",
            "650",
            "--youngs-modulus-mpa",
            "0.3",
            "--mechanics",
            "finite-strain",
        ]
        push = [
            "--rate-hz",
            "100",
            "--forces-mn",
            "20",
            "--hold-s",
            "0.5" if run.quick else "2",
        ]
        study = ["--study", str(ROOT / "docs" / "quick.toml")]
        command_seconds(scleraforce("phantom", "--out", str(path), *study, *eye, *push))

    return path
