"""Recordings in commands: findings of a calibration, a model's limits noted at once,
keys that a command refuses.
"""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import moving
from analytic_library import analytic_library
from small_recordings import looked_at_frames

import scleraforce as sf
from scleraforce.base.units import to_si
from scleraforce.calibration.filter.eye_filter import begin
from scleraforce.calibration.filter.eye_parameters import WallState
from scleraforce.calibration.start_of_an_eye import ForceFrame
from scleraforce.calibration.stiffness_from_forces import eye_of_forces
from scleraforce.lab.training.slice_dataset import (
    SampleSimulator,
    library_slices,
    near_library,
    plan_dataset,
)
from scleraforce.lab.virtual_eye import simulate_eye, study_sections
from scleraforce.lab.virtual_recording import draw_relaxation
from scleraforce.library.library_plan import plan_library
from scleraforce.library.library_store import solve_path
from scleraforce.library.plane_cut import cut_surfaces
from scleraforce.mechanics.contact_and_section import Contact
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.fields import field_key
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import FILTER, UNUSED, Study, parse_study


def test_a_stiffening_that_is_both_given_and_sought_is_refused(
    tmp_path: Path, shell
) -> None:
    (tmp_path / "study.toml").write_text("[tissue]\nstiffening = 3.0\n")
    given = f"--study {tmp_path}/study.toml --out {tmp_path}/out.json"
    error = shell.refused("calibrate eye", given)
    assert "tissue.stiffening: is sought in the frames" in error


CHANGES = {
    "width_m = 0.015": "width_m = 0.006",
    'id = "eye"': 'id = "eye"\niop_pa = 1999.84\nthickness_m = 1e-3',
    "gauge = 22": "gauge = 30",
}
SENTENCES = (
    "frames of 6 x 4 mm: at most 6.0 mm of the wall are visible; at least",
    "IOP 15 mmHg, the model was trained on",
    "wall thickness 1000 µm, the model was trained on",
    "needle of 30 gauge, the model was trained on",
)


def changed_recording(folder: Path, changes: dict[str, str]) -> Path:
    """A recording of one frame with other statements in its recording.toml."""
    looked_at_frames(folder, 1)
    text = (folder / "recording.toml").read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)

    (folder / "recording.toml").write_text(text)
    return folder


def test_every_command_has_the_same_sentences(tmp_path: Path, shell) -> None:
    recording = changed_recording(tmp_path / "r", CHANGES)
    frame = recording / "frames" / "0001.png"
    eye = "--eye a --thickness-um 1000 --iop-mmhg 15"
    again = ("import", frame, eye, "--like", recording, "--out", tmp_path / "i")
    said = {
        "show": shell.json("show", recording)["notes"],
        "import": shell.json(*again)["notes"],
        "evaluate": shell.json("evaluate default", recording)["notes"],
        "read": shell.json("read default", frame)["notes"],
        "sf.read": list(sf.read("default", frame).warnings),
    }
    counts = {
        name: [sum(f": {one}" in note for note in found) for one in SENTENCES]
        for name, found in said.items()
    }
    assert counts == dict.fromkeys(said, [1] * len(SENTENCES))


def test_another_model_has_other_limits(tmp_path: Path, shell) -> None:
    recording = changed_recording(
        tmp_path / "r", {"slice_gap_m = 0.0005": "slice_gap_m = 0.0008"}
    )

    def outside(*options: str) -> list[str]:
        remarks = shell.json("show", recording, *options)["remarks"]
        return [r["words"] for r in remarks if r["code"] == "outside-training"]

    assert outside() == []
    (found,) = outside("--model paper")
    assert found.startswith("outside the range of paper: gap ")
    out = f"--like {recording} --eye a --out {tmp_path}/i"
    again = ("import", recording / "frames", out, "--model")
    assert "nowhere: no such folder" in shell.refused(*again, "./nowhere")
    assert [path.name for path in tmp_path.iterdir()] == ["r"]
    assert found in shell.json(*again, "paper")["notes"]


