"""Whole virtual eyes from library walls, for the measurement of a reader's intervals:
calibrated, then read.

A share of the eyes are uneven: their form is not a sphere's, and their forces drift
away from the library's with the dent, as in uneven eyes computed in three dimensions.
The stated values of an eye are off by the study's errors.

The factors of a reading's traits, by which intervals are stretched, come from the
scores of these readings by quantile regression (Koenker and Bassett 1978): the
logarithm of the 90 % quantile is a sum over the traits. At its solution 90 % of the
scores of each trait stay below, whatever other traits the readings have (conditional
conformal prediction over groups that overlap: Gibbs, Cherian and Candes 2023), and few
eyes suffice: all readings with a trait teach its factor.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_array, eye_array, hstack

from scleraforce.base.arrays import Bytes, Floats
from scleraforce.base.errors import CalibrationError, SolverError
from scleraforce.base.onnx_network import network_session
from scleraforce.base.worker_processes import work_in_order
from scleraforce.calibration import seen_frames
from scleraforce.calibration.filter.eye_parameters import (
    WallState,
    stated_wall,
)
from scleraforce.calibration.start_of_an_eye import ForceFrame, StartedEye
from scleraforce.calibration.stiffness_from_forces import (
    TissueTrial,
    eye_of_forces,
    search_stiffening,
)
from scleraforce.fit.curve_placement import PlacesOnFrame, curve_depths, place_curves
from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.lab.training.drawn_wall_errors import (
    WallForms,
    added_depths,
    disturb,
    draw_forms,
)
from scleraforce.lab.training.library_sections import LibrarySections, library_eye
from scleraforce.lab.training.reader_samples import library_of_tissue, log_even
from scleraforce.library import Library
from scleraforce.library.plane_cut import column_laterals, fill_boundaries
from scleraforce.reading import interval_widths
from scleraforce.reading.answer import Reading, fit_reading
from scleraforce.reading.force_network import ForceNetwork
from scleraforce.reading.interval_widths import Factors, IntervalScore, score_reading
from scleraforce.reading.reading_models import SHIFTS
from scleraforce.recordings import force_errors
from scleraforce.records.eye import POPULATION_SD, Eye, Modulus
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN
from scleraforce.records.model_folder import NETWORK_FILE
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study, draw
from scleraforce.wall.wall_in_metres import Boundaries

FRAMES = 20
CALIBRATED = 3
FINER = 4  # columns and rows of a frame for one of a slice
# relative, from no force to the largest: uneven eyes computed in three dimensions
FORCE_DRIFT_SD = 0.035
FRAME_EVERY_S = 12.0  # of a force log: ramps, a hold, a rest
ROTATION_RAD = np.radians(3.0)
SHIFT_M = 0.05e-3  # of an eye between frames
DIRECTION_STATED = 0.5  # share of the eyes
POPULATION_STIFFENING_SD = 0.5  # of ln(1 + b), between eyes whose tissue stiffens
WEAKER = 0.9  # a largest force that the library does not hold is lowered by this
OPEN_OR_SEALED = (OPEN, SEALED, UNKNOWN)


@dataclass(frozen=True, kw_only=True)
class VirtualEye:
    """An eye: its true sections, its wall without force, its stated values, and its
    form (1,) at rest.

    `drift`: growth of its forces over the library's, as a share, up to `largest_n`.
    """

    model: LibrarySections
    wall: WallState
    stated: Setup
    forms: WallForms
    drift: float
    largest_n: float


@dataclass(frozen=True, eq=False)
class VirtualFrame:
    """One frame: its true force, N, the boundaries seen in it, and slices of it, each
    half a row lower.
    """

    force_n: float
    boundaries: Boundaries
    cuts: Bytes


def draw_eye(
    study: Study, library: Library, number: int, rng: np.random.Generator
) -> VirtualEye:
    """Draw an eye within `[reader]`; its globe is stated open, sealed or not at all by
    turns, its direction or not.
    """
    reader = study.reader
    stated_globe = OPEN_OR_SEALED[number % 3]
    library = library_of_tissue(library, reader, rng)
    ranges = reader.youngs_modulus_pa, reader.thickness_m, reader.gap_m
    modulus_pa, thickness_m, gap_m = (draw(values, rng) for values in ranges)
    iop_pa = float(log_even(reader.iop_pa, 1, rng)[0])
    polar_rad = float(
        min(draw(study.needle.polar_angle_rad, rng), library.polar_rad[-1])
    )
    sealed = stated_globe is SEALED or (stated_globe is UNKNOWN and rng.random() < 0.5)
    rigidity = rng.uniform(SEALED.lowest, SEALED.highest) if sealed else 0.0
    uneven = np.array([rng.random() < reader.uneven_share])
    forms = draw_forms(
        np.array([thickness_m]), np.array([library.radius_m]), uneven, rng
    )
    drift = FORCE_DRIFT_SD * rng.standard_normal() * float(uneven[0])
    globe = replace(UNKNOWN, mean=rigidity) if sealed else OPEN
    direction_rad = rng.uniform(-np.pi, np.pi)
    true = Setup(
        eye=Eye(iop_pa=iop_pa, thickness_m=thickness_m, globe=globe),
        needle=Needle(gap_m=gap_m, polar_rad=polar_rad),
        scan=Scan(direction_rad=direction_rad),
    )
    model = library_eye(study, true, library)
    wall = stated_wall(true, modulus_pa, 0.0, polar_rad)
    fractions = (
        reader.iop_noise_fraction,
        reader.thickness_noise_fraction,
        reader.gap_noise_fraction,
    )
    noise = 1.0 + rng.standard_normal(3) * fractions
    direction_stated = rng.random() < DIRECTION_STATED
    pole_noise_rad = reader.pole_noise_rad * rng.spawn(1)[0].standard_normal(2)
    stated = Setup(
        eye=Eye(
            iop_pa=iop_pa * float(noise[0]),
            thickness_m=float(
                np.clip(thickness_m * noise[1], *reader.thickness_m.bounds)
            ),
            globe=stated_globe,
        ),
        needle=Needle(
            gap_m=gap_m * float(noise[2]),
            polar_rad=abs(polar_rad + float(pole_noise_rad[0])),
        ),
        scan=Scan(
            direction_rad=(
                direction_rad + float(pole_noise_rad[1]) if direction_stated else None
            )
        ),
    )

    if reason := model.outside(wall):
        raise CalibrationError(reason)

    largest_n = study.needle.max_force_n
    while model.outside(replace(wall, force_n=largest_n)) is not None:
        largest_n *= WEAKER

    return VirtualEye(
        model=model,
        wall=wall,
        stated=stated,
        forms=forms,
        drift=drift,
        largest_n=largest_n,
    )


def draw_frames(
    eye: VirtualEye, study: Study, forces: Floats | int, rng: np.random.Generator
) -> tuple[VirtualFrame, ...]:
    """Draw frames of an eye under forces (frame,), N, or a number of even ones, with
    errors like the segmentation's.
    """
    reader = study.reader
    forces_n = (
        rng.uniform(0.0, eye.largest_n, forces) if isinstance(forces, int) else forces
    )
    lateral_m = draw(reader.lateral_m, rng)
    depth_m = draw(reader.surface_depth_m, rng)
    pose = np.array([lateral_m, depth_m, rng.uniform(-ROTATION_RAD, ROTATION_RAD)])
    pixel_m = study.slice.pixel_m / FINER
    fine = replace(
        study.slice,
        columns=FINER * study.slice.columns,
        rows=FINER * study.slice.rows,
        pixel_m=pixel_m,
    )
    columns_m = column_laterals(fine)
    poses = (
        pose + np.array([*rng.uniform(-SHIFT_M, SHIFT_M, 2), 0.0]) for _ in forces_n
    )
    seen_sbc = wall_depths(eye, forces_n, poses, columns_m)
    seen_sbc = disturb(seen_sbc, fine, rng, scale=reader.interval_boundary_errors)
    middle = slice(FINER // 2 - 1, FINER // 2 + 1)
    coarse_sbc = seen_sbc.reshape(len(forces_n), 2, study.slice.columns, FINER)[
        ..., middle
    ].mean(axis=3)
    halves = [
        fill_boundaries(coarse_sbc + shift * study.slice.pixel_m, study.slice)
        for shift in SHIFTS
    ]

    return tuple(
        VirtualFrame(
            float(force_n), Boundaries(columns_m, depths, fine.pixel_m), np.stack(cuts)
        )
        for force_n, depths, cuts in zip(
            forces_n, seen_sbc, zip(*halves, strict=True), strict=True
        )
    )


def wall_depths(
    eye: VirtualEye, forces_n: Floats, poses: Iterable[Floats], columns_m: Floats
) -> Floats:
    """Return the boundaries of an eye's wall in frames (frame, boundary, column), m;
    NaN beyond the wall.

    Forces are (frame,), columns lateral places from the frame's middle; each frame has
    a pose (3,): lateral and depth, m, and rotation, rad (`place_curves`).
    """
    effective_n = forces_n / (1.0 + eye.drift * (forces_n / eye.largest_n - 0.5))
    states = [replace(eye.wall, force_n=float(force_n)) for force_n in effective_n]
    both = PlacesOnFrame(
        np.concatenate([columns_m, columns_m]), np.repeat([0, 1], len(columns_m))
    )
    radius_m = np.array([eye.model.library.radius_m])
    depth_sbc = np.empty((len(states), 2, len(columns_m)))

    for depths, curves, pose in zip(
        depth_sbc, eye.model.curves(states), poses, strict=True
    ):
        depth, _, reached = curve_depths(place_curves(curves, *pose.tolist()), both)
        form = added_depths(eye.forms, radius_m, (columns_m - pose[0])[None])[0]
        depths[:] = np.where(reached, depth, np.nan).reshape(2, -1) + form

    return depth_sbc


def calibrated(
    eye: VirtualEye,
    frames: Sequence[VirtualFrame],
    study: Study,
    library: Library,
    rng: np.random.Generator,
    chosen: Sequence[int] | None = None,
) -> tuple[Setup, tuple[VirtualFrame, ...]]:
    """Return the known values of an eye after a calibration on some of its frames, and
    the other frames.

    The frames are in the order of the pushes; the `chosen` ones calibrate, by default
    three as by `calibrate` with `frames=3`. Frames of light forces only show the place
    of the eye, and are left. Raise a CalibrationError if the library does not have the
    eye with its stated values.
    """
    labelled = label_forces(np.array([frame.force_n for frame in frames]), rng)
    forces_n = labelled.force_n
    least_n = study.calibration.min_force_n
    wanted = CALIBRATED if chosen is None else len(chosen)

    if chosen is None:
        order = seen_frames.frame_order(forces_n, [True] * len(frames), least_n, wanted)
    else:
        order = sorted(chosen, key=lambda place: float(forces_n[place]))

    borne = {
        place: ForceFrame(wall=frames[place].boundaries, force_n=float(forces_n[place]))
        for place in order
        if forces_n[place] > least_n
    }

    def attempt(
        of_tissue: Library, before: StartedEye | None
    ) -> TissueTrial[tuple[Setup, tuple[ForceFrame, ...]]] | None:
        """Calibrate with the walls of one tissue."""
        return eye_of_forces(
            eye.stated, list(borne.values()), of_tissue, study, before, wanted
        )

    found = search_stiffening(library, attempt)
    if found is None:
        raise CalibrationError(
            "the library does not have the eye with its stated values"
        )

    stiffening, (known, used) = found
    left = tuple(
        frame for place, frame in enumerate(frames) if borne.get(place) not in used
    )

    return replace(known, eye=replace(known.eye, stiffening=stiffening)), left


def label_forces(
    forces_n: Floats, rng: np.random.Generator
) -> force_errors.FrameForces:
    """Return true forces (frame,), in the order of the pushes, with a log's noise and
    the rest of its sensor's zero.
    """
    time_s = FRAME_EVERY_S * np.arange(1, len(forces_n) + 1, dtype=np.float64)
    offset_n, drift_n_per_s = np.sqrt(
        np.diag(force_errors.ZERO_PRIOR)
    ) * rng.standard_normal(2)
    rests_s = (
        0.5
        * (time_s[:-1] + time_s[1:])[
            np.minimum(forces_n[:-1], forces_n[1:]) > force_errors.PUSH_N
        ]
    )
    rests_n = (
        offset_n
        + drift_n_per_s * rests_s
        + force_errors.REST_SD_N * rng.standard_normal(len(rests_s))
    )
    zero, covariance = force_errors.zero_line(rests_s, rests_n)
    left_n = offset_n - zero[0] + (drift_n_per_s - zero[1]) * time_s
    labels_n = (
        forces_n + left_n + force_errors.LABEL_SD_N * rng.standard_normal(len(forces_n))
    )

    return force_errors.FrameForces(labels_n, time_s, zero, covariance)


def of_population(eye: VirtualEye, study: Study, rng: np.random.Generator) -> Setup:
    """Return the known values of an eye that is read with the modulus of other eyes."""
    low, high = study.reader.youngs_modulus_pa.bounds
    mean_pa = float(
        np.clip(
            eye.wall.youngs_modulus_pa * (1.0 + POPULATION_SD * rng.standard_normal()),
            low,
            high,
        )
    )
    modulus = Modulus(
        mean_pa=mean_pa, sd_pa=POPULATION_SD * mean_pa, source="population"
    )
    stiffening = 0.0
    own = eye.model.library.stiffening
    walls = eye.model.library.walls.stiffening

    if own > 0.0:  # of other eyes with tissue that stiffens
        other = np.expm1(
            np.log1p(own) + POPULATION_STIFFENING_SD * rng.standard_normal()
        )
        stiffening = float(np.clip(other, walls[0], walls[-1]))

    known = replace(eye.stated.eye, modulus=modulus, stiffening=stiffening)
    return replace(eye.stated, eye=known)


# first stream of random numbers for eyes: the samples' streams are below, the
# validation's above
STREAM = 2**30
AHEAD = 2  # eyes for each process that are drawn or wait
# one of this many eyes whose globe is stated the same is calibrated a second time, on
# frames of any forces
OTHERWISE_EVERY = 2
MOST_CHOSEN = 5  # of these frames
# least force on these frames, and least value of their largest force
LEAST_N = 6e-3
LEAST_LARGEST_N = 12e-3
LEAST_SCORE = 1e-3  # a force at the median has no logarithm


EyeScores = Callable[[int], list[IntervalScore]]  # of an eye, by its number


def measured_intervals(
    prepare: Callable[[], EyeScores],
    eyes: int,
    workers: int,
    source: str,
    progress: Callable[[int], object] | None = None,
) -> dict[str, Any]:
    """Return `intervals` of `model.json` from the scores of virtual eyes: factors, and
    the number and kind of eyes.
    """
    if not eyes:
        return {}

    scores: list[IntervalScore] = []
    for of_eye in work_in_order(prepare, range(eyes), workers, ahead=AHEAD * workers):
        scores += of_eye
        if progress:
            progress(1)

    return {
        "intervals": interval_widths.intervals_record(
            scores, trait_factors(scores), source
        )
    }


ScoresOf = Callable[
    [int, VirtualEye, Setup, tuple[VirtualFrame, ...], np.random.Generator],
    list[IntervalScore],
]


def eye_scores(
    study: Study, library: Library, seed: int, scores_of: ScoresOf, number: int
) -> list[IntervalScore]:
    """Return the scores of a virtual eye, calibrated and then read; there are none if
    the library lacks the eye.
    """
    rng = np.random.default_rng([seed, STREAM + number])
    try:
        eye = draw_eye(study, library, number, rng)
        known, left = calibrated(
            eye, draw_frames(eye, study, FRAMES, rng), study, library, rng
        )
    except CalibrationError:
        return []

    return scores_of(number, eye, known, left, rng)


def measuring(study: Study, library: Library, network: bytes) -> EyeScores:
    """Return the function that scores an eye, for a process; `network`: of the slices,
    as ONNX.
    """
    read = ForceNetwork(
        network_session(network, NETWORK_FILE, 1), study, NETWORK_FILE
    ).read

    def scores(
        number: int,
        eye: VirtualEye,
        setup: Setup,
        left: tuple[VirtualFrame, ...],
        rng: np.random.Generator,
    ) -> list[IntervalScore]:
        of_eye = partial(_scores, study, library, eye.wall.polar_rad, read, str(number))
        found = [*of_eye(setup, left), *of_eye(of_population(eye, study, rng), left)]

        if number // len(OPEN_OR_SEALED) % OTHERWISE_EVERY == 0:
            again = np.random.default_rng([study.reader.seed, number, STREAM])
            otherwise = calibrated_otherwise(eye, study, library, again)
            found += of_eye(*otherwise) if otherwise else []

        return found

    return partial(eye_scores, study, library, study.reader.seed, scores)


def calibrated_otherwise(
    eye: VirtualEye, study: Study, library: Library, rng: np.random.Generator
) -> tuple[Setup, tuple[VirtualFrame, ...]] | None:
    """Return an eye's known values after a calibration on a few frames of drawn forces,
    and the other frames.

    None if the eye does not bear enough, or the library lacks it with its stated
    values.
    """
    if eye.largest_n <= LEAST_LARGEST_N:
        return None

    count = int(rng.integers(1, MOST_CHOSEN, endpoint=True))
    dared_n = rng.uniform(LEAST_LARGEST_N, eye.largest_n)
    forces_n = np.concatenate([[dared_n], rng.uniform(LEAST_N, dared_n, count - 1)])
    read_n = rng.uniform(0.0, eye.largest_n, FRAMES - CALIBRATED)
    frames = draw_frames(eye, study, np.concatenate([forces_n, read_n]), rng)

    try:
        return calibrated(eye, frames, study, library, rng, range(count))
    except CalibrationError:
        return None


def _scores(
    study: Study,
    library: Library,
    polar_rad: float,
    read: Callable[[Bytes, Setup], Reading],
    eye: str,
    setup: Setup,
    frames: Sequence[VirtualFrame],
) -> list[IntervalScore]:
    """Return the scores of both methods on frames of an eye with its contact at a polar
    angle.
    """
    found = list[IntervalScore]()
    walls = library.for_stiffening(setup.eye.stiffening or 0.0).for_contact(polar_rad)
    prior = prior_of(setup, study.reader, study.eye.radius_m)

    for frame in frames:
        found.append(
            score_reading("network", read(frame.cuts, setup), setup, eye, frame.force_n)
        )
        seen = frame.boundaries

        fit = fit_boundaries(
            walls,
            seen.lateral_m,
            seen.depth_m,
            prior,
            study.calibration.surface_smoothing_m,
        )
        if fit is not None:
            by_fit = fit_reading(
                fit,
                study.classes.bounds_n,
                interval_widths.NO_FACTORS.of_fit(setup, fit),
            )
            found.append(score_reading("fit", by_fit, setup, eye, frame.force_n, fit))

    return found


def trait_factors(scores: Sequence[IntervalScore]) -> Mapping[str, Factors]:
    """Return the factor of every trait in the scores, by method and modulus.

    The factor of a globe's trait (`GLOBE_TRAITS`) is at least `SMALLEST`, the factor of
    any other trait at least 1: such traits make a reader worse, and contrary evidence
    of few eyes is chance.
    """
    found: dict[str, dict[str, dict[str, float]]] = {}
    for (method, modulus), entries in interval_widths.of_each_modulus(scores).items():
        found.setdefault(method, {})[modulus] = _regression(entries)
    return found


def _regression(scores: Sequence[IntervalScore]) -> dict[str, float]:
    """Return the factors of the traits of readings with one kind of modulus.

    The linear programme of Koenker and Bassett: of the scores' distances above and
    below the prediction, each eye with the same weight, the least sum of share times
    above and (1 - share) times below.
    """
    traits = sorted({trait for entry in scores for trait in entry.traits[1:]})
    has = csr_array(
        np.array(
            [[trait in entry.traits for trait in traits] for entry in scores],
            dtype=np.float64,
        )
    )
    logs = np.log([max(entry.score, LEAST_SCORE) for entry in scores])
    share = interval_widths.share_of_new_eye(interval_widths.eye_count(scores))
    weight = len(scores) * interval_widths.weights_of_eyes(scores)  # 1 in the mean
    one = eye_array(len(scores))
    least = np.log(interval_widths.SMALLEST)
    most = np.log(interval_widths.LARGEST)
    ends = [
        (least if trait in interval_widths.GLOBE_TRAITS else 0.0, most)
        for trait in traits
    ]

    solution = linprog(
        np.concatenate([np.zeros(len(traits)), share * weight, (1.0 - share) * weight]),
        A_eq=hstack([has, one, -one], format="csr"),
        b_eq=logs,
        bounds=[*ends, *[(0.0, None)] * (2 * len(scores))],
        method="highs",
    )
    if solution.x is None:
        raise SolverError(f"factors of the intervals: {solution.message}")

    return {
        trait: round(float(np.exp(value)), 4)
        for trait, value in zip(traits, solution.x, strict=False)
    }
