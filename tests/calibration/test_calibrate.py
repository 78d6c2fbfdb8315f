"""Recordings in, posterior out: whole virtual recordings, the file, resuming from it,
and unusable input.
"""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from analytic_frames import LIBRARY
from small_recordings import calibration_of_a_sealed_eye

from ideal_boundaries import virtual_sections
from scleraforce.base.errors import CalibrationError
from scleraforce.base.units import SI_PER_UNIT
from scleraforce.calibration import calibrate, seen_frames
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.calibration import (
    Calibration,
    EyeCalibration,
    parse_calibration,
)
from scleraforce.calibration.seen_frames import frame_order
from scleraforce.calibration.stiffness_from_forces import TissueTrial
from scleraforce.lab.virtual_recording import plan_phantom, write_phantom
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import (
    known_of_eye,
    parse_calibration_file,
    summary_of,
)
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN, Globe
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from virtual_eyes import wall_of

FORCES = (0.002, 0.030, 0.012, 0.045, 0.020, 0.038)


def parsed(text: str) -> Calibration:
    return parse_calibration(parse_calibration_file(text.encode(), "c.json"))


@pytest.fixture(scope="module")
def recording(
    laboratory: Any, eye: Setup, tmp_path_factory: pytest.TempPathFactory
) -> Recording:
    path = tmp_path_factory.mktemp("calibrate") / "virtual"
    wall = laboratory.wall(wall_of(eye).thickness_m)
    study = laboratory.study
    write_phantom(
        path,
        plan_phantom(eye, FORCES, study, 3),
        lambda f: virtual_sections(wall, eye, f, study),
        study,
    )

    return read_recording(path)


@pytest.fixture(scope="module")
def calibration(laboratory: Any, recording: Recording) -> Calibration:
    return calibrate_recordings([recording], laboratory.study, "hash", None)


def test_modulus_from_raw_frames_is_within_3_percent(
    calibration: Calibration, eye: Setup
) -> None:
    found = calibration.eyes["virtual"]
    assert found.mean_pa == pytest.approx(wall_of(eye).youngs_modulus_pa, rel=0.03)
    assert abs(found.mean_pa - wall_of(eye).youngs_modulus_pa) < 3 * found.sd_pa
    assert found.status == "ok"
    assert calibration.population == (found.mean_pa, None)


def test_poses_of_raw_frames_are_within_50_um(
    calibration: Calibration, recording: Recording
) -> None:
    truth = json.loads((recording.path / "truth.json").read_text())["frames"]
    poses = {
        frame["file"]: [frame["pose"]["lateral_m"], frame["pose"]["depth_m"]]
        for frame in truth
    }
    found = calibration.eyes["virtual"]

    for record, step in zip(found.used, found.steps, strict=True):
        assert step.registered.nuisance[:2] == pytest.approx(
            poses[record.file], abs=50e-6
        )


@pytest.mark.slow
def test_a_chosen_frame_that_cannot_be_used_is_replaced(
    laboratory: Any, recording: Recording, tmp_path: Path
) -> None:
    path = shutil.copytree(recording.path, tmp_path / "virtual")
    highest = path / "frames" / "0004.png"
    cv2.imwrite(
        str(highest), np.zeros_like(cv2.imread(str(highest), cv2.IMREAD_UNCHANGED))
    )

    for one, used in (
        (recording, ["0005.png", "0004.png"]),
        (read_recording(path), ["0005.png", "0006.png"]),
    ):
        found = calibrate_recordings(
            [one], laboratory.study, "hash", None, frames=2
        ).eyes["virtual"]
        assert [frame.file for frame in found.used] == used

    assert "0004.png" in {frame.file for frame in found.frames if frame.skipped}


def test_light_frames_come_first_then_the_wanted_ones_rising_then_the_rest_from_the_highest():
    forces_n = np.array([0.0, 30.0, 12.0, 45.0, 20.0, 38.0, 2.0, 44.0]) * 1e-3
    every = [True] * 8

    for included, frames, order in (
        (every, None, [0, 1, 2, 3, 4, 5, 6, 7]),
        (every, 1, [0, 3, 7, 5, 1, 4, 2]),
        (every, 3, [0, 6, 2, 1, 3, 7, 5, 4]),
        ([True] * 3 + [False] + [True] * 4, 2, [0, 6, 4, 7, 5, 1, 2]),
        ([False] * 8, 3, []),
        ([n in (0, 6) for n in range(8)], 3, [0, 6]),
    ):
        assert frame_order(forces_n, included, 0.005, frames, rising=False) == order

    included = [True, True, True, False, True, True]
    forces_n = np.array([0.05, 0.002, 0.01, np.nan, 0.03, 0.004])
    assert frame_order(forces_n, included, 0.005, None, rising=True) == [
        1,
        5,
        2,
        4,
        0,
        3,
    ]


