"""Virtual eyes at finite strain, from the study to the sections that a recording is made of."""

import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from reference_walls import cut_section
from scleraforce.cli.main import run
from scleraforce.errors import InputError
from scleraforce.laboratory.virtual_eye import BentSections, PhantomEye, linear_sections, study_sections
from scleraforce.mechanics.contact import Section
from scleraforce.mechanics.finite_strain import bend_eye
from scleraforce.recording.folder import read_recording
from scleraforce.study import (
    EyeStudy,
    FormStudy,
    GlobeStudy,
    MechanicsStudy,
    MeshStudy,
    NeedleStudy,
    OctStudy,
    Study,
    WaveStudy,
    format_study,
)
from scleraforce.units import to_si

STUDY = Study(
    oct=OctStudy(columns=128, rows=96),
    mesh=MeshStudy(kind="graded", core=2, rings=4),
    mechanics=MechanicsStudy("finite-strain"),
    form=FormStudy(semi_axes=(1.04, 1.0, 0.96), wave=(WaveStudy(amplitude_fraction=0.1, degree=2),)),
)
EYE = PhantomEye(
    id="eye-x",
    thickness_m=800e-6,
    youngs_modulus_pa=0.3e6,
    iop_pa=266.0,
    gap_m=0.5e-3,
    polar_rad=0.6,
    azimuth_rad=0.3,
    direction_rad=0.2,
)
FORCES_N = (0.012, 0.0, 0.004)


def sections_in_a_process(eye: PhantomEye, study: Study, forces_n: tuple[float, ...]) -> list[Section]:
    return list(BentSections(eye, study)(forces_n))


def test_each_section_is_that_of_its_state_alone() -> None:
    together = study_sections(EYE, STUDY)(FORCES_N)
    bent = bend_eye(
        STUDY, EYE.plane.contact, thickness_m=800e-6, youngs_modulus_pa=0.3e6, iop_pa=266.0, max_force_n=0.012
    )
    for force_n, section in zip(FORCES_N, together, strict=True):
        alone = cut_section(bent.mesh, EYE.plane, bent.path.displacement_nc(force_n))
        assert np.abs(section.outer - alone.outer).max() < 1e-8
        assert np.abs(section.inner - alone.inner).max() < 1e-8
    top = [section.outer[:, 1].min() for section in together]
    assert top[1] < 1e-5 < 0.2e-3 < together[0].outer[np.abs(together[0].outer[:, 0]) < 0.2e-3, 1].min()


def test_a_larger_force_later_is_answered_and_smaller_ones_stay() -> None:
    sections_at = BentSections(EYE, STUDY)
    small = sections_at([0.003])[0]
    large, again = sections_at([0.012, 0.003])
    assert np.abs(again.outer - small.outer).max() < 1e-7  # steps differ
    near = np.abs(small.outer[:, 0]) < 1e-3
    assert np.all(large.outer[near, 1] > small.outer[near, 1] + 0.1e-3)
    assert sections_at([]) == []


def test_small_forces_without_pressure_bend_as_in_linear_mechanics() -> None:
    plain = replace(STUDY, form=FormStudy(), eye=EyeStudy(density_kg_m3=0.0))
    eye = replace(EYE, iop_pa=0.0)
    forces_n = (0.0, 1e-4)
    (rest, bent), (linear_rest, linear) = (
        BentSections(eye, plain)(forces_n),
        linear_sections(eye, plain)(forces_n),
    )
    moved, linear_moved = bent.outer - rest.outer, linear.outer - linear_rest.outer
    assert np.abs(moved - linear_moved).max() < 0.005 * np.abs(linear_moved).max()


def test_eye_and_study_go_to_another_process_and_sections_come_back() -> None:
    with ProcessPoolExecutor(1) as pool:
        there = pool.submit(sections_in_a_process, EYE, STUDY, (0.004,)).result()
    here = BentSections(EYE, STUDY)((0.004,))
    np.testing.assert_array_equal(there[0].outer, here[0].outer)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({}, r"form\.semi_axes, form\.wave: not used by `phantom` with linear mechanics"),
        ({"form": FormStudy(), "needle": NeedleStudy(tilt_rad=0.1)}, "tilt_deg"),
        ({"form": FormStudy(), "globe": GlobeStudy("sealed")}, r"globe\.kind"),
    ],
)
def test_linear_mechanics_refuses_an_eye_that_it_does_not_know(changes: dict, message: str) -> None:
    study = replace(STUDY, **{"mechanics": MechanicsStudy("linear"), **changes})
    with pytest.raises(InputError, match=message):
        study_sections(EYE, study)


def test_the_phantom_command_bends_at_finite_strain_and_says_so(tmp_path: Path, capsys) -> None:
    study = tmp_path / "study.toml"
    study.write_text(format_study(replace(STUDY, mechanics=MechanicsStudy())))
    out = tmp_path / "eye"
    arguments = ["phantom", "--study", str(study), "--out", str(out), "--forces-mn", "12,2", "--thickness-um", "800"]
    assert run(arguments) == 2
    assert f"{study}: form.semi_axes, form.wave: not used by `phantom`" in capsys.readouterr().err
    assert run([*arguments, "--mechanics", "finite-strain", "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["mechanics"] == "finite-strain"
    assert captured.err == ""
    truth = json.loads((out / "truth.json").read_text())
    assert truth["mechanics"]["kind"] == "finite-strain"
    assert truth["form"]["semi_axes"] == [1.04, 1.0, 0.96]
    polar = np.radians(35.0)
    assert truth["thickness_at_contact_m"] == pytest.approx(800e-6 * (1 + 0.1 * (1.5 * np.cos(polar) ** 2 - 0.5)))


@pytest.mark.slow
def test_the_phantom_of_a_sealed_eye_that_stiffens_tells_both_and_the_pressures(tmp_path: Path, capsys) -> None:
    study = tmp_path / "study.toml"
    study.write_text('[mesh]\nkind = "graded"\ncore = 4\nrings = 6\n[tissue]\nstiffening = 8.0\n')
    out = tmp_path / "eye"
    arguments = ["phantom", "--study", str(study), "--out", str(out), "--forces-mn", "12,0,25", "--globe", "sealed"]
    assert run([*arguments, "--json"]) == 2
    assert "globe.kind: not used by `phantom` with linear mechanics" in capsys.readouterr().err
    assert run([*arguments, "--mechanics", "finite-strain", "--rigidity", "0.02", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    truth = json.loads((out / "truth.json").read_text())
    pressures_pa = [frame["pressure_pa"] for frame in truth["frames"]]
    assert pressures_pa[1] == pytest.approx(truth["eye"]["iop_pa"])
    assert pressures_pa[1] < pressures_pa[0] < pressures_pa[2]
    assert truth["globe"]["kind"] == answer["globe"] == "sealed"
    assert truth["tissue"]["stiffening"] == answer["stiffening"] == 8.0
    assert truth["globe"]["rigidity_pa13_per_m3"] == pytest.approx(0.02 * to_si(1.0, "mmhg") ** (1 / 3) * 1e9)
    eye = read_recording(out).info.eye
    assert (eye.globe, eye.rigidity_pa13_per_m3) == ("sealed", None)  # as a laboratory knows it
