"""Eyes of finite strain in three dimensions, calibrated with walls of revolution: another model, another mesh."""

from dataclasses import replace
from math import radians
from pathlib import Path

import numpy as np
import pytest

from calibration_eyes import stated
from ideal_boundaries import ideal_boundaries
from scleraforce.calibration import assimilation
from scleraforce.calibration.assimilation import FrameStep
from scleraforce.laboratory.light import Pose
from scleraforce.laboratory.virtual_eye import BentSections, PhantomEye
from scleraforce.library.build import cached_library
from scleraforce.study import LibraryStudy, Study
from scleraforce.study.fields import Range

pytestmark = pytest.mark.slow

EYE = PhantomEye(
    id="bent",
    thickness_m=0.65e-3,
    youngs_modulus_pa=0.3e6,
    iop_pa=300.0,
    gap_m=0.6e-3,
    polar_rad=radians(42),
    direction_rad=radians(230),
)
FORCES = (0.040, 0.010, 0.052, 0.022, 0.031)
NARROW = LibraryStudy(
    thickness_m=Range(min=0.58e-3, max=0.72e-3),
    thicknesses=4,
    tension=Range(min=5e-3, max=6e-2),
    tensions=4,
    max_tip_m=5.5e-3,
    stiffenings=1,
)


@pytest.mark.long
def test_after_five_frames_the_modulus_is_within_3_percent_and_two_sd(tmp_path: Path) -> None:
    study, rng = replace(Study(), library=NARROW), np.random.default_rng(3)
    sections = BentSections(EYE, study)(FORCES)
    eye = assimilation.begin(study, stated(study, EYE), cached_library(study, folder=tmp_path, workers=1))
    alone = []
    for force_n, section in zip(FORCES, sections, strict=True):
        lateral_m, depth_m = rng.uniform(-0.2e-3, 0.2e-3, 2)
        pose = Pose(lateral_m=lateral_m, depth_m=0.5e-3 + depth_m)
        smoothing_m = study.calibration.surface_smoothing_m
        eye = assimilation.step(eye, ideal_boundaries(section, pose, study.oct, 5e-6, rng, smoothing_m), force_n)
        assert isinstance(eye.last, FrameStep)
        alone.append(eye.last.registered.wall.youngs_modulus_pa)
    assert eye.mean_pa == pytest.approx(EYE.youngs_modulus_pa, rel=0.03)
    assert abs(eye.mean_pa - EYE.youngs_modulus_pa) < 2 * eye.sd_pa
    assert eye.sd_pa < 0.03 * EYE.youngs_modulus_pa
    assert np.ptp(alone) < 0.08 * EYE.youngs_modulus_pa  # linear mechanics: by a factor of two and more
