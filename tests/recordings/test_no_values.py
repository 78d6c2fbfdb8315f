"""Pixels without a value: not finite, fill values, single hot pixels."""

import numpy as np
import pytest

from scleraforce.recordings.formats.picture_streams import TOP, find_greys

FLT_MAX = float(np.finfo(np.float32).max)


def pictures(low: float = 0.0, high: float = 1.0, count: int = 3) -> list[np.ndarray]:
    """Speckle with its largest and smallest value in the first picture."""
    rng = np.random.default_rng(0)
    found = [
        (low + (high - low) * rng.beta(1.0, 6.0, (40, 50))).astype(np.float32)
        for _ in range(count)
    ]
    found[0][0, :2] = low, high
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
    frames = [frame.astype(wide) for frame in pictures(low, high)]
    plain = find_greys(frames, None, "a")
    assert (plain.low, plain.high, plain.lost, plain.words) == (low, high, 0, "")
    frames[1][5, 7] = value
    greys = find_greys(frames, None, "a")
    assert (greys.low, greys.high, greys.scaled) == (low, high, True)
    assert greys.words == f"1 pixel has no value and is 0: 1 {words}"
    counts = [greys.counts(frame) for frame in frames]
    assert counts[1][5, 7] == 0
    assert (counts[0].min(), counts[0].max()) == (0, TOP)
    np.testing.assert_array_equal(counts[2], plain.counts(frames[2]))


@pytest.mark.parametrize("value", [-9999.0, -1e6, FLT_MAX, np.nan])
def test_a_third_of_a_picture_may_have_no_value(value):
    frames = pictures()
    for frame in frames:
        frame[:, :17] = value

    frames[0][0, 20:22] = 0.0, 1.0
    greys = find_greys(frames, None, "a")
    assert (greys.low, greys.high, greys.lost) == (0.0, 1.0, 3 * 40 * 17)
    assert all((greys.counts(frame)[:, :17] == 0).all() for frame in frames)


def test_bright_and_dark_values_that_are_ones_stay():
    for low, high, values in (
        (0.0, 1.0, np.linspace(1.0, 50.0, 40)),  # a reflex, and its flanks
        (0.0, 1.0, [2.5]),
        (-20000.0, 20000.0, [-9999.0, 9999.0]),
        (-1200.0, 0.0, [-999.0]),
        (0.0, 9998.0, [9999.0]),
        (0.0, 1.0, np.full(40, 30.0)),  # too many to be single ones
    ):
        frames = pictures(low, high)
        frames[1][3, : len(values)] = values
        greys = find_greys(frames, None, "a")
        assert greys.lost == 0
        assert greys.low == min(low, *values)
        assert greys.high == pytest.approx(max(high, *values))


def test_black_around_the_scan_stays_a_value():
    frames = pictures(100.0, 110.0)
    for frame in frames:
        frame[:, 40:] = 0.0

    greys = find_greys(frames, None, "a")
    assert (greys.low, greys.high, greys.lost) == (0.0, 110.0, 0)


def test_a_stated_range_clips_all_but_what_is_no_number():
    frame = np.array([[0.2, 5.0, np.inf, -np.inf, np.nan, FLT_MAX, -9999.0]])
    greys = find_greys([frame], (0.0, 1.0), "a")
    assert greys.counts(frame).tolist() == [[13107, TOP, 0, 0, 0, 0, 0]]
    assert greys.words == (
        "4 pixels have no value and are 0: 3 not finite, 1 beyond 1e+30"
    )


def test_wide_whole_numbers_may_have_fill_values():
    frames = [(1e6 * frame).astype(np.int32) for frame in pictures()]
    frames[2][4, 4] = np.iinfo(np.int32).min
    greys = find_greys(frames, None, "a")
    assert (greys.low, greys.high, greys.lost) == (0.0, 1e6, 1)
