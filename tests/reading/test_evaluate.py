"""An evaluation of recordings: every frame's answer, the frames that count, and notes
on the rest.
"""

import copy
import json
import shutil
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import said
from small_recordings import (
    LOGGED_INFO,
    LOOKED_AT_COLUMNS,
    LOOKED_AT_ROWS,
    calibration_text,
    drawn_wall,
)

from scleraforce.base.errors import RecordingError
from scleraforce.calibration.evaluation import FrameAnswer, evaluate_recordings
from scleraforce.reading.answer import unusable_answer
from scleraforce.reading.load_model import load_classifier, load_wall_finder
from scleraforce.reading.reading_models import Classifier
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.decoder import format_record
from scleraforce.records.eye import Eye
from scleraforce.records.frame import frame_digest
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.records.needle import Needle, gauge_diameter_m
from scleraforce.records.recording_info import RecordingInfo
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import boundary_slice

# classes 0 1 1 2, over the largest force, pierced
FORCES_N = (
    0.002,
    0.010,
    0.020,
    0.040,
    0.080,
    0.050,
)
SCALE = PixelScale(lateral_m=15e-3 / LOOKED_AT_COLUMNS, depth_m=4e-3 / LOOKED_AT_ROWS)


def write_recording(
    path: Path, eye: str, gap_m: float = 0.5e-3, forces: bool = True
) -> Path:
    """Six frames, 4 s apart, each in the middle of a push; the fourth shows nothing."""
    rng = np.random.default_rng(4)
    (path / "frames").mkdir(parents=True)
    scan = replace(LOGGED_INFO.scan, rows=LOOKED_AT_ROWS, columns=LOOKED_AT_COLUMNS)
    needle = Needle(diameter_m=gauge_diameter_m(22), gap_m=gap_m)
    info = RecordingInfo(Eye(eye, thickness_m=6e-4), scan, needle, LOGGED_INFO.force)
    (path / "recording.toml").write_text(format_record(info))
    lines = ["file,time_s,pierced"]

    for number, force_n in enumerate(FORCES_N):
        frame = drawn_wall(rng, 0.03 * force_n)
        if number == 3:
            frame[:] = 600
        cv2.imwrite(str(path / "frames" / f"{number}.png"), frame)
        lines.append(f"{number}.png,{5 + 6 * number},{int(number == 5)}")

    (path / "frames.csv").write_text("\n".join(lines) + "\n")
    if forces:
        time_s = np.arange(0.0, 45.0, 0.01)
        force_n = sum(
            f * (np.abs(time_s - 5 - 6 * n) < 2.0) for n, f in enumerate(FORCES_N)
        )
        log = np.zeros((len(time_s), 7))
        log[:, 0] = time_s
        log[:, 3] = 0.1 - force_n + rng.normal(0.0, 1e-4, len(time_s))
        header = "time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm"
        np.savetxt(
            path / "forces.csv",
            log,
            fmt="%.6f",
            delimiter=",",
            header=header,
            comments="",
        )

    return path


@pytest.fixture(scope="module")
def places(tmp_path_factory, write_model) -> dict[str, Path]:
    """A model for the paper's slices (random weights), and recordings."""
    folder = tmp_path_factory.mktemp("evaluate")
    write_model(folder / "model", Study())
    return {
        "model": folder / "model",
        "a": write_recording(folder / "a", "eye a"),
        "far": write_recording(folder / "far", "eye b", gap_m=0.8e-3),
        "silent": write_recording(folder / "silent", "eye c", forces=False),
    }


@pytest.fixture(scope="module")
def reader(places) -> Classifier:
    return load_classifier(places["model"])


def test_labels_exclusions_and_metrics_follow_the_recording(places, reader) -> None:
    found = evaluate_recordings(reader, [places["a"]])
    frames = found.frames
    assert [frame.file for frame in frames] == [f"{number}.png" for number in range(6)]
    np.testing.assert_allclose(
        [frame.measured_force_n for frame in frames], FORCES_N, atol=3e-4
    )
    assert [frame.target for frame in frames] == [0, 1, 1, 2, 2, 2]
    assert [frame.scored for frame in frames] == [True] * 4 + [False] * 2
    assert "largest force" in frames[4].excluded
    assert frames[5].excluded == "pierced"
    blank = frames[3].answer
    assert (blank.usable, blank.predicted, blank.probabilities) == (False, 2, None)
    assert blank.reason
    right = [frame.answer.predicted == frame.target for frame in frames[:4]]
    assert found.accuracy.value == np.mean(right)
    assert found.confusion.sum(axis=1).tolist() == [1, 2, 1]
    assert found.notes == ()


