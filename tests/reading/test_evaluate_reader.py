"""Evaluations of recordings: which frames count, the modulus that each is read with,
force errors and coverage, the command.
"""

import json
from collections.abc import Callable
from copy import copy
from dataclasses import replace
from math import isnan
from pathlib import Path
from shutil import copytree

import cv2
import numpy as np
import pytest
from analytic_frames import GAP_M, MODULUS_PA
from commands import said
from relaxing_eyes import read_as
from small_recordings import FORCES_N

from scleraforce.base.errors import CalibrationError, RecordingError
from scleraforce.calibration.evaluation import (
    Evaluation,
    FrameAnswer,
    evaluate_recordings,
)
from scleraforce.reading.load_model import load_reader
from scleraforce.reading.reading_models import Reader
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.eye import NO_DISCREPANCY, Eye, Modulus
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup

pytest.importorskip("torch")


@pytest.fixture(scope="module")
def model(places) -> Reader:
    return load_reader(places["model"])


@pytest.fixture(scope="module")
def calibration(places):
    return read_calibration(places["calibration"])


@pytest.fixture(scope="module")
def both(places, model, calibration) -> Evaluation:
    return evaluate_recordings(model, [places["mine"], places["other"]], calibration)


@pytest.fixture(scope="module")
def uncalibrated(places, model) -> Evaluation:
    return evaluate_recordings(model, [places["mine"]])


@pytest.fixture
def changed(places, tmp_path: Path) -> Callable[..., Path]:
    """Return a copy of the recording "mine", with other lines of its tables."""

    def change(
        frames: Callable[[list[str]], list[str]] | None = None,
        log: Callable[[np.ndarray], np.ndarray] | None = None,
        toml: tuple[str, str] = ("", ""),
    ) -> Path:
        folder = copytree(places["mine"], tmp_path / "changed", dirs_exist_ok=True)
        info = (folder / "recording.toml").read_text()
        (folder / "recording.toml").write_text(info.replace(*toml))
        if frames is not None:
            lines = (folder / "frames.csv").read_text().splitlines()
            (folder / "frames.csv").write_text("\n".join(frames(lines)) + "\n")
        if log is not None:
            path = folder / "forces.csv"
            header = path.read_text().splitlines()[0]
            rows = log(np.loadtxt(path, delimiter=",", skiprows=1))
            kinds = {"fmt": "%.6f", "delimiter": ",", "comments": ""}
            np.savetxt(path, rows, header=header, **kinds)
        return folder

    return change


def width_n(frame: FrameAnswer) -> float:
    low_n, high_n = frame.answer.interval_n
    return high_n - low_n


def test_labels_exclusions_and_metrics_follow_the_recording(
    changed, model, uncalibrated
):
    frames = uncalibrated.frames
    assert [frame.file for frame in frames] == [f"{number}.png" for number in range(5)]
    measured_n = [frame.measured_force_n for frame in frames]
    assert measured_n == pytest.approx([*FORCES_N, 0.010], abs=3e-4)
    assert [frame.target for frame in frames] == [0, 1, 1, 2, 1]
    assert all(frame.scored for frame in frames)
    blank = frames[4].answer
    assert (blank.usable, blank.predicted, blank.probabilities) == (False, 2, None)
    right = [frame.answer.predicted == frame.target for frame in frames]
    assert uncalibrated.accuracy.value == np.mean(right)
    assert uncalibrated.confusion.sum(axis=1).tolist() == [1, 3, 1]

    pierced = [",pierced", ",0", ",0", ",1", ",0", ",0"]
    twice = changed(
        lambda lines: [line + end for line, end in zip(lines, pierced, strict=True)],
        lambda log: log * np.where(np.arange(log.shape[1]) == 3, 2.0, 1.0),
    )
    found = evaluate_recordings(model, [twice]).frames
    assert [frame.scored for frame in found] == [True, True, False, False, True]
    assert found[2].excluded == "pierced"
    assert "largest force" in found[3].excluded


