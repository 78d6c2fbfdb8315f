"""What another recording answers."""

import json
from pathlib import Path

import pytest
from small_recording import write_small_recording

from scleraforce.errors import RecordingError
from scleraforce.recording.importing import answers_like


def test_scanner_needle_and_sensor_of_a_recording_answer_and_its_eye_does_not(tmp_path: Path) -> None:
    assert answers_like(write_small_recording(tmp_path / "r")) == {
        "width_mm": 8.0, "depth_mm": 3.0, "refractive_index": 1.0, "bits": 12, "gauge": 22, "gap_mm": 0.5, "axis": "fz",
        "contact_sign": "-1", "average_s": 0.1,
    }  # fmt: skip


def test_answers_on_how_sources_were_read_are_kept_and_those_of_one_session_are_not(tmp_path: Path) -> None:
    folder = write_small_recording(tmp_path / "r", log=False)
    answers = {"axes": "frame,depth,lateral", "columns": ["fz=F:N"], "rate_hz": 4.0, "clock_offset_s": 3.0}
    (folder / "import.json").write_text(json.dumps({"answers": answers}))
    found = answers_like(folder)
    assert (found["axes"], found["columns"]) == ("frame,depth,lateral", ["fz=F:N"])
    assert not {"rate_hz", "clock_offset_s", "axis"} & set(found)


@pytest.mark.parametrize("text", ["", "[]", '{"answers": NaN}', '{"answers": 7}'])
def test_a_file_that_import_did_not_write_is_refused(tmp_path: Path, text: str) -> None:
    folder = write_small_recording(tmp_path / "r")
    (folder / "import.json").write_text(text)
    with pytest.raises(RecordingError, match=r"import\.json: "):
        answers_like(folder)
