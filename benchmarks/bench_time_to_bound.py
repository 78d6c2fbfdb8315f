"""Predicted times until the bound, and how often they were right: ramps of virtual
eyes, read by the live reader.

    python benchmarks/bench_time_to_bound.py MODEL [--eyes 6]
        [--rates-mn-s 5 10 20 50 100] [--seed 43] [--plot FILE]

Open and sealed eyes (`monitor_sessions`) are bent in 3-D and calibrated on three
frames. Their raw frames, 100 a second, go through segmentation, slice and network; 50
and 25 a second are every second and fourth of them. After ten readings in contact each
has the probability that the upper end of the interval reaches the bound within 200 ms,
by the line of `reading.force_trend`. It did if the median of five upper ends in a row
reached it within that time. The ramps continue, or, with the same frames, stop at a
random frame and hold, which no line can know.
"""

import argparse
from collections.abc import Iterator
from itertools import pairwise
from math import erf, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from monitor_sessions.declarations import declarations
from monitor_sessions.eyes import draw_eye
from monitor_sessions.forces import FRAME_S, ramp_forces, trajectory
from monitor_sessions.frames import largest_force_n, stream
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

Floats = NDArray[np.float64]
LIMITS = MonitorLimits()
WITHIN_S = 0.2
SMOOTH = 5
LARGEST_N = 40e-3
EVERY = {100: 1, 50: 2, 25: 4}  # frames a second: of the frames rendered
BINS = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98, 1.0)


class Said(NamedTuple):
    """A frame's prediction: chance of the bound within 200 ms, whether so it came, and
    whether the interval held it.
    """

    rate_hz: int
    chance: float
    came: bool
    inside: bool


