"""Calibrations that should not exist are refused, with the likely cause."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import copytree

import cv2
import numpy as np
import pytest
from analytic_frames import LIBRARY, STUDY, THICKNESS_M
from small_recordings import (
    PUSHES_MN,
    calibration_text,
    write_places,
    write_pushes,
)

from scleraforce.base.errors import CalibrationError, RecordingError
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.calibration import Calibration
from scleraforce.calibration.calibration_checks import (
    check_recording,
    checked_calibration,
)
from scleraforce.front.api.reading_frames import (
    evaluate,
    load_model,
    read,
    summary_of_calibration,
)
from scleraforce.front.cli.main import run
from scleraforce.reading.load_model import load_wall_finder
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import (
    Appearance,
    CalibrationSummary,
    appearance_doubt,
    other_eye,
    parse_calibration_file,
    summary_of,
)
from scleraforce.records.decoder import format_record
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER

FRAMES = 4


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pushes(tmp_path_factory.mktemp("pushed") / "eye-a")


@pytest.fixture(scope="module")
def other_log(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The log of another eye, pushed in another order."""
    forces_mn = np.roll(PUSHES_MN[::-1], 4)
    other = write_pushes(tmp_path_factory.mktemp("other") / "b", "b", forces_mn)
    return (other / "forces.csv").read_text()


@pytest.fixture(scope="module")
def calibration(pushed: Path) -> Calibration:
    recording = read_recording(pushed)
    return calibrate_recordings([recording], STUDY, "", LIBRARY, ("e",), FRAMES)


@pytest.fixture
def changed(pushed: Path, tmp_path: Path) -> Callable[..., Recording]:
    """Return the recording with other frames, times, values of the scan, or log."""

    def change(
        frames: Callable[[np.ndarray], np.ndarray] | None = None,
        later_s: float = 0.0,
        log: str | None = None,
        **scan: float,
    ) -> Recording:
        folder = tmp_path / "changed"
        copytree(pushed, folder)
        for path in (folder / "frames").iterdir() if frames else ():
            cv2.imwrite(str(path), frames(cv2.imread(str(path), -1)))
        if log is not None:
            (folder / "forces.csv").write_text(log)

        recording = read_recording(folder)
        entries = recording.frames
        lines = [f"{each.file},{each.time_s + later_s:.4f}" for each in entries]
        (folder / "frames.csv").write_text("\n".join(["file,time_s", *lines]) + "\n")
        info = recording.info
        info = replace(info, scan=replace(info.scan, **scan))
        (folder / "recording.toml").write_text(format_record(info))
        return read_recording(folder)

    return change


def test_a_recording_that_agrees_with_itself_is_not_refused(
    changed: Callable[..., Recording], pushed: Path
) -> None:
    check_recording(read_recording(pushed), STUDY, None)
    # mirrored frames show the same, where the needle does not lean
    check_recording(changed(np.fliplr), STUDY, None)


def test_frames_that_are_upside_down_are_refused(
    changed: Callable[..., Recording],
) -> None:
    upside_down = changed(np.flipud)
    with pytest.raises(CalibrationError, match=r"upside down \(import `flip=rows`\)"):
        check_recording(upside_down, STUDY, None)
    check_recording(upside_down, STUDY, None, with_forces=False)


def test_transposed_frames_are_named(changed: Callable[..., Recording]) -> None:
    finder = load_wall_finder(SHIPPED_WALL_FINDER)
    with pytest.raises(CalibrationError, match=r"transposed; import them with `axes"):
        check_recording(changed(np.transpose), STUDY, finder)


def test_an_index_for_a_corrected_scan_is_refused(
    changed: Callable[..., Recording],
) -> None:
    with pytest.raises(
        CalibrationError, match=r"650 µm, but .* is the depth corrected already\?"
    ):
        check_recording(changed(refractive_index=1.38), STUDY, None)


@pytest.mark.parametrize("later_s", [5.3, -5.3, 10.0, -10.0])
def test_an_offset_of_the_clocks_is_refused_with_its_size(
    changed: Callable[..., Recording], later_s: float
) -> None:
    moved = changed(later_s=later_s)
    side = "earlier" if later_s > 0.0 else "later"
    with pytest.raises(
        CalibrationError,
        match=rf"labels contradict the dents: .* s {side} than frames\.csv says",
    ):
        check_recording(moved, STUDY, None)


def test_a_wrong_sign_of_the_force_is_named(pushed: Path) -> None:
    recording = read_recording(pushed)
    force = recording.info.force
    assert force is not None
    info = replace(
        recording.info, force=replace(force, contact_sign=-force.contact_sign)
    )
    with pytest.raises(RecordingError, match="check contact_sign"):
        check_recording(replace(recording, info=info), STUDY, None)


def test_the_log_of_another_day_is_refused(
    changed: Callable[..., Recording], other_log: str
) -> None:
    with pytest.raises(
        CalibrationError, match=r"forces\.csv is unrelated to the frames"
    ):
        check_recording(changed(log=other_log), STUDY, None)


