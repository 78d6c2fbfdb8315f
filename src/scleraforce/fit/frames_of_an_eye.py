"""The stiffness of an eye from its shape: one fit of the library's walls to all its
frames, whatever their forces.

How a dent spreads depends on the pressure over E. The frames share E, IOP, thickness,
gap, size, inner offset, form and pole; each has its own dent, pose, reflection and
pressure. The normal matrix is a block arrow: each frame's own block is eliminated
(Schur's complement), the frames' information on the shared block adds up, and the prior
counts once.

Walls that are not even bend otherwise than the library's, alike in all frames of a
contact. That discrepancy is a Gaussian process along the section and over the depth of
the dent (Kennedy and O'Hagan, J. R. Stat. Soc. B 63, 2001), an unknown of the same fit:
more frames do not make sure what none of them tells. Its sizes have the largest
marginal likelihood; they are at least as large as even walls in three dimensions need.

Beside the pictures, a frame may have the needle's travel (dent + force x the bed's
compliance + a shift, both unknown), a pressure of its own (a known change of the IOP),
or a known force.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import log
from typing import NamedTuple

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.normal_distribution import robust_spread
from scleraforce.fit import unknowns
from scleraforce.fit.compiled_fit import COLUMNS, CORRELATED_M, INNER_SD_M, OUTER_SD_M
from scleraforce.fit.compiled_search import HEAVY_CAUCHY, HIGHEST_POLE, MOVING
from scleraforce.fit.least_squares import UNSEEN_LOSS, cauchy_loss, cauchy_weight
from scleraforce.fit.one_frame import law_of, library_walls
from scleraforce.fit.prior_of_an_eye import HEAVY, KNOWN_SD, prior_of
from scleraforce.fit.shown_wall import LEAST_SD, WallDepths, predict_depths
from scleraforce.library.wall_responses import Library
from scleraforce.records.setup import Setup
from scleraforce.records.study import ReaderStudy

OWN = np.array(
    [
        unknowns.TIP,
        unknowns.LATERAL,
        unknowns.DEPTH,
        unknowns.ROTATION,
        unknowns.SHINE,
        unknowns.PRESSURE,
    ]
)
SHARED = np.setdiff1d(np.arange(len(unknowns.NAMES)), OWN)
# places in the shared vector
COMPLIANCE, SHIFT, RIGIDITY, WEIGHTS = range(len(SHARED), len(SHARED) + 4)
MODULUS, THICKNESS, SIZE, IOP = (
    SHARED.tolist().index(name)
    for name in (unknowns.MODULUS, unknowns.THICKNESS, unknowns.SIZE, unknowns.IOP)
)
_FORM, _POLE = (
    np.isin(SHARED, np.arange(len(unknowns.NAMES))[place]).nonzero()[0]
    for place in (unknowns.FORM, unknowns.POLE)
)
# Of the logarithm of the bed's compliance, m/N, the travel's shift, m, and the rigidity
# over the globe's mean.
EXTRA_MEAN = np.array([log(1 / 60.0), 0.0, 1.0])
EXTRA_SD = np.array([1.0, 1e-3, 1e-3])
TRAVEL_SD_M = 10e-6  # standard deviation of a travel
TIP_SD = 0.01  # its share for the library's dent
# standard deviation of the logarithm of a known force: the level of real walls beside
# the library's
FORCE_SD = 0.02
# length left out at either end of a frame's surface, where the segmentation bends it up
EDGE_M = 0.7e-3
COARSER = 2  # columns of a single frame's fit for one here
# The discrepancy: knots along asinh(x/1 mm) and over the dent, lengths of correlation,
# share of the thickness.
KNOTS = np.linspace(-np.arcsinh(6.5), np.arcsinh(6.5), 17)
KNOT_TIPS_M = np.array([0.0, 1.3e-3, 2.8e-3, 4.8e-3])
ALONG = 0.5
OVER_M = 2e-3
INNER_SHARE = 0.7
REFERENCE_M = 2e-3
WARP_M = 1e-3
ROUNDING = 1e-4  # of the kernel
LEAST_SIZE_M = 0.3e-6  # of a part that differs between depths of dents
RESTING_SIZES_M = np.array([1e-6, 2e-6, 4e-6, 8e-6, 16e-6])
GROWING_SIZES_M = np.array([4e-6, 8e-6, 16e-6, 32e-6])
LEAST_NOISE = 0.8  # of the boundaries over their SDs
# Of the standard deviation of ln E: rms of its errors over it, of 12 virtual eyes in
# three dimensions, a half of them uneven, each with and without travel
# (benchmarks/README.md).
WIDER = 1.4
ROUNDS = 30  # of the fit
SIZED_ROUNDS = (2, 4, 6, 8, 10, 12)  # with sizes sought
SETTLED = 2e-3  # of the cost
FIRST_DAMPING = 1e-3
RETRY_DAMPING = 1e-2
LEAST_DAMPING = 1e-6
MOST_DAMPING = 1e6
FARTHEST = 8.0  # standard deviations that unknowns may leave their prior by
EXTRA_STEP = 1e-5
LEAST_N = 1e-6
# steps for derivatives of force and volume
STEPS = np.where(np.isin(MOVING, (unknowns.TIP, unknowns.THICKNESS)), 1e-7, 1e-4)


@dataclass(frozen=True, eq=False, kw_only=True)
class ShownFrame:
    """A frame of an eye: its boundaries, as in `one_frame.fit_boundaries`, and what
    else is known at its time.

    `iop_pa`: the pressure without the needle, if it was changed; `travel_m`: how far
    the needle has gone; `force_n`: a known elastic force along the wall's normal, with
    its standard deviation `force_sd_n`; `gap_m`: of the frame's plane, if it differs
    between frames (its error is that of the eye's gap).
    """

    lateral_m: Floats
    depth_bc: Floats
    iop_pa: float | None = None
    travel_m: float | None = None
    force_n: float | None = None
    force_sd_n: float = 0.0
    gap_m: float | None = None


@dataclass(frozen=True, eq=False)
class JointFit:
    """The fit: `shared` unknowns with their `covariance`, the frames' `own` (frame,
    unknown), and sizes.

    The first of `shared` are `NAMES[SHARED]`, then `COMPLIANCE`, `SHIFT` and
    `RIGIDITY`; the weights of the discrepancy follow. `noise` is that of the boundaries
    over their SDs, `resting_m` and `growing_m` are sizes of the discrepancy: of any
    dent, and of one of 2 mm. `cost` is that of boundaries and prior, `forces_n`
    (frame,) are the frames' forces.
    """

    shared: Floats
    covariance: Floats
    own: Floats
    noise: float
    resting_m: float
    growing_m: float
    cost: float
    forces_n: Floats

    @property
    def log_modulus(self) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm of E in Pa."""
        return float(self.shared[MODULUS]), float(
            np.sqrt(self.covariance[MODULUS, MODULUS])
        )


