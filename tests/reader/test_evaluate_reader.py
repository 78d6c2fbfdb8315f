"""Evaluations with a model of kind "reader": moduli from a calibration, force errors and coverage, the commands."""

import json
import re
import shutil
from dataclasses import replace
from math import isnan
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import (
    GAP_M,
    IOP_PA,
    LIBRARY,
    MODULUS_PA,
    STUDY,
    THICKNESS_M,
)
from small_recordings import FORCES_N, write_places

from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.cli.main import run
from scleraforce.errors import CalibrationError, RecordingError
from scleraforce.known import NO_DISCREPANCY, OPEN, Known, Modulus
from scleraforce.known.calibration_file import read_calibration
from scleraforce.reader import Reader, load_model
from scleraforce.reader.evaluate import Evaluation, evaluate_recordings
from scleraforce.recording.folder import read_recording
from scleraforce.recording.images import read_frame
from scleraforce.recording.pixels import PixelScale
from scleraforce.study import MeshStudy
from scleraforce.units import from_si

pytest.importorskip("torch")


@pytest.fixture(scope="module")
def places(tmp_path_factory) -> dict[str, Path]:
    return write_places(tmp_path_factory.mktemp("reader"))


@pytest.fixture(scope="module")
def model(places) -> Reader:
    return load_model(places["model"])


@pytest.fixture(scope="module")
def both(places, model) -> Evaluation:
    return evaluate_recordings(model, [places["mine"], places["other"]], read_calibration(places["calibration"]))


@pytest.fixture(scope="module")
def uncalibrated(places, model) -> Evaluation:
    return evaluate_recordings(model, [places["mine"]])


def test_an_eye_is_read_with_its_own_modulus_and_a_stranger_with_the_populations(both) -> None:
    told = {frame.eye: (frame.youngs_modulus_pa, frame.modulus_source) for frame in both.frames}
    assert told["mine"] == (pytest.approx(MODULUS_PA), "own")
    assert told["stranger"] == (pytest.approx(1.1 * MODULUS_PA), "population")
    mine, other = (both.frames[start : start + 4] for start in (0, 5))
    for frame, stranger, force_n in zip(mine, other, FORCES_N, strict=True):
        low, high = frame.answer.interval_n
        assert frame.answer.force_n == pytest.approx(force_n, abs=1e-3)
        assert low < force_n < high
        wide_low, wide_high = stranger.answer.interval_n
        assert wide_high - wide_low > 1.2 * (high - low)
        assert wide_low < force_n < wide_high


def test_errors_and_coverage_are_those_of_the_usable_frames_that_count(both) -> None:
    counted = [f for f in both.frames if f.answer.usable and not f.calibration]
    assert [(f.recording[-4:], f.file) for f in both.frames if not f.answer.usable] == [
        ("mine", "4.png"),
        ("ther", "4.png"),
    ]
    assert len(counted) == 7
    errors = [abs(f.answer.force_n - f.measured_force_n) for f in counted]
    assert both.mae_n == pytest.approx(np.mean(errors))
    assert all(f.measured_force_sd_n > 0.0 for f in counted)
    sds_n = 1.6449 * np.array([f.measured_force_sd_n for f in counted])
    off_n = np.array([f.measured_force_n - f.answer.force_n for f in counted])
    below_n, above_n = np.array([np.subtract(f.answer.interval_n, f.answer.force_n) for f in counted]).T
    assert both.coverage.value == np.mean((off_n >= -np.hypot(below_n, sds_n)) & (off_n <= np.hypot(above_n, sds_n)))
    assert (both.accuracy.total, both.usable.accuracy.total) == (9, 7)
    assert both.accuracy.hits == 7
    assert both.usable.accuracy.value == 1.0


def test_the_truth_of_a_virtual_eye_decides_nothing_that_is_read_and_is_compared_with(
    places, model, tmp_path: Path
) -> None:
    mine = shutil.copytree(places["mine"], tmp_path / "mine")
    calibration = read_calibration(places["calibration"])
    without = evaluate_recordings(model, [mine], calibration)
    assert without.as_json()["truth"] is None
    true_n = [frame.answer.force_n or 0.0 for frame in without.frames]
    true_n[0] += 1.0  # far outside its interval
    truth = [{"file": frame.file, "force_n": n} for frame, n in zip(without.frames, true_n, strict=True)]
    (mine / "truth.json").write_text(json.dumps({"frames": truth}))
    beside = evaluate_recordings(model, [mine], calibration)
    assert [frame.as_json() | {"true_force_mn": None} for frame in beside.frames] == [
        frame.as_json() for frame in without.frames
    ]
    assert (beside.coverage, beside.as_json()["truth"]) == (without.coverage, "truth.json")
    compared = len(beside.true_forces)
    assert (beside.true_coverage.hits, beside.true_coverage.total) == (compared - 1, compared)
    (mine / "truth.json").write_text("no JSON")
    with pytest.raises(RecordingError, match=r"truth\.json"):
        evaluate_recordings(model, [mine], calibration)


