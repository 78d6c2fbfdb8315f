"""The globe turns about its centre, by a slow drift and small saccades, while needle and scanner stand still.

A sphere looks the same then, but the needle stands elsewhere on it: nearer to the base or to the limbus, where an
uneven wall is thicker or thinner. What turns with the globe is all of it, its supports and its weight, too. Left out is
how the surface of an eye that is no sphere moves in space: with semi-axes 12 % apart, a turn of 3 degrees lifts it by
up to 80 um, less than the eye shifts, and leans it by up to 0.7 degrees.
"""

from dataclasses import dataclass
from math import acos, atan2, pi

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from scleraforce.eye.contact import Contact
from scleraforce.section.plane import ScanPlane
from scleraforce.study import PhantomStudy, draw

Floats = NDArray[np.float64]

SACCADE_S = 1.0  # from one saccade to the next


@dataclass(frozen=True, kw_only=True)
class EyeTurn:
    """A rotation of the globe, from where it stood at the start, by its vector: about the eye's x and y axes, rad.

    It has no part about the eye's axis: gaze moves so (Listing's law).
    """

    about_x_rad: float
    about_y_rad: float


STILL = EyeTurn(about_x_rad=0.0, about_y_rad=0.0)


def turned_plane(plane: ScanPlane, turn: EyeTurn) -> ScanPlane:
    """Return the plane of the B-scan, and with it the contact, as the turned eye sees them.

    >>> plane = ScanPlane(Contact(polar_rad=0.6), gap_m=0.5e-3)
    >>> to_the_needle = EyeTurn(about_x_rad=0.0, about_y_rad=0.05)
    >>> round(turned_plane(plane, to_the_needle).contact.polar_rad, 6)
    0.55
    """
    back = Rotation.from_rotvec([-turn.about_x_rad, -turn.about_y_rad, 0.0])
    normal, lateral = back.apply(plane.contact.normal), back.apply(plane.lateral)
    contact = Contact(polar_rad=acos(min(normal[2], 1.0)), azimuth_rad=atan2(normal[1], normal[0]))
    direction_rad = atan2(lateral @ contact.parallel, lateral @ contact.meridian)
    return ScanPlane(contact, gap_m=plane.gap_m, direction_rad=direction_rad, tilt_rad=plane.tilt_rad)


def farthest_turn_rad(phantom: PhantomStudy) -> float:
    """Return how far an eye turns at most; 0 where it stands still."""
    return phantom.eye_drift_rad.bounds[1] + phantom.eye_saccade_rad.bounds[1]


def draw_turns(phantom: PhantomStudy, times_s: Floats, rng: np.random.Generator) -> tuple[EyeTurn, ...]:
    """Draw where the eye is turned to at ascending times (frame,).

    A drift to one side, which grows evenly up to its whole at the last time; off it, to a side that is drawn every
    `SACCADE_S`, a saccade.
    """
    drift_rad, heading = draw(phantom.eye_drift_rad, rng), _unit_vectors(rng, 1)
    count = int(times_s[-1] / SACCADE_S) + 1
    saccades = phantom.eye_saccade_rad.sample(rng, count)[:, None] * _unit_vectors(rng, count)
    turns = drift_rad * (times_s / times_s[-1])[:, None] * heading + saccades[(times_s / SACCADE_S).astype(np.intp)]
    return tuple(EyeTurn(about_x_rad=x, about_y_rad=y) for x, y in turns.tolist())


def _unit_vectors(rng: np.random.Generator, count: int) -> Floats:
    """Draw directions in the plane, (count, 2)."""
    angles = rng.uniform(-pi, pi, count)
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)
