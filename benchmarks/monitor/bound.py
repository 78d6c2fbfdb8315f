"""Predicted times until the bound, and how often they were right: ramps of virtual
eyes, read by the live reader.

Open and sealed eyes (`monitor.eyes`) are bent in 3-D and calibrated on three frames.
Their raw frames, 100 a second, go through segmentation, slice and network; 50 and 25 a
second are every second and fourth of them. After ten readings in contact each has the
probability that the upper end of the interval reaches the bound within 200 ms, by the
line of `reading.force_trend`. It did if the median of five upper ends in a row reached
it within that time. The ramps continue, or, with the same frames, stop at a random
frame and hold, which no line can know.
"""

from collections.abc import Iterator
from itertools import pairwise
from math import erf, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from markdown_tables import markdown
from monitor.declarations import declarations
from monitor.eyes import draw_eye, largest_force_n
from monitor.needle_forces import FRAME_S, ramp_forces, trajectory
from monitor.pictures import stream
from scleraforce.base.arrays import Floats
from scleraforce.base.units import to_si
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.reading.force_trend import (
    HORIZON_S,
    LEAST_SHARE,
    NOISE_WINDOWS,
    ForceRise,
    rise_of,
    time_to_bound,
)
from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.scan import PixelScale
from scleraforce.records.verdict import upper_end

LIMITS = MonitorLimits()
WITHIN_S = 0.2
SMOOTH = 5
LARGEST_N = 40e-3
EVERY = {100: 1, 50: 2, 25: 4}  # frames a second: of the frames rendered
BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0)
GOING = "ramps that continue"
STOPPING = "ramps that stop"


class Said(NamedTuple):
    """A frame's prediction: chance of the bound within 200 ms, whether so it came, and
    whether the interval held it.
    """

    rate_hz: int
    chance: float
    came: bool
    inside: bool


