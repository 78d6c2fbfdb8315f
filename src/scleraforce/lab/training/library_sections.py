"""Sections of a virtual eye of finite strain, from the response library
(`library.wall_responses`).

The library holds walls of revolution about the needle axis, so sections have a closed
form (`library.plane_cut`). Its wall is clamped all around at 90 degrees from the
needle; the eye's base is a plane, nearer on one side. Under a needle that does not push
on the pole the eye gives way less on the near side: the dent moves and turns by up to
0.1 mm. Along the section that is a pose, which registration finds; across the plane it
is a gap that is not the stated one, which costs E 3 to 7 %.
`mechanics.axisymmetric_wall` has that motion, in proportion to the force
(`base_moves`), `library.moving_base` the pressure's part. Gravity is neglected.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import cos, sin

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import CalibrationError, InputError
from scleraforce.base.units import from_si
from scleraforce.calibration.filter.eye_parameters import (
    WallState,
    stated_globe,
    stated_polar_rad,
)
from scleraforce.library import Library
from scleraforce.library.moving_base import pole_directions, section_places
from scleraforce.library.response_splines import CubicSpline
from scleraforce.library.sealed_eye import iop_ratio_under_force
from scleraforce.records.fields import declared
from scleraforce.records.globe import Globe
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study


def _shift(
    radius_m: float,
    thickness_m: float,
    poisson_ratio: float,
    needle_radius_m: float,
    polar_rad: float,
) -> tuple[Floats, Floats]:
    """Return the rings (boundary, node) of a wall, and their shift by a needle
    (boundary, node, harmonic, 3).
    """
    # 96 ms: SciPy's solvers, not for eyes without a stated direction
    from scleraforce.mechanics.axisymmetric_wall import (
        LARGEST_POLAR_RAD,
        EvenWall,
        base_shift,
    )

    wall = EvenWall(radius_m, thickness_m, poisson_ratio, needle_radius_m)
    shift = base_shift(wall, min(polar_rad, LARGEST_POLAR_RAD))
    mesh = wall.mesh()
    rings_bn = np.stack(
        [mesh.points_nc[nodes, 0] for nodes in (mesh.outer_n, mesh.inner_n)]
    )

    return rings_bn, shift.needle_mbnc.transpose(1, 2, 0, 3)


def base_moves(
    study: Study,
    setup: Setup,
    polar_rad: float,
    lateral_m: Floats,
) -> Floats:
    """Return the motion of the wall for F/E = 1 m^2 (boundary, place, [lateral, across,
    depth]), m: 0.3 s, once an eye.

    It does not grow beyond a polar angle of 55 degrees. At a polar angle of 0, or
    without a stated direction (the mean), nothing moves.
    """
    direction_rad = setup.scan.direction_rad
    if polar_rad == 0.0 or direction_rad is None:
        return np.zeros((2, len(lateral_m), 3))

    gap_m = declared(setup.needle.gap_m, "needle: gap_m")
    wall = (
        study.eye.radius_m,
        declared(setup.eye.thickness_m, "eye: thickness_m"),
        study.eye.poisson_ratio,
        study.needle.outer_diameter_m / 2,
    )
    rings_bn, shift_bnmc = _shift(*wall, polar_rad)
    # angle about the needle axis, from the lateral axis
    inside = np.arctan2(gap_m, lateral_m)
    distance_m = np.hypot(lateral_m, gap_m)

    return np.array(
        [
            _displacement(shift_nmc, rings, distance_m, inside, direction_rad)
            for shift_nmc, rings in zip(shift_bnmc, rings_bn, strict=True)
        ]
    )


def _displacement(
    shift_nmc: Floats,
    ring_n: Floats,
    distance_m: Floats,
    inside: Floats,
    direction_rad: float,
) -> Floats:
    """Return the motion (place, 3) of one boundary from its harmonics (node, harmonic,
    [away, around, depth]).
    """
    nodes, harmonics, _ = shift_nmc.shape
    flat = shift_nmc.reshape(nodes, -1).T
    local = np.array([np.interp(distance_m, ring_n, row) for row in flat]).reshape(
        harmonics, 3, -1
    )
    phase = np.arange(harmonics)[:, None] * (inside + direction_rad)
    away, depth = (local[:, axis] * np.cos(phase) for axis in (0, 2))
    around = (local[:, 1] * np.sin(phase)).sum(axis=0)
    away = away.sum(axis=0)
    depth = depth.sum(axis=0)
    lateral = away * np.cos(inside) - around * np.sin(inside)

    return np.stack(
        [lateral, away * np.sin(inside) + around * np.cos(inside), depth], axis=1
    )


REACH = 0.72  # of the radius: how far the section reaches to either side of the contact
SAMPLE_STEP_M = 0.1e-3  # between the places of a section
# along the wall, between points that a section is interpolated between
FINE_STEP_M = 0.05e-3
HIGHEST = 0.999  # of the library's highest pressure: what rises so far is outside
# share of the library's largest force beyond which the continuation takes its slope
END_SHARE = 0.97


@dataclass(frozen=True, eq=False)
class LibrarySections:
    """An eye whose sections come from a library.

    `lateral_m` (sample,): places of the section. `moves_bxc`: its `base_moves` at the
    stated polar angle.
    """

    setup: Setup
    library: Library
    lateral_m: Floats
    moves_bxc: Floats

    @property
    def globe(self) -> Globe:
        """The globe as far as it is stated."""
        return stated_globe(self.setup)

    def curves(self, states: Sequence[WallState]) -> Floats:
        """Return the sections (state, boundary, sample, 2) in m: lateral and depth.

        Beyond the library (a modulus too low for the force) the section continues along
        the slope by ln(F/E) at the end; pressure and thickness are held at the
        library's ends.
        """
        thickness, pressure, force = self._ratios(states)
        moved = self._moved(thickness, pressure, force)
        gap_m = np.array([state.gap_m for state in states])
        depth = section_depths(
            self._walls(thickness, pressure, force),
            self._fine,
            gap_m,
            self.setup.scan.tilt_rad or 0.0,
            self.lateral_m,
            moved,
        )
        return np.stack([np.broadcast_to(self.lateral_m, depth.shape), depth], axis=-1)

    def outside(self, state: WallState) -> str | None:
        """Return why the library does not reach a state, None if it does."""
        thickness, pressure, force = self._ratios([state])
        try:
            self.library.tips(thickness, pressure, force)
        except InputError as fault:
            return str(fault)

        if (
            self.globe.can_be_sealed
            and pressure[0] >= HIGHEST * self.library.iop_ratio_ends(thickness)[1][0]
        ):
            return "the pressure under the needle rises beyond the library's"

        return None

    def _ratios(self, states: Sequence[WallState]) -> tuple[Floats, Floats, Floats]:
        """Return thickness, the pressure under the needle over E and F/E of states,
        each (state,).
        """
        modulus = np.array([state.youngs_modulus_pa for state in states])
        thickness = np.array([state.thickness_m for state in states])
        pressure = np.array([state.iop_pa for state in states]) / modulus
        force = np.array([state.force_n for state in states]) / modulus

        if self.globe.can_be_sealed:
            rigidity = np.array([state.rigidity_pa13_per_m3 for state in states])
            globe = self.globe.pressure_law(rigidity).over(modulus)
            held, pressure = self._held(thickness, pressure)
            pressure = iop_ratio_under_force(
                self.library, held, pressure, np.maximum(force, 0.0), globe
            )

        return thickness, pressure, force

    def _held(self, thickness: Floats, pressure: Floats) -> tuple[Floats, Floats]:
        """Return thickness and pressure over E, clipped to the library's ends."""
        held = np.clip(
            thickness, self.library.thickness_m[0], self.library.thickness_m[-1]
        )
        return held, np.clip(pressure, *self.library.iop_ratio_ends(held))

    def _moved(self, thickness: Floats, pressure: Floats, force: Floats) -> Floats:
        """Return the motion of sections by the base's nearness (state, boundary, place,
        3), m.

        It is 0, the mean over all directions, if the section's is not stated.
        """
        direction_rad = self.setup.scan.direction_rad
        if direction_rad is None:
            return np.zeros((len(force), *self.moves_bxc.shape))

        pole = pole_directions(stated_polar_rad(self.setup), direction_rad)
        bulged = self.library.base_bulge(
            *self._held(thickness, pressure),
            self._places,
            np.broadcast_to(pole, (len(force), 2)),
        )

        return bulged + force[:, None, None, None] * self.moves_bxc

    def _walls(self, thickness: Floats, pressure: Floats, force: Floats) -> Floats:
        """Return the library's curves (state, boundary, node, 2), continued beyond its
        end.
        """
        library = self.library
        thickness, pressure = self._held(thickness, pressure)

        force = np.maximum(force, 0.0)
        largest = library.largest_force_ratio(thickness, pressure)
        beyond = np.flatnonzero(force > largest)
        excess = np.log(force[beyond] / largest[beyond])
        force[beyond] = largest[beyond]
        rows = np.append(np.arange(len(force)), beyond)
        forces = np.append(force, END_SHARE * largest[beyond])
        found = library.curves(
            thickness[rows], pressure[rows], forces
        ).curves_sbnc.astype(np.float64)
        curves = found[: len(thickness)]
        before = found[len(thickness) :]
        curves[beyond] += (curves[beyond] - before) * (excess / -np.log(END_SHARE))[
            :, None, None, None
        ]

        return curves

    @cached_property
    def _places(self) -> Floats:
        """Unit vectors to the section's places at rest (boundary, place, 3), as
        `library.moving_base` takes them.
        """
        gap_m = declared(self.setup.needle.gap_m, "needle: gap_m")
        thickness_m = declared(self.setup.eye.thickness_m, "eye: thickness_m")
        radii = self.library.radius_m - np.array([[0.0], [thickness_m]])
        return section_places(self.lateral_m / radii, gap_m / radii)

    @cached_property
    def _fine(self) -> Floats:
        """Weights (fine point, node) of a cubic spline along the wall through the
        library's nodes.
        """
        along = self.library.radius_m * self.library.node_angles()
        fine = np.linspace(
            along[0], along[-1], int((along[-1] - along[0]) / FINE_STEP_M) + 1
        )
        return CubicSpline(along).shares(fine)


