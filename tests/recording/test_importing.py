"""Options of another recording, and times of frames."""

import json
from contextlib import closing
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from foreign_files import COLUMNS, FRAMES, ROWS
from small_recordings import write_small_recording

from scleraforce.errors import InputError, RecordingError
from scleraforce.notebook.importing import import_recording
from scleraforce.recording.folder import EyeInfo, ForceInfo, NeedleInfo, OctInfo, RecordingInfo
from scleraforce.recording.importing import answers_like, given_times
from scleraforce.recording.scan import Scan
from scleraforce.recording.tables import ForceLog
from scleraforce.recording.writing import RecordingWriter, write_log, written
from scleraforce.whole_files import folder_when_whole


def test_scanner_needle_and_sensor_of_a_recording_answer_and_its_eye_does_not(tmp_path: Path) -> None:
    assert answers_like(write_small_recording(tmp_path / "r")) == {
        "width_mm": 8.0, "depth_mm": 3.0, "refractive_index": 1.0, "bits": 12, "gauge": 22, "gap_mm": 0.5, "axis": "fz",
        "contact_sign": "-1", "average_s": 0.1,
    }  # fmt: skip


def test_answers_on_the_form_of_sources_are_kept_and_answers_of_one_session_are_not(tmp_path: Path) -> None:
    folder = write_small_recording(tmp_path / "r", log=False)
    answers = {"axes": "frame,depth,lateral", "columns": ["fz=F:N"], "rate_hz": 4.0, "clock_offset_s": 3.0}
    (folder / "import.json").write_text(json.dumps({"answers": answers}))
    found = answers_like(folder)
    assert (found["axes"], found["columns"]) == ("frame,depth,lateral", ["fz=F:N"])
    assert not {"rate_hz", "clock_offset_s", "axis"} & set(found)


def test_a_file_that_import_did_not_write_is_refused(tmp_path: Path) -> None:
    for text in ["", "[]", '{"answers": NaN}', '{"answers": 7}']:
        place = Path(mkdtemp(dir=tmp_path))
        folder = write_small_recording(place / "r")
        (folder / "import.json").write_text(text)
        with pytest.raises(RecordingError, match=r"import\.json: "):
            answers_like(folder)


SCAN = Scan(names=("x/b.png", "x/a.png"), rows=2, columns=2, pictures=lambda: iter(()))


def times(folder: Path, text: str) -> list[float]:
    (folder / "times.csv").write_text(text)
    return given_times(SCAN, folder / "times.csv", None).time_s.tolist()


def test_a_table_goes_by_the_names_of_frames_or_else_by_their_order(tmp_path: Path) -> None:
    assert times(tmp_path, "file,time_s\na.png,7\nb.png,5\nother.png,9\n") == [5.0, 7.0]
    assert times(tmp_path, "Time (ms)\n250\n500\n") == [0.25, 0.5]
    assert times(tmp_path, "file,time_s\nc.png,1\nd.png,2\n") == [1.0, 2.0]


def test_a_rate_counts_from_zero() -> None:
    np.testing.assert_array_equal(given_times(SCAN, None, 4.0).time_s, [0.0, 0.25])
    assert given_times(SCAN, None, None) is None


def test_a_table_that_does_not_go_with_the_frames_is_refused(tmp_path: Path) -> None:
    for text, message in [
        ("time_s\n1\n2\n3\n", "3 times for 2 frames"),
        ("frame,when\na.png,1\n", "no column of times with its unit.*'frame', 'when'"),
        ("time_s\n1\nx\n", r"times\.csv:3: time_s: 'x' is not a number"),
    ]:
        with pytest.raises(InputError, match=message):
            times(tmp_path, text)


def test_a_table_and_a_rate_exclude_each_other() -> None:
    with pytest.raises(InputError, match="--rate-hz"):
        given_times(SCAN, Path("a.csv"), 4.0)


INFO = RecordingInfo(
    EyeInfo("e"),
    OctInfo(columns=COLUMNS, rows=ROWS, bits=13, width_m=0.01, depth_m=0.004),
    NeedleInfo(gauge=22, slice_gap_m=0.0),
    ForceInfo("fz", -1),
)


def write_all(folder: Path, log: ForceLog) -> None:
    with closing(RecordingWriter(folder, INFO, "a comment")) as writer:
        for nth, frame in enumerate(FRAMES):
            writer.add(f"{nth}.png", 0.5 + nth / 3.0, frame)
    write_log(folder, log)


def test_forces_come_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    log = ForceLog(np.arange(500) / 333.0, rng.normal(0.0, 0.02, (500, 2)), ("fz_n", "tx_nm"))
    write_all(tmp_path / "r", log)
    found = written(tmp_path / "r", tmp_path / "r").forces
    np.testing.assert_allclose(found.time_s, log.time_s, atol=1e-6)
    np.testing.assert_allclose(found.wrench_sc, log.wrench_sc, rtol=1e-6)
    assert found.columns == log.columns


def test_a_log_that_no_command_could_read_is_named_by_its_final_folder(tmp_path: Path) -> None:
    write_all(tmp_path / "part", ForceLog(np.arange(10) / 10.0, np.zeros((10, 1)), ("fz_n",)))
    with pytest.raises(RecordingError, match=rf"^{tmp_path}/out/forces\.csv: time_s: 10 samples a second; at least 20"):
        written(tmp_path / "part", tmp_path / "out")


def test_a_fault_leaves_nothing(tmp_path: Path) -> None:
    def half() -> None:
        with folder_when_whole(tmp_path / "out") as part:
            part.mkdir()
            (part / "half").touch()
            raise RuntimeError

    with pytest.raises(RuntimeError):
        half()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_there_stays(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    for name in ("out", "link"):
        with pytest.raises(InputError, match=f"{name}: exists already"):
            import_recording("a.png", tmp_path / name)
