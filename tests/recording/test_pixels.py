"""Pixels of any type become counts."""

import numpy as np
import pytest

from scleraforce.errors import FrameError, InputError
from scleraforce.recording.pixels import find_greys, one_grey

RAMP = np.arange(12).reshape(3, 4)


def test_whole_numbers_that_16_bits_hold_stay_as_they_are() -> None:
    for kind in ["u1", "u2", ">u2", "i2", "i4", "u8"]:
        picture = (RAMP * 20).astype(kind)
        counts = find_greys([picture], None, "a").counts(picture)
        np.testing.assert_array_equal(counts, RAMP * 20)
        assert counts.dtype == np.uint16
        turned = find_greys([picture.T], None, "a").counts(picture.T)
        np.testing.assert_array_equal(turned, RAMP.T * 20)
        assert turned.flags.c_contiguous


def test_negative_numbers_are_shifted_alike_in_all_frames() -> None:
    pictures = [(RAMP - 7).astype(np.int16), (RAMP + 100).astype(np.int16)]
    greys = find_greys(pictures, None, "a")
    np.testing.assert_array_equal(greys.counts(pictures[0]), RAMP)
    np.testing.assert_array_equal(greys.counts(pictures[1]), RAMP + 107)


def test_floats_are_scaled_from_the_smallest_of_all_frames_to_the_largest() -> None:
    pictures = [np.array([[-20.0, 0.0]]), np.array([[30.0, 5.0]])]
    greys = find_greys(pictures, None, "a")
    np.testing.assert_array_equal(greys.counts(pictures[0]), [[0, 26214]])  # 65535 * 20 / 50
    np.testing.assert_array_equal(greys.counts(pictures[1]), [[65535, 32768]])


def test_a_range_that_was_told_is_black_to_white_and_what_lies_beyond_is_cut() -> None:
    picture = np.array([[0, 10, 20, 30]], dtype=np.uint8)
    np.testing.assert_array_equal(find_greys([picture], (10.0, 20.0), "a").counts(picture), [[0, 0, 65535, 65535]])


def test_a_range_that_is_none_is_refused() -> None:
    for told in [(5.0, 5.0), (6.0, 5.0), (np.nan, 5.0)]:
        with pytest.raises(InputError, match="--grey-range"):
            find_greys([RAMP], told, "a")


def test_wide_numbers_are_scaled() -> None:
    picture = np.array([[0, 2**20]], dtype=np.int32)
    greys = find_greys([picture], None, "a")
    assert greys.scaled
    np.testing.assert_array_equal(greys.counts(picture), [[0, 65535]])


def test_what_is_no_number_becomes_black_and_is_counted() -> None:
    picture = np.array([[np.nan, 1.0, 3.0, -np.inf]])
    greys = find_greys([picture], None, "a")
    assert greys.lost == 2
    np.testing.assert_array_equal(greys.counts(picture), [[0, 0, 65535, 0]])


def test_pixels_in_which_there_is_nothing_to_see_are_refused() -> None:
    for picture in [np.full((2, 2), 0.5), np.full((2, 2), np.nan), np.ones((2, 2), complex)]:
        with pytest.raises(FrameError, match=r"scan\.tif: "):
            find_greys([picture], None, "scan.tif")


def test_colours_become_grey_and_grey_stays() -> None:
    grey = RAMP.astype(np.uint8)
    np.testing.assert_array_equal(one_grey(np.dstack([grey] * 3)), grey)
    assert one_grey(grey) is grey