def read_as(
    recording: Path, times_s: np.ndarray, forces_n: np.ndarray, reader: Classifier
) -> tuple[FrameAnswer, ...]:
    """Return the frames of an evaluation at these times that read as these forces."""
    frames = tuple(
        FrameEntry(f"{number}.png", at_s)
        for number, at_s in enumerate(times_s.tolist())
    )
    opened = read_recording(recording)
    picture = opened.frame(opened.frames[0])
    answers = iter(
        replace(unusable_answer(3, "not asked"), force_n=force_n)
        for force_n in forces_n.tolist()
    )

    class Shown(type(opened)):
        def frame(self, _: FrameEntry) -> np.ndarray:
            return picture

    shown = Shown(**(vars(replace(opened, frames=frames, forces=None))))
    model = copy.copy(reader)
    model.read_together = lambda *_: (next(answers),)
    return evaluate_recordings(model, [shown]).frames


def test_frames_after_a_puncture_in_the_readings_are_left_out_up_to_the_end_of_the_push(
    places, reader
) -> None:
    times_s = np.arange(300) / 100.0
    corners_s = [0.0, 0.5, 0.503, 1.2, 1.25, 2.0, 2.1]
    corners_n = [0.01, 0.03, 0.008, 0.008, 0.0, 0.0, 0.02]
    found = read_as(
        places["silent"], times_s, np.interp(times_s, corners_s, corners_n), reader
    )
    pierced = np.array([frame.pierced for frame in found])
    assert not pierced[times_s < 0.5].any()
    assert pierced[(times_s > 0.51) & (times_s < 1.2)].all()
    assert not pierced[times_s > 2.0].any()
    assert [frame.excluded == "pierced" for frame in found] == pierced.tolist()
    slow_n = np.interp(times_s, [0.0, 0.5, 0.8, 1.2], [0.01, 0.03, 0.008, 0.0])
    assert not any(
        frame.pierced for frame in read_as(places["silent"], times_s, slow_n, reader)
    )


@pytest.mark.parametrize("every_s", [0.2, 8.0])
def test_a_fall_between_held_pushes_is_no_puncture(places, reader, every_s) -> None:
    forces_n = 1e-3 * np.array([12.0, 24.0, 36.0, 35.0, 3.0, 3.1, 8.0, 9.0, 2.0, 2.0])
    times_s = every_s * np.arange(len(forces_n))
    found = read_as(places["silent"], times_s, forces_n, reader)
    assert not any(frame.pierced for frame in found)


def test_a_puncture_in_the_force_log_is_found_unless_frames_csv_says_otherwise(
    places, reader, tmp_path: Path
) -> None:
    path = shutil.copytree(places["a"], tmp_path / "through")
    log = np.loadtxt(path / "forces.csv", delimiter=",", skiprows=1)
    # of the third push: friction, before its middle, with the noise of a sensor
    through = (log[:, 0] > 16.5) & (log[:, 0] < 20.0)
    noise_n = np.random.default_rng(0).normal(0.0, 1e-4, through.sum())
    log[through, 3] = 0.1 - 6e-3 + noise_n
    header = "time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm"
    np.savetxt(
        path / "forces.csv", log, fmt="%.6f", delimiter=",", header=header, comments=""
    )
    assert [frame.pierced for frame in evaluate_recordings(reader, [path]).frames] == [
        False
    ] * 5 + [True]
    lines = [
        line.rpartition(",")[0]
        for line in (path / "frames.csv").read_text().splitlines()
    ]
    (path / "frames.csv").write_text("\n".join(lines) + "\n")
    found = evaluate_recordings(reader, [path])
    assert [frame.pierced for frame in found.frames] == [
        False,
        False,
        True,
        False,
        False,
        False,
    ]
    assert found.frames[2].to_dict()["pierced"] is True
    assert found.notes == (
        f"{path}: 1 frames after a puncture are left out, from 2.png on",
    )


def test_an_answer_is_the_networks_for_the_slice_of_the_segmented_frame(
    places, reader
) -> None:
    frames = evaluate_recordings(reader, [places["a"]]).frames
    pixels = cv2.imread(str(places["a"] / "frames" / "2.png"), cv2.IMREAD_UNCHANGED)
    finder = load_wall_finder(SHIPPED_WALL_FINDER)
    cut = boundary_slice(
        find_wall(pixels, SCALE, finder=finder), SCALE, reader.study.slice
    )
    assert 0.02 < (cut > 0).mean() < 0.3
    np.testing.assert_allclose(
        frames[2].answer.probabilities, reader.probabilities(cut[None])[0], atol=1e-12
    )
    assert frames[2].answer.predicted == np.argmax(frames[2].answer.probabilities)
    answers = [found.answer.probabilities for found in frames if found.answer.usable]
    assert np.ptp(answers, axis=0).max() > 0.02, (
        "a network that always gives the same answer proves nothing"
    )


