"""A virtual force log: a needle's motion, in pushes or continuous, and its reading by a
force sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scleraforce.base.arrays import Flags, Floats
from scleraforce.lab.tissue_light import drawn_record
from scleraforce.mechanics.tissue_material import ELASTIC, PronySeries
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS
from scleraforce.records.study import PhantomStudy, draw

TIME_DIGITS = 4  # of frames.csv and forces.csv: 0.1 ms


@dataclass(frozen=True, kw_only=True)
class Push:
    """One push: the needle comes on at `start_s`, in `ramp_s`, holds still for `hold_s`
    and leaves in `ramp_s`.
    """

    force_n: (
        float  # on the needle at the frame; the dent stays while the tissue relaxes
    )
    start_s: float
    ramp_s: float
    hold_s: float
    frame_s: float

    @property
    def corners_s(self) -> tuple[float, float, float, float]:
        """Times at which the needle begins to come, stops, begins to leave, and is off
        again.
        """
        left_s = self.start_s + self.ramp_s + self.hold_s
        return self.start_s, self.start_s + self.ramp_s, left_s, left_s + self.ramp_s


UNIT_PUSH = (0.0, 1.0, 1.0, 0.0)  # at the corners
# ranges of a puncture's fall, and of the friction over its force
FALL_S = (1e-3, 4e-3)
FRICTION = (0.15, 0.4)


@dataclass(frozen=True, kw_only=True)
class Puncture:
    """The needle goes through the wall at `time_s`: its force falls from `force_n` to
    the friction within `fall_s`.
    """

    time_s: float
    force_n: float
    fall_s: float
    # of `force_n`, along the shaft: pulls the wall outwards as the needle goes back
    friction_fraction: float
    out_s: float  # when it is out
    driven_s: tuple[float, ...]  # the needle's travel ...
    driven_n: tuple[float, ...]  # ... as the elastic force of a wall that bears it


@dataclass(frozen=True)
class NeedlePath:
    """A needle's travel, as the elastic force of its dents at turning points, and the
    tissue's relaxation.

    After a `puncture` it is the friction along the shaft, below 0 as the wall is pulled
    outwards; nothing relaxes.
    """

    times_s: tuple[float, ...]
    forces_n: tuple[float, ...]
    relaxation: PronySeries = ELASTIC
    puncture: Puncture | None = None

    def felt_n(self, time_s: Floats) -> Floats:
        """Return the true contact force in N at each time, shape of `time_s`."""
        felt_n = np.maximum(
            self.relaxation.felt_along(self.times_s, self.forces_n, time_s), 0.0
        )
        return np.where(
            self.pierced(time_s), np.interp(time_s, self.times_s, self.forces_n), felt_n
        )

    def pierced(self, time_s: Floats) -> Flags:
        """Return whether the needle has pierced the wall, at each time."""
        return np.asarray(time_s) > (
            np.inf if self.puncture is None else self.puncture.time_s
        )

    def elastic_n(self, time_s: Floats) -> Floats:
        """Return the elastic force in N, whose dent the wall shows, at each time; 0
        where the needle has let go.
        """
        driven_n = np.interp(time_s, self.times_s, self.forces_n)
        return np.where(
            (self.felt_n(time_s) > 0.0) | self.pierced(time_s), driven_n, 0.0
        )


@dataclass(frozen=True, kw_only=True)
class ForceSensor:
    """A force sensor: offset of each axis (3,), drift of the axis along the needle,
    noise, step, cross talk.
    """

    offset_n: tuple[float, float, float]
    drift_n_per_s: float
    noise_n: float
    step_n: float
    cross_talk_fraction: tuple[float, float]
    torque_noise_nm: float
    rate_hz: float


def plan_pushes(
    forces_n: tuple[float, ...], phantom: PhantomStudy, rng: np.random.Generator
) -> tuple[Push, ...]:
    """Draw the timing of a push for each force (at its frame). 0 N: the needle stays
    off.
    """
    start_s = draw(phantom.approach_s, rng)
    pushes = []

    for force_n in forces_n:
        ramp_s = draw(phantom.ramp_s, rng)
        hold_s = draw(phantom.hold_s, rng)
        delay_s = draw(phantom.frame_delay_s, rng)
        frame_s = round(start_s + ramp_s + delay_s, TIME_DIGITS)
        pushes.append(
            Push(
                force_n=force_n,
                start_s=start_s,
                ramp_s=ramp_s,
                hold_s=hold_s,
                frame_s=frame_s,
            )
        )
        start_s = pushes[-1].corners_s[-1] + draw(phantom.rest_s, rng)

    return tuple(pushes)


def path_of_pushes(pushes: Sequence[Push], relaxation: PronySeries) -> NeedlePath:
    """Return the travel with which the force on the needle is that of each push at its
    frame.

    What the tissue remembers of earlier pushes lowers the force of a later one, so its
    dent is the deeper.
    """
    elastic_n: list[float] = []
    for push in pushes:
        at_frame = np.array([push.frame_s])
        responses = [
            float(relaxation.felt_along(one.corners_s, UNIT_PUSH, at_frame)[0])
            for one in pushes
        ]
        remembered_n = sum(
            part_n * response
            for part_n, response in zip(elastic_n, responses, strict=False)
        )
        own = responses[len(elastic_n)]
        elastic_n.append(
            (push.force_n - remembered_n) / own if push.force_n > 0.0 else 0.0
        )

    corners_s = [time_s for push in pushes for time_s in push.corners_s]
    corners_n = [float(part_n * share) for part_n in elastic_n for share in UNIT_PUSH]
    return NeedlePath(tuple(corners_s), tuple(corners_n), relaxation)


def plan_path(
    forces_n: tuple[float, ...],
    ramp_n_per_s: float,
    hold_s: float,
    phantom: PhantomStudy,
    relaxation: PronySeries,
    rng: np.random.Generator,
) -> NeedlePath:
    """Lay a path through elastic forces: off the eye for a drawn time, then a ramp to
    each and a hold.
    """
    times_s = [0.0, draw(phantom.approach_s, rng)]
    path_n = [0.0, 0.0]

    for force_n in forces_n:
        reached_s = times_s[-1] + abs(force_n - path_n[-1]) / ramp_n_per_s
        times_s += [reached_s, reached_s + hold_s]
        path_n += [force_n, force_n]

    return NeedlePath(tuple(times_s), tuple(path_n), relaxation)


def plan_puncture(
    path: NeedlePath,
    puncture_n: float,
    ramp_n_per_s: float,
    hold_s: float,
    rng: np.random.Generator,
) -> NeedlePath:
    """Let a path go through the wall at an elastic force that it has not reached,
    travel on for a hold, and come out.

    On its way back the shaft sticks until the friction is turned, and slips until the
    tip is at the wall's surface.
    """
    at_s = path.times_s[-1] + (puncture_n - path.forces_n[-1]) / ramp_n_per_s
    fall_s = rng.uniform(*FALL_S)
    friction = rng.uniform(*FRICTION)
    left_n = friction * puncture_n
    turns_s = at_s + hold_s + fall_s
    # from the friction inwards to that outwards
    pulled_s = turns_s + 2.0 * left_n / ramp_n_per_s
    out_s = turns_s + hold_s + fall_s + (puncture_n + left_n) / ramp_n_per_s
    driven_n = puncture_n + ramp_n_per_s * (turns_s - at_s), -left_n
    puncture = Puncture(
        time_s=at_s,
        force_n=puncture_n,
        fall_s=fall_s,
        friction_fraction=friction,
        out_s=out_s,
        driven_s=(*path.times_s, turns_s, out_s),
        driven_n=(*path.forces_n, *driven_n),
    )
    times_s = (
        *path.times_s,
        at_s,
        at_s + fall_s,
        turns_s,
        pulled_s,
        out_s,
        out_s + fall_s,
    )
    forces_n = (*path.forces_n, puncture_n, left_n, left_n, -left_n, -left_n, 0.0)

    return replace(path, times_s=times_s, forces_n=forces_n, puncture=puncture)


def sample_sensor(phantom: PhantomStudy, rng: np.random.Generator) -> ForceSensor:
    """Draw the sensor of one recording."""
    return drawn_record(
        ForceSensor,
        phantom,
        rng,
        "force_",
        step_n=phantom.force_step_n,
        rate_hz=phantom.sample_rate_hz,
        offset_n=lambda: tuple(draw(phantom.force_offset_n, rng) for _ in range(3)),
        cross_talk_fraction=lambda: tuple(
            draw(phantom.cross_talk_fraction, rng) for _ in range(2)
        ),
        torque_noise_nm=lambda: draw(phantom.torque_noise_nm, rng),
    )


def sense(
    path: NeedlePath,
    sensor: ForceSensor,
    axis: int,
    sign: int,
    stop_s: float,
    rng: np.random.Generator,
) -> Floats:
    """Return the log of a sensor, shape (samples, 7): time in s, forces in N, torques
    in N m.

    `axis` (0, 1 or 2) is the force axis along the needle, `sign` its sign in contact;
    the log runs from 0 to `stop_s`.
    """
    time_s = np.arange(round(stop_s * sensor.rate_hz)) / sensor.rate_hz
    force_n = path.felt_n(time_s)
    log = rng.standard_normal((len(time_s), 7))
    log[:, 0] = time_s
    log[:, 1:4] *= sensor.noise_n
    log[:, 1:4] += sensor.offset_n
    log[:, 1 + axis] += sign * force_n + sensor.drift_n_per_s * time_s

    for other, fraction in zip(
        [i for i in range(3) if i != axis], sensor.cross_talk_fraction, strict=True
    ):
        log[:, 1 + other] += fraction * force_n

    if sensor.step_n > 0.0:
        log[:, 1:4] = np.rint(log[:, 1:4] / sensor.step_n) * sensor.step_n

    log[:, 4:] *= sensor.torque_noise_nm
    return log


def format_log(log: Floats) -> str:
    """Return forces.csv: 0.1 ms, 0.1 mN, 0.01 mN m."""
    line = f"%.{TIME_DIGITS}f,%.4f,%.4f,%.4f,%.5f,%.5f,%.5f"
    rounded = np.round(log, 5) + 0.0  # -0.0 becomes 0.0
    return (
        "\n".join(
            [",".join(FORCE_COLUMNS), *(line % tuple(row) for row in rounded.tolist())]
        )
        + "\n"
    )
