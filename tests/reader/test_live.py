"""The reading in the control loop: the network's answer, with every verdict that needs no fit; its first frames."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest
from analytic_frames import KNOWN, SCALE, STUDY, image, tip_of, wall_section
from small_models import FIVE_MN, force_reader

from scleraforce.known import NOTHING_KNOWN, Known
from scleraforce.reader import load_classifier
from scleraforce.reader.answer import Answer, Reading
from scleraforce.reader.kinds import ForceReader
from scleraforce.reader.model import LiveReader, warming_frame
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.wall import find_wall
from scleraforce.study import SliceStudy, Study

WIDE = Reading(probabilities=(0.1, 0.5, 0.4), force_n=0.025, interval_n=(0.020, 0.0261), contact_m=0.0)


def live(frame: np.ndarray, model: ForceReader | None = None, known: Known = KNOWN) -> Answer:
    return LiveReader(model or force_reader(), known, 1.0).read(frame, SCALE)


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    return image(wall_section(tip_of(0.015)))


@pytest.mark.parametrize("default", ["fit", "network"])
def test_the_answer_is_the_networks_whichever_method_is_the_default(frame: np.ndarray, default: str) -> None:
    answer = live(frame, force_reader(default=default))
    assert (answer.usable, answer.reason, answer.predicted) == (True, None, 1)
    assert (answer.force_n, answer.interval_n) == (FIVE_MN.force_n, FIVE_MN.interval_n)
    assert (answer.probabilities, answer.contact_m) == (FIVE_MN.probabilities, FIVE_MN.contact_m)


def test_what_both_readers_say_of_a_frame_is_the_same_but_for_the_fit(frame: np.ndarray) -> None:
    read = replace(FIVE_MN, force_n=0.015, interval_n=(0.012, 0.018))
    whole = force_reader(read, default="network").read(frame, SCALE, KNOWN)
    assert whole.warnings == ()
    assert live(frame, force_reader(read)) == replace(whole, can_calibrate=False, readings=(), fit=None)


def test_the_network_is_shown_the_slices_of_the_frame_and_what_is_known(frame: np.ndarray) -> None:
    alone, beside_the_fit = force_reader(), force_reader()
    live(frame, alone)
    beside_the_fit.read(frame, SCALE, KNOWN)
    (cut, known), (expected, _) = alone._network.shown[-1], beside_the_fit._network.shown[-1]
    np.testing.assert_array_equal(cut, expected)
    assert known == KNOWN


def test_the_outline_is_that_of_the_segmentation(frame: np.ndarray) -> None:
    found, reading = find_wall(frame, SCALE), live(frame)
    np.testing.assert_array_equal(reading.segmentation.outer_row, found.outer_row)
    np.testing.assert_array_equal(reading.segmentation.inner_row, found.inner_row)


def test_a_frame_without_a_wall_is_not_usable_and_has_no_outline() -> None:
    reading = live(np.full((512, 512), 700, dtype=np.uint16))
    assert (reading.usable, reading.predicted) == (False, 2)
    assert "empty" in reading.reason
    assert np.isnan(reading.segmentation.outer_row).all()
    assert np.isnan(reading.segmentation.inner_row).all()


def test_an_eye_outside_the_training_is_withdrawn_from(frame: np.ndarray) -> None:
    answer = live(frame, known=replace(KNOWN, thickness_m=1.1e-3))
    assert (answer.usable, answer.predicted, answer.force_n) == (False, 2, None)
    assert "the model was trained on" in answer.reason


def test_a_contact_outside_the_training_is_withdrawn_from(frame: np.ndarray) -> None:
    answer = live(frame, force_reader(replace(FIVE_MN, contact_m=-1.4e-3)))
    assert (answer.usable, answer.predicted, answer.force_n) == (False, 2, None)
    assert answer.reason == "contact -1.4 mm from the frame's middle, the model was trained on -1 to 1 mm"


def test_a_few_millimetres_of_wall_are_withdrawn_from() -> None:
    narrow = image(wall_section(tip_of(0.01)), scanner=replace(STUDY.oct, width_m=5e-3))
    scale = PixelScale(lateral_m=5e-3 / 512, depth_m=SCALE.depth_m)
    answer = LiveReader(force_reader(), KNOWN, 1.0).read(narrow, scale)
    assert (answer.usable, answer.predicted) == (False, 2)
    assert "of the wall are seen" in answer.reason


def test_a_dent_that_leaves_the_window_is_read_only_where_the_interval_is_narrow() -> None:
    deep = image(wall_section(4.2e-3, surface_m=0.4e-3))
    answer = live(deep, force_reader(WIDE))
    assert (answer.usable, answer.predicted, answer.force_n) == (False, 2, None)
    assert "leaves the window" in answer.reason
    assert live(deep, force_reader(FIVE_MN)).usable
    assert live(image(wall_section(tip_of(0.015))), force_reader(WIDE)).usable


@pytest.mark.parametrize("broken", [{"force_n": nan}, {"probabilities": (nan,) * 3}, {"interval_n": (0.004, np.inf)}])
def test_a_reading_that_is_no_number_never_passes(frame: np.ndarray, broken: dict[str, object]) -> None:
    answer = live(frame, force_reader(replace(FIVE_MN, **broken)))
    assert (answer.usable, answer.predicted, answer.probabilities, answer.force_n) == (False, 2, None, None)
    assert "not a number" in answer.reason


def test_a_refractive_index_makes_the_wall_thinner(frame: np.ndarray) -> None:
    thick, thin = force_reader(), force_reader()
    LiveReader(thick, KNOWN, 1.0).read(frame, SCALE)
    LiveReader(thin, KNOWN, 1.4).read(frame, SCALE)
    pixels = [np.count_nonzero(model._network.shown[-1][0]) for model in (thick, thin)]
    assert pixels[1] / pixels[0] == pytest.approx(1 / 1.4, rel=0.03)


@pytest.fixture(scope="module")
def classifier(write_model, tmp_path_factory: pytest.TempPathFactory):
    path = tmp_path_factory.mktemp("live") / "model"
    write_model(path, replace(Study(), slice=SliceStudy()))
    return load_classifier(path, finder=None)  # the loop does not check the wall


def test_a_classifier_answers_as_it_does_elsewhere(frame: np.ndarray, classifier) -> None:
    answer = LiveReader(classifier, Known(), 1.0).read(frame, SCALE)
    whole = load_classifier(classifier.path, finder=None).read(frame, SCALE)  # the loop has no time for the wall finder
    assert answer == replace(whole, can_calibrate=False)
    assert (answer.usable, answer.force_n) == (True, None)


def test_a_classifier_withdraws_from_a_dent_that_leaves_the_window(classifier) -> None:
    answer = LiveReader(classifier, Known(), 1.0).read(image(wall_section(4.2e-3, surface_m=0.4e-3)), SCALE)
    assert (answer.usable, answer.predicted, answer.probabilities) == (False, 2, None)
    assert "leaves the window" in answer.reason


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