@pytest.fixture(scope="module")
def pushed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual recording with forces that states neither thickness nor globe, and
    15 mmHg.
    """
    recording = sf.phantom(
        tmp_path_factory.mktemp("pushed") / "r",
        sf.parse_study("[mesh]\ncore = 2\nrings = 6\n"),
        eye="eye",
        thickness_m=650e-6,
        youngs_modulus_pa=0.3e6,
        iop_pa=to_si(15.0, "mmhg"),
        forces_n=[0.012, 0.024, 0.003],
        mechanics="finite-strain",
    )
    info = recording.path / "recording.toml"
    info.write_text(re.sub(r"(?m)^(thickness_m|globe).*\n", "", info.read_text()))
    return recording.path


def test_calibrate_prefers_the_given_thickness_and_notes_limits_at_once(
    pushed: Path, tmp_path: Path, shell
) -> None:
    error = shell.refused("calibrate", pushed, "--out", tmp_path / "none.json")
    assert "eye.thickness_m: missing" in error
    given = ("calibrate", pushed, "--thickness-um 650 --parameters e --frames 2")
    info = pushed / "recording.toml"
    before = info.read_text()
    # lines wrap where the path ends
    text = shell.text(*given, "--out", tmp_path / "0.json")
    assert text.startswith(f"note: {pushed}:")
    info.write_text(before.replace("[eye]", "[eye]\nthickness_m = 4e-4"))
    printed = shell.json(*given, "--out", tmp_path / "1.json")
    info.write_text(before)
    codes = {remark["code"] for remark in printed["remarks"]}
    assert codes == {"missing-input", "outside-training", "parameter-found"}
    assert f"{pushed}: open or sealed is not stated (eye.globe)" in "".join(
        printed["notes"]
    )
    for words in ("IOP 15 mmHg", "open or sealed is not stated (eye.globe)"):
        assert words in text.partition("population")[0]
    means = [
        json.loads((tmp_path / f"{n}.json").read_text())["eyes"]["eye"]["mean_mpa"]
        for n in range(2)
    ]
    assert means[0] == means[1]


def test_one_thickness_is_not_that_of_two_eyes(pushed: Path, tmp_path: Path) -> None:
    changed_recording(tmp_path / "other", {'id = "eye"': 'id = "other"'})
    words = "thickness_m: of one eye; the recordings are of eye, other"
    with pytest.raises(sf.InputError, match=words):
        sf.calibrate([pushed, tmp_path / "other"], thickness_m=650e-6)


PHYSICS = ("eye", "needle", "form", "mechanics", "tissue", "globe", "supports")
# Keys of these sections that commands take elsewhere: options, recordings, groups of a
# data set, a library's axes.
ELSEWHERE = {
    "eye.thickness_um",
    "eye.youngs_modulus_mpa",
    "eye.iop_mmhg",
    "needle.gap_mm",
    "needle.polar_angle_deg",
    "needle.max_force_mn",
    "mechanics.kind",
    "tissue.relaxation",
}
BOOKKEEPING = {"scleraforce.records.study", "scleraforce.records.fields", "dataclasses"}

SMALL = """
[mesh]
kind = "KIND"
divisions = 4
level = 0
core = 4
rings = 6
[library]
thicknesses = 4
tensions = 4
tips = 4
max_tip_mm = 0.5
elements = 16
[dataset]
contacts = 2
[[dataset.group]]
thickness_um = 500.0
images = 4
max_force_mn = 10.0
"""
HEXAHEDRA = SMALL.replace("KIND", "hexahedra")
GRADED = SMALL.replace("KIND", "graded")
HELD = '[supports]\nkind = "bed-and-straps"\n'
BENT = (
    HELD + '[mechanics]\nkind = "finite-strain"\n[globe]\nkind ='
    ' "sealed"\n[needle]\ntilt_deg = 2.0\n'
)
EVERYTHING = """
[eye]
density_kg_m3 = 1000.0
[needle]
tilt_deg = 3.0
tilt_direction_deg = 40.0
[form]
semi_axes = [1.05, 1.0, 1.0]
[[form.wave]]
degree = 2
[[form.region]]
modulus_ratio = 0.7
[form.cornea]
radius_mm = 8.0
[mechanics]
follower = false
[tissue]
stiffening = 10.0
softer_through = 5.0
stiffer_around = 2.0
relaxation = [[0.12, 1.2], [0.15, { min = 5.0, max = 12.0 }]]
[globe]
kind = "sealed"
rigidity_mmhg13_per_ul = 0.02
rigidity_law = "logarithmic"
leak_time_s = 20.0
[supports]
kind = "bed-and-straps"
bed_stiffness_kpa_per_mm = 2.0
bed_shear_stiffness_kpa_per_mm = 0.1
strap_stiffness_n_per_m = 30.0
medial_azimuth_deg = 20.0
[phantom]
eye_drift_deg = [2.0]
eye_saccade_deg = [0.5]
needle_count = 1
[calibration]
points = 20
span_mm = 3.0
sigma_points = "star"
positive = false
iterations = 1
gate_sd = 4.0
shift_sd_mm = 0.3
turn_sd_deg = 0.4
inner_sd_mm = 0.06
model_error_percent = 2.0
"""
EYE = Setup(
    eye=Eye("eye-x", thickness_m=800e-6, modulus=Modulus.stated(0.3e6), iop_pa=266.0),
    needle=Needle(gap_m=0.5e-3, polar_rad=0.6),
)
STATED = Setup(
    eye=Eye(iop_pa=266.0, thickness_m=0.7e-3, globe=OPEN),
    needle=Needle(gap_m=0.5e-3, polar_rad=0.5),
)
STATE = WallState(
    youngs_modulus_pa=0.3e6,
    force_n=0.01,
    iop_pa=266.0,
    thickness_m=0.7e-3,
    gap_m=0.5e-3,
    polar_rad=0.5,
)


def phantom(study: Study) -> None:
    draw_relaxation(EYE, study, 0)
    study_sections(EYE, study)([0.002])


def simulate(study: Study) -> None:
    simulate_eye(study, 800e-6, 0.002, Contact(polar_rad=0.6))


def generate_linear(study: Study) -> None:
    SampleSimulator(study, 0.3e6).slices(plan_dataset(study).part(slice(0, 4)))


def generate(study: Study) -> None:
    plan = plan_dataset(study)
    library_slices(
        study,
        0.3e6,
        plan.part(slice(0, 4)),
        near_library(study, plan, analytic_library()),
    )


def calibrate_linear(study: Study) -> None:
    begin(study, STATED).filter.model.curves([STATE])


def calibrate(study: Study) -> None:
    plan_library(study)
    library = analytic_library().for_stiffening(study.tissue.stiffening)
    ratios = np.array([[STATE.iop_pa], [STATE.force_n]]) / STATE.youngs_modulus_pa
    walls = library.curves(np.array([STATE.thickness_m]), *ratios).curves_sbnc
    section = cut_surfaces(walls[0], STATE.gap_m)
    (wall,) = moving([section], np.random.default_rng(0), 3e-6)
    frame = ForceFrame(wall=wall, force_n=STATE.force_n)
    assert eye_of_forces(STATED, [frame], library, study) is not None


def library(study: Study) -> None:
    solve_path(plan_library(study), 0)


WORK = {
    ("simulate", "linear"): (simulate, GRADED + HELD),
    ("simulate", "finite-strain"): (simulate, GRADED + BENT),
    ("phantom", "linear"): (phantom, GRADED + HELD),
    ("phantom", "finite-strain"): (phantom, GRADED + BENT),
    ("generate", "linear"): (generate_linear, HEXAHEDRA),
    ("generate", "finite-strain"): (generate, HEXAHEDRA),
    ("calibrate", "linear"): (calibrate_linear, GRADED),
    ("calibrate", "finite-strain"): (calibrate, HEXAHEDRA),
    ("library", None): (library, HEXAHEDRA),
}


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Collect the physics keys that the code reads, except to check, compare or write a
    study.
    """
    seen: set[str] = set()

    def watch(section: str) -> None:
        kind = type(getattr(Study(), section))
        keys = {
            name: f"{section}.{field_key(item)}"
            for name, item in kind.__dataclass_fields__.items()
        }

        def spy(record: object, name: str) -> object:
            caller = sys._getframe(1)
            checks = (
                caller.f_code.co_name.startswith(("__", "_check"))
                and caller.f_code.co_name != "__init__"
            )
            if caller.f_globals["__name__"] not in BOOKKEEPING and not checks:
                seen.update({keys[name]} if name in keys else ())
            return object.__getattribute__(record, name)

        monkeypatch.setattr(kind, "__getattribute__", spy)

    for section in PHYSICS:
        watch(section)

    return seen


