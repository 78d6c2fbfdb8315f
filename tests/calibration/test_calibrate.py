"""Recordings in, posterior out: whole virtual recordings, the file, resuming from it,
and unusable input.
"""

import json
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from analytic_frames import LIBRARY
from small_recordings import calibration_of_a_sealed_eye

from scleraforce.base.errors import CalibrationError
from scleraforce.base.units import SI_PER_UNIT
from scleraforce.calibration import calibrate, found_walls, seen_frames
from scleraforce.calibration.calibrate import calibrate_recordings
from scleraforce.calibration.calibration import (
    Calibration,
    EyeCalibration,
    parse_calibration,
)
from scleraforce.calibration.seen_frames import frame_order
from scleraforce.calibration.stiffness_from_forces import TissueTrial
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import (
    parse_calibration_file,
    summary_of,
)
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN, Globe
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation
from virtual_eyes import wall_of

FRAMES = 2


def parsed(text: str) -> Calibration:
    return parse_calibration(parse_calibration_file(text.encode(), "c.json"))


@pytest.fixture(scope="module")
def recording(virtual_folder: Path) -> Recording:
    return read_recording(virtual_folder)


@pytest.fixture(scope="module")
def calibration(laboratory: Any, recording: Recording) -> Calibration:
    return calibrate_recordings([recording], laboratory.study, "hash", None)


def test_modulus_from_raw_frames_is_within_3_percent_and_poses_within_50_um(
    calibration, recording, eye
):
    found = calibration.eyes["virtual"]
    assert found.mean_pa == pytest.approx(wall_of(eye).youngs_modulus_pa, rel=0.03)
    assert abs(found.mean_pa - wall_of(eye).youngs_modulus_pa) < 3 * found.sd_pa
    assert found.status == "ok"
    truth = json.loads((recording.path / "truth.json").read_text())["frames"]
    poses = {frame["file"]: frame["pose"] for frame in truth}

    for record, step in zip(found.used, found.steps, strict=True):
        pose = poses[record.file]
        assert step.registered.nuisance[:2] == pytest.approx(
            [pose["lateral_m"], pose["depth_m"]], abs=50e-6
        )


@pytest.mark.slow
def test_a_chosen_frame_that_cannot_be_used_is_replaced(
    laboratory, recording, tmp_path
):
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


ALL = [True] * 8


@pytest.mark.parametrize(
    ("included", "frames", "order"),
    [
        (ALL, None, [0, 1, 2, 3, 4, 5, 6, 7]),
        (ALL, 3, [0, 6, 2, 1, 3, 7, 5, 4]),
        ([True] * 3 + [False] + [True] * 4, 2, [0, 6, 4, 7, 5, 1, 2]),
        ([n in (0, 6) for n in range(8)], 3, [0, 6]),
    ],
)
def test_light_frames_come_first_then_the_wanted_ones_rising_then_the_rest_from_the_highest(
    included: list[bool], frames: int | None, order: list[int]
):
    forces_n = np.array([0.0, 30.0, 12.0, 45.0, 20.0, 38.0, 2.0, 44.0]) * 1e-3
    assert frame_order(forces_n, included, 0.005, frames) == order


def test_the_population_is_the_mean_of_the_sound_eyes(calibration):
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


def without_thickness(recording: Recording) -> Recording:
    eye = replace(recording.info.eye, thickness_m=None)
    return replace(recording, info=replace(recording.info, eye=eye))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unusable", "settings", "said"),
    [
        (without_thickness, {}, r"eye\.thickness_m: missing"),
        (lambda recording: replace(recording, forces=None), {}, r"no forces\.csv"),
        (lambda recording: recording, {"min_force_n": 1.0}, "none of its 6 frames"),
    ],
)
def test_a_recording_that_cannot_be_used_is_refused(
    laboratory,
    recording,
    unusable: Callable[[Recording], Recording],
    settings: dict[str, float],
    said: str,
):
    study = laboratory.study
    study = replace(study, calibration=replace(study.calibration, **settings))
    with pytest.raises(CalibrationError, match=said):
        calibrate_recordings([unusable(recording)], study, "", None)


def test_the_stiffening_of_the_eyes_and_of_the_population_survives_the_file():
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


HOSTILE = {
    "stiffening": [-1, 1e300, "5", True, None, []],
    "mean_mpa": [1e300, "0.2", True, None, [], 10**35],
    "sd_mpa": [-1, 1e300],
    "parameters": [
        {},
        [],
        {"youngs_modulus_pa": {"mean": 1e300, "sd": 1.0}},
        {"weight": {}},
    ],
    "recordings": [None, [3], [{}]],
    "steps": [{}, [{}], ["x"], []],
}


