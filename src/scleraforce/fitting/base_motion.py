"""What the nearness of the eye's base moves a section by, at the nodes of the library's walls (`library.base_bulge`).

The motion is smooth: it is found at a few places of the section and interpolated to where the plane meets the rings.
Those places are of a gap and a thickness that are about right; how the motion turns with these is below 1 um.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.base_bulge import base_push, section_places
from scleraforce.library.responses import Library

Array = NDArray[np.float64]

STATION_RAD = 0.04  # between the places


@dataclass(frozen=True, eq=False)
class Stations:
    """Places of a section and where the library's rings lie among them.

    `places_bpc`: unit vectors to them at rest, as `Library.base_bulge` takes them. A ring (boundary, left nodes and
    right ones), from the axis outwards on either side, lies between the place `left_bw` and the next one, by `share_bw`
    of the way.
    """

    library: Library
    places_bpc: Array
    left_bw: NDArray[np.intp]
    share_bw: Array

    def moved(self, place: tuple[Array, Array, Array], pole_s2: Array, alike: Sequence[int] | None = None) -> Array:
        """Return the motion of what the plane meets (sample, boundary, [left, right], node, 3), m.

        Args:
            place: of samples in the library's size: thickness, pressure over E and dent, (sample,) each.
            pole_s2: where the eye's pole lies (`base_bulge.pole_direction`).
            alike: for each sample the one whose motion under the pressure is about the same; None: its own.
        """
        thickness, ratio, _ = place
        own = sorted(set(alike)) if alike is not None else range(len(pole_s2))
        bulge = self.library.base_bulge(thickness[own], ratio[own], self.places_bpc, pole_s2[own])
        if alike is not None:
            bulge = bulge[[own.index(sample) for sample in alike]]
        pushed = base_push(self.library.forces(*place), thickness, self.library.poisson_ratio)
        bulge[..., :2] += (pushed[:, None] * pole_s2)[:, None, None, :]
        is_inner = np.array([[0], [1]])
        low, high = bulge[:, is_inner, self.left_bw], bulge[:, is_inner, self.left_bw + 1]
        at_rings: Array = low + self.share_bw[..., None] * (high - low)
        return at_rings.reshape(*at_rings.shape[:2], 2, -1, 3)


def section_stations(library: Library, gap_m: float, thickness_m: float) -> Stations:
    """Return the stations of sections about so far from the needle axis, of walls about so thick."""
    reach = np.sin(library.node_angles())
    count = int(np.ceil(library.node_angles()[-1] / STATION_RAD)) + 1
    stations = reach[-1] * np.linspace(-1.0, 1.0, 2 * count + 1)
    across = gap_m / (library.radius_m - np.array([[0.0], [thickness_m]]))
    rings = np.sqrt(np.maximum(reach**2 - across**2, 0.0))
    wanted = np.concatenate([-rings, rings], axis=1)
    left = np.clip(np.searchsorted(stations, wanted) - 1, 0, len(stations) - 2)
    share = (wanted - stations[left]) / (stations[left + 1] - stations[left])
    return Stations(library, section_places(stations, across), left, share)
