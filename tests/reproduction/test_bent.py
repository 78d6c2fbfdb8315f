"""The calibrations of the bent eyes: what their progress bar counts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from stiffened_library import made_up_library

from scleraforce.calibration.calibrate import calibration_passes
from scleraforce.reproduction import readings, stages
from scleraforce.reproduction.run import open_run
from scleraforce.study import Study


@dataclass(frozen=True)
class Frames:
    """Stands for a recording: as many frames."""

    frames: Sequence[int]


def test_the_bar_is_as_long_as_the_frames_that_both_calibrations_go_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search of the stiffening goes through each frame several times; linear mechanics once."""
    library, counted = made_up_library(), []

    def calibrate(recordings: Sequence[Frames], *others: Any, progress: Callable[[int], None], **_: Any) -> None:
        passes = calibration_passes(others[-1], None)
        progress(passes * sum(len(recording.frames) for recording in recordings))

    pushes = {eye.id: range(len(forces_n)) for eye, forces_n in readings.bent_trials(Study())}
    monkeypatch.setattr(readings, "read_recording", lambda path: Frames(pushes[path.name]))
    monkeypatch.setattr(readings, "calibrate_recordings", calibrate)
    monkeypatch.setattr(readings, "calibration_as_json", lambda _: {})
    monkeypatch.setattr(readings, "write_calibration", lambda *_: None)
    for module in (readings, stages):
        monkeypatch.setattr(module, "run_library", lambda *_: library)
    run = open_run(tmp_path / "out", Study(), 1)
    readings.calibrate_bent(run, counted.append)
    assert len(counted) == 2
    assert stages._bent_frames(run) == sum(counted) > sum(len(frames) for frames in pushes.values())
