"""An evaluation of recordings: every frame's answer, what counts, and what is said about the rest."""

import json
import shutil
from dataclasses import replace
from math import isnan
from pathlib import Path

import cv2
import numpy as np
import pytest
from small_recordings import calibration_text

from scleraforce.cli.main import run
from scleraforce.errors import RecordingError
from scleraforce.known.calibration_file import read_calibration
from scleraforce.reader import load_model
from scleraforce.reader.evaluate import evaluate_recordings
from scleraforce.recording.folder import frame_digest, read_recording
from scleraforce.recording.images import read_frame
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.slice import boundary_slice
from scleraforce.segmentation.wall import find_wall
from scleraforce.study import Study

FORCES_N = (0.002, 0.010, 0.020, 0.040, 0.080, 0.050)  # classes 0 1 1 2, over the largest force, pierced
ROWS, COLUMNS = 256, 300
RECORDING_TOML = """
[eye]
id = "{eye}"
thickness_m = 6e-4
[oct]
columns = 300
rows = 256
bits = 12
width_m = 15e-3
depth_m = 4e-3
[needle]
gauge = 22
slice_gap_m = {gap}
[force]
axis = "fz"
contact_sign = -1
"""


def draw_frame(dent_m: float, rng: np.random.Generator) -> np.ndarray:
    """A bright wall 0.6 mm thick, an arc of 12 mm with a dent, in speckle."""
    lateral_m = (np.arange(COLUMNS) + 0.5) / COLUMNS * 15e-3 - 7.5e-3
    top_m = 0.5e-3 + 12e-3 - np.sqrt(12e-3**2 - lateral_m**2) + dent_m * np.exp(-((lateral_m / 2e-3) ** 2))
    depth_m = (np.arange(ROWS)[:, None] + 0.5) / ROWS * 4e-3
    wall = (depth_m >= top_m) & (depth_m < top_m + 0.6e-3)
    return np.clip(rng.normal(np.where(wall, 2400.0, 600.0), 150.0), 0, 4095).astype(np.uint16)


def write_recording(path: Path, eye: str, gap_m: float = 0.5e-3, forces: bool = True) -> Path:
    """Six frames, 4 s apart, each in the middle of a push; the fourth shows nothing."""
    rng = np.random.default_rng(4)
    (path / "frames").mkdir(parents=True)
    (path / "recording.toml").write_text(RECORDING_TOML.format(eye=eye, gap=gap_m))
    lines = ["file,time_s,pierced"]
    for number, force_n in enumerate(FORCES_N):
        frame = draw_frame(30.0 * force_n * 1e-3, rng) if number != 3 else np.full((ROWS, COLUMNS), 600, np.uint16)
        cv2.imwrite(str(path / "frames" / f"{number}.png"), frame)
        lines.append(f"{number}.png,{5 + 6 * number},{int(number == 5)}")
    (path / "frames.csv").write_text("\n".join(lines) + "\n")
    if forces:
        time_s = np.arange(0.0, 45.0, 0.01)
        force_n = sum(f * (np.abs(time_s - 5 - 6 * n) < 2.0) for n, f in enumerate(FORCES_N))
        log = np.zeros((len(time_s), 7))
        log[:, 0], log[:, 3] = time_s, 0.1 - force_n + rng.normal(0.0, 1e-4, len(time_s))
        header = "time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm"
        np.savetxt(path / "forces.csv", log, fmt="%.6f", delimiter=",", header=header, comments="")
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


def test_labels_exclusions_and_metrics_are_those_of_the_recording(places) -> None:
    found = evaluate_recordings(load_model(places["model"]), [places["a"]])
    frames = found.frames
    assert [frame.file for frame in frames] == [f"{number}.png" for number in range(6)]
    np.testing.assert_allclose([frame.measured_force_n for frame in frames], FORCES_N, atol=3e-4)
    assert [frame.target for frame in frames] == [0, 1, 1, 2, 2, 2]
    assert [frame.scored for frame in frames] == [True] * 4 + [False] * 2
    assert "largest force" in frames[4].excluded
    assert frames[5].excluded == "pierced"
    right = [frame.answer.predicted == frame.target for frame in frames[:4]]
    assert found.accuracy.value == np.mean(right)
    assert found.confusion.sum(axis=1).tolist() == [1, 2, 1]
    assert found.notes == ()


