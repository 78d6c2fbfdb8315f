"""Many virtual acquisitions: what is drawn of each, and that workers change nothing."""

import json
from math import pi, radians
from pathlib import Path

import pytest
from effects import contents

from scleraforce.cli.main import run
from scleraforce.errors import InputError, RecordingError
from scleraforce.laboratory.acquisition import Acquisition, acquire_all, is_recorded, sample_eyes
from scleraforce.laboratory.phantom import write_phantom
from scleraforce.laboratory.virtual_eye import study_sections
from scleraforce.study import DatasetStudy, MeshStudy, NeedleStudy, OctStudy, Range, Study, format_study

STUDY = Study(
    oct=OctStudy(columns=128, rows=96),
    mesh=MeshStudy(divisions=4, level=0),
    needle=NeedleStudy(polar_angle_rad=Range(min=0.4, max=0.8)),
    dataset=DatasetStudy(gap_m=Range(min=0.4e-3, max=0.9e-3), tilt_rad=Range(min=-0.1, max=0.1)),
)
ACQUISITION = Acquisition((0.002, 0.01), STUDY, 3)


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings that this process has written, one by one."""
    out = tmp_path_factory.mktemp("eyes")
    for eye in sample_eyes(STUDY, 4, 3, "pig", {}):
        write_phantom(out / eye.id, ACQUISITION.plan(eye), study_sections(eye, STUDY), STUDY)
    return out


def test_eyes_are_drawn_from_what_the_study_samples() -> None:
    eyes = sample_eyes(STUDY, 300, 0, "eye", {})
    assert len({eye.id for eye in eyes}) == 300
    assert {eye.thickness_m for eye in eyes} == set(STUDY.eye.thickness_m.values)
    for values, low, high in [
        ([eye.polar_rad for eye in eyes], 0.4, 0.8),
        ([eye.gap_m for eye in eyes], 0.4e-3, 0.9e-3),
        ([eye.tilt_rad for eye in eyes], -0.1, 0.1),
        ([eye.azimuth_rad for eye in eyes], -pi, pi),
    ]:
        room = 0.05 * (high - low)
        assert low <= min(values) < low + room
        assert high - room < max(values) <= high
    assert {(eye.youngs_modulus_pa, eye.iop_pa) for eye in eyes} == {(0.25e6, STUDY.eye.iop_pa)}


def test_more_eyes_and_what_is_told_leave_the_rest_of_an_eye_as_it_is() -> None:
    few, many = sample_eyes(STUDY, 2, 7, "eye", {}), sample_eyes(STUDY, 5, 7, "eye", {"thickness_m": 5e-4})
    assert [eye.thickness_m for eye in many] == [5e-4] * 5
    assert [eye.polar_rad for eye in few] == [eye.polar_rad for eye in many[:2]]
    assert sample_eyes(STUDY, 2, 8, "eye", {})[0].polar_rad != few[0].polar_rad
    with pytest.raises(InputError, match="eye-1: thickness_m"):
        sample_eyes(STUDY, 1, 7, "eye", {"thickness_m": 5.0})


def test_a_needle_that_moves_is_planned_as_such() -> None:
    (eye,) = sample_eyes(STUDY, 1, 3, "eye", {})
    moving = Acquisition((0.01,), STUDY, 3, rate_hz=50.0, ramp_n_per_s=10e-3, hold_s=0.5).plan(eye)
    assert len(moving.frames) > 50
    assert len(ACQUISITION.plan(eye).frames) == 2


def test_a_recording_is_known_by_its_truth(here: Path, tmp_path: Path) -> None:
    first, second, *_ = sample_eyes(STUDY, 4, 3, "pig", {})
    assert is_recorded(here / "pig-1", ACQUISITION.plan(first), STUDY)
    assert not is_recorded(here / "pig-1", ACQUISITION.plan(second), STUDY)
    assert not is_recorded(here / "pig-1", Acquisition((0.002, 0.011), STUDY, 3).plan(first), STUDY)
    assert not is_recorded(tmp_path, ACQUISITION.plan(first), STUDY)
    for content in ("[]", "{", '{"frames": 7}', '{"frames": [7]}', "{}"):
        (tmp_path / "truth.json").write_text(content)
        assert not is_recorded(tmp_path, ACQUISITION.plan(first), STUDY)


@pytest.mark.slow
def test_workers_and_ctrl_c_change_no_byte(here: Path, tmp_path: Path) -> None:
    eyes = sample_eyes(STUDY, 4, 3, "pig", {})

    def interrupt(done: int) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        acquire_all(tmp_path / "out", eyes, ACQUISITION, workers=2, progress=interrupt)
    (kept,) = (tmp_path / "out").iterdir()
    assert contents(kept) == contents(here / kept.name)
    assert acquire_all(tmp_path / "out", eyes, ACQUISITION, workers=2) == 3
    assert contents(tmp_path / "out") == contents(here)


def test_what_is_no_recording_of_the_eye_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "pig-2").mkdir()
    with pytest.raises(RecordingError, match="pig-2: not the recording of this eye and seed"):
        acquire_all(tmp_path, sample_eyes(STUDY, 4, 3, "pig", {}), ACQUISITION, workers=1)
    assert [path.name for path in tmp_path.iterdir()] == ["pig-2"]


@pytest.mark.slow
def test_the_command_makes_many_eyes_and_takes_them_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "study.toml").write_text(format_study(STUDY))
    command = [
        "phantom",
        "--study",
        str(tmp_path / "study.toml"),
        "--out",
        str(tmp_path / "eyes"),
        "--forces-mn",
        "2,10",
    ]
    told = ("--polar-angle-deg", "35", "--azimuth-deg", "0")
    assert run([*command, "--count", "2", "--eye", "pig", *told, "--workers", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["recordings"] == [str(tmp_path / "eyes" / name) for name in ("pig-1", "pig-2")]
    assert (found["frames"], found["seed"]) == (4, 0)
    truths = [json.loads((Path(path) / "truth.json").read_text())["eye"] for path in found["recordings"]]
    assert [eye["polar_rad"] for eye in truths] == [radians(35.0)] * 2
    assert [eye["azimuth_rad"] for eye in truths] == [0.0] * 2  # 0 is stated, too
    assert truths[0]["gap_m"] != truths[1]["gap_m"]
    assert run([*command, "--count", "3", "--eye", "pig", *told]) == 0
    assert "wrote" in capsys.readouterr().out
    assert len(list((tmp_path / "eyes").iterdir())) == 3


def test_workers_are_for_many_eyes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["phantom", "--out", str(tmp_path / "eye"), "--workers", "2"]) == 2
    assert "--scheduler and --workers are for --count" in capsys.readouterr().err
    assert run(["phantom", "--out", str(tmp_path), "--count", "2", "--workers", "2", "--scheduler", "tcp://x:1"]) == 2
    assert "--scheduler has workers of its own" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
