"""The pictures of a calibration show the wall as the filter took it to be."""

from dataclasses import replace

import numpy as np
import pytest
from analytic_frames import IOP_PA, LIBRARY, STUDY, THICKNESS_M
from calibrated_eye import calibration_of_a_sealed_eye

from scleraforce.calibration.assimilation import FrameStep, begin, moments, step
from scleraforce.calibration.eye_model import EyeConstants, stated_wall
from scleraforce.known.eye import SEALED
from scleraforce.laboratory.ideal_boundaries import ideal_boundaries
from scleraforce.laboratory.light import Pose
from scleraforce.report.calibration_figures import draw_observed_points
from scleraforce.section.plane import Section


@pytest.mark.slow
def test_the_wall_of_a_sealed_eye_is_drawn_through_its_predicted_points() -> None:
    """With the rigidity that the frames told, which is another than the one in the middle of what was known."""
    truth = EyeConstants(
        iop_pa=IOP_PA, thickness_m=THICKNESS_M, gap_m=0.6e-3, polar_rad=0.0, polar_sd_rad=0.0,
        globe=replace(SEALED, mean=0.4 * SEALED.mean),
    )  # fmt: skip
    found, random = begin(STUDY, replace(truth, globe=SEALED), LIBRARY), np.random.default_rng(0)
    for force_n in (0.012, 0.03):
        outer, inner = found.filter.model.curves([stated_wall(truth, 0.3e6, force_n, 0.0)])[0]
        pose = Pose(lateral_m=0.0, depth_m=0.5e-3)
        found = step(found, ideal_boundaries(Section(outer, inner), pose, STUDY.oct, 2e-6, random), force_n)
    assert isinstance(found.last, FrameStep)
    means, sds = moments(found.filter, found.state)
    eye = replace(
        calibration_of_a_sealed_eye().eyes["mine"],
        names=found.filter.space.names,
        means=tuple(means.tolist()),
        sds=tuple(sds.tolist()),
        state=found.state,
        filter=found.filter,
        steps=(found.last,),
    )
    width_m, depth_m = STUDY.oct.width_m, STUDY.oct.depth_m
    final = draw_observed_points(eye, np.zeros((4, 4), np.uint16), 0, width_m, depth_m).axes[1]
    *curves, _, predicted = (np.column_stack(line.get_data()) for line in final.lines)
    lateral_mm, depth_mm = predicted.T
    off_mm = [np.abs(np.interp(lateral_mm, *curve.T) - depth_mm) for curve in curves]
    assert np.minimum(*off_mm).max() < 1e-3
