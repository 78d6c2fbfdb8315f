"""The relaxation of an eye's tissue, from the holds of its force log, and the elastic
force at each frame.

A needle that holds still keeps the dent and so the elastic force Fe, while the force F
falls. Holds are parts of the log between fast changes of the force. F is turned into Fe
by the series of `mechanics.material`, and the shares g keep Fe constant in all holds
(least squares, Gauss-Newton with g >= 0). Between pushes nothing pulls: Fe is 0 there.
A robot that holds the force instead of the place shows no relaxation; nor does a log
without holds.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, product

import numpy as np

from scleraforce.arrays import Flags, Floats
from scleraforce.calibration.forces import FrameForces
from scleraforce.known.relaxation import MOST_BEFORE_N, KnownRelaxation, Matrix, rows
from scleraforce.mechanics.material import driven_back
from scleraforce.recording.folder import Recording
from scleraforce.recording.labels import contact_force

# two terms of any times between are as good as in the grid
TIMES_S = (
    0.3,
    1.0,
    3.0,
    10.0,
    30.0,
    100.0,
)
# Half-normal priors of the shares, each with the same: pork loses 0.27 with 0.4 s and
# 0.33 with 4.3 s, the paper's eyes some percent. A log without holds leaves tissue that
# relaxes much or little on all times alike, as much as by chance.
PRIOR_SD = np.full(len(TIMES_S), 0.07)
# mean and standard deviation of a half-normal variable
MEAN_OF_SD = np.sqrt(2.0 / np.pi)
SD_OF_SD = np.sqrt(1.0 - 2.0 / np.pi)
STEP_S = 0.1  # of the log that is turned back: its low-pass leaves 5 Hz
CONTACT_N = 2e-3
LEAST_PUSH_N = 10e-3  # of which a hold is taken
FAST = 0.3  # of the fastest rise of a push: faster changes are the needle's
SURE = 4.0  # standard deviations of the noise
# samples: of a mean, which leaves out 0.2 s at a hold's ends; of the shortest hold
SMOOTHED = 4
LEAST = 5
OFF = 1.5  # of the usual scatter: the needle moved
MOST = 0.95  # of a force is lost
# of Gauss-Newton; of a share, for its derivative
ROUNDS = 6
STEP = 1e-4
LEAST_GAIN = 8.0  # of the log likelihood, below which the tissue counts as elastic
PUSHED = 0.7  # of a frame's force: the push began where it was less
ONE_FRAME_SD = 0.1  # of held, of one frame


def with_elastic_forces(
    recording: Recording, forces: FrameForces, known: KnownRelaxation | None
) -> tuple[FrameForces, KnownRelaxation, Floats]:
    """Return the forces of labelled frames as elastic ones, and how the tissue relaxes,
    unless that is known already.

    The recording has a force log without gaps. Its elastic force, every `STEP_S` from
    its beginning, is the third.
    """
    log = recording.forces
    info = recording.info.force
    assert log is not None
    assert info is not None
    since_s = log.time_s - log.time_s[0]
    time_s = np.arange(0.0, since_s[-1], STEP_S)
    felt_n = (
        np.interp(time_s, since_s, contact_force(log, info))
        - forces.zero[0]
        - forces.zero[1] * time_s
    )
    contact = felt_n > CONTACT_N

    if known is None:
        known = _found(felt_n, time_s, contact)
    if not known.shares:
        return forces, known, np.where(contact, felt_n, 0.0)

    shares = np.array(known.shares)
    elastic_n, memories_n = (
        found[0]
        for found in driven_back(felt_n, time_s, contact, shares[None], known.times_s)
    )
    frames = np.clip(np.searchsorted(time_s, forces.since_start_s), 0, len(time_s) - 1)
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
    known: KnownRelaxation,
    frame_s: Floats,
    force_n: Floats,
    time_s: Floats,
    elastic_n: Floats,
    memories_n: Floats,
) -> KnownRelaxation:
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
    found = replace(
        known,
        held=tuple(held.mean(axis=0).tolist()),
        held_covariance=_spread(held, ONE_FRAME_SD),
    )
    covariance_n2 = _spread(before_n, MOST_BEFORE_N / 2)
    found = replace(
        found,
        before_n=tuple(before_n.mean(axis=0).tolist()),
        before_covariance_n2=covariance_n2,
    )

    later = counted[counted > 0]
    if not len(later):
        return found

    earlier = frames[later - 1]
    left_n = (
        np.exp(-(time_s[pushes[later]] - time_s[earlier])[:, None] / times_s)
        * memories_n[earlier]
    )
    rest_n = at_push_n[later] - left_n
    earlier_n = np.maximum(force_n[later - 1], 0.0)
    after = earlier_n @ rest_n / max(float(earlier_n @ earlier_n), LEAST_PUSH_N**2)
    rest_n -= np.outer(earlier_n, after)
    covariance_n2 = rows(rest_n.T @ rest_n / max(len(later) - 1, 1))
    found = replace(
        found, after=tuple(after.tolist()), after_covariance_n2=covariance_n2
    )

    return replace(
        found,
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
        return rows(sd_of_one**2 * np.eye(found.shape[1]))

    return rows(
        (1.0 + 1.0 / count)
        * (count - 1)
        / max(count - 3, 1)
        * np.atleast_2d(np.cov(found.T))
    )


def _found(felt_n: Floats, time_s: Floats, contact: Flags) -> KnownRelaxation:
    """Find the shares on the holds of a log; without holds they are as in other
    tissue.
    """
    holds = list(_holds(felt_n, contact))
    if not holds:
        covariance = (
            SD_OF_SD**2 * (np.outer(PRIOR_SD, PRIOR_SD) + np.diag(PRIOR_SD**2)) / 2
        )
        return KnownRelaxation.of(
            (MEAN_OF_SD * PRIOR_SD).tolist(), TIMES_S, covariance, "population"
        )

    _, _, holds = _fitted(felt_n, time_s, contact, holds)
    shares, covariance, _ = _fitted(felt_n, time_s, contact, holds)
    return KnownRelaxation.of(shares.tolist(), TIMES_S, covariance, "holds")


def _holds(felt_n: Floats, contact: Flags) -> Iterator[slice]:
    """Yield the parts of a log between fast changes of the force, in contact."""
    ends_n = np.pad(felt_n, (SMOOTHED // 2, (SMOOTHED - 1) // 2), mode="symmetric")
    speed = np.gradient(
        np.convolve(ends_n, np.full(SMOOTHED, 1.0 / SMOOTHED), mode="valid")
    )
    noise = (
        1.4826 * float(np.median(np.abs(speed[~contact]))) if (~contact).any() else 0.0
    )
    ends = np.flatnonzero(np.diff(contact, prepend=False, append=False))

    for start, stop in ends.reshape(-1, 2).tolist():
        push = slice(start, stop)
        if felt_n[push].max() < LEAST_PUSH_N:
            continue

        fast = (
            np.flatnonzero(
                np.abs(speed[push]) > max(FAST * speed[push].max(), SURE * noise)
            )
            + start
        )
        for before, after in pairwise(fast.tolist()):
            hold = slice(before + 1, after)
            if (
                hold.stop - hold.start >= LEAST
                and felt_n[hold].min() > LEAST_PUSH_N / 2
            ):
                yield hold


def _fitted(
    felt_n: Floats, time_s: Floats, contact: Flags, holds: list[slice]
) -> tuple[Floats, Floats, list[slice]]:
    """Return shares, covariance, and the holds in which the needle did not move."""
    variance = 0.5 * float(
        np.mean(np.concatenate([np.diff(felt_n[hold]) for hold in holds]) ** 2)
    )

    def scatter(shares: Floats) -> list[Floats]:
        """Return the distance of Fe from its mean in each hold, (candidate, sample)."""
        elastic_n = driven_back(felt_n, time_s, contact, shares, TIMES_S)[0]
        return [
            elastic_n[:, hold] - elastic_n[:, hold].mean(axis=1, keepdims=True)
            for hold in holds
        ]

    shares = np.zeros(len(TIMES_S))
    prior = np.diag(PRIOR_SD**-2)
    steps = np.concatenate([np.zeros((1, len(TIMES_S))), STEP * np.eye(len(TIMES_S))])

    for _ in range(ROUNDS):
        rest_n = np.concatenate(scatter(shares + steps), axis=1)
        slopes = (rest_n[1:] - rest_n[0]) / STEP
        seen = slopes @ slopes.T / variance
        shares = not_negative(
            seen + prior, seen @ shares - slopes @ rest_n[0] / variance
        )
        shares *= min(1.0, MOST / max(float(shares.sum()), MOST))

    parts = scatter(np.stack([np.zeros(len(TIMES_S)), shares]))
    # of each hold, elastic and relaxing
    squares = np.array([(part_n**2).sum(axis=1) for part_n in parts]) / variance
    counts = np.array([part_n.shape[1] for part_n in parts])
    usual = squares[:, 1] / counts
    kept = [
        hold
        for hold, one in zip(holds, usual, strict=True)
        if one <= OFF**2 * float(np.median(usual))
    ]
    inflation = max(float(squares[:, 1].sum() / counts.sum()), 1.0)
    sure = 0.5 * float((squares[:, 0] - squares[:, 1]).sum()) > LEAST_GAIN * inflation
    covariance: Floats = inflation * np.linalg.inv(seen + prior)

    return (shares if sure else np.zeros_like(shares)), covariance, kept


def not_negative(normal: Floats, gradient: Floats) -> Floats:
    """Return the few x >= 0 with the least x N x / 2 - g x (share,); SciPy's takes a
    tenth of a second to import.
    """
    best = np.zeros(len(gradient))
    for chosen in product((False, True), repeat=len(gradient)):
        free = np.array(chosen)
        x = np.zeros(len(gradient))
        x[free] = np.linalg.solve(normal[np.ix_(free, free)], gradient[free])
        if (x >= 0.0).all() and gradient @ x > gradient @ best:  # twice what each gains
            best = x

    return best
