"""One wall of the library for all frames of an eye: the stiffness of an eye from the
shape of its dents, from known forces, or both.

How a dent spreads depends on the pressure over E, and how deep it is on the force over
E. Each frame has its own dent, pose, reflection and pressure; the eye's unknowns are
shared. The frames' normal equations add up, and the prior counts once.

From shape (`fit_shape`) all frames share E, IOP, thickness, gap, size, inner offset,
form and pole. Walls that are not even bend otherwise than the library's, alike in all
frames of a contact. That discrepancy is a Gaussian process along the section and over
the depth of the dent (Kennedy and O'Hagan, J. R. Stat. Soc. B 63, 2001), an unknown of
the same fit: more frames do not make sure what none of them tells. Its sizes have the
largest marginal likelihood; they are at least as large as even walls in three
dimensions need.

From forces (`fit_forces`) the frames share E, the rigidity of the globe, and what is
sought beside them; poses, forms and pressures are each frame's own. What is declared of
the eye, and the library's forces, are taken for right: E makes up for their errors, and
`JointFit.declared` says by how much.

Beside the pictures, a frame may have the needle's travel (dent + force x the bed's
compliance + a shift, both unknown), a pressure of its own (a known change of the IOP),
or a known force, which is off the library's by a level and a growth with the force that
all frames share (`records.eye.ForceDiscrepancy`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from math import hypot, log
from types import MappingProxyType

import numpy as np

from scleraforce.base.arrays import Floats, Places
from scleraforce.base.normal_distribution import robust_spread
from scleraforce.fit import unknowns
from scleraforce.fit.compiled_fit import COLUMNS, CORRELATED_M, INNER_SD_M, OUTER_SD_M
from scleraforce.fit.compiled_search import HEAVY_CAUCHY, HIGHEST_POLE, MOVING
from scleraforce.fit.curve_placement import PlacedCurves, PlacesOnFrame
from scleraforce.fit.least_squares import (
    NormalEquations,
    StoppingRule,
    WallColumns,
    cauchy_loss,
    cauchy_weight,
    covariance_of,
    damped_step,
    gauss_newton,
)
from scleraforce.fit.one_frame import law_of, library_walls
from scleraforce.fit.prior_of_an_eye import HEAVY, prior_of
from scleraforce.fit.shown_wall import LEAST_SD, WallDepths, predict_depths
from scleraforce.library.wall_responses import Library
from scleraforce.records.eye import GROWTH_SCALE, LEVEL_SCALE, beside_middle
from scleraforce.records.setup import Setup
from scleraforce.records.study import ReaderStudy

# what a frame has of its own where E is from shape, and what an eye's frames share
_OWN_SHAPE = (
    unknowns.TIP,
    unknowns.LATERAL,
    unknowns.DEPTH,
    unknowns.ROTATION,
    unknowns.SHINE,
    unknowns.PRESSURE,
)
_SHARED_SHAPE = tuple(
    name for name in range(len(unknowns.NAMES)) if name not in _OWN_SHAPE
)
# Further unknowns of an eye: the logarithm of the bed's compliance, m/N, the travel's
# shift, m, the rigidity over the globe's mean, and level and growth of its forces.
COMPLIANCE, SHIFT, RIGIDITY, LEVEL, GROWTH = range(5)
EXTRA_MEAN = np.array([log(1 / 60.0), 0.0, 1.0, 0.0, 0.0])
EXTRA_SD = np.array([1.0, 1e-3, 1e-3, LEVEL_SCALE, GROWTH_SCALE])
# what is declared of an eye: an error of it is the same in all frames
_DECLARED = (
    unknowns.GAP,
    unknowns.THICKNESS,
    unknowns.IOP,
    unknowns.SIZE,
    *range(unknowns.POLE.start, unknowns.POLE.stop),
)
LARGEST_DISCREPANCY = 3.0  # of level and growth
TRAVEL_SD_M = 10e-6  # standard deviation of a travel
TIP_SD = 0.01  # its share for the library's dent
LEAST_FORCE_SD = 0.01  # relative, of a known force
# standard deviations of what is taken for right, over those that it has
CERTAIN = 0.05
# of the thickness that pictures of an eye show at the needle: 8 um, and 5 um too thin,
# of 40 sealed eyes (`python -m figures posterior`)
SHOWN_THICKNESS_SD_M = 10e-6
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
WEIGHTS = 2 * len(KNOTS) * len(KNOT_TIPS_M)  # of the discrepancy
LEAST_SIZE_M = 0.3e-6  # of a part that differs between depths of dents
RESTING_SIZES_M = np.array([1e-6, 2e-6, 4e-6, 8e-6, 16e-6])
GROWING_SIZES_M = np.array([4e-6, 8e-6, 16e-6, 32e-6])
LEAST_NOISE = 0.8  # of the boundaries over their SDs
# Of the standard deviation of ln E: rms of its errors over it, of 12 virtual eyes in
# three dimensions, a half of them uneven, each with and without travel
# (benchmarks/README.md).
WIDER = 1.4
STOPPING = StoppingRule(
    iterations=30, converged_sd=0.02, settled_cost=2e-3, retry_damping=1e-2
)
SIZINGS = 6  # of noise and discrepancy at most, each followed by a fit
SAME_NOISE = 0.01  # relative
FARTHEST = 8.0  # standard deviations that unknowns may leave their prior by
EXTRA_STEP = 1e-5
LEAST_N = 1e-6
LEAST_PA = 1.0
TINY = 1e-12  # of a rise of the level
START_ROUNDS = 3
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


@dataclass(frozen=True, eq=False, kw_only=True)
class EyeToFit:
    """Frames of one eye that are to be fitted at once.

    Attributes:
        library: that of the eye's contact.
        frames: their forces are known or not.
        setup: the eye, its modulus the prior.
        trained: ranges of what is not declared.
        smoothing_m: as in `one_frame.fit_boundaries`.
        begun_fn: unknowns of fits to the single frames (frame, unknown).
    """

    library: Library
    frames: Sequence[ShownFrame]
    setup: Setup
    trained: ReaderStudy
    smoothing_m: float
    begun_fn: Floats


@dataclass(frozen=True, kw_only=True)
class DeclaredErrors:
    """How far ln E is off by the errors of what was taken for right.

    `others_sd`: its standard deviation by all of them but the thickness, `by_thickness`
    (1/m) its slope by that, and `thickness_sd_m` the standard deviation of the declared
    one.
    """

    others_sd: float
    by_thickness: float
    thickness_sd_m: float

    def log_modulus_sd(self, shown_off_m: float | None) -> float:
        """Return the standard deviation of ln E; `shown_off_m`: by how much pictures
        show another thickness than the declared one, None where they do not show it.

        A wall is not equally thick everywhere, and pictures show it at the needle.
        """
        off_m = (
            self.thickness_sd_m
            if shown_off_m is None
            else hypot(shown_off_m, SHOWN_THICKNESS_SD_M)
        )
        return hypot(self.others_sd, self.by_thickness * off_m)


@dataclass(frozen=True, eq=False, kw_only=True)
class JointFit:
    """The fit to all frames of an eye.

    `names` are the places in `unknowns.NAMES` of the shared unknowns. `shared` begins
    with them; then follow `COMPLIANCE` to `GROWTH`, then the weights of the
    discrepancy, if it is sought. `covariance` is theirs. `unknown_fn` (frame, unknown)
    are the unknowns of each frame in the order of `NAMES`. `noise` is that of the
    boundaries over their SDs, `resting_m` and `growing_m` are sizes of the discrepancy:
    of any dent, and of one of 2 mm. `cost` is that of boundaries and prior, `forces_n`
    (frame,) are the frames' forces. `declared`: the errors of what was taken for right;
    None: nothing was.
    """

    names: tuple[int, ...]
    shared: Floats
    covariance: Floats
    unknown_fn: Floats
    noise: float
    resting_m: float
    growing_m: float
    cost: float
    forces_n: Floats
    declared: DeclaredErrors | None = None

    def moments(self, name: int) -> tuple[float, float]:
        """Return mean and standard deviation of a shared unknown (`unknowns.NAMES`)."""
        place = self.names.index(name)
        return float(self.shared[place]), float(np.sqrt(self.covariance[place, place]))

    @property
    def log_modulus(self) -> tuple[float, float]:
        """Mean and standard deviation of the logarithm of E in Pa."""
        return self.moments(unknowns.MODULUS)

    @property
    def stiffness(self) -> tuple[Floats, Floats]:
        """Mean (2,) and covariance (2, 2) of ln E and of the rigidity over the globe's
        mean.
        """
        places = [self.names.index(unknowns.MODULUS), len(self.names) + RIGIDITY]
        return self.shared[places], self.covariance[np.ix_(places, places)]


class _FrameOfEye:
    """A frame's columns (column,), outer ones first, with a workspace; how far its
    unknowns (unknown,) are known to be from the eye's, `beside_eye`.
    """

    def __init__(
        self, shown: ShownFrame, log_iop: float, gap_m: float, smoothing_m: float
    ) -> None:
        self.shown = shown
        self.beside_eye = np.zeros(len(unknowns.NAMES))
        self.beside_eye[[unknowns.IOP, unknowns.GAP]] = log_iop, gap_m
        seen = np.isfinite(shown.depth_bc)
        lateral_m = shown.lateral_m
        ends = lateral_m[seen[0]][[0, -1]] + EDGE_M * np.array([1.0, -1.0])
        inside = (lateral_m > ends[0]) & (lateral_m < ends[1])
        inside[
            np.arange(len(inside)) % (COARSER * max(1, -(-len(lateral_m) // COLUMNS)))
            > 0
        ] = False
        boundary, column = np.nonzero(seen & inside)
        places = PlacesOnFrame(lateral_m[column], boundary, smoothing_m)
        apart_m = float(np.median(np.diff(places.lateral_m[: places.outer])))
        self.columns = WallColumns(
            places,
            shown.depth_bc[boundary, column],
            np.where(boundary == 1, INNER_SD_M, OUTER_SD_M),
            max(1.0, CORRELATED_M / apart_m),
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


class _EyeProblem:
    """The least-squares problem of an eye's frames.

    Unknown: the shared ones (`JointFit.shared`), then each frame's own. `noise` and the
    discrepancy's sizes stay while it is solved; `resize` finds them anew. `sds`: of the
    priors of some unknowns (`unknowns.NAMES`), in place of the usual ones. `certain`:
    the standard deviations of what is declared, and of the library's forces, over those
    that they have, `known_sd` (unknown,).
    """

    def __init__(
        self,
        eye: EyeToFit,
        names: tuple[int, ...],
        is_discrepancy_sought: bool,
        sds: Mapping[int, float] = MappingProxyType({}),
        certain: float = 1.0,
    ) -> None:
        frames = eye.frames
        setup = eye.setup
        prior = prior_of(setup, eye.trained, eye.library.radius_m)
        extra_sd = EXTRA_SD.copy()
        self.known_sd = prior.sd.copy()
        prior.sd[list(_DECLARED)] *= certain
        extra_sd[[LEVEL, GROWTH]] *= certain
        for name, sd in sds.items():
            prior.sd[name] = sd

        self.library = eye.library
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
            _FrameOfEye(*of_frame, eye.smoothing_m)
            for of_frame in zip(frames, logs, gaps_m, strict=True)
        ]
        self.shared_names = names
        self.own_names = tuple(
            name for name in range(len(unknowns.NAMES)) if name not in names
        )
        self.extras = slice(len(names), len(names) + len(EXTRA_MEAN))
        weights = np.zeros(WEIGHTS if is_discrepancy_sought else 0)
        self.weights = slice(self.extras.stop, self.extras.stop + len(weights))
        shared = np.array(names)
        own = np.array(self.own_names)
        self.mean = np.concatenate(
            [
                prior.mean[shared],
                EXTRA_MEAN,
                weights,
                np.tile(prior.mean[own], len(frames)),
            ]
        )
        self.sd = np.concatenate(
            [
                prior.sd[shared],
                extra_sd,
                weights + np.inf,  # their precision is that of the sizes
                np.tile(prior.sd[own], len(frames)),
            ]
        )
        if setup.eye.modulus is not None:
            # E has these moments, and its logarithm is normal
            variance = float(np.log1p(setup.eye.modulus.relative_sd**2))
            place = names.index(unknowns.MODULUS)
            self.mean[place] = log(setup.eye.modulus.mean_pa) - 0.5 * variance
            self.sd[place] = np.sqrt(variance)

        if not self.law.is_open:
            self.sd[self.extras][RIGIDITY] = prior.globe.sd / prior.globe.mean

        heavy = [self.places(name) for name in HEAVY]
        if unknowns.THICKNESS in names:
            heavy.append(self.places(unknowns.THICKNESS))
        if not is_discrepancy_sought:
            heavy.append(self.extras.start + np.array([LEVEL, GROWTH]))
        self.heavy = np.concatenate(heavy)
        self.noise = 1.0
        self.precision = np.diag(self.sd**-2.0)
        self._set_bounds()
        self.set_sizes(float(RESTING_SIZES_M[1]), float(GROWING_SIZES_M[0]))

    def _set_bounds(self) -> None:
        """Set the bounds of the unknowns (unknown,), for walls that can be cut."""
        self.low = self.mean - FARTHEST * self.sd
        self.high = self.mean + FARTHEST * self.sd
        for number, name in enumerate(range(unknowns.FORM.start, unknowns.FORM.stop)):
            places = self.places(name)
            least, most = unknowns.FORM_ENDS[:, number]
            self.low[places] = np.maximum(self.low[places], least)
            self.high[places] = np.minimum(self.high[places], most)

        tips = self.places(unknowns.TIP)
        self.low[tips] = 0.0
        self.high[tips] = np.inf  # as far as the library reaches, see `inside`
        self.low[self.extras][LEVEL:] = -LARGEST_DISCREPANCY
        self.high[self.extras][LEVEL:] = LARGEST_DISCREPANCY
        if not self.law.is_open:
            self.low[self.extras][RIGIDITY] = self.globe.lowest / self.globe.mean
            self.high[self.extras][RIGIDITY] = self.globe.highest / self.globe.mean

    @property
    def count(self) -> int:
        """The number of unknowns."""
        return len(self.mean)

    @property
    def shared_count(self) -> int:
        """The number of unknowns that the frames share."""
        return self.weights.stop

    def places(self, name: int) -> Places:
        """Return where an unknown (`unknowns.NAMES`) is in the fit's: once if it is
        shared, else for each frame.
        """
        if name in self.shared_names:
            return np.array([self.shared_names.index(name)])

        first = self.shared_count + self.own_names.index(name)
        return first + len(self.own_names) * np.arange(len(self.frames))

    def of_frame(self, number: int) -> Places:
        """Return the places of what a frame shows: the shared unknowns and its own."""
        own = self.shared_count + len(self.own_names) * number
        return np.r_[: self.shared_count, own : own + len(self.own_names)]

    def set_sizes(self, resting_m: float, growing_m: float) -> None:
        """Give the discrepancy its sizes."""
        self.resting_m = resting_m
        self.growing_m = growing_m
        if self.weights.stop > self.weights.start:
            precision = _weights_precision(resting_m, growing_m)[0]
            self.precision[self.weights, self.weights] = precision

    def begun(self, unknown_fn: Floats, shared: Floats | None) -> Floats:
        """Return the unknowns at fits of single frames (frame, unknown), and at shared
        ones, by default the prior's.
        """
        begun = self.mean[: self.shared_count] if shared is None else shared
        beside_eye = np.array([frame.beside_eye for frame in self.frames])
        own = (unknown_fn - beside_eye)[:, list(self.own_names)]
        return self.inside(np.concatenate([begun, own.ravel()]))

    def begun_by_forces(self, unknown_fn: Floats) -> Floats:
        """Return the unknowns at fits of single frames (frame, unknown), whose forces
        are known: E, rigidity, and the pressure under the needle are what they tell.
        """
        unknown_fn = unknown_fn.copy()
        force_n = np.array([frame.shown.force_n for frame in self.frames], np.float64)
        unknown = self.begun(unknown_fn, None)
        if not self.law.is_open:
            ratio = self._rigidity_ratio(unknown_fn, force_n)
            unknown[self.extras][RIGIDITY] = ratio
            unknown = self.inside(unknown)

        law = self.globe.pressure_law(
            self.globe.mean * float(unknown[self.extras][RIGIDITY])
        )

        for _ in range(START_ROUNDS):
            forces, volumes = self.forces_volumes(unknown_fn)
            log_ratio = np.log(force_n / np.maximum(forces, LEAST_N))
            unknown_fn[:, unknowns.MODULUS] += float(np.median(log_ratio))
            if not self.law.is_open:
                resting_pa = np.exp(unknown_fn[:, unknowns.IOP])
                pressed_pa = np.maximum(law.pressure(resting_pa, volumes), LEAST_PA)
                unknown_fn[:, unknowns.PRESSURE] = np.log(pressed_pa)

        unknown[self.places(unknowns.MODULUS)] = np.median(
            unknown_fn[:, unknowns.MODULUS]
        )
        unknown[self.places(unknowns.PRESSURE)] = unknown_fn[:, unknowns.PRESSURE]
        return self.inside(unknown)

    def _rigidity_ratio(self, unknown_fn: Floats, force_n: Floats) -> float:
        """Return the rigidity, over the globe's mean, that single frames tell with
        their forces.

        The shape of a dent tells the pressure over E; the force is E times what the
        library has for that dent, and the pressure follows.
        """
        forces, volumes = self.forces_volumes(unknown_fn)
        pressed_pa = (
            np.exp(unknown_fn[:, unknowns.PRESSURE])
            * force_n
            / np.maximum(forces, LEAST_N)
        )
        resting_pa = np.exp(unknown_fn[:, unknowns.IOP])
        globe = self.globe.pressure_law(self.globe.mean)
        risen = globe.level(pressed_pa) - globe.level(resting_pa)
        return float(np.median(risen / np.maximum(globe.rate * volumes, TINY)))

    def named(self, frame: _FrameOfEye, unknown: Floats) -> Floats:
        """Return a frame's unknowns in the order of `NAMES`."""
        found = np.empty(len(unknowns.NAMES))
        found[list(self.shared_names)] = unknown[: len(self.shared_names)]
        found[list(self.own_names)] = unknown[self.shared_count :]
        return found + frame.beside_eye

    def basis(self, frame: _FrameOfEye, unknown: Floats) -> Floats:
        """Return how the weights move the columns (column, weight): linear between
        knots.
        """
        places = frame.columns.places
        along = np.arcsinh((places.lateral_m - unknown[unknowns.LATERAL]) / WARP_M)
        over = np.array([unknown[unknowns.TIP]])
        at_knots = _hats(KNOTS, along)[:, :, None] * _hats(KNOT_TIPS_M, over)
        both = at_knots.reshape(len(along), -1)
        return np.concatenate([both, both * places.is_inner[:, None]], axis=1)

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

    def numbers(
        self, frame: _FrameOfEye, unknown_su: Floats, extra_se: Floats
    ) -> Floats:
        """Return how far law, travel and force are off, in standard deviations (state,
        number); `extra_se` (state, 5): of the eye, `COMPLIANCE` to `GROWTH`.
        """
        shown = frame.shown
        found = list[Floats]()
        if self.law.is_open and shown.travel_m is None and shown.force_n is None:
            return np.empty((len(unknown_su), 0))

        compliance, shift_m, rigidity, level, growth = extra_se.T
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
            sd = max(shown.force_sd_n / shown.force_n, LEAST_FORCE_SD)
            forces = np.maximum(forces, LEAST_N)
            off = level + growth * beside_middle(forces)
            found.append((log(shown.force_n) - np.log(forces) - off) / sd)

        return np.stack(found, axis=1)

    def compare_frame(
        self, frame: _FrameOfEye, unknown: Floats
    ) -> tuple[NormalEquations, float]:
        """Return a frame's part of the normal equations at what it shows (shared and
        own), and of the cost.
        """
        named = self.named(frame, unknown)
        columns = frame.columns
        depths = frame.depths
        extra = unknown[self.extras]
        section = np.empty((2, 2 * len(self.library.node_angles()), 2))
        at = columns.places
        places = at.lateral_m, at.outer, at.smoothing_m
        about = self.about[0] + frame.beside_eye[unknowns.GAP], self.about[1]
        predict_depths(
            self.library.tables, self.law, places, *about, named, depths, section
        )
        weights = unknown[self.weights]
        basis = (
            self.basis(frame, named)
            if len(weights)
            else np.empty((len(at.lateral_m), 0))
        )
        rows = np.concatenate(
            [
                depths.jacobian[:, list(self.shared_names)],
                np.zeros((len(basis), len(extra))),
                basis,
                depths.jacobian[:, list(self.own_names)],
            ],
            axis=1,
        )
        placed = PlacedCurves(
            depths.depth_m + basis @ weights, depths.slope, rows, depths.seen
        )
        normal, gradient = columns.normal_equations(placed, self.noise)
        numbers, by_numbers = self._numbers_and_slopes(frame, named, extra)
        misfit = robust_spread(np.abs(columns.residual(placed)))
        cost = columns.loss(placed) / self.noise**2 + float(numbers @ numbers)

        return (
            NormalEquations(
                normal + by_numbers.T @ by_numbers,
                gradient + by_numbers.T @ numbers,
                (misfit,),
            ),
            cost,
        )

    def _numbers_and_slopes(
        self, frame: _FrameOfEye, named: Floats, extra: Floats
    ) -> tuple[Floats, Floats]:
        """Return a frame's numbers, and the derivatives of what is predicted of them
        (number, shared and own).
        """
        moving = list(MOVING)
        extras = np.arange(len(extra))
        first = 1 + len(moving)
        states_su = np.tile(named, (first + len(extra), 1))
        states_su[1 + np.arange(len(moving)), moving] += STEPS
        extra_se = np.tile(extra, (len(states_su), 1))
        extra_se[first + extras, extras] += EXTRA_STEP
        here, *varied = self.numbers(frame, states_su, extra_se)
        slopes_n = (here - np.array(varied)).T
        by_name = np.zeros((len(here), len(named)))
        by_name[:, moving] = slopes_n[:, : len(moving)] / STEPS
        slopes = [
            by_name[:, list(self.shared_names)],
            slopes_n[:, len(moving) :] / EXTRA_STEP,
            np.zeros((len(here), self.weights.stop - self.weights.start)),
            by_name[:, list(self.own_names)],
        ]

        return here, np.concatenate(slopes, axis=1)

    def prior(self, unknown: Floats) -> tuple[NormalEquations, float]:
        """Return the prior's part of the normal equations, and the cost of leaving
        it.
        """
        away = unknown - self.mean
        off = away[self.heavy] / self.sd[self.heavy]
        normal = self.precision.copy()
        normal[self.heavy, self.heavy] *= cauchy_weight(off, HEAVY_CAUCHY)
        gradient = -normal @ away
        away[self.heavy] = 0.0
        cost = cauchy_loss(off, HEAVY_CAUCHY).sum() + away @ self.precision @ away

        return NormalEquations(normal, gradient, ()), float(cost)

    def evaluate(self, unknown: Floats) -> tuple[NormalEquations, float]:
        """Return the normal equations of all frames with the prior, and the cost."""
        prior, cost = self.prior(unknown)
        misfits = list[float]()

        for number, frame in enumerate(self.frames):
            places = self.of_frame(number)
            of_frame, frame_cost = self.compare_frame(frame, unknown[places])
            prior.normal[np.ix_(places, places)] += of_frame.normal
            prior.gradient[places] += of_frame.gradient
            misfits += of_frame.misfits
            cost += frame_cost

        return NormalEquations(prior.normal, prior.gradient, tuple(misfits)), cost

    def inside(self, unknown: Floats) -> Floats:
        """Return unknowns within the ranges where walls can be cut."""
        unknown = np.clip(unknown, self.low, self.high)
        along, across = (
            self.places(name) for name in range(unknowns.POLE.start, unknowns.POLE.stop)
        )
        sine = np.hypot(unknown[along], unknown[across])
        nearer = HIGHEST_POLE / np.maximum(sine, HIGHEST_POLE)
        unknown[along] *= nearer
        unknown[across] *= nearer
        farthest_m = self.library.tip_m[-1] * np.exp(
            unknown[self.places(unknowns.SIZE)]
        )
        tips = self.places(unknowns.TIP)
        unknown[tips] = np.minimum(unknown[tips], farthest_m)
        return unknown

    def resize(self, unknown: Floats, terms: NormalEquations) -> bool:
        """Find the noise by the columns' misfit, and the discrepancy's sizes by the
        marginal likelihood (Laplace's); return whether they are other ones.
        """
        noise = max(LEAST_NOISE, float(np.median(terms.misfits)))
        at = self.weights
        weights = unknown[at]
        # what all but the prior says of the weights, whatever the other unknowns are
        left = self.eliminated(terms)
        covariance = covariance_of(left.normal)
        information = np.linalg.inv(covariance[at, at])
        pull = information @ (covariance @ left.gradient)[at]
        precision = self.precision[at, at]
        information -= precision
        pull += precision @ weights
        losses = dict[tuple[float, float], float]()

        for sizes in product(RESTING_SIZES_M.tolist(), GROWING_SIZES_M.tolist()):
            precision, log_determinant = _weights_precision(*sizes)
            lower = np.linalg.cholesky(information + precision)
            gained = np.linalg.solve(lower, pull - precision @ weights)
            losses[sizes] = (
                weights @ precision @ weights
                - gained @ gained
                + 2.0 * np.log(np.diag(lower)).sum()
                - log_determinant
            )

        sizes = min(losses, key=losses.__getitem__)
        is_same_noise = abs(noise / self.noise - 1.0) < SAME_NOISE
        if is_same_noise and sizes == (self.resting_m, self.growing_m):
            return False

        self.noise = noise
        self.set_sizes(*sizes)
        return True

    def arrow_step(self, normal: Floats, gradient: Floats, damping: float) -> Floats:
        """Return the step of normal equations, whose matrix is a block arrow: the
        frames' own unknowns are damped and eliminated, then the shared ones are damped
        by what is left of their diagonal.

        Damped by the whole diagonal they creep: what a frame says of E, its own dent
        and pressure say nearly as well.
        """
        left, follow = self._eliminate(normal, gradient, damping)
        shared = damped_step(left.normal, left.gradient, damping)
        own = follow[..., -1] - follow[..., :-1] @ shared
        return np.concatenate([shared, own.ravel()])

    def eliminated(self, terms: NormalEquations) -> NormalEquations:
        """Return the normal equations of the shared unknowns, whatever each frame's own
        ones are.
        """
        return self._eliminate(terms.normal, terms.gradient, 0.0)[0]

    def declared_errors(self, terms: NormalEquations) -> DeclaredErrors:
        """Return how far ln E is off by the errors of what is taken for right: what is
        declared of the eye, and the library's forces.

        The prior of each is moved in all frames, and E follows as the normal equations
        have it.
        """
        others = [
            self._slope_by(terms, self.places(name)) * float(self.known_sd[name])
            for name in _DECLARED
            if name in self.own_names and name != unknowns.THICKNESS
        ]
        others += [
            self._slope_by(terms, np.array([self.extras.start + number]))
            * float(EXTRA_SD[number])
            for number in (LEVEL, GROWTH)
        ]
        thickness = unknowns.THICKNESS
        is_declared = thickness in self.own_names
        return DeclaredErrors(
            others_sd=hypot(*others),
            by_thickness=(
                self._slope_by(terms, self.places(thickness)) if is_declared else 0.0
            ),
            thickness_sd_m=float(self.known_sd[thickness]),
        )

    def _slope_by(self, terms: NormalEquations, places: Places) -> float:
        """Return the slope of ln E by the mean of the priors at these places, which
        move together.
        """
        (modulus,) = self.places(unknowns.MODULUS)
        pull = np.zeros(self.count)
        pull[places] = self.sd[places] ** -2.0
        left, _ = self._eliminate(terms.normal, pull, 0.0)
        return float((covariance_of(left.normal) @ left.gradient)[modulus])

    def _eliminate(
        self, normal: Floats, gradient: Floats, damping: float
    ) -> tuple[NormalEquations, Floats]:
        """Eliminate the frames' own unknowns, damped (Schur's complement).

        Return what is left of the shared ones, and how the own ones (frame, own, shared
        and gradient) follow them.
        """
        shared = self.shared_count
        size = (len(self.frames), len(self.own_names))
        across = normal[shared:, :shared].reshape(*size, shared)
        blocks = normal[shared:, shared:].reshape(*size, *size)
        frame = np.arange(size[0])
        own = blocks[frame, :, frame]
        sd = 1.0 / np.sqrt(np.diagonal(own, axis1=1, axis2=2))
        scaled = own * sd[:, :, None] * sd[:, None] + damping * np.eye(size[1])
        right = np.concatenate([across, gradient[shared:].reshape(*size, 1)], axis=2)
        follow = sd[..., None] * np.linalg.solve(scaled, sd[..., None] * right)
        taken = np.einsum("fos,fok->sk", across, follow)
        left = NormalEquations(
            normal[:shared, :shared] - taken[:, :-1],
            gradient[:shared] - taken[:, -1],
            (),
        )
        return left, follow


