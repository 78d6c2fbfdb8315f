"""Surfaces of revolution, cut by the plane of the B-scan: closed form.

A surface consists of rings at distance r from the needle axis and depth d below the undeformed contact. In the frame of
`section.plane.ScanPlane` (gap g, tilt tau) the point of the plane at lateral X and depth Y lies at X along the lateral
axis, g + Y sin(tau) along the offset, and Y cos(tau) deep. So the plane meets the ring (r, d) at

    Y = d / cos(tau),   X^2 = r^2 - (g + d tan(tau))^2,

if that is not negative: on both sides of the needle axis alike, whatever the direction of the plane. Between two rings
of the library, Y is interpolated linearly in X^2: that is exact for a parabola, also at X = 0, where X itself grows
like a square root along the surface.
"""

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import InputError
from scleraforce.library.responses import INNER, OUTER
from scleraforce.section.plane import Section

Floats = NDArray[np.float64]

PARTS = 4  # points of a section for each ring of the surface
PARTS_MIDDLE = 12  # between X = 0 and the first ring that the plane meets


def cut_rings(curves: NDArray[np.floating], gap_m: Floats | float, tilt_rad: Floats | float) -> tuple[Floats, Floats]:
    """Return X^2 (..., node), m^2, and Y (..., node), m, of the rings; X^2 is negative where the plane misses one.

    Args:
        curves: distance from the needle axis and depth of the rings (..., node, 2), m.
        gap_m: distance of the plane from the needle axis, m; broadcasts against (..., node).
        tilt_rad: its tilt about its lateral axis.
    """
    distance, deep = curves[..., 0].astype(np.float64), curves[..., 1].astype(np.float64)
    return distance**2 - (gap_m + deep * np.tan(tilt_rad)) ** 2, deep / np.cos(tilt_rad)


def cut_surfaces(curves_bnc: NDArray[np.floating], gap_m: float, tilt_rad: float = 0.0) -> Section:
    """Cut a wall, two surfaces of revolution about the needle axis.

    Args:
        curves_bnc: outer and inner surface (boundary, node, 2): distance from the needle axis and depth, m, from the
            axis outwards (one sample of `Responses.curves_sbnc`).
        gap_m: distance of the plane from the needle axis, m.
        tilt_rad: turns the plane about its lateral axis.

    Returns:
        The section, from negative to positive lateral side, in the order of the material.

    Raises:
        InputError: the plane does not cut through both surfaces.
    """
    square_bn, depth_bn = cut_rings(curves_bnc, gap_m, tilt_rad)
    return Section(*(section_curve(square_bn[boundary], depth_bn[boundary]) for boundary in (OUTER, INNER)))


def highest_depths(curves_snc: NDArray[np.floating], gap_m: Floats, tilt_rad: Floats) -> Floats:
    """Return the smallest depth of the section of each surface (sample,), m.

    Args:
        curves_snc: one surface for each sample (sample, node, 2), m.
        gap_m: distance of its plane (sample,), m.
        tilt_rad: tilt of its plane (sample,).

    Raises:
        InputError: a plane misses its surface.
    """
    square, depth = cut_rings(curves_snc, gap_m[:, None], tilt_rad[:, None])
    first, middle = _middle(square, depth)
    beyond = np.arange(square.shape[1]) > first[:, None]
    highest: Floats = np.minimum(np.where(beyond, depth, np.inf).min(axis=1), middle)
    return highest


def _middle(square: Floats, depth: Floats) -> tuple[NDArray[np.intp], Floats]:
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
    """Return one boundary (points, 2) from X^2 and Y of its rings (node,), from negative to positive lateral side.

    Raises:
        InputError: the plane misses the last ring.
    """
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
