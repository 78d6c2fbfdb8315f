"""Linear displays are recognised from pairs of counts, and only their walls are looked
for in logarithms.
"""

import numpy as np
import pytest
from analytic_frames import SCALE, drawn_counts

from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.frame_light import as_logarithmic, pair_contrast

LINEAR = {"display": "linear", "snr_db": 20.0, "display_range_db": 38.0}


def speckle() -> np.ndarray:
    """Intensities whose mean falls from row to row, by 20 dB."""
    mean = np.logspace(0.0, -2.0, 400)[:, None]
    return mean * np.random.default_rng(1).exponential(size=(400, 500))


@pytest.mark.parametrize("largest", [200.0, 4000.0, 60000.0])
@pytest.mark.parametrize(("power", "expected"), [(1.0, 0.5), (0.5, 2.0 - np.sqrt(3.0))])
def test_the_contrast_of_pairs_is_that_of_speckle_whatever_the_gain(
    largest, power, expected
):
    shown = speckle() ** power
    dtype = np.uint8 if largest < 256 else np.uint16
    frame = (shown * largest / shown.max()).astype(dtype)
    assert pair_contrast(frame) == pytest.approx(expected, abs=0.04)
    assert (as_logarithmic(frame) is frame) == (power < 1.0)


def lit_pairs(rows: int, lost: bool = False) -> np.ndarray:
    """A frame with 8 lit pairs in each row, and a brighter pixel."""
    row = np.repeat(np.array([100, 300], dtype=np.uint16), 8)
    frame = np.tile(row, (rows, 1))
    frame[7, 3] *= not lost
    brightest = np.zeros((1, 16), dtype=np.uint16)
    brightest[0, 0] = 301
    return np.vstack([brightest, frame])


DARK = np.zeros((64, 64), dtype=np.uint16)
SHOWN = [
    drawn_counts(seed, display=kind)
    for kind in ("logarithmic", "root")
    for seed in range(7201, 7203)
]


@pytest.mark.parametrize("frame", [DARK, lit_pairs(24), lit_pairs(25, True), *SHOWN])
def test_other_displays_and_frames_with_hardly_any_light_stay_unchanged(frame):
    assert as_logarithmic(frame) is frame


def test_two_hundred_lit_pairs_tell_a_linear_display():
    assert as_logarithmic(lit_pairs(25)) is not lit_pairs(25)
    assert as_logarithmic(lit_pairs(25)).max() > 30_000


@pytest.mark.parametrize("share", [0.0, 0.01, 0.02])
def test_a_linear_display_is_recognised_where_it_saturates(share: float):
    """Saturated pixels are all alike, although the light is not."""
    shown = speckle()
    shown = (4095.0 * shown / np.quantile(shown, 1.0 - share)).clip(0, 4095)
    frame = shown.astype(np.uint16)
    assert as_logarithmic(frame) is not frame


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_logarithms_keep_order_and_black(dtype):
    frame = (speckle() * 30.0).clip(0, 255).astype(dtype)
    shown = as_logarithmic(frame)
    assert shown.dtype == np.uint16
    counts, first = np.unique(frame, return_index=True)
    levels = shown.ravel()[first].astype(float)
    assert (np.diff(levels) > 0.0).all()
    assert levels[0] == counts[0] == 0
    step = 65535.0 / np.log1p(np.iinfo(dtype).max)
    expected = step * np.log1p(counts[1:].astype(float))
    np.testing.assert_allclose(levels[1:], expected, rtol=1e-3)


@pytest.mark.parametrize("seed", range(7210, 7216))
def test_walls_of_linear_frames_are_found_as_in_logarithmic_ones(seed, shipped):
    """In the counts themselves both methods differ in most of these frames, which are
    then not usable.
    """
    frame = drawn_counts(seed, **LINEAR)
    logarithmic = drawn_counts(seed, **LINEAR | {"display": "logarithmic"})
    expected = find_wall(logarithmic, SCALE, finder=shipped)
    assert expected.usable
    for finder in (None, shipped):
        found = find_wall(frame, SCALE, finder=finder)
        alike = find_wall(as_logarithmic(frame), SCALE, finder=finder)
        np.testing.assert_array_equal(found.inner_row, alike.inner_row)
        assert found.usable, found.reason
        assert np.nanmedian(np.abs(found.outer_row - expected.outer_row)) < 1.0
        assert np.nanmedian(np.abs(found.inner_row - expected.inner_row)) < 3.0
