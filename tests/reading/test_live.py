"""The reading in the control loop: the network's answer, with every verdict that needs
no fit; its first frames.

The stiffness of a known wall says what a withdrawal explains of a fall.
"""

from dataclasses import replace
from math import nan

import numpy as np
import pytest
from analytic_frames import KNOWN, SCALE, STUDY, image, tip_of, wall_section
from small_models import FIVE_MN, force_reader

from scleraforce.reading.answer import Answer, Reading
from scleraforce.reading.eye_reader import (
    EyeReader,
    MomentFrame,
    OpenedMoment,
    warming_frame,
)
from scleraforce.reading.load_model import load_classifier, load_force_reader
from scleraforce.reading.needle_place import NOWHERE
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, SEALED
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.scan import PixelScale, Scan
from scleraforce.records.setup import NOTHING_KNOWN, Setup
from scleraforce.records.study import SliceStudy, Study

WIDE = Reading(
    probabilities=(0.1, 0.5, 0.4),
    force_n=0.025,
    interval_n=(0.020, 0.0261),
    contact_m=0.0,
)


def live(
    frame: np.ndarray, model: ForceReader | None = None, setup: Setup = KNOWN
) -> Answer:
    reader = EyeReader(model or force_reader(), setup, by="network")
    return answer_of(reader, frame)


def answer_of(
    reader: EyeReader, frame: np.ndarray, scale: PixelScale = SCALE
) -> Answer:
    moment = OpenedMoment((MomentFrame(frame),), scale)
    (answer,), _ = reader.read(moment, reader.start())
    return answer


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    return image(wall_section(tip_of(0.015)))


def test_a_live_answer_is_the_network_s_and_the_whole_one_without_the_fit(
    frame: np.ndarray,
) -> None:
    agreeing = replace(FIVE_MN, force_n=0.015, interval_n=(0.012, 0.018))
    alone = force_reader(agreeing)
    beside_the_fit = force_reader(agreeing, default="network")
    whole = beside_the_fit.read(frame, SCALE, KNOWN)
    answer = live(frame, alone)
    assert whole.warnings == ()
    assert (answer.force_n, answer.interval_n, answer.contact_m) == (
        0.015,
        (0.012, 0.018),
        FIVE_MN.contact_m,
    )
    assert answer == replace(
        whole, can_calibrate=False, readings=(), fit=None, places=NOWHERE
    )
    np.testing.assert_array_equal(
        answer.segmentation.outer_row, whole.segmentation.outer_row
    )
    np.testing.assert_array_equal(
        answer.segmentation.inner_row, whole.segmentation.inner_row
    )
    cut, known = alone.network.shown[-1]
    expected, _ = beside_the_fit.network.shown[-1]
    np.testing.assert_array_equal(cut, expected)
    assert known == KNOWN


def test_the_loop_withdraws_wherever_a_frame_cannot_be_judged(
    frame: np.ndarray,
) -> None:
    blank = np.full((512, 512), 700, dtype=np.uint16)
    deep = image(wall_section(4.2e-3, surface_m=0.4e-3))
    broken = (
        {"force_n": nan},
        {"probabilities": (nan,) * 3},
        {"interval_n": (0.004, np.inf)},
    )
    cases = [
        (live(blank), "empty"),
        (
            live(
                frame, setup=replace(KNOWN, eye=replace(KNOWN.eye, thickness_m=1.1e-3))
            ),
            "the model was trained on",
        ),
        (
            live(frame, force_reader(replace(FIVE_MN, contact_m=-1.4e-3))),
            "contact -1.4 mm from the frame's middle",
        ),
        (live(deep, force_reader(WIDE)), "leaves the window"),
        *(
            (live(frame, force_reader(replace(FIVE_MN, **fault))), "not a number")
            for fault in broken
        ),
    ]

    for answer, words in cases:
        assert (
            answer.usable,
            answer.predicted,
            answer.probabilities,
            answer.force_n,
        ) == (False, 2, None, None)
        assert words in answer.reason

    assert np.isnan(cases[0][0].segmentation.outer_row).all()
    assert live(deep, force_reader(FIVE_MN)).usable  # its interval is narrow
    assert live(frame, force_reader(WIDE)).usable


