"""How much an eye's tissue stiffens: the b whose walls explain its frames of known force best.

Tissue that stiffens bears more at the same dent and dents in another form, the more so the farther it is strained. A
calibration is therefore made once with the walls of each stiffening that the library holds, and then with those of a
few between the best ones (`search`). What a stiffening leaves unexplained is the loss of the frames' boundaries, read
without their forces, and of the forces that are read there beside those that are known.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, log, log1p
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from scleraforce.library import Library
from scleraforce.library.plan import LITTLE_STIFFENING, stiffening_place

Found = TypeVar("Found")

DIVERGED = 1_000_000  # frames that a calibration refuses if it explains none
REFINEMENTS = 3  # stiffenings between the library's that are tried
ENOUGH = 12.0  # so much more loss than that of a stiffening that explains the frames: those beyond are not tried
# What the boundaries of a frame of an even wall lose. Walls that are none of the library's lose more, whatever their
# tissue, and say less of it: their loss counts as many times less.
EVEN_LOSS = 5.0
EXPLAINED = 2.0  # times as much: the walls are the frames'
# Scale of Cauchy's prior of ln(1 + b): tissue counts as none that stiffens unless its frames say so.
SCALE, CAUCHY = 0.5, 2.0
WIDE = 0.6  # of ln(1 + 5 b): an interval at an end in which one more is tried
NEAR = 0.03  # of the same: what lies so near was tried


@dataclass(frozen=True, kw_only=True)
class TissueTrial(Generic[Found]):
    """A calibration with walls of one stiffening.

    `refused` is the number of frames that it could not take up, `of_boundaries` and `of_forces` what the others lose,
    `frames` how many they are.
    """

    found: Found
    refused: int
    frames: int
    of_boundaries: float
    of_forces: float

    @property
    def loss(self) -> float:
        """What it leaves unexplained."""
        return self.of_boundaries + self.of_forces

    @classmethod
    def diverged(cls, found: Found, refused: int) -> "TissueTrial[Found]":
        """Return a trial that explains none of its frames, and so counts for less than all that explain some."""
        return cls(found=found, refused=DIVERGED + refused, frames=0, of_boundaries=0.0, of_forces=0.0)


def most_trials(library: Library) -> int:
    """Return how many stiffenings are tried at most."""
    held = len(library.stiffenings)
    return held + REFINEMENTS if held > 1 else 1


def search(library: Library, calibrate: Callable[[Library], TissueTrial[Found] | None]) -> tuple[float, Found] | None:
    """Return the stiffening that explains an eye's frames best, and what was found with it; None where none does.

    It begins with those that the library holds walls of, from the lowest, until one explains the frames and the next
    much worse; and goes on beside the best one. A stiffening with which frames are refused that others take up is out
    of the question.

    Args:
        library: for any contact.
        calibrate: with the library of one stiffening; None where there is no such eye.
    """
    tried = dict[float, TissueTrial[Found]]()

    def attempt(stiffening: float) -> None:
        found = calibrate(library.for_stiffening(stiffening))
        if found is not None:
            tried[stiffening] = found

    for stiffening in library.stiffenings.tolist():
        attempt(stiffening)
        if stiffening in tried and _is_enough(tried):
            break
    if not tried:
        return None
    for _ in range(REFINEMENTS):
        between = _between(tried)
        if between is None:
            break
        attempt(between)
    best, trial = list(tried.items())[int(_losses(tried).argmin())]
    return best, trial.found


def _is_enough(tried: Mapping[float, TissueTrial[Found]]) -> bool:
    """Return whether an earlier stiffening explains the frames, and the last one much worse."""
    losses = _losses(tried)
    best = list(tried.values())[int(losses.argmin())]
    explained = best.of_boundaries <= EXPLAINED * EVEN_LOSS * best.frames
    return explained and losses.min() + ENOUGH < float(losses[-1]) < inf


def _losses(tried: Mapping[float, TissueTrial[Found]]) -> NDArray[np.float64]:
    """Return what each trial loses, and its stiffening by the prior; infinite where it refuses more frames."""
    fewest = min(trial.refused for trial in tried.values())
    able = [trial for trial in tried.values() if trial.refused == fewest]
    least = min(able, key=lambda trial: trial.loss)
    scale = max(1.0, least.of_boundaries / (EVEN_LOSS * max(least.frames, 1)))
    return np.array(
        [
            trial.loss / scale + CAUCHY**2 * log(1.0 + (log1p(b) / (SCALE * CAUCHY)) ** 2)
            if trial.refused == fewest
            else inf
            for b, trial in tried.items()
        ]
    )


def _between(tried: Mapping[float, TissueTrial[Found]]) -> float | None:
    """Return the stiffening to try next, beside the best one; None: no other is likely to be better.

    It is where a parabola through the best one and its neighbours is lowest; halfway to the other neighbour beside one
    that is out of the question, below a largest one that is best, and where there is only one other.
    """
    order = np.argsort(list(tried))
    places, losses = stiffening_place(np.array(list(tried)))[order], _losses(tried)[order]
    best, last = int(losses.argmin()), len(places) - 1
    lowest, bounded = float(places[best]), 0 < best < last
    if last >= 2:
        first = min(max(best - 1, 0), last - 2)
        near = slice(first, first + 3)
        if np.isfinite(losses[near]).all():
            bent, straight, _ = np.polyfit(places[near], losses[near], 2).tolist()
            if bent > 0.0:
                lowest = float(np.clip(-0.5 * straight / bent, places[0], places[-1]))
        elif bounded:
            beside = best - 1 if np.isfinite(losses[best - 1]) else best + 1
            lowest = 0.5 * float(places[best] + places[beside]) if np.isfinite(losses[beside]) else lowest
    unsure = last > 0 and (best == last or last == 1) and lowest == places[best]
    beside = best - 1 if best == last else best + 1
    if unsure and np.isfinite(losses[beside]) and abs(places[best] - places[beside]) > WIDE:
        lowest = 0.5 * float(places[best] + places[beside])
    if np.abs(places - lowest).min() < NEAR:
        return None
    return float(np.clip(LITTLE_STIFFENING * np.expm1(lowest), min(tried), max(tried)))
