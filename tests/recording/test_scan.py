"""Several files of frames as one scan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from format_frames import COLUMNS, FRAMES, ROWS, pictures_of

from scleraforce.errors import FrameError
from scleraforce.recording import scan as scans
from scleraforce.recording.pixels import Sourced
from scleraforce.recording.scan import Scan, Times, check_bytes, joined, rising


def single(nth: int, time_s: float | None = None, **stated: object) -> Scan:
    times = None if time_s is None else Times(np.array([time_s]), "its tag")
    pictures = lambda: iter(FRAMES[nth : nth + 1])  # noqa: E731
    return Scan(names=(f"{nth}.png",), rows=ROWS, columns=COLUMNS, pictures=pictures, times=times, **stated)


def test_files_with_times_come_in_their_order_whatever_the_order_given() -> None:
    scan = joined([single(2, 7.0), single(0, 3.0), single(1, 5.0)])
    assert scan.names == ("0.png", "1.png", "2.png")
    np.testing.assert_array_equal(scan.times.time_s, [3.0, 5.0, 7.0])
    np.testing.assert_array_equal(pictures_of(scan), FRAMES[:3])


@pytest.mark.parametrize("times", [(1.0, None), (1.0, 1.0), (None, None)])
def test_files_of_which_not_all_state_a_time_of_their_own_come_as_given(times: tuple[float | None, ...]) -> None:
    scan = joined([single(4, times[0]), single(0, times[1])])
    assert scan.names == ("4.png", "0.png")
    assert scan.times is None


def test_pictures_can_be_gone_through_twice() -> None:
    scan = joined([single(0), single(1)])
    np.testing.assert_array_equal(pictures_of(scan), pictures_of(scan))


@pytest.mark.parametrize(
    ("other", "found"),
    [
        ({"bits": 8}, "bits 8, where 0.png has not stated"),
        ({"rows": ROWS + 1}, "rows 25, where 0.png has 24"),
        ({"depth_pixel_m": Sourced(1e-6, "tag")}, "depth of a pixel .* 1, where 0.png has not stated"),
        ({"lateral_pixel_m": Sourced(2e-6, "")}, "width of a pixel .* 2, where 0.png has not stated"),
    ],
)
def test_files_of_another_kind_are_refused_with_both_values(other: dict[str, object], found: str) -> None:
    with pytest.raises(FrameError, match=rf"1\.png: {found}"):
        joined([single(0), replace(single(1), **other)])


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        ([], "damaged: 0 of 1 frames can be read"),
        ([FRAMES[0], FRAMES[1]], r"damaged: a frame of \(24, 40\), number 2"),
        ([FRAMES[0].T], r"damaged: a frame of \(40, 24\), number 1"),
    ],
)
def test_frames_that_a_file_does_not_state_are_damage(pictures: list[np.ndarray], message: str) -> None:
    scan = joined([replace(single(0), pictures=lambda: iter(pictures))])
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
    check_bytes(Path("a"), 2**30)
    with pytest.raises(FrameError, match="1 GiB at most"):
        check_bytes(Path("a"), 2**30 + 1)