def test_a_log_that_is_too_short_is_refused(
    changed: Callable[..., Recording], pushed: Path
) -> None:
    lines = (pushed / "forces.csv").read_text().splitlines(keepends=True)
    with pytest.raises(CalibrationError, match=r"9 of 12 frames have no label"):
        check_recording(changed(log="".join(lines[: len(lines) // 4])), STUDY, None)


def test_the_command_ends_with_exit_2_and_writes_no_file(
    changed: Callable[..., Recording],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "calibration.json"
    folder = changed(np.flipud).path
    assert run(["calibrate", str(folder), "--out", str(out)]) == 2
    assert not out.exists()
    assert "upside down" in capsys.readouterr().err


def checked_with(calibration: Calibration, recording: Recording) -> Calibration:
    summary = summary_of_calibration(calibration)
    return checked_calibration(calibration, summary, [recording], STUDY, LIBRARY, None)


def test_a_calibration_keeps_what_its_frames_show(
    calibration: Calibration, pushed: Path
) -> None:
    found = checked_with(calibration, read_recording(pushed))
    shown = found.eyes["eye-a"].appearance
    assert shown is not None
    assert shown.thickness_um == pytest.approx(THICKNESS_M * 1e6, rel=0.05)
    assert shown.size == pytest.approx(1.0, abs=0.05)
    assert summary_of_calibration(found).eyes["eye-a"].appearance == shown


def test_a_modulus_that_no_reader_takes_is_refused(
    calibration: Calibration, pushed: Path
) -> None:
    eye = calibration.eyes["eye-a"]
    for modulus_pa in (0.029e6, 1.23e6):
        wrong = replace(eye, means=(modulus_pa,), sds=(0.01 * modulus_pa,))
        with pytest.raises(CalibrationError, match="Young's modulus would be"):
            checked_with(
                replace(calibration, eyes={"eye-a": wrong}), read_recording(pushed)
            )


def test_frames_that_a_reader_would_refuse_are_refused_with_the_cause(
    calibration: Calibration, pushed: Path
) -> None:
    recording = read_recording(pushed)
    scan = recording.info.scan
    for factor in (0.75, 1.35):
        wide = replace(scan, width_m=factor * scan.width_m)
        wrong = replace(recording, info=replace(recording.info, scan=wide))
        with pytest.raises(
            CalibrationError, match=r"a reader would refuse \d+ of 8 frames .*width_m"
        ):
            checked_with(calibration, wrong)


OURS = Appearance(
    thickness_um=650.0, thickness_sd_um=5.0, size=1.0, size_sd=0.01, frames=8
)


def summary_with(appearance: Appearance | None) -> CalibrationSummary:
    entry = {} if appearance is None else {"appearance": vars(appearance)}
    text = calibration_text(eyes={"eye-a": entry})
    return summary_of(parse_calibration_file(text.encode(), "c.json"))


def test_another_eye_of_the_same_name_is_noticed_by_thickness_and_size() -> None:
    assert other_eye(OURS, replace(OURS, thickness_um=670.0, size=1.03)) is None
    assert "a wall of 560 µm" in (
        other_eye(OURS, replace(OURS, thickness_um=560.0)) or ""
    )
    assert "1.20 times as large" in (other_eye(OURS, replace(OURS, size=1.2)) or "")

    thin = replace(OURS, thickness_um=560.0)
    doubt = appearance_doubt(summary_with(OURS), "eye-a", thin)
    assert doubt is not None
    assert doubt.startswith("c.json: eyes.eye-a: a wall of 560 µm is seen, not of 650")
    assert appearance_doubt(summary_with(OURS), "eye-b", thin) is None
    # a file from before, which has none
    assert appearance_doubt(summary_with(None), "eye-a", thin) is None
    assert json.loads(calibration_text(eyes={"eye-a": {}}))["format"] == 3


def test_reading_with_the_calibration_of_another_eye_says_so(tmp_path: Path) -> None:
    places = write_places(tmp_path)
    content = json.loads(places["calibration"].read_text())
    model = load_model(places["model"], wall_finder=None)
    frame = places["mine"] / "frames" / "2.png"

    for thickness_um, is_noticed in ((650.0, False), (500.0, True)):
        shown = vars(replace(OURS, thickness_um=thickness_um))
        content["eyes"]["mine"]["appearance"] = shown
        places["calibration"].write_text(json.dumps(content))
        notes = evaluate(model, places["mine"], places["calibration"]).notes
        answer = read(model, frame, calibration=places["calibration"])
        for said in (notes, answer.warnings):
            assert any("is that of another eye" in each for each in said) == is_noticed


SHARED = Path(__file__).parents[3] / "shared" / "recordings"


@pytest.mark.real
@pytest.mark.parametrize("name", ["sample-a", "sample-b", "sample-c"])
def test_recordings_by_others_agree_and_their_mistakes_do_not(
    name: str,
) -> None:
    if not (SHARED / name).is_dir():
        pytest.skip(f"no {SHARED / name}")
    recording = read_recording(SHARED / name)
    check_recording(recording, STUDY, None)

    for later_s in (10.0, -10.0):
        moved = [replace(e, time_s=e.time_s + later_s) for e in recording.frames]
        with pytest.raises(CalibrationError, match="labels contradict the dents"):
            check_recording(replace(recording, frames=tuple(moved)), STUDY, None)

    scan = replace(recording.info.scan, refractive_index=1.38)
    with pytest.raises(CalibrationError, match="is the depth corrected already"):
        check_recording(
            replace(recording, info=replace(recording.info, scan=scan)), STUDY, None
        )