def test_an_eye_is_read_with_its_own_modulus_and_a_stranger_with_the_populations(
    both, uncalibrated
):
    used = {f.eye: (f.youngs_modulus_pa, f.modulus_source) for f in both.frames}
    assert used["mine"] == (pytest.approx(MODULUS_PA), "own")
    assert used["stranger"] == (pytest.approx(1.1 * MODULUS_PA), "population")
    mine, other = (both.frames[start : start + 4] for start in (0, 5))

    for frame, stranger, force_n in zip(mine, other, FORCES_N, strict=True):
        assert frame.answer.force_n == pytest.approx(force_n, abs=1e-3)
        for one in (frame, stranger):
            low, high = one.answer.interval_n
            assert low < force_n < high
        assert width_n(stranger) > 1.2 * width_n(frame)

    unknown = uncalibrated.frames[2]
    assert width_n(unknown) > width_n(both.frames[7]) > width_n(both.frames[2])
    assert unknown.modulus_source is None


def test_errors_and_coverage_count_usable_frames_outside_the_calibration(both):
    counted = [f for f in both.frames if f.answer.usable and not f.calibration]
    unusable = [(f.recording[-4:], f.file) for f in both.frames if not f.answer.usable]
    assert unusable == [("mine", "4.png"), ("ther", "4.png")]
    assert len(counted) == 7
    errors = [abs(f.answer.force_n - f.measured_force_n) for f in counted]
    assert both.mae_n == pytest.approx(np.mean(errors))
    assert all(f.measured_force_sd_n > 0.0 for f in counted)
    covered = [f.label.covered for f in counted]
    assert (both.coverage.hits, both.coverage.total) == (sum(covered), 7)
    assert (both.accuracy.total, both.usable.accuracy.total) == (9, 7)
    assert both.accuracy.hits == 7
    assert both.usable.accuracy.value == 1.0


def test_frames_that_calibrated_are_known_by_their_content_and_not_scored(
    changed, model, calibration, both
):
    """A renamed copy is marked; another frame of the same eye and name is not."""
    assert [f.file for f in both.frames if f.calibration] == ["1.png"]
    copied = changed(lambda lines: [line.replace("1.png", "b.png") for line in lines])
    other = read_frame(copied / "frames" / "1.png")
    (copied / "frames" / "1.png").rename(copied / "frames" / "b.png")
    found = evaluate_recordings(model, [copied], calibration).frames
    assert [f.file for f in found if f.calibration] == ["b.png"]

    other[0, 0] += 1
    cv2.imwrite(str(copied / "frames" / "b.png"), other)
    found = evaluate_recordings(model, [copied], calibration).frames
    assert not any(f.calibration for f in found)


def test_a_recording_that_was_read_is_not_read_again(changed, model, uncalibrated):
    recording = read_recording(changed())
    for name in ("frames.csv", "forces.csv"):
        (recording.path / name).unlink()
    found = evaluate_recordings(model, [recording])
    place = str(recording.path)
    again = tuple(replace(one, recording=place) for one in uncalibrated.frames)
    assert [f.to_dict() for f in found.frames] == [f.to_dict() for f in again]

    with pytest.raises(RecordingError, match="given twice"):
        evaluate_recordings(model, [recording, recording.path / "frames" / ".."])


def answered(
    model: Reader, recording: Path, times_s: np.ndarray, forces_n: np.ndarray
) -> list[dict[str, object]]:
    """Return the frames of an evaluation at these times that read as these forces."""
    answers = (
        replace(read_as(force_n), interval_n=(0.9 * force_n, force_n / 0.9))
        for force_n in forces_n.tolist()
    )
    told = copy(model)
    told.read_together = lambda *_: (next(answers),)
    frames = tuple(FrameEntry("1.png", time_s) for time_s in times_s.tolist())
    shown = replace(read_recording(recording), frames=frames, forces=None)
    return evaluate_recordings(told, [shown]).to_dict()["frames"]


def test_frames_after_a_puncture_in_the_readings_are_left_out_up_to_the_end_of_the_push(
    places, model
):
    times_s = np.arange(140) / 100.0
    corners_s = [0.0, 0.2, 0.203, 0.5, 0.55, 1.25, 1.35]
    corners_n = [0.01, 0.03, 0.008, 0.008, 0.0, 0.0, 0.02]
    fallen_n = np.interp(times_s, corners_s, corners_n)
    found = answered(model, places["mine"], times_s, fallen_n)
    pierced = np.array([frame["pierced"] for frame in found])
    assert not pierced[times_s < 0.2].any()
    assert pierced[(times_s > 0.21) & (times_s < 0.5)].all()
    assert not pierced[times_s > 1.25].any()
    assert [frame["excluded"] == "pierced" for frame in found] == pierced.tolist()


