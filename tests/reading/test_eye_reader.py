"""The reader of an eye: its memory, its remarks, the pressure of a moment; the reading
in the control loop, by the network alone.
"""

from dataclasses import replace
from math import inf, nan

import numpy as np
import pytest
from analytic_frames import (
    KNOWN,
    SCALE,
    STUDY,
    frame_under,
    image,
    tip_of,
    wall_section,
)
from small_models import FIVE_MN, force_reader

from scleraforce.reading.answer import Answer, Reading
from scleraforce.reading.eye_reader import (
    EyeReader,
    Memory,
    MomentFrame,
    OpenedMoment,
    warming_frame,
)
from scleraforce.reading.load_model import load_classifier, load_force_reader
from scleraforce.reading.needle_place import NeedlePlace
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, REFERENCE_RIGIDITY, SEALED, Globe
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import NOTHING_KNOWN, Setup
from scleraforce.records.study import Study
from scleraforce.records.tissue_relaxation import Relaxation
from virtual_eyes import changed

RELAXING = changed(KNOWN, relaxation=Relaxation.declared([[0.2, 1.0]]))
LEAKING = changed(
    KNOWN, globe=Globe.declared("sealed", REFERENCE_RIGIDITY, leak_time_s=20.0)
)
FRAME = frame_under(0.015)
NOISE = np.random.default_rng(0).integers(0, 4096, FRAME.shape, np.uint16)
BLANK = np.full((512, 512), 700, dtype=np.uint16)
# so shallow that an open and a sealed globe are nearly the same
SHALLOW = image(wall_section(tip_of(0.004)))
DEEP = image(wall_section(4.2e-3, surface_m=0.4e-3))


def read(
    reader: EyeReader, pixels: np.ndarray, memory: Memory | None = None, **stated: float
) -> tuple[Answer, Memory]:
    scale = stated.pop("scale", SCALE)
    moment = OpenedMoment((MomentFrame(pixels),), scale, **stated)
    (answer,), after = reader.read(moment, memory or reader.start())
    return answer, after


@pytest.mark.parametrize(
    "setup", [KNOWN, RELAXING, LEAKING], ids=["", "tissue", "leak"]
)
@pytest.mark.parametrize("monitored", [False, True])
def test_a_frame_that_cannot_be_judged_leaves_the_memory_as_it_was(setup, monitored):
    reader = EyeReader(force_reader(), setup)
    memory = reader.start(monitored=monitored)
    _, memory = read(reader, FRAME, memory, time_s=1.0)
    answer, after = read(reader, NOISE, memory, time_s=1.1)
    assert not answer.usable
    assert vars(after) == vars(memory)


def test_a_moment_before_the_last_one_begins_a_new_sequence():
    reader = EyeReader(force_reader(), RELAXING)
    first, memory = read(reader, FRAME, time_s=5.0)
    later, memory = read(reader, FRAME, memory, time_s=5.1)
    assert later.force_n != first.force_n
    again, _ = read(reader, FRAME, memory, time_s=5.0)
    assert again.verdict == first.verdict


@pytest.mark.parametrize(
    ("setup", "pixels", "stated", "fields"),
    [
        (KNOWN, SHALLOW, {}, []),
        (RELAXING, SHALLOW, {}, ["relaxation"]),
        (RELAXING, SHALLOW, {"held_s": 2.0}, []),
        (RELAXING, SHALLOW, {"time_s": 1.0}, []),
        (LEAKING, SHALLOW, {}, ["leak_time_s"]),
        (LEAKING, SHALLOW, {"time_s": 1.0}, []),
        (LEAKING, SHALLOW, {"iop_pa": 250.0}, []),  # which the leak has left
        (LEAKING, NOISE, {}, []),
    ],
)
def test_a_single_frame_says_what_it_does_not_know_of_the_time_before(
    setup, pixels, stated, fields
):
    answer, _ = read(EyeReader(force_reader(), setup), pixels, **stated)
    assert [field for one in answer.remarks for field in one.fields] == fields


