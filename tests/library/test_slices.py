"""Batches of slices against the general drawing of sections."""

import numpy as np
import pytest
from analytic_library import curves

from scleraforce.library.sections import cut_surfaces
from scleraforce.library.slices import Framing, column_laterals, draw_slices, fill_boundaries, wall_boundaries
from scleraforce.mechanics.contact import Section, SliceWindow
from scleraforce.mechanics.section import fill_section
from scleraforce.study import SliceStudy

STUDY = SliceStudy()
WINDOW = SliceWindow(left_m=-7e-3, top_m=0.0, columns=140, rows=40, pixel_m=1e-4)
COUNT = 60


def drawn(seed, turn_rad=0.0):
    """Random walls, planes and framings."""
    rng = np.random.default_rng(seed)
    walls = curves(rng.uniform(0.35e-3, 0.9e-3, COUNT), rng.uniform(1e-4, 6e-3, COUNT), rng.uniform(0.0, 6e-3, COUNT))
    framing = Framing(
        rng.uniform(-1e-3, 1e-3, COUNT),
        rng.uniform(0.1e-3, 0.8e-3, COUNT),
        rng.uniform(0.95, 1.05, COUNT),
        rng.uniform(-turn_rad, turn_rad, COUNT),
    )
    return walls, rng.uniform(0.3e-3, 1e-3, COUNT), rng.uniform(-0.2, 0.2, COUNT), framing


def placed_section(walls, gap, tilt, framing, sample):
    section = cut_surfaces(walls[sample], gap[sample], tilt[sample])
    return Section(*(framing.place(sample, curve) for curve in (section.outer, section.inner)))


def folded_walls():
    """A dent whose rim hangs over: X runs back between two rings."""
    wall = curves(0.5e-3, 1e-3, 4e-3).copy()
    wall[0, 40:55, 0] -= 1.5e-3 * np.sin(np.linspace(0.0, np.pi, 15))
    assert (np.diff(wall[0, :60, 0]) < 0.0).any()
    return wall[None]


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
        for depth, curve in zip(boundaries[sample], (section.outer, section.inner), strict=True):
            assert depth == pytest.approx(np.interp(column_laterals(STUDY), *curve.T), abs=2e-6)


@pytest.mark.parametrize("turn_rad", [0.0, 0.05])
def test_a_wall_that_hangs_over_is_drawn_by_its_contour(turn_rad):
    walls, gap, tilt = folded_walls(), np.array([0.5e-3]), np.array([0.03])
    framing = Framing(np.array([0.2e-3]), np.array([0.0]), np.array([1.0]), np.array([turn_rad]))
    boundaries = wall_boundaries(walls, gap, tilt, framing, STUDY)
    assert boundaries.folded.tolist() == [True]
    section = placed_section(walls, gap, tilt, framing, 0)
    assert np.array_equal(draw_slices(walls, gap, tilt, framing, STUDY)[0], fill_section(section, WINDOW))
    lateral, depth = section.outer.T
    for column, found in zip(column_laterals(STUDY), boundaries.depth_sbc[0, 0], strict=True):
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