HELD_N = 1e-3 * np.array([12.0, 24.0, 36.0, 35.0, 3.0, 3.1, 8.0, 9.0, 2.0, 2.0])
SLOW_S = np.arange(70) / 100.0
SLOW_N = np.interp(SLOW_S, [0.0, 0.2, 0.5, 0.7], [0.01, 0.03, 0.008, 0.0])


@pytest.mark.parametrize(
    ("times_s", "forces_n"),
    [(SLOW_S, SLOW_N), (0.2 * np.arange(10), HELD_N), (8.0 * np.arange(10), HELD_N)],
    ids=["slow", "dense", "sparse"],
)
def test_a_slow_fall_and_one_between_held_pushes_are_no_puncture(
    places, model, times_s: np.ndarray, forces_n: np.ndarray
):
    found = answered(model, places["mine"], times_s, forces_n)
    assert not any(frame["pierced"] for frame in found)


def test_frames_in_a_row_say_when_the_highest_class_is_reached(places, model):
    forces_n = np.append(0.010 + 5e-4 * np.arange(13), 0.028)
    found = answered(model, places["mine"], 0.01 * np.arange(14), forces_n)
    median_ms = [frame["time_to_bound_ms"] for frame in found]
    ends_ms = [frame["time_to_bound_ms_interval"] for frame in found]
    assert median_ms[:9] == [None] * 9, "ten frames make a line"
    assert median_ms[12] == pytest.approx(1e3 * (0.027 - forces_n[12]) / 0.05)
    assert ends_ms[12][0] < median_ms[12] < ends_ms[12][1]
    assert (median_ms[13], ends_ms[13]) == (0.0, [0.0, 0.0])


def test_a_puncture_in_the_force_log_is_found_unless_frames_csv_says_otherwise(
    changed, model
):
    def through(log: np.ndarray) -> np.ndarray:
        """Friction alone, before the middle of the third push, with a sensor's
        noise.
        """
        after = (log[:, 0] > 16.5) & (log[:, 0] < 20.0)
        noise_n = np.random.default_rng(0).normal(0.0, 1e-4, after.sum())
        log[after, 3] = 0.1 - 6e-3 + noise_n
        return log

    path = changed(log=through)
    found = evaluate_recordings(model, [path])
    assert [frame.pierced for frame in found.frames] == [False] * 2 + [
        True,
        False,
        False,
    ]
    words = "1 frames after a puncture are left out, from 2.png on"
    assert f"{path}: {words}" in found.notes

    head, *rows = (path / "frames.csv").read_text().splitlines()
    lines = [f"{head},pierced", *(f"{row},0" for row in rows)]
    (path / "frames.csv").write_text("\n".join(lines) + "\n")
    assert not any(f.pierced for f in evaluate_recordings(model, [path]).frames)


def test_the_truth_of_a_virtual_eye_decides_nothing_that_is_read_and_is_compared_with(
    changed, model, uncalibrated
):
    mine = changed()
    assert uncalibrated.to_dict()["truth"] is None
    true_n = [*FORCES_N, 0.0]
    true_n[0] += 1.0  # far outside its interval
    truth = [{"file": f"{n}.png", "force_n": true} for n, true in enumerate(true_n)]
    (mine / "truth.json").write_text(json.dumps({"frames": truth}))
    beside = evaluate_recordings(model, [mine])
    read, alone = (
        [frame.answer.to_dict() for frame in found.frames]
        for found in (beside, uncalibrated)
    )
    assert read == alone
    assert beside.coverage == uncalibrated.coverage
    assert beside.to_dict()["truth"] == "truth.json"
    assert (beside.true_coverage.hits, beside.true_coverage.total) == (3, 4)

    (mine / "truth.json").write_text("no JSON")
    with pytest.raises(RecordingError, match=r"truth\.json"):
        evaluate_recordings(model, [mine])


def test_a_stranger_read_with_the_populations_modulus_is_named_in_notes_and_warnings(
    places, both
):
    (note,) = [note for note in both.notes if "population's modulus" in note]
    named = f"stranger is not in {places['calibration']}, which has 1 eye (mine)"
    assert named in note
    words = "the modulus is the population's, not this eye's own"
    warned = [words in frame.answer.warnings for frame in both.frames]
    assert warned == [False] * 5 + [True] * 5


