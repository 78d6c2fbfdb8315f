"""E, k, the forces' level and growth, and the tissue's stiffening, from frames of known
force.

Once `start_of_an_eye` has found where E and k lie, all frames are read as a reader
would read them, without their forces and with the same E and k. Their known forces over
those read show how far E, k and the forces' level and growth are off (`KnownForce`).
The frames determine the four together far better than each: the discrepancy is known
given E and k (`ForceDiscrepancy`), and best for forces like the frames'. `regression`
finds the four; E and k are held by the start, with heavy tails, level and growth by
their spread among eyes.

The loss of a stiffening (`search_stiffening`) is that of the frames' boundaries, read
without their forces, and that of the forces read beside the known ones.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import exp, inf, log, log1p
from typing import Generic, TypeGuard, TypeVar

import numpy as np

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.normal_distribution import (
    NINETY_PERCENT,
    correlation_of,
    within_bounds,
)
from scleraforce.calibration.start_of_an_eye import (
    EVEN_LOSS,
    ForceFrame,
    StartedEye,
    first_fit,
    of_other_eyes,
    start_eye,
    with_prior,
)
from scleraforce.fit.one_frame import NO_WALL_M, BoundaryFit, fit_boundaries
from scleraforce.fit.planes_of_a_moment import PlanesFit
from scleraforce.fit.prior_of_an_eye import Prior, prior_of
from scleraforce.library import Library
from scleraforce.library.library_plan import LITTLE_STIFFENING, stiffening_place
from scleraforce.recordings.force_errors import LABEL_SD_N
from scleraforce.records.eye import (
    GROWTH_SCALE,
    LEVEL_SCALE,
    ForceDiscrepancy,
    Modulus,
    beside_middle,
)
from scleraforce.records.fields import computed
from scleraforce.records.globe import REFERENCE_RIGIDITY, Globe
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study

Scales = tuple[Floats, Floats]

# places of the four that are found: ln E, k over the reference's, level, growth
OF_MODULUS = 0
OF_RIGIDITY = 1
SCALES = np.array([LEVEL_SCALE, GROWTH_SCALE])
CAUCHY = 2.0  # scales at which a prior's weight is halved
ROUNDS = 60
# starts of the search: either pair explains much
BEGINNINGS = (
    (0.0, 0.0, 1.0, 1.0),
    (1.0, 1.0, 0.0, 0.0),
)
AS_READ = (False, False, True, True)  # what is sought where E and k stay
_OPEN_SD = 1e-6  # standard deviation of the k of an open globe
SETTLED = 1e-9
# Of three frames each of 31 virtual eyes of even walls of the library; less than 1, for
# the frames share some of the reading errors. And how many frames the prior is worth:
# with 3 to 8, intervals of 65 such eyes, a half of them uneven, were the narrowest at
# equal coverage.
EXPECTED_SQUARE = 0.17
SCATTER_FRAMES = 5.0


LEAST_SLOPE = 0.2  # of the force by E: less is the slope of a globe that bears it all
# What a calibration file may hold: squares of the largest are still numbers, and the
# tiniest may be divided by.
LARGEST = 1e15
TINY = 1e-15
finite = partial(computed, -LARGEST, LARGEST)
not_negative = partial(computed, 0.0, LARGEST)
positive = partial(computed, TINY, LARGEST)


@dataclass(frozen=True, kw_only=True)
class KnownForce:
    """A frame's known force, the force that is read in it, and the standard deviation
    of that, all N.

    It was read with `modulus_pa` and `rigidity`, Pa^(1/3)/m^3, each taken for certain;
    `by_modulus` and `by_rigidity` are the slopes of the logarithm of the read force by
    ln E and by the rigidity over the reference's. `loss` is that of its boundaries
    (`BoundaryFit.loss`).
    """

    force_n: float = positive()
    library_n: float = positive()
    sd_n: float = positive()
    modulus_pa: float = positive()
    rigidity: float = finite()
    by_modulus: float = finite(default=1.0)
    by_rigidity: float = finite(default=0.0)
    loss: float = not_negative(default=0.0)

    @property
    def own_modulus_pa(self) -> float:
        """The modulus by this frame alone, at the rigidity that it was read with."""
        ratio = self.force_n / self.library_n
        return self.modulus_pa * float(
            ratio ** (1.0 / max(self.by_modulus, LEAST_SLOPE))
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class StiffnessEstimate:
    """The estimate of ln E, k over the reference's, level and growth: mean (4,) and
    covariance (4, 4).

    `loss` is that of the E and k with which the frames were read. `scatter`: residuals
    of the frames in standard deviations of their expectation.
    """

    mean: Floats
    covariance: Floats
    loss: float
    scatter: float


def regression(
    frames: Sequence[KnownForce], setup: Setup, place: Floats
) -> StiffnessEstimate:
    """Return the estimate from frames of one eye, by reweighted least squares."""
    center = np.concatenate([place_of(setup), np.zeros(2)])
    direction = np.zeros((len(frames), 4))
    left = np.zeros(len(frames))
    weight = np.zeros(len(frames))

    for row, frame in enumerate(frames):
        beside = float(beside_middle(np.array(frame.library_n)))
        direction[row] = frame.by_modulus, frame.by_rigidity, 1.0, beside
        read_at = np.array(
            [log(frame.modulus_pa), frame.rigidity / REFERENCE_RIGIDITY, 0.0, 0.0]
        )
        left[row] = log(frame.force_n / frame.library_n) - direction[row] @ (
            center - read_at
        )
        weight[row] = 1.0 / (
            (frame.sd_n / frame.library_n) ** 2 + (LABEL_SD_N / frame.force_n) ** 2
        )

    modulus, globe = own_modulus_and_globe(setup)
    sds = np.array([modulus.relative_sd, max(globe.sd / REFERENCE_RIGIDITY, _OPEN_SD)])
    of_start = np.outer(sds, sds) * np.array(
        [[1.0, globe.correlation], [globe.correlation, 1.0]]
    )
    scales: Scales = np.asarray(np.linalg.inv(of_start)), np.diag(SCALES**-2.0)
    every = np.ones(4, dtype=bool)
    begun = (
        _reweighted(direction, left, weight, scales, every, begin)
        for begin in BEGINNINGS
    )
    mean, covariance = min(
        begun, key=lambda found: _loss(direction, left, weight, scales, found[0])
    )
    away = np.concatenate([place, np.zeros(2)]) - center
    there, _ = _reweighted(
        direction,
        left - direction @ away,
        weight,
        scales,
        np.array(AS_READ),
        BEGINNINGS[0],
    )
    loss = _loss(direction, left, weight, scales, there + away)
    rest = left - direction @ mean
    # Before any frame the scatter is 1, sure like `SCATTER_FRAMES` frames (inverse
    # gamma prior: Gelman et al., Bayesian Data Analysis, 3rd ed., section 2.6). It is
    # never less: a few frames that agree do not show that others will.
    squares = SCATTER_FRAMES + float(weight @ rest**2) / EXPECTED_SQUARE
    scatter = max(1.0, float(np.sqrt(squares / (SCATTER_FRAMES + len(frames)))))

    return StiffnessEstimate(
        mean=center + mean, covariance=covariance, loss=loss, scatter=scatter
    )


def _reweighted(
    direction: Floats,
    left: Floats,
    weight: Floats,
    scales: Scales,
    free: Flags,
    begin: tuple[float, ...],
) -> tuple[Floats, Floats]:
    """Return mean (4,) and covariance (4, 4) of the `free` unknowns; the rest stays 0.

    `direction` (frame, 4) are the frames' slopes, `left` (frame,) the residuals to
    explain; `scales`: inverse squares of the scales of E with k, and of level with
    growth, (2, 2) each. Far from `begin` the priors hardly hold.
    """
    normal = direction.T @ (weight[:, None] * direction)
    gradient = direction.T @ (weight * left)
    found = np.where(free & bool(len(left)), begin, 0.0)
    covariance = np.zeros((4, 4))

    for _ in range(ROUNDS):
        precision = normal.copy()
        precision[:2, :2] += scales[0] / (
            1.0 + found[:2] @ scales[0] @ found[:2] / CAUCHY**2
        )
        precision[2:, 2:] += scales[1] / (1.0 + scales[1] @ found[2:] ** 2 / CAUCHY**2)
        before = found
        covariance[np.ix_(free, free)] = np.linalg.inv(precision[np.ix_(free, free)])

        found = covariance @ gradient
        if np.abs(found - before).max() < SETTLED:
            break

    return found, covariance


def _loss(
    direction: Floats, left: Floats, weight: Floats, scales: Scales, found: Floats
) -> float:
    """Return the loss of the four: their residuals, and their distance from the priors
    (`_reweighted`).
    """
    rest = left - direction @ found
    of_start = CAUCHY**2 * np.log1p(found[:2] @ scales[0] @ found[:2] / CAUCHY**2)
    of_eyes = CAUCHY**2 * np.log1p(scales[1] @ found[2:] ** 2 / CAUCHY**2).sum()
    return float(weight @ rest**2 + of_start + of_eyes)


def modulus_after(read: Sequence[KnownForce], setup: Setup, prior: Setup) -> Modulus:
    """Return the modulus by some of an eye's readings and a prior; `setup`: the eye
    after all of them.
    """
    found = regression(read, prior, place_of(setup))
    sd = float(np.sqrt(found.covariance[OF_MODULUS, OF_MODULUS]))
    mean_pa = exp(float(found.mean[OF_MODULUS]))
    return Modulus(mean_pa=mean_pa, sd_pa=sd * mean_pa, source="own")


def own_modulus_and_globe(setup: Setup) -> tuple[Modulus, Globe]:
    """Return modulus and globe of an eye after its frames, which has both."""
    assert setup.eye.modulus is not None
    assert setup.eye.globe is not None
    return setup.eye.modulus, setup.eye.globe


def place_of(setup: Setup) -> Floats:
    """Return ln E and k over the reference's (2,)."""
    modulus, globe = own_modulus_and_globe(setup)
    return np.array([log(modulus.mean_pa), globe.mean / REFERENCE_RIGIDITY])


