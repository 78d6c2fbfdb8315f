"""What a monitor learns from a declared pressure that is wrong, and that learning never
lowers the upper end of an interval.
"""

from dataclasses import replace
from math import log

import numpy as np
import pytest
from analytic_frames import (
    BOTH,
    KNOWN,
    LATERAL_M,
    MODULUS_PA,
    SCALE,
    STUDY,
    image,
    known_eye,
    middling_eye,
    tip_of,
    wall_section,
)
from small_models import FIVE_MN, force_reader

from predicted_walls import Walls, predict_wall
from scleraforce.calibration.stiffness_from_shape import EyePosterior
from scleraforce.fit import unknowns
from scleraforce.fit.frames_of_an_eye import ShownFrame
from scleraforce.library import Library, load_library
from scleraforce.live.companions.eye_learning import IOP_SD, EyeFitting
from scleraforce.live.decision.decide import decide
from scleraforce.live.decision.events import Cause, FrameRead, State
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.decision.state import MonitorState
from scleraforce.reading.answer import Answer, Reading, not_below, unusable_answer
from scleraforce.reading.eye_reader import EyeReader, MomentFrame, OpenedMoment
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.eye import Modulus
from scleraforce.records.model_folder import LIBRARY_FILE, SHIPPED_READER
from scleraforce.records.setup import Setup

TRUE_PA = 0.4e6
TRUE_IOP_PA = 533.0  # 4 mmHg
DECLARED_IOP_PA = 267.0
POPULATION = Modulus(mean_pa=0.35e6, sd_pa=0.087e6, source="population")
BEFORE = replace(
    KNOWN,
    eye=replace(
        KNOWN.eye,
        modulus=Modulus(
            mean_pa=MODULUS_PA, sd_pa=0.1 * MODULUS_PA, source="population"
        ),
    ),
)


def learned(share: float) -> Setup:
    """Return the eye as learned, with a share of the E before."""
    mean_pa = share * MODULUS_PA
    modulus = Modulus(mean_pa=mean_pa, sd_pa=0.05 * mean_pa, source="shape")
    return replace(
        BEFORE, eye=replace(BEFORE.eye, modulus=modulus, unlearned=BEFORE.eye)
    )


class ProportionalNetwork:
    """Reads F/E = 0.033 N / 0.3 MPa from every wall, as its known E says."""

    def read(self, cuts: np.ndarray, setup: Setup) -> Reading:  # noqa: ARG002
        assert setup.eye.modulus is not None
        force_n = 0.033 * setup.eye.modulus.mean_pa / MODULUS_PA
        high = force_n > 0.030
        return replace(
            FIVE_MN,
            probabilities=(0.0, 0.3, 0.7) if high else (0.0, 0.9, 0.1),
            force_n=force_n,
            interval_n=(0.9 * force_n, 1.1 * force_n),
        )


def proportional_reader() -> ForceReader:
    reader = force_reader()
    reader.network = ProportionalNetwork()  # type: ignore[assignment]
    return reader


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    return image(wall_section(tip_of(0.020)))


@pytest.mark.parametrize("share", [0.5, 0.8, 1.3])
def test_no_learned_e_lowers_the_upper_end_of_the_second_opinion(frame, share):
    reader = force_reader()
    eye = learned(share)
    before = reader.read(frame, SCALE, BEFORE)
    alone = reader.read(
        frame, SCALE, replace(eye, eye=replace(eye.eye, unlearned=None))
    )
    answer = reader.read(frame, SCALE, eye)
    assert before.interval_n
    assert alone.interval_n
    assert answer.interval_n == (
        alone.interval_n[0],
        max(alone.interval_n[1], before.interval_n[1]),
    )
    assert (alone.interval_n[1] < before.interval_n[1]) == (share < 1.0)
    assert answer.force_n == alone.force_n


@pytest.mark.parametrize("knows_before", [False, True])
def test_the_monitor_still_withdraws_where_the_unlearned_reading_would(
    frame, knows_before
):
    """Without the eye before, 33 mN pass as 16.5."""
    eye = learned(0.5).eye
    known = eye if knows_before else replace(eye, unlearned=None)
    reader = EyeReader(proportional_reader(), replace(KNOWN, eye=known), by="network")
    moment = OpenedMoment((MomentFrame(frame),), SCALE, 1.0)
    (answer,), _ = reader.read(moment, reader.start(monitored=True))
    read = FrameRead(
        at_s=1.0,
        frame_id=1,
        verdict=answer.verdict,
        shown_back=0,
        size=(frame.shape[0], frame.shape[1]),
        scale_m=(SCALE.lateral_m, SCALE.depth_m),
    )
    _, decision = decide(MonitorState(), read, MonitorLimits())
    assert decision.cause is (Cause.DANGEROUS_CLASS if knows_before else None)
    assert decision.state is (State.WITHDRAW if knows_before else State.WATCHING)


def test_of_two_answers_the_more_careful_parts_are_kept():
    low = Answer(
        predicted=1,
        probabilities=(0.0, 0.9, 0.1),
        usable=True,
        reason=None,
        force_n=0.017,
        interval_n=(0.010, 0.029),
    )
    high = replace(
        low,
        predicted=2,
        probabilities=(0.0, 0.3, 0.7),
        force_n=0.033,
        interval_n=(0.025, 0.041),
    )
    dark = unusable_answer(3, "empty")
    both = not_below(low, high)
    assert (both.predicted, both.probabilities) == (2, (0.0, 0.3, 0.7))
    assert (both.force_n, both.interval_n) == (0.017, (0.010, 0.041))
    assert not_below(high, low) == high
    assert not_below(low, dark) == not_below(dark, low) == dark


@pytest.fixture(scope="module")
def library() -> Library:
    return load_library(SHIPPED_READER / LIBRARY_FILE).for_contact(0.6)


def test_e_learned_from_half_the_pressure_is_as_unsure_as_the_pressure(
    library,
):
    rng = np.random.default_rng(5)
    walls = Walls(library)
    frames = []

    for tip_m in 1e-3 * np.linspace(0.4, 2.6, 6):
        unknown = middling_eye(tip_m)
        unknown[[unknowns.MODULUS, unknowns.IOP]] = log(TRUE_PA), log(TRUE_IOP_PA)
        placed = predict_wall(walls, unknown, BOTH)
        noise_m = 2e-6 * rng.standard_normal((2, len(LATERAL_M)))
        depth_bc = placed.depth_m.reshape(2, -1) + noise_m
        frames.append(ShownFrame(lateral_m=LATERAL_M, depth_bc=depth_bc))

    known = replace(
        known_eye(middling_eye(0.0)),
        eye=replace(
            known_eye(middling_eye(0.0)).eye, iop_pa=DECLARED_IOP_PA, modulus=POPULATION
        ),
    )
    begun = EyePosterior(setup=known, study=STUDY, library=library)
    sure = begun.with_frames(frames).modulus
    found = EyeFitting(begun, "eye", None).take(frames)
    assert found is not None
    assert found.frames == len(frames)
    modulus = found.setup.eye.modulus
    assert modulus is not None
    # a pressure taken for sure is a wrong E, surely
    assert sure.mean_pa + 2.0 * sure.sd_pa < TRUE_PA
    assert modulus.mean_pa + 2.0 * modulus.sd_pa > TRUE_PA
    assert modulus.relative_sd > 0.8 * (IOP_SD**-2 + POPULATION.relative_sd**-2) ** -0.5
