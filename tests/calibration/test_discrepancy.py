"""Frames of known force, read again: E of an eye whose filter was off, and forces that are surer than E."""

from dataclasses import replace
from math import exp, log

import numpy as np
import pytest
from analytic_frames import BOTH, LATERAL_M, LIBRARY, noisy_boundaries

from scleraforce.calibration import known_forces
from scleraforce.calibration.known_forces import read_again, settled
from scleraforce.known import OPEN, Known, Modulus
from scleraforce.library.fit import fit_boundaries
from scleraforce.library.prediction import Walls, force_n, predict_wall
from scleraforce.library.prior import SHINE_MEAN_M, prior_of
from scleraforce.library.unknowns import DEPTH, GAP, IOP, LATERAL, MODULUS, NAMES, SHINE, THICKNESS, TIP
from scleraforce.segmentation.observations import Boundaries
from scleraforce.study import Study

STUDY = replace(Study(), calibration=replace(Study().calibration, surface_smoothing_m=0.0))
TIPS_M = (0.5e-3, 1.1e-3, 1.7e-3)
MODULUS_PA = 0.3e6


def known_of(modulus_pa: float, relative_sd: float = 0.05) -> Known:
    modulus = Modulus(mean_pa=modulus_pa, sd_pa=relative_sd * modulus_pa, source="own")
    return Known(modulus=modulus, iop_pa=270.0, thickness_m=0.65e-3, gap_m=0.6e-3, polar_rad=0.0, globe=OPEN)


def frames(factor: float = 1.0) -> list[tuple[Boundaries, float]]:
    """Boundaries of an eye at three dents, and their forces, which are those of the library times a factor."""
    rng, walls, found = np.random.default_rng(4), Walls(LIBRARY), []
    for tip_m in TIPS_M:
        unknown = np.zeros(len(NAMES))
        unknown[[TIP, LATERAL, DEPTH]] = tip_m, 0.3e-3, 0.5e-3
        unknown[[GAP, THICKNESS, MODULUS, IOP, SHINE]] = 0.6e-3, 0.65e-3, log(MODULUS_PA), log(270.0), SHINE_MEAN_M
        depth = noisy_boundaries(predict_wall(walls, unknown, BOTH), 3e-6, rng)
        known_n = factor * float(force_n(walls, unknown[None])[0])
        found.append((Boundaries(LATERAL_M, depth, float(np.diff(LATERAL_M)[0])), known_n))
    return found


def test_slopes_are_those_of_forces_that_are_read_with_another_modulus() -> None:
    known = known_of(MODULUS_PA)
    other = known_of(1.05 * MODULUS_PA)
    for here, there in zip(*(read_again(frames(), each, LIBRARY, STUDY) for each in (known, other)), strict=True):
        assert here is not None
        assert there is not None
        assert log(there.library_n / here.library_n) == pytest.approx(here.by_modulus * log(1.05), abs=0.005)
        assert here.by_rigidity == 0.0


@pytest.mark.parametrize("wrong", [0.6, 1.5])
def test_a_modulus_that_the_filter_missed_is_found(wrong: float) -> None:
    after = settled(known_of(wrong * MODULUS_PA), frames(), (), LIBRARY, STUDY)
    now, again = after.known, after.again
    assert now.modulus is not None
    assert now.discrepancy is not None
    assert now.modulus.mean_pa == pytest.approx(MODULUS_PA, rel=0.05)
    for frame in again:
        assert frame is not None
        corrected_n = now.discrepancy.corrected_n(np.array([frame.library_n]))[0]
        assert corrected_n == pytest.approx(frame.force_n, rel=0.03)


def test_forces_are_surer_than_the_modulus_that_they_tell() -> None:
    """An eye whose forces all lie 4 % off is read right, and its intervals are those of a frame, not of E."""
    seen = frames(1.04)
    now = settled(known_of(MODULUS_PA), seen, (), LIBRARY, STUDY).known
    assert now.modulus is not None
    assert now.modulus.relative_sd > 0.015
    assert now.discrepancy is not None
    apart = replace(now.discrepancy, level_by=(0.0, 0.0), growth_by=(0.0, 0.0))
    for boundaries, known_n in seen[1:]:
        widths = []
        for each in (now, replace(now, discrepancy=apart)):
            fit = fit_boundaries(LIBRARY, boundaries.lateral_m, boundaries.depth_m, prior_of(each, STUDY.reader))
            assert fit is not None
            assert fit.force_n == pytest.approx(known_n, rel=0.03)
            widths.append(float(np.diff(np.log(fit.interval_n))[0]))
        assert widths[0] < 0.9 * widths[1]