class _FrameOfEye:
    """A frame's columns (column,), outer ones first, with a workspace; its IOP's
    logarithm and gap beside the eye's.
    """

    def __init__(self, shown: ShownFrame, log_iop: float, gap_m: float) -> None:
        self.shown = shown
        self.log_iop = log_iop
        self.gap_m = gap_m
        seen = np.isfinite(shown.depth_bc)
        lateral_m = shown.lateral_m
        ends = lateral_m[seen[0]][[0, -1]] + EDGE_M * np.array([1.0, -1.0])
        inside = (lateral_m > ends[0]) & (lateral_m < ends[1])
        inside[
            np.arange(len(inside)) % (COARSER * max(1, -(-len(lateral_m) // COLUMNS)))
            > 0
        ] = False
        boundary, column = np.nonzero(seen & inside)
        self.at_m = lateral_m[column]
        self.depth_m = shown.depth_bc[boundary, column]
        self.is_inner = boundary == 1
        self.outer = int((boundary == 0).sum())
        self.sd_m = np.where(self.is_inner, INNER_SD_M, OUTER_SD_M)
        self.as_one = max(
            1.0, CORRELATED_M / float(np.median(np.diff(self.at_m[: self.outer])))
        )
        lines = [np.empty(len(column)) for _ in range(4)]
        flags = np.empty(len(column), dtype=np.bool_)
        self.depths = WallDepths(
            lines[0],
            lines[1],
            lines[2],
            lines[3],
            flags,
            np.empty((len(column), len(unknowns.NAMES))),
        )


class _Seen(NamedTuple):
    """A frame beside a wall: its cost, normal matrix and gradient (shared and own), and
    its columns' residuals.
    """

    cost: float
    normal: Floats
    gradient: Floats
    off: Floats


class _EyeProblem:
    """The least-squares problem of an eye's frames."""

    def __init__(
        self,
        library: Library,
        frames: Sequence[ShownFrame],
        setup: Setup,
        trained: ReaderStudy,
        smoothing_m: float,
        iop_sd: float = KNOWN_SD[unknowns.IOP],
    ) -> None:
        prior = prior_of(setup, trained, library.radius_m)
        self.library = library
        self.smoothing_m = smoothing_m
        self.law = law_of(prior.globe)
        self.globe = prior.globe
        resting_pa = setup.eye.iop_pa or float(np.exp(prior.mean[unknowns.IOP]))
        self.about = (
            float(prior.mean[unknowns.GAP]),
            float(prior.mean[unknowns.THICKNESS]),
        )
        own_gap_m = setup.needle.gap_m or 0.0
        gaps_m = [
            0.0 if shown.gap_m is None else shown.gap_m - own_gap_m for shown in frames
        ]
        logs = [log((shown.iop_pa or resting_pa) / resting_pa) for shown in frames]
        self.frames = [
            _FrameOfEye(*of_frame)
            for of_frame in zip(frames, logs, gaps_m, strict=True)
        ]
        self.own_mean = prior.mean[OWN]
        self.own_sd = prior.sd[OWN]
        self.mean = np.concatenate(
            [
                prior.mean[SHARED],
                EXTRA_MEAN,
                np.zeros(2 * len(KNOTS) * len(KNOT_TIPS_M)),
            ]
        )
        self.sd = np.concatenate([prior.sd[SHARED], EXTRA_SD])
        if setup.eye.iop_pa is not None and setup.eye.iop_sd_pa is None:
            self.sd[IOP] = iop_sd

        if setup.eye.modulus is not None:
            # E has these moments, and its logarithm is normal
            variance = float(np.log1p(setup.eye.modulus.relative_sd**2))
            self.mean[MODULUS] = log(setup.eye.modulus.mean_pa) - 0.5 * variance
            self.sd[MODULUS] = np.sqrt(variance)

        if not self.law.is_open:
            self.sd[RIGIDITY] = prior.globe.sd / prior.globe.mean

        self.is_heavy = np.append(
            np.isin(SHARED, [*HEAVY, unknowns.THICKNESS]),
            np.zeros(len(EXTRA_SD), dtype=np.bool_),
        )
        self.noise = 1.0
        self.resting_m = float(RESTING_SIZES_M[1])
        self.growing_m = float(GROWING_SIZES_M[0])
        self.precision = self.weights_precision()

    def weights_precision(self) -> Floats:
        """Return the inverse covariance of the discrepancy's weights: of both
        boundaries, then of the inner one.
        """
        along = np.exp(
            -0.5 * ((KNOTS[:, None] - KNOTS) / ALONG) ** 2
        ) + ROUNDING * np.eye(len(KNOTS))
        over = np.exp(-0.5 * ((KNOT_TIPS_M[:, None] - KNOT_TIPS_M) / OVER_M) ** 2)
        grown = self.growing_m * (KNOT_TIPS_M / REFERENCE_M) ** 2
        sizes = (
            self.resting_m**2
            + np.outer(grown, grown) * over
            + LEAST_SIZE_M**2 * np.eye(len(grown))
        )
        one = np.linalg.inv(np.kron(along, sizes))

        return np.asarray(
            np.kron(np.diag([1.0, INNER_SHARE**-2]), one), dtype=np.float64
        )

    def unknown(self, frame: _FrameOfEye, shared: Floats, own: Floats) -> Floats:
        """Return a frame's unknowns in the order of `NAMES`."""
        found = np.empty(len(unknowns.NAMES))
        found[SHARED] = shared[: len(SHARED)]
        found[OWN] = own
        found[unknowns.IOP] += frame.log_iop
        found[unknowns.GAP] += frame.gap_m
        return found

    def basis(self, frame: _FrameOfEye, unknown: Floats) -> Floats:
        """Return how the weights move the columns (column, weight): linear between
        knots.
        """
        along = np.arcsinh((frame.at_m - unknown[unknowns.LATERAL]) / WARP_M)
        over = np.array([unknown[unknowns.TIP]])
        at_knots = _hats(KNOTS, along)[:, :, None] * _hats(KNOT_TIPS_M, over)
        both = at_knots.reshape(len(along), -1)
        return np.concatenate([both, both * frame.is_inner[:, None]], axis=1)

    def forces_volumes(self, unknown_su: Floats) -> tuple[Floats, Floats]:
        """Return forces, N, and displaced volumes, m^3, of states (state, unknown)."""
        size = np.exp(unknown_su[:, unknowns.SIZE])
        wall = library_walls(self.library, unknown_su, self.law.pressure)
        forces = (
            np.exp(unknown_su[:, unknowns.MODULUS])
            * size**2
            * self.library.forces(*wall)
        )
        return forces, size**3 * self.library.displaced_m3(*wall)

    def numbers(self, frame: _FrameOfEye, unknown_su: Floats, extra: Floats) -> Floats:
        """Return how far law, travel and force are off, in standard deviations (state,
        number); `extra`: (3,).
        """
        shown = frame.shown
        compliance, shift_m, rigidity = extra
        found = list[Floats]()
        forces, volumes = self.forces_volumes(unknown_su)
        pressure = np.exp(unknown_su[:, self.law.pressure])
        resting = np.exp(unknown_su[:, unknowns.IOP])

        if not self.law.is_open:
            globe = self.globe.pressure_law(self.globe.mean * rigidity)
            risen = globe.level(pressure) - globe.level(resting)
            slope = resting[0] * globe.level_slope(resting[0])
            found.append((globe.rate * volumes - risen) / (LEAST_SD * slope))

        if shown.travel_m is not None:
            # under more pressure the wall rises as a sphere does
            stiffness = (
                2.0
                * np.exp(unknown_su[:, unknowns.MODULUS])
                * unknown_su[:, unknowns.THICKNESS]
            )
            rise = (
                (pressure - resting)
                * self.library.radius_m**2
                * (1.0 - self.library.poisson_ratio)
                / stiffness
            )
            gone = (
                unknown_su[:, unknowns.TIP]
                - rise
                + np.exp(compliance) * forces
                + shift_m
            )
            found.append(
                (shown.travel_m - gone) / np.hypot(TRAVEL_SD_M, TIP_SD * shown.travel_m)
            )

        if shown.force_n is not None:
            sd = np.hypot(FORCE_SD, shown.force_sd_n / shown.force_n)
            found.append(
                (log(shown.force_n) - np.log(np.maximum(forces, LEAST_N))) / sd
            )

        return np.stack(found, axis=1) if found else np.empty((len(unknown_su), 0))

    def compare_frame(
        self, frame: _FrameOfEye, shared: Floats, own: Floats, derive: bool = True
    ) -> _Seen:
        """Return a frame beside the wall of unknowns; without normal matrix and
        gradient if they are not asked for.
        """
        unknown = self.unknown(frame, shared, own)
        depths = frame.depths
        extra = shared[COMPLIANCE:WEIGHTS]
        section = np.empty((2, 2 * len(self.library.node_angles()), 2))
        places = frame.at_m, frame.outer, self.smoothing_m
        about = self.about[0] + frame.gap_m, self.about[1]
        predict_depths(
            self.library.tables, self.law, places, *about, unknown, depths, section
        )
        basis = self.basis(frame, unknown)
        unit_m = frame.sd_m * np.sqrt(1.0 + depths.slope**2)
        off = (frame.depth_m - depths.depth_m - basis @ shared[WEIGHTS:]) / unit_m
        lost = np.where(depths.seen, cauchy_loss(off), UNSEEN_LOSS).sum()
        away = (own - self.own_mean) / self.own_sd
        numbers = self.numbers(frame, unknown[None], extra)[0]
        share = 1.0 / (frame.as_one * self.noise**2)
        cost = float(share * lost + away @ away + numbers @ numbers)

        if not derive:
            return _Seen(cost, np.empty(0), np.empty(0), off)

        unused = np.zeros((len(off), len(EXTRA_SD)))
        rows = np.concatenate(
            [depths.jacobian[:, SHARED], unused, basis, depths.jacobian[:, OWN]], axis=1
        )
        weight = np.where(depths.seen, share * cauchy_weight(off), 0.0)
        rows /= unit_m[:, None]
        by_numbers = self._by_numbers(frame, unknown, extra, numbers, rows.shape[1])
        normal = rows.T @ (weight[:, None] * rows) + by_numbers.T @ by_numbers
        gradient = rows.T @ (weight * off) + by_numbers.T @ numbers
        normal[len(shared) :, len(shared) :] += np.diag(self.own_sd**-2.0)
        gradient[len(shared) :] -= away / self.own_sd

        return _Seen(cost, normal, gradient, off)

    def _by_numbers(
        self,
        frame: _FrameOfEye,
        unknown: Floats,
        extra: Floats,
        numbers: Floats,
        count: int,
    ) -> Floats:
        """Return the derivatives of the predicted numbers (number, shared and own)."""
        found = np.zeros((len(numbers), count))
        moving = list(MOVING)

        if len(numbers):
            by_unknown = np.zeros((len(numbers), len(unknown)))
            varied = np.tile(unknown, (len(moving), 1))
            varied[np.arange(len(moving)), moving] += STEPS
            by_unknown[:, moving] = (
                numbers - self.numbers(frame, varied, extra)
            ).T / STEPS
            found[:, : len(SHARED)] = by_unknown[:, SHARED]
            found[:, -len(OWN) :] = by_unknown[:, OWN]

            for place, one in enumerate(np.eye(len(extra)) * EXTRA_STEP):
                moved = self.numbers(frame, unknown[None], extra + one)[0]
                found[:, COMPLIANCE + place] = (numbers - moved) / EXTRA_STEP

        return found

    def prior(self, shared: Floats) -> tuple[float, Floats, Floats]:
        """Return the cost of leaving the prior, with its normal matrix and gradient."""
        away = (shared[:WEIGHTS] - self.mean[:WEIGHTS]) / self.sd
        bent = 1.0 + (away / HEAVY_CAUCHY) ** 2
        lost = np.where(self.is_heavy, HEAVY_CAUCHY**2 * np.log(bent), away**2)
        precision = np.where(self.is_heavy, 1.0 / bent, 1.0) / self.sd**2
        weights = shared[WEIGHTS:]
        normal = np.zeros((len(shared), len(shared)))
        normal[:WEIGHTS, :WEIGHTS] = np.diag(precision)
        normal[WEIGHTS:, WEIGHTS:] = self.precision
        gradient = -np.concatenate(
            [precision * away * self.sd, self.precision @ weights]
        )

        return float(lost.sum() + weights @ self.precision @ weights), normal, gradient

    def total(self, shared: Floats, own: Floats) -> float:
        """Return the cost of all frames and of leaving the prior."""
        each = zip(self.frames, own, strict=True)
        return self.prior(shared)[0] + sum(
            self.compare_frame(frame, shared, one, derive=False).cost
            for frame, one in each
        )

    def inside(self, shared: Floats, own: Floats) -> tuple[Floats, Floats]:
        """Return unknowns within the ranges where walls can be cut."""
        shared = shared.copy()
        own = own.copy()
        away = FARTHEST * self.sd
        shared[:WEIGHTS] = np.clip(
            shared[:WEIGHTS], self.mean[:WEIGHTS] - away, self.mean[:WEIGHTS] + away
        )
        shared[_FORM] = np.clip(shared[_FORM], *unknowns.FORM_ENDS)
        shared[_POLE] *= HIGHEST_POLE / max(
            float(np.hypot(*shared[_POLE])), HIGHEST_POLE
        )
        low = self.own_mean - FARTHEST * self.own_sd
        high = self.own_mean + FARTHEST * self.own_sd
        low[0] = 0.0
        high[0] = self.library.tip_m[-1] * np.exp(shared[SIZE])

        return shared, np.clip(own, low, high)

    def size(self, shared: Floats, seen: Sequence[_Seen]) -> None:
        """Find the noise by the columns' misfit, and the discrepancy's sizes by the
        marginal likelihood (Laplace's).
        """
        misfits = [robust_spread(np.abs(one.off)) for one in seen]
        self.noise = max(LEAST_NOISE, float(np.median(misfits)))
        normal, gradient = _eliminated(seen, len(shared), 0.0)[:2]
        _, own_normal, own_gradient = self.prior(shared)
        own_normal[WEIGHTS:, WEIGHTS:] = 0.0
        own_gradient[WEIGHTS:] = 0.0
        normal = normal + own_normal
        gradient = gradient + own_gradient
        weights = shared[WEIGHTS:]
        best = np.inf
        chosen = self.resting_m, self.growing_m, self.precision

        for self.resting_m, self.growing_m in product(
            RESTING_SIZES_M.tolist(), GROWING_SIZES_M.tolist()
        ):
            self.precision = precision = self.weights_precision()
            with_weights = normal.copy()
            pull = gradient.copy()
            with_weights[WEIGHTS:, WEIGHTS:] += precision
            pull[WEIGHTS:] -= precision @ weights
            lower = np.linalg.cholesky(with_weights)
            gained = np.linalg.solve(lower, pull)
            loss = (
                weights @ precision @ weights
                - gained @ gained
                + 2.0 * np.log(np.diag(lower)).sum()
            )

            loss -= np.linalg.slogdet(precision)[1]
            if loss < best:
                best = loss
                chosen = (self.resting_m, self.growing_m, precision)

        self.resting_m, self.growing_m, self.precision = chosen


def _hats(knots: Floats, values: Floats) -> Floats:
    """Return the linear interpolation from knots to values (value, knot)."""
    return np.stack(
        [np.interp(values, knots, one) for one in np.eye(len(knots))], axis=1
    )


def _eliminated(
    seen: Sequence[_Seen], shared: int, damping: float
) -> tuple[Floats, Floats, list[Floats]]:
    """Return the frames' normal matrix and gradient of the shared unknowns, and how
    each frame's own ones follow.
    """
    normal = np.zeros((shared, shared))
    gradient = np.zeros(shared)
    follow = list[Floats]()

    for one in seen:
        own = one.normal[shared:, shared:] + damping * np.diag(
            np.diag(one.normal)[shared:]
        )
        right = np.column_stack([one.normal[shared:, :shared], one.gradient[shared:]])
        follow.append(np.asarray(np.linalg.solve(own, right), dtype=np.float64))
        normal += (
            one.normal[:shared, :shared]
            - one.normal[:shared, shared:] @ follow[-1][:, :shared]
        )
        gradient += (
            one.gradient[:shared] - one.normal[:shared, shared:] @ follow[-1][:, shared]
        )

    return normal, gradient, follow


def fit_jointly(
    library: Library,
    frames: Sequence[ShownFrame],
    setup: Setup,
    trained: ReaderStudy,
    smoothing_m: float,
    own: Floats,
    shared: Floats | None = None,
    iop_sd: float = KNOWN_SD[unknowns.IOP],
) -> JointFit:
    """Fit the library to all frames of an eye at once, from each frame's unknowns `own`
    (frame, `OWN`).

    `setup` is the eye, its modulus the prior; `library` that of its contact; `shared`:
    of an earlier fit, to begin at; `iop_sd`: standard deviation of the logarithm of a
    known IOP.
    """
    problem = _EyeProblem(library, frames, setup, trained, smoothing_m, iop_sd)
    shared, own = problem.inside(problem.mean if shared is None else shared, own)
    damping = FIRST_DAMPING
    cost = np.inf

    for number in range(ROUNDS):
        seen = [
            problem.compare_frame(frame, shared, one)
            for frame, one in zip(problem.frames, own, strict=True)
        ]
        if number in SIZED_ROUNDS:
            problem.size(shared, seen)
            seen = [
                problem.compare_frame(frame, shared, one)
                for frame, one in zip(problem.frames, own, strict=True)
            ]

        lost, normal, gradient = problem.prior(shared)
        before = lost + sum(one.cost for one in seen)

        while True:
            of_frames, pull, follow = _eliminated(seen, len(shared), damping)
            step = np.linalg.solve(
                _damped(normal + of_frames, damping), gradient + pull
            )
            moves = np.array([one[:, -1] - one[:, :-1] @ step for one in follow])
            trial = problem.inside(shared + step, own + moves)

            cost = problem.total(*trial)
            if cost <= before or damping > MOST_DAMPING:
                break

            damping = max(10.0 * damping, RETRY_DAMPING)

        if cost <= before:
            shared, own = trial
            damping = max(damping / 10.0, LEAST_DAMPING)

        if number > max(SIZED_ROUNDS) and before - cost < SETTLED:
            break

    seen = [
        problem.compare_frame(frame, shared, one)
        for frame, one in zip(problem.frames, own, strict=True)
    ]
    precision = problem.prior(shared)[1] + _eliminated(seen, len(shared), 0.0)[0]
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    # never beyond the prior's
    wider = min(
        WIDER, problem.sd[MODULUS] / float(np.sqrt(covariance[MODULUS, MODULUS]))
    )
    covariance[MODULUS] *= wider
    covariance[:, MODULUS] *= wider
    each = [
        problem.unknown(frame, shared, one)
        for frame, one in zip(problem.frames, own, strict=True)
    ]
    forces_n, _ = problem.forces_volumes(np.array(each))
    sizes = problem.noise, problem.resting_m, problem.growing_m

    return JointFit(
        shared, covariance, own, *sizes, problem.total(shared, own), forces_n
    )


def _damped(normal: Floats, damping: float) -> Floats:
    return normal + damping * np.diag(np.diag(normal))