def main() -> None:
    """Play the ramps and print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("model", type=Path)
    parser.add_argument("--eyes", type=int, default=6)
    parser.add_argument(
        "--rates-mn-s", type=float, nargs="+", default=[5.0, 10.0, 20.0, 50.0, 100.0]
    )
    parser.add_argument("--seed", type=int, default=43)
    parser.add_argument("--plot", type=Path)
    given = parser.parse_args()
    reader = load_force_reader(given.model)
    going = list[Said]()
    stopping = list[Said]()

    for number in range(given.eyes):
        for rate_mn_s, readings_tn in ramps(
            reader, number, given.rates_mn_s, given.seed
        ):
            rng = np.random.default_rng((given.seed, number, int(rate_mn_s)))
            for rate_hz, every in EVERY.items():
                going += predictions(readings_tn[::every], rate_hz)
                stopping += predictions(held(readings_tn[::every], rng), rate_hz)

            print(
                f"eye {number}, {rate_mn_s:g} mN/s: {len(readings_tn)} frames",
                flush=True,
            )

    for name, said in (("continue", going), ("stop somewhere", stopping)):
        print(f"\nRamps that {name}:\n{table(said)}")

    if given.plot is not None:
        draw(given.plot, going, stopping)


def ramps(
    reader: ForceReader, number: int, rates_mn_s: list[float], seed: int
) -> Iterator[tuple[float, Floats]]:
    """Yield the rate of each ramp of an eye with its usable readings (frame, 3): time,
    force, upper end.
    """
    rng = np.random.default_rng((seed, number))
    scale = PixelScale.of(reader.study.oct)
    drawn = draw_eye(("open", "sealed")[number % 2], number, reader.study, seed)
    known = declarations(drawn, reader, seed, rng)["declared"]

    for rate_mn_s in rates_mn_s:
        forces = ramp_forces(
            to_si(rate_mn_s, "mn_per_s"), min(LARGEST_N, largest_force_n(drawn)), rng
        )
        rows = []
        over = 0

        for place, frame in enumerate(
            stream(drawn, trajectory(*forces, reader.study, rng), rng, seed)
        ):
            verdict = reader.read_live(frame, scale, known).verdict
            upper_n = upper_end(verdict)
            if verdict.usable and verdict.force_n is not None and upper_n is not None:
                rows.append((place * FRAME_S, verdict.force_n, upper_n))
                over += upper_n >= LIMITS.bound_n + 1e-3

            if over > SMOOTH:
                break

        yield rate_mn_s, np.array(rows).reshape(-1, 3)


def held(readings_tn: Floats, rng: np.random.Generator) -> Floats:
    """Return the readings of a ramp that stops at a random frame: from there on the
    ones around it, for a second.
    """
    last = int(rng.integers(len(readings_tn) // 3, len(readings_tn)))
    around = rng.integers(max(last - SMOOTH, 0), last + 1, int(1.0 / FRAME_S))
    after = readings_tn[around]
    after[:, 0] = readings_tn[last, 0] + np.median(
        np.diff(readings_tn[:, 0])
    ) * np.arange(1, len(after) + 1)

    return np.concatenate([readings_tn[: last + 1], after])


def predictions(readings_tn: Floats, rate_hz: int) -> Iterator[Said]:
    """Yield the prediction of each frame before the bound, as the monitor makes it,
    beside what came.
    """
    if len(readings_tn) < SMOOTH:
        return

    smooth_n = np.median(
        np.lib.stride_tricks.sliding_window_view(readings_tn[:, 2], SMOOTH), axis=1
    )
    reached = np.flatnonzero(smooth_n >= LIMITS.bound_n)
    at_s = float(readings_tn[reached[0] + SMOOTH // 2, 0]) if len(reached) else np.inf
    history = [(float(time_s), float(force_n)) for time_s, force_n, _ in readings_tn]

    for place, (now_s, force_n, upper_n) in enumerate(readings_tn):
        rise = rise_of(
            history[max(place + 1 - NOISE_WINDOWS * LIMITS.rate_frames, 0) : place + 1],
            LIMITS.rate_frames,
        )
        if (
            rise is None
            or now_s >= at_s
            or upper_n >= LIMITS.bound_n
            or rise.points[0][1] < LIMITS.contact_n
        ):
            continue

        found = time_to_bound(rise, force_n, upper_n, LIMITS.bound_n)
        early_s, late_s = (
            (HORIZON_S, None) if found is None else (found.early_s, found.late_s)
        )
        left_s = at_s - now_s
        inside = early_s <= left_s and (late_s is None or left_s <= late_s)
        yield Said(rate_hz, chance(rise, force_n / upper_n), left_s <= WITHIN_S, inside)


def chance(rise: ForceRise, share: float) -> float:
    """Return the probability that the line, a share of its upper end, comes to the
    bound within 200 ms.
    """
    a, b = rise.variances
    over_n = (
        rise.now_n + rise.slope * WITHIN_S - LIMITS.bound_n * max(share, LEAST_SHARE)
    )

    return 0.5 * (
        1.0
        + erf(
            over_n / max(sqrt(2.0 * (a + b * (WITHIN_S - rise.middle_s) ** 2)), 1e-12)
        )
    )


def table(said: list[Said]) -> str:
    """Return predicted beside observed shares, and how many intervals held, as
    Markdown.
    """
    lines = [
        "| chance of the bound within 200 ms | frames | predicted | it came |",
        "|---|---|---|---|",
    ]
    for low, high, predicted, came, count in reliability(said):
        lines.append(
            f"| {low:.0%} to {high:.0%} | {count} | {predicted:.0%} | {came:.0%} |"
        )

    open_ended = [one for one in said if 0.01 < one.chance < 0.99]
    held_by = {
        rate: [one.inside for one in open_ended if one.rate_hz == rate]
        for rate in EVERY
    }
    shares = [
        f"{rate} Hz {np.mean(inside):.0%}" for rate, inside in held_by.items() if inside
    ]

    return "\n".join(
        [
            *lines,
            (
                "90 % intervals that held, of chances between 1 % and 99 %:"
                f" {', '.join(shares)}"
            ),
        ]
    )


def reliability(said: list[Said]) -> Iterator[tuple[float, float, float, float, int]]:
    """Yield the ends of each bin of chances, the mean chance, the share that came, and
    the number of frames.
    """
    chances = np.array([one.chance for one in said])
    came = np.array([one.came for one in said])

    for low, high in pairwise(BINS):
        inside = (chances >= low) & ((chances < high) | (high == 1.0))
        if inside.any():
            yield (
                low,
                high,
                float(chances[inside].mean()),
                float(came[inside].mean()),
                int(inside.sum()),
            )


def draw(path: Path, going: list[Said], stopping: list[Said]) -> None:
    """Draw observed against predicted shares."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1)

    for said, name, mark in (
        (going, "ramps that continue", "o-"),
        (stopping, "ramps that stop", "s--"),
    ):
        rows = list(reliability(said))
        axes.plot([row[2] for row in rows], [row[3] for row in rows], mark, label=name)

    axes.set(
        xlabel="predicted: bound within 200 ms",
        ylabel="share of frames for which it came",
        xlim=(0, 1),
        ylim=(0, 1),
    )
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