Trial = TypeVar("Trial")

# steps for differences: in ln E, and in k as a share of k, or of a tenth of the
# reference rigidity if k is smaller
MODULUS_STEP = 0.02
RIGIDITY_STEP = 0.05
LEAST_RIGIDITY = 0.1
LARGEST_STEP = 0.5  # of ln E, before the frames are read anew
READINGS = 5  # at most; what moves by less than a step is not read anew
CERTAIN = 0.001  # of a standard deviation: nothing is left of it


DIVERGED = 1_000_000  # frames that a calibration refuses if it explains none
REFINEMENTS = 3  # stiffenings between the library's that are tried
# more loss than that of a stiffening that explains the frames: those beyond are not
# tried
ENOUGH = 6.0
# times as much: frames of uneven eyes, too, are explained by the walls of their tissue
EXPLAINED = 8.0
# Scale of Cauchy's prior of ln(1 + b): tissue does not stiffen unless its frames say
# so.
TISSUE_SCALE = 0.5
TISSUE_CAUCHY = 2.0
WIDE = 0.6  # of ln(1 + 5 b): an interval at an end in which one more is tried
NEAR = 0.03  # of the same: what lies so near was tried
# least gain of loss, by a parabola, that is worth a trial where losses differ by less
GAIN = 0.02
ALIKE = 1.0


