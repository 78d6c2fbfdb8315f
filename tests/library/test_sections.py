"""Cuts of surfaces of revolution against the general cut of a 3-D mesh; slices of
walls.
"""

from functools import cache

import numpy as np
import pytest
from analytic_library import RADIUS_M, curves

from reference_walls import cut_section
from scleraforce.base.errors import InputError
from scleraforce.library.plane_cut import (
    Framing,
    column_laterals,
    cut_surfaces,
    draw_slices,
    fill_boundaries,
    highest_depths,
    wall_boundaries,
)
from scleraforce.mechanics.contact_and_section import (
    Contact,
    ScanPlane,
    SliceWindow,
    WallSection,
)
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.mesh_section import fill_section
from scleraforce.records.study import SliceStudy

PLANES = [
    (0.5e-3, 0.0, 0.0),
    (0.0, 0.0, 1.0),
    (0.8e-3, 0.12, 0.4),
    (0.4e-3, -0.2, -2.0),
]


@cache
def fine_mesh(thickness_m):
    return build_mesh(RADIUS_M, thickness_m, 40, 1, 2)


@pytest.mark.parametrize("plane", PLANES)
def test_the_section_is_that_of_the_general_cut_of_a_mesh(plane):
    """The wall of the analytic eye as nodal displacements of a 3-D mesh: within what
    its elements can follow.
    """
    gap_m, tilt_rad, direction_rad = plane
    thickness_m = 0.5e-3
    tip_m = 1.5e-3
    contact = Contact(polar_rad=0.3, azimuth_rad=0.7)
    mesh = fine_mesh(thickness_m)
    deep = RADIUS_M - mesh.points_nc @ contact.normal
    across = (
        mesh.points_nc - (mesh.points_nc @ contact.normal)[:, None] * contact.normal
    )
    arc = RADIUS_M * np.arctan2(np.linalg.norm(across, axis=1), RADIUS_M - deep)
    inward = tip_m * np.exp(-0.5 * (arc / 2.6e-3) ** 2)
    displacement = (
        -inward[:, None] * contact.normal
        - 0.1 * np.exp(-0.5 * (arc / 3e-3) ** 2)[:, None] * across
    )
    plane = ScanPlane(
        contact, gap_m=gap_m, direction_rad=direction_rad, tilt_rad=tilt_rad
    )
    expected = cut_section(mesh, plane, displacement)

    angle = np.linspace(0.0, 1.1, 400)
    radius = np.array([[RADIUS_M], [RADIUS_M - thickness_m]])
    inward = tip_m * np.exp(-0.5 * (RADIUS_M * angle / 2.6e-3) ** 2)
    distance = (
        radius
        * np.sin(angle)
        * (1.0 - 0.1 * np.exp(-0.5 * (RADIUS_M * angle / 3e-3) ** 2))
    )
    wall = np.stack([distance, RADIUS_M - radius * np.cos(angle) + inward], axis=-1)
    found = cut_surfaces(wall, gap_m, tilt_rad)

    for mine, general in ((found.outer, expected.outer), (found.inner, expected.inner)):
        near = general[np.abs(general[:, 0]) < 6e-3]
        assert np.interp(near[:, 0], *mine.T) == pytest.approx(near[:, 1], abs=6e-6)


def test_the_highest_point_agrees_with_the_section_s():
    rng = np.random.default_rng(0)
    gap = rng.uniform(0.0, 1.2e-3, 40)
    tilt = rng.uniform(-0.2, 0.2, 40)
    walls = curves(rng.uniform(0.4e-3, 0.9e-3, 40), 1e-3, rng.uniform(0.0, 5e-3, 40))
    expected = [
        cut_surfaces(*row).outer[:, 1].min()
        for row in zip(walls, gap, tilt, strict=True)
    ]
    assert highest_depths(walls[:, 0], gap, tilt) == pytest.approx(expected, abs=1e-9)

    with pytest.raises(InputError, match="misses"):
        cut_surfaces(curves(0.5e-3, 1e-3, 0.0), 13e-3)


STUDY = SliceStudy()
WINDOW = SliceWindow(left_m=-7e-3, top_m=0.0, columns=140, rows=40, pixel_m=1e-4)
COUNT = 60


