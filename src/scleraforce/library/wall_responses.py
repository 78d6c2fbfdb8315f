"""The response library: what the needle does to any eye, from stored load paths.

Without gravity, the deformed shape depends on Young's modulus E, force F and pressure
IOP only through F/E ("force ratio", m^2) and IOP/E ("IOP ratio"), for a given
thickness, radius, needle and Poisson's ratio. So paths over thickness and pressure
serve every eye. The axis of the pressure is the tension, p R/(E t), because walls of
every thickness burst at about the same one. A path is stored at given displacements of
the tip, in which it is smooth also where the force falls; a force is turned into a tip
afterwards. Interpolation is a tensor of cubic splines in log thickness, log tension and
tip.

The paths are of a wall of revolution about the needle axis; `library.moving_base` has
the effect of a contact beside the pole.
"""

from collections import OrderedDict
from dataclasses import InitVar, dataclass, field, replace
from functools import cached_property

import numpy as np

from scleraforce.base.arrays import Flags, Floats, Places
from scleraforce.base.errors import InputError
from scleraforce.base.units import from_si
from scleraforce.library import response_splines
from scleraforce.library.moving_base import (
    bulges_of,
    contact_rises,
    meridian_angles,
    rise_slope,
)
from scleraforce.library.range_checks import SLACK, check_inside, inside_ends
from scleraforce.library.response_splines import (
    Curves,
    SplineTables,
    curves_of,
    values_at,
)
from scleraforce.library.sealed_eye import LibraryEye
from scleraforce.library.stiffened_walls import StiffenedWalls
from scleraforce.mechanics.tissue_material import burst_tension
from scleraforce.records.globe import sealed_law
from scleraforce.records.study_of_eye import RIGIDITY_LAWS


def check_arrays(library: "Library") -> None:
    """Raise `InputError`, which names the array, if shapes or values of a library do
    not fit together.
    """
    shape = (len(library.thickness_m), len(library.tension), len(library.tip_m))
    polar_rad = library.polar_rad
    if min(*shape, len(polar_rad)) < response_splines.SUPPORT:
        raise InputError(
            f"library: {shape} thicknesses, tensions, tips and {len(polar_rad)} polar"
            f" angles; must be at least {response_splines.SUPPORT} of each"
        )

    walls = library.walls
    at_pole = (len(library.walls.stiffening), *shape)

    for name, found, wanted in (
        ("force_ratio_btpd", walls.force_ratio_btpd.shape, at_pole),
        ("displaced_btpd", walls.displaced_btpd.shape, at_pole),
        ("stiffness_atpd", library.stiffness_atpd.shape, (len(polar_rad), *shape)),
        (
            "undented_btpbnc",
            walls.undented_btpbnc.shape,
            (*at_pole[:3], 2, max(walls.undented_btpbnc.shape[-2], 2), 2),
        ),
        (
            "curves",
            walls.curves.shape,
            (*at_pole, 2, max(walls.curves.shape[-2], 2), 2),
        ),
    ):
        if found != wanted:
            raise InputError(
                f"library: {name} {found}: two points at least, of the axes {shape}"
            )

    axes = (polar_rad, library.thickness_m, library.tension, library.tip_m)
    check_inside(
        "polar angle",
        np.asarray(library.contact_polar_rad),
        polar_rad[0],
        polar_rad[-1],
        "deg",
    )

    if not all((np.diff(axis) > 0.0).all() for axis in axes):
        raise InputError("library: an axis that does not increase")

    sizes = (
        library.radius_m,
        library.needle_radius_m,
        library.max_force_ratio,
        axes[1][0],
        axes[2][0],
    )
    if (
        not all(0.0 < size < np.inf for size in sizes)
        or not 0.0 <= library.poisson_ratio < 0.5
    ):
        raise InputError(
            "library: radius, needle radius, largest F/E, first thickness and tension"
            f" {sizes}, Poisson's ratio {library.poisson_ratio}: impossible"
        )
    if not all(np.isfinite(array).all() for array in (*axes, library.stiffness_atpd)):
        raise InputError("library: values that are not finite")


