"""Evaluations with a model of kind "reader": moduli from a calibration, force errors
and coverage, the commands.
"""

import json
import re
import shutil
from dataclasses import replace
from math import isnan
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import GAP_M, LIBRARY, MODULUS_PA, STUDY
from commands import said
from small_recordings import FORCES_N, write_places

from scleraforce.base.errors import CalibrationError, RecordingError
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.evaluation import (
    Evaluation,
    FrameAnswer,
    evaluate_recordings,
)
from scleraforce.reading.answer import Answer
from scleraforce.reading.load_model import load_reader
from scleraforce.reading.reading_models import Reader
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.eye import NO_DISCREPANCY, Eye, Modulus
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import MeshStudy

pytest.importorskip("torch")


@pytest.fixture(scope="module")
def places(tmp_path_factory) -> dict[str, Path]:
    return write_places(tmp_path_factory.mktemp("reader"))


@pytest.fixture(scope="module")
def model(places) -> Reader:
    return load_reader(places["model"])


@pytest.fixture(scope="module")
def both(places, model) -> Evaluation:
    return evaluate_recordings(
        model,
        [places["mine"], places["other"]],
        read_calibration(places["calibration"]),
    )


@pytest.fixture(scope="module")
def uncalibrated(places, model) -> Evaluation:
    return evaluate_recordings(model, [places["mine"]])


def width_n(frame: FrameAnswer) -> float:
    low_n, high_n = frame.answer.interval_n
    return high_n - low_n


def test_an_eye_is_read_with_its_own_modulus_and_a_stranger_with_the_populations(
    both, uncalibrated
) -> None:
    used = {
        frame.eye: (frame.youngs_modulus_pa, frame.modulus_source)
        for frame in both.frames
    }
    assert used["mine"] == (pytest.approx(MODULUS_PA), "own")
    assert used["stranger"] == (pytest.approx(1.1 * MODULUS_PA), "population")
    mine, other = (both.frames[start : start + 4] for start in (0, 5))

    for frame, stranger, force_n in zip(mine, other, FORCES_N, strict=True):
        assert frame.answer.force_n == pytest.approx(force_n, abs=1e-3)
        for one in (frame, stranger):
            low, high = one.answer.interval_n
            assert low < force_n < high

        assert width_n(stranger) > 1.2 * width_n(frame)

    assert (
        width_n(uncalibrated.frames[2])
        > width_n(both.frames[7])
        > width_n(both.frames[2])
    )
    assert uncalibrated.frames[2].modulus_source is None


def test_errors_and_coverage_count_usable_frames_outside_the_calibration(both) -> None:
    counted = [f for f in both.frames if f.answer.usable and not f.calibration]
    unusable = [(f.recording[-4:], f.file) for f in both.frames if not f.answer.usable]
    assert unusable == [("mine", "4.png"), ("ther", "4.png")]
    assert len(counted) == 7
    errors = [abs(f.answer.force_n - f.measured_force_n) for f in counted]
    assert both.mae_n == pytest.approx(np.mean(errors))
    assert all(f.measured_force_sd_n > 0.0 for f in counted)
    sds_n = 1.6449 * np.array([f.measured_force_sd_n for f in counted])
    off_n = np.array([f.measured_force_n - f.answer.force_n for f in counted])
    below_n, above_n = np.array(
        [np.subtract(f.answer.interval_n, f.answer.force_n) for f in counted]
    ).T
    assert both.coverage.value == np.mean(
        (off_n >= -np.hypot(below_n, sds_n)) & (off_n <= np.hypot(above_n, sds_n))
    )
    assert (both.accuracy.total, both.usable.accuracy.total) == (9, 7)
    assert both.accuracy.hits == 7
    assert both.usable.accuracy.value == 1.0


