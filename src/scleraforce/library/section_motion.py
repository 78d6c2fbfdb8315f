"""What the nearness of the eye's base moves many sections by, each of an eye of its own (`library.base_bulge`)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.base_bulge import base_push, section_places
from scleraforce.library.responses import OUTER, Library
from scleraforce.library.states import Responses

Floats = NDArray[np.float64]

PLACE_M = 1.2e-3  # between places; the motion is smooth, and linear between them to 1 um
GROWN_RAD = 0.4  # from the axis, where it counts how much wider a wall has become: a dent hardly reaches so far
BLOCK = 128  # samples together: their arrays stay in the cache
ALONG, ACROSS, DOWN = range(3)


@dataclass(frozen=True, eq=False)
class SectionMotion:
    """How far sections have moved, in the library's size.

    `lateral_p` (place,): even places of a section, m, the same to both sides of the needle axis. `moved_sbpc` (sample,
    boundary, place, [along the section, across it, down]), m.
    """

    lateral_p: Floats
    moved_sbpc: Floats

    def of(self, samples: slice) -> "SectionMotion":
        """Return that of some samples."""
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
        """How far the contact has moved across the section (sample,), m."""
        middle: Floats = self.moved_sbpc[:, 0, len(self.lateral_p) // 2, ACROSS]
        return middle


def section_motion(
    library: Library,
    walls: Responses,
    place: tuple[Floats, Floats],
    gap_m: Floats,
    pole_s2: Floats,
    reach_m: float,
) -> SectionMotion:
    """Return what pressure and force move sections by.

    Args:
        library: of responses.
        walls: its states that are cut.
        place: of the walls in the library: thickness, m, and pressure over E, (sample,) each.
        gap_m: of the sections (sample,), m.
        pole_s2: where the eye's pole lies (`base_bulge.pole_direction`).
        reach_m: how far sections are looked at, to either side of the needle axis.

    Raises:
        InputError: a wall lies outside the library.
    """
    thickness_m, iop_ratio = place
    lateral = reach_m * np.linspace(-1.0, 1.0, 2 * int(np.ceil(reach_m / PLACE_M)) + 1)
    radii_sb = library.radius_m - np.stack([np.zeros_like(thickness_m), thickness_m], axis=1)
    per_rest = 1.0 / (radii_sb * _growth(library, walls)[:, None])[..., None]  # from here to unit vectors at rest
    moved = np.empty((len(gap_m), 2, len(lateral), 3))
    for start in range(0, len(gap_m), BLOCK):
        some = slice(start, start + BLOCK)
        places = section_places(lateral * per_rest[some], gap_m[some, None, None] * per_rest[some])
        moved[some] = library.base_bulge(thickness_m[some], iop_ratio[some], places, pole_s2[some])
    pushed = base_push(walls.force_ratio, thickness_m, library.poisson_ratio)
    moved[..., :DOWN] += (pushed[:, None] * pole_s2)[:, None, None, :]
    return SectionMotion(lateral, moved)


def _growth(library: Library, walls: Responses) -> Floats:
    """Return how much wider walls are than at rest (sample,): 1 where they are as wide."""
    angles = library.node_angles()
    node = min(int(np.searchsorted(angles, GROWN_RAD)), len(angles) - 1)
    wide: Floats = walls.curves_sbnc[:, OUTER, node, 0] / (library.radius_m * np.sin(angles[node]))
    return wide
