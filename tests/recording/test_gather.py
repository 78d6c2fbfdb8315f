"""Frames and forces of several sources, on one clock."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from format_frames import COUNT, FRAMES, pictures_of, write_log

from scleraforce.errors import InputError
from scleraforce.recording.scan import Times
from scleraforce.recording.sources import ImportOptions, gather, on_one_clock
from scleraforce.recording.tables import ForceLog


def log_at(first_s: float) -> ForceLog:
    return ForceLog(first_s + np.arange(10) / 200.0, np.zeros((10, 1)), ("fz_n",))


def test_a_stack_and_a_log_go_together_whatever_their_order(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", FRAMES)
    force_n = write_log(tmp_path / "log.csv")
    for sources in (["a.tif", "log.csv"], ["log.csv", "a.tif"]):
        seen: list[int] = []
        found = gather([tmp_path / name for name in sources], ImportOptions(), seen.append)
        np.testing.assert_array_equal(pictures_of(found.scan), FRAMES)
        np.testing.assert_allclose(found.log.force_n("fz"), force_n, atol=1e-7)
        assert not found.one_clock
        assert seen == [1, 1]


def test_pictures_of_a_folder_are_one_scan(tmp_path: Path) -> None:
    for nth, frame in enumerate(FRAMES):
        cv2.imwrite(str(tmp_path / f"frame{8 + nth}.png"), frame)
    found = gather([tmp_path], ImportOptions())
    np.testing.assert_array_equal(pictures_of(found.scan), FRAMES)
    assert found.notes == ()


def test_files_given_in_another_order_than_their_numbers_are_noted(tmp_path: Path) -> None:
    for nth in (9, 10):
        cv2.imwrite(str(tmp_path / f"f{nth}.png"), FRAMES[0])
    shell = sorted(tmp_path.iterdir())
    assert gather(shell, ImportOptions()).notes == (
        "frames are taken in the order given, f10.png to f9.png; their numbers have another",
    )


def test_sources_without_frames_or_with_two_logs_are_refused(tmp_path: Path) -> None:
    write_log(tmp_path / "a.csv")
    write_log(tmp_path / "b.csv")
    tifffile.imwrite(tmp_path / "a.tif", FRAMES)
    with pytest.raises(InputError, match=r"a\.csv: no frames in the sources"):
        gather([tmp_path / "a.csv"], ImportOptions())
    with pytest.raises(InputError, match=r"b\.csv: a second force log beside .*a\.csv"):
        gather([tmp_path / name for name in ("a.tif", "a.csv", "b.csv")], ImportOptions())


def test_clocks_that_count_from_1970_begin_at_a_whole_second_before_both() -> None:
    times = Times(1.7e9 + 3.5 + np.arange(COUNT), "tag")
    moved, log, origin_s = on_one_clock(times, log_at(1.7e9 + 2.25), 0.0)
    assert origin_s == 1.7e9 + 2
    assert (moved.time_s[0], log.time_s[0]) == pytest.approx((1.5, 0.25), abs=1e-6)


def test_an_offset_brings_the_frames_to_the_clock_of_the_log() -> None:
    moved, log, origin_s = on_one_clock(Times(np.arange(COUNT) * 1.0, "film"), log_at(40.0), 40.5)
    np.testing.assert_array_equal(moved.time_s, 40.5 + np.arange(COUNT))
    assert (log.time_s[0], origin_s) == (40.0, 0.0)


def test_frames_that_come_before_the_log_count_from_their_own_second() -> None:
    moved, log, origin_s = on_one_clock(Times(np.array([1e9 + 0.5]), "tag"), log_at(1e9 + 7.0), 0.0)
    assert (moved.time_s[0], log.time_s[0], origin_s) == (0.5, 7.0, 1e9)


def test_times_that_do_not_rise_are_refused() -> None:
    with pytest.raises(InputError, match="do not rise"):
        on_one_clock(Times(np.array([0.0, 0.0]), "tag"), None, 0.0)
