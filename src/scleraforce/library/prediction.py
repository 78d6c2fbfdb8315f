"""The picture of a library's wall in the columns of a frame, its derivatives by the unknowns, and the globe's law.

The wall is a surface of revolution about the needle axis. The B-scan plane, parallel to that axis at a distance of one
gap, sees a point of it at the distance r from the axis at the lateral place sqrt(r² - gap²), to both sides. An eye that
is larger by a factor is the same eye at another length unit: thickness and dent count relative to it, and so do F/E, by
its square, and volumes, by its cube.

What a frame shows is the state at the pressure under the needle. In an open globe that is the IOP. In one that may be
sealed it is an unknown of its own. There level(P) - level(P0) = k dV (`mechanics.globe`), with P the pressure under the
needle. Of a normal k this says that level(P) is normal about level(P0) + mean(k) dV with the standard deviation
sd(k) dV. So the pressure is fitted, which a frame shows, and not the rigidity, which it shows only where the dent is
deep.

The eye's base lies nearer on one side of the needle (`library.base`). Its effect is known where the pole's place is
known; else that place is an unknown. The motion is smooth: it is found at a few places of the section, for an
approximate gap and thickness (their effect is below 1 um), and interpolated to where the plane meets the rings.

The form of an eye that is not an even sphere is added at rest (`library.unknowns`); how it bends is left out.
"""

from dataclasses import KW_ONLY, dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scleraforce.known import OPEN, KnownGlobe
from scleraforce.library import unknowns as at
from scleraforce.library.base import section_places
from scleraforce.library.fit_loops import Law, Rings, States, off_the_laws, predict, sections_of_walls
from scleraforce.library.placement import Placed, Places
from scleraforce.library.responses import Library
from scleraforce.study.eye import RIGIDITY_LAWS

Array = NDArray[np.float64]

STATION_RAD = 0.04  # between the places


HIGHEST_POLE = 0.85  # sine of the largest polar angle of a contact that a fit takes


@dataclass(frozen=True, eq=False)
class Walls:
    """The candidate walls of a fit: a library and the known globe.

    `gap_m` and `thickness_m` are approximate values of the walls.
    """

    library: Library
    globe: KnownGlobe = OPEN
    _: KW_ONLY
    gap_m: float = 0.6e-3
    thickness_m: float = 0.6e-3

    @cached_property
    def rings(self) -> Rings:
        """Rings of the walls' sections, at the approximate gap and thickness."""
        angles = self.library.node_angles()
        reach = np.sin(angles)
        count = int(np.ceil(angles[-1] / STATION_RAD)) + 1
        stations = reach[-1] * np.linspace(-1.0, 1.0, 2 * count + 1)
        across = self.gap_m / (self.library.radius_m - np.array([[0.0], [self.thickness_m]]))
        rings = np.sqrt(np.maximum(reach**2 - across**2, 0.0))
        wanted = np.concatenate([-rings, rings], axis=1)
        left = np.clip(np.searchsorted(stations, wanted) - 1, 0, len(stations) - 2)
        share = (wanted - stations[left]) / (stations[left + 1] - stations[left])
        return Rings(section_places(stations, across), left, share)

    @cached_property
    def law(self) -> Law:
        """Law of the globe, of its mean rigidity and of its standard deviation."""
        mean, spread = self.globe.globe(self.globe.mean), self.globe.globe(self.globe.sd)
        return Law(mean.law == RIGIDITY_LAWS[1], float(mean.rate), float(spread.rate), LEAST_SD)

    @property
    def pressure(self) -> int:
        """Index of the unknown that is the pressure under the needle: the IOP in an open globe."""
        return at.PRESSURE if self.globe.can_be_sealed else at.IOP


def force_n(walls: Walls, unknown_su: Array) -> Array:
    """Return the needle's force for each set of unknowns (sample, unknown), (sample,) in N."""
    size, modulus = np.exp(unknown_su[:, at.SIZE]), np.exp(unknown_su[:, at.MODULUS])
    forces: Array = modulus * size**2 * walls.library.forces(*_library_place(walls, unknown_su))
    return forces


def displaced_m3(walls: Walls, unknown_su: Array) -> Array:
    """Return the volume that the dent displaces for each set of unknowns, (sample,)."""
    return np.exp(3.0 * unknown_su[:, at.SIZE]) * walls.library.displaced_m3(*_library_place(walls, unknown_su))


