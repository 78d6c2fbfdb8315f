"""The force from the wall's boundaries alone: the wall of the response library that
lies best on them.

Least squares with a robust loss (Cauchy's), by a damped Gauss-Newton method. Unknown
are the dent and the pose; thickness, gap, E, IOP and the eye's size are unknown too,
with priors, so that an unknown property widens the force's interval by as much as it
should; so is the rigidity of a globe that may be sealed. The force follows from the
dent: F = E f(dent, wall, pressure under the needle). A frame's fit is one compiled
call, beside which other threads run.

The wall is a surface of revolution about the needle axis. The B-scan plane, parallel to
that axis at a distance of one gap, sees a point of it at the distance r from the axis
at the lateral place sqrt(r² - gap²), to both sides. An eye that is larger by a factor
is the same eye at another length unit: thickness and dent count relative to it, and so
do F/E, by its square, and volumes, by its cube.

What a frame shows is the state at the pressure under the needle. In an open globe that
is the IOP. In one that may be sealed it is an unknown of its own. There level(P) -
level(P0) = k dV (`records.globe`), with P the pressure under the needle. Of a normal
k this says that level(P) is normal about level(P0) + mean(k) dV with the standard
deviation sd(k) dV. So the pressure is fitted, which a frame shows, and not the
rigidity, which it shows only where the dent is deep.

The pole's place, on which the base's motion depends (`library.moving_base`), is an
unknown where it is not given. The form of an eye that is not an even sphere is added at
rest (`fit.unknowns`); how it bends is left out.

`docs/reader.md` gives the sources of the noise and the other constants.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise
from math import inf

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.fit import unknowns
from scleraforce.fit.compiled_fit import (
    OUTER_SD_M,
    FitArrays,
    UncertaintyDraws,
    fit_frame,
)
from scleraforce.fit.compiled_search import PriorArrays
from scleraforce.fit.prior_of_an_eye import Prior, form_size
from scleraforce.fit.shown_wall import GlobeLaw
from scleraforce.library.wall_responses import Library
from scleraforce.records.globe import Globe
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

# Beyond it a surface is not a wall. Virtual eyes reach 9 um, with a cornea in view 13
# um.
NO_WALL_M = 20e-6
DRAWS = 512
HALF_A_DRAW = 0.5  # beyond the last one
LEAST_SCALE_N = 1e-9  # of draws that are all the same
# Frames of even walls lie nearer to an even wall of the library, frames of uneven walls
# farther from it.
LARGEST_MISFIT_M = 6e-6
LARGEST_FORM = 1.0


def library_walls(
    library: Library, unknown_su: Floats, pressure: int
) -> tuple[Floats, Floats, Floats]:
    """Return thickness, pressure over E and tip, each (state,), of unknowns (state,
    unknown), as `library_place`.
    """
    size = np.exp(unknown_su[:, unknowns.SIZE])
    thickness = np.clip(
        unknown_su[:, unknowns.THICKNESS] / size, *library.tables.thickness_ends_m
    )
    ratio = np.exp(unknown_su[:, pressure] - unknown_su[:, unknowns.MODULUS])
    ratio = np.clip(ratio, *library.iop_ratio_ends(thickness))

    return (
        thickness,
        ratio,
        np.clip(unknown_su[:, unknowns.TIP] / size, 0.0, library.tables.tip_m[-1]),
    )


@lru_cache(maxsize=64)
def law_of(globe: Globe) -> GlobeLaw:
    """Return the law of a globe."""
    rates = (
        float(globe.pressure_law(rigidity).rate)
        for rigidity in (globe.lowest, globe.mean, globe.highest, globe.sd)
    )
    sealed = globe.can_be_sealed

    return GlobeLaw(
        unknowns.PRESSURE if sealed else unknowns.IOP,
        not sealed,
        globe.law == RIGIDITY_LAWS[1],
        *rates,
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundaryFit:
    """The wall of the library that lies best on a frame's boundaries.

    `force_n` is the median, `interval_n` holds 90 %; `draws_n` (draw,) are forces drawn
    from the posterior. `contact_m` is the contact's lateral place from the frame's
    middle, `tip_m` its depth of indentation. `misfit_m` is the robust root mean square
    distance from the wall, `outliers` the share of columns farther off than a segmented
    wall ever is, not counting an inner boundary at the end of a layer below the wall.
    `wall_bmc` (boundary, point, 2) is the wall in the frame, m; `unknown` (unknown,)
    are the values in the order of `NAMES`, and `spread` (number, unknown) says how
    standard normal numbers draw about them. `iop_pa` is the pressure in the eye under
    the needle, `tension` that times the eye's radius over E times thickness. `loss` is
    the cost of boundaries and prior, in squares of standard deviations.
    """

    force_n: float
    interval_n: tuple[float, float]
    draws_n: Floats
    contact_m: float
    tip_m: float
    misfit_m: float
    outliers: float
    wall_bmc: Floats
    unknown: Floats
    spread: Floats
    iop_pa: float
    tension: float
    loss: float

    @cached_property
    def sd(self) -> Floats:
        """Standard deviations of the unknowns (unknown,)."""
        return np.asarray(np.sqrt((self.spread**2).sum(axis=0)))

    @property
    def is_uneven(self) -> bool:
        """True if the wall is not an even sphere, by the frame's misfit or the form."""
        return (
            self.misfit_m > LARGEST_MISFIT_M or form_size(self.unknown) > LARGEST_FORM
        )

    def probabilities(
        self, bounds_n: tuple[float, ...], least_n: float = -inf
    ) -> tuple[float, ...]:
        """Return the probability of each class, where no force is below `least_n`.

        No class is ever certain, as the number of draws is finite: half a draw lies
        beyond the last one on either side, and its density falls off from there. So a
        class is never likelier than the one between it and the draws.
        """
        least = self._share_below(least_n)
        below = [0.0]
        above = [1.0]

        for bound_n in bounds_n:
            share = positive_share(self._share_below(bound_n), least)
            below.append(share)
            above.append(self._share_above(bound_n) if share >= 0.5 else 1.0 - share)

        # the difference of the smaller numbers: the other one loses the last digits
        return tuple(
            after - before if after < 0.5 else higher - lower
            for (before, after), (higher, lower) in zip(
                pairwise((*below, 1.0)), pairwise((*above, 0.0)), strict=True
            )
        )

    def _share_below(self, bound_n: float) -> float:
        if (self.draws_n <= bound_n).any():
            return 1.0 - self._share_above(bound_n)

        first_n = float(self.draws_n.min())
        tail = _tail(first_n - bound_n, self.force_n - self.interval_n[0])
        return HALF_A_DRAW / (len(self.draws_n) + 1.0) * tail

    def _share_above(self, bound_n: float) -> float:
        higher = int((self.draws_n > bound_n).sum())
        share = (higher + HALF_A_DRAW) / (len(self.draws_n) + 1.0)
        if higher:
            return share

        last_n = float(self.draws_n.max())
        return share * _tail(bound_n - last_n, self.interval_n[1] - self.force_n)