def test_a_recording_that_was_read_is_not_read_again(
    places, reader, tmp_path: Path
) -> None:
    recording = read_recording(shutil.copytree(places["a"], tmp_path / "a"))
    (recording.path / "frames.csv").unlink()
    (recording.path / "forces.csv").unlink()
    found = evaluate_recordings(reader, [recording])
    again = evaluate_recordings(reader, [places["a"]])
    assert [frame.recording for frame in found.frames] == [str(recording.path)] * len(
        FORCES_N
    )
    assert found.frames == tuple(
        replace(frame, recording=str(recording.path)) for frame in again.frames
    )

    for twice in (
        [recording, recording.path],
        [places["a"], places["a"] / "." / "frames" / ".."],
    ):
        with pytest.raises(RecordingError, match="given twice"):
            evaluate_recordings(reader, twice)


def test_a_dent_that_leaves_the_window_is_withdrawn_from_instead_of_read(
    reader,
) -> None:
    rng = np.random.default_rng(2)
    for dent_m, leaves in (
        (0.0, False),
        (1.5e-3, False),
        (3.2e-3, False),
        (4e-3, True),
        (6e-3, True),
    ):
        answer = reader.read(drawn_wall(rng, dent_m), SCALE)
        assert answer.usable is not leaves
        if leaves:
            assert (answer.predicted, answer.probabilities) == (2, None)
            assert "dent" in answer.reason


def test_frames_that_calibrated_are_known_by_their_content_and_not_scored(
    places, reader, tmp_path: Path
) -> None:
    """A renamed copy is marked; another recording's frame of the same eye and name is
    not.
    """
    names = ("1.png", "2.png")
    file = tmp_path / "calibration.json"
    digests = {
        name: frame_digest(read_frame(places["a"] / "frames" / name)) for name in names
    }
    used = [{"file": name, "sha256": digest} for name, digest in digests.items()]
    file.write_text(calibration_text(eyes={"eye a": {"frames": used}}))
    copy = shutil.copytree(places["a"], tmp_path / "copy")
    other = shutil.copytree(places["a"], tmp_path / "other")
    (copy / "frames" / "1.png").rename(copy / "frames" / "renamed.png")
    (copy / "frames.csv").write_text(
        (copy / "frames.csv").read_text().replace("1.png", "renamed.png")
    )

    for name in names:
        changed = read_frame(other / "frames" / name)
        changed[0, 0] += 1
        cv2.imwrite(str(other / "frames" / name), changed)

    found = evaluate_recordings(reader, [copy, other], read_calibration(file))
    marked = [
        (frame.recording, frame.file) for frame in found.frames if frame.calibration
    ]
    assert marked == [(str(copy), "renamed.png"), (str(copy), "2.png")]
    assert len(found.scored) == 2 + 4


def test_a_frame_outside_the_log_is_left_out_and_noted_and_the_others_are_scored(
    places, reader, tmp_path
) -> None:
    path = shutil.copytree(places["a"], tmp_path / "changed")
    header, *rows = (path / "forces.csv").read_text().splitlines()
    late = [row for row in rows if float(row.split(",")[0]) > 6.0]
    (path / "forces.csv").write_text("\n".join([header, *late]) + "\n")
    found = evaluate_recordings(reader, [path])
    assert [frame.scored for frame in found.frames] == [
        False,
        True,
        True,
        True,
        False,
        False,
    ]
    assert (found.frames[0].measured_force_n, found.frames[0].target) == (None, None)
    assert "force samples within" in found.frames[0].excluded
    assert any(
        "1 of 6 frames have no label and are left out (0.png: " in note
        for note in found.notes
    )


def test_a_gap_outside_the_study_s_is_noted_and_not_an_error(places, reader) -> None:
    (note,) = evaluate_recordings(reader, [places["a"], places["far"]]).notes
    assert note.startswith(f"{places['far']}: gap")
    assert "0.8 mm, the model was trained on 0.5 mm" in note
    farther = load_classifier(places["model"])
    farther.study = replace(
        reader.study, needle=replace(reader.study.needle, gap_m=0.8e-3)
    )
    assert evaluate_recordings(farther, [places["far"]]).notes == ()


def test_a_recording_without_a_force_log_is_read_but_not_scored(places, capsys) -> None:
    result = json.loads(
        said(capsys, "evaluate", places["model"], places["silent"], "--json")
    )
    assert {
        "accuracy",
        "confusion",
        "recall",
        "precision",
        "intervals",
        "frames",
    } <= set(result)
    assert (result["accuracy"], result["recall"]) == (None, [None] * 3)
    assert "no forces.csv" in result["notes"][0]
    assert len(result["frames"]) == 6
    assert {
        (frame["measured_force_mn"], frame["target"]) for frame in result["frames"]
    } == {(None, None)}
    blank = result["frames"][3]
    assert blank["recording"] == str(places["silent"])
    assert (blank["probabilities"], blank["usable"]) == (None, False)