def test_a_stranger_read_with_the_populations_modulus_is_named_in_notes_and_warnings(places, both, capsys) -> None:
    (note,) = [note for note in both.notes if "population's modulus" in note]
    assert f"stranger is not in {places['calibration']}, which has 1 eye (mine): read with the pop" in note
    mine, other = both.frames[:5], both.frames[5:]
    assert not any("population" in warning for frame in mine for warning in frame.answer.warnings)
    assert all("the modulus is the population's, not this eye's own" in frame.answer.warnings for frame in other)
    assert (
        run(["evaluate", str(places["model"]), str(places["other"]), "--calibration", str(places["calibration"])]) == 0
    )
    assert "note: " in (printed := capsys.readouterr().out)
    assert "stranger is not in" in " ".join(printed.split())


@pytest.mark.slow
@pytest.mark.parametrize(("stated", "kind"), [('globe = "sealed"\n', "sealed"), ("", "unknown")])
def test_what_a_recording_says_of_its_globe_reaches_reading_and_calibration(
    places, model, uncalibrated, tmp_path: Path, stated: str, kind: str
) -> None:
    path = shutil.copytree(places["mine"], tmp_path / "mine")
    text = (path / "recording.toml").read_text().replace("[needle]\n", "[needle]\npolar_angle_rad = 0.0\n")
    (path / "recording.toml").write_text(text.replace('globe = "open"\n', stated))
    found = evaluate_recordings(model, [path])
    for frame, of_open in zip(found.frames[1:4], uncalibrated.frames[1:4], strict=True):
        assert np.diff(frame.answer.interval_n) > 1.05 * np.diff(of_open.answer.interval_n)
    coarse = replace(STUDY, mesh=MeshStudy(divisions=4))
    eye = calibrate_recordings([read_recording(path)], coarse, "0", library=LIBRARY, frames=2).eyes["mine"]
    assert (eye.globe.kind, eye.globe.calibrated) == (kind, True)
    assert not any("globe" in doubt for doubt in eye.recordings[0].doubts)
    linear = calibrate_recordings([read_recording(path)], coarse, "0", library=None, frames=1).eyes["mine"]
    assert linear.globe.kind == "open"
    assert any("linear mechanics" in doubt for doubt in linear.recordings[0].doubts) == (kind == "sealed")


def test_forces_of_another_size_than_those_read_are_noted(places, model, tmp_path: Path) -> None:
    path = shutil.copytree(places["mine"], tmp_path / "kilogram-force")
    log = np.loadtxt(path / "forces.csv", delimiter=",", skiprows=1)
    log[:, 1:] /= 9.80665
    header = (path / "forces.csv").read_text().splitlines()[0]
    np.savetxt(path / "forces.csv", log, fmt="%.6f", delimiter=",", header=header, comments="")
    found = evaluate_recordings(model, [path], read_calibration(places["calibration"]))
    (times,) = re.findall(r"forces\.csv has ([0-9.]+) times the force that the frames show", " ".join(found.notes))
    assert float(times) == pytest.approx(1 / 9.80665, rel=0.06)  # as exact as four frames are read


def test_without_a_calibration_the_modulus_is_unknown_and_the_interval_says_so(uncalibrated, both) -> None:
    widths = [
        from_si(f.answer.interval_n[1] - f.answer.interval_n[0], "mn")
        for f in (uncalibrated.frames[2], both.frames[2], both.frames[7])
    ]
    assert widths[0] > widths[2] > widths[1]
    assert uncalibrated.frames[2].modulus_source is None


def test_moduli_of_linear_walls_are_refused(places, model) -> None:
    with pytest.raises(CalibrationError, match="calibrate with --mechanics finite-strain"):
        evaluate_recordings(model, [places["mine"]], read_calibration(places["linear"]))


def test_an_eye_outside_the_training_is_noted_and_all_its_frames_are_withdrawn_from(places, model) -> None:
    found = evaluate_recordings(model, [places["far"]])
    assert "gap between B-scan and needle axis 1.5 mm" in found.notes[0]
    assert {(frame.answer.usable, frame.answer.predicted) for frame in found.frames} == {(False, 2)}
    assert isnan(found.mae_n)
    assert all(frame.answer.can_calibrate for frame in found.frames[:3])