def place_walls(walls: Walls, unknown_su: Array) -> Array:
    """Return the two boundaries of walls in the frame (sample, boundary, point, 2): lateral from its middle, depth, m.

    All lie at the first sample's pose, and none has a form of its own.
    """
    library, every = walls.library, np.arange(len(unknown_su))
    lateral_m, depth_m, rotation_rad = unknown_su[0, [at.LATERAL, at.DEPTH, at.ROTATION]].tolist()
    size, pole = np.exp(unknown_su[:, at.SIZE]), np.ascontiguousarray(unknown_su[:, at.POLE])
    states = States(
        *_library_place(walls, unknown_su), size, unknown_su[:, at.GAP].copy(), pole, every,
        every if pole.any() else np.zeros_like(every), lateral_m, depth_m, rotation_rad,
    )  # fmt: skip
    placed = np.empty((len(every), 2, library.tables.curves.shape[1] // 2, 2))
    sections_of_walls(library.tables, walls.rings, states, placed)
    return placed


def formed_wall(walls: Walls, unknown: Array) -> Array:
    """Return the two boundaries of a wall in the frame (boundary, point, 2), with its form at rest."""
    placed: Array = place_walls(walls, unknown[None])[0]
    for is_inner, curve in enumerate(placed):
        is_boundary = np.full(len(curve), float(is_inner))
        curve[:, 1] += at.form_depths(unknown[at.FORM], curve[:, 0] - unknown[at.LATERAL], is_boundary)
    return placed


def predict_wall(walls: Walls, unknown: Array, places: Places) -> Placed:
    """Predict the depths and slopes at places for unknowns in the order of `NAMES`, with their derivatives."""
    count = len(places.lateral_m)
    placed = Placed(np.empty(count), np.empty(count), np.empty((count, len(at.NAMES))), np.empty(count, dtype=np.bool_))
    looked_at = places.lateral_m, places.outer, places.smoothing_m
    predict(walls.library.tables, walls.rings, unknown, walls.pressure, *looked_at, *vars(placed).values())
    return placed


def shining(slope: Array) -> Array:
    """Return the shift of the edge by the mirror reflection, over that of a surface that faces the light."""
    return np.exp(-((slope / at.SHINING_SLOPE) ** 2))


def _library_place(walls: Walls, unknown_su: Array) -> tuple[Array, Array, Array]:
    """Return thickness, pressure over E and tip of samples in the library's size, kept within its ranges."""
    library, size = walls.library, np.exp(unknown_su[:, at.SIZE])
    thickness = np.clip(unknown_su[:, at.THICKNESS] / size, library.thickness_m[0], library.thickness_m[-1])
    ratio = np.exp(unknown_su[:, walls.pressure] - unknown_su[:, at.MODULUS])
    return (
        thickness,
        np.clip(ratio, *library.iop_ratio_ends(thickness)),
        np.clip(unknown_su[:, at.TIP] / size, library.tip_m[0], library.tip_m[-1]),
    )


MOVING = (at.TIP, at.THICKNESS, at.MODULUS, at.IOP, at.SIZE, at.PRESSURE)
STEPS = np.where(np.isin(MOVING, [at.TIP, at.THICKNESS]), 1e-7, 1e-4)  # m, or of a logarithm
LEAST_SD = 3e-3  # relative, of the pressure that the law gives: volumes of the library


def off_the_law(walls: Walls, unknown_su: Array) -> Array:
    """Return the distance of unknowns from the globe's law (sample,), in standard deviations; 0 in an open globe."""
    if not walls.globe.can_be_sealed:
        return np.zeros(len(unknown_su))
    off, sd = _off(walls, unknown_su)
    return np.asarray(off / sd)


def law_slope(walls: Walls, unknown: Array) -> Array:
    """Return the derivative of `off_the_law` by each unknown (unknown,)."""
    slope = np.zeros(len(at.NAMES))
    if walls.globe.can_be_sealed:
        moving = list(MOVING)
        varied = np.repeat(unknown[None], len(moving) + 1, axis=0)
        varied[1:, moving] += np.diag(STEPS)
        off, sd = _off(walls, varied)
        slope[moving] = (off[1:] - off[0]) / (STEPS * sd[0])
    return slope


def keep_within(walls: Walls, unknown_su: Array) -> Array:
    """Return unknowns (sample, unknown) with the pressure limited by the globe's bounds of rigidity."""
    known = walls.globe
    if not known.can_be_sealed:
        return unknown_su
    volume = displaced_m3(walls, unknown_su)
    resting_pa = np.exp(unknown_su[:, at.IOP])
    ends = [np.log(known.globe(k).pressure(resting_pa, volume)) for k in (known.lowest, known.highest)]
    kept = unknown_su.copy()
    kept[:, at.PRESSURE] = np.clip(kept[:, at.PRESSURE], *ends)
    return kept


def _off(walls: Walls, unknown_su: Array) -> tuple[Array, Array]:
    """Return the distance of level(P) from its mean and its standard deviation, (sample,) each."""
    off, sd = np.empty(len(unknown_su)), np.empty(len(unknown_su))
    off_the_laws(walls.library.tables, walls.law, unknown_su, off, sd)
    return off, sd
