"""The fit of one dent to several B-scans of one moment: a cross of two planes, or a few
parallel ones.

All planes cut the same wall, under one force. The unknowns are the first plane's
(`fit.unknowns`), its tilt against the needle axis, and for each further plane its
own offset in depth (planes follow one another), inner offset, shine and form. What
another plane shows follows from its place beside the first one: its gap, lateral place,
rotation and tilt are the first one's, turned by the angle between them. So no gap has
to be known: gaps have a sign, and a plane that crosses another one sees its gap as a
lateral place; of parallel planes the differences of the gaps are known.

Every plane adds its normal equations (`compiled_fit.fit_plane`), mapped to these
unknowns. The search starts from the fit to each plane alone, with the needle on either
side of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.fit import compiled_fit, unknowns
from scleraforce.fit.compiled_fit import TO_THE_END
from scleraforce.fit.compiled_search import PriorArrays
from scleraforce.fit.least_squares import (
    NormalEquations,
    StoppingRule,
    covariance_of,
    gauss_newton,
)
from scleraforce.fit.one_frame import (
    BoundaryFit,
    doubt_of,
    empty_fit,
    fit_boundaries,
    fit_of,
    law_of,
)
from scleraforce.fit.prior_of_an_eye import FREE_SD, Prior
from scleraforce.library.wall_responses import Library

TILT = len(unknowns.NAMES)  # place of the tilt's tangent, after the unknowns of a plane
# of each further plane; depth: beside
OWN = [
    unknowns.DEPTH,
    unknowns.INNER_OFFSET,
    unknowns.SHINE,
    *range(unknowns.FORM.start, unknowns.FORM.stop),
]
DEPTH_SD_M = 20e-6  # by which an eye moves between two planes
FARTHEST_SD_M = 1e-3  # of the contact from the scanner's axis, either way
STARTS = 3
# least singular value of directions that tell a lean: two 42 degrees apart
LEAST_CROSSING = 0.5
STOPPING = StoppingRule(
    iterations=25, converged_sd=0.02, settled_cost=0.002, retry_damping=1e-2
)


@dataclass(frozen=True, eq=False)
class SeenPlane:
    """A plane and the boundaries that it shows.

    The plane lies `offset_m` from the scanner's axis, along its normal; its lateral
    axis lies `direction_rad` from the scanner's x axis, turned as
    `mechanics.contact_and_section.ScanPlane`'s. `lateral_m` and `depth_bc` are as in
    `fit_boundaries`; `prior` is that of the plane alone, its gap unknown. `gap_sd_m`:
    of the needle's axis about the plane, if a shaft is seen in it.
    """

    offset_m: float
    direction_rad: float
    lateral_m: Floats
    depth_bc: Floats
    prior: Prior
    gap_sd_m: float | None = None


@dataclass(frozen=True)
class SpatialPlace:
    """The place where the needle pushes, and how the wall lies there, with standard
    deviations.

    `contact_m` (3,): x and y from the scanner's axis, and depth below the frames' top:
    of the contact at rest without pressure, plus the dent, or as `at_depth` has it;
    `tilt_rad` (2,): between the scanner's axis and the wall's normal, which leans
    towards growing x and y on its way up where these are positive. `lean_rad`: between
    that normal and the needle, if two planes that cross show its shaft.
    """

    contact_m: tuple[float, ...]
    contact_sd_m: tuple[float, ...]
    tilt_rad: tuple[float, ...]
    tilt_sd_rad: tuple[float, ...]
    lean_rad: float | None = None

    def at_depth(self, depth_m: float, sd_m: float) -> "SpatialPlace":
        """Return the place with the contact at a depth."""
        x_m, y_m, _ = self.contact_m
        x_sd_m, y_sd_m, _ = self.contact_sd_m
        return replace(
            self, contact_m=(x_m, y_m, depth_m), contact_sd_m=(x_sd_m, y_sd_m, sd_m)
        )

    def with_shafts(
        self, directions_rad: Sequence[float], angles_rad: Sequence[float]
    ) -> "SpatialPlace":
        """Return the place with the lean of a needle whose shaft is seen at angles,
        towards growing columns, in planes.

        >>> origin = (0.0, 0.0, 0.0)
        >>> upright = SpatialPlace(origin, origin, (0.0, 0.1), (0.0, 0.0))
        >>> round(upright.with_shafts([0.0, np.pi / 2], [0.0, 0.3]).lean_rad, 6)
        0.2
        """
        axes = np.stack([np.cos(directions_rad), np.sin(directions_rad)], axis=1)
        if len(axes) < 2 or np.linalg.svd(axes, compute_uv=False)[1] < LEAST_CROSSING:
            return self

        beside = np.tan(angles_rad) - axes @ np.tan(self.tilt_rad)
        shaft = np.array(
            [*np.linalg.lstsq(axes, beside, rcond=None)[0] + np.tan(self.tilt_rad), 1.0]
        )
        normal = np.array([*np.tan(self.tilt_rad), 1.0])
        cosine = shaft @ normal / np.linalg.norm(shaft) / np.linalg.norm(normal)

        return replace(self, lean_rad=float(np.arccos(min(cosine, 1.0))))


def plane_map(first: SeenPlane, other: SeenPlane) -> tuple[Floats, Floats]:
    """Return matrix (unknown + 1, unknown + 1) and shift that give a plane's unknowns
    and tilt for the first one's.
    """
    turn = other.direction_rad - first.direction_rad
    c = np.cos(turn)
    s = np.sin(turn)
    matrix = np.eye(TILT + 1)
    shift = np.zeros(TILT + 1)

    for along, across in (
        (unknowns.ROTATION, TILT),
        (unknowns.POLE.start, unknowns.POLE.start + 1),
    ):
        matrix[np.ix_([along, across], [along, across])] = [[c, s], [-s, c]]

    matrix[
        np.ix_([unknowns.LATERAL, unknowns.GAP], [unknowns.LATERAL, unknowns.GAP])
    ] = [[c, -s], [s, c]]
    shift[unknowns.LATERAL] = s * first.offset_m
    shift[unknowns.GAP] = other.offset_m - c * first.offset_m
    return matrix, shift


def contact_place(plane: SeenPlane, unknown: Floats) -> Floats:
    """Return where the contact lies about the scanner's axis: x, y, m."""
    c = np.cos(plane.direction_rad)
    s = np.sin(plane.direction_rad)
    along = unknown[unknowns.LATERAL]
    across = plane.offset_m - unknown[unknowns.GAP]
    return np.array([c * along - s * across, s * along + c * across])


