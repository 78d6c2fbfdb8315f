"""The course of a session: forces of the needle, motion of the eye, changes of the
light.
"""

from dataclasses import dataclass
from math import pi

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.records.study import Study

FRAME_S = 0.01
ACTIONS = ("hold", "swing", "ramp", "step", "lift off")
SHARES = (0.2, 0.25, 0.3, 0.2, 0.05)


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
    reached_n = rng.uniform(0.5, 1.0) * highest_n
    force_n = [0.0] * 100
    force_n += np.linspace(0.0, reached_n, _frames(rng, 0.5, 1.5)).tolist()
    name = ["before contact"] * 100 + ["approach"] * (len(force_n) - 100)

    while len(force_n) < count:
        part_n, action = _next_action(force_n[-1], highest_n, rng)
        force_n += part_n.tolist()
        name += [action] * len(part_n)

    cycles = rng.uniform(0.8, 1.5) * FRAME_S * np.arange(count) + rng.random()
    forces_n = np.array(force_n[:count])
    touching = np.clip(forces_n / 1e-3, 0.0, 1.0)
    tremor_n = 0.2e-3 * np.sin(2.0 * pi * cycles)

    return np.clip(forces_n + touching * tremor_n, 0.0, highest_n), name[:count]


def ramp_forces(
    rate_n_s: float, largest_n: float, rng: np.random.Generator
) -> tuple[Floats, list[str]]:
    """Return true forces that rise at a rate to the largest, after a while without
    contact.
    """
    before = np.zeros(_frames(rng, 0.5, 1.0))
    step_n = rate_n_s * FRAME_S
    rising = np.arange(0.0, largest_n, step_n) + rng.random() * step_n
    forces_n = np.minimum(np.concatenate([before, rising]), largest_n)

    return forces_n, ["ramp"] * len(forces_n)


def _frames(rng: np.random.Generator, least_s: float, most_s: float) -> int:
    return int(rng.uniform(least_s, most_s) / FRAME_S)


def _next_action(
    now_n: float, highest_n: float, rng: np.random.Generator
) -> tuple[Floats, str]:
    """Return the forces of the robot's next action, and its name."""
    frames = _frames(rng, 1.0, 4.0)
    share = np.arange(1, frames + 1) / frames
    action = str(rng.choice(ACTIONS, p=SHARES))

    if action == "hold":
        return np.full(frames, now_n), action

    if action == "swing":
        reach_n = rng.uniform(0.2, 1.0) * min(now_n, highest_n - now_n)
        return now_n + reach_n * np.sin(2.0 * pi * share * rng.integers(1, 4)), action

    if action == "lift off":
        down = np.linspace(1.0, 0.0, _frames(rng, 0.1, 0.4))
        away = np.zeros(_frames(rng, 0.3, 2.0))
        back = np.linspace(0.0, rng.uniform(2e-3, 10e-3), _frames(rng, 0.5, 1.5))
        return np.concatenate([now_n * down, away, back]), action

    if action == "ramp":
        goal_n = rng.uniform(0.0, highest_n)
        return now_n + (goal_n - now_n) * share, action

    step_n = rng.choice([-1, 1]) * rng.uniform(0.5e-3, 3e-3)
    goal_n = np.clip(now_n + step_n, 0.0, highest_n)
    rise = np.minimum(np.arange(1, frames + 1) / rng.integers(3, 8), 1.0)
    return now_n + (goal_n - now_n) * rise, action


def trajectory(
    force_n: Floats, name: list[str], study: Study, rng: np.random.Generator
) -> Trajectory:
    """Add what the eye and the light do: drift, breathing and pulse within the study's
    shifts, and a jitter of 5 um.
    """
    time_s = FRAME_S * np.arange(len(force_n))

    def swinging(reach: float, least_s: float, most_s: float) -> Floats:
        cycles = time_s / rng.uniform(least_s, most_s) + rng.random()
        return np.asarray(reach * np.sin(2.0 * pi * cycles))

    def shift_m(pulse_m: float) -> Floats:
        largest_m = study.phantom.eye_shift_m.bounds[1]
        drift = swinging(0.6 * largest_m, 3.0, 20.0)
        drift += swinging(0.3 * largest_m, 3.0, 5.0)
        drift += swinging(pulse_m, 0.8, 1.2)
        return drift + rng.normal(0.0, 5e-6, len(time_s))

    return Trajectory(
        force_n, shift_m(5e-6), shift_m(20e-6), swinging(2.0, 2.0, 10.0), name
    )
