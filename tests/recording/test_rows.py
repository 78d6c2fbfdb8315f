"""Rows of frames: labels of the recording, answers of a file."""

import csv
import json
from io import StringIO
from pathlib import Path

import pytest
from format_frames import with_log
from small_recording import write_small_recording

from scleraforce.errors import InputError
from scleraforce.recording.export import csv_text, frame_rows, read_answers, with_answers
from scleraforce.recording.folder import read_recording
from scleraforce.recording.labels import label_frames
from scleraforce.study import ClassesStudy

CLASSES = ClassesStudy()


def test_rows_have_the_labels_of_the_recording(tmp_path: Path) -> None:
    recording = read_recording(with_log(write_small_recording(tmp_path / "r", frames=30)))
    labels = label_frames(recording, CLASSES)
    rows = frame_rows(recording, CLASSES)
    assert [row["measured_force_mn"] for row in rows] == pytest.approx([each.measured_force_n * 1e3 for each in labels])
    assert [row["target"] for row in rows] == [each.target for each in labels]
    assert rows[3] | {"measured_force_mn": 0, "target": 0} == {
        "file": "0003.png", "time_s": 1.03, "pierced": False, "measured_force_mn": 0, "target": 0,
    }  # fmt: skip
    silent = read_recording(write_small_recording(tmp_path / "s", log=False))
    assert frame_rows(silent, CLASSES)[0]["measured_force_mn"] is None


def test_answers_join_the_rows_of_their_frames_with_the_classes_of_their_model(tmp_path: Path) -> None:
    rows = [{"file": f"{n}.png", "time_s": float(n), "target": 1} for n in range(3)]
    answers = [
        {"file": "/else/where/1.png", "predicted": 2, "target": 0, "time_s": 9.0},
        {"file": "2.png", "recording": str(tmp_path / "other"), "predicted": 7},
        {"file": "0.png", "recording": "old/place/r", "predicted": 0},
    ]
    joined = with_answers(rows, answers, tmp_path / "r")
    assert [row.get("predicted") for row in joined] == [0, 2, None]
    assert [row["target"] for row in joined] == [1, 0, 1]
    assert [row["time_s"] for row in joined] == [0.0, 1.0, 2.0]
    with pytest.raises(InputError, match="none of its frames is among the answers"):
        with_answers(rows, [{"file": "9.png"}], tmp_path / "r")


def test_frames_of_one_name_in_two_folders_keep_their_own_answers(tmp_path: Path) -> None:
    rows = [{"file": file, "target": None} for file in ("1.png", "a/1.png", "b/1.png")]
    answers = [{"file": "a/1.png", "predicted": 1}, {"file": "b/1.png", "predicted": 2}]
    assert [row.get("predicted") for row in with_answers(rows, answers, tmp_path)] == [None, 1, 2]


def test_a_table_has_a_column_for_each_number_of_any_row() -> None:
    rows = [
        {"file": "a, b.png", "usable": True, "interval_mn": [1.5, None], "needle": {"tip": {"x": 1}}},
        {"file": "c.png", "usable": False, "interval_mn": None, "reason": "dark"},
    ]
    found = list(csv.DictReader(StringIO(csv_text(rows))))
    assert found[0] | {"file": "a, b.png"} == {
        "file": "a, b.png", "usable": "1", "interval_low_mn": "1.5", "interval_high_mn": "", "needle_tip_x": "1",
        "reason": "",
    }  # fmt: skip
    assert (found[1]["usable"], found[1]["reason"], found[1]["needle_tip_x"]) == ("0", "dark", "")


@pytest.mark.parametrize(
    "text",
    [
        "[]", "{}", '{"frames": 3}', '{"frames": [{"a": 1}]}', "{", '{"frames": [NaN]}', '{"frames": [{"file": 1}]}',
        '{"frames": [{"file": "x", "recording": 1}]}',
    ],
)  # fmt: skip
def test_a_file_that_is_no_answers_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=r"a\.json: "):
        read_answers(tmp_path / "a.json")
    (tmp_path / "a.json").write_text(json.dumps({"frames": [{"file": "x"}]}))
    assert read_answers(tmp_path / "a.json") == [{"file": "x"}]
