"""Who yields in the holds of a force log: what the log shows, and what frames
decide.
"""

from dataclasses import replace

import numpy as np
import pytest
from relaxing_eyes import BOUNDS_N, TISSUE, logged, read_as

from scleraforce.calibration.holds_of_a_log import (
    TIMES_S,
    HeldFrame,
    HeldFrames,
    HoldLog,
    doubted_by_dents,
    held_frames,
    who_yields,
)
from scleraforce.calibration.relaxation_from_holds import hold_log, with_elastic_forces
from scleraforce.lab.needle_pushes import NeedlePath, Push, path_of_pushes, plan_pushes
from scleraforce.mechanics.tissue_material import ELASTIC, PronySeries
from scleraforce.reading.tissue_memory import TissueMemory
from scleraforce.recordings.force_errors import ZERO_PRIOR, FrameForces
from scleraforce.records.eye import Eye
from scleraforce.records.setup import Setup
from scleraforce.records.study import PhantomStudy, Range
from scleraforce.records.tissue_relaxation import Relaxation

FALL = PronySeries((0.12,), (1.2,))
FORCES_N = tuple((45e-3 * np.array([0.4, 1.0, 0.3, 0.7, 0.9, 0.5, 0.8, 0.6])).tolist())
SEEDS = range(3)
STEP_S = 0.05


def pushed(
    hold_s: float, rng: np.random.Generator, tissue: PronySeries = ELASTIC
) -> tuple[tuple[Push, ...], NeedlePath]:
    """Pushes with holds of a length, and the path of their needle."""
    phantom = PhantomStudy(
        hold_s=Range(min=0.95 * hold_s, max=1.05 * hold_s),
        frame_delay_s=Range(min=0.5 * hold_s, max=0.6 * hold_s),
    )
    pushes = plan_pushes(FORCES_N, phantom, rng)
    return pushes, path_of_pushes(pushes, tissue)


def yielding(pushes: tuple[Push, ...]) -> NeedlePath:
    """The path of a needle that yields on an elastic wall, anew in each push."""
    times_s = np.arange(0.0, pushes[-1].corners_s[-1] + STEP_S, STEP_S)
    force_n = np.zeros_like(times_s)
    for push in pushes:
        own = FALL.felt_along(push.corners_s, (0.0, 1.0, 1.0, 0.0), times_s)
        force_n += np.where(times_s < push.corners_s[-1], push.force_n * own, 0.0)

    return NeedlePath(
        tuple(times_s.tolist()), tuple(np.maximum(force_n, 0.0).tolist()), ELASTIC
    )


def found_in(
    path: NeedlePath, frame_s: np.ndarray, rng: np.random.Generator
) -> tuple[HoldLog, Relaxation, np.ndarray]:
    """The log of a path, what it shows, and the elastic forces of frames."""
    recording = logged(path, rng)
    forces = FrameForces(path.felt_n(frame_s), frame_s, np.zeros(2), ZERO_PRIOR)
    elastic, relaxation, _ = with_elastic_forces(recording, forces, None)
    return hold_log(recording, forces), relaxation, elastic.force_n


def middles(pushes: tuple[Push, ...]) -> np.ndarray:
    return np.array([push.frame_s for push in pushes])


