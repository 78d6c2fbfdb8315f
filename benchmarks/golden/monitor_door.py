"""What a running monitor reads in the frames of a recording: its network, and its
second opinion.

A real monitor gets the frames over OpenIGTLink from `replay --step`, each one when the
last was read twice; frames of several planes come from `replay` slowly. Readings do not
depend on the pace, but for those of tissue that may relax. The monitor's decisions
would, so they are made in virtual time (`groups.sessions`).
"""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from math import degrees
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import scleraforce as sf

SCLERAFORCE = str(Path(sys.executable).with_name("scleraforce"))
READ_S = 120.0  # for a frame to be read twice, on a machine that is very busy
LOOK_S = 0.005
END_S = 120.0
MOMENT_S = 1.0  # an opinion takes 0.02 s
PA_PER_MMHG = 133.322387415

Entry = dict[str, Any]


class MonitorRefusedError(Exception):
    """The monitor ended at its start; the words are its own."""


@dataclass(frozen=True)
class MonitorReadings:
    """The network's entries of the monitor's log, and the second opinion's verdicts, a
    frame each.
    """

    network: tuple[Entry, ...]
    opinions: tuple[Entry, ...]


def monitor_readings(
    recording: Path, calibration: Path | None, folder: Path, model: str
) -> MonitorReadings:
    """Show a recording to a monitor that knows of the eye what the recording and the
    calibration state.
    """
    log = folder / f"{recording.name}.black-box"
    tapped = folder / f"{recording.name}.opinions"
    tapped.touch()
    options = [*_eye_options(recording, calibration), "--black-box", str(log)]
    opened = sf.read_recording(recording)
    count = len(opened.frames)
    with _monitor(tapped, [model, *options]) as port:
        if opened.info.scan.planes:
            _play(recording, port)
        else:
            _step(
                recording, port, lambda: len(_frames(log)), lambda: len(_lines(tapped))
            )
        _await_count(lambda: len(_frames(log)), count, "frames")
        _await_count(lambda: len(_lines(tapped)), count, "second opinions")
    return MonitorReadings(tuple(_frames(log)), tuple(_lines(tapped)))


def _eye_options(recording: Path, calibration: Path | None) -> list[str]:
    """Return the options that tell a monitor what a recording states of its eye, needle
    and scanner.
    """
    info = sf.read_recording(recording).info
    eye, needle, scan = info.eye, info.needle, info.scan
    direction_rad = scan.direction_rad
    options: dict[str, Any] = {
        "--columns": scan.columns,
        "--rows": scan.rows,
        "--width-mm": 1e3 * scan.extent_m[0],
        "--depth-mm": 1e3 * scan.extent_m[1],
        "--refractive-index": scan.refractive_index,
        "--thickness-um": None if eye.thickness_m is None else 1e6 * eye.thickness_m,
        "--iop-mmhg": None if eye.iop_pa is None else eye.iop_pa / PA_PER_MMHG,
        "--globe": None if eye.globe is None else eye.globe.kind,
        "--polar-angle-deg": None
        if needle.polar_rad is None
        else degrees(needle.polar_rad),
        "--plane-direction-deg": None
        if direction_rad is None
        else degrees(direction_rad),
        "--calibration": calibration,
        "--eye": eye.name,
    }
    if needle.gap_m is not None:
        options["--gap-mm"] = 1e3 * needle.gap_m
    words = [
        word
        for option, value in options.items()
        if value is not None
        for word in (option, str(value))
    ]
    for plane in scan.planes:
        place = f"{1e3 * plane.offset_m!r}:{degrees(plane.direction_rad)!r}"
        words += ["--plane", f"{plane.name}:{place}"]
    return words


@contextmanager
def _monitor(tapped: Path, words: list[str]) -> Iterator[int]:
    """Run a monitor on a free port, which is yielded; copy its second opinions."""
    command = [sys.executable, "-m", "golden.monitored", str(tapped), *words]
    process = subprocess.Popen(
        [*command, "--port", "0", "--json"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert process.stderr is not None
    lines: list[str] = []
    try:
        for line in process.stderr:
            lines.append(line)
            if line.startswith("reset"):
                break
        else:
            raise MonitorRefusedError("".join(lines).strip())
        listens = next(line for line in lines if line.startswith("listens"))
        yield int(listens.split()[2].rpartition(":")[2])
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=END_S)


def _step(
    recording: Path, port: int, frames: Callable[[], int], opinions: Callable[[], int]
) -> None:
    """Send the frames of a recording, each when the monitor has read the one before
    twice.
    """
    command = [SCLERAFORCE, "replay", str(recording), "--port", str(port)]
    process = subprocess.Popen(
        [*command, "--step", "--json"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    try:
        for number in range(1, len(sf.read_recording(recording).frames) + 1):
            if process.poll() is not None:
                raise RuntimeError(f"replay ended: {process.communicate()[1]}")
            process.stdin.write("\n")
            process.stdin.flush()
            _await_count(frames, number, "frames")
            _await_count(opinions, number, "second opinions")
    finally:
        process.communicate(timeout=END_S)


def _play(recording: Path, port: int) -> None:
    """Send the frames of several planes so that those of one moment have one stamp, and
    moments `MOMENT_S` between.
    """
    times_s = sorted({frame.time_s for frame in sf.read_recording(recording).frames})
    least_s = min(after - before for before, after in pairwise(times_s))
    command = [SCLERAFORCE, "replay", str(recording), "--port", str(port)]
    subprocess.run(
        [*command, "--speed", f"{least_s / MOMENT_S:g}", "--preload", "--quiet"],
        check=True,
        timeout=END_S + MOMENT_S * (times_s[-1] - times_s[0]) / least_s,
    )


def _await_count(counted: Callable[[], int], count: int, what: str) -> None:
    """Wait until the monitor has read so many of something."""
    until_s = monotonic() + READ_S
    while counted() < count:
        if monotonic() > until_s:
            words = f"{counted()} of {count} {what} within {READ_S:g} s"
            raise RuntimeError(f"the monitor has read {words}")
        sleep(LOOK_S)


def _frames(log: Path) -> list[Entry]:
    """Return the entries of the monitor's log that are of frames."""
    entries = [
        line["entry"]
        for file in sorted((log / "log").glob("*.jsonl"))
        for line in _lines(file)
        if line["kind"] == "entry"
    ]
    return [entry for entry in entries if entry["event"] == "frame"]


def _lines(file: Path) -> list[Entry]:
    """Return the whole lines of a file of JSON lines that is still written."""
    whole = file.read_text(encoding="utf-8").rpartition("\n")[0]
    return [json.loads(line) for line in whole.splitlines()]