@dataclass(frozen=True, kw_only=True)
class TissueTrial(Generic[Trial]):
    """A calibration with walls of one stiffening.

    `refused` is the number of frames that it could not use, `frames` that of the
    others, `of_boundaries` and `of_forces` their losses. `started`: the eye where it
    began, for the next trial of the same frames.
    """

    found: Trial
    refused: int
    frames: int
    of_boundaries: float
    of_forces: float
    started: StartedEye | None = None

    @property
    def loss(self) -> float:
        """The whole loss."""
        return self.of_boundaries + self.of_forces

    @classmethod
    def diverged(
        cls, found: Trial, refused: int, started: StartedEye | None = None
    ) -> "TissueTrial[Trial]":
        """Return a trial that explains none of its frames: any trial that explains some
        is better.
        """
        return cls(
            found=found,
            refused=DIVERGED + refused,
            frames=0,
            of_boundaries=0.0,
            of_forces=0.0,
            started=started,
        )


@dataclass(frozen=True)
class RereadEye:
    """The setup, the readings of its frames (None: cannot be read), and the loss of
    their forces.
    """

    setup: Setup
    again: tuple[KnownForce | None, ...]
    loss: float

    def trial(
        self, found: Trial, refused: int, started: StartedEye | None = None
    ) -> TissueTrial[Trial]:
        """Return the trial that `search_stiffening` compares; `refused`: the number of
        frames that no wall of the library lies on.
        """
        read = [frame for frame in self.again if frame is not None]
        refused += len(self.again) - len(read)
        loss = sum(frame.loss for frame in read)
        return TissueTrial(
            found=found,
            refused=refused,
            frames=len(read),
            of_boundaries=loss,
            of_forces=self.loss,
            started=started,
        )