def test_the_truth_of_a_virtual_eye_decides_nothing_that_is_read_and_is_compared_with(
    places, model, tmp_path
) -> None:
    mine = shutil.copytree(places["mine"], tmp_path / "mine")
    calibration = read_calibration(places["calibration"])
    without = evaluate_recordings(model, [mine], calibration)
    assert without.to_dict()["truth"] is None
    true_n = [frame.answer.force_n or 0.0 for frame in without.frames]
    true_n[0] += 1.0  # far outside its interval
    truth = [
        {"file": frame.file, "force_n": n}
        for frame, n in zip(without.frames, true_n, strict=True)
    ]
    (mine / "truth.json").write_text(json.dumps({"frames": truth}))
    beside = evaluate_recordings(model, [mine], calibration)
    read, alone = (
        [frame.to_dict() for frame in found.frames] for found in (beside, without)
    )
    assert [frame | {"true_force_mn": None} for frame in read] == alone
    assert (beside.coverage, beside.to_dict()["truth"]) == (
        without.coverage,
        "truth.json",
    )
    compared = len(beside.true_forces)
    assert (beside.true_coverage.hits, beside.true_coverage.total) == (
        compared - 1,
        compared,
    )
    (mine / "truth.json").write_text("no JSON")

    with pytest.raises(RecordingError, match=r"truth\.json"):
        evaluate_recordings(model, [mine], calibration)


def test_a_stranger_read_with_the_populations_modulus_is_named_in_notes_and_warnings(
    places, both, capsys
) -> None:
    (note,) = [note for note in both.notes if "population's modulus" in note]
    assert (
        f"stranger is not in {places['calibration']}, which has 1 eye (mine): read with"
        " the pop" in note
    )
    mine = both.frames[:5]
    other = both.frames[5:]
    assert not any(
        "population" in warning for frame in mine for warning in frame.answer.warnings
    )
    assert all(
        "the modulus is the population's, not this eye's own" in frame.answer.warnings
        for frame in other
    )
    printed = said(
        capsys,
        "evaluate",
        places["model"],
        places["other"],
        "--calibration",
        places["calibration"],
    )
    assert "note: " in printed
    assert "stranger is not in" in " ".join(printed.split())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "kind"), [('globe = "sealed"\n', "sealed"), ("", "unknown")]
)
def test_the_globe_of_a_recording_reaches_reading_and_calibration(
    places, model, uncalibrated, tmp_path: Path, stated: str, kind: str
) -> None:
    path = shutil.copytree(places["mine"], tmp_path / "mine")
    text = (
        (path / "recording.toml")
        .read_text()
        .replace("[needle]\n", "[needle]\npolar_angle_rad = 0.0\n")
    )
    (path / "recording.toml").write_text(text.replace('globe = "open"\n', stated))
    found = evaluate_recordings(model, [path])

    for frame, of_open in zip(found.frames[1:4], uncalibrated.frames[1:4], strict=True):
        assert width_n(frame) > 1.05 * width_n(of_open)

    coarse = replace(STUDY, mesh=MeshStudy(divisions=4))
    eye = calibrate_recordings(
        [read_recording(path)], coarse, "0", library=LIBRARY, frames=2
    ).eyes["mine"]
    assert (eye.globe.kind, eye.globe.calibrated) == (kind, True)
    assert not any("globe" in doubt for doubt in eye.recordings[0].doubts)
    linear = calibrate_recordings(
        [read_recording(path)], coarse, "0", library=None, frames=1
    ).eyes["mine"]
    assert linear.globe.kind == "open"
    assert any(
        "linear mechanics" in doubt for doubt in linear.recordings[0].doubts
    ) == (kind == "sealed")


