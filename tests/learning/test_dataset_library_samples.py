"""Data sets with finite strain: slices drawn from a library, against cutting and filling them one by one."""

from dataclasses import replace

import numpy as np
import pytest
import zarr
from analytic_library import analytic_library

from scleraforce.errors import DatasetError, InputError, StudyError
from scleraforce.learning.dataset import draft_plan, open_dataset, plan_dataset
from scleraforce.learning.generate import generate_dataset, library_slices, near_library
from scleraforce.library.sections import cut_surfaces
from scleraforce.mechanics.slices import fill_section, slice_window
from scleraforce.study import DatasetGroup, GlobeStudy, MechanicsStudy, Range, Study, format_study, parse_study

MODULUS_PA = 0.3e6


@pytest.fixture(scope="module")
def library():
    return analytic_library()


@pytest.fixture(scope="module")
def study():
    base = Study()
    dataset = replace(
        base.dataset,
        contacts=5,
        gap_m=Range(min=0.35e-3, max=1e-3),
        tilt_rad=Range(min=-0.1, max=0.1),
        framing_lateral_m=Range(min=-1e-3, max=1e-3),
        framing_depth_m=Range(min=-2e-4, max=2e-4),
        group=(
            DatasetGroup(thickness_m=5e-4, images=250, max_force_n=30e-3),
            DatasetGroup(thickness_m=8e-4, images=200, max_force_n=50e-3),
        ),
    )
    return parse_study(format_study(replace(base, dataset=dataset)))


def one_by_one(study, library, plan, sample):
    """Cut and fill one sample as a section is cut and filled anywhere else."""
    thickness, ratio = plan.thickness_m[sample : sample + 1], np.array([study.eye.iop_pa / MODULUS_PA])
    plane = float(plan.gap_m[sample]), float(plan.tilt_rad[sample])
    beside = library.for_contact(float(plan.polar_rad[sample]))
    force_ratio = plan.force_n[sample : sample + 1] / MODULUS_PA
    resting, loaded = (
        cut_surfaces(beside.curves(thickness, ratio, force).curves_sbnc[0], *plane)
        for force in (np.zeros(1), force_ratio)
    )
    framing = float(plan.framing_lateral_m[sample]), float(plan.framing_depth_m[sample])
    return fill_section(loaded, slice_window(study.slice, float(resting.outer[:, 1].min()), *framing))


@pytest.mark.slow
def test_slices_are_those_of_cutting_and_filling_one_by_one(study, library):
    plan = plan_dataset(study)
    near = near_library(study, plan, library)
    images = library_slices(study, MODULUS_PA, draft_plan(study).unit(1), near)
    numbers = np.arange(plan.images)[plan.unit(1)]
    differing = [
        int((image != one_by_one(study, library, plan, sample)).sum())
        for sample, image in zip(numbers[:25], images, strict=False)
    ]
    assert max(differing) <= 2  # pixels of 5,600: centres on a boundary, to 2 um
    assert np.mean(differing) < 0.4


@pytest.mark.slow
def test_the_store_says_finite_strain_and_is_taken_up(study, library, tmp_path):
    def interrupt(done: int) -> None:
        if done:
            raise KeyboardInterrupt

    whole, taken_up = tmp_path / "whole", tmp_path / "taken_up"
    result = generate_dataset(study, whole, youngs_modulus_pa=MODULUS_PA, library=library)
    assert (result.images, result.simulated) == (450, 450)
    with pytest.raises(KeyboardInterrupt):
        generate_dataset(study, taken_up, youngs_modulus_pa=MODULUS_PA, library=library, progress=interrupt)
    with pytest.raises(DatasetError, match="begun with another mechanics"):
        generate_dataset(study, taken_up, youngs_modulus_pa=MODULUS_PA)
    assert generate_dataset(study, taken_up, youngs_modulus_pa=MODULUS_PA, library=library).simulated < 450
    files = [path.relative_to(whole) for path in whole.rglob("*") if path.is_file()]
    assert all((whole / file).read_bytes() == (taken_up / file).read_bytes() for file in files)
    assert zarr.open_group(whole, mode="r").attrs["mechanics"] == "finite-strain"
    dataset = open_dataset(whole)
    assert dataset.slices.any(axis=(1, 2)).all()
    assert set(np.unique(dataset.slices)) == {0, 255}


def test_a_library_of_another_eye_and_other_mechanics_are_refused(study, library, tmp_path):
    plan = plan_dataset(study)
    other = replace(library, radius_m=11e-3)
    with pytest.raises(DatasetError, match="library: of radius, nu, needle radius"):
        near_library(study, plan, other)
    dead = MechanicsStudy(follower=False)
    others = {"globe.kind": {"globe": GlobeStudy("sealed")}, "mechanics.follower": {"mechanics": dead}}
    for key, changes in others.items():
        with pytest.raises(StudyError, match=rf"{key}: not used by `generate` with finite-strain mechanics"):
            generate_dataset(replace(study, **changes), tmp_path / "slices", library=library)
    assert not (tmp_path / "slices").exists()


def test_a_force_beyond_the_library_is_named(study, library):
    with pytest.raises(InputError, match=r"F/E: .* mm\^2 is outside the library's range, 0 to 0\.5 mm\^2"):
        library_slices(study, 0.05e6, draft_plan(study).unit(0), library)
