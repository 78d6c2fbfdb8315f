"""Surfaces of revolution, cut by the plane of the B-scan: closed form.

A surface consists of rings at distance r from the needle axis and depth d below the undeformed contact. In the frame of
`mechanics.contact.ScanPlane` (gap g, tilt tau) the point of the plane at lateral X and depth Y lies at X along the
lateral axis, g + Y sin(tau) along the offset, and Y cos(tau) deep. So the plane meets the ring (r, d) at

    Y = d / cos(tau),   X^2 = r^2 - (g + d tan(tau))^2,

if that is not negative: on both sides of the needle axis alike, whatever the direction of the plane. Between two rings
of the library, Y is interpolated linearly in X^2: that is exact for a parabola, also at X = 0, where X itself grows
like a square root along the surface. `section_motion` adds the effect of the eye's base (`library.base`).
"""

from dataclasses import dataclass

import numpy as np

from scleraforce.arrays import Floats, Places, Reals
from scleraforce.errors import InputError
from scleraforce.library.base import base_push, section_places
from scleraforce.library.responses import INNER, OUTER, Library
from scleraforce.library.states import Responses
from scleraforce.mechanics.contact import Section

PARTS = 4  # points of a section for each ring of the surface
PARTS_MIDDLE = 12  # between X = 0 and the first ring that the plane meets


def cut_rings(curves: Reals, gap_m: Floats | float, tilt_rad: Floats | float) -> tuple[Floats, Floats]:
    """Return X^2 (..., node), m^2, and Y (..., node), m, of the rings; X^2 is negative where the plane misses one.

    The curves are distance from the needle axis and depth of the rings (..., node, 2), m; gap and tilt broadcast.
    """
    distance, deep = curves[..., 0].astype(np.float64), curves[..., 1].astype(np.float64)
    return distance**2 - (gap_m + deep * np.tan(tilt_rad)) ** 2, deep / np.cos(tilt_rad)


def cut_surfaces(curves_bnc: Reals, gap_m: float, tilt_rad: float = 0.0) -> Section:
    """Cut a wall, two surfaces of revolution about the needle axis (boundary, node, 2): distance and depth, m.

    The section goes from negative to positive lateral side, in the order of the material. A plane that misses a
    surface raises `InputError`, here and below.
    """
    square_bn, depth_bn = cut_rings(curves_bnc, gap_m, tilt_rad)
    return Section(*(section_curve(square_bn[boundary], depth_bn[boundary]) for boundary in (OUTER, INNER)))


def highest_depths(curves_snc: Reals, gap_m: Floats, tilt_rad: Floats) -> Floats:
    """Return the smallest depth of the section of each surface (sample,), m; the surfaces are (sample, node, 2)."""
    square, depth = cut_rings(curves_snc, gap_m[:, None], tilt_rad[:, None])
    first, middle = _middle(square, depth)
    beyond = np.arange(square.shape[1]) > first[:, None]
    return np.minimum(np.where(beyond, depth, np.inf).min(axis=1), middle)


def _middle(square: Floats, depth: Floats) -> tuple[Places, Floats]:
    """Return the last node before X = 0 (...), and the depth there (...)."""
    missed = square < 0.0
    if missed[..., -1].any():
        raise InputError("the B-scan plane misses a surface of the wall; its gap or tilt is too large")
    nodes = square.shape[-1]
    before = np.where(missed.any(axis=-1), nodes - 1 - np.argmax(missed[..., ::-1], axis=-1), 0)
    pair = before[..., None] + np.arange(2)
    (low, high), (start, end) = (
        np.moveaxis(np.take_along_axis(values, pair, axis=-1), -1, 0) for values in (square, depth)
    )
    part = np.clip(-low / np.where(high > low, high - low, 1.0), 0.0, 1.0)
    return before, start + part * (end - start)


