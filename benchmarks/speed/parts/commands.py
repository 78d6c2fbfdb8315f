"""Commands from a cold start, as a user or a script calls them."""

import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

from monitor.real_monitor import scleraforce
from scleraforce.recordings.recording_folder import read_recording
from speed.children import command_seconds
from speed.parts.recording import made_recording
from speed.record import Row, Table, spread
from speed.run import ROOT, Run, in_turns

BARE = "`python -c pass`"
IMPORTS = "`python -c 'import numpy, cv2, onnxruntime'`"
HELP = "`scleraforce --help`"
READ = "`scleraforce read default FRAME`"
CALIBRATE = "`scleraforce calibrate EYE --frames 3`"
GOALS_S = {HELP: 0.09, READ: 0.5, CALIBRATE: 1.0}
BESIDE = {HELP: BARE, READ: IMPORTS, CALIBRATE: IMPORTS}
KNOWN = {
    "--youngs-modulus-mpa": "0.3",
    "--iop-mmhg": "2",
    "--thickness-um": "650",
    "--gap-mm": "0.5",
}
SETTINGS = """A new process each time, in turns; its files are in the system's cache.
The value is the least, which other work on the machine disturbs least. The calibration
seeks the stiffening, with the bundled library in place."""


def measure(run: Run) -> Table:
    """Start each command several times."""
    recording = read_recording(made_recording(run))
    frame = recording.frame_path(recording.frames[0])
    known = [word for option in KNOWN.items() for word in option]
    eye = str(run.folder / "eye")
    out = run.folder / "eye.json"
    mechanics = ["--mechanics", "finite-strain", "--thickness-um", "650"]
    study = ["--study", str(ROOT / "docs" / "quick.toml")]
    command_seconds(scleraforce("phantom", "--out", eye, *mechanics, *study))
    commands = {
        BARE: [sys.executable, "-c", "pass"],
        HELP: scleraforce("--help"),
        IMPORTS: [sys.executable, "-c", "import numpy, cv2, onnxruntime"],
        READ: scleraforce("read", "default", str(frame), *known),
        CALIBRATE: scleraforce("calibrate", eye, "--frames", "3", "--out", str(out)),
    }
    taken_s = in_turns(
        {name: partial(_run, command, out) for name, command in commands.items()},
        run.count(12, 1),
    )
    rows = {
        name: Row(
            what=name,
            unit="s",
            value=min(seconds),
            spread=spread(seconds)["spread"],
            goal=GOALS_S.get(name),
        )
        for name, seconds in taken_s.items()
    }
    for name, beside in BESIDE.items():
        value = rows[beside].value
        rows[name] = replace(rows[name], beside=beside, beside_value=value)

    return Table("Commands", SETTINGS, tuple(rows.values()))


def _run(command: list[str], out: Path) -> None:
    """Run a command, whose result is not there yet."""
    out.unlink(missing_ok=True)
    command_seconds(command)