def ends(pushes: tuple[Push, ...]) -> np.ndarray:
    """Times of two frames in each hold, near its begin and near its end."""
    corners_s = [push.corners_s for push in pushes]
    return np.array(
        [
            stops_s + share * (leaves_s - stops_s)
            for _, stops_s, leaves_s, _ in corners_s
            for share in (0.1, 0.9)
        ]
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_a_needle_that_yields_leaves_both_explanations_and_its_forces_as_they_are(seed):
    rng = np.random.default_rng(seed)
    pushes, _ = pushed(8.0, rng)
    path = yielding(pushes)
    _, found, elastic_n = found_in(path, middles(pushes), rng)
    assert found.finding is not None
    assert found.finding.cause == "undecided"
    assert set(found.finding.not_estimated_s) >= {30.0, 100.0}
    assert found.finding.fall == pytest.approx(0.09, abs=0.03)
    assert elastic_n == pytest.approx(path.felt_n(middles(pushes)), abs=1e-12)
    assert not any(found.shares)
    long = np.array(TIMES_S) >= 30.0
    assert (np.array(found.other)[long] <= 0.06).all()
    lost = 1.0 - PronySeries(found.other, TIMES_S).left(np.array(4.0))
    assert lost == pytest.approx(0.12, abs=0.08)
    assert (np.diag(found.covariance)[long] > 0.02**2).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_tissue_that_remembers_its_pushes_counts_first(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tissue = PronySeries((0.27, 0.33), (0.4, 4.3))
    pushes, path = pushed(8.0, rng, tissue)
    _, found, elastic_n = found_in(path, middles(pushes), rng)
    assert found.finding is not None
    assert found.finding.chance == pytest.approx(1.0)
    assert sum(found.shares) == pytest.approx(0.6, abs=0.1)
    assert found.other == (0.0,) * len(TIMES_S)
    ratio = elastic_n / path.elastic_n(middles(pushes))
    assert ratio == pytest.approx(1.0, abs=0.15)
    assert ratio.mean() == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize(
    ("hold_s", "longest_s"), [(2.0, 3.0), (8.0, 10.0), (20.0, 100.0)]
)
@pytest.mark.parametrize("seed", SEEDS)
def test_time_constants_far_beyond_the_holds_are_not_estimated(
    seed: int, hold_s: float, longest_s: float
) -> None:
    rng = np.random.default_rng(seed)
    pushes, _ = pushed(hold_s, rng)
    _, found, _ = found_in(yielding(pushes), middles(pushes), rng)
    assert found.finding is not None
    shown = [time for time in TIMES_S if time not in found.finding.not_estimated_s]
    assert max(shown) <= longest_s
    assert max(shown) >= hold_s / 4


def decided(
    path: NeedlePath,
    pushes: tuple[Push, ...],
    shown: NeedlePath,
    rng: np.random.Generator,
    sd: float,
) -> Relaxation:
    """What two frames of each hold decide, whose dents have the elastic forces of
    `shown`.
    """
    frame_s = ends(pushes)
    log, found, _ = found_in(path, frame_s, rng)
    held = held_frames(log, found, frame_s)
    count = len(held.frames)
    assert count >= 8
    true_n = shown.elastic_n(frame_s)[[frame.index for frame in held.frames]]
    read = np.log(true_n) + rng.normal(0.0, sd, count)
    return who_yields(found, held, read, np.full(count, sd))


@pytest.mark.parametrize("seed", SEEDS)
def test_dents_that_follow_the_force_show_that_the_needle_yields(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pushes, _ = pushed(8.0, rng)
    path = yielding(pushes)
    after = decided(path, pushes, path, rng, 0.005)
    assert after.finding is not None
    assert after.finding.cause == "needle"
    assert after.finding.tissue_share < 0.5
    assert not after.matters
    assert not np.any(after.covariance)


@pytest.mark.parametrize("seed", SEEDS)
def test_dents_that_stay_show_that_the_tissue_relaxes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pushes, path = pushed(8.0, rng, TISSUE)
    after = decided(path, pushes, path, rng, 0.005)
    assert after.finding is not None
    assert after.finding.cause == "tissue"
    assert after.other == ()
    held_s = np.array([1.0, 4.0])
    left = PronySeries(after.shares, TIMES_S).left(held_s)
    assert left == pytest.approx(TISSUE.left(held_s), abs=0.04)


@pytest.mark.parametrize("seed", SEEDS)
def test_dents_that_follow_by_half_show_that_both_yield(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pushes, _ = pushed(8.0, rng)
    path = yielding(pushes)
    log, found, _ = found_in(path, ends(pushes), rng)
    held = held_frames(log, found, ends(pushes))
    read = 0.5 * np.array([frame.log_force for frame in held.frames])
    after = who_yields(found, held, read, np.full(len(read), 1e-3))
    assert after.finding is not None
    assert after.finding.cause == "both"
    seen = [time not in found.finding.not_estimated_s for time in TIMES_S]
    expected = np.where(seen, 0.5 * np.array(found.other), 0.0)
    assert after.shares == pytest.approx(expected, rel=0.01)


def test_dents_that_are_read_too_roughly_decide_nothing() -> None:
    rng = np.random.default_rng(4)
    pushes, _ = pushed(8.0, rng)
    path = yielding(pushes)
    after = decided(path, pushes, path, rng, 0.3)
    assert after.finding is not None
    assert after.finding.cause == "undecided"
    assert after.finding.frames >= 8
    assert any(after.other)


@pytest.mark.parametrize("seed", SEEDS)
def test_dents_of_different_pushes_contradict_a_log_that_seems_sure(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tissue = PronySeries((0.27, 0.33), (0.4, 4.3))
    pushes, path = pushed(8.0, rng, tissue)
    frame_s = middles(pushes)
    log, found, _ = found_in(path, frame_s, rng)
    assert found.finding is not None
    doubted = replace(
        found,
        shares=found.other,
        other=found.shares,
        finding=replace(found.finding, chance=0.05),
    )

    def read_of(true_n: np.ndarray) -> Relaxation:
        read = np.log(0.8 * true_n) + rng.normal(0.0, 0.02, len(true_n))
        return doubted_by_dents(doubted, log, frame_s, read, np.full(len(read), 0.02))

    after = read_of(path.elastic_n(frame_s))
    assert after.finding is not None
    assert after.finding.chance == 0.5
    assert not any(after.shares)
    shown = np.array(found.shares) > 0.0
    assert np.array(after.other)[shown] == pytest.approx(np.array(found.shares)[shown])
    nothing = np.empty(0)
    assert doubted_by_dents(doubted, log, nothing, nothing, nothing) is doubted
    # dents of a needle that yields: they follow the force
    assert read_of(path.felt_n(frame_s)) is doubted


def test_one_frame_in_a_hold_decides_nothing() -> None:
    rng = np.random.default_rng(5)
    pushes, _ = pushed(8.0, rng)
    log, found, _ = found_in(yielding(pushes), middles(pushes), rng)
    assert held_frames(log, found, middles(pushes)).frames == ()
    alone = HeldFrames((HeldFrame(0, 0, -4.0), HeldFrame(1, 1, -3.5)), 0.1)
    assert who_yields(found, alone, np.zeros(2), np.full(2, 0.01)) is found


@pytest.mark.parametrize("first", ["tissue", "needle"])
def test_the_interval_reaches_to_the_reading_of_the_other_explanation(first) -> None:
    """A sudden push: relaxing tissue bears more than in the holds of the calibration,
    an elastic wall the same.
    """
    lost = 0.2
    tissue = (lost,)
    nothing = np.zeros((1, 1))
    shares, other = ((0.0,), tissue) if first == "needle" else (tissue, (0.0,))
    known = replace(
        Relaxation.of(shares, (1.0,), nothing, "holds"),
        held=(1.0,),
        held_covariance=((0.0,),),
        before_n=(0.0,),
        before_covariance_n2=((0.0,),),
        other=other,
    )
    # the elastic force of a dent that a calibration on 20 mN saw, by either
    calibrated_n = 20e-3
    elastic_n = calibrated_n / (1.0 - sum(shares))
    sudden_n = {"needle": calibrated_n, "tissue": calibrated_n / (1.0 - lost)}
    history = TissueMemory.unknown(Setup(eye=Eye(relaxation=known)), 60e-3)
    answer, _ = history.read(read_as(elastic_n), BOUNDS_N, held_s=1e-6)
    assert answer.force_n == pytest.approx(sudden_n[first], rel=0.02)
    low_n, high_n = answer.interval_n
    assert all(
        low_n - 1e-5 <= force_n <= high_n + 1e-5 for force_n in sudden_n.values()
    )
    # as in the calibration, both are the same
    answer, _ = history.read(read_as(elastic_n), BOUNDS_N, held_s=100.0)
    assert answer.force_n == pytest.approx(calibrated_n, rel=1e-3)
    certain = TissueMemory.unknown(
        Setup(eye=Eye(relaxation=replace(known, other=()))), 60e-3
    )
    alone, _ = certain.read(read_as(elastic_n), BOUNDS_N, held_s=100.0)
    assert answer.interval_n == pytest.approx(alone.interval_n, rel=1e-6)
