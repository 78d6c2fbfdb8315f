"""Pixels of any type become counts."""

import numpy as np
import pytest

from scleraforce.errors import FrameError, InputError
from scleraforce.recording.pixels import find_greys, one_grey

RAMP = np.arange(12).reshape(3, 4)


def test_pixels_of_any_type_become_counts_by_one_map_of_all_frames() -> None:
    small = np.array([[0, 10, 20, 30]], dtype=np.uint8)
    for pictures, given, counts, scaled, lost in [
        *(([(RAMP * 20).astype(kind)], None, [RAMP * 20], False, 0) for kind in ("u1", "u2", ">u2", "i2", "i4", "u8")),
        ([(RAMP * 20).T], None, [RAMP.T * 20], False, 0),
        ([(RAMP - 7).astype(np.int16), (RAMP + 100).astype(np.int16)], None, [RAMP, RAMP + 107], False, 0),
        ([np.array([[-20.0, 0.0]]), np.array([[30.0, 5.0]])], None, [[[0, 26214]], [[65535, 32768]]], True, 0),
        ([small], (10.0, 20.0), [[[0, 0, 65535, 65535]]], True, 0),
        ([np.array([[0, 2**20]], dtype=np.int32)], None, [[[0, 65535]]], True, 0),
        ([np.array([[np.nan, 1.0, 3.0, -np.inf]])], None, [[[0, 0, 65535, 0]]], True, 2),
    ]:
        greys = find_greys(pictures, given, "a")
        assert (greys.scaled, greys.lost) == (scaled, lost)
        for picture, expected in zip(pictures, counts, strict=True):
            found = greys.counts(picture)
            np.testing.assert_array_equal(found, expected)
            assert found.dtype == np.uint16
            assert found.flags.c_contiguous


def test_a_range_or_pixels_without_a_difference_are_refused() -> None:
    for given in [(5.0, 5.0), (6.0, 5.0), (np.nan, 5.0)]:
        with pytest.raises(InputError, match="--grey-range"):
            find_greys([RAMP], given, "a")
    for picture in [np.full((2, 2), 0.5), np.full((2, 2), np.nan), np.ones((2, 2), complex)]:
        with pytest.raises(FrameError, match=r"scan\.tif: "):
            find_greys([picture], None, "scan.tif")


def test_colours_become_grey_and_grey_stays() -> None:
    grey = RAMP.astype(np.uint8)
    np.testing.assert_array_equal(one_grey(np.dstack([grey] * 3)), grey)
    assert one_grey(grey) is grey