def _tail(beyond_n: float, scale_n: float) -> float:
    """Return the share of a tail farther than a distance beyond its beginning.

    It falls off as that of Student's t with three degrees of freedom, so that the last
    class has a share above 0 at any distance.
    """
    return (1.0 + beyond_n / max(scale_n, LEAST_SCALE_N)) ** -3.0


def positive_share(share: float, negative: float) -> float:
    """Return the share of a distribution below a force, once the share below 0 is cut
    off; the median stays.

    >>> positive_share(0.375, 0.25)
    0.25
    """
    if not share < 0.5:
        return share
    return 0.5 * (share - negative) / (0.5 - negative)


def fit_boundaries(
    library: Library,
    lateral_m: Floats,
    depth_bc: Floats,
    prior: Prior,
    smoothing_m: float = 0.0,
    borne_n: float | None = None,
    begun: Floats | None = None,
) -> BoundaryFit | None:
    """Fit the library to the boundaries of a frame; None if it shows fewer columns than
    there are unknowns.

    `lateral_m` (column,): places of the frame's columns from its middle. `depth_bc` (2,
    column), m: depth of the outer and the inner boundary below the frame's top, free of
    refraction; NaN where unseen. `smoothing_m`: standard deviation of the Gaussian with
    which the segmentation smooths the outer boundary. `borne_n`: the needle's force, if
    known: one more start in a sealed globe. `begun` (unknown,): the unknowns of another
    fit, which this one starts from alone, and goes to the end: for small changes of the
    prior.
    """
    fitted = empty_fit(library)
    has_fit = fit_frame(
        library.tables,
        law_of(prior.globe),
        np.ascontiguousarray(lateral_m, dtype=np.float64),
        np.ascontiguousarray(depth_bc, dtype=np.float64),
        float(smoothing_m),
        PriorArrays(
            prior.mean,
            prior.sd,
            prior.precision,
            prior.same_force,
            prior.calibrated,
            prior.wall_sd_m,
        ),
        doubt_of(prior),
        np.nan if borne_n is None else float(borne_n),
        np.empty(0) if begun is None else np.ascontiguousarray(begun, dtype=np.float64),
        fitted,
    )

    return fit_of(library, prior.globe, fitted) if has_fit else None


