"""The default library against load paths that it does not hold."""

import numpy as np
import pytest

from scleraforce.library.plan import plan_library
from scleraforce.library.store import build_library, open_library
from scleraforce.mechanics.axisymmetric import axisymmetric_path
from scleraforce.mechanics.meridian import MeridianSize
from scleraforce.study import Study

WALLS = 12


@pytest.mark.long
@pytest.mark.slow
def test_interpolation_is_worth_a_tenth_of_a_pixel_and_half_a_per_cent(tmp_path):
    study = Study()
    build_library(study, tmp_path / "library.zarr")
    library, plan = open_library(tmp_path / "library.zarr").for_contact(0.0), plan_library(study)
    rng = np.random.default_rng(7)
    thicknesses = rng.uniform(*plan.thickness_m[[0, -1]], WALLS)
    ratios = np.exp(rng.uniform(*np.log(plan.tension[[0, -1]]), WALLS)) * thicknesses / plan.radius_m
    dents_m = np.concatenate([[2e-5], np.linspace(0.1e-3, 9.9e-3, 30)])
    for wall in zip(thicknesses, ratios, strict=True):
        path = axisymmetric_path(
            plan.radius_m, wall[0], plan.poisson_ratio, plan.needle_radius_m, wall[1], tips_m=dents_m,
            max_force_ratio_m2=plan.grid.max_force_ratio_m2, size=MeridianSize(plan.grid.elements, plan.grid.layers),
        )  # fmt: skip
        tips = path.tip_m[1:]
        thickness, ratio = (np.full(len(tips), value) for value in wall)
        forces, curves = path.force_ratio_m2[1:], path.curves_sbnc[1:]
        found = library.at_tip(thickness, ratio, tips)
        near = curves[..., 0] < 9e-3
        assert found.force_ratio == pytest.approx(forces, rel=5e-3)
        assert np.linalg.norm(found.curves_sbnc - curves, axis=-1)[near].max() < 10e-6
        asked = (forces < 0.999 * library.largest_force_ratio(thickness, ratio)) & (
            np.maximum.accumulate(np.r_[0.0, forces[:-1]]) < forces
        )
        assert library.tips(thickness[asked], ratio[asked], forces[asked]) == pytest.approx(tips[asked], rel=5e-3)