def section_curve(square: Floats, depth: Floats) -> Floats:
    """Return one boundary (points, 2) from X^2 and Y of its rings (node,), from negative to positive lateral side."""
    before, middle = _middle(square, depth)
    squares = np.concatenate([[0.0], square[before + 1 :]])
    depths = np.concatenate([[middle], depth[before + 1 :]])
    steps = np.full(len(squares) - 1, PARTS)
    steps[0] = PARTS_MIDDLE
    ring = np.repeat(np.arange(len(steps)), steps)
    part = (np.arange(len(ring)) - (np.cumsum(steps) - steps)[ring]) / steps[ring]
    lateral = np.sqrt(squares)
    lateral = np.append(lateral[ring] + part * np.diff(lateral)[ring], lateral[-1])  # equal steps in each interval
    rise = np.diff(squares)
    part = (lateral[:-1] ** 2 - squares[ring]) / np.where(rise == 0.0, 1.0, rise)[ring]
    deep = np.append(depths[ring] + part * np.diff(depths)[ring], depths[-1])
    half = np.stack([lateral, deep], axis=1)
    return np.concatenate([half[:0:-1] * [-1.0, 1.0], half])


PLACE_M = 1.2e-3  # between places; the motion is smooth, and linear between them to 1 um
GROWN_RAD = 0.4  # from the axis, where it counts how much wider a wall has become: a dent hardly reaches so far
BLOCK = 128  # samples together: their arrays stay in the cache
ALONG, ACROSS, DOWN = range(3)


@dataclass(frozen=True, eq=False)
class SectionMotion:
    """The motion of sections, in the library's size.

    `lateral_p` (place,): even places of a section, m, the same to both sides of the needle axis. `moved_sbpc` (sample,
    boundary, place, [along the section, across it, down]), m.
    """

    lateral_p: Floats
    moved_sbpc: Floats

    def of(self, samples: slice) -> "SectionMotion":
        """Return the motion of some samples."""
        return SectionMotion(self.lateral_p, self.moved_sbpc[samples])

    def at(self, lateral_t: Floats) -> Floats:
        """Return the motion at other places (sample, boundary, place, 3), m."""
        step = self.lateral_p[1] - self.lateral_p[0]
        from_first = np.clip((lateral_t - self.lateral_p[0]) / step, 0.0, len(self.lateral_p) - 1)
        left = np.minimum(from_first.astype(np.intp), len(self.lateral_p) - 2)
        weights = np.zeros((len(lateral_t), len(self.lateral_p)))
        rows, share = np.arange(len(lateral_t)), from_first - left
        weights[rows, left], weights[rows, left + 1] = 1.0 - share, share
        return np.asarray(weights @ self.moved_sbpc)

    @property
    def across_contact(self) -> Floats:
        """Motion of the contact across the section (sample,), m."""
        return self.moved_sbpc[:, 0, len(self.lateral_p) // 2, ACROSS]


def section_motion(
    library: Library, walls: Responses, place: tuple[Floats, Floats], gap_m: Floats, pole_s2: Floats, reach_m: float
) -> SectionMotion:
    """Return the motion of the sections of a library's states by pressure and force.

    `place`: thickness, m, and pressure over E of the walls, (sample,) each. `gap_m` (sample,) is the sections';
    `pole_s2` the direction of the eye's pole (`base.pole_directions`); `reach_m` the sections' half width.
    """
    thickness_m, iop_ratio = place
    angles = library.node_angles()
    node = min(int(np.searchsorted(angles, GROWN_RAD)), len(angles) - 1)
    grown_s: Floats = walls.curves_sbnc[:, OUTER, node, 0] / (library.radius_m * np.sin(angles[node]))
    lateral = reach_m * np.linspace(-1.0, 1.0, 2 * int(np.ceil(reach_m / PLACE_M)) + 1)
    radii_sb = library.radius_m - np.stack([np.zeros_like(thickness_m), thickness_m], axis=1)
    per_rest = 1.0 / (radii_sb * grown_s[:, None])[..., None]  # from here to unit vectors at rest
    moved = np.empty((len(gap_m), 2, len(lateral), 3))
    for start in range(0, len(gap_m), BLOCK):
        some = slice(start, start + BLOCK)
        places = section_places(lateral * per_rest[some], gap_m[some, None, None] * per_rest[some])
        moved[some] = library.base_bulge(thickness_m[some], iop_ratio[some], places, pole_s2[some])
    pushed = base_push(walls.force_ratio, thickness_m, library.poisson_ratio)
    moved[..., :DOWN] += (pushed[:, None] * pole_s2)[:, None, None, :]
    return SectionMotion(lateral, moved)