@cache
def _weights_precision(resting_m: float, growing_m: float) -> tuple[Floats, float]:
    """Return the inverse covariance of the discrepancy's weights, of both boundaries,
    then of the inner one; and the logarithm of its determinant.
    """
    along = np.exp(-0.5 * ((KNOTS[:, None] - KNOTS) / ALONG) ** 2) + ROUNDING * np.eye(
        len(KNOTS)
    )
    over = np.exp(-0.5 * ((KNOT_TIPS_M[:, None] - KNOT_TIPS_M) / OVER_M) ** 2)
    grown = growing_m * (KNOT_TIPS_M / REFERENCE_M) ** 2
    sizes = (
        resting_m**2
        + np.outer(grown, grown) * over
        + LEAST_SIZE_M**2 * np.eye(len(grown))
    )
    one = np.kron(np.linalg.inv(along), np.linalg.inv(sizes))
    precision = np.asarray(np.kron(np.diag([1.0, INNER_SHARE**-2]), one), np.float64)

    return precision, float(np.linalg.slogdet(precision)[1])


def _hats(knots: Floats, values: Floats) -> Floats:
    """Return the linear interpolation from knots to values (value, knot)."""
    return np.stack(
        [np.interp(values, knots, one) for one in np.eye(len(knots))], axis=1
    )