def test_a_moment_is_read_at_its_pressure_as_if_the_eye_had_it():
    reader = EyeReader(force_reader(), KNOWN)
    iop_pa = 1.3 * KNOWN.eye.iop_pa
    expected, _ = read(replace(reader, setup=changed(KNOWN, iop_pa=iop_pa)), FRAME)
    answer, _ = read(reader, FRAME, iop_pa=iop_pa)
    usual, _ = read(reader, FRAME)
    assert answer.verdict == expected.verdict != usual.verdict


@pytest.mark.parametrize(("pierced", "expected"), [(None, {"pierced"}), (False, set())])
def test_a_puncture_is_remarked_unless_somebody_says_that_there_was_none(
    pierced, expected
):
    reader = EyeReader(force_reader(FIVE_MN), KNOWN)
    memory = reader.start()
    found = set[str]()
    for number, pixels in enumerate((FRAME,) * 6 + (SHALLOW,) * 3):
        stated = {"time_s": 0.01 * number, "pierced": pierced}
        answer, memory = read(reader, pixels, memory, **stated)
        found |= {remark.code for remark in answer.remarks}

    assert found & {"pierced"} == expected
    assert bool(memory.punctures_s) == bool(expected)


WIDE = Reading(
    probabilities=(0.1, 0.5, 0.4),
    force_n=0.025,
    interval_n=(0.020, 0.0261),
    contact_m=0.0,
)


def live(pixels: np.ndarray, reading: Reading = FIVE_MN, **eye: float) -> Answer:
    reader = EyeReader(force_reader(reading), changed(KNOWN, **eye), by="network")
    return read(reader, pixels)[0]


def test_a_live_answer_is_the_network_s_and_the_whole_one_without_the_fit():
    agreeing = replace(FIVE_MN, force_n=0.015, interval_n=(0.012, 0.018))
    alone = force_reader(agreeing)
    beside_the_fit = force_reader(agreeing, default="network")
    whole = beside_the_fit.read(FRAME, SCALE, KNOWN)
    answer, _ = read(EyeReader(alone, KNOWN, by="network"), FRAME)
    assert whole.warnings == ()
    assert (answer.force_n, answer.interval_n) == (0.015, (0.012, 0.018))
    assert answer == replace(
        whole, can_calibrate=False, readings=(), fit=None, places=NeedlePlace()
    )
    wall = answer.segmentation
    np.testing.assert_array_equal(wall.outer_row, whole.segmentation.outer_row)
    np.testing.assert_array_equal(wall.inner_row, whole.segmentation.inner_row)
    cut, known = alone.network.shown[-1]
    np.testing.assert_array_equal(cut, beside_the_fit.network.shown[-1][0])
    assert known == KNOWN


@pytest.mark.parametrize(
    ("pixels", "change", "eye", "words"),
    [
        (BLANK, {}, {}, "empty"),
        (FRAME, {}, {"thickness_m": 1.1e-3}, "the model was trained on"),
        (FRAME, {"contact_m": -1.4e-3}, {}, "contact -1.4 mm from the frame's middle"),
        (DEEP, vars(WIDE), {}, "leaves the window"),
        (FRAME, {"force_n": nan}, {}, "not a number"),
        (FRAME, {"interval_n": (0.004, inf)}, {}, "not a number"),
    ],
)
def test_the_loop_withdraws_wherever_a_frame_cannot_be_judged(
    pixels, change, eye, words
):
    answer = live(pixels, replace(FIVE_MN, **change), **eye)
    assert (answer.usable, answer.predicted) == (False, 2)
    assert (answer.probabilities, answer.force_n) == (None, None)
    assert words in answer.reason
    if pixels is BLANK:
        assert np.isnan(answer.segmentation.outer_row).all()


@pytest.mark.parametrize(("pixels", "reading"), [(DEEP, FIVE_MN), (FRAME, WIDE)])
def test_a_narrow_interval_or_a_dent_within_the_window_is_answered(pixels, reading):
    assert live(pixels, reading).usable