def bound(
    model: Path,
    *,
    eyes: int = 6,
    rates_mn_s: tuple[float, ...] = (5.0, 10.0, 20.0, 50.0, 100.0),
    seed: int = 43,
    plot: Path | None = None,
) -> None:
    """Predicted times until the bound, and how often they were right.

    Args:
        model: of kind "reader".
        eyes: open and sealed in turns.
        rates_mn_s: of the ramps.
        seed: of the eyes.
        plot: picture of the observed against the predicted shares.
    """
    reader = load_force_reader(model)
    said: dict[str, list[Said]] = {GOING: [], STOPPING: []}
    for number in range(eyes):
        for rate_mn_s, readings_tn in _ramps(reader, number, rates_mn_s, seed):
            rng = np.random.default_rng((seed, number, int(rate_mn_s)))
            for rate_hz, every in EVERY.items():
                ramp_tn = readings_tn[::every]
                said[GOING] += _predictions(ramp_tn, rate_hz)
                said[STOPPING] += _predictions(_held(ramp_tn, rng), rate_hz)

    figure = Figure(figsize=(4.6, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    for (name, frames), mark in zip(said.items(), ("o-", "s--"), strict=True):
        bins = list(_reliability(frames))
        rows = [
            [f"{low:.0%} to {high:.0%}", count, f"{predicted:.0%}", f"{came:.0%}"]
            for low, high, predicted, came, count in bins
        ]
        head = [f"{name}: chance of the bound within 200 ms", "frames"]
        print(markdown([*head, "predicted", "it came"], rows))
        print(f"intervals that held: {_held_shares(frames)}\n")
        axes.plot(*np.array([each[2:4] for each in bins]).T, mark, label=name)

    axes.set(
        xlabel="predicted: bound within 200 ms",
        ylabel="share of frames for which it came",
    )
    axes.legend(frameon=False)
    if plot is not None:
        figure.savefig(plot, dpi=150)


def _ramps(
    reader: ForceReader, number: int, rates_mn_s: tuple[float, ...], seed: int
) -> Iterator[tuple[float, Floats]]:
    """Yield the rate of each ramp of an eye with its usable readings (frame, 3): time,
    force, upper end.
    """
    rng = np.random.default_rng((seed, number))
    scale = PixelScale.of(reader.study.oct)
    drawn = draw_eye(("open", "sealed")[number % 2], number, reader.study, seed)
    known = declarations(drawn, reader, seed, rng)["declared"]
    largest_n = min(LARGEST_N, largest_force_n(drawn))

    for rate_mn_s in rates_mn_s:
        forces = ramp_forces(to_si(rate_mn_s, "mn_per_s"), largest_n, rng)
        path = trajectory(*forces, reader.study, rng)
        rows = []
        over = 0
        for index, frame in enumerate(stream(drawn, path, rng, seed)):
            verdict = reader.read_live(frame, scale, known).verdict
            upper_n = upper_end(verdict)
            if verdict.usable and verdict.force_n is not None and upper_n is not None:
                rows.append((index * FRAME_S, verdict.force_n, upper_n))
                over += upper_n >= LIMITS.bound_n + 1e-3

            if over > SMOOTH:
                break

        yield rate_mn_s, np.array(rows).reshape(-1, 3)


def _held(readings_tn: Floats, rng: np.random.Generator) -> Floats:
    """Return the readings of a ramp that stops at a random frame: from there on the
    ones around it, for a second.
    """
    last = int(rng.integers(len(readings_tn) // 3, len(readings_tn)))
    around = rng.integers(max(last - SMOOTH, 0), last + 1, int(1.0 / FRAME_S))
    step_s = np.median(np.diff(readings_tn[:, 0]))
    after_tn = readings_tn[around]
    after_tn[:, 0] = readings_tn[last, 0] + step_s * np.arange(1, len(after_tn) + 1)

    return np.concatenate([readings_tn[: last + 1], after_tn])


def _predictions(readings_tn: Floats, rate_hz: int) -> Iterator[Said]:
    """Yield the prediction of each frame before the bound, as the monitor makes it,
    beside what came.
    """
    if len(readings_tn) < SMOOTH:
        return

    windows = np.lib.stride_tricks.sliding_window_view(readings_tn[:, 2], SMOOTH)
    reached = np.flatnonzero(np.median(windows, axis=1) >= LIMITS.bound_n)
    at_s = float(readings_tn[reached[0] + SMOOTH // 2, 0]) if len(reached) else np.inf
    history = [(float(time_s), float(force_n)) for time_s, force_n, _ in readings_tn]

    for index, (now_s, force_n, upper_n) in enumerate(readings_tn, start=1):
        begin = max(index - NOISE_WINDOWS * LIMITS.rate_frames, 0)
        rise = rise_of(history[begin:index], LIMITS.rate_frames)
        over = now_s >= at_s or upper_n >= LIMITS.bound_n
        if rise is None or over or rise.points[0][1] < LIMITS.contact_n:
            continue

        left_s = at_s - now_s
        found = time_to_bound(rise, force_n, upper_n, LIMITS.bound_n)
        late_s = found.late_s if found else None
        inside = (found.early_s if found else HORIZON_S) <= left_s
        inside &= late_s is None or left_s <= late_s
        chance = _chance(rise, force_n / upper_n)
        yield Said(rate_hz, chance, left_s <= WITHIN_S, inside)


def _chance(rise: ForceRise, share: float) -> float:
    """Return the probability that the line, a share of its upper end, comes to the
    bound within 200 ms.
    """
    offset, slope = rise.variances
    bound_n = LIMITS.bound_n * max(share, LEAST_SHARE)
    over_n = rise.now_n + rise.slope * WITHIN_S - bound_n
    variance = offset + slope * (WITHIN_S - rise.middle_s) ** 2

    return 0.5 * (1.0 + erf(over_n / max(sqrt(2.0 * variance), 1e-12)))


def _held_shares(said: list[Said]) -> str:
    """Return how many 90 % intervals held, of chances between 1 % and 99 %."""
    inside = {
        rate_hz: [
            each.inside
            for each in said
            if each.rate_hz == rate_hz and 0.01 < each.chance < 0.99
        ]
        for rate_hz in EVERY
    }
    return ", ".join(
        f"{hz} Hz {np.mean(held):.0%}" for hz, held in inside.items() if held
    )


def _reliability(said: list[Said]) -> Iterator[tuple[float, float, float, float, int]]:
    """Yield the ends of each bin of chances, the mean chance, the share that came, and
    the number of frames.
    """
    chances = np.array([each.chance for each in said])
    came = np.array([each.came for each in said])

    for low, high in pairwise(BINS):
        inside = (chances >= low) & ((chances < high) | (high == 1.0))
        if inside.any():
            predicted = float(chances[inside].mean())
            yield low, high, predicted, float(came[inside].mean()), int(inside.sum())
