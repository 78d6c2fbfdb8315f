"""Which axis of an array is which."""

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from format_frames import FRAMES, pictures_of

from scleraforce.errors import FrameError, InputError
from scleraforce.recording.pixels import Sourced
from scleraforce.recording.scan import AXES, UnansweredError, array_scan, parse_axes


@pytest.mark.parametrize("order", list(permutations(AXES)))
def test_any_order_of_the_axes_gives_the_same_frames_and_scale(order: tuple[str, ...]) -> None:
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


def test_open_axes_are_asked_for_with_the_sizes() -> None:
    with pytest.raises(UnansweredError, match=r"a\.npy: an array of 5 x 24 x 40: which axis.*; give --axes"):
        array_scan(Path("a.npy"), FRAMES, None)


@pytest.mark.parametrize("array", [np.zeros(5), np.zeros((2, 3, 4, 5)), np.zeros(())])
def test_arrays_that_are_no_frames_are_refused(array: np.ndarray) -> None:
    with pytest.raises(FrameError, match="give frames x rows x columns"):
        array_scan(Path("a"), array, AXES)


def test_names_of_another_number_of_axes_are_refused() -> None:
    with pytest.raises(FrameError, match=r"--axes names 2 axes \(depth,lateral\); the array is of 5 x 24 x 40"):
        array_scan(Path("a"), FRAMES, ("depth", "lateral"))


@pytest.mark.parametrize("text", ["x,y,z", "frame", "frame,depth", "depth,depth,lateral", ""])
def test_names_that_are_no_axes_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="--axes"):
        parse_axes(text)