def test_forces_that_no_level_and_growth_explain_scatter() -> None:
    """One force of three is 8 % off, and comes out as far off again; even walls scatter no more than expected."""
    even, scattered = frames(), frames()
    boundaries, known_n = scattered[1]
    scattered[1] = boundaries, 1.08 * known_n
    found = [settled(known_of(MODULUS_PA), seen, (), LIBRARY, STUDY).known.scatter for seen in (even, scattered)]
    assert found[0] == 1.0
    assert found[1] > 1.8


def test_level_and_growth_are_those_of_a_modulus_that_may_go_no_farther(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where E may not go where the frames want it, the forces are told right all the same, by the discrepancy."""
    monkeypatch.setattr(known_forces, "READINGS", 1)
    after = settled(known_of(0.7 * MODULUS_PA), frames(), (), LIBRARY, STUDY)
    now, again = after.known, after.again
    assert now.modulus is not None
    assert now.discrepancy is not None
    assert now.modulus.mean_pa == pytest.approx(0.7 * MODULUS_PA)
    for frame, within in zip(
        again, (0.1, 0.08, 0.08), strict=True
    ):  # how much the surface shines is open in a small dent
        assert frame is not None
        corrected_n = now.discrepancy.corrected_n(np.array([frame.library_n]))[0]
        assert corrected_n == pytest.approx(frame.force_n, rel=within)


def test_what_was_read_before_counts_as_what_is_read_now() -> None:
    seen = frames(1.1)
    known = known_of(MODULUS_PA)
    earlier = [frame for frame in read_again(seen[:2], known, LIBRARY, STUDY) if frame is not None]
    at_once = settled(known, seen, (), LIBRARY, STUDY).known
    parts = settled(known, seen[2:], earlier, LIBRARY, STUDY).known
    assert at_once.modulus is not None
    assert parts.modulus is not None
    assert parts.modulus.mean_pa == pytest.approx(at_once.modulus.mean_pa, rel=0.01)


def test_the_largest_force_of_the_frames_that_were_read_is_kept() -> None:
    seen, known = frames(), known_of(MODULUS_PA)
    blind = Boundaries(LATERAL_M, np.full((2, len(LATERAL_M)), np.nan), 1e-4)
    largest_n = seen[-1][1]
    earlier = [frame for frame in read_again(seen, known, LIBRARY, STUDY) if frame is not None]
    for now, before in (([*seen, (blind, 2.0 * largest_n)], []), (seen[:1], earlier)):
        found = settled(known, now, before, LIBRARY, STUDY).known.discrepancy
        assert found is not None
        assert found.largest_n == largest_n


def test_without_a_frame_that_can_be_read_the_filter_s_stays() -> None:
    known = known_of(MODULUS_PA)
    blind = Boundaries(LATERAL_M, np.full((2, len(LATERAL_M)), np.nan), 1e-4)
    after = settled(known, [(blind, 0.02)], (), LIBRARY, STUDY)
    now = after.known
    assert after.again == (None,)
    assert now.modulus is not None
    assert now.modulus.mean_pa == pytest.approx(MODULUS_PA, rel=exp(1e-9) - 1.0)
    assert now.discrepancy is not None
    assert (now.discrepancy.level, now.discrepancy.growth, now.discrepancy.largest_n) == (0.0, 0.0, None)


def test_what_the_search_of_a_stiffening_compares_is_what_the_frames_that_were_read_lose() -> None:
    """Rougher boundaries lose more, and forces that E cannot explain; a frame that cannot be read counts as refused."""
    known = known_of(MODULUS_PA)
    blind = Boundaries(LATERAL_M, np.full((2, len(LATERAL_M)), np.nan), 1e-4)
    after = settled(known, [*frames(), (blind, 0.02)], (), LIBRARY, STUDY)
    trial = after.trial("an eye", 2)
    read = [frame for frame in after.again if frame is not None]
    assert (trial.found, trial.refused, trial.frames) == ("an eye", 3, 3)
    assert trial.of_boundaries == pytest.approx(sum(frame.loss for frame in read))
    assert min(frame.loss for frame in read) > 0.0
    assert trial.of_forces == after.loss
    assert trial.loss == pytest.approx(trial.of_boundaries + trial.of_forces)
    rng = np.random.default_rng(1)
    rough = [
        (replace(seen, depth_m=seen.depth_m + 20e-6 * np.sin(LATERAL_M / 0.4e-3 + rng.uniform(0.0, 6.0))), force_n)
        for seen, force_n in frames()
    ]
    assert settled(known, rough, (), LIBRARY, STUDY).trial("", 0).of_boundaries > 3.0 * trial.of_boundaries
    bent = [(seen, force_n * factor) for (seen, force_n), factor in zip(frames(), (0.8, 1.0, 1.25), strict=True)]
    assert settled(known, bent, (), LIBRARY, STUDY).loss > after.loss + 5.0
