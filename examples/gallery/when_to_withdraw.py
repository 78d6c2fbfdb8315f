"""A ramp of force, and the withdrawal.

The force rises by 12 mN/s and stops at 27 mN, below the bound of 30 mN. The upper end
of the interval counts, and its rise: the monitor withdraws before the force reaches the
bound, by the robot's reaction time.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scleraforce.front.report.figure_files import (
    AMBER,
    BLACK,
    BLUE,
    GREY,
    RED,
    inches,
    styled,
    write_figure,
)
from scleraforce.live.decision.decide import Decision, decide
from scleraforce.live.decision.events import FrameRead, State
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.decision.state import MonitorState
from scleraforce.records.verdict import Verdict

RATE_HZ = 100.0
SECONDS = 3.5
# of the reading; its interval is so large a share of the force, and 0.5 mN
NOISE_N = 0.1e-3
HALF_INTERVAL = 0.12
SHADES = {State.NOT_READY: GREY, State.WATCHING: BLUE, State.WITHDRAW: RED}


def ramp() -> tuple[np.ndarray, np.ndarray]:
    """Return times and forces of the frames: no contact for half a second, then 12 mN/s
    up to 27 mN.
    """
    time_s = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    return time_s, np.clip(0.012 * (time_s - 0.5), 0.0, 0.027)


def decisions(
    time_s: np.ndarray, read_n: np.ndarray, half_n: np.ndarray
) -> list[Decision]:
    """Return the monitor's decision at each frame."""
    state = MonitorState()
    made = []

    for number, (at_s, force_n, half) in enumerate(
        zip(time_s, read_n, half_n, strict=True), start=1
    ):
        label = int(np.searchsorted([0.005, 0.030], force_n))
        frame = FrameRead(
            at_s=float(at_s),
            frame_id=number,
            shown_back=0,
            size=(512, 512),
            scale_m=(29e-6, 8e-6),
            verdict=Verdict(
                predicted=label,
                probabilities=tuple(float(label == other) for other in range(3)),
                usable=True,
                reason=None,
                force_n=float(force_n),
                interval_n=(float(force_n - half), float(force_n + half)),
            ),
        )
        state, decision = decide(state, frame, MonitorLimits())
        made.append(decision)

    return made


@styled
def draw() -> Figure:
    """Draw the read force with its interval; the ground has the colour of the state."""
    time_s, force_n = ramp()
    read_n = np.abs(
        force_n + np.random.default_rng(0).normal(0.0, NOISE_N, len(force_n))
    )
    half_n = 0.5e-3 + HALF_INTERVAL * read_n
    made = decisions(time_s, read_n, half_n)
    figure = Figure(figsize=inches(150, 75))
    axes = figure.subplots()
    axes.fill_between(
        time_s,
        (read_n - half_n) * 1e3,
        (read_n + half_n) * 1e3,
        color=AMBER,
        alpha=0.4,
        linewidth=0,
    )
    axes.plot(time_s, read_n * 1e3, color=BLACK, linewidth=0.8)
    axes.axhline(30.0, color=GREY, linewidth=0.6, linestyle=(0, (4, 3)))

    for state, shade in SHADES.items():
        inside = np.array([decision.state is state for decision in made])
        axes.fill_between(
            time_s,
            0.0,
            36.0,
            where=inside,
            color=shade,
            alpha=0.12,
            linewidth=0,
            label=state.name,
        )

    first = next(
        n for n, decision in enumerate(made) if decision.state is State.WITHDRAW
    )
    cause = made[first].cause
    axes.annotate(
        cause.name if cause else "",
        (time_s[first], read_n[first] * 1e3),
        (time_s[first] - 0.9, 33.0),
        arrowprops={"arrowstyle": "->", "linewidth": 0.6},
    )
    axes.set_ylim(0.0, 36.0)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("read force, 90 % interval [mN]")
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, 0.85))

    return figure


if __name__ == "__main__":
    write_figure(
        draw(), Path(sys.argv[1] if len(sys.argv) > 1 else "when_to_withdraw.png")
    )
