"""The answer to one raw frame: segment it, read it, judge the reading; what cannot be judged is class 2 (withdraw)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.fitting.library_fit import BoundaryFit, fit_boundaries, prior_of
from scleraforce.known.eye import Known, outside_training
from scleraforce.reader.model import ForceReader
from scleraforce.reader.readings import Reading, disagreement, fit_reading
from scleraforce.reader.verdicts import (
    allows_calibration,
    contact_outside,
    dent_leaves,
    fit_leaves,
    no_wall_of_an_eye,
    too_little_wall,
)
from scleraforce.reader.wall_reader import SHIFTS, WallReader
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.observations import Boundaries
from scleraforce.segmentation.observed import segmented_boundaries
from scleraforce.segmentation.wall import Segmentation, boundary_slices, find_wall
from scleraforce.units import n_to_mn

__all__ = ["WIDEST_N", "Answer", "Look", "answer_frame", "class_answer", "look", "reading_answer", "unusable"]

WIDEST_N = 6e-3  # of the interval of a dent that leaves the window: what its flanks tell must be as sure as this

_NOTHING = np.zeros((1, 0, 0), dtype=np.uint8)  # no slice


@dataclass(frozen=True)
class Answer:
    """What a model says about a frame.

    Where the frame is not `usable`, `predicted` is the highest class (withdraw) and `reason` says why; what was read
    all the same is None. `force_n`, its 90 % `interval_n` and the contact's lateral place `contact_m`, from the
    frame's middle, are None with a classifier. `warnings` are sentences that limit the answer; `can_calibrate` says
    whether enough of the wall is in view to calibrate on the frame. `readings` has what each method read, by its name,
    and `fit` the wall of the library that lies best on the frame, where they were made.
    """

    predicted: int
    probabilities: tuple[float, ...] | None
    usable: bool
    reason: str | None
    force_n: float | None = None
    interval_n: tuple[float, float] | None = None
    contact_m: float | None = None
    warnings: tuple[str, ...] = ()
    can_calibrate: bool = False
    readings: tuple[tuple[str, Reading], ...] = ()
    fit: BoundaryFit | None = None


@dataclass(frozen=True, eq=False)
class Look:
    """What was seen in a frame: its segmentation, and slices of it where there is a wall to read.

    `cuts` (slice, row, column): a classifier's one slice; for a reader several, shifted in depth by `SHIFTS`. `reason`
    says why it cannot be read, None where it can.
    """

    segmentation: Segmentation
    cuts: NDArray[np.uint8]
    reason: str | None

    @property
    def cut(self) -> NDArray[np.uint8]:
        """The slice that is not shifted."""
        first: NDArray[np.uint8] = self.cuts[0]
        return first


def answer_frame(
    reader: ForceReader | WallReader,
    frame: Pixels,
    scale: PixelScale,
    known: Known | None = None,
) -> Answer:
    """Read one raw frame with all that the model has.

    Args:
        reader: the model.
        frame: raw B-scan (row, column).
        scale: size of a pixel as stored, with the refractive index.
        known: of the eye; a classifier takes no notice of it.
    """
    seen = look(frame, scale, reader)
    if seen.reason:
        return unusable(reader, seen.reason)
    boundaries = segmented_boundaries(seen.segmentation, scale)
    if isinstance(reader, ForceReader):
        return replace(class_answer(reader, seen.cut), can_calibrate=_can_calibrate(seen, boundaries))
    return _force_answer(reader, seen, boundaries, known or Known())


def look(
    frame: Pixels,
    scale: PixelScale,
    reader: ForceReader | WallReader,
) -> Look:
    """Segment a frame and draw the slices that a model reads; the arguments are those of `answer_frame`."""
    found = find_wall(frame, scale)
    if not found.usable:
        return Look(found, _NOTHING, found.reason)
    shifts = SHIFTS if isinstance(reader, WallReader) else (0.0,)
    cuts = boundary_slices(found, scale, reader.study.slice, shifts)
    return Look(found, cuts, None if cuts[0].any() else "the wall lies outside the window of the slice")


def unusable(reader: ForceReader | WallReader, reason: str) -> Answer:
    """Return the answer to a frame that cannot be judged: withdraw."""
    return Answer(reader.classes - 1, None, False, reason)


def class_answer(reader: ForceReader, cut: NDArray[np.uint8]) -> Answer:
    """Ask the paper's network.

    One that met few dents leaving the window takes what is left for a wall without force: the most dangerous frames
    would be read as the least. They are withdrawn from instead.
    """
    if dent_leaves(cut):
        return unusable(reader, "the dent leaves the window of the slice")
    probabilities = reader.probabilities(cut[np.newaxis])[0]
    if not np.isfinite(probabilities).all():
        return unusable(reader, "the network's answer is no number")
    return Answer(int(probabilities.argmax()), tuple(probabilities.tolist()), True, None)


def reading_answer(reader: WallReader, reading: Reading, name: str, leaves: bool) -> Answer:
    """Return the answer that one method gives.

    Args:
        reader: the model.
        reading: of the method.
        name: of the method.
        leaves: whether the dent leaves the window.
    """
    if not reading.finite:
        return unusable(reader, f"what the {name} reads is no number")
    reason = contact_outside(reading, reader.study.reader)
    if reason:
        return unusable(reader, reason)
    if leaves and not reading.width_n < WIDEST_N:
        return unusable(
            reader,
            "the dent leaves the window of the slice, and its flanks leave the force open by "
            f"{n_to_mn(reading.width_n):.0f} mN",
        )
    return Answer(
        reading.predicted, reading.probabilities, True, None, reading.force_n, reading.interval_n, reading.contact_m
    )


def _force_answer(reader: WallReader, seen: Look, boundaries: Boundaries, known: Known) -> Answer:
    """Ask the network and the fit; the model's default is the answer, the other one its check."""
    reason = outside_training(known, reader.study.reader)
    if reason:
        return replace(unusable(reader, reason), can_calibrate=_can_calibrate(seen, boundaries))
    reason = too_little_wall(boundaries.lateral_m, boundaries.depth_m[0], reader.study.slice)
    if reason:
        return unusable(reader, reason)
    prior = prior_of(known, reader.study.reader)
    smoothing_m = reader.study.calibration.surface_smoothing_m
    library = reader.library_at(known.polar_rad)
    fit = fit_boundaries(library, boundaries.lateral_m, boundaries.depth_m, prior, smoothing_m)
    if fit is None:
        return unusable(reader, "too little of the wall is seen")
    reason = no_wall_of_an_eye(fit, prior)
    if reason:
        return replace(unusable(reader, reason), fit=fit)
    readings = {"network": reader.read(seen.cuts, known), "fit": fit_reading(fit, reader.study.classes.bounds_n)}
    names = (reader.default, reader.other)
    leaves = dent_leaves(seen.cut) or fit_leaves(fit, reader.study.slice)
    answer = reading_answer(reader, readings[reader.default], reader.default, leaves)
    elsewhere = contact_outside(readings[reader.other], reader.study.reader)
    if answer.usable and elsewhere:
        answer = unusable(reader, elsewhere)
    warning = disagreement(readings[reader.default], readings[reader.other], names) if answer.usable else None
    return replace(
        answer,
        warnings=(warning,) if warning else (),
        can_calibrate=_can_calibrate(seen, boundaries, fit.contact_m),
        readings=tuple(readings.items()),
        fit=fit,
    )


def _can_calibrate(seen: Look, boundaries: Boundaries, contact_m: float = 0.0) -> bool:
    """Return whether enough of the wall is in view about a contact."""
    return not dent_leaves(seen.cut) and allows_calibration(
        seen.segmentation, boundaries.lateral_m, boundaries.depth_m, contact_m
    )