def library_eye(study: Study, setup: Setup, library: Library) -> LibrarySections:
    """Return the model of an eye; raises `CalibrationError`."""
    mine = (
        study.eye.radius_m,
        study.eye.poisson_ratio,
        study.needle.outer_diameter_m / 2,
    )
    if not np.allclose(
        mine,
        (library.radius_m, library.poisson_ratio, library.needle_radius_m),
        rtol=1e-6,
    ):
        raise CalibrationError(
            "library: made for another radius of the eye, Poisson's ratio or needle"
            " than the study's; make it anew"
        )

    thinnest = float(library.thickness_m[0])
    thickest = float(library.thickness_m[-1])
    thickness_m = declared(setup.eye.thickness_m, "eye: thickness_m")
    if not thinnest <= thickness_m <= thickest:
        raise CalibrationError(
            f"thickness: {from_si(thickness_m, 'um'):g} µm; the library has"
            f" walls of {from_si(thinnest, 'um'):.0f} to"
            f" {from_si(thickest, 'um'):.0f} µm"
        )

    side = np.arange(0.0, REACH * library.radius_m, SAMPLE_STEP_M)
    lateral_m = np.concatenate([-side[:0:-1], side])
    polar_rad = stated_polar_rad(setup)
    moves = base_moves(study, setup, polar_rad, lateral_m)

    return LibrarySections(setup, library.nearest_contact(polar_rad), lateral_m, moves)


