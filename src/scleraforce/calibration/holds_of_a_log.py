"""What the holds of a force log say of the tissue, and who yields in them.

A needle that holds still keeps the dent and so the elastic force Fe, while the force F
falls: F is turned into Fe by the series of `mechanics.tissue_material`, and the shares
g keep Fe constant in all holds (least squares, Gauss-Newton with g >= 0). The log alone
cannot tell this from a needle, or its holder, that yields on an elastic wall: then the
dent follows the force, and Fe is F.

Two things keep that apart from what the log does not say:

- A time constant counts as shown if the holds say more of its share than other tissue
  does: the share's variance is below half of the prior's. The others are not
  estimated; their variance stays, and widens intervals.
- Two frames of one hold decide who yields (`who_yields`): the dent stays, or follows
  the force. Without such frames both are kept (`Relaxation.other`). As the first
  of them counts the one that explains the log better: what relaxing tissue remembers of
  a push changes the next hold, while a needle begins each push anew. The dents of all
  frames can contradict a log that seems sure (`doubted_by_dents`).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from scleraforce.base.arrays import Flags, Floats
from scleraforce.base.normal_distribution import robust_spread
from scleraforce.mechanics.elastic_force import driven_back
from scleraforce.records.tissue_relaxation import (
    HoldFinding,
    Relaxation,
    matrix_rows,
)

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
# Share of the prior's variance above which other tissue says more of a share than the
# holds do.
SHOWN = 0.5
STEP_S = 0.1  # of the log that is turned back: its low-pass leaves 5 Hz
CONTACT_N = 2e-3
LEAST_PUSH_N = 10e-3  # of which a hold is taken
FAST = 0.3  # of the fastest rise of a push: faster changes are the needle's
SURE = 4.0  # standard deviations of the noise
SMOOTHED = 4  # samples of a mean, which leaves out 0.2 s at a hold's ends
LEAST = 5  # samples of the shortest hold
REACHED = 0.8  # of a hold's median force: below, a slow ramp is not over
OFF = 1.5  # of the usual scatter: the needle moved
MOST = 0.95  # of a force is lost
ROUNDS = 6  # of Gauss-Newton
STEP = 1e-4  # of a share, for its derivative
LEAST_GAIN = 8.0  # of the log likelihood, below which the tissue counts as elastic
# Chance of tissue, or of a needle, from which the log shows that pushes are remembered,
# or that they are not. Without memory both explanations read frames like the
# calibration's alike, and elastic walls need no shares.
REMEMBERED = 0.9
FORGOTTEN = 1.0 - REMEMBERED
# Chance of tissue where the log shows no memory: both explanations are models only.
LEAST_CHANCE = 0.25
LEAST_ODDS = 1e-20  # chances closer to 0 or 1 count as this
# Shares of time constants too long for the holds, over those of other tissue: points of
# a half-normal distribution, and their weights.
HIDDEN = np.arange(0.0, 3.0, 0.25)
HIDDEN_WEIGHTS = np.exp(-0.5 * HIDDEN**2) / np.exp(-0.5 * HIDDEN**2).sum()
MOST_SQUARES = 200.0  # of residuals: a few wild ones decide nothing
# Standard deviations of the tissue's share of a fall, as frames show it, within which
# all of it, or nothing, is the tissue's.
AGREED = 2.0
LEAST_SD = 0.02  # of that share: the error of the holds' own fit
FRAMES_OF_HOLD = 2  # that are read: the farthest apart
MOST_HOLDS = 12  # whose frames are read
MOST_FRAMES = 24  # that are read where no hold has two of them


@dataclass(frozen=True, eq=False)
class HoldLog:
    """A force log every `STEP_S`, without offset and drift, (sample,): time since its
    beginning, force, and whether the needle touches.
    """

    time_s: Floats
    felt_n: Floats
    contact: Flags

    @classmethod
    def of(cls, since_s: Floats, contact_n: Floats, zero: Floats) -> "HoldLog":
        """Return the log of a contact force; `zero` is offset, N, and drift, N/s."""
        time_s = np.arange(0.0, since_s[-1], STEP_S)
        felt_n = np.interp(time_s, since_s, contact_n) - zero[0] - zero[1] * time_s
        return cls(time_s, felt_n, felt_n > CONTACT_N)

    def frames(self, since_s: Floats) -> np.ndarray:
        """Return the samples of times, (time,)."""
        return np.clip(np.searchsorted(self.time_s, since_s), 0, len(self.time_s) - 1)

    def elastic(self, shares: Floats, *, anew: bool = False) -> tuple[Floats, Floats]:
        """Return Fe (candidate, sample) and m_i (candidate, sample, term) by shares
        (candidate, term).
        """
        return driven_back(
            self.felt_n, self.time_s, self.contact, shares, TIMES_S, anew=anew
        )

    def noise_variance(self, holds: Sequence[slice]) -> float:
        """Return the variance of a sample's noise, N^2, from the steps between samples:
        within holds the force itself changes little from one to the next.
        """
        steps_n = np.concatenate([np.diff(self.felt_n[hold]) for hold in holds])
        return 0.5 * float(np.mean(steps_n**2))

    @property
    def holds(self) -> list[slice]:
        """The parts of the log between fast changes of the force, in contact."""
        return list(self._holds())

    def _holds(self) -> Iterator[slice]:
        felt_n = self.felt_n
        contact = self.contact
        ends_n = np.pad(felt_n, (SMOOTHED // 2, (SMOOTHED - 1) // 2), mode="symmetric")
        smooth_n = np.convolve(ends_n, np.full(SMOOTHED, 1.0 / SMOOTHED), mode="valid")
        speed = np.gradient(smooth_n)
        at_rest = np.abs(speed[~contact])
        noise = robust_spread(at_rest) if at_rest.size else 0.0
        ends = np.flatnonzero(np.diff(contact, prepend=False, append=False))

        for start, stop in ends.reshape(-1, 2).tolist():
            push = slice(start, stop)
            if felt_n[push].max() < LEAST_PUSH_N:
                continue

            fast = np.abs(speed[push]) > max(FAST * speed[push].max(), SURE * noise)
            for before, after in pairwise((np.flatnonzero(fast) + start).tolist()):
                held_n = smooth_n[before + 1 : after]
                if len(held_n) < LEAST:
                    continue

                reached = int(np.argmax(held_n >= REACHED * np.median(held_n)))
                hold = slice(before + 1 + reached, after)
                if (
                    hold.stop - hold.start >= LEAST
                    and felt_n[hold].min() > LEAST_PUSH_N / 2
                ):
                    yield hold


@dataclass(frozen=True, eq=False)
class HoldFit:
    """Shares (term,) with their covariance; `misfit`: chi squares of the holds and of
    the prior.
    """

    shares: Floats
    covariance: Floats
    misfit: float
    fall: float  # share of a force that is lost in a hold, the median one
    gain: float  # of the log likelihood, over elastic tissue
    inflation: float  # of the variance: the scatter about the fit over the noise
    kept: tuple[slice, ...]  # holds in which the needle did not move


def fit_holds(
    log: HoldLog,
    holds: Sequence[slice],
    shown: Flags | None = None,
    *,
    anew: bool = False,
) -> HoldFit:
    """Fit the shares of the `shown` terms, by default of all, to holds.

    `anew`: nothing is remembered of earlier pushes, as by a needle that yields.
    """
    used = np.arange(len(TIMES_S)) if shown is None else np.flatnonzero(shown)
    variance = log.noise_variance(holds)

    def scatter(shares: Floats) -> list[Floats]:
        """Return the distance of Fe from its mean in each hold, (candidate, sample)."""
        elastic_n = log.elastic(shares, anew=anew)[0]
        return [
            elastic_n[:, hold] - elastic_n[:, hold].mean(axis=1, keepdims=True)
            for hold in holds
        ]

    shares = np.zeros(len(TIMES_S))
    prior_sd = PRIOR_SD.copy()
    if len(used):  # the longest one stands for all that are longer
        prior_sd[used[-1]] = np.sqrt((PRIOR_SD[used[-1] :] ** 2).sum())

    prior = np.diag(prior_sd[used] ** -2)
    steps = np.concatenate([np.zeros((1, len(TIMES_S))), STEP * np.eye(len(TIMES_S))])
    steps = steps[[0, *(used + 1)]]
    seen = np.zeros((len(used), len(used)))

    for _ in range(ROUNDS if len(used) else 0):
        rest_n = np.concatenate(scatter(shares + steps), axis=1)
        slopes = (rest_n[1:] - rest_n[0]) / STEP
        seen = slopes @ slopes.T / variance
        gradient = seen @ shares[used] - slopes @ rest_n[0] / variance
        shares[used] = not_negative(seen + prior, gradient)
        shares *= min(1.0, MOST / max(float(shares.sum()), MOST))

    parts = scatter(np.stack([np.zeros(len(TIMES_S)), shares]))
    # of each hold, elastic and relaxing
    squares = np.array([(part_n**2).sum(axis=1) for part_n in parts]) / variance
    counts = np.array([part_n.shape[1] for part_n in parts])
    usual = squares[:, 1] / counts
    kept = tuple(
        hold
        for hold, one in zip(holds, usual, strict=True)
        if one <= OFF**2 * float(np.median(usual))
    )
    inflation = max(float(squares[:, 1].sum() / counts.sum()), 1.0)
    covariance = np.diag(PRIOR_SD**2)
    covariance[np.ix_(used, used)] = inflation * np.linalg.inv(seen + prior)
    misfit = float(squares[:, 1].sum() + ((shares / prior_sd) ** 2).sum())
    gain = 0.5 * float((squares[:, 0] - squares[:, 1]).sum()) / inflation

    (elastic_n,), (memory_n,) = log.elastic(shares[None], anew=anew)
    ends_n = np.array(
        [
            elastic_n[hold].mean() - memory_n[[hold.start, hold.stop - 1]] @ shares
            for hold in kept
        ]
    )
    fall = float(np.median(1.0 - ends_n[:, 1] / ends_n[:, 0]))

    return HoldFit(shares, covariance, misfit, fall, gain, inflation, kept)


def find_relaxation(log: HoldLog) -> Relaxation:
    """Find what the holds of a log say; without holds, shares are as in other
    tissue.
    """
    holds = log.holds
    if not holds:
        covariance = (
            SD_OF_SD**2 * (np.outer(PRIOR_SD, PRIOR_SD) + np.diag(PRIOR_SD**2)) / 2
        )
        none = Relaxation.of(
            (MEAN_OF_SD * PRIOR_SD).tolist(), TIMES_S, covariance, "population"
        )
        return replace(none, finding=HoldFinding(cause="no holds"))

    whole = fit_holds(log, fit_holds(log, holds).kept)
    shown = np.diag(whole.covariance) < SHOWN * PRIOR_SD**2
    tissue = fit_holds(log, whole.kept, shown) if shown.any() else whole
    length_s = STEP_S * float(np.median([one.stop - one.start for one in whole.kept]))
    finding = HoldFinding(
        cause="undecided",
        hold_s=length_s,
        fall=tissue.fall,
        not_estimated_s=tuple(np.array(TIMES_S)[~shown].tolist()),
    )
    nothing = np.zeros(len(TIMES_S)).tolist()

    if whole.gain <= LEAST_GAIN:
        steady = Relaxation.of(nothing, TIMES_S, whole.covariance, "holds")
        return replace(steady, finding=replace(finding, cause="steady", fall=0.0))

    needle = fit_holds(log, whole.kept, shown, anew=True)
    gain = 0.5 * (needle.misfit - tissue.misfit) / tissue.inflation
    chance = _chance(gain)
    return _undecided(tissue.shares, whole.covariance, replace(finding, chance=chance))


def _undecided(tissue: Floats, covariance: Floats, finding: HoldFinding) -> Relaxation:
    """Return both explanations of a fall, the first one by the tissue's chance.

    `tissue` are its shares (term,) if it yields, 0 where they are not estimated. If
    nothing tells whether pushes are remembered, those may be as in other tissue.
    """
    assert finding.chance is not None
    nothing = (0.0,) * len(TIMES_S)
    shares = tuple(tissue.tolist())

    if finding.chance >= REMEMBERED:
        first, other = shares, nothing
    elif _without_memory(finding):
        first, other = nothing, shares
        covariance = LEAST_CHANCE * covariance
    else:
        hidden = np.isin(TIMES_S, finding.not_estimated_s)
        as_in_others = np.where(hidden, MEAN_OF_SD * PRIOR_SD, tissue)
        first, other = nothing, tuple(as_in_others.tolist())

    found = Relaxation.of(first, TIMES_S, covariance, "holds")
    return replace(found, other=other, finding=finding)


def _without_memory(finding: HoldFinding) -> bool:
    """Return True if the log shows that pushes are not remembered."""
    return finding.chance is not None and finding.chance <= FORGOTTEN


@dataclass(frozen=True)
class HeldFrame:
    """A frame in a hold: its number, the hold's, and ln of the force on the needle then
    by the holds' fit.
    """

    index: int
    hold: int
    log_force: float


@dataclass(frozen=True)
class HeldFrames:
    """Frames of holds in pairs; `fall_sd`: how sure the log is of the falls between
    them, relative.
    """

    frames: tuple[HeldFrame, ...]
    fall_sd: float


def held_frames(log: HoldLog, relaxation: Relaxation, since_s: Floats) -> HeldFrames:
    """Return the frames that decide who yields: of each hold the two between which the
    force falls most, of the holds in which it falls most.

    The force is a hold's mean and the fit's fall, scaled to all holds of the log:
    whoever yields, its shape is the same, and it has less noise than a label.
    """
    shares = np.array(tissue_shares(relaxation))
    _, (memory_n,) = log.elastic(shares[None])
    fit_n = -(memory_n @ shares)
    holds = log.holds
    felt_n, fallen_n = (
        np.concatenate([part[hold] - part[hold].mean() for hold in holds])
        for part in (log.felt_n, fit_n)
    )
    size = float(fallen_n @ fallen_n)
    if not size > 0.0:
        return HeldFrames((), np.inf)

    scale = float(felt_n @ fallen_n) / size
    rest_n = felt_n - scale * fallen_n
    fall_sd = float(np.sqrt(rest_n @ rest_n / len(rest_n) / size))
    samples = log.frames(since_s)
    apart = list[tuple[float, tuple[HeldFrame, HeldFrame]]]()

    for number, hold in enumerate(holds):
        there = np.flatnonzero((samples >= hold.start) & (samples < hold.stop))
        if len(there) < FRAMES_OF_HOLD:
            continue

        force_n = log.felt_n[hold].mean() + scale * (
            fit_n[samples[there]] - fit_n[hold].mean()
        )
        ends = [int(force_n.argmax()), int(force_n.argmin())]
        if force_n[ends[1]] > 0.0 and ends[0] != ends[1]:
            first, last = (
                HeldFrame(int(there[end]), number, float(np.log(force_n[end])))
                for end in ends
            )
            apart.append((first.log_force - last.log_force, (first, last)))

    apart.sort(key=lambda one: -one[0])
    kept = tuple(frame for _, pair in apart[:MOST_HOLDS] for frame in pair)
    return HeldFrames(kept, fall_sd / abs(scale) if scale else np.inf)


def who_yields(
    relaxation: Relaxation,
    held: HeldFrames,
    log_read: Floats,
    log_sd: Floats,
) -> Relaxation:
    """Return what frames of one hold decide, from ln of the forces that their dents
    show, (frame,), and the standard deviations of these.

    Within a hold ln of a dent's force is a line in ln F, whose slope is the needle's
    part of the fall: 1 if the dent follows the force, 0 if it stays. The scatter about
    the line counts if it is larger than expected.
    """
    frames = held.frames
    holds = [frame.hold for frame in frames]
    counted = np.array([holds.count(hold) >= FRAMES_OF_HOLD for hold in holds])
    if not counted.any():
        return relaxation

    _, group = np.unique(np.array(holds)[counted], return_inverse=True)
    size = np.bincount(group)
    x, y = (
        values[counted] - (np.bincount(group, values[counted]) / size)[group]
        for values in (np.array([frame.log_force for frame in frames]), log_read)
    )
    spread = float(x @ x)
    if not spread > 0.0:
        return relaxation

    slope = float(x @ y) / spread
    freedom = len(x) - len(size) - 1
    variance = float(np.mean(log_sd[counted] ** 2))
    if freedom > 0:
        rest = y - slope * x
        variance = max(variance, float(rest @ rest) / freedom)

    sd = max(
        float(np.hypot(np.sqrt(variance / spread), slope * held.fall_sd)), LEAST_SD
    )
    return _decided(relaxation, 1.0 - slope, sd, len(x))


def _decided(
    relaxation: Relaxation, share: float, sd: float, frames: int
) -> Relaxation:
    """Return a relaxation whose `share` of a fall is the tissue's, by frames."""
    assert relaxation.finding is not None
    elastic = share <= AGREED * sd
    relaxes = share >= 1.0 - AGREED * sd
    finding = replace(
        relaxation.finding, frames=frames, tissue_share=share, tissue_share_sd=sd
    )
    if elastic and relaxes:
        return replace(relaxation, finding=finding)

    part = 0.0 if elastic else 1.0 if relaxes else float(np.clip(share, 0.0, 1.0))
    shares = np.array(tissue_shares(relaxation))
    covariance = part**2 * np.array(relaxation.covariance)
    if _without_memory(finding):
        covariance /= LEAST_CHANCE
    if part > 0.0:
        covariance = covariance + np.outer(shares, shares) * sd**2

    return replace(
        relaxation,
        shares=tuple((part * shares).tolist()),
        covariance=matrix_rows(covariance),
        other=(),
        finding=replace(
            finding, cause="needle" if elastic else "tissue" if relaxes else "both"
        ),
    )


