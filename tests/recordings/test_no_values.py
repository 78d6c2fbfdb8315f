"""Pixels as counts; those without a value: not finite, fill values, hot pixels."""

import numpy as np
import pytest

from scleraforce.base.errors import InputError
from scleraforce.recordings.formats.picture_streams import TOP, find_greys

FLT_MAX = float(np.finfo(np.float32).max)
RAMP = 20 * np.arange(12).reshape(3, 4)


@pytest.mark.parametrize("kind", ["u1", "u2", ">u2", "i2", "i4", "u8"])
def test_small_whole_numbers_stay_counts(kind):
    for picture in (RAMP.astype(kind), RAMP.astype(kind).T):
        greys = find_greys([picture], None, "a")
        counts = greys.counts(picture)
        np.testing.assert_array_equal(counts, picture)
        assert (greys.scaled, counts.dtype) == (False, np.uint16)
        assert counts.flags.c_contiguous


def test_signed_numbers_begin_at_zero_in_all_frames():
    frames = [(RAMP + shift).astype(np.int16) for shift in (-7, 100)]
    greys = find_greys(frames, None, "a")
    assert not greys.scaled
    for frame in frames:
        np.testing.assert_array_equal(greys.counts(frame), frame + 7)


@pytest.mark.parametrize(
    ("values", "given", "counts"),
    [
        ([-20.0, 0.0, 30.0, 5.0], None, [0, 26214, TOP, 32768]),
        (np.array([0, 10, 20, 30], np.uint8), (10.0, 20.0), [0, 0, TOP, TOP]),
        (np.array([0, 2**20], np.int32), None, [0, TOP]),
        (
            [0.2, 5.0, np.inf, -np.inf, np.nan, FLT_MAX, -9999.0],
            (0.0, 1.0),
            [13107, TOP, 0, 0, 0, 0, 0],
        ),
    ],
)
def test_other_numbers_are_scaled_to_their_range_or_a_stated_one(values, given, counts):
    picture = np.array([values])
    greys = find_greys([picture], given, "a")
    assert greys.scaled
    assert greys.counts(picture).tolist() == [counts]


@pytest.mark.parametrize("given", [(5.0, 5.0), (6.0, 5.0), (np.nan, 5.0)])
def test_a_range_that_is_none_is_refused(given):
    with pytest.raises(InputError, match="`grey_range`"):
        find_greys([RAMP], given, "scan.tif")


@pytest.mark.parametrize("value", [0.5, np.nan, 1j])
def test_pixels_without_a_difference_are_refused(value):
    with pytest.raises(InputError, match=r"scan\.tif: "):
        find_greys([np.full((2, 2), value)], None, "scan.tif")


def pictures(low=0.0, high=1.0):
    """Speckle with its largest and smallest value in the first picture."""
    rng = np.random.default_rng(0)
    found = (low + (high - low) * rng.beta(1.0, 6.0, (3, 40, 50))).astype(np.float32)
    found[0, 0, :2] = low, high
    return found


@pytest.mark.parametrize(
    ("low", "high", "value", "words"),
    [
        (0.0, 1.0, FLT_MAX, "beyond 1e+30"),
        (0.0, 1.0, -FLT_MAX, "beyond 1e+30"),
        (0.0, 1.0, np.inf, "not finite"),
        (0.0, 1.0, -np.inf, "not finite"),
        (0.0, 1.0, np.nan, "not finite"),
        (0.0, 1.0, -9999.0, "of -9999"),
        (0.0, 4095.0, -9999.0, "of -9999"),
        (-60.0, 10.0, -999.0, "of -999"),
        (0.0, 1.0, 9999.0, "of 9999"),
        (0.0, 200.0, 1e20, "of 1e+20"),
        (0.0, 200.0, 5000.0, "single ones outside 0 to 200"),
        (0.0, 1.0, -40.0, "single ones outside 0 to 1"),
    ],
)
@pytest.mark.parametrize("wide", [np.float32, np.float64])
def test_values_that_are_none_are_black_and_do_not_compress_the_others(
    low, high, value, words, wide
):
    frames = pictures(low, high).astype(wide)
    plain = find_greys(frames, None, "a")
    assert (plain.low, plain.high, plain.lost, plain.words) == (low, high, 0, "")
    frames[1, 5, 7] = value
    greys = find_greys(frames, None, "a")
    assert (greys.low, greys.high, greys.scaled) == (low, high, True)
    assert greys.words == f"1 pixel has no value and is 0: 1 {words}"
    assert greys.counts(frames[1])[5, 7] == 0
    assert greys.counts(frames[0])[0, :2].tolist() == [0, TOP]
    np.testing.assert_array_equal(greys.counts(frames[2]), plain.counts(frames[2]))


@pytest.mark.parametrize("value", [-9999.0, -1e6, FLT_MAX, np.nan])
def test_a_third_of_a_picture_may_have_no_value(value):
    frames = pictures()
    frames[:, :, :17] = value
    frames[0, 0, 20:22] = 0.0, 1.0
    greys = find_greys(frames, None, "a")
    assert (greys.low, greys.high, greys.lost) == (0.0, 1.0, 3 * 40 * 17)
    assert not any(greys.counts(frame)[:, :17].any() for frame in frames)


@pytest.mark.parametrize(
    ("low", "high", "values"),
    [
        (0.0, 1.0, np.linspace(1.0, 50.0, 40)),  # a reflex, and its flanks
        (0.0, 1.0, [2.5]),
        (-20000.0, 20000.0, [-9999.0, 9999.0]),
        (-1200.0, 0.0, [-999.0]),
        (0.0, 9998.0, [9999.0]),
        (0.0, 1.0, np.full(40, 30.0)),  # too many to be single ones
    ],
)
def test_bright_and_dark_values_that_are_ones_stay(low, high, values):
    frames = pictures(low, high)
    frames[1, 3, : len(values)] = values
    greys = find_greys(frames, None, "a")
    assert (greys.lost, greys.low) == (0, min(low, *values))
    assert greys.high == pytest.approx(max(high, *values))


def test_black_around_the_scan_stays_a_value():
    frames = pictures(100.0, 110.0)
    frames[:, :, 40:] = 0.0
    greys = find_greys(frames, None, "a")
    assert (greys.low, greys.high, greys.lost) == (0.0, 110.0, 0)


def test_wide_whole_numbers_may_have_fill_values():
    frames = (1e6 * pictures()).astype(np.int32)
    frames[2, 4, 4] = np.iinfo(np.int32).min
    greys = find_greys(frames, None, "a")
    assert (greys.low, greys.high, greys.lost) == (0.0, 1e6, 1)