def test_file_has_the_keys_that_others_read(calibration: Calibration) -> None:
    content = json.loads(json.dumps(calibration.to_dict(), allow_nan=False))
    entry = content["eyes"]["virtual"]
    assert entry["updates"] == 5
    assert [frame["file"] for frame in entry["frames"]] == [
        f"000{number}.png" for number in range(2, 7)
    ]
    assert len({frame["sha256"] for frame in entry["frames"]}) == 5
    assert content["population"]["sd_mpa"] is None
    assert content["population"]["mean_mpa"] == entry["mean_mpa"]
    assert content["study_sha256"] == "hash"
    assert len(entry["recordings"][0]["sha256"]) == 64


def test_the_population_is_the_mean_of_the_sound_eyes(calibration: Calibration) -> None:
    sound = calibration.eyes["virtual"]
    diverged = replace(
        sound,
        frames=(*sound.frames[:-1], replace(sound.frames[-1], status="E has run away")),
    )

    def population(**moduli_pa: float) -> Calibration:
        eyes = {
            name: replace(
                diverged if name == "lost" else sound, id=name, means=(mean_pa,)
            )
            for name, mean_pa in moduli_pa.items()
        }
        return Calibration(eyes, "", (5e-3, 30e-3), "linear")

    three = population(a=0.2e6, b=0.3e6, c=0.1e6)
    assert three.population == pytest.approx((0.2e6, 0.1e6))
    two = population(a=0.2e6, b=0.3e6, lost=9e6)
    assert two.population == pytest.approx((0.25e6, 0.1e6 / 2**0.5))
    assert population(lost=9e6).population == (9e6, None)


@pytest.mark.slow
def test_a_recording_that_cannot_be_used_is_refused(
    laboratory: Any, recording: Recording
) -> None:
    study = laboratory.study
    info = recording.info
    without = replace(
        recording, info=replace(info, eye=replace(info.eye, thickness_m=None))
    )
    strict = replace(study, calibration=replace(study.calibration, min_force_n=1.0))

    for one, of_study, said in (
        (without, study, r"eye\.thickness_m: missing"),
        (replace(recording, forces=None), study, r"no forces\.csv"),
        (recording, strict, "none of its 6 frames"),
    ):
        with pytest.raises(CalibrationError, match=said):
            calibrate_recordings([one], of_study, "", None)


def test_the_stiffening_of_the_eyes_and_of_the_population_survives_the_file() -> None:
    one = calibration_of_a_sealed_eye().eyes["mine"]
    again = tuple(
        replace(frame, again=replace(frame.again, loss=3.5))
        for frame in one.frames
        if frame.again
    )
    eyes = {
        "a": replace(one, id="a", stiffening=15.0, frames=again),
        "b": replace(one, id="b", stiffening=0.0),
    }
    content = Calibration(eyes, "hash", (5e-3, 30e-3), "finite-strain").to_dict()
    text = json.dumps(content, allow_nan=False)
    found = parsed(text)
    summary = summary_of(parse_calibration_file(text.encode(), "c.json"))

    assert [found.eyes[eye].stiffening for eye in "ab"] == [15.0, 0.0]
    assert [summary.eyes[eye].eye.stiffening for eye in "ab"] == [15.0, 0.0]
    for either in (found, summary):
        assert either.population_stiffening == pytest.approx(3.0)  # 1 + b: 16 and 1

    assert [frame.again.loss for frame in found.eyes["a"].frames if frame.again] == [
        3.5
    ] * 3
    for entry in (content["population"], *content["eyes"].values()):
        del entry["stiffening"]

    for step in content["eyes"]["a"]["steps"]:
        del step["again"]["loss"]

    before = parsed(json.dumps(content))
    assert [before.eyes[eye].stiffening for eye in "ab"] == [0.0, 0.0]
    assert [frame.again.loss for frame in before.eyes["a"].frames if frame.again] == [
        0.0
    ] * 3


HOSTILE = {
    "stiffening": ([-1, 1e300, "5", True, None, []], "stiffening"),
    "mean_mpa": ([1e300, "0.2", True, None, [], 10**35], "mean_mpa"),
    "sd_mpa": ([-1, 1e300], "sd_mpa"),
    "parameters": (
        [{}, [], {"youngs_modulus_pa": {"mean": 1e300, "sd": 1.0}}, {"weight": {}}],
        "parameters",
    ),
    "recordings": ([None, [3], [{}]], "recordings"),
    "steps": ([{}, [{}], ["x"], []], "steps"),
}


def test_hostile_values_are_refused_by_their_key_before_they_are_used(
    calibration: Calibration,
) -> None:
    text = json.dumps(calibration.to_dict())
    for key, (values, place) in HOSTILE.items():
        for value in values:
            content = json.loads(text)
            assert key in content["eyes"]["virtual"]
            content["eyes"]["virtual"][key] = value

            with pytest.raises(
                CalibrationError, match=rf"^c\.json: eyes\.virtual(\.|: ){place}"
            ) as fault:
                parsed(json.dumps(content))

            assert "\n" not in str(fault.value)


