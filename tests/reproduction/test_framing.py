"""The framing that `reproduce` trains on."""

import numpy as np

from scleraforce.laboratory.light import sample_pose
from scleraforce.reproduction.run import framed_for_laboratory
from scleraforce.study import Study, format_study, parse_study


def test_every_pose_of_the_virtual_laboratory_lies_in_the_framing_of_the_data_set() -> None:
    study = framed_for_laboratory(Study())
    rng = np.random.default_rng(1)
    poses = [sample_pose(study.phantom, rng) for _ in range(500)]
    lateral, depth = study.dataset.framing_lateral_m.bounds, study.dataset.framing_depth_m.bounds
    offsets = [pose.depth_m - study.slice.margin_m for pose in poses]
    assert lateral[0] < min(pose.lateral_m for pose in poses)
    assert max(pose.lateral_m for pose in poses) < lateral[1]
    assert depth[0] < min(offsets)
    assert max(offsets) < depth[1]
    # ... and not much more than that: half a millimetre of surface depths and shifts, and a pixel on both sides
    assert depth[1] - depth[0] < max(offsets) - min(offsets) + 0.3e-3


def test_a_framed_study_survives_its_toml() -> None:
    study = framed_for_laboratory(Study())
    assert parse_study(format_study(study)) == study
