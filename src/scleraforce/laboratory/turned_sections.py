"""Sections of an eye that turns, from its load paths at three contacts, whatever the number of frames.

The contacts are those of the start, and of turns about the eye's x and y axes as far as it turns at all. To any other
turn a section goes evenly, at equal force and at equal distance along its curves from the needle's place. Against paths
at a frame's own contact, up to 4 degrees away on walls that wave by 12 % three times around, it is off by 6 um and
0.05 mN at dents up to 3 mm, by 18 um and 0.1 mN at 6 mm; the nearest of five contacts is off by up to 0.5 mN.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.eye_movement import STILL, EyeTurn
from scleraforce.section.plane import Section

Floats = NDArray[np.float64]


class TurnedSections:
    """An eye's sections for needle forces in N where it is turned to, from those at a few turns, the knots."""

    def __init__(self, knots: Sequence[Callable[[Sequence[float]], Sequence[Section]]], reach_rad: float) -> None:
        """Take the functions that give the sections at each of `knot_turns(reach_rad)`."""
        self.knots, self.reach_rad = tuple(knots), reach_rad

    def __call__(self, forces_n: Sequence[float]) -> Sequence[Section]:
        """Return the sections of the eye as it stands at the start; the load paths of all knots are then known."""
        return self.turned(forces_n, [STILL] * len(forces_n))

    def turned(self, forces_n: Sequence[float], turns: Sequence[EyeTurn]) -> Sequence[Section]:
        """Return the sections where the eye is turned to at each force."""
        at_knots = [knot(forces_n) for knot in self.knots]
        return [
            _blend(sections, knot_weights(turn, self.reach_rad))
            for turn, *sections in zip(turns, *at_knots, strict=True)
        ]


def knot_turns(reach_rad: float) -> tuple[EyeTurn, ...]:
    """Return the turns of the knots, for eyes that turn by up to `reach_rad`."""
    return STILL, replace(STILL, about_x_rad=reach_rad), replace(STILL, about_y_rad=reach_rad)


def knot_weights(turn: EyeTurn, reach_rad: float) -> Floats:
    """Return the weights of the knots at a turn, (knot,); they add up to 1.

    >>> knot_weights(EyeTurn(about_x_rad=0.01, about_y_rad=-0.02), 0.04)
    array([ 1.25,  0.25, -0.5 ])
    """
    x, y = turn.about_x_rad / reach_rad, turn.about_y_rad / reach_rad
    return np.array([1.0 - x - y, x, y])


def _blend(sections: Sequence[Section], weights: Floats) -> Section:
    """Return the weighted sum of sections, point by point along their curves, as far as all of them go."""
    return Section(
        _blend_curves([section.outer for section in sections], weights),
        _blend_curves([section.inner for section in sections], weights),
    )


def _blend_curves(curves: Sequence[Floats], weights: Floats) -> Floats:
    along = [_from_needle_m(curve) for curve in curves]
    first_m, last_m = max(distance[0] for distance in along), min(distance[-1] for distance in along)
    shared_m = along[0][(along[0] >= first_m) & (along[0] <= last_m)]
    blended = np.zeros((len(shared_m), 2))
    for weight, distance, curve in zip(weights, along, curves, strict=True):
        blended += weight * np.stack([np.interp(shared_m, distance, axis) for axis in curve.T], axis=1)
    return blended


def _from_needle_m(curve: Floats) -> Floats:
    """Return how far along a curve its points lie from where it passes the needle, at lateral 0; (point,), m."""
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    nearest = int(np.abs(curve[:, 0]).argmin())
    beside = slice(max(nearest - 1, 0), nearest + 2)
    distance: Floats = along_m - np.interp(0.0, curve[beside, 0], along_m[beside])
    return distance