def test_an_answer_is_the_networks_for_the_slice_of_the_segmented_frame(places) -> None:
    reader = load_model(places["model"])
    frames = evaluate_recordings(reader, [places["a"]]).frames
    frame = frames[2]
    pixels = cv2.imread(str(places["a"] / "frames" / "2.png"), cv2.IMREAD_UNCHANGED)
    scale = PixelScale(lateral_m=15e-3 / COLUMNS, depth_m=4e-3 / ROWS)
    cut = boundary_slice(find_wall(pixels, scale), scale, reader.study.slice)
    assert 0.02 < (cut > 0).mean() < 0.3
    np.testing.assert_allclose(frame.answer.probabilities, reader.probabilities(cut[None])[0], atol=1e-12)
    assert frame.answer.predicted == np.argmax(frame.answer.probabilities)
    answers = [found.answer.probabilities for found in frames if found.answer.usable]
    assert np.ptp(answers, axis=0).max() > 0.02, "a network that answers always the same proves nothing"


def test_a_recording_that_was_read_is_not_read_again(places, tmp_path: Path) -> None:
    recording, reader = read_recording(shutil.copytree(places["a"], tmp_path / "a")), load_model(places["model"])
    (recording.path / "frames.csv").unlink()
    (recording.path / "forces.csv").unlink()
    found, again = evaluate_recordings(reader, [recording]), evaluate_recordings(reader, [places["a"]])
    assert [frame.recording for frame in found.frames] == [str(recording.path)] * len(FORCES_N)
    assert found.frames == tuple(replace(frame, recording=str(recording.path)) for frame in again.frames)
    with pytest.raises(RecordingError, match="given twice"):
        evaluate_recordings(reader, [recording, recording.path])


def test_a_frame_that_shows_nothing_counts_as_class_2_and_was_never_shown_to_the_network(places) -> None:
    blank = evaluate_recordings(load_model(places["model"]), [places["a"]]).frames[3]
    assert (blank.answer.usable, blank.answer.predicted, blank.answer.probabilities) == (False, 2, None)
    assert blank.answer.reason
    assert blank.scored


def test_a_dent_that_leaves_the_window_is_withdrawn_from_instead_of_read(places) -> None:
    reader, scale = load_model(places["model"]), PixelScale(lateral_m=15e-3 / COLUMNS, depth_m=4e-3 / ROWS)
    rng = np.random.default_rng(2)
    for dent_m, leaves in ((0.0, False), (1.5e-3, False), (3.2e-3, False), (4e-3, True), (6e-3, True)):
        answer = reader.read(draw_frame(dent_m, rng), scale)
        assert answer.usable is not leaves
        if leaves:
            assert (answer.predicted, answer.probabilities) == (2, None)
            assert "dent" in answer.reason


def test_frames_that_calibrated_the_modulus_are_marked_and_not_scored(places, tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    digests = {name: frame_digest(read_frame(places["a"] / "frames" / name)) for name in ("1.png", "2.png")}
    used = [{"file": name, "sha256": digest} for name, digest in digests.items()]
    file.write_text(calibration_text(eyes={"eye a": {"frames": used}}))
    reader = load_model(places["model"])
    found = evaluate_recordings(reader, [places["a"]], read_calibration(file))
    assert [frame.calibration for frame in found.frames] == [False, True, True] + [False] * 3
    assert len(found.scored) == 2


def test_frames_that_calibrated_are_known_by_their_content_and_not_their_name(places, tmp_path: Path) -> None:
    """A renamed copy is marked; another recording's frame of the same eye and name is not."""
    digest = frame_digest(read_frame(places["a"] / "frames" / "1.png"))
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(eyes={"eye a": {"frames": [{"file": "1.png", "sha256": digest}]}}))
    copy, other = shutil.copytree(places["a"], tmp_path / "copy"), shutil.copytree(places["a"], tmp_path / "other")
    (copy / "frames" / "1.png").rename(copy / "frames" / "renamed.png")
    (copy / "frames.csv").write_text((copy / "frames.csv").read_text().replace("1.png", "renamed.png"))
    changed = read_frame(other / "frames" / "1.png")
    changed[0, 0] += 1
    cv2.imwrite(str(other / "frames" / "1.png"), changed)
    found = evaluate_recordings(load_model(places["model"]), [copy, other], read_calibration(file))
    assert [(frame.recording, frame.file) for frame in found.frames if frame.calibration] == [
        (str(copy), "renamed.png")
    ]