def _joint_fit(
    problem: _EyeProblem, unknown: Floats, terms: NormalEquations, cost: float
) -> JointFit:
    """Return the fit at the unknowns that were found."""
    named = [
        problem.named(frame, unknown[problem.of_frame(number)])
        for number, frame in enumerate(problem.frames)
    ]
    return JointFit(
        names=problem.shared_names,
        shared=unknown[: problem.shared_count],
        covariance=covariance_of(problem.eliminated(terms).normal),
        unknown_fn=np.array(named),
        noise=problem.noise,
        resting_m=problem.resting_m,
        growing_m=problem.growing_m,
        cost=cost,
        forces_n=problem.forces_volumes(np.array(named))[0],
    )


def fit_shape(eye: EyeToFit, shared: Floats | None = None) -> JointFit:
    """Fit the library to all frames of an eye at once, whatever their forces.

    `shared` is that of an earlier fit, to begin at.
    """
    problem = _EyeProblem(eye, _SHARED_SHAPE, True)
    unknown = problem.begun(eye.begun_fn, shared)
    unknown, terms, cost = gauss_newton(problem, unknown, STOPPING, problem.arrow_step)

    for _ in range(SIZINGS):
        if not problem.resize(unknown, terms):
            break
        unknown, terms, cost = gauss_newton(
            problem, unknown, STOPPING, problem.arrow_step
        )

    fit = _joint_fit(problem, unknown, terms, cost)
    # never beyond the prior's
    place = fit.names.index(unknowns.MODULUS)
    wider = min(WIDER, problem.sd[place] / fit.log_modulus[1])
    fit.covariance[place] *= wider
    fit.covariance[:, place] *= wider
    return fit


def fit_forces(eye: EyeToFit, sought: Mapping[int, float]) -> JointFit:
    """Fit the library to frames that all have known forces: E and the rigidity of the
    globe.

    `sought` are further unknowns that the frames share, places in `unknowns.NAMES`,
    with the standard deviations of their priors. The fit's cost is that with what is
    declared as unsure as it is.
    """
    names = (unknowns.MODULUS, *sought)
    problem = _EyeProblem(eye, names, False, sought, CERTAIN)
    start = problem.begun_by_forces(eye.begun_fn)
    unknown, terms, _ = gauss_newton(problem, start, STOPPING, problem.arrow_step)
    unsure = _EyeProblem(eye, names, False, sought)
    _, _, cost = gauss_newton(unsure, unknown, STOPPING, unsure.arrow_step)
    fit = _joint_fit(problem, unknown, terms, cost)
    return replace(fit, declared=problem.declared_errors(terms))
