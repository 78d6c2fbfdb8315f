"""Poses of an eye in a frame."""

import numpy as np

from scleraforce.lab.tissue_light import Pose
from scleraforce.records.study import PhantomStudy, draw


def sample_pose(phantom: PhantomStudy, rng: np.random.Generator) -> Pose:
    """Draw the pose of an eye in one frame, without a recording that the depth and the
    tilt belong to.
    """
    depth_m = draw(phantom.surface_depth_m, rng) + draw(phantom.eye_shift_m, rng)
    return Pose(
        lateral_m=draw(phantom.eye_shift_m, rng),
        depth_m=depth_m,
        tilt_rad=draw(phantom.eye_tilt_rad, rng),
    )
