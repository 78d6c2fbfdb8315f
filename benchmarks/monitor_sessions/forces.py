"""The course of a session: forces of the needle, motion of the eye, changes of the
light.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from scleraforce.records.study import Study

Floats = NDArray[np.float64]

FRAME_S = 0.01
PATH_N = 45e-3


@dataclass(frozen=True)
class Trajectory:
    """True forces, N, and what the eye and the light do, (frame,)."""

    force_n: Floats
    lateral_m: Floats
    depth_m: Floats
    snr_db: Floats
    name: list[str]


def moving_forces(
    count: int, highest_n: float, rng: np.random.Generator
) -> tuple[Floats, list[str]]:
    """Return true forces below the highest and what the robot does, (frame,): an
    approach to its upper half first.
    """
    approach = np.linspace(
        0.0, rng.uniform(0.5, 1.0) * highest_n, int(rng.uniform(0.5, 1.5) / FRAME_S)
    )
    force_n = [0.0] * 100 + list(approach)
    name = ["before contact"] * 100 + ["approach"] * len(approach)

    while len(force_n) < count:
        part, words = _segment(force_n[-1], highest_n, rng)
        force_n += part
        name += [words] * len(part)

    tremor = 0.2e-3 * np.sin(
        2.0 * pi * (rng.uniform(0.8, 1.5) * FRAME_S * np.arange(count) + rng.random())
    )
    forces = np.array(force_n[:count])
    touching = np.clip(forces / 1e-3, 0.0, 1.0)

    return np.clip(forces + touching * tremor, 0.0, highest_n), name[:count]


def ramp_forces(
    rate_n_s: float, largest_n: float, rng: np.random.Generator
) -> tuple[Floats, list[str]]:
    """Return true forces that rise at a rate to the largest, after a while without
    contact.
    """
    before = np.zeros(int(rng.uniform(0.5, 1.0) / FRAME_S))
    rising = (
        np.arange(0.0, largest_n, rate_n_s * FRAME_S)
        + rng.random() * rate_n_s * FRAME_S
    )
    forces = np.minimum(np.concatenate([before, rising]), largest_n)

    return forces, ["ramp"] * len(forces)


def _segment(
    now_n: float, highest_n: float, rng: np.random.Generator
) -> tuple[list[float], str]:
    """Return the forces of the robot's next action."""
    frames = int(rng.uniform(1.0, 4.0) / FRAME_S)
    share = np.arange(1, frames + 1) / frames

    kind = rng.choice(
        ["hold", "swing", "ramp", "step", "lift off"], p=[0.2, 0.25, 0.3, 0.2, 0.05]
    )
    if kind == "hold":
        return [now_n] * frames, "hold"

    if kind == "swing":
        reach = rng.uniform(0.2, 1.0) * min(now_n, highest_n - now_n)
        wave = np.sin(2.0 * pi * share * rng.integers(1, 4))
        return list(now_n + reach * wave), "swing"

    if kind == "ramp":
        goal_n = rng.uniform(0.0, highest_n)
        return list(now_n + (goal_n - now_n) * share), "ramp"

    if kind == "step":
        goal_n = float(
            np.clip(
                now_n + rng.choice([-1, 1]) * rng.uniform(0.5e-3, 3e-3), 0.0, highest_n
            )
        )
        rise = np.minimum(np.arange(1, frames + 1) / rng.integers(3, 8), 1.0)

        return list(now_n + (goal_n - now_n) * rise), "step"

    down = np.linspace(1.0, 0.0, int(rng.uniform(0.1, 0.4) / FRAME_S))
    away = np.zeros(int(rng.uniform(0.3, 2.0) / FRAME_S))
    back = np.linspace(
        0.0, rng.uniform(2e-3, 10e-3), int(rng.uniform(0.5, 1.5) / FRAME_S)
    )

    return [*(now_n * down), *away, *back], "lift off"


def trajectory(
    force_n: Floats, name: list[str], study: Study, rng: np.random.Generator
) -> Trajectory:
    """Add what the eye and the light do: drift, breathing and pulse within the study's
    shifts, and a jitter of 5 um.
    """
    time_s = FRAME_S * np.arange(len(force_n))

    def swinging(reach: float, period_s: tuple[float, float]) -> Floats:
        swing: Floats = reach * np.sin(
            2.0 * pi * (time_s / rng.uniform(*period_s) + rng.random())
        )
        return swing

    largest_m = study.phantom.eye_shift_m.bounds[1]
    shifts = []

    for pulse_m in (5e-6, 20e-6):
        drift = swinging(0.6 * largest_m, (3.0, 20.0)) + swinging(
            0.3 * largest_m, (3.0, 5.0)
        )
        shifts.append(
            drift + swinging(pulse_m, (0.8, 1.2)) + rng.normal(0.0, 5e-6, len(time_s))
        )

    return Trajectory(force_n, shifts[0], shifts[1], swinging(2.0, (2.0, 10.0)), name)