def test_an_assumed_pressure_is_a_missing_input_until_a_moment_states_one():
    def missing(reader: EyeReader) -> bool:
        return any(remark.fields == ("iop_pa",) for remark in reader.remarks)

    reader = EyeReader(force_reader(), changed(KNOWN, iop_assumed=True))
    assert missing(reader)
    assert not missing(reader.at(1.2 * KNOWN.eye.iop_pa))
    assert not missing(EyeReader(force_reader(), KNOWN))


@pytest.mark.parametrize(
    ("known", "thinner"), [(None, 1.4), (KNOWN.eye.thickness_m, 1.0)]
)
def test_a_refractive_index_makes_a_wall_thinner_whose_thickness_is_not_known(
    known: float | None, thinner: float
):
    pixels = []
    for index in (None, 1.4):
        model = force_reader()
        setup = changed(KNOWN, refractive_index=index, thickness_m=known)
        reader = EyeReader(model, setup, by="network")
        read(reader, FRAME, scale=reader.scale_of(SCALE.lateral_m, SCALE.depth_m))
        pixels.append(np.count_nonzero(model.network.shown[-1][0]))
    assert pixels[1] / pixels[0] == pytest.approx(1 / thinner, rel=0.03)


def test_a_classifier_answers_as_it_does_elsewhere(write_model, tmp_path):
    path = write_model(tmp_path / "model", Study()).path
    # the loop does not check the wall
    classifier = load_classifier(path, finder=None)
    reader = EyeReader(classifier, Setup(), by="network")
    answer, _ = read(reader, FRAME)
    assert answer == replace(classifier.read(FRAME, SCALE), can_calibrate=False)
    assert (answer.usable, answer.force_n) == (True, None)
    answer, _ = read(reader, DEEP)
    assert (answer.usable, answer.predicted, answer.probabilities) == (False, 2, None)
    assert "leaves the window" in answer.reason


OTHER = PixelScale(lateral_m=20e-6, depth_m=8e-6, refractive_index=1.38)


@pytest.mark.parametrize(
    "known", [KNOWN, NOTHING_KNOWN, changed(KNOWN, thickness_m=0.4e-3)]
)
@pytest.mark.parametrize(("shape", "scale"), [((512, 512), SCALE), ((640, 800), OTHER)])
def test_network_and_fit_read_a_warming_frame(known, shape, scale):
    radius_m = STUDY.eye.radius_m
    frame = warming_frame(shape, scale, radius_m, known.eye.thickness_m)
    answer = force_reader().read(frame, scale, known)
    assert answer.fit is not None, answer.reason
    assert [method for method, _ in answer.readings] == ["network", "fit"]


def sure(mean_pa: float, sd_pa: float = 0.0) -> Modulus:
    return Modulus(mean_pa=mean_pa, sd_pa=sd_pa, source="own")


def test_the_stiffness_is_a_known_open_walls_and_grows_with_its_modulus():
    """It says what a withdrawal explains of a fall."""
    model = load_force_reader(SHIPPED_READER)
    eye = Eye(modulus=sure(0.3e6), thickness_m=600e-6, iop_pa=266.0, globe=OPEN)
    known = Setup(eye=eye)

    def steepest(**eye: object) -> float | None:
        return model.steepest_n_m(changed(known, **eye))

    soft = steepest(modulus=sure(0.2e6), iop_pa=266.0 * 2 / 3)
    hard = steepest(modulus=sure(0.4e6), iop_pa=266.0 * 4 / 3)
    assert hard == pytest.approx(2.0 * soft)
    assert 10.0 < soft < 25.0
    assert steepest(globe=SEALED) is steepest(thickness_m=None) is None

    reader = EyeReader(model, changed(known, modulus=sure(0.3e6, 0.05e6)), "network")
    adopted = reader.with_eye(replace(eye, modulus=sure(0.3e6, 0.01e6)))
    expected = steepest(modulus=sure(0.32e6))
    assert model.steepest_n_m(adopted.setup) == pytest.approx(expected)
    # the reader does not read it
    assert reader.with_eye(replace(eye, modulus=sure(99e6))) is reader
