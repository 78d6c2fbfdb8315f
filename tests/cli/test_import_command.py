"""`scleraforce import`: recordings from files of other programs, asked for what these leave open."""

import json
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
import tifffile
from effects import contents
from foreign_files import COLUMNS, COUNT, DEPTH_M, FRAMES, LATERAL_M, ROWS, told, with_log, write_dicom, write_log
from small_recordings import write_small_recording

from scleraforce.cli.import_ import import_
from scleraforce.cli.main import run
from scleraforce.recording import importing
from scleraforce.recording.folder import read_recording
from scleraforce.recording.sources import ImportOptions

REAL = Path(__file__).parents[3] / "shared" / "recordings" / "sample-a"
NIFTI = ["--axes", "lateral,depth,frame"]


def stack(path: Path, **stated: object) -> Path:
    """A TIFF that states its scale and when its frames were taken."""
    resolution = (1e-6 / LATERAL_M, 1e-6 / DEPTH_M)
    metadata = {"axes": "TYX", "unit": "um", "finterval": 1.0, **stated}
    tifffile.imwrite(path, FRAMES, imagej=True, resolution=resolution, metadata=metadata)
    return path


def imported(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict:
    assert run(["import", *map(str, arguments), "--json"]) == 0, capsys.readouterr().err
    return json.loads(capsys.readouterr().out)


def refused(capsys: pytest.CaptureFixture[str], out: Path, *arguments: object) -> str:
    before = sorted(out.parent.rglob("*"))
    assert run(["import", *map(str, arguments), "--out", str(out)]) == 2
    assert sorted(out.parent.rglob("*")) == before
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    return error


def test_frames_and_forces_become_a_recording_that_says_where_values_come_from(tmp_path: Path, capsys) -> None:
    force_n = write_log(tmp_path / "log.csv")
    sources = [stack(tmp_path / "a.tif"), tmp_path / "log.csv"]
    entry = imported(
        capsys, *sources, "--out", tmp_path / "r", *told("--bits", 13, "--clock-offset-s", 0.5, "--contact-sign", -1)
    )
    recording = read_recording(tmp_path / "r")
    for frame, pixels in zip(recording.frames, FRAMES, strict=True):
        np.testing.assert_array_equal(recording.frame(frame), pixels)
    assert [frame.time_s for frame in recording.frames] == [0.5, 1.5, 2.5, 3.5, 4.5]
    np.testing.assert_allclose(recording.forces.force_n("fz"), force_n, atol=1e-7)
    info = recording.info
    assert (info.oct.width_m, info.oct.depth_m) == pytest.approx((COLUMNS * LATERAL_M, ROWS * DEPTH_M))
    assert (info.oct.refractive_index, info.oct.bits, info.needle.gauge, info.eye.id) == (1.38, 13, 22, "eye-1")
    assert (info.force.axis, info.force.contact_sign) == ("fz", -1)
    assert entry["values"] == {
        "width_mm": "ImageJ's unit", "depth_mm": "ImageJ's unit", "refractive_index": "option", "bits": "option",
        "clock_offset_s": "option", "axis": "the only force of the log", "contact_sign": "option", "eye": "option",
        "gauge": "option", "gap_mm": "option", "times": "ImageJ's finterval",
    }  # fmt: skip
    assert (entry["frames"], entry["force_samples"]) == (COUNT, len(force_n))
    kept = json.loads((tmp_path / "r" / "import.json").read_text())
    assert [file["kind"] for file in kept["files"]] == ["tiff", "log"]
    assert kept["answers"] == {"columns": ["time=Time (ms):ms", "fz=Force_Z [mN]:mN"]}
    assert cv2.imread(str(tmp_path / "r" / "preview.png")).shape[1] == pytest.approx(170 / 25.4 * 200, abs=2)


def test_a_second_import_writes_the_same_bytes(tmp_path: Path, capsys) -> None:
    source = stack(tmp_path / "a.tif")
    for name in ("r", "s"):
        imported(capsys, source, "--out", tmp_path / name, *told("--bits", 16))
    assert contents(tmp_path / "r") == contents(tmp_path / "s")


def test_without_a_terminal_all_that_is_missing_is_named_at_once_and_nothing_is_written(tmp_path: Path, capsys) -> None:
    for nth in range(2):
        cv2.imwrite(str(tmp_path / f"{nth}.png"), FRAMES[nth])
    write_log(tmp_path / "log.csv")
    (tmp_path / "out").mkdir()
    error = refused(capsys, tmp_path / "out" / "r", tmp_path / "0.png", tmp_path / "1.png", tmp_path / "log.csv")
    asked = [question for name, question in importing.QUESTIONS.items() if name != "axis"]
    assert [f"({question.options})" in error for question in asked] == [not question.optional for question in asked]


def test_half_a_scale_is_not_enough(tmp_path: Path, capsys) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), FRAMES[0])
    for given, missing in (("--width-mm", "--depth-mm"), ("--depth-mm", "--width-mm")):
        error = refused(capsys, tmp_path / "r", tmp_path / "a.png", *told("--bits", 16), given, 3)
        assert f"({missing})" in error
        assert f"({given})" not in error


