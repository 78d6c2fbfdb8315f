"""The answer to one raw frame: segment it, read it, judge the reading; what cannot be judged is class 2 (withdraw)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.frames import segmented_boundaries
from scleraforce.calibration.observations import Boundaries
from scleraforce.imaging.segmentation import PixelScale, Segmentation, Segmenter, boundary_slice
from scleraforce.reader.known import Known, outside_training
from scleraforce.reader.library_fit import BoundaryFit, fit_boundaries, prior_of
from scleraforce.reader.model import ForceReader
from scleraforce.reader.readings import Reading, disagreement, fit_reading
from scleraforce.reader.verdicts import allows_calibration, dent_leaves, fit_leaves, no_wall_of_an_eye, too_little_wall
from scleraforce.reader.wall_reader import WallReader

__all__ = ["WIDEST_N", "Answer", "answer_frame"]

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

WIDEST_N = 6e-3  # of the interval of a dent that leaves the window: what its flanks tell must be as sure as this


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


@dataclass(frozen=True)
class Seen:
    """What was found in a frame: the segmentation, its slice, and the boundaries in m."""

    segmentation: Segmentation
    cut: NDArray[np.uint8]
    boundaries: Boundaries

    def allows_calibration(self, contact_m: float = 0.0) -> bool:
        """Return whether enough of the wall is in view about a contact."""
        return not dent_leaves(self.cut) and allows_calibration(
            self.segmentation, self.boundaries.lateral_m, self.boundaries.depth_m, contact_m
        )


def answer_frame(
    reader: ForceReader | WallReader,
    segmenter: Segmenter,
    frame: Pixels,
    scale: PixelScale,
    refractive_index: float,
    known: Known | None = None,
) -> Answer:
    """Read one raw frame.

    Args:
        reader: the model.
        segmenter: made for the same refractive index; it keeps its buffers between frames.
        frame: raw B-scan (row, column).
        scale: size of a pixel as stored; depth is optical where `refractive_index` is not 1.
        refractive_index: by which depth is stretched in the frame; 1 where the scanner has corrected it.
        known: of the eye; a classifier takes no notice of it.
    """
    segmentation = segmenter.segment(frame, scale)
    if not segmentation.usable:
        return _unusable(reader, segmentation.reason)
    cut = boundary_slice(segmentation, scale, reader.study.slice, refractive_index)
    if not cut.any():
        return _unusable(reader, "the wall lies outside the window of the slice")
    seen = Seen(segmentation, cut, segmented_boundaries(segmentation, scale, refractive_index))
    if isinstance(reader, ForceReader):
        return _class_answer(reader, seen)
    return _force_answer(reader, seen, known or Known())


def _unusable(reader: ForceReader | WallReader, reason: str, can_calibrate: bool = False) -> Answer:
    return Answer(reader.classes - 1, None, False, reason, can_calibrate=can_calibrate)


def _class_answer(reader: ForceReader, seen: Seen) -> Answer:
    """Ask the paper's network.

    One that met few dents leaving the window takes what is left for a wall without force: the most dangerous frames
    would be read as the least. They are withdrawn from instead.
    """
    if dent_leaves(seen.cut):
        return _unusable(reader, "the dent leaves the window of the slice")
    probabilities = reader.probabilities(seen.cut[np.newaxis])[0]
    if not np.isfinite(probabilities).all():
        return _unusable(reader, "the network's answer is no number", seen.allows_calibration())
    return Answer(
        int(probabilities.argmax()),
        tuple(probabilities.tolist()),
        True,
        None,
        can_calibrate=seen.allows_calibration(),
    )


def _force_answer(reader: WallReader, seen: Seen, known: Known) -> Answer:
    """Ask the network and the fit; the model's default is the answer, the other one its check."""
    reason = outside_training(known, reader.study.reader)
    if reason:
        return _unusable(reader, reason, seen.allows_calibration())
    reason = too_little_wall(seen.boundaries.lateral_m, seen.boundaries.depth_m, reader.study.slice)
    if reason:
        return _unusable(reader, reason)
    prior = prior_of(known, reader.study.reader)
    smoothing_m = reader.study.calibration.surface_smoothing_m
    library = reader.library_at(known.polar_rad)
    fit = fit_boundaries(library, seen.boundaries.lateral_m, seen.boundaries.depth_m, prior, smoothing_m)
    if fit is None:
        return _unusable(reader, "too little of the wall is seen")
    reason = no_wall_of_an_eye(fit, prior)
    if reason:
        return replace(_unusable(reader, reason), fit=fit)
    readings = {"network": reader.read(seen.cut, known), "fit": fit_reading(fit, reader.study.classes.bounds_n)}
    read = Answer(
        reader.classes - 1, None, False, None, readings=tuple(readings.items()), fit=fit,
        can_calibrate=seen.allows_calibration(fit.contact_m),
    )  # fmt: skip
    names = (reader.default, reader.other)
    answer, check = (readings[name] for name in names)
    if not answer.finite:
        return replace(read, reason=f"what the {reader.default} reads is no number")
    leaves = dent_leaves(seen.cut) or fit_leaves(fit, reader.study.slice)
    if leaves and not answer.width_n < WIDEST_N:
        return replace(
            read,
            reason="the dent leaves the window of the slice, and its flanks leave the force open by "
            f"{answer.width_n * 1e3:.0f} mN",
        )
    warning = disagreement(answer, check, names)
    return replace(
        read,
        predicted=answer.predicted,
        probabilities=answer.probabilities,
        usable=True,
        force_n=answer.force_n,
        interval_n=answer.interval_n,
        contact_m=answer.contact_m,
        warnings=(warning,) if warning else (),
    )
