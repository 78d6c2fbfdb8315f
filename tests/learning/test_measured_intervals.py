"""Which readings of which virtual eyes a training measures its intervals on, and what their calibration is told."""

from typing import Any

import numpy as np
import pytest
from analytic_library import analytic_library

from scleraforce.known import Known
from scleraforce.learning import intervals, virtual_eyes
from scleraforce.learning.virtual_eyes import VirtualEye, calibrated, draw_eye, draw_frames
from scleraforce.library import Library
from scleraforce.models import SHIPPED_READER
from scleraforce.reader.intervals import Score
from scleraforce.study import Range, ReaderStudy, Study

EVEN = Study(reader=ReaderStudy(uneven_share=0.0, thickness_m=Range(min=500e-6, max=700e-6)))
CALIBRATED, OTHERS, OTHERWISE = Known(gap_m=0.3e-3), Known(gap_m=0.4e-3), Known(gap_m=0.5e-3)


@pytest.fixture(scope="module")
def library() -> Library:
    return analytic_library(thicknesses=5, ratios=5, tips=24)


@pytest.fixture(scope="module")
def eye(library: Library) -> VirtualEye:
    return draw_eye(EVEN, library, 0, np.random.default_rng(5))


def test_every_second_eye_of_a_telling_is_calibrated_otherwise_as_well(
    eye: VirtualEye, library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    traits = {CALIBRATED: ("own E", "taut"), OTHERS: ("other E", "taut"), OTHERWISE: ("own E", "taut", "sparse")}
    monkeypatch.setattr(intervals, "draw_eye", lambda *_: eye)
    monkeypatch.setattr(intervals, "draw_frames", lambda *_: ())
    monkeypatch.setattr(intervals, "calibrated", lambda *_: (CALIBRATED, ()))
    monkeypatch.setattr(intervals, "of_population", lambda *_: OTHERS)
    monkeypatch.setattr(intervals, "calibrated_otherwise", lambda *_: (OTHERWISE, ()))
    monkeypatch.setattr(intervals, "_scores", lambda *given: [Score("fit", traits[given[5]], given[4], 1.0)])
    scores_of = intervals.measuring(Study(), library, (SHIPPED_READER / "model.onnx").read_bytes())
    found = {number: [(score.traits, score.eye) for score in scores_of(number)] for number in range(12)}
    for number, of_eye in found.items():
        of_all = [(found_in, str(number)) for found_in in traits.values()]
        assert of_eye == (of_all if number in (0, 1, 2, 6, 7, 8) else of_all[:2])


def test_a_calibration_is_told_how_unsure_the_zero_of_the_log_is_and_when_its_frames_were_taken(
    eye: VirtualEye, library: Library, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[Any] = []

    def begin(*given: Any, zero_covariance: Any) -> Any:
        told.append(zero_covariance)
        return virtual_begin(*given, zero_covariance=zero_covariance)

    def step(session: Any, boundaries: Any, force_n: float, since_start_s: float) -> Any:
        told.append(since_start_s)
        return virtual_step(session, boundaries, force_n, since_start_s)

    virtual_begin, virtual_step = virtual_eyes.begin, virtual_eyes.step
    monkeypatch.setattr(virtual_eyes, "begin", begin)
    monkeypatch.setattr(virtual_eyes, "step", step)
    labels: list[Any] = []

    def label(*given: Any) -> Any:
        labels.append(virtual_label(*given))
        return labels[0]

    virtual_label = virtual_eyes.label_forces
    monkeypatch.setattr(virtual_eyes, "label_forces", label)
    calibrated(eye, draw_frames(eye, EVEN, 5, np.random.default_rng(6)), EVEN, library, np.random.default_rng(7))
    covariance, *times_s = told
    np.testing.assert_array_equal(covariance, labels[0].zero_covariance)
    assert len(times_s) >= 3
    assert set(times_s) <= set(labels[0].since_start_s.tolist())
    assert len(set(times_s)) == len(times_s)
