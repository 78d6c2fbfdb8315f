"""The width of a reader's intervals, from its scores (`reader.intervals`) on whole virtual eyes.

The factors of a reading's traits, by which intervals are stretched, come from these scores by quantile regression
(Koenker and Bassett 1978): the logarithm of the 90 % quantile of the scores is a sum over the traits. At its solution
90 % of the scores of each trait stay below, whatever other traits these readings have (conditional conformal prediction
over groups that overlap: Gibbs, Cherian and Candes 2023), and few eyes suffice, for a trait is learned from all
readings that have it. A factor for each combination of traits instead had 4 to 40 eyes; the share for a new eye is then
0.92 to 1 of theirs, and intervals were too wide.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from scipy.sparse import csr_array, eye_array, hstack

from scleraforce.errors import CalibrationError, SolverError
from scleraforce.known import Known
from scleraforce.learning.virtual_eyes import (
    CALIBRATED,
    FRAMES,
    OPEN_OR_SEALED,
    VirtualEye,
    VirtualFrame,
    calibrated,
    draw_eye,
    draw_frames,
    frames_under,
    of_population,
)
from scleraforce.library import Library
from scleraforce.library.fit import fit_boundaries
from scleraforce.library.prior import prior_of
from scleraforce.processes import work_in_order
from scleraforce.reader.answer import Reading, fit_reading
from scleraforce.reader.intervals import (
    GLOBE_TRAITS,
    LARGEST,
    NO_FACTORS,
    SMALLEST,
    Factors,
    Score,
    eye_count,
    intervals_record,
    of_each_modulus,
    score,
    share_of_new_eye,
    traits_of,
    weights_of_eyes,
)
from scleraforce.reader.model import slice_network
from scleraforce.study import Study

STREAM = 2**30  # of random numbers: the samples' streams are below, those of the validation above
AHEAD = 2  # eyes for each process that are drawn or wait
OTHERWISE_EVERY = 2  # of the eyes of each telling, one is calibrated a second time, on frames of any forces
MOST_CHOSEN = 5  # of these frames
LEAST_N, LEAST_LARGEST_N = 6e-3, 12e-3  # of their forces, and of the largest of them
LEAST_SCORE = 1e-3  # a force at the median has no logarithm


def measured_intervals(
    prepare: Callable[[], Callable[[int], list[Score]]],
    eyes: int,
    workers: int,
    source: str,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Return `intervals` of `model.json` from the scores of virtual eyes: factors, and the number and kind of eyes."""
    scores: list[Score] = []
    for of_eye in work_in_order(prepare, range(eyes), workers, ahead=AHEAD * workers):
        scores += of_eye
        if progress:
            progress(1)
    return intervals_record(scores, trait_factors(scores), source)


ScoresOf = Callable[[int, VirtualEye, Known, tuple[VirtualFrame, ...], np.random.Generator], list[Score]]


def eye_scores(study: Study, library: Library, seed: int, scores_of: ScoresOf, number: int) -> list[Score]:
    """Return the scores of the virtual eye of a number, which is calibrated first and read on its other frames.

    There are none of an eye in a corner of the ranges that the library does not have.
    """
    rng = np.random.default_rng([seed, STREAM + number])
    try:
        eye = draw_eye(study, library, number, rng)
        known, left = calibrated(eye, draw_frames(eye, study, FRAMES, rng), study, library, rng)
    except CalibrationError:
        return []
    return scores_of(number, eye, known, left, rng)


def measuring(study: Study, library: Library, network: bytes) -> Callable[[int], list[Score]]:
    """Return the function that scores an eye, for a process; `network`: of the slices, as ONNX."""
    read = slice_network(network, study).read

    def scores(
        number: int, eye: VirtualEye, known: Known, left: tuple[VirtualFrame, ...], rng: np.random.Generator
    ) -> list[Score]:
        of_eye = partial(_scores, study, library, eye.wall.polar_rad, read, str(number))
        found = [*of_eye(known, left), *of_eye(of_population(eye, study, rng), left)]
        if number // len(OPEN_OR_SEALED) % OTHERWISE_EVERY == 0:
            again = np.random.default_rng([study.reader.seed, number, STREAM])
            otherwise = calibrated_otherwise(eye, study, library, again)
            found += of_eye(*otherwise) if otherwise else []
        return found

    return partial(eye_scores, study, library, study.reader.seed, scores)