def test_moduli_of_linear_walls_are_refused(places, model):
    linear = read_calibration(places["linear"])
    with pytest.raises(CalibrationError, match="with `mechanics=finite-strain`"):
        evaluate_recordings(model, [places["mine"]], linear)


def test_an_eye_outside_the_training_is_noted_and_all_its_frames_are_withdrawn_from(
    places, model
):
    found = evaluate_recordings(model, [places["far"]])
    assert "gap between B-scan and needle axis 1.5 mm" in found.notes[0]
    assert {(f.answer.usable, f.answer.predicted) for f in found.frames} == {(False, 2)}
    assert isnan(found.mae_n)
    assert all(frame.answer.can_calibrate for frame in found.frames[:3])


def test_the_command_prints_forces_in_millinewtons(places, both, capsys, monkeypatch):
    monkeypatch.chdir(places["mine"].parent)
    options = ("--calibration", "calibration.json")
    command = ["evaluate", "./model", "mine", "other", *options]
    result = json.loads(said(capsys, *command, "--json"))
    assert result["mae_mn"] == pytest.approx(1e3 * both.mae_n)
    assert result["coverage"] == both.coverage.value
    frame, _, blank = result["frames"][2:5]
    assert frame["predicted_force_mn"] == pytest.approx(22.0, abs=1.0)
    assert frame["interval_mn"][0] < 22.0 < frame["interval_mn"][1]
    assert frame["contact_mm"] == pytest.approx(0.3, abs=0.1)
    # the network, which always gives the same answer, is unsure
    assert (frame["warnings"], frame["can_calibrate"]) == ([], True)
    assert (blank["predicted_force_mn"], blank["can_calibrate"]) == (None, False)


def test_a_recording_without_a_force_log_is_read_but_not_scored(
    places, changed, capsys
):
    silent = changed()
    (silent / "forces.csv").unlink()
    result = json.loads(said(capsys, "evaluate", places["model"], silent, "--json"))
    assert (result["accuracy"], result["recall"]) == (None, [None] * 3)
    assert "no forces.csv" in " ".join(result["notes"])
    found = [(one["measured_force_mn"], one["target"]) for one in result["frames"]]
    assert found == [(None, None)] * 5


@pytest.mark.slow
def test_intervals_are_stretched_to_hold_on_recordings(places, model, tmp_path, capsys):
    out = tmp_path / "stretched"
    options = ("--intervals", places["model"], "--frames", 1, "--json", "--out", out)
    result = json.loads(said(capsys, "calibrate", places["mine"], *options))
    changes = {row["method"]: row for row in result["stretches"]}
    assert set(changes) == {"fit", "network"}
    for row in changes.values():
        assert (row["modulus"], *row["globes"]) == ("own E", "open")
        assert (row["eyes"], row["readings"]) == (1, 3)
        assert row["factor"] >= 1.0

    after = load_reader(out)
    assert after.record["intervals"]["source"] == "recordings of mine"
    modulus = Modulus(mean_pa=MODULUS_PA, sd_pa=0.01 * MODULUS_PA, source="own")
    one_frame = replace(NO_DISCREPANCY, widest_gap=1.0)
    eye = Eye(modulus=modulus, globe=OPEN, discrepancy=one_frame)
    known = Setup(eye=eye, needle=Needle(gap_m=GAP_M))
    pixels = read_frame(places["mine"] / "frames" / "2.png")
    scale = PixelScale.of(read_recording(places["mine"]).info.scan)
    was, now = (reader.read(pixels, scale, known) for reader in (model, after))
    assert now.force_n == was.force_n
    widths = [answer.interval_n[1] - answer.force_n for answer in (was, now)]
    assert widths[1] / widths[0] == pytest.approx(changes["fit"]["factor"], rel=1e-4)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("model", "--out", "new", "--mechanics", "linear"), "--intervals"),
        (("model", "--out", "model"), "exists already"),
        (("none", "--out", "new"), "no such folder"),
    ],
)
def test_intervals_take_a_reader_only_and_none_of_the_other_options(
    places, monkeypatch, capsys, words: tuple[str, ...], message: str
):
    monkeypatch.chdir(places["mine"].parent)
    model, *options = words
    command = ("calibrate", "mine", "--intervals", f"./{model}", *options)
    assert message in said(capsys, *command, code=2)
    assert not Path("new").exists()