@dataclass(frozen=True, eq=False)
class _PlanesProblem:
    """The least-squares problem of several planes; `maps`: matrix and shift of each
    plane's unknowns and tilt.
    """

    library: Library
    planes: Sequence[SeenPlane]
    smoothing_m: float
    beliefs: Sequence[PriorArrays]
    maps: Sequence[tuple[Floats, Floats]]

    @classmethod
    def of(
        cls, library: Library, planes: Sequence[SeenPlane], smoothing_m: float
    ) -> "_PlanesProblem":
        """The problem."""
        count = TILT + 1 + len(OWN) * (len(planes) - 1)
        maps = []
        beliefs = []

        for number, plane in enumerate(planes):
            prior = plane.prior
            matrix, shift = plane_map(planes[0], plane)
            mapped = np.zeros((TILT + 1, count))
            mapped[:, : TILT + 1] = matrix
            precision = prior.precision.copy()
            calibrated = prior.calibrated
            mean = prior.mean.copy()
            sd = prior.sd.copy()
            mean[unknowns.GAP] = plane.offset_m
            sd[unknowns.GAP] = FARTHEST_SD_M

            if plane.gap_sd_m is not None:
                mean[unknowns.GAP] = 0.0
                sd[unknowns.GAP] = plane.gap_sd_m

            precision[unknowns.GAP, unknowns.GAP] = sd[unknowns.GAP] ** -2.0
            if number:  # all else is the first plane's
                first = TILT + 1 + len(OWN) * (number - 1)
                mapped[OWN[1:], OWN[1:]] = 0.0
                mapped[OWN, range(first, first + len(OWN))] = 1.0
                held = np.zeros(len(unknowns.NAMES))
                held[OWN[1:]] = np.diag(precision)[OWN[1:]]
                held[unknowns.GAP] = precision[unknowns.GAP, unknowns.GAP] * (
                    plane.gap_sd_m is not None
                )
                precision = np.diag(held)
                calibrated = np.zeros((2, 2))

            maps.append((mapped, shift))
            beliefs.append(
                PriorArrays(
                    mean,
                    sd,
                    precision,
                    prior.same_force * (not number),
                    calibrated,
                    prior.wall_sd_m,
                )
            )

        return cls(library, planes, smoothing_m, beliefs, maps)

    def of_plane(self, number: int, unknown: Floats) -> tuple[Floats, float]:
        """Return a plane's unknowns and its tilt."""
        matrix, shift = self.maps[number]
        found = matrix @ unknown + shift
        return found[:TILT].copy(), float(found[TILT])

    def terms(
        self, unknown: Floats, scales: Sequence[float]
    ) -> tuple[NormalEquations, float]:
        """Return the normal equations and the cost; the columns' SDs of a plane count
        `scales` times.
        """
        count = len(unknown)
        cost = 0.0
        normal = np.zeros((count, count))
        gradient = np.zeros(count)
        misfits = list[float]()

        for number, scale in enumerate(scales):
            own = np.empty((TILT + 1, TILT + 1))
            own_gradient = np.empty(TILT + 1)
            matrix = self.maps[number][0]
            fitted = empty_fit(self.library)
            fitted.unknown[:], tilt = self.of_plane(number, unknown)
            cost += self._look(number, tilt, scale, own, own_gradient, fitted)
            normal += matrix.T @ own @ matrix
            gradient += matrix.T @ own_gradient
            misfits.append(float(fitted.numbers[3]))

        for place, sd in (
            (TILT, FREE_SD[unknowns.ROTATION]),
            *((place, DEPTH_SD_M) for place in self._depths),
        ):
            normal[place, place] += sd**-2.0
            gradient[place] -= unknown[place] / sd**2
            cost += float((unknown[place] / sd) ** 2)

        return NormalEquations(normal, gradient, tuple(misfits)), cost

    @property
    def _depths(self) -> range:
        return range(TILT + 1, TILT + 1 + len(OWN) * (len(self.planes) - 1), len(OWN))

    def _look(
        self,
        number: int,
        tilt: float,
        scale: float,
        normal: Floats,
        gradient: Floats,
        fitted: compiled_fit.FitArrays,
    ) -> float:
        """Write a plane's normal equations, or its fit (`compiled_fit.fit_plane`);
        return its cost.
        """
        plane = self.planes[number]
        prior = self.planes[number].prior
        return compiled_fit.fit_plane(
            self.library.tables,
            law_of(prior.globe),
            plane.lateral_m,
            plane.depth_bc,
            self.smoothing_m,
            self.beliefs[number],
            doubt_of(prior),
            tilt,
            scale,
            normal,
            gradient,
            fitted,
        )

    def evaluate(self, unknown: Floats) -> tuple[NormalEquations, float]:
        """Return the normal equations and the cost."""
        return self.terms(unknown, [1.0] * len(self.planes))

    def inside(self, unknown: Floats) -> Floats:
        """Return unknowns that the library has."""
        for number in range(len(self.planes)):
            own, _ = self.of_plane(number, unknown)
            compiled_fit.into_library(self.library.tables, own)

            if number:
                unknown[self._depths[number - 1] + 1 :][: len(OWN) - 1] = own[OWN[1:]]
            else:
                unknown[:TILT] = own

        return unknown

    def starts(self, alone: Sequence[BoundaryFit]) -> list[Floats]:
        """Return starts: each plane's own fit, with the needle on either side, and
        where the lateral places meet.
        """
        axes = [
            (np.cos(plane.direction_rad), np.sin(plane.direction_rad))
            for plane in self.planes
        ]
        weights = np.array([1.0 / (fit.sd[unknowns.LATERAL] + 1e-6) for fit in alone])
        design = np.concatenate(
            [np.array(axes) * weights[:, None], np.eye(2) / FARTHEST_SD_M]
        )
        wanted = np.concatenate(
            [[fit.unknown[unknowns.LATERAL] for fit in alone] * weights, np.zeros(2)]
        )
        meeting = np.linalg.lstsq(design, wanted, rcond=None)[0]
        turned = np.linalg.lstsq(
            np.concatenate([axes, 0.1 * np.eye(2)]),
            np.array([*(fit.unknown[unknowns.ROTATION] for fit in alone), 0.0, 0.0]),
            rcond=None,
        )[0]
        found = list[Floats]()

        for fit, plane in zip(alone, self.planes, strict=True):
            sides = [fit.unknown.copy(), fit.unknown.copy()]
            sides[1][unknowns.GAP] *= -1.0
            places = (meeting, *(contact_place(plane, side) for side in sides))
            found += [self._start(alone, fit, place, turned) for place in places]

        return found

    def _start(
        self,
        alone: Sequence[BoundaryFit],
        fit: BoundaryFit,
        place: Floats,
        turned: Floats,
    ) -> Floats:
        first = self.planes[0]
        start = np.zeros(self.maps[0][0].shape[1])
        c = np.cos(first.direction_rad)
        s = np.sin(first.direction_rad)
        start[:TILT] = fit.unknown
        start[unknowns.POLE] = self.planes[0].prior.mean[unknowns.POLE]
        start[[unknowns.LATERAL, unknowns.ROTATION]] = (
            c * place[0] + s * place[1],
            c * turned[0] + s * turned[1],
        )
        start[[unknowns.GAP, TILT]] = (
            first.offset_m + s * place[0] - c * place[1],
            -s * turned[0] + c * turned[1],
        )

        for number, own in enumerate(alone):
            if number:
                start[self._depths[number - 1] + 1 :][: len(OWN) - 1] = own.unknown[
                    OWN[1:]
                ]
            else:
                start[OWN] = own.unknown[OWN]

        return self.inside(start)

    def begun(self, fits: Sequence[BoundaryFit], place: SpatialPlace) -> Floats:
        """Return the start at a fit with other priors, with the modulus of this one."""
        start = self._start(
            fits, fits[0], np.array(place.contact_m[:2]), np.array(place.tilt_rad)
        )
        start[unknowns.POLE] = fits[0].unknown[unknowns.POLE]
        start[unknowns.MODULUS] = self.beliefs[0].mean[unknowns.MODULUS]
        start[self._depths] = [
            fit.unknown[unknowns.DEPTH] - fits[0].unknown[unknowns.DEPTH]
            for fit in fits[1:]
        ]

        return self.inside(start)

    def conclude(
        self, unknown: Floats, terms: NormalEquations
    ) -> tuple[tuple[BoundaryFit, ...], SpatialPlace]:
        """Return the fit with its uncertainty."""
        least = (
            1.0
            if any(plane.prior.wall_sd_m for plane in self.planes)
            else compiled_fit.LEAST_NOISE
        )
        scales = [
            min(max(misfit, least), compiled_fit.MOST_NOISE) for misfit in terms.misfits
        ]
        normal = self.terms(unknown, scales)[0].normal
        covariance = covariance_of(normal)
        found = list[BoundaryFit]()

        for number, plane in enumerate(self.planes):
            matrix = self.maps[number][0][:TILT]
            fitted = empty_fit(self.library)
            fitted.unknown[:], tilt = self.of_plane(number, unknown)
            own = plane.prior.sd
            size, ways = np.linalg.eigh(
                matrix @ covariance @ matrix.T / np.outer(own, own)
            )
            fitted.spread[:] = np.sqrt(np.maximum(size, 0.0))[:, None] * ways.T * own
            self._look(number, tilt, 1.0, np.empty((0, 0)), np.empty(0), fitted)
            fit = fit_of(self.library, plane.prior.globe, fitted)

            if found:
                shared = {
                    name: getattr(found[0], name)
                    for name in ("force_n", "interval_n", "draws_n")
                }
                fit = replace(fit, **shared)

            found.append(fit)

        return tuple(found), self._place(unknown, covariance)

    def _place(self, unknown: Floats, covariance: Floats) -> SpatialPlace:
        first = self.planes[0]
        ways = np.zeros((5, len(unknown)))
        c = np.cos(first.direction_rad)
        s = np.sin(first.direction_rad)
        turned = np.array([[c, -s], [s, c]])
        ways[:2, [unknowns.LATERAL, unknowns.GAP]] = turned * [1.0, -1.0]
        ways[2, [unknowns.DEPTH, unknowns.TIP]] = 1.0
        ways[3:, [unknowns.ROTATION, TILT]] = turned
        values = ways @ unknown
        values[:2] += turned[:, 1] * first.offset_m
        sds = np.sqrt(np.diag(ways @ covariance @ ways.T))

        return SpatialPlace(
            tuple(values[:3]), tuple(sds[:3]), tuple(values[3:]), tuple(sds[3:])
        )


