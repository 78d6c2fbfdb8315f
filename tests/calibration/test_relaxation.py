"""Relaxation of an eye, from the holds of its force log, and the elastic forces of its
frames.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from relaxing_eyes import FORCES_N, TISSUE, found_in, pushed, shown_by
from scipy.optimize import nnls

from scleraforce.calibration.holds_of_a_log import TIMES_S, not_negative
from scleraforce.lab.needle_pushes import NeedlePath
from scleraforce.mechanics.tissue_material import PronySeries
from scleraforce.records.tissue_relaxation import Relaxation

SEEDS = range(2)


@pytest.mark.parametrize(
    "tissue",
    [TISSUE, PronySeries((0.12, 0.15), (3.0, 20.0))],
    ids=["usual", "other times"],
)
@pytest.mark.parametrize("seed", SEEDS)
def test_the_holds_of_a_log_show_the_shares_and_the_elastic_forces(
    seed: int, tissue: PronySeries
):
    _, path, frame_s, _, found, elastic_n = found_in(tissue, seed)
    assert found.source == "holds"
    held_s = np.array([1.0, 4.0])
    series = PronySeries(found.shares, found.times_s)
    assert series.left(held_s) == pytest.approx(tissue.left(held_s), abs=0.03)
    heavy = np.array(FORCES_N) > 10e-3
    true_n = path.elastic_n(frame_s)
    assert elastic_n[heavy] == pytest.approx(true_n[heavy], rel=0.08)
    assert np.mean(elastic_n[heavy] / true_n[heavy]) == pytest.approx(1.0, abs=0.03)
    assert (
        true_n[heavy] > 1.1 * np.array(FORCES_N)[heavy]
    ).all()  # without it E would be as much too low


@pytest.mark.parametrize("hold", [None, 4])
@pytest.mark.parametrize("seed", SEEDS)
def test_tissue_whose_force_stays_or_falls_in_one_hold_alone_is_elastic(
    seed: int, hold: int | None
):
    """In that hold of 34 mN, the needle gives way by a tenth."""
    rng = np.random.default_rng(seed)
    pushes, path = pushed(PronySeries((), ()), rng)
    forces_n = np.array(path.forces_n)
    if hold is not None:
        forces_n[4 * hold + 2] *= 0.9

    path = NeedlePath(path.times_s, tuple(forces_n.tolist()))
    held = shown_by(pushes, path, rng)
    found = held.relaxation
    assert (found.source, found.shares) == ("holds", (0.0,) * len(TIMES_S))
    assert held.elastic_n == pytest.approx(path.felt_n(held.frame_s), abs=1e-15)


def test_a_log_without_holds_keeps_the_shares_of_other_tissue_with_their_spread():
    rng = np.random.default_rng(0)
    corners_s = (0.0, 2.5)
    corners_n = (0.0, 0.0)
    for start_s in np.arange(2.5, 30.0, 3.0).tolist():  # up and down at once
        corners_s = (*corners_s, start_s + 1.0, start_s + 2.0, start_s + 3.0)
        corners_n = (*corners_n, 0.03, 0.0, 0.0)

    path = NeedlePath(corners_s, corners_n, TISSUE)
    pushes = [SimpleNamespace(frame_s=3.5), SimpleNamespace(frame_s=6.5)]
    found = shown_by(pushes, path, rng).relaxation
    assert found.source == "population"
    assert 0.1 < sum(found.shares) < 0.6
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx(
        np.array(found.shares) * 0.755, rel=0.01
    )


def test_a_declared_relaxation_is_used_unchanged():
    held = found_in(TISSUE, 2, Relaxation.declared(TISSUE.terms))
    found = held.relaxation
    assert (found.source, found.shares, found.times_s) == (
        "declared",
        TISSUE.shares,
        TISSUE.times_s,
    )
    first_n = held.path.elastic_n(held.frame_s)[0]
    assert held.elastic_n[0] == pytest.approx(first_n, rel=0.01)
    held = found_in(TISSUE, 2, Relaxation.declared(()))
    assert held.elastic_n == pytest.approx(FORCES_N, abs=1e-15)
    held = found_in(TISSUE, 2, Relaxation.declared([(0.2, 1.0)]))
    assert np.shape(held.relaxation.held_covariance) == (1, 1)


def test_histories_are_of_the_frames():
    pushes, _, frame_s, _, found, _ = found_in(TISSUE, 0)
    held_s = np.array(
        [push.frame_s - push.start_s - push.ramp_s / 2 for push in pushes]
    )
    assert found.held_s == pytest.approx(held_s.mean(), abs=0.4)
    assert found.held == pytest.approx(
        1.0 - np.exp(-held_s.mean() / np.array(TIMES_S)), abs=0.05
    )
    assert found.every_s == pytest.approx(np.median(np.diff(frame_s)), rel=0.01)


def test_shares_that_are_not_negative_are_the_ones_of_scipy():
    rng = np.random.default_rng(3)
    inner = 0

    for _ in range(40):
        root = rng.standard_normal((6, 4))
        wanted = rng.standard_normal(6)
        expected = nnls(root, wanted)[0]
        found = not_negative(root.T @ root, root.T @ wanted)
        assert found == pytest.approx(expected, abs=1e-9)
        inner += int((expected == 0.0).any() and (expected > 0.0).any())

    assert inner > 10
