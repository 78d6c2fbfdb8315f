"""A virtual force log: a needle's motion, in pushes or continuous, and its reading by a force sensor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.tables import FORCE_COLUMNS
from scleraforce.study import PhantomStudy, draw

Samples = NDArray[np.float64]

TIME_DIGITS = 4  # of frames.csv and forces.csv: 0.1 ms


@dataclass(frozen=True, kw_only=True)
class Push:
    """One push: the needle comes on at `start_s`, in `ramp_s`, holds still for `hold_s` and leaves in `ramp_s`.

    Meanwhile the force relaxes by `relaxation_fraction` with the time constant `relaxation_time_s`; it is `force_n` at
    the frame, at `frame_s`.
    """

    force_n: float
    start_s: float
    ramp_s: float
    hold_s: float
    frame_s: float
    relaxation_fraction: float
    relaxation_time_s: float

    @property
    def end_s(self) -> float:
        """Time at which the needle is off again."""
        return self.start_s + 2 * self.ramp_s + self.hold_s


@dataclass(frozen=True)
class ForcePath:
    """The force that a robot holds: straight lines between turning points, (points,) each; constant beyond them."""

    times_s: tuple[float, ...]
    forces_n: tuple[float, ...]


Motion = tuple[Push, ...] | ForcePath


@dataclass(frozen=True, kw_only=True)
class ForceSensor:
    """A force sensor: offset of each axis (3,), drift of the axis along the needle, noise, step, cross talk."""

    offset_n: tuple[float, float, float]
    drift_n_per_s: float
    noise_n: float
    step_n: float
    cross_talk_fraction: tuple[float, float]
    torque_noise_nm: float
    rate_hz: float


def plan_pushes(forces_n: tuple[float, ...], phantom: PhantomStudy, rng: np.random.Generator) -> tuple[Push, ...]:
    """Draw the timing of a push for each force (at its frame), with one eye's relaxation. 0 N: the needle stays off."""
    relaxes = {name: draw(getattr(phantom, name), rng) for name in ("relaxation_fraction", "relaxation_time_s")}
    start_s = draw(phantom.approach_s, rng)
    pushes = []
    for force_n in forces_n:
        ramp_s, hold_s, delay_s = draw(phantom.ramp_s, rng), draw(phantom.hold_s, rng), draw(phantom.frame_delay_s, rng)
        frame_s = round(start_s + ramp_s + delay_s, TIME_DIGITS)
        times = {"start_s": start_s, "ramp_s": ramp_s, "hold_s": hold_s, "frame_s": frame_s}
        pushes.append(Push(force_n=force_n, **times, **relaxes))
        start_s = pushes[-1].end_s + draw(phantom.rest_s, rng)
    return tuple(pushes)


def plan_path(
    forces_n: tuple[float, ...], ramp_n_per_s: float, hold_s: float, phantom: PhantomStudy, rng: np.random.Generator
) -> ForcePath:
    """Lay a path through forces: off the eye for a drawn time, then a ramp to each and a hold; nothing relaxes."""
    times_s, path_n = [0.0, draw(phantom.approach_s, rng)], [0.0, 0.0]
    for force_n in forces_n:
        reached_s = times_s[-1] + abs(force_n - path_n[-1]) / ramp_n_per_s
        times_s += [reached_s, reached_s + hold_s]
        path_n += [force_n, force_n]
    return ForcePath(tuple(times_s), tuple(path_n))


def motion_end_s(motion: Motion) -> float:
    """Return the time at which the last push, or the path, ends."""
    return motion.times_s[-1] if isinstance(motion, ForcePath) else motion[-1].end_s


def true_force(motion: Motion, time_s: Samples) -> Samples:
    """Return the true contact force in N at each time, shape of `time_s`."""
    if isinstance(motion, ForcePath):
        return np.asarray(np.interp(time_s, motion.times_s, motion.forces_n), dtype=np.float64)
    force_n = np.zeros_like(time_s)
    for push in motion:
        hold_s = push.start_s + push.ramp_s
        relaxed = _relaxed(push, np.clip(time_s - hold_s, 0.0, push.hold_s))
        coming = np.clip((time_s - push.start_s) / push.ramp_s, 0.0, 1.0)
        leaving = np.clip((push.end_s - time_s) / push.ramp_s, 0.0, 1.0)
        at_frame = _relaxed(push, np.array(push.frame_s - hold_s))
        force_n += push.force_n * np.minimum(coming, leaving) * relaxed / at_frame
    return force_n


def sample_sensor(phantom: PhantomStudy, rng: np.random.Generator) -> ForceSensor:
    """Draw the sensor of one recording."""
    x, y, z = (draw(phantom.force_offset_n, rng) for _ in range(3))
    return ForceSensor(
        offset_n=(x, y, z),
        drift_n_per_s=draw(phantom.force_drift_n_per_s, rng),
        noise_n=draw(phantom.force_noise_n, rng),
        step_n=phantom.force_step_n,
        cross_talk_fraction=(draw(phantom.cross_talk_fraction, rng), draw(phantom.cross_talk_fraction, rng)),
        torque_noise_nm=draw(phantom.torque_noise_nm, rng),
        rate_hz=phantom.sample_rate_hz,
    )


def sense(
    motion: Motion, sensor: ForceSensor, axis: int, sign: int, stop_s: float, rng: np.random.Generator
) -> Samples:
    """Return the log of a sensor, shape (samples, 7): time in s, forces in N, torques in N m.

    `axis` (0, 1 or 2) is the force axis along the needle, `sign` its sign in contact; the log runs from 0 to `stop_s`.
    """
    time_s = np.arange(round(stop_s * sensor.rate_hz)) / sensor.rate_hz
    force_n = true_force(motion, time_s)
    log = rng.standard_normal((len(time_s), 7))
    log[:, 0] = time_s
    log[:, 1:4] *= sensor.noise_n
    log[:, 1:4] += sensor.offset_n
    log[:, 1 + axis] += sign * force_n + sensor.drift_n_per_s * time_s
    for other, fraction in zip([i for i in range(3) if i != axis], sensor.cross_talk_fraction, strict=True):
        log[:, 1 + other] += fraction * force_n
    if sensor.step_n > 0.0:
        log[:, 1:4] = np.rint(log[:, 1:4] / sensor.step_n) * sensor.step_n
    log[:, 4:] *= sensor.torque_noise_nm
    return log


def format_log(log: Samples) -> str:
    """Return forces.csv: 0.1 ms, 0.1 mN, 0.01 mN m."""
    line = f"%.{TIME_DIGITS}f,%.4f,%.4f,%.4f,%.5f,%.5f,%.5f"
    rounded = np.round(log, 5) + 0.0  # -0.0 becomes 0.0
    return "\n".join([",".join(FORCE_COLUMNS), *(line % tuple(row) for row in rounded.tolist())]) + "\n"


def _relaxed(push: Push, held_s: Samples) -> Samples:
    """Return the share of the first force that is left after a hold."""
    return 1.0 - push.relaxation_fraction * (1.0 - np.exp(-held_s / push.relaxation_time_s))
