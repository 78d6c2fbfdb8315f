"""Readings of a reproduction: both calibrations count their frames, and slices are labelled for another modulus."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from analytic_library import made_up_library

from scleraforce.calibration.calibrate import calibration_passes
from scleraforce.learning.classifier import classes_at_modulus
from scleraforce.mechanics.contact import Contact, ScanPlane
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.mesh import build_mesh
from scleraforce.mechanics.section import cut_sections
from scleraforce.reproduction import readings, stages
from scleraforce.reproduction.run import open_run
from scleraforce.study import ClassesStudy, Study


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
    monkeypatch.setattr(readings, "run_library", lambda *_: library)
    run = open_run(tmp_path / "out", Study(), 1)
    readings.calibrate_bent(run, counted.append)
    assert len(counted) == 2
    assert stages._bent_frames(run) == sum(counted) > sum(len(frames) for frames in pushes.values())


def test_a_stiffer_wall_puts_the_same_slice_into_a_higher_class() -> None:
    force_n = np.array([0.0, 0.0047, 0.0053, 0.028, 0.033])
    assert classes_at_modulus(force_n, 1.0, ClassesStudy()).tolist() == [0, 0, 1, 1, 2]
    assert classes_at_modulus(force_n, 1.1, ClassesStudy()).tolist() == [0, 1, 1, 2, 2]
    assert classes_at_modulus(force_n, 0.9, ClassesStudy()).tolist() == [0, 0, 0, 1, 1]


def test_a_section_at_another_modulus_is_that_of_the_scaled_force_to_a_tenth_of_a_pixel() -> None:
    # Pressure and weight do not scale with the force; what they add is what the relabelling neglects.
    mesh = build_mesh(12e-3, 0.6e-3, 8, 0, 1, 2)
    wall = LinearWall(mesh, 0.45)
    plane = ScanPlane(Contact(polar_rad=np.radians(35.0)), gap_m=0.5e-3)
    modes_knc = np.stack([266.0 * wall.pressure_nc, wall.needle_cnc([plane.contact], 0.35e-3)[0]])
    here, there = 0.25e6, 0.28e6
    weights_fk = np.array([[1.0 / here, 0.03 / here], [1.0 / there, 0.03 / here]])
    one, other = cut_sections(mesh, [plane], modes_knc, weights_fk[None])[0]
    assert np.abs(one.outer - other.outer).max() < 1e-5
    assert np.abs(one.inner - other.inner).max() < 1e-5
