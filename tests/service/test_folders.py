"""The folders are tried at the start: what could not be kept later is one line now."""

from pathlib import Path

import pytest

from scleraforce.errors import InputError
from scleraforce.service.black_box.decision_log import DecisionLog
from scleraforce.service.startup import try_folders


def refusal(black_box: Path, record: Path | None = None) -> str:
    with pytest.raises(InputError) as refused:
        try_folders(black_box, record)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_folders_that_can_be_written_are_left_as_the_black_box_finds_them(tmp_path: Path) -> None:
    for _ in range(2):
        try_folders(tmp_path / "a" / "box", tmp_path / "b" / "session")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a", "box", "decisions-000001.jsonl", "log"]


def test_a_black_box_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    assert "Not a directory" in refusal(tmp_path / "file" / "box")
    assert "File name too long" in refusal(tmp_path / ("x" * 300))
    assert "/proc/box" in refusal(Path("/proc/box"))
    assert (tmp_path / "file").read_text() == "mine"


def test_a_black_box_of_another_monitor_is_refused(tmp_path: Path) -> None:
    other = DecisionLog(tmp_path / "log")
    assert "in use by another monitor" in refusal(tmp_path)
    other.close()


def test_a_recording_that_could_not_be_made_is_refused_before_anything_is(tmp_path: Path) -> None:
    box = tmp_path / "box"
    (tmp_path / "there").mkdir()
    (tmp_path / "file").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    assert "exists already" in refusal(box, tmp_path / "there")
    assert "exists already" in refusal(box, tmp_path / "link")
    assert "Not a directory" in refusal(box, tmp_path / "file" / "session")
    assert "File name too long" in refusal(box, tmp_path / ("x" * 300))
    assert "--record /proc/session" in refusal(box, Path("/proc/session"))
    assert "the folder of the black box is there" in refusal(box, box)
    assert "the folder of the black box is there" in refusal(box / "inside", box)
    assert not box.exists()