def _cut_rings(curves: Floats, gap_m: Floats, tilt_rad: float) -> tuple[Floats, Floats]:
    """Return X^2 (..., node), m^2, and Y (..., node), m, of the rings; X^2 is negative
    where the plane misses one.

    The curves are distance from the needle axis and depth of the rings (..., node, 2),
    m; the gap broadcasts.
    """
    distance = curves[..., 0]
    deep = curves[..., 1]
    return distance**2 - (gap_m + deep * np.tan(tilt_rad)) ** 2, deep / np.cos(tilt_rad)


def section_depths(
    curves_sbnc: Floats,
    fine_fn: Floats,
    gap_m: Floats,
    tilt_rad: float,
    lateral_m: Floats,
    moved_sbxc: Floats,
) -> Floats:
    """Return the depths (state, boundary, place) in the plane of surfaces of revolution
    that moved a little more.

    `curves_sbnc` have distance from the axis and depth, from the axis outwards;
    `fine_fn` are weights that interpolate along the wall; `gap_m` (state,): the plane's
    distance from the axis at the undeformed contact; `moved_sbxc`: further motion
    (lateral, across, depth) at the lateral places. Of a wall that folds over itself the
    outermost part counts: it is on top, where the light comes from.
    """
    square, depth = _cut_rings(fine_fn @ curves_sbnc, gap_m[:, None, None], tilt_rad)
    on_top = np.minimum.accumulate(square[..., ::-1], axis=-1)[..., ::-1]
    rows = list(
        zip(
            on_top.reshape(-1, len(fine_fn)),
            depth.reshape(-1, len(fine_fn)),
            strict=True,
        )
    )
    lateral, across, deeper = np.moveaxis(moved_sbxc, -1, 0)
    came_from = (lateral_m - lateral) ** 2 + (
        across - 2 * gap_m[:, None, None]
    ) * across

    if tilt_rad:
        here = _interpolated(rows, came_from)
        came_from = came_from - 2 * across * here * sin(tilt_rad)

    return _interpolated(rows, came_from) + deeper / cos(tilt_rad)


def _interpolated(rows: Sequence[tuple[Floats, Floats]], wanted: Floats) -> Floats:
    """Interpolate each row's depth over the square of the lateral place, (...,
    place).
    """
    places = wanted.reshape(len(rows), -1)
    found = [np.interp(place, *row) for place, row in zip(places, rows, strict=True)]
    return np.array(found).reshape(wanted.shape)
