"""Who yields in the holds of a force log: what the log shows, and what frames
decide.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from relaxing_eyes import BOUNDS_N, TISSUE, HeldPushes, read_as, shown_by

from scleraforce.calibration.holds_of_a_log import (
    TIMES_S,
    doubted_by_dents,
    held_frames,
    who_yields,
)
from scleraforce.lab.needle_pushes import NeedlePath, Push, path_of_pushes, plan_pushes
from scleraforce.mechanics.tissue_material import ELASTIC, PronySeries
from scleraforce.reading.answer import Answer
from scleraforce.reading.tissue_memory import TissueMemory
from scleraforce.records.eye import Eye
from scleraforce.records.setup import Setup
from scleraforce.records.study import PhantomStudy, Range
from scleraforce.records.tissue_relaxation import Relaxation

FALL = PronySeries((0.12,), (1.2,))
REMEMBERS = PronySeries((0.27, 0.33), (0.4, 4.3))
FORCES_N = tuple((45e-3 * np.array([0.4, 1.0, 0.3, 0.7, 0.9, 0.5, 0.8, 0.6])).tolist())
SEEDS = range(2)
STEP_S = 0.05


PHANTOM = PhantomStudy(
    hold_s=Range(min=7.6, max=8.4), frame_delay_s=Range(min=4.0, max=4.8)
)


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


@cache
def held(tissue: PronySeries | None, seed: int) -> HeldPushes:
    """What holds of 8 s show, on tissue that relaxes, or if the needle yields."""
    rng = np.random.default_rng(seed)
    pushes = plan_pushes(FORCES_N, PHANTOM, rng)
    path = path_of_pushes(pushes, tissue) if tissue else yielding(pushes)
    return shown_by(pushes, path, rng)


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


def decided(holds: HeldPushes, sd: float) -> Relaxation:
    """What two frames of each hold decide, whose dents have the elastic forces of the
    path.
    """
    frame_s = ends(holds.pushes)
    frames = held_frames(holds.log, holds.relaxation, frame_s)
    count = len(frames.frames)
    assert count >= 8
    true_n = holds.path.elastic_n(frame_s)[[frame.index for frame in frames.frames]]
    noise = np.random.default_rng(7).normal(0.0, sd, count)
    read = np.log(true_n) + noise
    return who_yields(holds.relaxation, frames, read, np.full(count, sd))


@pytest.mark.parametrize("seed", SEEDS)
def test_a_needle_that_yields_leaves_both_explanations_and_its_forces_as_they_are(seed):
    _, path, frame_s, _, found, elastic_n = held(None, seed)
    assert found.finding.cause == "undecided"
    assert set(found.finding.not_estimated_s) >= {30.0, 100.0}
    assert found.finding.fall == pytest.approx(0.09, abs=0.03)
    assert elastic_n == pytest.approx(path.felt_n(frame_s), abs=1e-12)
    assert not any(found.shares)
    long = np.array(TIMES_S) >= 30.0
    assert (np.array(found.other)[long] <= 0.06).all()
    lost = 1.0 - PronySeries(found.other, TIMES_S).left(np.array(4.0))
    assert lost == pytest.approx(0.12, abs=0.08)
    assert (np.diag(found.covariance)[long] > 0.02**2).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_tissue_that_remembers_its_pushes_counts_first(seed: int):
    _, path, frame_s, _, found, elastic_n = held(REMEMBERS, seed)
    assert found.finding.chance == pytest.approx(1.0)
    assert sum(found.shares) == pytest.approx(0.6, abs=0.1)
    assert found.other == (0.0,) * len(TIMES_S)
    ratio = elastic_n / path.elastic_n(frame_s)
    assert ratio == pytest.approx(1.0, abs=0.15)
    assert ratio.mean() == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("seed", SEEDS)
def test_dents_that_follow_the_force_show_that_the_needle_yields(seed: int):
    after = decided(held(None, seed), 0.005)
    assert after.finding.cause == "needle"
    assert after.finding.tissue_share < 0.5
    assert not after.matters
    assert not np.any(after.covariance)


def test_dents_that_are_read_too_roughly_or_once_in_a_hold_decide_nothing():
    holds = held(None, 0)
    after = decided(holds, 0.3)
    assert after.finding.cause == "undecided"
    assert any(after.other)
    found = holds.relaxation
    alone = held_frames(holds.log, found, holds.frame_s)
    assert alone.frames == ()
    assert who_yields(found, alone, np.empty(0), np.empty(0)) is found


@pytest.mark.parametrize("seed", SEEDS)
def test_dents_that_stay_show_that_the_tissue_relaxes(seed: int):
    after = decided(held(TISSUE, seed), 0.005)
    assert after.finding.cause == "tissue"
    assert after.other == ()
    held_s = np.array([1.0, 4.0])
    left = PronySeries(after.shares, TIMES_S).left(held_s)
    assert left == pytest.approx(TISSUE.left(held_s), abs=0.04)


@pytest.mark.parametrize("seed", SEEDS)
def test_dents_that_follow_by_half_show_that_both_yield(seed: int):
    pushes, _, _, log, found, _ = held(None, seed)
    frames = held_frames(log, found, ends(pushes))
    read = 0.5 * np.array([frame.log_force for frame in frames.frames])
    after = who_yields(found, frames, read, np.full(len(read), 1e-3))
    assert after.finding.cause == "both"
    seen = [time not in found.finding.not_estimated_s for time in TIMES_S]
    expected = np.where(seen, 0.5 * np.array(found.other), 0.0)
    assert after.shares == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("seed", SEEDS)
def test_dents_of_different_pushes_contradict_a_log_that_seems_sure(seed: int):
    rng = np.random.default_rng(seed)
    _, path, frame_s, log, found, _ = held(REMEMBERS, seed)
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
    assert after.finding.chance == 0.5
    assert not any(after.shares)
    shown = np.array(found.shares) > 0.0
    assert np.array(after.other)[shown] == pytest.approx(np.array(found.shares)[shown])
    # dents of a needle that yields: they follow the force
    assert read_of(path.felt_n(frame_s)) is doubted


@pytest.mark.parametrize("first", ["tissue", "needle"])
def test_the_interval_reaches_to_the_reading_of_the_other_explanation(first):
    """A sudden push: relaxing tissue bears more than in the holds of the calibration,
    an elastic wall the same.
    """
    lost = 0.2
    shares, other = ((0.0,), (lost,)) if first == "needle" else ((lost,), (0.0,))
    known = replace(
        Relaxation.of(shares, (1.0,), np.zeros((1, 1)), "holds"),
        held=(1.0,),
        held_covariance=((0.0,),),
        before_n=(0.0,),
        before_covariance_n2=((0.0,),),
        other=other,
    )
    # the elastic force of a dent that a calibration on 20 mN saw, by either
    calibrated_n = 20e-3
    elastic_n = calibrated_n / (1.0 - sum(shares))

    def read(relaxation: Relaxation, held_s: float) -> Answer:
        memory = TissueMemory.unknown(Setup(eye=Eye(relaxation=relaxation)), 60e-3)
        return memory.read(read_as(elastic_n), BOUNDS_N, held_s=held_s)[0]

    sudden_n = {"needle": calibrated_n, "tissue": calibrated_n / (1.0 - lost)}
    sudden = read(known, 1e-6)
    assert sudden.force_n == pytest.approx(sudden_n[first], rel=0.02)
    low_n, high_n = sudden.interval_n
    assert low_n - 1e-5 <= min(sudden_n.values())
    assert max(sudden_n.values()) <= high_n + 1e-5
    # as in the calibration, both are the same
    slow = read(known, 100.0)
    assert slow.force_n == pytest.approx(calibrated_n, rel=1e-3)
    certain = read(replace(known, other=()), 100.0)
    assert slow.interval_n == pytest.approx(certain.interval_n, rel=1e-6)