Again = tuple[list[KnownForce | None], list[KnownForce], StiffnessEstimate]


def reread_eye(
    setup: Setup,
    frames: Sequence[ForceFrame],
    earlier: Sequence[KnownForce],
    library: Library,
    study: Study,
) -> RereadEye:
    """Return the setup after its frames are read again; its E and globe are the prior,
    with those of `earlier` frames.
    """

    def read_with(now: Setup) -> Again:
        again = read_again(frames, now, library, study)
        read = [*earlier, *(frame for frame in again if frame is not None)]
        return again, read, regression(read, setup, place_of(now))

    now = setup
    again, read, found = read_with(setup)

    for _ in range(READINGS - 1):
        moved = _moved(now, found)
        if not read or (np.abs(place_of(moved) - place_of(now)) < _steps(now)).all():
            now = moved
            break

        of_moved = read_with(moved)
        if len(of_moved[1]) < len(read) or of_moved[2].loss >= found.loss:
            break

        now = moved
        again, read, found = of_moved

    return RereadEye(
        _with_discrepancy(now, found, [frame.force_n for frame in read]),
        tuple(again),
        found.loss,
    )


def eye_of_forces(
    setup: Setup,
    frames: Sequence[ForceFrame],
    library: Library,
    study: Study,
    before: StartedEye | None = None,
    most: int | None = None,
) -> TissueTrial[tuple[Setup, tuple[ForceFrame, ...]]] | None:
    """Return what frames of known force tell of an eye with the walls of one tissue,
    and the frames that were used; None if none can be.

    Args:
        setup: what is stated of the eye, and its globe.
        frames: in the order in which they are taken.
        library: of the tissue.
        study: the prior of E, and ranges of what is not stated.
        before: the eye by the same frames and walls of another tissue (`start_eye`).
        most: number of frames that are used; None: all.
    """
    stated = with_prior(setup, study)
    others = of_other_eyes(stated)
    near = library.nearest_contact(setup.needle.polar_rad)
    taken = list[ForceFrame]()
    fits = list[BoundaryFit]()
    refused = 0

    for frame in frames:
        if len(taken) == most:
            break
        fit = first_fit(frame.shown, others, near, study)
        if fit is None:
            refused += 1
        else:
            taken.append(frame)
            fits.append(fit)

    if not taken:
        return None

    started = start_eye(stated, taken, fits, near, study, {}, before)
    used = tuple(taken)
    if started.status != "ok":
        without = replace(stated, eye=replace(stated.eye, modulus=None))
        return TissueTrial.diverged((without, used), refused, started)

    after = reread_eye(started.setup, taken, (), library, study)
    return after.trial((after.setup, used), refused, started)


