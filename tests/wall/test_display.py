"""Linear displays are recognised from pairs of counts, and only their walls are looked
for in logarithms.
"""

from functools import partial

import numpy as np
import pytest
from analytic_frames import SCALE, drawn_counts
from hypothesis import given, strategies as st

from scleraforce.wall import frame_light
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.frame_light import as_logarithmic, pair_contrast
from scleraforce.wall.wall_network import WallFinder

LINEAR = {"display": "linear", "snr_db": 20.0, "display_range_db": 38.0}


def speckle(seed: int = 1, shape: tuple[int, int] = (400, 500)) -> np.ndarray:
    """Intensities whose mean falls from row to row, by 20 dB."""
    mean = np.logspace(0.0, -2.0, shape[0])[:, None]
    return mean * np.random.default_rng(seed).exponential(size=shape)


@pytest.mark.parametrize(
    ("largest", "dtype"), [(200.0, np.uint8), (4000.0, np.uint16), (60000.0, np.uint16)]
)
@pytest.mark.parametrize(("power", "expected"), [(1.0, 0.5), (0.5, 2.0 - np.sqrt(3.0))])
def test_the_contrast_of_pairs_is_that_of_speckle_whatever_the_gain(
    largest, dtype, power, expected
) -> None:
    shown = speckle() ** power
    frame = (shown * largest / shown.max()).astype(dtype)
    assert pair_contrast(frame) == pytest.approx(expected, abs=0.04)


def contrast_by_arrays(frame: np.ndarray) -> float:
    rows = frame[:: max(1, len(frame) // frame_light.LOOKED_AT_ROWS)].astype(np.int32)
    one = rows[:, frame_light.PAIR_COLUMNS :]
    other = rows[:, : -frame_light.PAIR_COLUMNS]
    lit = (one > 0) & (other > 0)
    one = one[lit]
    other = other[lit]

    if len(one) < frame_light.LEAST_PAIRS:
        return 0.0

    total = one + other
    place = int(frame_light.DIMMER * len(total))
    mean = total >> 1
    brightest = mean >= np.partition(mean, place)[place]
    shares = np.abs(one - other)[brightest].astype(np.float32) / total[
        brightest
    ].astype(np.float32)

    return float(np.median(shares))


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([3, 255, 4095, 65535]),
    st.sampled_from([0.0, 0.3, 0.99]),
)
def test_the_contrast_agrees_with_arrays(seed: int, largest: int, black: float) -> None:
    """To the last bit, in frames of any size and light."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(16, 300, 2).tolist())
    frame = rng.integers(0, largest + 1, shape).astype(
        np.uint8 if largest < 256 else np.uint16
    )
    frame[rng.random(shape) < black] = 0
    assert pair_contrast(frame) == contrast_by_arrays(frame)


def test_other_displays_and_frames_with_hardly_any_light_stay_unchanged() -> None:
    dark = np.zeros((2, 64, 64), dtype=np.uint16)
    dark[1, 10, ::8] = [100, 4000] * 4
    shown = (
        drawn_counts(seed, display=kind)
        for kind in ("logarithmic", "root")
        for seed in range(7201, 7205)
    )

    for frame in (*dark, *shown):
        assert as_logarithmic(frame) is frame


@pytest.mark.parametrize(("rows", "contrast"), [(24, 0.0), (25, 0.5)])
def test_two_hundred_lit_pairs_tell_a_contrast_and_fewer_do_not(
    rows: int, contrast: float
) -> None:
    # 8 pairs a row
    frame = np.tile(np.repeat(np.array([100, 300], dtype=np.uint16), 8), (rows, 1))
    assert pair_contrast(frame) == contrast
    frame[7, 3] = 0
    assert pair_contrast(frame) == 0.0


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_logarithms_keep_order_and_black(dtype: type) -> None:
    frame = (speckle() * 30.0).clip(0, 255).astype(dtype)
    assert pair_contrast(frame) > frame_light.NOT_LOGARITHMIC
    shown = as_logarithmic(frame)
    assert shown.dtype == np.uint16
    counts, first = np.unique(frame, return_index=True)
    levels = shown.ravel()[first].astype(float)
    assert (np.diff(levels) > 0.0).all()
    assert levels[0] == counts[0] == 0
    step = np.log1p(counts[1:].astype(float))
    np.testing.assert_allclose(
        levels[1:] / step, 65535.0 / np.log1p(np.iinfo(dtype).max), rtol=1e-3
    )


def test_walls_of_linear_frames_are_found_as_in_logarithmic_ones(
    shipped: WallFinder,
) -> None:
    """In the counts themselves both methods differ in most of these frames, which are
    then not usable.
    """
    for seed in range(7210, 7216):
        frame = drawn_counts(seed, **LINEAR)
        logarithmic = drawn_counts(seed, **(LINEAR | {"display": "logarithmic"}))
        expected = find_wall(logarithmic, SCALE, finder=shipped)
        assert expected.usable

        for way in (find_wall, partial(find_wall, finder=shipped)):
            found = way(frame, SCALE)
            np.testing.assert_array_equal(
                found.inner_row, way(as_logarithmic(frame), SCALE).inner_row
            )
            assert found.usable, found.reason
            assert np.nanmedian(np.abs(found.outer_row - expected.outer_row)) < 1.0
            assert np.nanmedian(np.abs(found.inner_row - expected.inner_row)) < 3.0
