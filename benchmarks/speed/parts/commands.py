"""Commands from a cold start, as a user or a script calls them."""

import sys

from scleraforce.recordings.recording_folder import read_recording
from speed.children import command_seconds, scleraforce
from speed.parts.recording import made_recording
from speed.record import Row, Table, spread
from speed.run import ROOT, Run

BARE = "`python -c pass`"
IMPORTS = "`python -c 'import numpy, cv2, onnxruntime'`"
HELP = "`scleraforce --help`"
READ = "`scleraforce read default FRAME`"
CALIBRATE = "`scleraforce calibrate EYE --frames 3`"
GOALS_S = {HELP: 0.09, READ: 0.5, CALIBRATE: 1.0}
BESIDE = {HELP: BARE, READ: IMPORTS}
SETTINGS = """A new process each time, in turns; its files are in the system's cache.
The value is the least, which other work on the machine disturbs least. The calibration
seeks the stiffening, with the bundled library in place."""


def measure(run: Run) -> Table:
    """Start each command several times."""
    path = made_recording(run)
    frame = read_recording(path).frame_path(read_recording(path).frames[0])
    known = [
        "--youngs-modulus-mpa",
        "0.3",
        "--iop-mmhg",
        "2",
        "--thickness-um",
        "650",
        "--gap-mm",
        "0.5",
    ]
    eye = run.folder / "eye"
    out = run.folder / "eye.json"
    mechanics = ["--mechanics", "finite-strain", "--thickness-um", "650"]
    study = ["--study", str(ROOT / "docs" / "quick.toml")]
    command_seconds(scleraforce("phantom", "--out", str(eye), *mechanics, *study))
    commands = {
        BARE: [sys.executable, "-c", "pass"],
        HELP: scleraforce("--help"),
        IMPORTS: [sys.executable, "-c", "import numpy, cv2, onnxruntime"],
        READ: scleraforce("read", "default", str(frame), *known),
        CALIBRATE: scleraforce(
            "calibrate", str(eye), "--frames", "3", "--out", str(out)
        ),
    }
    taken: dict[str, list[float]] = {name: [] for name in commands}

    for _ in range(run.count(12, 1)):
        for name, command in commands.items():
            out.unlink(missing_ok=True)
            taken[name].append(command_seconds(command))

    rows = [
        Row(
            what=name,
            unit="s",
            value=min(seconds),
            spread=spread(seconds)["spread"],
            beside=BESIDE.get(name, ""),
            beside_value=min(taken[BESIDE[name]]) if name in BESIDE else None,
            goal=GOALS_S.get(name),
        )
        for name, seconds in taken.items()
    ]
    return Table("Commands", SETTINGS, tuple(rows))