def read_again(
    frames: Sequence[ForceFrame], setup: Setup, library: Library, study: Study
) -> list[KnownForce | None]:
    """Return the readings of an eye's frames without their forces, each None if the
    frame cannot be read.

    Each is read at its own resting pressure, if the globe leaks. E and k, which the
    frames share, are taken for certain: they do not scatter between them. The planes of
    a moment are read together, and are one reading.
    """
    near = library.nearest_contact(setup.needle.polar_rad)
    modulus, globe = own_modulus_and_globe(setup)
    modulus_step, rigidity_step = _steps(setup)
    certain = [_certain(setup), _certain(setup, modulus_step)]

    if globe.can_be_sealed:
        certain.append(_certain(setup, 0.0, rigidity_step))

    found = list[KnownForce | None]()

    for frame in frames:
        iop_pa = setup.eye.iop_pa if frame.iop_pa is None else frame.iop_pa
        eyes = [replace(each, eye=replace(each.eye, iop_pa=iop_pa)) for each in certain]
        fits = (
            _fits(near, frame, eyes, study)
            if frame.planes is None
            else _fits_of_planes(near, frame.planes, eyes, study)
        )

        beside = list(filter(_read, fits))
        if len(beside) < len(eyes):
            found.append(None)
            continue

        here, stiffer, *rigid = beside
        low_n, high_n = here.interval_n
        slopes = [log(each.force_n / here.force_n) for each in (stiffer, *rigid)]
        found.append(
            KnownForce(
                force_n=frame.force_n,
                library_n=here.force_n,
                sd_n=0.5 * (high_n - low_n) / NINETY_PERCENT,
                modulus_pa=modulus.mean_pa,
                rigidity=globe.mean,
                by_modulus=slopes[0] / modulus_step,
                by_rigidity=slopes[1] / rigidity_step if rigid else 0.0,
                loss=here.loss,
            )
        )

    return found


def _fits(
    near: Library, frame: ForceFrame, eyes: Sequence[Setup], study: Study
) -> list[BoundaryFit | None]:
    """Return the fits of a frame with each of the setups; none if the first one
    cannot be read.
    """
    priors = [prior_of(eye, study.reader, study.eye.radius_m) for eye in eyes]
    smoothing_m = study.calibration.surface_smoothing_m
    at = near, frame.wall.lateral_m, frame.wall.depth_m

    fit = fit_boundaries(*at, priors[0], smoothing_m, frame.force_n)
    if not _read(fit):
        return []

    # A fit of its own for each could end in another valley, and the slope would be that
    # from one to the other.
    moved = (fit.unknown + prior.mean - priors[0].mean for prior in priors)
    return [
        fit_boundaries(*at, of, smoothing_m, begun=start)
        for of, start in zip(priors, moved, strict=True)
    ]


def _fits_of_planes(
    near: Library, seen: PlanesFit, eyes: Sequence[Setup], study: Study
) -> list[BoundaryFit | None]:
    """Return the fits of all planes of a moment with each of the setups."""

    def priors(eye: Setup) -> list[Prior]:
        return [
            prior_of(eye.turned(plane.direction_rad), study.reader, study.eye.radius_m)
            for plane in seen.planes
        ]

    smoothing_m = study.calibration.surface_smoothing_m
    first = seen.with_priors(near, priors(eyes[0]), smoothing_m)
    return [first.with_priors(near, priors(eye), smoothing_m).whole for eye in eyes]


def _read(fit: BoundaryFit | None) -> TypeGuard[BoundaryFit]:
    """Return True if a frame was read."""
    return fit is not None and fit.misfit_m <= NO_WALL_M and fit.force_n > 0.0


def _steps(setup: Setup) -> Floats:
    """Return the steps of ln E and k over the reference's (2,) for difference
    quotients.
    """
    modulus, globe = own_modulus_and_globe(setup)
    share = RIGIDITY_STEP * max(globe.mean / REFERENCE_RIGIDITY, LEAST_RIGIDITY)
    return np.array(
        [
            max(modulus.relative_sd, MODULUS_STEP),
            max(globe.sd / REFERENCE_RIGIDITY, share),
        ]
    )


