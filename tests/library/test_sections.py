"""Cuts of surfaces of revolution against the general cut of a 3-D mesh, and against rotating every ring by hand."""

from functools import cache

import numpy as np
import pytest
from analytic_library import RADIUS_M, curves
from scipy.optimize import brentq

from reference_walls import cut_section
from scleraforce.errors import InputError
from scleraforce.library.sections import cut_rings, cut_surfaces, highest_depths
from scleraforce.mechanics.contact import Contact, ScanPlane
from scleraforce.mechanics.mesh import build_mesh

PLANES = [(0.5e-3, 0.0, 0.0), (0.0, 0.0, 1.0), (0.8e-3, 0.12, 0.4), (0.4e-3, -0.2, -2.0), (1.2e-3, 0.05, 3.0)]


def naive_points(curve_nc, gap_m, tilt_rad, direction_rad):
    """(lateral, depth) of each ring, where turning its point about the needle axis brings it into the plane."""
    plane = ScanPlane(
        Contact(polar_rad=0.6, azimuth_rad=0.3), gap_m=gap_m, direction_rad=direction_rad, tilt_rad=tilt_rad
    )
    normal, origin = plane.contact.normal, plane.origin(RADIUS_M)
    found = []
    for distance, deep in curve_nc:

        def point(angle, distance=distance, deep=deep):
            around = np.cos(angle) * plane.contact.meridian + np.sin(angle) * plane.contact.parallel
            return (RADIUS_M - deep) * normal + distance * around - origin

        def height(angle, point=point):
            return point(angle) @ plane.normal

        # from the side of the plane's offset to the far side, on the positive lateral half
        along_offset = direction_rad + 0.5 * np.pi
        along_offset += 0.0 if height(along_offset) > height(along_offset + np.pi) else np.pi
        half = along_offset + np.pi if point(along_offset + 0.5 * np.pi) @ plane.lateral > 0 else along_offset - np.pi
        if height(along_offset) * height(half) < 0.0:
            at = point(brentq(height, along_offset, half, xtol=1e-14))
            found.append((at @ plane.lateral, at @ plane.depth))
    return np.array(found)


@pytest.mark.parametrize("plane", PLANES)
def test_rings_are_cut_where_turning_them_about_the_axis_meets_the_plane(plane):
    for tip_m in (0.0, 2e-3, 6e-3):
        for curve in curves(0.5e-3, 2e-3, tip_m)[:, ::3]:  # each ring is cut alone
            square, depth = cut_rings(curve, *plane[:2])
            met = square > 0.0
            assert met.sum() > 16
            expected = naive_points(curve, *plane)
            assert np.sqrt(square[met]) == pytest.approx(expected[:, 0], abs=1e-9)
            assert depth[met] == pytest.approx(expected[:, 1], abs=1e-9)


@cache
def fine_mesh(thickness_m):
    return build_mesh(RADIUS_M, thickness_m, 40, 1, 2)


@pytest.mark.parametrize("plane", PLANES[:4])
def test_the_section_is_that_of_the_general_cut_of_a_mesh(plane):
    """The wall of the analytic eye as nodal displacements of a 3-D mesh: within what its elements can follow."""
    gap_m, tilt_rad, direction_rad = plane
    thickness_m, tip_m, contact = 0.5e-3, 1.5e-3, Contact(polar_rad=0.3, azimuth_rad=0.7)
    mesh = fine_mesh(thickness_m)
    deep = RADIUS_M - mesh.points_nc @ contact.normal
    across = mesh.points_nc - (mesh.points_nc @ contact.normal)[:, None] * contact.normal
    arc = RADIUS_M * np.arctan2(np.linalg.norm(across, axis=1), RADIUS_M - deep)
    inward = tip_m * np.exp(-0.5 * (arc / 2.6e-3) ** 2)
    displacement = -inward[:, None] * contact.normal - 0.1 * np.exp(-0.5 * (arc / 3e-3) ** 2)[:, None] * across
    expected = cut_section(
        mesh, ScanPlane(contact, gap_m=gap_m, direction_rad=direction_rad, tilt_rad=tilt_rad), displacement
    )

    angle = np.linspace(0.0, 1.1, 400)
    radius = np.array([[RADIUS_M], [RADIUS_M - thickness_m]])
    inward = tip_m * np.exp(-0.5 * (RADIUS_M * angle / 2.6e-3) ** 2)
    distance = radius * np.sin(angle) * (1.0 - 0.1 * np.exp(-0.5 * (RADIUS_M * angle / 3e-3) ** 2))
    wall = np.stack([distance, RADIUS_M - radius * np.cos(angle) + inward], axis=-1)
    found = cut_surfaces(wall, gap_m, tilt_rad)
    for mine, general in ((found.outer, expected.outer), (found.inner, expected.inner)):
        near = general[np.abs(general[:, 0]) < 6e-3]
        assert np.interp(near[:, 0], *mine.T) == pytest.approx(near[:, 1], abs=6e-6)


def test_the_highest_point_agrees_with_the_section_s():
    rng = np.random.default_rng(0)
    gap, tilt = rng.uniform(0.0, 1.2e-3, 40), rng.uniform(-0.2, 0.2, 40)
    walls = curves(rng.uniform(0.4e-3, 0.9e-3, 40), 1e-3, rng.uniform(0.0, 5e-3, 40))
    expected = [cut_surfaces(*row).outer[:, 1].min() for row in zip(walls, gap, tilt, strict=True)]
    assert highest_depths(walls[:, 0], gap, tilt) == pytest.approx(expected, abs=1e-9)
    with pytest.raises(InputError, match="misses"):
        cut_surfaces(curves(0.5e-3, 1e-3, 0.0), 13e-3)