def test_a_log_in_millinewtons_is_refused(places, tmp_path: Path, capsys) -> None:
    path = shutil.copytree(places["a"], tmp_path / "milli")
    log = np.loadtxt(path / "forces.csv", delimiter=",", skiprows=1)
    log[:, 1:] *= 1e3
    header = (path / "forces.csv").read_text().splitlines()[0]
    np.savetxt(path / "forces.csv", log, fmt="%.6f", delimiter=",", header=header, comments="")
    assert run(["evaluate", str(places["model"]), str(path)]) == 2
    assert "forces.csv: fz_n: 79.99 N under 4.png, more than 3 N; the columns are in N" in capsys.readouterr().err


def shortened(places, tmp_path: Path, change) -> Path:
    """A copy of recording a whose log `change` was applied to."""
    path = shutil.copytree(places["a"], tmp_path / "changed")
    header, *rows = (path / "forces.csv").read_text().splitlines()
    (path / "forces.csv").write_text("\n".join([header, *change(rows)]) + "\n")
    return path


def test_a_frame_outside_the_log_is_left_out_and_said_and_the_others_are_scored(places, tmp_path: Path) -> None:
    path = shortened(places, tmp_path, lambda rows: [row for row in rows if float(row.split(",")[0]) > 6.0])
    found = evaluate_recordings(load_model(places["model"]), [path])
    assert [frame.scored for frame in found.frames] == [False, True, True, True, False, False]
    assert (found.frames[0].measured_force_n, found.frames[0].target) == (None, None)
    assert "force samples within" in found.frames[0].excluded
    assert any("1 of 6 frames have no label and are left out (0.png: " in note for note in found.notes)


def test_no_frame_is_scored_by_samples_that_are_no_forces(places, tmp_path: Path) -> None:
    def damaged(rows: list[str]) -> list[str]:
        fields = [row.split(",") for row in rows]
        for line in fields:
            line[3] = "213.0" if 10.8 < float(line[0]) < 11.5 else line[3]  # at frame 1
            line[3] = "nan" if float(line[0]) == 17.0 else line[3]  # at frame 2
        return [",".join(line) for line in fields]

    found = evaluate_recordings(load_model(places["model"]), [shortened(places, tmp_path, damaged)])
    assert [frame.scored for frame in found.frames] == [True, False, False, True, False, False]
    np.testing.assert_allclose(found.frames[3].measured_force_n, FORCES_N[3], atol=3e-4)
    notes = " ".join(found.notes)
    assert "1 of 4500 samples have no force (nan)" in notes
    assert "69 of 4500 samples are implausible and have no force; the first is " in notes
    assert "forces.csv:1083: fz_n: 213 N" in notes