def test_one_frame_needs_no_rate_and_one_without_forces_no_offset(tmp_path: Path, capsys) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), FRAMES[0])
    size = ["--width-mm", "10", "--depth-mm", "4"]
    entry = imported(capsys, tmp_path / "a.png", "--out", tmp_path / "r", *told("--bits", 13), *size)
    assert entry["force_samples"] is None
    recording = read_recording(tmp_path / "r")
    assert [(frame.file, frame.time_s) for frame in recording.frames] == [("a.png", 0.0)]
    assert recording.info.force is None


def test_options_come_before_the_file_and_the_file_before_another_recording(tmp_path: Path, capsys) -> None:
    size = ["--width-mm", "9", "--depth-mm", "8"]
    first = imported(capsys, stack(tmp_path / "a.tif"), "--out", tmp_path / "r", *told("--bits", 16), *size)
    assert (first["width_mm"], first["values"]["width_mm"]) == (9.0, "option")
    like = ["--like", tmp_path / "r", "--eye", "eye-2"]
    second = imported(capsys, tmp_path / "a.tif", "--out", tmp_path / "s", *like)
    assert second["width_mm"] == pytest.approx(COLUMNS * LATERAL_M * 1e3)
    assert second["values"]["width_mm"] == "ImageJ's unit"
    assert second["values"]["gauge"] == f"like {tmp_path / 'r'}"
    write_dicom(tmp_path / "b.dcm", FRAMES, FrameTime=100.0)
    third = imported(capsys, tmp_path / "b.dcm", "--out", tmp_path / "t", *like)
    assert (third["width_mm"], third["values"]["width_mm"]) == (9.0, f"like {tmp_path / 'r'}")


def test_a_recording_comes_back_from_its_own_files(tmp_path: Path, capsys) -> None:
    folder = with_log(write_small_recording(tmp_path / "small", frames=12))
    sources = [folder / "frames", folder / "forces.csv", "--times", folder / "frames.csv"]
    entry = imported(capsys, *sources, "--out", tmp_path / "r", "--like", folder, "--eye", "small")
    first, second = read_recording(folder), read_recording(tmp_path / "r")
    assert second.info == first.info
    assert second.frames == first.frames
    for frame in first.frames:
        np.testing.assert_array_equal(second.frame(frame), first.frame(frame))
    np.testing.assert_allclose(second.forces.force_n("fz"), first.forces.force_n("fz"), rtol=1e-6)
    assert entry["values"]["times"] == str(folder / "frames.csv")


def test_single_precision_of_a_scale_is_no_digit_of_it(tmp_path: Path, capsys) -> None:
    nibabel = pytest.importorskip("nibabel")
    image = nibabel.Nifti1Image(FRAMES.T, np.eye(4))
    image.header.set_zooms((0.3, 0.1, 1.0))
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "a.nii")
    options = told("--bits", 16, "--rate-hz", 1, *NIFTI)
    entry = imported(capsys, tmp_path / "a.nii", "--out", tmp_path / "r", *options)
    assert (entry["width_mm"], entry["depth_mm"]) == (12.0, 2.4)


