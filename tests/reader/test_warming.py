"""The frame that is read before the first real one goes all the way, or the first real one would take longer."""

from dataclasses import replace

import numpy as np
import pytest
from analytic_frames import KNOWN, SCALE, STUDY
from small_models import force_reader

from scleraforce.known import NOTHING_KNOWN, Known
from scleraforce.reader.model import LiveReader, warming_frame
from scleraforce.recording.pixels import PixelScale

SHAPE = (STUDY.oct.rows, STUDY.oct.columns)
RADIUS_M = STUDY.eye.radius_m


@pytest.mark.parametrize("known", [KNOWN, NOTHING_KNOWN, replace(KNOWN, thickness_m=0.4e-3)])
@pytest.mark.parametrize(
    ("shape", "scale"),
    [
        (SHAPE, SCALE),
        (SHAPE, replace(SCALE, refractive_index=1.38)),
        ((640, 800), PixelScale(lateral_m=20e-6, depth_m=8e-6, refractive_index=1.38)),
    ],
)
def test_network_and_fit_read_it(shape: tuple[int, int], scale: PixelScale, known: Known) -> None:
    model = force_reader()
    answer = model.read(warming_frame(shape, scale, RADIUS_M, known.thickness_m), scale, known)
    assert answer.fit is not None, answer.reason
    assert [method for method, _ in answer.readings] == ["network", "fit"]
    assert len(model._network.shown) == 1


def test_the_live_reader_has_shown_it_to_its_network_before_the_first_frame() -> None:
    model = force_reader()
    LiveReader(model, KNOWN, 1.38)
    assert len(model._network.shown) >= 1


def test_it_is_the_same_at_each_call_and_of_the_size_that_is_asked_for() -> None:
    frame = warming_frame((30, 40), SCALE, RADIUS_M)
    assert (frame.shape, frame.dtype) == ((30, 40), np.uint16)
    np.testing.assert_array_equal(frame, warming_frame((30, 40), SCALE, RADIUS_M))


def test_a_frame_wider_than_the_eye_has_a_wall_too() -> None:
    wide = PixelScale(lateral_m=100e-6, depth_m=40e-6)
    frame = warming_frame(SHAPE, wide, RADIUS_M)
    assert (frame > 800).any(axis=0)[236:276].all()
