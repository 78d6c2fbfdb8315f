"""Reading a frame on one core: segmentation, all of the loop's reading, the fit that
gives the second opinion.
"""

import gc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter, sleep

import cv2
import numpy as np

from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.reading.eye_reader import EyeReader, MomentFrame, OpenedMoment
from scleraforce.reading.reading_models import ForceReader
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.eye import Modulus
from scleraforce.records.globe import OPEN, UNKNOWN, Globe
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import segmented_boundaries
from speed.eyes import DrawnEye, draw_eyes, shipped_reader
from speed.parts.recording import made_recording
from speed.record import Row, Table
from speed.run import Run

PAUSE_S = 0.01  # of a scanner with 100 frames a second
AGAIN = 10  # times in a row
FIT_EVERY = 10  # frames of the recording
# of its eye, as a calibration finds it
MODULUS_PA = 0.3e6
MODULUS_SD_PA = 4.5e3
CRUDE = "plain median and Otsu"
SEGMENT = "segment"
READ = "all of the live reading"
FIT = "fit"
FIT_OPEN = "fit, open globe"
FIT_UNKNOWN = "fit, unknown globe"
GOALS_MS = {
    SEGMENT: (0.35, 0.7),
    FIT: (1.0, None),
    FIT_OPEN: (2.0, None),
    FIT_UNKNOWN: (8.0, None),
}
SETTINGS = """Frames of 512 x 512 pixels and 16 bits, drawn from the shipped reader's
library under 0 to 60 mN; one core. Between two calls there is a pause of 10 ms, as
between the frames of a scanner: caches are cold. The rows are taken in turns, frame by
frame."""
WORDS = {
    CRUDE: (
        "8 bits, `medianBlur` 5 x 5, Otsu's threshold, contours: walls are not"
        " distinguished from other tissue"
    ),
    SEGMENT: "`find_wall`: both boundaries, in each column, with a verdict",
    READ: (
        "`EyeReader.read`: segmentation, slices, network, verdicts, force with its"
        " interval"
    ),
    FIT: (
        "`fit_boundaries`: a wall of the library laid on the boundaries of a segmented"
        " frame, here of a recording of 0 to 20 mN with the known inputs of a monitor"
    ),
    FIT_OPEN: "the same of the drawn eyes that show enough for a fit, declared open",
    FIT_UNKNOWN: "the same, globe not declared",
}
Work = Callable[[int], object]


def measure(run: Run) -> Table:
    """Time a frame's steps, cold and in a row."""
    reader = shipped_reader()
    eyes = draw_eyes(reader, run.count(24, 4))
    work = _work(reader, eyes) | {FIT: _fit(reader, made_recording(run))}
    work |= {
        FIT_OPEN: _fits(reader, eyes, OPEN),
        FIT_UNKNOWN: _fits(reader, eyes, UNKNOWN),
    }

    for do in work.values():
        do(0)

    gc.collect()
    gc.freeze()
    cold = _cold(work, len(eyes), run.count(16, 2))
    rows = [
        row for name, times in cold.items() for row in _rows(name, times, cold[CRUDE])
    ]
    again = {name: _again(work[name], len(eyes)) for name in (CRUDE, SEGMENT)}
    in_a_row = Row(
        what=f"{SEGMENT}, the same frame again",
        unit="ms",
        value=float(np.median(again[SEGMENT])),
        beside=CRUDE,
        beside_value=float(np.median(again[CRUDE])),
        settings=f"{AGAIN} times in a row, without a pause",
    )

    return Table("Reading a frame", SETTINGS, (*rows, in_a_row))


def _crude(frame: np.ndarray) -> None:
    grey = cv2.convertScaleAbs(frame, alpha=1 / 16)
    _, mask = cv2.threshold(cv2.medianBlur(grey, 5), 0, 255, cv2.THRESH_OTSU)
    cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)


def _work(reader: ForceReader, eyes: Sequence[DrawnEye]) -> dict[str, Work]:
    """Return what is done with the frames of drawn eyes, by their numbers."""
    live = [EyeReader(reader, eye.setup, by="network") for eye in eyes]
    memories = [one.start(monitored=True) for one in live]

    def read(n: int) -> object:
        moment = OpenedMoment((MomentFrame(eyes[n].frame),), eyes[n].scale, float(n))
        return live[n].read(moment, memories[n])

    return {
        CRUDE: lambda n: _crude(eyes[n].frame),
        SEGMENT: lambda n: find_wall(eyes[n].frame, eyes[n].scale),
        READ: read,
    }


def _fit(reader: ForceReader, path: Path) -> Work:
    """Return the function that fits a wall to a frame of the recording, with a
    monitor's known inputs.
    """
    recording = read_recording(path)
    known = replace(
        recording.info.setup,
        eye=replace(
            recording.info.setup.eye,
            modulus=Modulus(mean_pa=MODULUS_PA, sd_pa=MODULUS_SD_PA, source="own"),
        ),
    )
    scale = recording.info.scan.scale
    prior = prior_of(known, reader.study.reader)
    library = reader.library_for(known)
    smoothing_m = reader.study.calibration.surface_smoothing_m
    frames = [recording.frame(entry) for entry in recording.frames[::FIT_EVERY]]
    seen = [segmented_boundaries(find_wall(frame, scale), scale) for frame in frames]

    def fit(n: int) -> object:
        one = seen[n % len(seen)]
        return fit_boundaries(library, one.lateral_m, one.depth_m, prior, smoothing_m)

    return fit


def _fits(reader: ForceReader, eyes: Sequence[DrawnEye], globe: Globe) -> Work:
    """Return the function that fits a wall to the boundaries of a drawn eye of a known
    kind of globe.
    """
    inputs = []
    smoothing_m = reader.study.calibration.surface_smoothing_m

    for eye in eyes:
        known = replace(eye.setup, eye=replace(eye.setup.eye, globe=globe))
        seen = segmented_boundaries(find_wall(eye.frame, eye.scale), eye.scale)

        one = (
            reader.library_for(known),
            seen.lateral_m,
            seen.depth_m,
            prior_of(known, reader.study.reader),
            smoothing_m,
        )
        if fit_boundaries(*one) is not None:
            # a frame that shows too little is refused at once
            inputs.append(one)

    return lambda n: fit_boundaries(*inputs[n % len(inputs)])


def _cold(work: Mapping[str, Work], frames: int, rounds: int) -> dict[str, list[float]]:
    """Return the times of each piece of work, ms, after a pause each time."""
    taken: dict[str, list[float]] = {name: [] for name in work}
    for number in range(frames * rounds):
        for name, do in work.items():
            sleep(PAUSE_S)
            start = perf_counter()
            do(number % frames)
            taken[name].append(1e3 * (perf_counter() - start))

    return taken


def _again(do: Work, frames: int) -> list[float]:
    taken = []
    for number in range(frames):
        for _ in range(AGAIN):
            start = perf_counter()
            do(number)
            taken.append(1e3 * (perf_counter() - start))

    return taken


def _rows(name: str, times: Sequence[float], beside: Sequence[float]) -> list[Row]:
    """Return the rows of the median and of 99 %."""
    return [
        Row(
            what=f"{name}, {words}",
            unit="ms",
            value=float(np.quantile(times, share)),
            beside="" if name == CRUDE else CRUDE,
            beside_value=None if name == CRUDE else float(np.quantile(beside, share)),
            goal=goal,
            settings=WORDS[name] if share == 0.5 else "",
        )
        for words, share, goal in zip(
            ("median", "99 %"),
            (0.5, 0.99),
            GOALS_MS.get(name, (None, None)),
            strict=True,
        )
    ]
