"""Imported recordings are written whole or not at all."""

from pathlib import Path

import numpy as np
import pytest
from format_frames import COLUMNS, FRAMES, ROWS

from scleraforce.errors import InputError, RecordingError
from scleraforce.recording.folder import EyeInfo, ForceInfo, NeedleInfo, OctInfo, RecordingInfo
from scleraforce.recording.tables import ForceLog
from scleraforce.recording.writing import folder_when_whole, write_frames, write_log, written

INFO = RecordingInfo(
    EyeInfo("e"),
    OctInfo(columns=COLUMNS, rows=ROWS, bits=13, width_m=0.01, depth_m=0.004),
    NeedleInfo(gauge=22, slice_gap_m=0.0),
    ForceInfo("fz", -1),
)


def write_all(folder: Path, log: ForceLog) -> None:
    frames = ((f"{nth}.png", 0.5 + nth / 3.0, frame) for nth, frame in enumerate(FRAMES))
    write_frames(folder, INFO, "a comment", frames)
    write_log(folder, log)


def test_frames_and_forces_come_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    log = ForceLog(np.arange(500) / 333.0, rng.normal(0.0, 0.02, (500, 2)), ("fz_n", "tx_nm"))
    write_all(tmp_path / "r", log)
    recording = written(tmp_path / "r", tmp_path / "r")
    for entry, frame in zip(recording.frames, FRAMES, strict=True):
        np.testing.assert_array_equal(recording.frame(entry), frame)
    np.testing.assert_allclose([entry.time_s for entry in recording.frames], 0.5 + np.arange(5) / 3.0, atol=1e-6)
    np.testing.assert_allclose(recording.forces.time_s, log.time_s, atol=1e-6)
    np.testing.assert_allclose(recording.forces.wrench_sc, log.wrench_sc, rtol=1e-6)
    assert recording.forces.columns == log.columns
    assert recording.info == INFO


def test_a_log_that_no_command_could_read_is_named_as_it_was_to_be(tmp_path: Path) -> None:
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
        with pytest.raises(InputError, match=f"{name}: exists already"), folder_when_whole(tmp_path / name):
            pass