def test_forces_of_another_size_than_those_read_are_noted(
    places, model, tmp_path: Path
) -> None:
    path = shutil.copytree(places["mine"], tmp_path / "kilogram-force")
    log = np.loadtxt(path / "forces.csv", delimiter=",", skiprows=1)
    log[:, 1:] /= 9.80665
    header = (path / "forces.csv").read_text().splitlines()[0]
    np.savetxt(
        path / "forces.csv", log, fmt="%.6f", delimiter=",", header=header, comments=""
    )
    found = evaluate_recordings(model, [path], read_calibration(places["calibration"]))
    (times,) = re.findall(
        r"forces\.csv has ([0-9.]+) times the force that the frames show",
        " ".join(found.notes),
    )
    # as exact as four frames are read
    assert float(times) == pytest.approx(1 / 9.80665, rel=0.06)


def test_moduli_of_linear_walls_are_refused(places, model) -> None:
    with pytest.raises(
        CalibrationError, match="calibrate with `mechanics=finite-strain`"
    ):
        evaluate_recordings(model, [places["mine"]], read_calibration(places["linear"]))


def test_an_eye_outside_the_training_is_noted_and_all_its_frames_are_withdrawn_from(
    places, model
) -> None:
    found = evaluate_recordings(model, [places["far"]])
    assert "gap between B-scan and needle axis 1.5 mm" in found.notes[0]
    assert {
        (frame.answer.usable, frame.answer.predicted) for frame in found.frames
    } == {(False, 2)}
    assert isnan(found.mae_n)
    assert all(frame.answer.can_calibrate for frame in found.frames[:3])


def test_the_command_prints_forces_in_millinewtons(
    places, both, capsys, monkeypatch
) -> None:
    monkeypatch.chdir(places["mine"].parent)
    command = [
        "evaluate",
        "./model",
        "mine",
        "other",
        "--calibration",
        "calibration.json",
    ]
    result = json.loads(said(capsys, *command, "--json"))
    assert result["mae_mn"] == pytest.approx(1e3 * both.mae_n)
    assert result["coverage"] == both.coverage.value
    assert result["usable"]["accuracy"] == 1.0
    frame = result["frames"][2]
    blank = result["frames"][4]
    assert frame["predicted_force_mn"] == pytest.approx(22.0, abs=1.0)
    low, high = frame["interval_mn"]
    assert low < 22.0 < high
    assert frame["contact_mm"] == pytest.approx(0.3, abs=0.1)
    assert frame["can_calibrate"]
    # the network, which always gives the same answer, is unsure
    assert frame["warnings"] == []
    assert (blank["predicted_force_mn"], blank["interval_mn"], blank["contact_mm"]) == (
        None,
        None,
        None,
    )
    assert not blank["can_calibrate"]
    lines = said(capsys, *command).splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.startswith("force error") for line in lines)
    assert any("90 % interval and label agree" in line for line in lines)


@pytest.mark.slow
def test_intervals_are_stretched_to_hold_on_recordings(
    places, tmp_path: Path, capsys
) -> None:
    out = tmp_path / "stretched"
    command = [
        "calibrate",
        places["mine"],
        "--intervals",
        places["model"],
        "--frames",
        1,
        "--json",
        "--out",
        out,
    ]
    changes = {
        row["method"]: row for row in json.loads(said(capsys, *command))["stretches"]
    }
    assert set(changes) == {"fit", "network"}
    assert {(row["modulus"], *row["globes"]) for row in changes.values()} == {
        ("own E", "open")
    }
    assert all(
        (row["eyes"], row["readings"]) == (1, 3) and row["factor"] >= 1.0
        for row in changes.values()
    )
    before = load_reader(places["model"])
    after = load_reader(out)
    assert after.record["intervals"]["source"] == "recordings of mine"
    modulus = Modulus(mean_pa=MODULUS_PA, sd_pa=0.01 * MODULUS_PA, source="own")
    one_frame = replace(NO_DISCREPANCY, widest_gap=1.0)
    known = Setup(
        eye=Eye(modulus=modulus, globe=OPEN, discrepancy=one_frame),
        needle=Needle(gap_m=GAP_M),
    )
    pixels = read_frame(places["mine"] / "frames" / "2.png")
    scale = PixelScale.of(read_recording(places["mine"]).info.scan)
    was, now = (model.read(pixels, scale, known) for model in (before, after))
    assert now.force_n == was.force_n
    assert was.fit is not None
    widths = [answer.interval_n[1] - answer.force_n for answer in (was, now)]
    assert widths[1] / widths[0] == pytest.approx(changes["fit"]["factor"], rel=1e-4)