def drawn(seed, turn_rad=0.0):
    """Random walls, planes and framings."""
    rng = np.random.default_rng(seed)
    walls = curves(
        rng.uniform(0.35e-3, 0.9e-3, COUNT),
        rng.uniform(1e-4, 6e-3, COUNT),
        rng.uniform(0.0, 6e-3, COUNT),
    )
    framing = Framing(
        rng.uniform(-1e-3, 1e-3, COUNT),
        rng.uniform(0.1e-3, 0.8e-3, COUNT),
        rng.uniform(0.95, 1.05, COUNT),
        rng.uniform(-turn_rad, turn_rad, COUNT),
    )

    return (
        walls,
        rng.uniform(0.3e-3, 1e-3, COUNT),
        rng.uniform(-0.2, 0.2, COUNT),
        framing,
    )


def placed_section(walls, gap, tilt, framing, sample):
    section = cut_surfaces(walls[sample], gap[sample], tilt[sample])
    return WallSection(
        *(framing.place(sample, curve) for curve in (section.outer, section.inner))
    )


def folded_walls():
    """A dent whose rim hangs over: X runs back between two rings."""
    wall = curves(0.5e-3, 1e-3, 4e-3).copy()
    wall[0, 40:55, 0] -= 1.5e-3 * np.sin(np.linspace(0.0, np.pi, 15))
    assert (np.diff(wall[0, :60, 0]) < 0.0).any()
    return wall[None]


def test_between_rings_the_depth_is_linear_in_the_square_of_the_lateral_place():
    walls, gap_m, tilt_rad, _ = drawn(12)
    above_the_equator = walls[:, :, :64]
    for wall, gap, tilt in zip(above_the_equator, gap_m, tilt_rad, strict=True):
        section = cut_surfaces(wall, gap, tilt)
        for (distance, deep), curve in zip(
            np.moveaxis(wall, -1, 1), (section.outer, section.inner), strict=True
        ):
            square = distance**2 - (gap + deep * np.tan(tilt)) ** 2
            assert (np.diff(curve[:, 0]) > 0.0).all()
            assert curve[[0, -1], 0] == pytest.approx(
                np.sqrt(square[-1]) * np.array([-1.0, 1.0])
            )
            assert curve[:, 1] == pytest.approx(
                np.interp(curve[:, 0] ** 2, square, deep / np.cos(tilt)), abs=1e-12
            )


@pytest.mark.parametrize("turn_rad", [0.0, 0.08])
def test_slices_show_the_cut_section_but_for_centres_on_its_boundary(turn_rad):
    eyes = drawn(11, turn_rad)
    images = draw_slices(*eyes, STUDY)
    boundaries = wall_boundaries(*eyes, STUDY).depth_sbc
    centres = (np.arange(40) + 0.5)[:, None] * 1e-4

    for sample, image in enumerate(images):
        section = placed_section(*eyes, sample)
        expected = fill_section(section, WINDOW)
        close = (np.abs(boundaries[sample][:, None] - centres) < 2e-6).any(axis=0)
        assert np.array_equal(image[~close], expected[~close])
        assert close.mean() < 0.01

        for depth, curve in zip(
            boundaries[sample], (section.outer, section.inner), strict=True
        ):
            assert depth == pytest.approx(
                np.interp(column_laterals(STUDY), *curve.T), abs=2e-6
            )


@pytest.mark.parametrize("turn_rad", [0.0, 0.05])
def test_a_wall_that_hangs_over_is_drawn_by_its_contour(turn_rad):
    walls = folded_walls()
    gap = np.array([0.5e-3])
    tilt = np.array([0.03])
    framing = Framing(
        np.array([0.2e-3]), np.array([0.0]), np.array([1.0]), np.array([turn_rad])
    )
    boundaries = wall_boundaries(walls, gap, tilt, framing, STUDY)
    assert boundaries.folded.tolist() == [True]
    section = placed_section(walls, gap, tilt, framing, 0)
    assert np.array_equal(
        draw_slices(walls, gap, tilt, framing, STUDY)[0], fill_section(section, WINDOW)
    )
    lateral, depth = section.outer.T

    for column, found in zip(
        column_laterals(STUDY), boundaries.depth_sbc[0, 0], strict=True
    ):
        crossings = [
            np.interp(column, lateral[k : k + 2][order], depth[k : k + 2][order])
            for k in range(len(lateral) - 1)
            if (order := np.argsort(lateral[k : k + 2])) is not None
            and lateral[k : k + 2].min() <= column <= lateral[k : k + 2].max()
        ]
        assert found == pytest.approx(min(crossings), abs=3e-6)


def test_boundaries_that_cross_enclose_the_wall_all_the_same():
    depth = np.array([[[1.0e-3], [1.4e-3]], [[1.4e-3], [1.0e-3]]])
    image = fill_boundaries(depth, SliceStudy(columns=8))
    assert np.array_equal(image[0], image[1])
    assert image[0, :, 0].nonzero()[0].tolist() == [10, 11, 12, 13]
