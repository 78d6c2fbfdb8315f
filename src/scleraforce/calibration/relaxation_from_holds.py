"""The elastic force at each frame of a log, of tissue that relaxes, and the histories
of the frames (`calibration.holds_of_a_log` finds how it relaxes).

F is turned into Fe by the series of `mechanics.tissue_material`. Between pushes nothing
pulls: Fe is 0 there. A robot that holds the force instead of the place shows no
relaxation; nor does a log without holds.
"""

from dataclasses import replace

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.calibration.holds_of_a_log import (
    LEAST_PUSH_N,
    HoldLog,
    find_relaxation,
)
from scleraforce.mechanics.elastic_force import driven_back
from scleraforce.recordings.force_errors import FrameForces
from scleraforce.recordings.forces_under_frames import contact_force
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.tissue_relaxation import (
    MOST_BEFORE_N,
    Matrix,
    Relaxation,
    matrix_rows,
)

PUSHED = 0.7  # of a frame's force: the push began where it was less
ONE_FRAME_SD = 0.1  # of held, of one frame


def hold_log(recording: Recording, forces: FrameForces) -> HoldLog:
    """Return a recording's force log, which has no gaps, for its holds."""
    log = recording.forces
    info = recording.info.force
    assert log is not None
    assert info is not None
    since_s = log.time_s - log.time_s[0]
    return HoldLog.of(since_s, contact_force(log, info), forces.zero)


def with_elastic_forces(
    recording: Recording, forces: FrameForces, known: Relaxation | None
) -> tuple[FrameForces, Relaxation, Floats]:
    """Return the forces of labelled frames as elastic ones, and how the tissue relaxes,
    unless that is known already.

    The recording has a force log without gaps. Its elastic force, every `STEP_S` from
    its beginning, is the third.
    """
    log = hold_log(recording, forces)
    time_s = log.time_s
    felt_n = log.felt_n
    contact = log.contact
    known = find_relaxation(log) if known is None else known
    if not known.shares:
        return forces, known, np.where(contact, felt_n, 0.0)

    shares = np.array(known.shares)
    (elastic_n,), (memories_n,) = driven_back(
        felt_n, time_s, contact, shares[None], known.times_s
    )
    frames = log.frames(forces.since_start_s)
    lag_n = np.where(contact[frames], memories_n[frames] @ shares, 0.0)
    force_n = forces.force_n + lag_n
    known = _with_histories(
        known,
        forces.since_start_s,
        np.nan_to_num(force_n),
        time_s,
        elastic_n,
        memories_n,
    )

    return replace(forces, force_n=force_n), known, elastic_n


def _with_histories(
    known: Relaxation,
    frame_s: Floats,
    force_n: Floats,
    time_s: Floats,
    elastic_n: Floats,
    memories_n: Floats,
) -> Relaxation:
    """Return a relaxation with the histories of frames, which have an elastic force."""
    times_s = np.array(known.times_s)
    counted = np.flatnonzero(force_n > LEAST_PUSH_N)
    frames = np.clip(np.searchsorted(time_s, frame_s), 0, len(time_s) - 1)
    pushes = np.array(
        [
            _push(elastic_n[:frame], PUSHED * one_n)
            for frame, one_n in zip(frames, force_n, strict=True)
        ]
    )

    if not len(counted):
        return known

    held_s = time_s[frames] - time_s[pushes]
    at_push_n = memories_n[pushes]
    held = memories_n[frames] - np.exp(-held_s[:, None] / times_s) * at_push_n
    held /= np.maximum(force_n, LEAST_PUSH_N)[:, None]
    held = held[counted]
    before_n = at_push_n[counted]
    with_held = replace(
        known,
        held=tuple(held.mean(axis=0).tolist()),
        held_covariance=_spread(held, ONE_FRAME_SD),
    )
    covariance_n2 = _spread(before_n, MOST_BEFORE_N / 2)
    histories = replace(
        with_held,
        before_n=tuple(before_n.mean(axis=0).tolist()),
        before_covariance_n2=covariance_n2,
    )

    # a frame of the same push does not say what a rest leaves
    later = counted[counted > 0]
    later = later[pushes[later] >= frames[later - 1]]
    if not len(later):
        return histories

    earlier = frames[later - 1]
    left_n = (
        np.exp(-(time_s[pushes[later]] - time_s[earlier])[:, None] / times_s)
        * memories_n[earlier]
    )
    rest_n = at_push_n[later] - left_n
    earlier_n = np.maximum(force_n[later - 1], 0.0)
    after = earlier_n @ rest_n / max(float(earlier_n @ earlier_n), LEAST_PUSH_N**2)
    rest_n -= np.outer(earlier_n, after)
    covariance_n2 = matrix_rows(rest_n.T @ rest_n / max(len(later) - 1, 1))
    histories = replace(
        histories, after=tuple(after.tolist()), after_covariance_n2=covariance_n2
    )

    return replace(
        histories,
        every_s=float(np.median(np.diff(frame_s))),
        held_s=float(np.median(held_s[counted])),
    )


def _push(elastic_n: Floats, less_n: float) -> int:
    """Return the last sample with less than a force."""
    lighter = np.flatnonzero(elastic_n < less_n)
    return int(lighter[-1]) if len(lighter) else 0


def _spread(found: Floats, sd_of_one: float) -> Matrix:
    """Return the covariance of another frame's memories after seen frames, (frame,
    term): of Student's t.
    """
    count = len(found)
    if count == 1:
        return matrix_rows(sd_of_one**2 * np.eye(found.shape[1]))

    return matrix_rows(
        (1.0 + 1.0 / count)
        * (count - 1)
        / max(count - 3, 1)
        * np.atleast_2d(np.cov(found.T))
    )