def test_damage_is_reported_in_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    stack(tmp_path / "a.tif")
    write_dicom(tmp_path / "a.dcm", FRAMES)
    (tmp_path / "a.avi").write_bytes(b"RIFF\0\0\0\0AVI LIST" + bytes(500))
    for path in sorted(tmp_path.iterdir()):
        data = path.read_bytes()
        path.write_bytes(data[: len(data) // 2])
        error = refused(capfd, tmp_path / "r", path)  # of the libraries' C code, too
        assert error.startswith(f"error: {path}")


def test_the_columns_of_a_log_are_told_once(tmp_path: Path, capsys) -> None:
    lines = [f"{n},{n / 200},{-0.001 * n}" for n in range(400)]
    (tmp_path / "log.csv").write_text("\n".join(["n,when,pull", *lines]) + "\n")
    sources = [stack(tmp_path / "a.tif"), tmp_path / "log.csv"]
    options = told("--bits", 16, "--clock-offset-s", 0)
    error = refused(capsys, tmp_path / "r", *sources, *options)
    assert (
        "which column is the time, and which a force, and in what unit? There are 'n', 'when', 'pull'; give --column"
        in error
    )
    columns = ["--column", "time=when:s", "--column", "fz=pull:mN", "--contact-sign", "-1"]
    imported(capsys, *sources, "--out", tmp_path / "r", *options, *columns)
    imported(capsys, *sources, "--out", tmp_path / "s", "--like", tmp_path / "r", "--eye", "b", "--clock-offset-s", 0)
    for name in ("r", "s"):
        assert read_recording(tmp_path / name).forces.force_n("fz")[100] == pytest.approx(-0.1e-3)


def test_floats_are_scaled_and_that_is_said(tmp_path: Path, capsys) -> None:
    frames = FRAMES.astype(np.float32) - 700.0
    frames[0, 0, 0] = np.nan
    np.save(tmp_path / "a.npy", frames)
    size = ["--width-mm", 10, "--depth-mm", 4, "--rate-hz", 5, "--axes", "frame,depth,lateral"]
    assert run(["import", str(tmp_path / "a.npy"), "--out", str(tmp_path / "r"), *told(*size)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"pixels of -699 to {FRAMES.max() - 700} became counts of 0 to 65535" in said
    assert "1 pixels are not finite numbers; they became 0" in said
    recording = read_recording(tmp_path / "r")
    assert int(recording.frame(recording.frames[-1]).max()) == 65535
    assert recording.info.oct.bits == 16


def test_a_value_beyond_what_a_recording_may_have_is_refused(tmp_path: Path, capsys) -> None:
    write_dicom(tmp_path / "a.dcm", FRAMES[0], PixelSpacing=[1.0, 5.0])
    error = refused(capsys, tmp_path / "r", tmp_path / "a.dcm", *told())
    assert "a.dcm: width_m: 0.2 is above the largest allowed value 0.1; " in error


def test_more_bits_than_were_told_are_refused(tmp_path: Path, capsys) -> None:
    assert "--bits says 8" in refused(capsys, tmp_path / "r", stack(tmp_path / "a.tif"), *told("--bits", 8))


def test_a_scale_that_is_told_against_the_file_is_noted(tmp_path: Path, capsys) -> None:
    width_mm = COLUMNS * LATERAL_M * 1e3
    path = stack(tmp_path / "a.tif")
    same = imported(capsys, path, "--out", tmp_path / "r", *told("--bits", 16, "--width-mm", width_mm))
    assert not any("states" in note for note in same["notes"])
    other = imported(capsys, path, "--out", tmp_path / "s", *told("--bits", 16, "--width-mm", 2 * width_mm))
    stated = f"width of the frames: {2 * width_mm:g} mm (option), where ImageJ's unit states {width_mm:g} mm"
    assert other["notes"][0] == stated


def test_frames_without_forces_beside_them_are_counted(tmp_path: Path, capsys) -> None:
    write_log(tmp_path / "log.csv")
    options = told("--bits", 16, "--clock-offset-s", -1.5, "--contact-sign", -1)
    entry = imported(capsys, stack(tmp_path / "a.tif"), tmp_path / "log.csv", "--out", tmp_path / "r", *options)
    assert any(note.startswith("2 frames were taken before or after the forces") for note in entry["notes"])


def test_clocks_that_do_not_overlap_are_refused(tmp_path: Path, capsys) -> None:
    write_log(tmp_path / "log.csv")
    options = told("--bits", 16, "--clock-offset-s", 1000, "--contact-sign", -1)
    error = refused(capsys, tmp_path / "r", stack(tmp_path / "a.tif"), tmp_path / "log.csv", *options)
    assert "the clocks do not overlap: frames at 1000.000 to" in error
    assert "--clock-offset-s brings both to one clock" in error


def test_forces_that_no_needle_gives_are_refused_before_the_recording_exists(tmp_path: Path, capsys) -> None:
    rng, time_s = np.random.default_rng(0), np.arange(0.0, 8.0, 0.005)
    log, source = tmp_path / "log.csv", stack(tmp_path / "a.tif")
    options = told("--bits", 16, "--clock-offset-s", 2, "--contact-sign", -1, "--column")
    for force_n, noise_n in ((28_780.0, 0.0), (4.0, 0.0), (0.03, 2.0)):
        pushed_n = force_n * np.clip(time_s - 1.0, 0.0, 1.0) + noise_n * rng.normal(size=len(time_s))
        np.savetxt(log, np.column_stack([time_s, -pushed_n]), "%.4f", ",", header="time_s,Fz", comments="")
        error = refused(capsys, tmp_path / "r", source, log, *options, "fz=Fz:N")
        assert f"{log}: fz_n: " in error
        assert "fz=Fz:N" in error
        imported(capsys, source, log, "--out", tmp_path / f"r-{force_n}", *options, "fz=Fz:uN")


def test_a_slow_log_is_refused_by_its_own_name(tmp_path: Path, capsys) -> None:
    write_log(tmp_path / "log.csv", rate_hz=10.0)
    options = told("--bits", 16, "--clock-offset-s", 0, "--contact-sign", -1)
    error = refused(capsys, tmp_path / "r", stack(tmp_path / "a.tif"), tmp_path / "log.csv", *options)
    assert f"{tmp_path}/log.csv: time_s: 10 samples a second; at least 20 are needed" in error


def test_an_option_with_nothing_to_act_on_is_refused(tmp_path: Path, capsys) -> None:
    unused = {
        "a force log": ("--axis fz", "--contact-sign 1", "--average-s 1", "--clock-offset-s 0"),
        "a force log of text": ("--column fz=a:N",),
        "a ROS bag": ("--image-topic /a", "--force-topic /a", "--by-arrival"),
        "an .npz file": ("--array a",),
    }
    source = stack(tmp_path / "a.tif")
    for what, options in unused.items():
        for option in options:
            error = refused(capsys, tmp_path / "r", source, *told("--bits", 16), *option.split())
            name = option.split()[0]
            assert error == f"error: {name}: acts on {what}, which is not among the sources; leave it out\n"
    np.save(tmp_path / "a.npy", FRAMES)  # one array, without a name
    options = told("--bits", 16, "--axes", "frame,depth,lateral", "--array", "a")
    assert "--array: acts on an .npz file" in refused(capsys, tmp_path / "r", tmp_path / "a.npy", *options)


def test_a_value_that_no_eye_has_is_refused_by_its_option(tmp_path: Path, capsys) -> None:
    source = stack(tmp_path / "a.tif")
    for option, value in (("--thickness-um", 0.65), ("--iop-mmhg", -1)):
        error = refused(capsys, tmp_path / "r", source, *told("--bits", 16, option, value))
        assert f"Invalid value for '{option}'" in error


def test_a_rate_takes_frames_off_the_clock_of_their_bag(tmp_path: Path, capsys) -> None:
    from ros_bag import write_bag

    bag = write_bag(tmp_path / "bag", "mcap")
    size = ["--width-mm", 10, "--depth-mm", 4, "--bits", 13, "--axis", "fz", "--contact-sign", -1]
    error = refused(capsys, tmp_path / "r", bag, *told(*size, "--rate-hz", 4))
    assert "(--clock-offset-s)" in error


def test_a_bag_gives_frames_and_forces_on_one_clock_that_begins_near_them(tmp_path: Path, capsys) -> None:
    from ros_bag import FORCE_TIMES_S, FRAME_TIMES_S, START_NS, write_bag

    bag = write_bag(tmp_path / "bag", "mcap")
    size = ["--width-mm", 10, "--depth-mm", 4, "--bits", 13, "--axis", "fz", "--contact-sign", -1, "--average-s", 0.1]
    entry = imported(capsys, bag, "--out", tmp_path / "r", *told(*size))
    recording = read_recording(tmp_path / "r")
    assert entry["clock_origin_s"] == START_NS / 1e9
    np.testing.assert_allclose([frame.time_s for frame in recording.frames], FRAME_TIMES_S, atol=2e-6)
    np.testing.assert_allclose(recording.forces.time_s, FORCE_TIMES_S, atol=2e-6)
    assert recording.info.force.average_s == 0.1
    assert any("arrived 80.0 ms" in note for note in entry["notes"])
    assert sum("messages arrived" in note for note in entry["notes"]) == 2  # images and forces
    assert entry["values"]["times"] == "header.stamp of /oct/image"


def test_every_question_is_an_option_and_every_option_an_answer() -> None:
    names = {parameter.name for parameter in import_.params if isinstance(parameter, click.Option)}
    fields = set(ImportOptions.__dataclass_fields__)
    assert set(importing.QUESTIONS) <= fields == names - {"out", "like", "model", "json", "quiet"}


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/recordings")
def test_frames_of_a_real_recording_come_back_from_every_format(tmp_path: Path, capsys) -> None:
    nibabel = pytest.importorskip("nibabel")
    recording = read_recording(REAL)
    frames = np.stack([recording.frame(entry) for entry in recording.frames[:3]])
    tifffile.imwrite(tmp_path / "a.tif", frames, photometric="minisblack")
    write_dicom(tmp_path / "a.dcm", frames, PixelSpacing=[4.0 / 512, 15.0 / 512], BitsStored=12, HighBit=11)
    nibabel.save(nibabel.Nifti1Image(frames.T, np.diag([15.0 / 512, 4.0 / 512, 1.0, 1.0])), tmp_path / "a.nii.gz")
    for name in ("a.tif", "a.dcm", "a.nii.gz"):
        out = tmp_path / f"{name}-out"
        like = ["--like", REAL, "--eye", "sample-a", "--thickness-um", 700, "--rate-hz", 1, *NIFTI]
        imported(capsys, tmp_path / name, "--out", out, *(like if name == "a.nii.gz" else like[:-2]))
        found = read_recording(out)
        np.testing.assert_array_equal(np.stack([found.frame(entry) for entry in found.frames]), frames)
        assert found.info.oct == recording.info.oct
    masks = tmp_path / "masks"
    assert run(["segment", str(tmp_path / "a.dcm-out"), "--out", str(masks), "--json"]) == 0
    assert all(frame["usable"] for frame in json.loads(capsys.readouterr().out)["frames"])


def test_scales_that_contradict_each_other_need_both_options_and_are_noted_then(tmp_path: Path, capsys) -> None:
    nominal = {"PixelSpacing": [0.004, 0.015], "NominalScannedPixelSpacing": [0.01, 0.02]}
    write_dicom(tmp_path / "a.dcm", FRAMES, FrameTime=100.0, **nominal)
    for given in ([], ["--width-mm", 6]):
        error = refused(capsys, tmp_path / "r", tmp_path / "a.dcm", *given, *told("--bits", 13))
        for found in ("PixelSpacing", "0.004 x 0.015 mm", "NominalScannedPixelSpacing", "0.01 x 0.02 mm", "--width-mm"):
            assert found in error
    options = told("--bits", 13, "--width-mm", 6, "--depth-mm", 3)
    entry = imported(capsys, tmp_path / "a.dcm", "--out", tmp_path / "r", *options)
    assert any("NominalScannedPixelSpacing" in note for note in entry["notes"])
    assert json.loads((tmp_path / "r" / "import.json").read_text())["notes"] == entry["notes"]


def test_times_that_contradict_each_other_need_an_option(tmp_path: Path, capsys) -> None:
    write_dicom(tmp_path / "a.dcm", FRAMES, FrameTimeVector=[0.0, 1.0], PixelSpacing=[0.004, 0.015])
    error = refused(capsys, tmp_path / "r", tmp_path / "a.dcm", *told("--bits", 13))
    assert "FrameTimeVector has 2 values, NumberOfFrames is 5" in error
    assert "--rate-hz" in error
    imported(capsys, tmp_path / "a.dcm", "--out", tmp_path / "r", *told("--bits", 13, "--rate-hz", 10))
    assert [frame.time_s for frame in read_recording(tmp_path / "r").frames] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])


def test_what_was_done_to_the_pixels_is_in_import_json_and_printed(tmp_path: Path, capsys) -> None:
    write_dicom(tmp_path / "a.dcm", 65535 - FRAMES, RescaleSlope=-1.0, FrameTime=100.0, PixelSpacing=[0.004, 0.015])
    assert run(["import", str(tmp_path / "a.dcm"), "--out", str(tmp_path / "r"), *told("--bits", 16)]) == 0
    assert "note:" in (printed := capsys.readouterr().out)
    assert "RescaleSlope -1" in " ".join(printed.split())
    assert "RescaleSlope -1" in " ".join(json.loads((tmp_path / "r" / "import.json").read_text())["notes"])
    recording = read_recording(tmp_path / "r")
    np.testing.assert_array_equal(recording.frame(recording.frames[3]), FRAMES[3])