def test_a_refractive_index_makes_the_wall_thinner(frame: np.ndarray) -> None:
    thick = force_reader()
    thin = force_reader()
    index = replace(KNOWN, scan=Scan(refractive_index=1.4))
    for model, setup in ((thick, KNOWN), (thin, index)):
        reader = EyeReader(model, setup, by="network")
        scale = reader.scale_of(SCALE.lateral_m, SCALE.depth_m)
        answer_of(reader, frame, scale)

    pixels = [np.count_nonzero(model.network.shown[-1][0]) for model in (thick, thin)]
    assert pixels[1] / pixels[0] == pytest.approx(1 / 1.4, rel=0.03)


@pytest.fixture(scope="module")
def classifier(write_model, tmp_path_factory: pytest.TempPathFactory):
    path = tmp_path_factory.mktemp("live") / "model"
    write_model(path, replace(Study(), slice=SliceStudy()))
    return load_classifier(path, finder=None)  # the loop does not check the wall


def test_a_classifier_answers_as_it_does_elsewhere(
    frame: np.ndarray, classifier
) -> None:
    reader = EyeReader(classifier, Setup(), by="network")
    answer = answer_of(reader, frame)
    assert answer == replace(classifier.read(frame, SCALE), can_calibrate=False)
    assert (answer.usable, answer.force_n) == (True, None)
    answer = answer_of(reader, image(wall_section(4.2e-3, surface_m=0.4e-3)))
    assert (answer.usable, answer.predicted, answer.probabilities) == (False, 2, None)
    assert "leaves the window" in answer.reason


SHAPE = (STUDY.oct.rows, STUDY.oct.columns)
RADIUS_M = STUDY.eye.radius_m


def test_network_and_fit_read_a_warming_frame() -> None:
    model = force_reader()
    other = PixelScale(lateral_m=20e-6, depth_m=8e-6, refractive_index=1.38)

    for known in (
        KNOWN,
        NOTHING_KNOWN,
        replace(KNOWN, eye=replace(KNOWN.eye, thickness_m=0.4e-3)),
    ):
        for shape, scale in (
            (SHAPE, SCALE),
            (SHAPE, replace(SCALE, refractive_index=1.38)),
            ((640, 800), other),
        ):
            answer = model.read(
                warming_frame(shape, scale, RADIUS_M, known.eye.thickness_m),
                scale,
                known,
            )
            assert answer.fit is not None, answer.reason
            assert [method for method, _ in answer.readings] == ["network", "fit"]


def test_the_stiffness_is_a_known_open_walls_and_grows_with_its_modulus() -> None:
    reader = load_force_reader(SHIPPED_READER)
    modulus = Modulus(mean_pa=0.3e6, sd_pa=0.0, source="own")
    known = Setup(
        eye=Eye(modulus=modulus, thickness_m=600e-6, iop_pa=266.0, globe=OPEN)
    )
    soft, hard = (
        reader.steepest_n_m(
            replace(
                known,
                eye=replace(
                    known.eye,
                    modulus=replace(modulus, mean_pa=pa),
                    iop_pa=266.0 * pa / 0.3e6,
                ),
            )
        )
        for pa in (0.2e6, 0.4e6)
    )
    assert soft is not None
    assert hard == pytest.approx(2.0 * soft)
    assert 10.0 < soft < 25.0
    unsure = replace(modulus, mean_pa=0.3e6, sd_pa=0.05e6)
    live = EyeReader(
        reader, replace(known, eye=replace(known.eye, modulus=unsure)), by="network"
    )
    sure = replace(known.eye, modulus=replace(unsure, sd_pa=0.01e6))
    adopted = live.with_eye(sure)
    assert reader.steepest_n_m(adopted.setup) == pytest.approx(
        reader.steepest_n_m(
            replace(
                known, eye=replace(known.eye, modulus=replace(modulus, mean_pa=0.32e6))
            )
        )
    )
    # the reader does not read it
    unread = replace(known.eye, modulus=replace(modulus, mean_pa=99e6))
    assert live.with_eye(unread) is live
    assert (
        reader.steepest_n_m(replace(known, eye=replace(known.eye, globe=SEALED)))
        is None
    )
    assert (
        reader.steepest_n_m(replace(known, eye=replace(known.eye, thickness_m=None)))
        is None
    )
