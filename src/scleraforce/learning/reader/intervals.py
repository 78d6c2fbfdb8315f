"""How wide a reader's intervals have to be: its scores (`reader.interval_scores`) on whole virtual eyes."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import use_compiled_loops
from scleraforce.errors import CalibrationError
from scleraforce.fitting.library_fit import fit_boundaries
from scleraforce.fitting.prior import prior_of
from scleraforce.known.eye import Known
from scleraforce.learning.reader.virtual_eyes import (
    FRAMES,
    VirtualEye,
    VirtualFrame,
    calibrated,
    draw_eye,
    draw_frames,
    of_population,
)
from scleraforce.library import Library
from scleraforce.processes import work_in_order
from scleraforce.reader.interval_factors import NO_FACTORS
from scleraforce.reader.interval_groups import group_of
from scleraforce.reader.interval_scores import Score, intervals_record, score
from scleraforce.reader.model import slice_network
from scleraforce.reader.readings import Reading, fit_reading
from scleraforce.study import Study

__all__ = ["STREAM", "calibrated_eye", "intervals_of", "measured_intervals"]

STREAM = 2**30  # of random numbers: the samples' streams are below, those of the validation above
AHEAD = 2  # eyes for each process that are drawn or wait


def measured_intervals(
    study: Study,
    library: Library,
    network: bytes,
    workers: int,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Return `intervals` of `model.json`: factors, and on how many eyes of which kind they rest.

    Args:
        study: with `[reader]`.
        library: of responses, whole.
        network: of the slices, as ONNX.
        workers: processes.
        progress: called with 1 after each eye.

    Raises:
        SolverError: a worker died.
    """
    prepare = partial(_measuring, study, library, network)
    return intervals_of(prepare, study.reader.interval_eyes, workers, "virtual eyes of the library's walls", progress)


def intervals_of(
    prepare: Callable[[], Callable[[int], list[Score]]],
    eyes: int,
    workers: int,
    source: str,
    progress: Callable[[int], object] | None,
) -> dict[str, Any]:
    """Return `intervals` of `model.json` from the scores of virtual eyes.

    Args:
        prepare: called once in each process; returns what scores an eye of a number.
        eyes: how many.
        workers: processes.
        source: what the eyes are, in words.
        progress: called with 1 after each eye.
    """
    scores: list[Score] = []
    for of_eye in work_in_order(prepare, range(eyes), workers, ahead=AHEAD * workers):
        scores += of_eye
        if progress:
            progress(1)
    return intervals_record(scores, source)


def _measuring(study: Study, library: Library, network: bytes) -> Callable[[int], list[Score]]:
    """Return what scores an eye, in its process."""
    use_compiled_loops()
    reads_slices = slice_network(network, study)

    def scores_of(number: int) -> list[Score]:
        rng = np.random.default_rng([study.reader.seed, STREAM + number])
        drawn = calibrated_eye(study, library, number, rng)
        if drawn is None:
            return []
        eye, known, left = drawn
        found = []
        for told in (known, of_population(eye, study, rng)):
            near = library.for_stiffening(told.stiffening or 0.0).for_contact(eye.wall.polar_rad)
            for frame in left:
                found += _scores(study, near, reads_slices.read, told, frame, str(number))
        return found

    return scores_of


def calibrated_eye(
    study: Study, library: Library, number: int, rng: np.random.Generator
) -> tuple[VirtualEye, Known, tuple[VirtualFrame, ...]] | None:
    """Return a virtual eye, what is known of it after its calibration, and the frames that are left.

    None where it lies in a corner of the ranges that the library does not have.
    """
    try:
        eye = draw_eye(study, library, number, rng)
        return eye, *calibrated(eye, draw_frames(eye, study, FRAMES, rng), study, library, rng)
    except CalibrationError:
        return None


def _scores(
    study: Study,
    library: Library,
    read: Callable[[NDArray[np.uint8], Known], Reading],
    known: Known,
    frame: VirtualFrame,
    eye: str,
) -> list[Score]:
    """Return the scores of both methods on a frame."""
    by_network = read(frame.cuts, known)
    found = [Score("network", group_of(known), eye, score(by_network, frame.force_n))]
    seen = frame.boundaries
    fit = fit_boundaries(
        library, seen.lateral_m, seen.depth_m, prior_of(known, study.reader), study.calibration.surface_smoothing_m
    )
    if fit is not None:
        by_fit = fit_reading(fit, study.classes.bounds_n, NO_FACTORS.of_fit(known, fit))
        found.append(Score("fit", group_of(known, fit), eye, score(by_fit, frame.force_n)))
    return found