def _certain(setup: Setup, log_modulus: float = 0.0, rigidity: float = 0.0) -> Setup:
    """Return an eye whose E and k are certain, each a step off: of ln E, and of k over
    the reference's.
    """
    modulus, globe = own_modulus_and_globe(setup)
    if globe.can_be_sealed:
        mean = globe.mean + rigidity * REFERENCE_RIGIDITY
        lowest = min(globe.lowest, mean)
        highest = max(globe.highest, mean)
        globe = replace(
            globe,
            mean=mean,
            sd=CERTAIN * globe.sd,
            lowest=lowest,
            highest=highest,
            correlation=0.0,
        )

    modulus = replace(modulus, mean_pa=modulus.mean_pa * exp(log_modulus), sd_pa=0.0)
    return replace(
        setup, eye=replace(setup.eye, modulus=modulus, globe=globe, discrepancy=None)
    )


def _moved(setup: Setup, found: StiffnessEstimate) -> Setup:
    """Return an eye with the E and k that were found, not too far from the ones that it
    was read with.
    """
    modulus, globe = own_modulus_and_globe(setup)
    mean = found.mean
    covariance = found.covariance

    if globe.can_be_sealed:
        # where k would leave its bounds, E is that of a k on the bound
        bounds = (globe.lowest / REFERENCE_RIGIDITY, globe.highest / REFERENCE_RIGIDITY)
        mean = within_bounds(mean, covariance, OF_RIGIDITY, bounds)
        globe = replace(globe, mean=float(mean[OF_RIGIDITY]) * REFERENCE_RIGIDITY)

    farther = np.clip(
        mean[OF_MODULUS] - log(modulus.mean_pa), -LARGEST_STEP, LARGEST_STEP
    )
    return replace(
        setup,
        eye=replace(
            setup.eye,
            modulus=replace(modulus, mean_pa=modulus.mean_pa * exp(farther)),
            globe=globe,
        ),
    )


def _with_discrepancy(
    setup: Setup, found: StiffnessEstimate, forces_n: Sequence[float]
) -> Setup:
    """Return an eye at its E and k with their uncertainty, and the discrepancy given
    these; forces in N.
    """
    modulus, globe = own_modulus_and_globe(setup)
    covariance = found.covariance
    sds = np.sqrt(np.diag(covariance))
    modulus = replace(modulus, sd_pa=float(sds[OF_MODULUS]) * modulus.mean_pa)

    if globe.can_be_sealed:
        correlation = correlation_of(covariance, OF_MODULUS, OF_RIGIDITY)
        globe = replace(
            globe,
            sd=float(sds[OF_RIGIDITY]) * REFERENCE_RIGIDITY,
            correlation=correlation,
        )

    given = covariance[2:, :2] @ np.linalg.inv(covariance[:2, :2])
    level, growth = (
        found.mean[2:] + given @ (place_of(setup) - found.mean[:2])
    ).tolist()
    left = covariance[2:, 2:] - given @ covariance[:2, 2:]
    level_sd, growth_sd = np.sqrt(np.diag(left)).tolist()
    rising_n = [0.0, *sorted(forces_n)]
    by = given * np.array([modulus.relative_sd, float(sds[OF_RIGIDITY])])
    discrepancy = ForceDiscrepancy(
        level=level,
        growth=growth,
        level_sd=level_sd,
        growth_sd=growth_sd,
        correlation=correlation_of(left, 0, 1),
        level_by=(float(by[0, 0]), float(by[0, 1])),
        growth_by=(float(by[1, 0]), float(by[1, 1])),
        scatter=found.scatter,
        largest_n=rising_n[-1] if forces_n else None,
        widest_gap=float(np.diff(rising_n).max() / rising_n[-1]) if forces_n else None,
    )

    return replace(
        setup,
        eye=replace(setup.eye, modulus=modulus, globe=globe, discrepancy=discrepancy),
    )


def most_trials(library: Library) -> int:
    """Return the largest number of stiffenings that are tried."""
    held = len(library.walls.stiffening)
    return held + REFINEMENTS if held > 1 else 1