# rows of (thickness, tension) and their weights, each (sample, 16)
Walls = tuple[Places, Floats]

# the boundaries of a wall, as an index
OUTER = 0
INNER = 1
OTHERS = 10  # libraries of other stiffenings that one keeps: each has some 20 MB
CONTACTS = 10  # libraries of other contacts that one keeps: each has some 0.5 MB


@dataclass(frozen=True)
class Responses:
    """States of walls, one for each sample.

    `curves_sbnc` (sample, boundary, node, 2), m: distance from the needle axis and
    depth below the undeformed contact of material points of the outer and the inner
    surface, from the axis outwards; float32, exact to 1 nm. `tip_m` (sample,): inward
    displacement of the contact relative to the wall under IOP alone. `force_ratio`
    (sample,): F/E, m^2.
    """

    curves_sbnc: Curves
    tip_m: Floats
    force_ratio: Floats


@dataclass(frozen=True, kw_only=True)
class Library:
    """Load paths over thickness and tension, and their interpolation. All evaluation is
    vectorised over samples.

    A sample outside of the library raises `InputError`, which names the value and the
    range.

    `thickness_m` (t,), `tension` (p,) and `tip_m` (d,) increase, at least four values
    each; `tip_m` starts at 0. `stiffness_atpd` is the factor of the force for contacts
    at the polar angles `polar_rad` (a,), from 0. `max_force_ratio` is its largest F/E.
    It answers for contacts at `contact_polar_rad`, and for the `walls` of tissue that
    stiffens by `stiffening` (`mechanics.tissue_material`).
    """

    thickness_m: Floats
    tension: Floats
    tip_m: Floats
    walls: StiffenedWalls
    stiffening: float
    radius_m: float
    poisson_ratio: float
    needle_radius_m: float
    max_force_ratio: float
    polar_rad: Floats
    stiffness_atpd: Floats
    contact_polar_rad: float
    # has the spline weights of its walls already
    same_walls: InitVar["Library | None"] = None

    def __repr__(self) -> str:
        return (
            f"<Library: {len(self.thickness_m) * len(self.tension)} load paths of"
            f" {len(self.tip_m)} dents>"
        )

    _same_walls: "Library | None" = field(init=False, repr=False, compare=False)
    # of the walls, for its stiffening
    _mix_b: Floats = field(init=False, repr=False, compare=False)
    _others: "OrderedDict[float, Library]" = field(
        default_factory=OrderedDict, init=False, repr=False, compare=False
    )
    _contacts: "OrderedDict[float, Library]" = field(
        default_factory=OrderedDict, init=False, repr=False, compare=False
    )

    def __post_init__(self, same_walls: "Library | None") -> None:
        check_arrays(self)
        object.__setattr__(self, "_same_walls", same_walls)
        object.__setattr__(self, "_mix_b", self.walls.weights(self.stiffening))

    @cached_property
    def force_ratio_tpd(self) -> Floats:
        """F/E over the pole (t, p, d), m^2."""
        return np.tensordot(self._mix_b, self.walls.force_ratio_btpd, axes=1)

    @cached_property
    def displaced_tpd(self) -> Floats:
        """The displaced volume over the pole (t, p, d), m^3."""
        return np.tensordot(self._mix_b, self.walls.displaced_btpd, axes=1)

    @cached_property
    def undented_tpbnc(self) -> Curves:
        """Walls without the needle (t, p, boundary, node, 2), m."""
        return np.tensordot(
            self._mix_b, self.walls.undented_btpbnc.astype(np.float64), axes=1
        ).astype(np.float32)

    def curves_tpdbnc(self) -> Curves:
        """Return the curves of all its states (t, p, d, boundary, node, 2), m."""
        return self.walls.curves.mixed(self._mix_b)

    def curves(
        self, thickness_m: Floats, iop_ratio: Floats, force_ratio: Floats
    ) -> Responses:
        """Return the first state on loading (sample,) of walls, m, at IOP/E that
        carries a force F/E, m^2.
        """
        tip_m = self.tips(thickness_m, iop_ratio, force_ratio)
        return Responses(
            self._curves(thickness_m, iop_ratio, tip_m),
            tip_m,
            np.asarray(force_ratio, dtype=np.float64),
        )

    def at_tip(
        self, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats
    ) -> Responses:
        """Return the states at given tips (sample,), m; twice continuously
        differentiable in all three arguments.
        """
        forces = self.forces(thickness_m, iop_ratio, tip_m)
        tips = np.asarray(tip_m, dtype=np.float64)
        return Responses(self._curves(thickness_m, iop_ratio, tips), tips, forces)

    def shapes(self, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats) -> Curves:
        """Return the curves of `at_tip` (sample, boundary, node, 2), m, without the
        forces: half the work.
        """
        check_inside("tip", tip_m, 0.0, float(self.tip_m[-1]), "mm")
        return self._curves(thickness_m, iop_ratio, np.asarray(tip_m, dtype=np.float64))

    def forces(self, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats) -> Floats:
        """Return F/E (sample,), m^2, of `at_tip` without the curves, at a hundredth of
        the cost.
        """
        return self._at_tips(self.tables.forces, thickness_m, iop_ratio, tip_m)

    def displaced_m3(
        self, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats
    ) -> Floats:
        """Return the volume between the wall without the needle and with it, at one
        pressure, (sample,), m^3.
        """
        return self._at_tips(self.tables.volumes, thickness_m, iop_ratio, tip_m)

    def base_bulge(
        self,
        thickness_m: Floats,
        iop_ratio: Floats,
        places_sbpc: Floats,
        pole_s2: Floats,
    ) -> Floats:
        """Return the motion of places by the base, from the wall about the needle axis
        to that about the eye's (sample, boundary, place, 3), m.

        Its parts are along the section, across it, and down. `places_sbpc`: unit
        vectors to the places at rest (`moving_base.section_places`), one sample for
        all, or one for each; `pole_s2`: of `moving_base.pole_directions`.
        """
        self.check_walls(thickness_m, iop_ratio)
        moved = np.empty((len(pole_s2), *places_sbpc.shape[-3:]))
        thickness, ratio, _ = _samples(thickness_m, iop_ratio, np.empty(len(pole_s2)))
        places = np.ascontiguousarray(np.broadcast_to(places_sbpc, moved.shape))
        bulges_of(
            self.tables, thickness, ratio, places, np.ascontiguousarray(pole_s2), moved
        )

        return moved

    def node_angles(self) -> Floats:
        """Return the angles from the needle axis at which the nodes of the curves lie
        at rest (node,).
        """
        return self._angles[: self.walls.curves.shape[5]]

    @cached_property
    def _angles(self) -> Floats:
        """Angles from the axis of the nodes of the walls without the needle."""
        return meridian_angles(
            self.undented_tpbnc[0, 0].astype(np.float64), self.radius_m
        )

    def iop_ratio_ends(self, thickness_m: Floats) -> tuple[Floats, Floats]:
        """Return the lowest and the highest IOP ratio (sample,) that the library holds
        for walls.
        """
        per_tension = np.asarray(thickness_m) / self.radius_m
        return self.tension[0] * per_tension, self.tension[-1] * per_tension

    def tips(
        self, thickness_m: Floats, iop_ratio: Floats, force_ratio: Floats
    ) -> Floats:
        """Return the tips (sample,), m, at which loading first reaches the forces;
        arguments as for `curves`.
        """
        paths = self._paths(thickness_m, iop_ratio)
        check_inside("F/E", force_ratio, 0.0, self.max_force_ratio, "mm2", "mm^2")

        tips = response_splines.first_crossing(
            self.tip_m, paths, np.array(force_ratio, dtype=np.float64)
        )
        if np.isnan(tips).any():
            sample = int(np.argmax(np.isnan(tips)))
            raise InputError(
                f"F/E: {from_si(force_ratio[sample], 'mm2'):.4g} mm^2 dents a wall of"
                f" {from_si(thickness_m[sample], 'um'):.0f} µm with IOP/E"
                f" {iop_ratio[sample]:.3g} by more than the library's"
                f" {from_si(self.tip_m[-1], 'mm'):g} mm"
            )

        return tips

    def covers(
        self, thickness_m: Floats, iop_ratio: Floats, force_ratio: Floats
    ) -> Flags:
        """Return which samples `curves` answers (sample,)."""
        values = np.broadcast_arrays(
            thickness_m, self._tension(thickness_m, iop_ratio), force_ratio
        )
        ranges = (
            self._ends(self.thickness_m),
            self._ends(self.tension),
            (0.0, self.max_force_ratio),
        )
        known = np.ones(values[0].shape, dtype=bool)

        for value, (low, high) in zip(values, ranges, strict=True):
            known &= (value >= low - SLACK * high) & (value <= high * (1.0 + SLACK))

        thickness, tension, force = (
            value[known].astype(np.float64) for value in values
        )
        paths = self._paths(thickness, tension * thickness / self.radius_m)
        known[known] = np.isfinite(
            response_splines.first_crossing(self.tip_m, paths, force)
        )

        return known

    def largest_force_ratio(self, thickness_m: Floats, iop_ratio: Floats) -> Floats:
        """Return the largest F/E (sample,), m^2, that `curves` answers for these
        walls.
        """
        forces = self._paths(thickness_m, iop_ratio)[:, : len(self.tip_m)]
        return np.minimum(forces.max(axis=1), self.max_force_ratio)

    def for_contact(self, polar_rad: float) -> "Library":
        """Return the library of needles at a polar angle; it shares the arrays that do
        not depend on it, and the last few are cached.
        """
        library = self._contacts.get(polar_rad)
        if library is None:
            library = replace(
                self, contact_polar_rad=polar_rad, same_walls=self._same_walls or self
            )
            self._contacts[polar_rad] = library
            if len(self._contacts) > CONTACTS:
                self._contacts.popitem(last=False)

        return library

    def for_stiffening(self, stiffening: float) -> "Library":
        """Return the library of tissue that stiffens by b, at the same contact; the
        last few are cached.
        """
        if stiffening == self.stiffening:
            return self

        if stiffening not in self._others:
            self._others[stiffening] = replace(self, stiffening=stiffening)
            if len(self._others) > OTHERS:
                self._others.popitem(last=False)

        self._others.move_to_end(stiffening)
        return self._others[stiffening]

    def nearest_contact(self, polar_rad: float | None) -> "Library":
        """Return the library of needles at a polar angle, or at the nearest that it
        holds; for None, itself.
        """
        if polar_rad is None:
            return self
        return self.for_contact(min(max(polar_rad, 0.0), float(self.polar_rad[-1])))

    def eye(
        self,
        *,
        thickness_m: float,
        youngs_modulus_pa: float,
        iop_pa: float,
        rigidity_pa13_per_m3: float = 0.0,
        rigidity_law: str = RIGIDITY_LAWS[0],
        polar_angle_rad: float | None = None,
        stiffening: float | None = None,
    ) -> LibraryEye:
        """Return one eye, which answers with the force of a dent and the dent of a
        force.

        `iop_pa`: without the needle; `rigidity_pa13_per_m3`: of a sealed globe, 0 is an
        open one; `polar_angle_rad`: of the contact, from the pole. None: the library's.

        Raises:
            InputError: a value is outside the library's range.
        """
        library = self if stiffening is None else self.for_stiffening(stiffening)

        if polar_angle_rad is not None:
            check_inside(
                "polar angle",
                np.array(polar_angle_rad),
                *self._ends(self.polar_rad),
                "deg",
            )
            library = library.for_contact(polar_angle_rad)

        library.check_walls(
            np.array([thickness_m]), np.array([iop_pa / youngs_modulus_pa])
        )
        globe = sealed_law(rigidity_pa13_per_m3, rigidity_law)

        return LibraryEye(library, thickness_m, youngs_modulus_pa, iop_pa, globe)

    def within(self, distance_m: float) -> "Library":
        """Return the library without the material that lies farther than `distance_m`
        from the needle axis.

        One node beyond is kept. It is smaller and faster, for slices that do not show
        the rest.
        """
        near = (self.curves_tpdbnc()[..., 0].min(axis=(0, 1, 2)) < distance_m).any(
            axis=0
        )
        return replace(
            self,
            walls=self.walls.within(min(int(np.flatnonzero(near)[-1]) + 2, len(near))),
        )

    @cached_property
    def _splines(
        self,
    ) -> tuple[
        response_splines.CubicSpline,
        response_splines.CubicSpline,
        response_splines.CubicSpline,
    ]:
        """Splines over log thickness, log tension, tip."""
        thickness, tension, tip = map(
            response_splines.CubicSpline,
            (np.log(self.thickness_m), np.log(self.tension), self.tip_m),
        )
        return thickness, tension, tip

    @cached_property
    def _curve_weights(self) -> Curves:
        """Spline weights of the curves (t p d, b n c)."""
        shared = self._same_walls
        return (
            shared._curve_weights
            if shared
            else self.walls.curves.coefficients(self._mix_b, self._splines)
        )

    @cached_property
    def _undented_weights(self) -> Floats:
        """Spline weights of the walls without the needle (t p, b n c)."""
        if self._same_walls:
            return self._same_walls._undented_weights
        weights = response_splines.tensor_coefficients(
            self._splines[:2], self.undented_tpbnc.astype(np.float64)
        )
        return weights.reshape(len(self.thickness_m) * len(self.tension), -1)

    @cached_property
    def tables(self) -> SplineTables:
        """Tables that the loops of `response_splines` interpolate; they share the
        library's arrays.
        """
        along = self._splines
        forces = self._contact_forces
        volumes = self._contact_volumes
        thickness, tension, tip = (spline.pieces for spline in along)

        return SplineTables(
            thickness=thickness,
            tension=tension,
            tip=tip,
            tensions=len(self.tension),
            tips=len(self.tip_m),
            curves=self._curve_weights,
            undented=self._undented_weights,
            forces=response_splines.tensor_coefficients(along, forces).reshape(-1),
            volumes=response_splines.tensor_coefficients(along, volumes).reshape(-1),
            paths=response_splines.values_and_slopes(along, forces, axis=2),
            volumes_along_tension=response_splines.values_and_slopes(
                along, volumes, axis=1
            ),
            log_tension=np.log(self.tension),
            tip_m=self.tip_m,
            thickness_ends_m=self._ends(self.thickness_m),
            tension_ends=self._ends(self.tension),
            angles=self._angles,
            sines=np.sin(self._angles),
            cosines=np.cos(self._angles),
            radius_m=self.radius_m,
            poisson_ratio=self.poisson_ratio,
        )

    @cached_property
    def _contact_forces(self) -> Floats:
        """F/E at the contact's polar angle (t, p, d)."""
        spline = response_splines.CubicSpline(self.polar_rad)
        (shares,) = spline.shares(
            inside_ends(np.array([self.contact_polar_rad]), self.polar_rad)
        )
        return self.force_ratio_tpd * np.tensordot(shares, self.stiffness_atpd, axes=1)

    @cached_property
    def _contact_volumes(self) -> Floats:
        """The displaced volume at the contact's polar angle (t, p, d), m^3."""
        rises = contact_rises(
            self.undented_tpbnc, np.array([0.0, self.contact_polar_rad]), self.radius_m
        )
        pole, beside = (
            rise_slope(rise, self.thickness_m / self.radius_m, self.tension)[..., None]
            for rise in rises
        )

        return (
            self.displaced_tpd
            + self._contact_forces * beside
            - self.force_ratio_tpd * pole
        )

    def _at_tips(
        self,
        coefficients: Floats,
        thickness_m: Floats,
        iop_ratio: Floats,
        tip_m: Floats,
    ) -> Floats:
        """Values (sample,) at given tips of the spline over (t p d,) with these
        coefficients.
        """
        check_inside("tip", tip_m, 0.0, float(self.tip_m[-1]), "mm")
        self.check_walls(thickness_m, iop_ratio)
        return values_at(
            self.tables, coefficients, *_samples(thickness_m, iop_ratio, tip_m)
        )

    def _paths(self, thickness_m: Floats, iop_ratio: Floats) -> Floats:
        """Force, and then its slope, at the library's tips for walls (sample, 2 d)."""
        rows, weights = self._walls(thickness_m, iop_ratio)
        return np.asarray((weights[:, None] @ self.tables.paths[rows])[:, 0])

    def _curves(self, thickness_m: Floats, iop_ratio: Floats, tip_m: Floats) -> Curves:
        """Return the curves of states whose tips lie in the library."""
        self.check_walls(thickness_m, iop_ratio)
        found = np.empty((len(tip_m), *self.walls.curves.shape[4:]), dtype=np.float32)
        thickness, ratio, tip = _samples(thickness_m, iop_ratio, tip_m)
        curves_of(self.tables, thickness, ratio, tip, found.reshape(len(found), -1))
        return found

    def _walls(self, thickness_m: Floats, iop_ratio: Floats) -> Walls:
        """Return the walls' places between the nodes of the library."""
        tension = self.check_walls(thickness_m, iop_ratio)
        t, of_t = self._splines[0].weights(
            np.log(inside_ends(thickness_m, self.thickness_m))
        )
        p, of_p = self._splines[1].weights(np.log(inside_ends(tension, self.tension)))
        support = np.arange(response_splines.SUPPORT)
        shape = (len(t), response_splines.SUPPORT**2)
        rows = (t[:, None] + support)[:, :, None] * len(self.tension) + (
            p[:, None] + support
        )[:, None]

        return rows.reshape(shape), (of_t[:, :, None] * of_p[:, None]).reshape(shape)

    def check_walls(self, thickness_m: Floats, iop_ratio: Floats) -> Floats:
        """Return the tensions of walls (sample,); one outside the library raises
        `InputError`, with its IOP/E.
        """
        check_inside(
            "thickness", thickness_m, *self._ends(self.thickness_m), "um", "µm"
        )
        tension = self._tension(thickness_m, iop_ratio)
        ends = self._ends(self.tension)

        inside = (tension >= ends[0] * (1.0 - SLACK)) & (
            tension <= ends[1] * (1.0 + SLACK)
        )
        if inside.all():
            return tension

        worst = int(np.argmin(inside))  # NaN is outside, too
        thickness = float(np.broadcast_to(thickness_m, tension.shape)[worst])
        per_tension = thickness / self.radius_m
        low, high, burst = (
            value * per_tension for value in (*ends, burst_tension(self.poisson_ratio))
        )
        raise InputError(
            f"IOP/E: {tension[worst] * per_tension:.4g} is outside the library's range"
            f" for a wall of {from_si(thickness, 'um'):.0f} µm, {low:.3g} to"
            f" {high:.3g}; it bursts at {burst:.3g}"
        )

    def _tension(self, thickness_m: Floats, iop_ratio: Floats) -> Floats:
        return np.asarray(iop_ratio) * (self.radius_m / np.asarray(thickness_m))

    @staticmethod
    def _ends(axis: Floats) -> tuple[float, float]:
        return float(axis[0]), float(axis[-1])


def _samples(*values: Floats) -> list[Floats]:
    """Return values (sample,) each, of the one type that the loops are compiled for."""
    return [
        np.ascontiguousarray(value, dtype=np.float64)
        for value in np.broadcast_arrays(*values)
    ]