def test_the_command_prints_forces_in_millinewtons(places, both, capsys) -> None:
    arguments = [str(places[name]) for name in ("model", "mine", "other")]
    assert run(["evaluate", *arguments, "--calibration", str(places["calibration"]), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["mae_mn"] == pytest.approx(1e3 * both.mae_n)
    assert result["coverage"] == both.coverage.value
    assert result["usable"]["accuracy"] == 1.0
    frame, blank = result["frames"][2], result["frames"][4]
    assert frame["predicted_force_mn"] == pytest.approx(22.0, abs=1.0)
    low, high = frame["interval_mn"]
    assert low < 22.0 < high
    assert frame["contact_mm"] == pytest.approx(0.3, abs=0.1)
    assert frame["can_calibrate"]
    assert frame["warnings"] == []  # the network, which answers always the same, is unsure
    assert (blank["predicted_force_mn"], blank["interval_mn"], blank["contact_mm"]) == (None, None, None)
    assert not blank["can_calibrate"]


def test_the_commands_text_has_forces_and_fits_80_columns(places, capsys, monkeypatch) -> None:
    monkeypatch.chdir(places["mine"].parent)
    assert run(["evaluate", "model", "mine", "--calibration", "calibration.json"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert any(line.startswith("force error") for line in lines)
    assert any("90 % interval and label agree" in line for line in lines)


def test_classify_reads_more_the_more_it_is_told(places, capsys, tmp_path) -> None:
    alone = tmp_path / "2.png"  # no recording states what is known of its eye
    alone.write_bytes((places["mine"] / "frames" / "2.png").read_bytes())
    frame, size = str(alone), ["--width-mm", "15", "--depth-mm", "4"]
    told = [
        "--youngs-modulus-mpa", str(MODULUS_PA / 1e6), "--iop-mmhg", str(IOP_PA / 133.322),
        "--thickness-um", str(THICKNESS_M * 1e6), "--gap-mm", str(GAP_M * 1e3),
        "--globe", "open",
    ]  # fmt: skip
    widths = []
    for options in (told, told[2:], []):
        assert run(["classify", str(places["model"]), frame, *size, "--json", *options]) == 0
        (entry,) = json.loads(capsys.readouterr().out)["frames"]
        low, high = entry["interval_mn"]
        assert low < 22.0 < high
        widths.append(high - low)
    assert widths == sorted(widths)
    assert run(["classify", str(places["model"]), frame, *size, *told]) == 0
    assert "mN (90 %:" in capsys.readouterr().out


def test_classify_withdraws_from_an_eye_that_it_was_not_made_for(places, capsys) -> None:
    frame = str(places["mine"] / "frames" / "0.png")
    assert run(["classify", str(places["model"]), frame, "--json", "--iop-mmhg", "30"]) == 0
    (entry,) = json.loads(capsys.readouterr().out)["frames"]
    assert (entry["usable"], entry["predicted"], entry["predicted_force_mn"]) == (False, 2, None)
    assert entry["reason"].startswith("IOP 30 mmHg")


@pytest.mark.parametrize("option", ["--youngs-modulus-mpa", "--iop-mmhg", "--thickness-um", "--gap-mm"])
def test_classify_refuses_what_is_not_a_number(places, capsys, option: str) -> None:
    frame = str(places["mine"] / "frames" / "0.png")
    assert run(["classify", str(places["model"]), frame, "--json", option, "nan"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"error: Invalid value for '{option}': nan is not a finite number; ")
    assert printed.err.count("\n") == 1


@pytest.mark.slow
def test_intervals_are_stretched_to_hold_on_recordings(places, tmp_path: Path, capsys) -> None:
    out = tmp_path / "stretched"
    command = ["calibrate", str(places["mine"]), "--intervals", str(places["model"]), "--frames", "1", "--json"]
    assert run([*command, "--out", str(out)]) == 0
    found = json.loads(capsys.readouterr().out)
    changes = {row["method"]: row for row in found["stretches"]}
    assert set(changes) == {"fit", "network"}
    assert {(row["modulus"], *row["globes"]) for row in changes.values()} == {("own E", "open")}
    assert all(row["eyes"] == 1 and row["factor"] >= 1.0 for row in changes.values())
    before, after = load_model(places["model"]), load_model(out)
    assert after.record["intervals"]["source"] == "recordings of mine"
    modulus = Modulus(mean_pa=MODULUS_PA, sd_pa=0.01 * MODULUS_PA, source="own")
    one_frame = replace(NO_DISCREPANCY, widest_gap=1.0)
    known = Known(modulus=modulus, gap_m=GAP_M, globe=OPEN, discrepancy=one_frame)
    pixels = read_frame(places["mine"] / "frames" / "2.png")
    scale = PixelScale.of(read_recording(places["mine"]).info.oct)
    was, now = (model.read(pixels, scale, known) for model in (before, after))
    assert now.force_n == was.force_n
    assert was.fit is not None
    widths = [answer.interval_n[1] - answer.force_n for answer in (was, now)]
    assert widths[1] / widths[0] == pytest.approx(changes["fit"]["factor"], rel=1e-4)


def test_intervals_take_a_reader_only_and_none_of_the_other_options(places, tmp_path: Path, capsys) -> None:
    command = ["calibrate", str(places["mine"]), "--intervals", str(places["model"]), "--out", str(tmp_path / "new")]
    assert run([*command, "--mechanics", "linear"]) == 2
    assert "--intervals" in capsys.readouterr().err
    assert run([*command[:-1], str(places["model"])]) == 2
    assert "exists already" in capsys.readouterr().err
    assert run([*command[:3], str(tmp_path / "none"), *command[4:]]) == 2
    assert "no such folder" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