@pytest.mark.parametrize(
    ("key", "value"), [(key, value) for key in HOSTILE for value in HOSTILE[key]]
)
def test_hostile_values_are_refused_by_their_key_before_they_are_used(
    calibration, key: str, value: Any
):
    content = json.loads(json.dumps(calibration.to_dict()))
    assert key in content["eyes"]["virtual"]
    content["eyes"]["virtual"][key] = value
    with pytest.raises(
        CalibrationError, match=rf"^c\.json: eyes\.virtual(\.|: ){key}"
    ) as fault:
        parsed(json.dumps(content))

    assert "\n" not in str(fault.value)


@pytest.mark.slow
def test_frames_that_were_seen_are_left_out_under_any_name_and_path(
    laboratory, recording, calibration, tmp_path
):
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
    """Its first frames, of an elastic eye whose globe is stated."""
    elastic = Relaxation.declared(())
    eye = replace(recording.info.eye, globe=globe, relaxation=elastic)
    return replace(
        recording,
        info=replace(recording.info, eye=eye),
        frames=recording.frames[:FRAMES],
    )


@pytest.fixture
def diverging(monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Globe | None]]:
    """Make a calibration diverge if a globe is stated; return the stated globe of each,
    and look at every frame.
    """

    def use(status: str, rigidity: float, sd: float = 0.001) -> list[Globe | None]:
        sealed = calibration_of_a_sealed_eye().eyes["mine"]
        *frames, last = sealed.frames
        asked = list[Globe | None]()

        def found(
            recording: Recording, _: Any, look: Any, *__: Any
        ) -> TissueTrial[EyeCalibration]:
            assert len({look.seen(index) for index in range(FRAMES)}) == FRAMES
            assert len(look.labelled()[0]) == FRAMES
            stated = recording.info.eye.globe
            asked.append(stated)
            unknown = replace(UNKNOWN, mean=rigidity * PER_UL, sd=sd * PER_UL)
            said = "diverged: by 5 sd" if stated else status
            eye = replace(
                sealed,
                id="virtual",
                frames=(*frames, replace(last, status=said)),
                globe=SEALED if stated else unknown,
            )
            return TissueTrial.diverged(eye, 0)

        monkeypatch.setattr(calibrate, "calibrate_eye", found)
        return asked

    return use


@pytest.mark.parametrize(
    ("stated", "status", "rigidity", "doubted"),
    [
        (OPEN, "ok", 0.03, True),
        (OPEN, "ok", 0.0052, True),
        (OPEN, "diverged: by 4 sd", 0.0, False),
        (OPEN, "diverged: by 4 sd", 0.03, False),
        (SEALED, "ok", 0.0, True),
        (None, "diverged: by 4 sd", 0.03, False),
    ],
)
def test_a_globe_is_doubted_if_frames_agree_on_another_one_and_each_is_segmented_and_labelled_once(
    recording,
    diverging,
    monkeypatch,
    stated: Globe | None,
    status: str,
    rigidity: float,
    doubted: bool,
):
    calls = Counter[str]()

    def counted(module: Any, name: str) -> Callable[..., Any]:
        original = getattr(module, name)
        return lambda *given: calls.update([name]) or original(*given)

    for module, name in ((found_walls, "find_wall"), (seen_frames, "label_frames")):
        monkeypatch.setattr(module, name, counted(module, name))

    asked = diverging(status, rigidity)
    eye = calibrate_recordings(
        [of_globe(recording, stated)], Study(), "hash", LIBRARY
    ).eyes["virtual"]
    assert set(asked) == {stated, None}
    assert calls == {"find_wall": FRAMES, "label_frames": 1}
    assert eye.status.startswith("diverged")
    assert bool(eye.recordings[-1].doubts) == doubted
    assert (eye.globe == UNKNOWN) == doubted


@pytest.mark.parametrize(
    ("rigidity", "sd"), [(0.0017, 0.0002), (0.0004, 0.001), (0.0055, 0.003)]
)
def test_an_open_globe_is_not_doubted_for_a_rigidity_that_no_closed_one_has(
    recording,
    diverging,
    rigidity: float,
    sd: float,
):
    asked = diverging("ok", rigidity, sd)
    stated = of_globe(recording, OPEN)
    before = calibrate_recordings([stated], Study(), "hash", LIBRARY)
    eye = before.eyes["virtual"]
    assert asked[0] == OPEN
    assert eye.status == "ok"
    assert (eye.globe.kind, eye.globe.mean) == ("open", rigidity * PER_UL)
    assert eye.globe.sd == pytest.approx(max(sd, rigidity / 1.645) * PER_UL, rel=1e-3)
    assert len(eye.recordings[-1].doubts) == 1
    again = calibrate_recordings([stated] * 2, Study(), "hash", LIBRARY)
    assert asked[-1] is None
    assert again.eyes["virtual"].globe == eye.globe
