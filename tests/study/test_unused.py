"""Keys of a study that a command does not use are refused by name; keys for other work are allowed."""

from dataclasses import replace
from math import radians

import pytest

from scleraforce.errors import StudyError
from scleraforce.study import (
    CorneaStudy,
    EyeStudy,
    FormStudy,
    GlobeStudy,
    MechanicsStudy,
    MeshStudy,
    NeedleStudy,
    NetworkStudy,
    PhantomStudy,
    RegionStudy,
    Study,
    SupportsStudy,
    TissueStudy,
    WaveStudy,
    fixed,
)
from scleraforce.study.unused import UNUSED, refuse_unused

BED = SupportsStudy(kind="bed-and-straps")
CHANGED = {
    "eye.density_kg_m3": Study(eye=EyeStudy(density_kg_m3=1000.0)),
    "form.semi_axes": Study(form=FormStudy(semi_axes=(1.1, 1.0, 1.0))),
    "form.wave": Study(form=FormStudy(wave=(WaveStudy(),))),
    "form.region": Study(form=FormStudy(region=(RegionStudy(modulus_ratio=0.7),))),
    "form.cornea": Study(form=FormStudy(cornea=CorneaStudy())),
    "needle.tilt_deg": Study(needle=NeedleStudy(tilt_rad=radians(5.0))),
    "needle.tilt_direction_deg": Study(needle=NeedleStudy(tilt_rad=0.1, tilt_direction_rad=1.0)),
    "globe.kind": Study(globe=GlobeStudy("sealed")),
    "globe.rigidity_mmhg13_per_ul": Study(globe=GlobeStudy("sealed", rigidity_pa13_per_m3=0.1e9)),
    "globe.rigidity_law": Study(globe=GlobeStudy("sealed", rigidity_law="logarithmic")),
    "tissue.stiffening": Study(tissue=TissueStudy(10.0)),
    "mechanics.follower": Study(mechanics=MechanicsStudy(follower=False)),
    "supports.kind": Study(supports=SupportsStudy(kind="straps")),
    "supports.bed_stiffness_kpa_per_mm": Study(supports=replace(BED, bed_stiffness_pa_per_m=1e6)),
    "supports.bed_shear_stiffness_kpa_per_mm": Study(supports=replace(BED, bed_shear_stiffness_pa_per_m=1e5)),
    "supports.strap_stiffness_n_per_m": Study(supports=replace(BED, strap_stiffness_n_per_m=40.0)),
    "phantom.eye_drift_deg": Study(phantom=PhantomStudy(eye_drift_rad=fixed(0.03))),
    "phantom.eye_saccade_deg": Study(phantom=PhantomStudy(eye_saccade_rad=fixed(0.01))),
    "phantom.needle_count": Study(phantom=PhantomStudy(needle_count=fixed(1))),
    "supports.medial_azimuth_deg": Study(supports=replace(BED, medial_azimuth_rad=1.0)),
}


def test_a_key_is_refused_by_the_commands_that_do_not_use_it_and_by_no_other() -> None:
    assert {key for keys in UNUSED.values() for key in keys} == set(CHANGED)
    other = Study(network=NetworkStudy(epochs=3), mesh=MeshStudy(core=8), mechanics=MechanicsStudy("finite-strain"))
    allowed = (Study(), replace(other, eye=EyeStudy(iop_pa=400.0, radius_m=11e-3)))
    for work, refused in UNUSED.items():
        for study in allowed:
            refuse_unused(study, *work)
        for key, study in CHANGED.items():
            if key in refused:
                with pytest.raises(StudyError, match=rf"^study: .*{key}.*: not used by `{work[0]}`"):
                    refuse_unused(study, *work)
            else:
                refuse_unused(study, *work)


def test_a_stiffening_is_refused_with_the_reason_and_the_remedy() -> None:
    why = "(linear mechanics knows no tissue that stiffens, and a library has a range of it, [library])"
    for work, end in {
        ("simulate", "linear"): f"with linear mechanics {why}; leave it out, or give --mechanics finite-strain",
        ("generate", "finite-strain"): f"with finite-strain mechanics {why}; leave it out",
        ("train --kind reader", None): f"{why}; leave it out",
    }.items():
        with pytest.raises(StudyError) as found:
            refuse_unused(CHANGED["tissue.stiffening"], *work)
        assert str(found.value) == f"study: tissue.stiffening: not used by `{work[0]}` {end}"


def test_one_line_names_all_keys_and_other_mechanics_only_where_it_uses_them() -> None:
    both = replace(CHANGED["form.wave"], needle=NeedleStudy(tilt_rad=0.1))
    with pytest.raises(StudyError) as found:
        refuse_unused(both, "simulate", "linear")
    assert str(found.value) == (
        "study: form.wave, needle.tilt_deg: not used by `simulate` with linear mechanics; leave them out, or give "
        "--mechanics finite-strain"
    )
    with pytest.raises(StudyError, match=r"with linear mechanics; leave it out$"):
        refuse_unused(CHANGED["form.wave"], "generate", "linear")
    with pytest.raises(StudyError, match=r"with finite-strain mechanics; leave it out, or give --mechanics linear$"):
        refuse_unused(CHANGED["eye.density_kg_m3"], "generate", "finite-strain")


def test_a_key_that_another_one_switches_off_is_refused() -> None:
    for study, message in [
        (Study(supports=SupportsStudy(bed_stiffness_pa_per_m=1e6)), r"bed_stiffness_kpa_per_mm: has no effect"),
        (Study(supports=SupportsStudy(kind="straps", bed_shear_stiffness_pa_per_m=1e5)), r'"straps"; .* give "bed" or'),
        (Study(supports=SupportsStudy(kind="bed", strap_stiffness_n_per_m=9.0)), r'strap_stiffness_n.*kind = "bed"'),
        (Study(supports=SupportsStudy(medial_azimuth_rad=1.0)), r'medial_azimuth_deg: has no .*kind = "clamped"'),
        (Study(needle=NeedleStudy(tilt_direction_rad=1.0)), r"tilt_direction_deg: has no effect with needle\.tilt"),
    ]:
        with pytest.raises(StudyError, match=message):
            refuse_unused(study, "simulate", "finite-strain")
