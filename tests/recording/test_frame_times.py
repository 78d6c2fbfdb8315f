"""Times of frames that somebody states beside them."""

from pathlib import Path

import numpy as np
import pytest

from scleraforce.errors import InputError
from scleraforce.recording.importing import told_times
from scleraforce.recording.scan import Scan

SCAN = Scan(names=("x/b.png", "x/a.png"), rows=2, columns=2, pictures=lambda: iter(()))


def times(folder: Path, text: str) -> list[float]:
    (folder / "times.csv").write_text(text)
    return told_times(SCAN, folder / "times.csv", None).time_s.tolist()


def test_a_table_with_names_goes_by_them(tmp_path: Path) -> None:
    assert times(tmp_path, "file,time_s\na.png,7\nb.png,5\nother.png,9\n") == [5.0, 7.0]


def test_a_table_without_them_goes_by_order(tmp_path: Path) -> None:
    assert times(tmp_path, "Time (ms)\n250\n500\n") == [0.25, 0.5]
    assert times(tmp_path, "file,time_s\nc.png,1\nd.png,2\n") == [1.0, 2.0]


def test_a_rate_counts_from_zero() -> None:
    np.testing.assert_array_equal(told_times(SCAN, None, 4.0).time_s, [0.0, 0.25])
    assert told_times(SCAN, None, None) is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time_s\n1\n2\n3\n", "3 times for 2 frames"),
        ("frame,when\na.png,1\n", "no column of times with its unit.*'frame', 'when'"),
        ("time_s\n1\nx\n", r"times\.csv:3: time_s: 'x' is not a number"),
    ],
)
def test_a_table_that_does_not_go_with_the_frames_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        times(tmp_path, text)


def test_a_table_and_a_rate_are_one_too_many() -> None:
    with pytest.raises(InputError, match="--rate-hz"):
        told_times(SCAN, Path("a.csv"), 4.0)