def doubt_of(prior: Prior) -> UncertaintyDraws:
    """Return the numbers that draw an eye's forces."""
    off = prior.discrepancy
    count = len(unknowns.NAMES)
    terms = np.array(
        [
            [off.level, off.level_sd, *off.level_by],
            [off.growth, off.growth_sd, *off.growth_by],
        ]
    )

    return UncertaintyDraws(
        _by_number(count + 2),
        _standard_normal(2, seed=1),
        terms,
        float(off.correlation),
    )


def empty_fit(library: Library) -> FitArrays:
    """Return a fit without values."""
    count = len(unknowns.NAMES)
    wall_bmc = np.empty((2, 2 * len(library.node_angles()), 2))
    return FitArrays(
        np.empty(count),
        np.empty((count, count)),
        np.empty(DRAWS),
        wall_bmc,
        np.empty(6),
    )


def fit_of(library: Library, globe: Globe, fitted: FitArrays) -> BoundaryFit:
    """Return a fit from its arrays."""
    unknown = fitted.unknown
    force, low_n, high_n, misfit, outliers, cost = fitted.numbers.tolist()
    radius_m = library.radius_m * np.exp(unknown[unknowns.SIZE])
    pressure = unknown[law_of(globe).pressure]

    return BoundaryFit(
        force_n=force,
        interval_n=(low_n, high_n),
        draws_n=fitted.draws_n,
        contact_m=float(unknown[unknowns.LATERAL]),
        tip_m=float(unknown[unknowns.TIP]),
        misfit_m=misfit * OUTER_SD_M,
        outliers=outliers,
        wall_bmc=fitted.wall_bmc,
        unknown=unknown,
        spread=fitted.spread,
        iop_pa=float(np.exp(pressure)),
        tension=float(
            np.exp(pressure - unknown[unknowns.MODULUS])
            * radius_m
            / unknown[unknowns.THICKNESS]
        ),
        loss=cost,
    )


@lru_cache(maxsize=4)
def _by_number(size: int) -> Floats:
    """Return the points of `_standard_normal` number by number (size, draw)."""
    return np.ascontiguousarray(_standard_normal(size).T)


@lru_cache(maxsize=4)
def _standard_normal(size: int, seed: int = 0) -> Floats:
    """Return DRAWS points of a standard normal distribution (draw, size), always the
    same, symmetric about 0.
    """
    half = np.random.default_rng(seed).standard_normal((DRAWS // 2, size))
    both = np.concatenate([half, -half])
    return both / both.std(axis=0)