def doubted_by_dents(
    relaxation: Relaxation,
    log: HoldLog,
    since_s: Floats,
    log_read: Floats,
    log_sd: Floats,
) -> Relaxation:
    """Return the relaxation with both explanations open, if the log decides for one and
    the dents of frames contradict it; else unchanged.

    `log_read` (frame,) are ln of the forces that the dents show at times `since_s`
    after the log's beginning, `log_sd` their standard deviations. Up to a common factor
    these forces are the log's elastic ones if the tissue yields, and the log's own if
    the needle does. Shares of time constants too long for the holds are unknown: the
    tissue's likelihood is the mean over those of other tissue. Dents never decide:
    their readings share errors that the likelihoods do not contain.
    """
    finding = relaxation.finding
    shares = np.array(tissue_shares(relaxation))
    if finding is None or not log_is_sure(finding) or not shares.any():
        return relaxation
    if not len(log_read):
        return relaxation

    assert finding.chance is not None
    hidden = np.isin(TIMES_S, finding.not_estimated_s)
    candidates = shares + np.outer(HIDDEN, np.where(hidden, PRIOR_SD, 0.0))
    elastic_n, _ = log.elastic(candidates)
    at = log.frames(since_s)
    noise_n = np.sqrt(log.noise_variance(log.holds))
    sd = np.hypot(np.hypot(log_sd, LEAST_SD), noise_n / log.felt_n[at])
    by_tissue = _likelihoods(log_read - np.log(elastic_n[:, at]), sd)
    by_needle = _likelihoods(log_read - np.log(log.felt_n[None, at]), sd)
    gain = float(np.log(HIDDEN_WEIGHTS @ by_tissue) - np.log(by_needle[0]))

    chances = np.array([finding.chance, 1.0 - finding.chance])
    log_odds = -float(np.diff(np.log(np.maximum(chances, LEAST_ODDS)))[0])
    chance = _chance(log_odds + gain)
    chances_of_tissue = finding.chance, chance
    if min(chances_of_tissue) >= REMEMBERED or max(chances_of_tissue) <= FORGOTTEN:
        return relaxation

    covariance = np.array(relaxation.covariance)
    if _without_memory(finding):
        covariance = covariance / LEAST_CHANCE
    return _undecided(shares, covariance, replace(finding, chance=0.5))


def log_is_sure(finding: HoldFinding) -> bool:
    """Return whether a log decides by itself if pushes are remembered."""
    chance = finding.chance
    return chance is not None and (chance >= REMEMBERED or chance <= FORGOTTEN)


def _chance(log_odds: float) -> float:
    return 1.0 / (1.0 + float(np.exp(-np.clip(log_odds, -50.0, 50.0))))


def _likelihoods(values: Floats, sd: Floats) -> Floats:
    """Return the likelihoods (candidate,) of values (candidate, frame) about a mean of
    their own.
    """
    weights = sd**-2
    means = values @ weights / weights.sum()
    squares = (values - means[:, None]) ** 2 @ weights
    return np.exp(-0.5 * np.minimum(squares, MOST_SQUARES))


def tissue_shares(relaxation: Relaxation) -> tuple[float, ...]:
    """Return the shares of an undecided relaxation if the tissue yields: those that the
    holds show.
    """
    finding = relaxation.finding
    hidden = () if finding is None else finding.not_estimated_s
    shares = relaxation.shares if any(relaxation.shares) else relaxation.other
    each = zip(shares, relaxation.times_s, strict=True)
    return tuple(0.0 if time_s in hidden else share for share, time_s in each)


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
