"""The pixels of a scan, unrolled along its wall and laid on other walls."""

from dataclasses import replace

import numpy as np
import pytest

from scleraforce.base.errors import FrameError
from scleraforce.lab.real_texture import ScanTexture, unrolled
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import OctStudy
from scleraforce.wall.wall import Segmentation

OCT = OctStudy()
SCALE = PixelScale.of(OCT)
LATERAL_M = (np.arange(OCT.columns) + 0.5) * SCALE.lateral_m - OCT.width_m / 2
ROW_M = (np.arange(OCT.rows) + 0.5)[:, None] * SCALE.depth_m
RNG = np.random.default_rng
THICKNESS_M = 0.6e-3
RADIUS_M = 12e-3


def round_surface(top_m: float, dent_m: float = 0.0) -> np.ndarray:
    """Depths of a round surface with a dent in its middle, (column,), m."""
    round_m = RADIUS_M - np.sqrt(RADIUS_M**2 - LATERAL_M**2)
    return top_m + round_m + dent_m * np.exp(-((LATERAL_M / 1.5e-3) ** 2))


def section_of(outer_m: np.ndarray, thickness_m: float) -> WallSection:
    """A wall that is even along its normal, wider than the frame."""
    slope = np.gradient(outer_m, LATERAL_M)
    normal = np.stack([-slope, np.ones_like(slope)]) / np.hypot(1.0, slope)
    outer = np.stack([LATERAL_M, outer_m])
    return WallSection(outer.T, (outer + thickness_m * normal).T)


def layered(section: WallSection, thickness_m: float) -> np.ndarray:
    """Air of 10, two halves of a wall of 100 and 60, and 30 below, (row, column)."""
    outer_m = np.interp(LATERAL_M, *section.outer.T)
    steep = np.hypot(1.0, np.gradient(outer_m, LATERAL_M))
    below = (ROW_M - outer_m) / steep / SCALE.refractive_index
    cuts = [below < 0.0, below < 0.5 * thickness_m, below < thickness_m]
    return np.select(cuts, [10, 100, 60], 30).astype(np.uint8)


def wall_of(section: WallSection, thickness_m: float) -> Segmentation:
    """The true wall of a layered frame."""
    outer_m = np.interp(LATERAL_M, *section.outer.T)
    steep = np.hypot(1.0, np.gradient(outer_m, LATERAL_M))
    outer_row = outer_m / SCALE.depth_m - 0.5
    below = thickness_m * steep * SCALE.refractive_index / SCALE.depth_m
    rows = outer_row, outer_row + below, OCT.rows
    return Segmentation(*rows, True, "", True, thickness_m=thickness_m)


@pytest.mark.parametrize("dent_m", [0.0, 1.2e-3])
@pytest.mark.parametrize("thickness_m", [THICKNESS_M, 0.45e-3])
def test_layers_follow_the_bent_wall_at_their_distance(
    dent_m: float, thickness_m: float
):
    """Also stretched to another thickness; away from their edges to a count. What lies
    far below a dent is below the scan's last row.
    """
    rest = section_of(round_surface(0.6e-3), THICKNESS_M)
    frame = layered(rest, THICKNESS_M)
    texture = unrolled(frame, SCALE, wall_of(rest, THICKNESS_M), 255)
    bent = section_of(round_surface(0.4e-3, dent_m), thickness_m)
    laid = texture.laid_on(bent, OCT, RNG(0)) / 4095.0 * 255.0
    expected = layered(bent, thickness_m)
    middle = np.abs(LATERAL_M) < 5e-3
    off = np.abs(laid - expected)[:, middle]
    for count in (10, 100, 60):
        of_layer = off[expected[:, middle] == count]
        assert (of_layer < 30.0).mean() > 0.985
        # a row or two at each edge are between two layers
        assert (of_layer < 1.5).mean() > 0.9


def test_a_short_scan_is_continued_by_its_mirror_image_and_other_grains_keep_the_mean():
    rest = section_of(round_surface(0.6e-3), THICKNESS_M)
    mean = layered(rest, THICKNESS_M).astype(float)
    speckle = RNG(1).gamma(4.0, 0.25, mean.shape)
    frame = np.clip(mean * speckle, 0, 255).astype(np.uint8)
    wall = wall_of(rest, THICKNESS_M)
    narrow = np.abs(LATERAL_M) > 2e-3
    wall.outer_row[narrow] = np.nan
    texture = unrolled(frame, SCALE, wall, 255)
    assert texture.light.shape[1] * texture.column_m == pytest.approx(4e-3, rel=0.05)
    laid = texture.laid_on(rest, OCT, RNG(0)).astype(float) / 4095.0 * 255.0
    is_wall = (mean == 100) & (np.abs(LATERAL_M) < 6e-3)
    assert laid[is_wall].mean() == pytest.approx(100.0, rel=0.05)
    assert laid[is_wall].std() > 20.0

    again = texture.grained_anew(RNG(2))
    other = again.laid_on(rest, OCT, RNG(0)).astype(float) / 4095.0 * 255.0
    assert other[is_wall].mean() == pytest.approx(100.0, rel=0.05)
    assert other[is_wall].std() == pytest.approx(laid[is_wall].std(), rel=0.15)
    assert np.corrcoef(other[is_wall], laid[is_wall])[0, 1] < 0.3
    np.testing.assert_array_equal(
        texture.grained_anew(RNG(2)).light, again.light, strict=True
    )


def test_beyond_the_scan_lies_air_and_columns_without_a_wall_are_black():
    """Rows above those of the scan have its air."""
    rest = section_of(round_surface(0.2e-3), THICKNESS_M)
    frame = layered(rest, THICKNESS_M)
    frame[:20] = RNG(0).integers(5, 15, (20, OCT.columns))
    texture = unrolled(frame, SCALE, wall_of(rest, THICKNESS_M), 255)
    assert isinstance(texture, ScanTexture)
    deep = section_of(round_surface(2.0e-3), THICKNESS_M)
    half = WallSection(deep.outer[:256], deep.inner[:256])
    laid = texture.laid_on(half, OCT, RNG(0))
    assert not laid[:, 260:].any()
    top = laid[:50, 120:250] / 4095.0 * 255.0
    assert 4.0 < top.min() <= top.max() < 16.0


def test_a_wall_whose_end_is_not_seen_is_not_stretched():
    """What the segmentation assumes of its thickness is not the scan's."""
    rest = section_of(round_surface(0.6e-3), THICKNESS_M)
    wall = replace(wall_of(rest, THICKNESS_M), inner_found=False)
    texture = unrolled(layered(rest, THICKNESS_M), SCALE, wall, 255)
    assert np.isnan(texture.thickness_m)
    thin = section_of(round_surface(0.6e-3), 0.5 * THICKNESS_M)
    laid = texture.laid_on(thin, OCT, RNG(0)) / 4095.0 * 255.0
    middle = np.abs(LATERAL_M) < 5e-3
    expected = layered(rest, THICKNESS_M)[:, middle]
    off = np.abs(laid[:, middle] - expected)
    assert (off[expected == 60] < 30.0).mean() > 0.985


def test_hardly_any_surface_is_refused_in_a_sentence():
    rest = section_of(round_surface(0.6e-3), THICKNESS_M)
    wall = wall_of(rest, THICKNESS_M)
    wall.outer_row[np.abs(LATERAL_M) > 0.3e-3] = np.nan
    frame = layered(rest, THICKNESS_M)
    with pytest.raises(FrameError, match=r"0\.6 mm of the wall's surface are seen"):
        unrolled(frame, SCALE, wall, 255)
