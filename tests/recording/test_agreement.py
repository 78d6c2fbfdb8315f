"""A log that does not go with its frames is doubted, one that does is not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from logged_info import LOGGED_INFO

from scleraforce.recording.folder import ForceInfo, Recording
from scleraforce.recording.labels import axis_doubt, log_doubts
from scleraforce.recording.tables import FORCE_COLUMNS, ForceLog, FrameEntry
from scleraforce.study import ClassesStudy

CLASSES = ClassesStudy()
PUSHES_N = np.array([0.031, 0.008, 0.045, 0.002, 0.022, 0.051, 0.015, 0.038, 0.004, 0.027])
FRAMES_S = 8.0 + 10.0 * np.arange(len(PUSHES_N))


def recording(rng: np.random.Generator, later_s: float = 0.0, pushes_n: np.ndarray = PUSHES_N) -> Recording:
    """Pushes of 4 s, a frame in the middle of each; its time is stated as `later_s` later than it is."""
    time_s = np.arange(0.0, 115.0, 0.005)
    force_n = sum(f * np.clip(2.5 - np.abs(time_s - t), 0.0, 1.0) for f, t in zip(pushes_n, FRAMES_S, strict=True))
    wrench = rng.normal(0.0, 4e-3, (len(time_s), 6))
    wrench[:, 2] -= force_n
    wrench[:, 0] += 0.02 * force_n
    frames = tuple(FrameEntry(f"{k}.png", t + later_s) for k, t in enumerate(FRAMES_S))
    return Recording(Path("rec"), LOGGED_INFO, frames, ForceLog(time_s, wrench, FORCE_COLUMNS[1:]))


def seen(rng: np.random.Generator, pushes_n: np.ndarray = PUSHES_N) -> list[float]:
    """What frames show: a dent in another unit, not in proportion, some of it noise, one of them nothing."""
    shown = 30.0 * pushes_n**0.8 * rng.normal(1.0, 0.1, len(pushes_n))
    shown[3] = np.nan
    return shown.tolist()


@pytest.mark.parametrize("seed", [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 10))])
def test_a_log_that_goes_with_its_frames_is_not_doubted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert log_doubts(recording(rng), CLASSES, seen(rng)) == ()
    alike_n = np.full(len(PUSHES_N), 0.02)
    assert log_doubts(recording(rng, 0.0, alike_n), CLASSES, seen(rng, alike_n)) == ()
    assert log_doubts(recording(rng, 5.0), CLASSES, [1.0, 2.0, 3.0, *[None] * 7]) == ()  # too few to tell


@pytest.mark.parametrize(("later_s", "words"), [(6.0, "earlier"), (-6.0, "later"), (10.0, "earlier")])
def test_shifted_times_are_said_with_their_direction(later_s: float, words: str) -> None:
    rng = np.random.default_rng(1)
    (doubt,) = log_doubts(recording(rng, later_s), CLASSES, seen(rng))
    assert "the frames' times are off" in doubt
    assert f" s {words} than frames.csv says" in doubt


def test_dents_that_differ_by_less_than_a_nanometre_say_nothing_of_the_clocks() -> None:
    """The same frames as above, of a wall that hardly moved: what is left of their shape is rounding."""
    rng = np.random.default_rng(1)
    doubted = recording(rng, 6.0)
    shown = np.array(seen(rng))
    assert log_doubts(doubted, CLASSES, (1e-3 * shown).tolist())
    assert not any("times are off" in doubt for doubt in log_doubts(doubted, CLASSES, (1e-12 * shown).tolist()))


def test_frames_of_another_session_are_doubted() -> None:
    rng = np.random.default_rng(2)
    (doubt,) = log_doubts(recording(rng), CLASSES, [1.0, 9.0, 4.0, 6.0, 2.0, 3.0, 9.0, 5.0, 8.0, 2.0])
    assert "forces.csv has nothing to do with what the frames show" in doubt


def test_an_axis_across_the_needle_is_named_with_the_one_along_it() -> None:
    good = recording(np.random.default_rng(3))
    wrong = replace(good, info=replace(LOGGED_INFO, force=ForceInfo("fx", -1)))
    assert axis_doubt(good, CLASSES) is None
    doubt = axis_doubt(wrong, CLASSES)
    assert doubt is not None
    assert "mN along fz under the frames, but " in doubt
    assert "mN along fx: check [force] axis" in doubt
    assert log_doubts(wrong, CLASSES, [None] * len(PUSHES_N)) == (doubt,)


def test_forces_of_another_size_than_those_that_were_read_are_doubted() -> None:
    rng = np.random.default_rng(4)
    log = recording(rng, 0.0, PUSHES_N / 9.81)  # kilogram-force
    (doubt,) = log_doubts(log, CLASSES, PUSHES_N.tolist(), in_newtons=True)
    assert doubt.startswith("forces.csv has 0.1 times the force that the frames show")
    assert log_doubts(recording(rng), CLASSES, (1.5 * PUSHES_N).tolist(), in_newtons=True) == ()


def test_samples_that_are_no_forces_raise_no_doubt() -> None:
    rng = np.random.default_rng(7)
    holed = recording(rng)
    holed.forces.wrench_sc[rng.random(len(holed.forces.time_s)) < 0.1] = np.nan
    assert log_doubts(holed, CLASSES, seen(rng)) == ()
    assert log_doubts(holed, CLASSES, PUSHES_N.tolist(), in_newtons=True) == ()


def test_a_recording_without_a_log_gives_no_doubt() -> None:
    assert log_doubts(replace(recording(np.random.default_rng(5)), forces=None), CLASSES, []) == ()