SOLVES_A_PATH = {("simulate", "finite-strain"), ("phantom", "finite-strain")}


@pytest.mark.parametrize(
    ("command", "mechanics"),
    [
        pytest.param(*one, marks=[pytest.mark.slow] * (one in SOLVES_A_PATH))
        for one in WORK
    ],
)
def test_the_table_names_the_keys_that_a_command_does_not_read(
    command: str, mechanics: str | None, read: set[str]
) -> None:
    work, text = WORK[command, mechanics]
    study = parse_study(text)
    kinds = {section: type(getattr(study, section)) for section in PHYSICS}
    every = {
        f"{name}.{field_key(key)}"
        for name, kind in kinds.items()
        for key in kind.__dataclass_fields__.values()
    }
    read.clear()
    work(study)
    of_physics = set(UNUSED[command, mechanics]) - set(FILTER)
    assert every - read - ELSEWHERE == of_physics


ARGUMENTS = {
    "simulate": "--thickness-um 500 --force-mn 10",
    "phantom": "--out OUT",
    "generate": "--out OUT",
    "calibrate": "no-recording --out OUT",
    "library": "--out OUT",
    "train kind=reader": "no-library --out OUT",
    "train kind=raw-reader": "no-library --out OUT",
    "reproduce": "--out OUT",
}


@pytest.mark.parametrize(
    ("command", "mechanics"), [case for case, unused in UNUSED.items() if unused]
)
def test_a_command_refuses_unused_keys_by_name(
    tmp_path: Path, shell, command: str, mechanics: str | None
) -> None:
    study = tmp_path / "all.toml"
    out = tmp_path / "out"
    study.write_text(EVERYTHING)
    options = f"--mechanics {mechanics}" if mechanics else ""
    typed = command.replace(" kind=", " --kind ")
    arguments = ARGUMENTS[command].replace("OUT", str(out))
    error = shell.refused(typed, arguments, options, "--study", study)
    keys = error.removeprefix(f"error: {study}: ").partition(": not used by")[0]
    assert keys.split(", ") == list(UNUSED[command, mechanics])
    assert not out.exists()
