"""Reading a frame on one core: segmentation, all of the loop's reading, the fit that
gives the second opinion.
"""

import gc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter, sleep

import cv2
import numpy as np

from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.reading.eye_reader import EyeReader, MomentFrame, OpenedMoment
from scleraforce.reading.reading_models import ForceReader
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.eye import Modulus
from scleraforce.records.frame import Pixels
from scleraforce.records.globe import OPEN, UNKNOWN, Globe
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
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
MODULUS = Modulus(mean_pa=0.3e6, sd_pa=4.5e3, source="own")
CRUDE = "plain median and Otsu"
SEGMENT = "segment"
READ = "all of the live reading"
FIT = "fit"
FIT_OPEN = "fit, open globe"
FIT_UNKNOWN = "fit, unknown globe"
SHARES = {"median": 0.5, "99 %": 0.99}
GOALS_MS = {
    (SEGMENT, "median"): 0.35,
    (SEGMENT, "99 %"): 0.7,
    (FIT, "median"): 1.0,
    (FIT_OPEN, "median"): 2.0,
    (FIT_UNKNOWN, "median"): 8.0,
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
Work = Callable[[], object]  # on one frame


def measure(run: Run) -> Table:
    """Time a frame's steps, cold and in a row."""
    reader = shipped_reader()
    eyes = draw_eyes(reader, run.count(24, 4))
    work: dict[str, list[Work]] = {
        CRUDE: [partial(plain_median_and_otsu, eye.frame) for eye in eyes],
        SEGMENT: [partial(find_wall, eye.frame, eye.scale) for eye in eyes],
        READ: [_live(reader, eye, float(n)) for n, eye in enumerate(eyes)],
        FIT: _fits_of_recording(reader, run),
        FIT_OPEN: _fits_of_eyes(reader, eyes, OPEN),
        FIT_UNKNOWN: _fits_of_eyes(reader, eyes, UNKNOWN),
    }
    for each in work.values():
        each[0]()

    gc.collect()
    gc.freeze()
    cold_ms = _cold_ms(work, len(eyes) * run.count(16, 2))
    rows = [
        Row(
            what=f"{name}, {share}",
            unit="ms",
            value=float(np.quantile(cold_ms[name], quantile)),
            beside="" if name == CRUDE else CRUDE,
            beside_value=(
                None if name == CRUDE else float(np.quantile(cold_ms[CRUDE], quantile))
            ),
            goal=GOALS_MS.get((name, share)),
            settings=WORDS[name] if share == "median" else "",
        )
        for name in work
        for share, quantile in SHARES.items()
    ]
    in_a_row = Row(
        what=f"{SEGMENT}, the same frame again",
        unit="ms",
        value=_again_ms(work[SEGMENT]),
        beside=CRUDE,
        beside_value=_again_ms(work[CRUDE]),
        settings=f"{AGAIN} times in a row, without a pause",
    )

    return Table("Reading a frame", SETTINGS, (*rows, in_a_row))


def plain_median_and_otsu(frame: Pixels) -> None:
    """Do what one would do without this package, which tells a machine's speed."""
    grey = cv2.convertScaleAbs(frame, alpha=1 / 16)
    _, mask = cv2.threshold(cv2.medianBlur(grey, 5), 0, 255, cv2.THRESH_OTSU)
    cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)


def _live(reader: ForceReader, eye: DrawnEye, at_s: float) -> Work:
    """Return what reads the frame of an eye in the loop."""
    live = EyeReader(reader, eye.setup, by="network")
    moment = OpenedMoment((MomentFrame(eye.frame),), eye.scale, at_s)
    return partial(live.read, moment, live.start(monitored=True))


def _fit(reader: ForceReader, setup: Setup, frame: Pixels, scale: PixelScale) -> Work:
    """Return what fits a wall to the boundaries of a frame."""
    seen = segmented_boundaries(find_wall(frame, scale), scale)
    return partial(
        fit_boundaries,
        reader.library_for(setup),
        seen.lateral_m,
        seen.depth_m,
        prior_of(setup, reader.study.reader),
        reader.study.calibration.surface_smoothing_m,
    )


def _fits_of_recording(reader: ForceReader, run: Run) -> list[Work]:
    """Return the fits of the recording's frames, with a monitor's known inputs."""
    recording = read_recording(made_recording(run))
    setup = recording.info.setup
    known = replace(setup, eye=replace(setup.eye, modulus=MODULUS))
    scale = recording.info.scan.scale
    return [
        _fit(reader, known, recording.frame(entry), scale)
        for entry in recording.frames[::FIT_EVERY]
    ]


def _fits_of_eyes(
    reader: ForceReader, eyes: Sequence[DrawnEye], globe: Globe
) -> list[Work]:
    """Return the fits of drawn eyes of a known kind of globe; a frame that shows too
    little is refused at once, and left out.
    """
    fits = []
    for eye in eyes:
        known = replace(eye.setup, eye=replace(eye.setup.eye, globe=globe))
        fits.append(_fit(reader, known, eye.frame, eye.scale))
    return [fit for fit in fits if fit() is not None]


def _cold_ms(work: Mapping[str, Sequence[Work]], times: int) -> dict[str, list[float]]:
    """Return the times of each piece of work, after a pause each time."""
    taken_ms: dict[str, list[float]] = {name: [] for name in work}
    for number in range(times):
        for name, frames in work.items():
            do = frames[number % len(frames)]
            sleep(PAUSE_S)
            start_s = perf_counter()
            do()
            taken_ms[name].append(1e3 * (perf_counter() - start_s))

    return taken_ms


def _again_ms(work: Sequence[Work]) -> float:
    """Return the median time in a row, without a pause."""
    taken_ms = []
    for do in work:
        for _ in range(AGAIN):
            start_s = perf_counter()
            do()
            taken_ms.append(1e3 * (perf_counter() - start_s))

    return float(np.median(taken_ms))
