"""The table of unused keys agrees with the code, and every command refuses them."""

import sys
from pathlib import Path

import pytest
from analytic_library import analytic_library

from scleraforce.calibration.assimilation import begin
from scleraforce.calibration.eye_model import EyeConstants, WallState
from scleraforce.laboratory.phantom import draw_relaxation
from scleraforce.laboratory.virtual_eye import PhantomEye, simulate_eye, study_sections
from scleraforce.learning.dataset import draft_plan, plan_dataset
from scleraforce.learning.generate import SampleSimulator, library_slices, near_library
from scleraforce.library.build import solve_path
from scleraforce.library.plan import plan_library
from scleraforce.mechanics.contact import Contact
from scleraforce.study import Study, parse_study
from scleraforce.study.fields import field_key
from scleraforce.study.unused import UNUSED

PHYSICS = ("eye", "needle", "form", "mechanics", "tissue", "globe", "supports")
# Keys of these sections that commands take elsewhere: options, recordings, groups of a data set, a library's axes.
ELSEWHERE = {
    "eye.thickness_um", "eye.youngs_modulus_mpa", "eye.iop_mmhg", "needle.gap_mm", "needle.polar_angle_deg",
    "needle.max_force_mn", "mechanics.kind", "tissue.relaxation",
}  # fmt: skip
BOOKKEEPING = {"scleraforce.study", "scleraforce.study.fields", "scleraforce.study.unused", "dataclasses"}

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
HEXAHEDRA, GRADED = SMALL.replace("KIND", "hexahedra"), SMALL.replace("KIND", "graded")
HELD = '[supports]\nkind = "bed-and-straps"\n'
BENT = HELD + '[mechanics]\nkind = "finite-strain"\n[globe]\nkind = "sealed"\n[needle]\ntilt_deg = 2.0\n'
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
"""
EYE = PhantomEye(id="eye-x", thickness_m=800e-6, youngs_modulus_pa=0.3e6, iop_pa=266.0, gap_m=0.5e-3, polar_rad=0.6)
STATED = EyeConstants(iop_pa=266.0, thickness_m=0.7e-3, gap_m=0.5e-3, polar_rad=0.5, polar_sd_rad=0.0)
STATE = WallState(youngs_modulus_pa=0.3e6, force_n=0.01, iop_pa=266.0, thickness_m=0.7e-3, gap_m=0.5e-3, polar_rad=0.5)


def phantom(study: Study) -> None:
    draw_relaxation(EYE, study, 0)
    study_sections(EYE, study)([0.002])


def simulate(study: Study) -> None:
    simulate_eye(study, 800e-6, 0.002, Contact(polar_rad=0.6))


def generate_linear(study: Study) -> None:
    SampleSimulator(study, 0.3e6).slices(draft_plan(study).samples(slice(0, 4)))


def generate(study: Study) -> None:
    near = near_library(study, plan_dataset(study), analytic_library())
    library_slices(study, 0.3e6, draft_plan(study).unit(0), near)


def calibrate_linear(study: Study) -> None:
    begin(study, STATED, None).filter.model.curves([STATE])


def calibrate(study: Study) -> None:
    begin(study, STATED, analytic_library().for_stiffening(study.tissue.stiffening)).filter.model.curves([STATE])


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
    """Collect the physics keys that the code reads, except to check, compare or write a study."""
    seen: set[str] = set()

    def watch(section: str) -> None:
        kind = type(getattr(Study(), section))
        keys = {name: f"{section}.{field_key(item)}" for name, item in kind.__dataclass_fields__.items()}

        def spy(record: object, name: str) -> object:
            caller = sys._getframe(1)
            if caller.f_globals["__name__"] not in BOOKKEEPING and not caller.f_code.co_name.startswith("__"):
                seen.update({keys[name]} if name in keys else ())
            return object.__getattribute__(record, name)

        monkeypatch.setattr(kind, "__getattribute__", spy)

    for section in PHYSICS:
        watch(section)
    return seen


SOLVES_A_PATH = {("simulate", "finite-strain"), ("phantom", "finite-strain")}


@pytest.mark.parametrize(
    ("command", "mechanics"), [pytest.param(*one, marks=[pytest.mark.slow] * (one in SOLVES_A_PATH)) for one in WORK]
)
def test_the_table_names_the_keys_that_a_command_does_not_read(
    command: str, mechanics: str | None, read: set[str]
) -> None:
    work, text = WORK[command, mechanics]
    study = parse_study(text)
    every = {
        f"{section}.{field_key(item)}"
        for section in PHYSICS
        for item in type(getattr(study, section)).__dataclass_fields__.values()
    }
    read.clear()
    work(study)
    assert every - read - ELSEWHERE == set(UNUSED[command, mechanics])


ARGUMENTS = {
    "simulate": "--thickness-um 500 --force-mn 10",
    "phantom": "--out OUT",
    "generate": "--out OUT",
    "calibrate": "no-recording --out OUT",
    "library": "--out OUT",
    "train --kind reader": "no-library --out OUT",
    "train --kind raw-reader": "no-library --out OUT",
    "reproduce": "--out OUT",
}


def test_a_command_refuses_unused_keys_by_name(tmp_path: Path, monkeypatch, shell) -> None:
    for function in ("simulate_eye", "study_sections"):  # of eyes of finite strain, which use all keys
        monkeypatch.setattr(f"scleraforce.notebook.virtual.{function}", not_refused)
    study, out = tmp_path / "all.toml", tmp_path / "out"
    study.write_text(EVERYTHING)
    for (command, mechanics), unused in UNUSED.items():
        options = f" --mechanics {mechanics}" if mechanics else ""
        line = f"{command} {ARGUMENTS[command]}{options} --study STUDY"
        words = [{"OUT": str(out), "STUDY": str(study)}.get(word, word) for word in line.split()]
        if not unused:
            shell.run(*words, code=130)
            continue
        keys = shell.refused(*words).removeprefix(f"error: {study}: ").partition(": not used by")[0]
        assert keys.split(", ") == list(unused)
        assert not out.exists()


def not_refused(*_: object, **__: object) -> None:
    raise KeyboardInterrupt
