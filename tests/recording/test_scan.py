"""Several files as one scan, and the axes of arrays."""

from dataclasses import replace
from functools import partial
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from foreign_files import COLUMNS, FRAMES, ROWS, pictures_of

from scleraforce.errors import FrameError, InputError
from scleraforce.recording import scan as scans
from scleraforce.recording.pixels import Sourced
from scleraforce.recording.scan import AXES, Scan, Times, UnansweredError, array_scan, joined, parse_axes, rising


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


def test_frames_that_a_file_does_not_state_are_damage() -> None:
    for pictures, message in [
        ([], "damaged: 0 of 1 frames can be read"),
        ([FRAMES[0], FRAMES[1]], r"damaged: a frame of \(24, 40\), number 2"),
        ([FRAMES[0].T], r"damaged: a frame of \(40, 24\), number 1"),
    ]:
        scan = joined([replace(single(0), pictures=partial(iter, pictures))])
        with pytest.raises(FrameError, match=rf"0\.png: {message}"):
            list(scan.pictures())


def test_a_turned_scan_has_depth_for_width() -> None:
    turned = replace(single(0), depth_pixel_m=Sourced(1e-6, "d"), lateral_pixel_m=Sourced(2e-6, "l")).turned()
    np.testing.assert_array_equal(pictures_of(turned)[0], FRAMES[0].T)
    assert (turned.depth_pixel_m.source, turned.lateral_pixel_m.source) == ("l", "d")


def test_times_that_are_not_finite_do_not_rise() -> None:
    assert not rising(np.array([0.0, np.nan]))
    assert not rising(np.array([0.0, np.inf, np.inf]))


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


def test_axes_of_one_do_not_count() -> None:
    scan = array_scan(Path("a"), FRAMES[:, :, np.newaxis], AXES, tuple(Sourced(float(n), "") for n in range(4)))
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert (scan.depth_pixel_m.value, scan.lateral_pixel_m.value) == (1.0, 3.0)
    one = array_scan(Path("a"), FRAMES[:1], ("lateral", "frame", "depth"))
    np.testing.assert_array_equal(pictures_of(one)[0], FRAMES[0].T)
    assert one.names == ("a",)


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