@dataclass(frozen=True, eq=False)
class PlanesFit:
    """The fit to several planes of one moment, as `fit_planes` returns it."""

    planes: tuple[SeenPlane, ...]
    fits: tuple[BoundaryFit, ...]
    place: SpatialPlace

    @property
    def whole(self) -> BoundaryFit:
        """The first plane's fit, with the worst misfit and the mean loss of all."""
        misfit_m = max(fit.misfit_m for fit in self.fits)
        loss = float(np.mean([fit.loss for fit in self.fits]))
        return replace(self.fits[0], misfit_m=misfit_m, loss=loss)

    def with_priors(
        self, library: Library, priors: Sequence[Prior], smoothing_m: float
    ) -> "PlanesFit":
        """Return the fit with other priors, which starts from this one and goes to the
        end.
        """
        planes = tuple(
            replace(plane, prior=prior)
            for plane, prior in zip(self.planes, priors, strict=True)
        )
        problem = _PlanesProblem.of(library, planes, smoothing_m)
        unknown, terms, _ = gauss_newton(
            problem, problem.begun(self.fits, self.place), TO_THE_END
        )

        return PlanesFit(planes, *problem.conclude(unknown, terms))


def fit_planes(
    library: Library, planes: Sequence[SeenPlane], smoothing_m: float = 0.0
) -> tuple[tuple[BoundaryFit, ...], SpatialPlace | None]:
    """Fit the library to the boundaries of several planes of one moment.

    Return the fit as each plane shows it, with one force and distribution, and the
    contact's place, None of a single plane. There are no fits if a plane shows too few
    columns. The gap among a plane's unknowns has a sign: above 0, the plane lies
    towards its normal from the needle's axis.
    """
    fits = [
        fit_boundaries(
            library, plane.lateral_m, plane.depth_bc, plane.prior, smoothing_m
        )
        for plane in planes
    ]
    alone = [fit for fit in fits if fit is not None]
    if len(alone) < len(planes):
        return (), None
    if len(planes) == 1:
        return tuple(alone), None

    problem = _PlanesProblem.of(library, planes, smoothing_m)
    starts = problem.starts(alone)
    costs = [problem.evaluate(start)[1] for start in starts]
    order = np.argsort(costs)[:STARTS].tolist()
    ended = [gauss_newton(problem, starts[number], STOPPING) for number in order]
    unknown, terms, _ = min(ended, key=lambda each: each[2])

    return problem.conclude(unknown, terms)