def search_stiffening(
    library: Library,
    calibrate: Callable[[Library, StartedEye | None], TissueTrial[Trial] | None],
) -> tuple[float, Trial] | None:
    """Return the stiffening that explains an eye's frames best, and the calibration
    with it; None if there is none.

    It begins with the library's, from the lowest, until one explains the frames and the
    next much worse, or two in a row do worse and worse; it continues beside the best
    one. A stiffening that refuses frames which others use is ruled out. `calibrate`
    gets the walls of one tissue, and the start of the trial before.
    """
    tried = dict[float, TissueTrial[Trial]]()

    def attempt(stiffening: float) -> None:
        before = next(reversed(tried.values())).started if tried else None
        found = calibrate(library.for_stiffening(stiffening), before)
        if found is not None:
            tried[stiffening] = found

    for stiffening in library.walls.stiffening.tolist():
        attempt(stiffening)
        if stiffening in tried:
            losses = _losses(tried)
            trials = list(tried.values())
            best = trials[int(losses.argmin())]
            explained = best.of_boundaries <= EXPLAINED * EVEN_LOSS * best.frames

            worse = (losses.min() + ENOUGH < losses[-2:]) & (losses[-2:] < inf)
            if worse[-1] and (
                explained or (len(worse) == 2 and worse[0] and losses[-2] < losses[-1])
            ):
                break

    if not tried:
        return None

    for _ in range(REFINEMENTS):
        between = _between(tried)
        if between is None:
            break

        attempt(between)

    stiffening, trial = list(tried.items())[int(_losses(tried).argmin())]
    return stiffening, trial.found


def _losses(tried: Mapping[float, TissueTrial[Trial]]) -> Floats:
    """Return the loss of each trial with that of its stiffening by the prior; infinite
    if it refuses more frames.
    """
    fewest = min(trial.refused for trial in tried.values())
    able = [trial for trial in tried.values() if trial.refused == fewest]
    least = min(able, key=lambda trial: trial.loss)
    scale = max(1.0, least.of_boundaries / (EVEN_LOSS * max(least.frames, 1)))
    by_prior = [
        TISSUE_CAUCHY**2 * log(1.0 + (log1p(b) / (TISSUE_SCALE * TISSUE_CAUCHY)) ** 2)
        for b in tried
    ]
    each = zip(tried.values(), by_prior, strict=True)

    return np.array(
        [
            trial.loss / scale + prior if trial.refused == fewest else inf
            for trial, prior in each
        ]
    )


def _between(tried: Mapping[float, TissueTrial[Trial]]) -> float | None:
    """Return the stiffening to try next, beside the best one; None: no other is likely
    to be better.

    It is the lowest place of a parabola through the best one and its neighbours;
    halfway to the other neighbour beside one that is ruled out, below a largest one
    that is best, and if there is only one other. A parabola through losses that are
    alike is trusted, also in how little is to gain.
    """
    order = np.argsort(list(tried))
    places = stiffening_place(np.array(list(tried)))[order]
    losses = _losses(tried)[order]
    best = int(losses.argmin())
    last = len(places) - 1
    lowest = float(places[best])
    bounded = 0 < best < last

    if last >= 2:
        first = min(max(best - 1, 0), last - 2)
        near = slice(first, first + 3)
        if np.isfinite(losses[near]).all():
            bent, straight, _ = np.polyfit(places[near], losses[near], 2).tolist()
            if bent > 0.0:
                lowest = float(np.clip(-0.5 * straight / bent, places[0], places[-1]))
                off, at_best = np.array([lowest, places[best]]) + 0.5 * straight / bent

                gains = (
                    bent * (at_best**2 - off**2) >= GAIN
                    or np.ptp(losses[near]) >= ALIKE
                )
                if not gains and np.diff(places[near]).min() < WIDE:
                    return None
        elif bounded:
            beside = best - 1 if np.isfinite(losses[best - 1]) else best + 1
            lowest = (
                0.5 * float(places[best] + places[beside])
                if np.isfinite(losses[beside])
                else lowest
            )

    unsure = last > 0 and (best == last or last == 1) and lowest == places[best]
    beside = best - 1 if best == last else best + 1
    if (
        unsure
        and np.isfinite(losses[beside])
        and abs(places[best] - places[beside]) > WIDE
    ):
        lowest = 0.5 * float(places[best] + places[beside])

    if np.abs(places - lowest).min() < NEAR:
        return None

    return float(np.clip(LITTLE_STIFFENING * np.expm1(lowest), min(tried), max(tried)))