@pytest.mark.slow
def test_frames_that_were_seen_are_left_out_under_any_name_and_path(
    laboratory: Any, recording: Recording, calibration: Calibration, tmp_path: Path
) -> None:
    moved = shutil.copytree(recording.path, tmp_path / "moved")
    (moved / "frames" / "0003.png").rename(moved / "frames" / "x.png")
    (moved / "frames.csv").write_text(
        (moved / "frames.csv").read_text().replace("0003.png", "x.png")
    )
    again = calibrate_recordings(
        [recording, read_recording(moved)], laboratory.study, "", None
    )
    assert again.eyes["virtual"].mean_pa == pytest.approx(
        calibration.eyes["virtual"].mean_pa, rel=1e-12
    )
    assert len(again.eyes["virtual"].frames) == 6


PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]


def of_globe(recording: Recording, globe: Globe | None) -> Recording:
    return replace(
        recording,
        info=replace(recording.info, eye=replace(recording.info.eye, globe=globe)),
    )


@pytest.fixture
def diverging(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Globe | None]]:
    """Make a calibration diverge if a globe is stated; return the stated globe of each,
    and look at every frame.
    """

    def use(status: str, rigidity: float, sd: float = 0.001) -> list[str | None]:
        sealed = calibration_of_a_sealed_eye().eyes["mine"]
        asked = list[str | None]()

        def found(
            recording: Recording, _: Any, look: Any, *__: Any
        ) -> TissueTrial[EyeCalibration]:
            assert len(
                {look.seen(index) for index in range(len(recording.frames))}
            ) == len(FORCES)
            assert len(look.labelled()[0]) == len(FORCES)
            asked.append(recording.info.eye.globe)
            *frames, last = sealed.frames

            if asked[-1] is None:
                globe = replace(UNKNOWN, mean=rigidity * PER_UL, sd=sd * PER_UL)
                said = status
            else:
                globe = SEALED
                said = "diverged: by 5 sd"

            eye = replace(
                sealed,
                id="virtual",
                frames=(*frames, replace(last, status=said)),
                globe=globe,
            )
            return TissueTrial.diverged(eye, 0)

        monkeypatch.setattr(calibrate, "calibrate_eye", found)
        return asked

    return use


def test_a_globe_is_doubted_if_frames_agree_on_another_one_and_each_is_segmented_and_labelled_once(
    recording: Recording,
    diverging: Callable[..., list[Globe | None]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    segmented = list[Any]()
    labelled = list[Any]()
    find_wall = seen_frames.find_wall
    label_frames = seen_frames.label_frames
    monkeypatch.setattr(
        seen_frames,
        "find_wall",
        lambda *given: segmented.append(given) or find_wall(*given),
    )
    monkeypatch.setattr(
        seen_frames,
        "label_frames",
        lambda *given: labelled.append(given) or label_frames(*given),
    )

    for stated, status, rigidity, doubted in (
        (OPEN, "ok", 0.03, True),
        (OPEN, "ok", 0.0052, True),
        (OPEN, "diverged: by 4 sd", 0.0, False),
        (OPEN, "diverged: by 4 sd", 0.03, False),
        (SEALED, "ok", 0.0, True),
        (None, "diverged: by 4 sd", 0.03, False),
    ):
        asked = diverging(status, rigidity)
        segmented.clear()
        labelled.clear()
        eye = calibrate_recordings(
            [of_globe(recording, stated)], Study(), "hash", LIBRARY
        ).eyes["virtual"]
        assert set(asked) == {stated, None}
        assert (len(segmented), len(labelled)) == (len(FORCES), 1)
        assert eye.status.startswith("diverged")
        assert bool(eye.recordings[-1].doubts) == doubted
        assert (eye.globe == UNKNOWN) == doubted


def test_an_open_globe_is_not_doubted_for_a_rigidity_that_no_closed_one_has(
    recording: Recording, diverging: Callable[..., list[Globe | None]]
) -> None:
    for rigidity, sd in ((0.0017, 0.0002), (0.0004, 0.001), (0.0055, 0.003)):
        asked = diverging("ok", rigidity, sd)
        before = calibrate_recordings(
            [of_globe(recording, OPEN)], Study(), "hash", LIBRARY
        )
        eye = before.eyes["virtual"]
        assert asked[0] == OPEN
        assert eye.status == "ok"
        assert (eye.globe.kind, eye.globe.mean) == ("open", rigidity * PER_UL)
        assert eye.globe.sd == pytest.approx(
            max(sd, rigidity / 1.645) * PER_UL, rel=1e-3
        )
        (doubt,) = eye.recordings[-1].doubts
        assert "they are read as with k 0.03" in doubt
        summary = summary_of(
            parse_calibration_file(json.dumps(before.to_dict()).encode(), "c.json")
        )
        stated = of_globe(recording, OPEN).info.setup
        assert known_of_eye(stated, summary, "virtual").eye.globe == eye.globe
        asked.clear()
        again = calibrate_recordings(
            [of_globe(recording, OPEN)] * 2, Study(), "hash", LIBRARY
        )
        assert asked[-1] is None
        assert again.eyes["virtual"].globe == eye.globe