def test_intervals_take_a_reader_only_and_none_of_the_other_options(
    places, tmp_path: Path, capsys
) -> None:
    mine = places["mine"]
    model = places["model"]
    out = tmp_path / "new"

    for words, message in (
        ((model, "--out", out, "--mechanics", "linear"), "--intervals"),
        ((model, "--out", model), "exists already"),
        ((tmp_path / "none", "--out", out), "no such folder"),
    ):
        assert message in said(capsys, "calibrate", mine, "--intervals", *words, code=2)

    assert not out.exists()


def test_a_relaxing_eye_is_read_in_order_of_time_and_holds_of_frames_csv_count(
    places, model, tmp_path: Path
) -> None:
    mine = shutil.copytree(places["mine"], tmp_path / "mine")
    info = (mine / "recording.toml").read_text()
    (mine / "recording.toml").write_text(
        info.replace("[eye]", "[eye]\nrelaxation = [[0.12, 1.2], [0.15, 12.0]]")
    )
    elastic = evaluate_recordings(model, [places["mine"]])
    plain = evaluate_recordings(model, [mine])
    lines = (mine / "frames.csv").read_text().splitlines()
    held = ["1000", *[""] * (len(lines) - 2)]
    rows = map(",".join, zip(lines[1:], held, strict=True))
    (mine / "frames.csv").write_text("\n".join([f"{lines[0]},held_s", *rows]))
    told = evaluate_recordings(model, [mine])

    for before, after in zip(elastic.frames, plain.frames, strict=True):
        if before.answer.usable:
            assert after.answer.elastic_force_n == before.answer.force_n
            assert after.answer.force_n < before.answer.force_n

    first = told.frames[0].answer
    assert first.force_n == pytest.approx(0.73 * first.elastic_force_n, rel=1e-6)
    # what the first frame has left
    assert told.frames[1].answer != plain.frames[1].answer


def test_frames_in_a_row_say_when_the_highest_class_is_reached(
    places, model, tmp_path, monkeypatch
) -> None:
    folder = tmp_path / "moving"
    (folder / "frames").mkdir(parents=True)
    shutil.copy(places["mine"] / "recording.toml", folder)
    first = next((places["mine"] / "frames").iterdir())
    rows = [f"{n:02d}.png,{n}e-2\n" for n in range(14)]

    for row in rows:
        shutil.copy(first, folder / "frames" / row.partition(",")[0])

    (folder / "frames.csv").write_text("".join(["file,time_s\n", *rows]))
    forces_n = [0.010 + 5e-4 * n for n in range(13)] + [0.028]
    reads = iter(
        Answer(
            predicted=1,
            probabilities=(0.0, 1.0, 0.0),
            usable=True,
            reason=None,
            force_n=force_n,
            interval_n=(0.9 * force_n, force_n / 0.9),
        )
        for force_n in forces_n
    )
    monkeypatch.setattr(type(model), "read", lambda *_: next(reads))
    found = [frame.to_dict() for frame in evaluate_recordings(model, [folder]).frames]
    assert [frame["time_to_bound_ms"] for frame in found[:9]] == [None] * 9, (
        "ten frames make a line"
    )
    assert found[12]["time_to_bound_ms"] == pytest.approx(
        1e3 * (0.027 - forces_n[12]) / 0.05
    )
    early, late = found[12]["time_to_bound_ms_interval"]
    assert early < found[12]["time_to_bound_ms"] < late
    assert (found[13]["time_to_bound_ms"], found[13]["time_to_bound_ms_interval"]) == (
        0.0,
        [0.0, 0.0],
    )
