"""Several files as one scan, the axes of arrays, and pixels as counts."""

from dataclasses import replace
from functools import partial
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from foreign_files import COLUMNS, FRAMES, ROWS, pictures_of

from scleraforce.errors import FrameError, InputError
from scleraforce.recording import scan as scans
from scleraforce.recording.pixels import Sourced, find_greys
from scleraforce.recording.scan import AXES, Scan, Times, UnansweredError, array_scan, joined, parse_axes


def single(nth: int, time_s: float | None = None, **stated: object) -> Scan:
    times = None if time_s is None else Times(np.array([time_s]), "its tag")
    pictures = lambda: iter(FRAMES[nth : nth + 1])  # noqa: E731
    return Scan(names=(f"{nth}.png",), rows=ROWS, columns=COLUMNS, pictures=pictures, times=times, **stated)


def test_files_come_in_the_order_of_their_times_or_else_as_given() -> None:
    scan = joined([single(2, 7.0), single(0, 3.0), single(1, 5.0)])
    assert scan.names == ("0.png", "1.png", "2.png")
    np.testing.assert_array_equal(scan.times.time_s, [3.0, 5.0, 7.0])
    for _ in range(2):  # pictures can be read twice
        np.testing.assert_array_equal(pictures_of(scan), FRAMES[:3])
    for times in [(1.0, None), (1.0, 1.0), (None, None)]:
        scan = joined([single(4, times[0]), single(0, times[1])])
        assert (scan.names, scan.times) == (("4.png", "0.png"), None)


def test_files_of_another_kind_are_refused_with_both_values() -> None:
    for other, found in [
        ({"bits": 8}, "bits 8, where 0.png has not stated"),
        ({"rows": ROWS + 1}, "rows 25, where 0.png has 24"),
        ({"depth_pixel_m": Sourced(1e-6, "tag")}, "depth of a pixel .* 1, where 0.png has not stated"),
        ({"lateral_pixel_m": Sourced(2e-6, "")}, "width of a pixel .* 2, where 0.png has not stated"),
    ]:
        with pytest.raises(FrameError, match=rf"1\.png: {found}"):
            joined([single(0), replace(single(1), **other)])
    assert joined([single(0), replace(single(1), scale_fault="a fault")]).scale_fault == "a fault"


def test_frames_that_a_file_does_not_state_are_damage() -> None:
    for pictures, message in [
        ([], "damaged: 0 of 1 frames can be read"),
        ([FRAMES[0], FRAMES[1]], r"damaged: a frame of \(24, 40\), number 2"),
        ([FRAMES[0].T], r"damaged: a frame of \(40, 24\), number 1"),
    ]:
        scan = joined([replace(single(0), pictures=partial(iter, pictures))])
        with pytest.raises(FrameError, match=rf"0\.png: {message}"):
            list(scan.pictures())


def test_more_bytes_than_one_source_may_have_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scans, "LARGEST_BYTES", 2**30)
    scans.check_bytes(2**30)
    with pytest.raises(FrameError, match="1 GiB at most"):
        scans.check_bytes(2**30 + 1)


def test_any_order_of_the_axes_gives_the_same_frames_and_scale() -> None:
    for order in list(permutations(AXES)):
        array = np.transpose(FRAMES, [AXES.index(name) for name in order])
        steps = {"frame": Sourced(9.0, ""), "depth": Sourced(1e-6, "d"), "lateral": Sourced(2e-6, "l")}
        scan = array_scan(Path("a.npy"), array, order, tuple(steps[name] for name in order))
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert (scan.depth_pixel_m, scan.lateral_pixel_m) == (steps["depth"], steps["lateral"])


def test_axes_that_are_open_or_do_not_fit_are_refused_with_the_sizes() -> None:
    for array, axes, kind, message in [
        (FRAMES, None, UnansweredError, r"^an array of 5 x 24 x 40: which axis.*; give --axes"),
        *((np.zeros(shape), AXES, FrameError, "give frames x rows x columns") for shape in ((5,), (2, 3, 4, 5), ())),
        (FRAMES, AXES[1:], FrameError, r"--axes names 2 axes \(depth,lateral\); the array is of 5 x 24 x 40"),
    ]:
        with pytest.raises(kind, match=message):
            array_scan(Path("a.npy"), array, axes)
    for text in ["x,y,z", "frame", "frame,depth", "depth,depth,lateral", ""]:
        with pytest.raises(InputError, match="--axes"):
            parse_axes(text)


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
