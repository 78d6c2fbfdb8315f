"""`calibrate --without-force`: from recordings without a force log to a file that
readers take.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from analytic_frames import BOTH, LATERAL_M, eye_of_population, middling_eye

import scleraforce as sf
from predicted_walls import Walls, predict_wall
from scleraforce.base.errors import InputError
from scleraforce.calibration import found_walls
from scleraforce.calibration.stiffness_from_shape import (
    MOST_FRAMES,
    EyePosterior,
    _spread,
)
from scleraforce.fit.frames_of_an_eye import ShownFrame
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.records.calibration_file import (
    known_of_eye,
    read_calibration,
)
from scleraforce.records.eye import LEAST_MODULUS_SD, Eye
from scleraforce.records.frame import frame_digest
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation

pytestmark = pytest.mark.usefixtures("made_up_walls")


@pytest.fixture(scope="module")
def found(made_up_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("shape") / "out.json"
    sf.calibrate(made_up_folder, without_force=True, out=out)
    return out


def test_the_file_says_that_no_force_was_measured_and_is_read_back(found):
    entry = json.loads(found.read_text())["eyes"]["made-up"]
    assert entry["without_force"] is True
    # no force has been used: `evaluate` scores all of them
    assert entry["frames"] == []
    assert (
        entry["updates"]
        == len([step for step in entry["steps"] if step["skipped"] is None])
        >= 4
    )


def test_readers_take_its_uncertainty_once_and_do_not_narrow_it(found):
    known = known_of_eye(
        Setup(eye=Eye(iop_pa=266.0), needle=Needle(gap_m=0.5e-3)),
        read_calibration(found),
        "made-up",
    )
    assert known.eye.modulus is not None
    assert known.eye.modulus.source == "shape"
    prior = prior_of(known, Study().reader)
    assert prior.discrepancy.level_sd == known.eye.modulus.relative_sd
    own = replace(
        known.eye.modulus,
        source="own",
        sd_pa=LEAST_MODULUS_SD * known.eye.modulus.mean_pa,
    )
    by_force = replace(known, eye=replace(known.eye, modulus=own))
    same_force = prior_of(by_force, Study().reader).same_force
    np.testing.assert_allclose(prior.same_force, same_force, rtol=1e-12)


def test_known_forces_narrow_it(found, made_up_folder):
    eye = sf.calibrate(made_up_folder, without_force=True, frames=1).eyes["made-up"]
    by_shape = read_calibration(found).eyes["made-up"].eye.modulus
    assert by_shape is not None
    assert eye.sd_pa / eye.mean_pa < 0.7 * by_shape.sd_pa / 0.27e6
    assert eye.mean_pa == pytest.approx(0.27e6, rel=0.15)
    assert [frame.force_n > 0.0 for frame in eye.frames].count(True) == 1


@pytest.mark.parametrize(
    ("change", "given", "words"),
    [
        ("iop_pa", {}, "eye.iop_pa: missing"),
        (None, {"parameters": ["e"]}, "without_force"),
        (
            None,
            {"without_force": False, "prior": "c.json"},
            "`prior`: is the prior of without_force",
        ),
    ],
)
def test_what_cannot_be_is_refused(
    change: str | None,
    given: dict[str, Any],
    words: str,
    made_up_folder,
):
    recording = sf.read_recording(made_up_folder)

    if change is not None:
        info = replace(
            recording.info, eye=replace(recording.info.eye, **{change: None})
        )
        recording = replace(recording, info=info)

    with pytest.raises(InputError, match=words):
        sf.calibrate(recording, **{"without_force": True, **given})


def test_a_posterior_keeps_the_most_different_dents_and_the_known_forces():
    tips_m = [1e-6 * number for number in range(MOST_FRAMES + 4)] + [3e-3]
    kept = _spread(tips_m, [place == 5 for place in range(len(tips_m))])
    assert len(kept) == MOST_FRAMES
    assert {0, 5, len(tips_m) - 1} <= set(kept)


def test_a_frame_without_a_wall_of_the_library_teaches_nothing(
    library,
):
    shown = predict_wall(Walls(library), middling_eye(1e-3), BOTH).depth_m.reshape(
        2, -1
    )
    flat = ShownFrame(lateral_m=LATERAL_M, depth_bc=shown * 0.0 + [[1e-3], [1.6e-3]])
    setup = eye_of_population(0.3e6, 0.1e6)
    eye = EyePosterior(setup=setup, study=Study(), library=library)
    assert eye.with_frames([flat]) is eye
    after = eye.with_frames([ShownFrame(lateral_m=LATERAL_M, depth_bc=shown)])
    assert len(after.frames) == 1
    assert after.modulus.source == "shape"


def test_a_calibration_finds_the_wall_of_each_frame_once(
    made_up_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked = list[str]()

    def counted(frame: np.ndarray, *more: Any) -> Segmentation:
        looked.append(frame_digest(frame))
        return find_wall(frame, *more)

    monkeypatch.setattr(found_walls, "find_wall", counted)
    sf.calibrate(made_up_folder, without_force=True)
    assert len(looked) == len(set(looked)) == 6