def calibrated_otherwise(
    eye: VirtualEye, study: Study, library: Library, rng: np.random.Generator
) -> tuple[Known, tuple[VirtualFrame, ...]] | None:
    """Return the known values of an eye after a calibration on a few frames of any forces, and the other frames.

    The number of frames, the largest force and the other forces below it are drawn. None if the eye does not bear
    enough, or the library lacks it with its stated values.
    """
    if eye.largest_n <= LEAST_LARGEST_N:
        return None
    count = int(rng.integers(1, MOST_CHOSEN, endpoint=True))
    dared_n = rng.uniform(LEAST_LARGEST_N, eye.largest_n)
    forces_n = np.concatenate([[dared_n], rng.uniform(LEAST_N, dared_n, count - 1)])
    read_n = rng.uniform(0.0, eye.largest_n, FRAMES - CALIBRATED)
    frames = frames_under(eye, study, np.concatenate([forces_n, read_n]), rng)
    try:
        return calibrated(eye, frames, study, library, rng, range(count))
    except CalibrationError:
        return None


def network_score(reading: Reading, known: Known, eye: str, force_n: float) -> Score:
    """Return the score of a network's reading of an eye under a force, N."""
    return Score("network", traits_of(known, reading.force_n), eye, score(reading, force_n))


def _scores(
    study: Study,
    library: Library,
    polar_rad: float,
    read: Callable[[NDArray[np.uint8], Known], Reading],
    eye: str,
    known: Known,
    frames: Sequence[VirtualFrame],
) -> list[Score]:
    """Return the scores of both methods on frames of an eye with its contact at a polar angle."""
    found = list[Score]()
    walls = library.for_stiffening(known.stiffening or 0.0).for_contact(polar_rad)
    prior = prior_of(known, study.reader)
    for frame in frames:
        found.append(network_score(read(frame.cuts, known), known, eye, frame.force_n))
        seen = frame.boundaries
        fit = fit_boundaries(walls, seen.lateral_m, seen.depth_m, prior, study.calibration.surface_smoothing_m)
        if fit is not None:
            by_fit = fit_reading(fit, study.classes.bounds_n, NO_FACTORS.of_fit(known, fit))
            found.append(Score("fit", traits_of(known, fit.force_n, fit), eye, score(by_fit, frame.force_n)))
    return found


def trait_factors(scores: Sequence[Score]) -> Mapping[str, Factors]:
    """Return the factor of every trait in the scores, by method and modulus.

    The factor of a globe's trait (`GLOBE_TRAITS`) is at least `SMALLEST`, the factor of any other trait at least 1:
    such traits make a reader worse, and contrary evidence of few eyes is chance.
    """
    found: dict[str, dict[str, dict[str, float]]] = {}
    for (method, modulus), entries in of_each_modulus(scores).items():
        found.setdefault(method, {})[modulus] = _regression(entries)
    return found


def _regression(scores: Sequence[Score]) -> dict[str, float]:
    """Return the factors of the traits of readings with one kind of modulus.

    The linear programme of Koenker and Bassett: of the scores' distances above and below the prediction, each eye with
    the same weight, the least sum of share times above and (1 - share) times below.
    """
    traits = sorted({trait for entry in scores for trait in entry.traits[1:]})
    has = csr_array(np.array([[trait in entry.traits for trait in traits] for entry in scores], dtype=np.float64))
    logs = np.log([max(entry.score, LEAST_SCORE) for entry in scores])
    share, weight = share_of_new_eye(eye_count(scores)), len(scores) * weights_of_eyes(scores)  # 1 in the mean
    one = eye_array(len(scores))
    ends = [(np.log(SMALLEST) if trait in GLOBE_TRAITS else 0.0, np.log(LARGEST)) for trait in traits]
    solution = linprog(
        np.concatenate([np.zeros(len(traits)), share * weight, (1.0 - share) * weight]),
        A_eq=hstack([has, one, -one], format="csr"),
        b_eq=logs,
        bounds=[*ends, *[(0.0, None)] * (2 * len(scores))],
        method="highs",
    )
    if solution.x is None:
        raise SolverError(f"factors of the intervals: {solution.message}")
    return {trait: round(float(np.exp(value)), 4) for trait, value in zip(traits, solution.x, strict=False)}
