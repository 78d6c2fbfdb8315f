"""A rigid flat punch without friction on the wall of revolution: it touches where the
wall would rise above it.

The contact grows with the dent: a flat punch meets a sphere at a point. Below the punch
a stiff bed (`BED` over Young's modulus, per metre) holds the wall, so that a contact
pressure of 0.1 E sinks in by 0.1 um. Forces are F/E in m^2 and pressures p/E. The dent
is the punch's travel from where it touches the wall under its resting pressure.

In a sealed globe the pressure P is an unknown beside the displacement u, with V(P, no
punch) as a spline:

    R(u, P) + contact(u) = 0     P = law(P0, V(P, no punch) - V(u))
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from real_tissue.walls import fine_meridian
from scleraforce.base.errors import SolverError
from scleraforce.mechanics.axisymmetric_wall import AxisymmetricWall
from scleraforce.mechanics.finite_elements import gauss_points
from scleraforce.mechanics.load_path_tracing import pressurise
from scleraforce.mechanics.meridian_elements import line_shapes
from scleraforce.mechanics.tissue_material import burst_tension
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw

Floats = NDArray[np.float64]

BED = 1e6
POINTS = 6  # along an element below the punch
# residual forces relative to pressure and punch; error of the pressure
TOLERANCE = 1e-8
FEWEST = 3  # states that have a slope
MOST_STEPS = 30  # of Newton's method; the points that touch change from one to the next
# where the undented volume is tabulated: over the rest, the burst
HIGHEST = 3.0
BELOW_BURST = 0.9
PRESSURES = 13


@dataclass(frozen=True)
class Pushed:
    """A wall under a punch, at each dent (dent,).

    Attributes:
        dent_m: the punch's travel.
        force_ratio_m2: F/E.
        iop_ratio: p/E; constant unless the globe is sealed.
        touched: area that touches over that of the punch.
    """

    dent_m: Floats
    force_ratio_m2: Floats
    iop_ratio: Floats
    touched: Floats

    def slope_m(self) -> Floats:
        """Return the stiffness dF/dx over E at each dent, (dent,) in m."""
        return np.asarray(np.gradient(self.force_ratio_m2, self.dent_m, edge_order=2))


def flat_punch_path(
    radius_m: float,
    thickness_m: float,
    poisson_ratio: float,
    punch_m: float,
    iop_ratio: float,
    dents_m: Floats,
    *,
    symmetric: bool = False,
    globe: PressureLaw = CONSTANT_PRESSURE,
    inside: int = 10,
    outside: int = 24,
) -> Pushed:
    """Return how a sphere of outer radius `radius_m` meets a flat punch of radius
    `punch_m`.

    Args:
        radius_m: outer radius without pressure.
        thickness_m: without pressure.
        poisson_ratio: nu.
        punch_m: radius of the punch.
        iop_ratio: resting pressure over Young's modulus.
        dents_m: travels of the punch, ascending, (dent,).
        symmetric: two punches at opposite poles of a whole sphere, instead of a
            half-sphere with a clamped edge.
        globe: how the pressure follows the displaced volume, over Young's modulus.
        inside: elements below the punch.
        outside: elements beyond it.

    The path of a sealed globe ends where its pressure runs away
    (`mechanics.equilibrium`).

    Raises:
        SolverError: no equilibrium was found, or of a sealed globe too few.
    """
    mesh = fine_meridian(
        radius_m, thickness_m, punch_m, inside=inside, outside=outside, layers=1
    )
    wall = AxisymmetricWall(mesh, poisson_ratio, symmetric=symmetric)
    punch = _Punch(wall, poisson_ratio, punch_m, iop_ratio, globe)
    u = punch.rest
    top_m = mesh.points_nc[0, 1] + _everywhere(wall, punch.rest)[1]
    states: list[tuple[float, float, float]] = []
    pressure = iop_ratio

    for dent_m in dents_m:
        try:
            u, pressure = punch.settled(u, pressure, top_m - dent_m)
        except SolverError:
            if not globe.is_sealed or len(states) < FEWEST:
                raise

            break  # the pressure runs away

        above = punch.above(u, top_m - dent_m)
        touched = float(np.sum(punch.areas_ep * (above > 0.0)))
        states.append((float(np.sum(BED * above * punch.areas_ep)), pressure, touched))

    force, iop, area = np.array(states).T
    return Pushed(
        np.asarray(dents_m)[: len(force)], force, iop, area / punch.areas_ep.sum()
    )


class _Punch:
    """A wall and the points of its outer surface that a punch may touch."""

    def __init__(
        self,
        wall: AxisymmetricWall,
        poisson_ratio: float,
        punch_m: float,
        iop_ratio: float,
        globe: PressureLaw,
    ) -> None:
        mesh = wall.mesh
        places_pk, weights_p = gauss_points(1, POINTS)
        self._values_pn, slopes_pn = line_shapes(places_pk[:, 0])
        nodes_en = np.stack(
            [mesh.outer_n[:-2:2], mesh.outer_n[1::2], mesh.outer_n[2::2]], axis=1
        )
        nodes_en = nodes_en[
            mesh.points_nc[nodes_en[:, -1], 0] <= punch_m * (1.0 + 1e-9)
        ]
        distance_en = mesh.points_nc[nodes_en, 0]
        rings_ep = (distance_en @ self._values_pn.T) * (distance_en @ slopes_pn.T)
        self.areas_ep = 2.0 * np.pi * rings_ep * weights_p
        self._heights_en = mesh.points_nc[nodes_en, 1]
        self._places_en = 2 * nodes_en + 1
        number = np.full(mesh.points_nc.size, -1)
        number[wall.free] = np.arange(len(wall.free))
        self._numbers_en = number[self._places_en]
        self._wall = wall
        self.rest = pressurise(wall, iop_ratio)
        self._resting = iop_ratio
        self._globe = globe
        self._applied = float(
            np.linalg.norm(wall.residual(np.zeros(len(self.rest)), iop_ratio))
        )
        thickness_m = mesh.radius_m - float(
            np.linalg.norm(mesh.points_nc[mesh.inner_n[0]])
        )
        burst = (
            burst_tension(poisson_ratio)
            * thickness_m
            / (mesh.radius_m - 0.5 * thickness_m)
        )
        highest = (
            min(HIGHEST, BELOW_BURST * burst / iop_ratio) if globe.is_sealed else 1.01
        )
        pressures = iop_ratio * np.linspace(1.0, highest, PRESSURES)
        volumes = [
            wall.volume(pressurise(wall, float(pressure)))[0] for pressure in pressures
        ]
        self._undented = CubicSpline(pressures, volumes)

    def settled(
        self, u: Floats, pressure: float, height_m: float
    ) -> tuple[Floats, float]:
        """Return displacement and pressure in equilibrium below a punch at a height, by
        Newton's method.
        """
        for _ in range(MOST_STEPS):
            contact = self._contact(u, height_m)
            defect = self._wall.residual(u, pressure) + contact
            volume_m3, gradient = self._wall.volume(u)
            displaced_m3 = float(self._undented(pressure)) - volume_m3
            law = float(self._globe.pressure(self._resting, displaced_m3))
            error = pressure - law

            applied = self._applied * pressure / self._resting + np.linalg.norm(contact)
            if (
                np.linalg.norm(defect) <= TOLERANCE * applied
                and abs(error) <= TOLERANCE * pressure
            ):
                return u, pressure
            if not law > 0.0:
                break

            steeper = float(self._globe.stiffness(law))
            solved = np.linalg.solve(
                self._tangent(u, pressure, height_m),
                np.stack([-defect, gradient], axis=1),
            )
            corner = (
                1.0
                - steeper * float(self._undented(pressure, 1))
                + steeper * float(gradient @ solved[:, 1])
            )
            more = (-error - steeper * float(gradient @ solved[:, 0])) / corner
            u = u + solved[:, 0] + more * solved[:, 1]
            pressure = pressure + more

        raise SolverError("punch: no equilibrium was found; use shorter steps")

    def above(self, u: Floats, height_m: float) -> Floats:
        """Return how far the wall is above the punch, (element, point) in m; 0 where it
        does not touch.
        """
        rise_en = _everywhere(self._wall, u)[self._places_en]
        return np.asarray(
            np.maximum((self._heights_en + rise_en) @ self._values_pn.T - height_m, 0.0)
        )

    def _contact(self, u: Floats, height_m: float) -> Floats:
        """Forces of the bed below the punch, on the side of the internal ones,
        (unknown,).
        """
        amount_en = (BED * self.above(u, height_m) * self.areas_ep) @ self._values_pn
        return np.asarray(
            np.bincount(self._numbers_en.ravel(), amount_en.ravel(), minlength=len(u))
        )

    def _tangent(self, u: Floats, pressure: float, height_m: float) -> Floats:
        tangent = np.asarray(
            np.linalg.inv(self._wall.factor(u, pressure)(np.eye(len(u)))),
            dtype=np.float64,
        )
        touching_ep = BED * self.areas_ep * (self.above(u, height_m) > 0.0)
        blocks = np.einsum(
            "ep,pa,pb->eab", touching_ep, self._values_pn, self._values_pn
        )
        np.add.at(
            tangent,
            (self._numbers_en[:, :, None], self._numbers_en[:, None, :]),
            blocks,
        )

        return tangent


def _everywhere(wall: AxisymmetricWall, u: Floats) -> Floats:
    everywhere = np.zeros(wall.mesh.points_nc.size)
    everywhere[wall.free] = u
    return everywhere