@pytest.mark.parametrize(
    ("content", "field"),
    [("{", "not JSON"), ("[]", "format"), (calibration_text(eyes={"x": {"frames": 3}}), "eyes.x.frames")],
)
def test_a_calibration_file_that_cannot_be_used_is_refused(
    places, tmp_path: Path, content: str, field: str, capsys
) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(content)
    assert run(["evaluate", str(places["model"]), str(places["a"]), "--calibration", str(file)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert str(file) in error
    assert field in error


def test_a_gap_that_the_model_was_not_trained_on_is_said_and_no_error(places) -> None:
    found = evaluate_recordings(load_model(places["model"]), [places["a"], places["far"]])
    assert len(found.notes) == 1
    assert found.notes[0].startswith(f"{places['far']}: gap")
    assert "0.8 mm, the model was trained on 0.5 mm" in found.notes[0]


def test_what_a_model_was_trained_on_is_taken_from_its_study(places) -> None:
    reader = load_model(places["model"])
    closed = replace(reader.study.needle, gap_m=0.8e-3)
    reader.study = replace(reader.study, needle=closed)
    assert evaluate_recordings(reader, [places["far"]]).notes == ()


def test_a_recording_without_a_force_log_is_read_but_not_scored(places) -> None:
    found = evaluate_recordings(load_model(places["model"]), [places["silent"]])
    assert len(found.frames) == 6
    assert {(frame.target, frame.measured_force_n) for frame in found.frames} == {(None, None)}
    assert isnan(found.accuracy.value)
    assert "no forces.csv" in found.notes[0]


def test_a_recording_given_twice_is_refused(places) -> None:
    with pytest.raises(RecordingError, match="twice"):
        evaluate_recordings(load_model(places["model"]), [places["a"], places["a"] / "." / "frames" / ".."])


def test_the_command_prints_its_json_and_null_where_there_is_nothing(places, capsys) -> None:
    assert run(["evaluate", str(places["model"]), str(places["silent"]), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert {"accuracy", "confusion", "recall", "precision", "intervals", "frames"} <= set(result)
    assert result["accuracy"] is None
    assert result["recall"] == [None] * 3
    frame = result["frames"][3]
    assert frame["recording"] == str(places["silent"])
    assert (frame["measured_force_mn"], frame["target"], frame["probabilities"], frame["usable"]) == (
        None,
        None,
        None,
        False,
    )


def test_the_commands_text_fits_80_columns_and_shows_the_confusion(places, capsys, monkeypatch) -> None:
    monkeypatch.chdir(places["a"].parent)
    assert run(["evaluate", "model", "a"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.startswith("accuracy") and "of 4" in line for line in lines)
    assert any("3.png" in line and "not usable" in line for line in lines)


def test_the_page_shows_every_frame_with_what_was_found_in_it(places, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert run(["evaluate", str(places["model"]), str(places["a"]), "--html", str(page)]) == 0
    source = page.read_text(encoding="utf-8")
    assert source.count("data:image/jpeg;base64,") == 6
    assert "All 6 frames are shown." in source
    assert " UTC. Research use only: not a medical device." in source


def test_an_existing_page_is_refused_before_any_frame_is_read(places, tmp_path: Path, capsys) -> None:
    page = tmp_path / "page.html"
    page.write_text("mine")
    assert run(["evaluate", str(places["model"]), str(places["a"]), "--html", str(page)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert page.read_text() == "mine"


def test_classify_answers_as_evaluate_does(places, capsys) -> None:
    frames = [str(places["a"] / "frames" / f"{number}.png") for number in range(6)]
    assert run(["classify", str(places["model"]), *frames, "--json"]) == 0
    answers = json.loads(capsys.readouterr().out)["frames"]
    expected = evaluate_recordings(load_model(places["model"]), [places["a"]]).frames
    assert [entry["file"] for entry in answers] == frames
    assert [entry["predicted"] for entry in answers] == [frame.answer.predicted for frame in expected]
    assert [entry["usable"] for entry in answers] == [frame.answer.usable for frame in expected]
    np.testing.assert_allclose(answers[1]["probabilities"], expected[1].answer.probabilities)


def test_classify_reads_a_frame_at_the_scale_that_it_is_told(places, capsys) -> None:
    frame = str(places["a"] / "frames" / "1.png")
    results = []
    for options in ([], ["--width-mm", "15", "--depth-mm", "4"], ["--width-mm", "5"], ["--refractive-index", "1.4"]):
        assert run(["classify", str(places["model"]), frame, "--json", *options]) == 0
        results.append(json.loads(capsys.readouterr().out)["frames"][0]["probabilities"])
    assert results[0] == results[1]
    assert results[0] != results[2]
    assert results[0] != results[3]
