"""Whether a force log goes with its frames: the axis along the needle, and one clock for both.

What the frames show is a number for each that goes with the force, on any scale (a force that was read, a class, the
depth of a dent): a curve of the log's forces is laid through it, so neither an eye's modulus nor a model's error of
scale matters. How much of it the curve leaves over is compared for the stated times and for shifted ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.files import Recording
from scleraforce.recording.info import ForceInfo
from scleraforce.recording.labels import contact_force
from scleraforce.recording.tables import ForceLog
from scleraforce.study import ClassesStudy
from scleraforce.units import from_si

Array = NDArray[np.float64]

CROSS_FORCE = 2.0  # a needle that is pushed along its axis has no more than that share of the force across it
OTHER_SIZE = 3.0  # moduli of the training differ by less from the middle of their range
LEAST_FRAMES = 6  # a curve of three coefficients goes through fewer whatever they show
MOST_FRAMES = 50  # frames of a film are no independent witnesses: evenly chosen ones are enough
RELATED = 4.6  # gain of log likelihood of a curve over none that chance gives once in a hundred times (chi square, 2)
BETTER = 10.0  # the same of a shift over the stated times; chance gives about 7 where 12 frames try 240 shifts
FARTHEST_S, STEP_S, LEAST_SHIFT_S = 60.0, 0.5, 1.0  # of the frames' times, in the search for a shift
LEAST_SCATTER = 1e-3  # of the variance: what reading and label leave over at best
LEAST_VARIANCE_M2 = (1e-9) ** 2  # of what frames show: where all show the same, no shift fits better
LEAST_SHARE = 0.75  # of the frames that must lie on the log under a shift


def log_doubts(
    recording: Recording, classes: ClassesStudy, shown: Sequence[float | None], in_newtons: bool = False
) -> tuple[str, ...]:
    """Return sentences on a log that does not go with its frames.

    Args:
        recording: the recording; one without a log gives no doubt.
        classes: forces within their lowest bound of one another say nothing.
        shown: what each frame shows of the force, in any unit; None or NaN where it shows nothing.
        in_newtons: whether `shown` is a force in N, so that its size can be compared as well.
    """
    doubt = axis_doubt(recording, classes)
    if doubt or recording.forces is None or recording.info.force is None:
        return (doubt,) if doubt else ()
    values = np.array([np.nan if value is None else value for value in shown], dtype=np.float64)
    seen = np.flatnonzero(np.isfinite(values))
    if len(seen) > MOST_FRAMES:
        seen = seen[np.linspace(0, len(seen) - 1, MOST_FRAMES).astype(np.intp)]
    times_s = np.array([frame.time_s for frame in recording.frames])[seen]
    means = _Means.of(recording.forces, recording.info.force)
    stated_n = means.around(times_s)
    known = np.isfinite(stated_n)
    times_s, values, stated_n = times_s[known], values[seen][known], stated_n[known]
    doubt = _size_doubt(stated_n, values, classes) if in_newtons else None
    if doubt:
        return (doubt,)
    if len(stated_n) < LEAST_FRAMES or np.ptp(values) == 0.0:
        return ()
    shift_s, gain = _best_shift(means, times_s, values)
    if gain > BETTER:
        return (
            f"the frames' times are off: what the frames show goes with forces.csv as if they had been taken about "
            f"{abs(shift_s):g} s {'later' if shift_s > 0 else 'earlier'} than frames.csv says; bring both to one clock",
        )
    varied = np.ptp(stated_n) > classes.bounds_n[0]
    if varied and _likelihood(stated_n, values) - _likelihood(np.zeros_like(stated_n), values) < RELATED:
        return ("forces.csv has nothing to do with what the frames show; check that both are of one session, and "
                "their clocks",)  # fmt: skip
    return ()


def _size_doubt(stated_n: Array, read_n: Array, classes: ClassesStudy) -> str | None:
    """Return a sentence where the log's forces are far smaller or larger than those that the frames show."""
    pushed = np.maximum(read_n, stated_n) > classes.bounds_n[0]
    if pushed.sum() < LEAST_FRAMES // 2:
        return None
    ratio = float(np.median(stated_n[pushed] / np.maximum(read_n[pushed], 1e-6)))
    if 1.0 / OTHER_SIZE < ratio < OTHER_SIZE:
        return None
    return (
        f"forces.csv has {max(ratio, 0.0):.2g} times the force that the frames show, in the median: check its unit "
        "(N), the [force] axis, that frames.csv and forces.csv have one clock, and what is known of the eye"
    )


def axis_doubt(recording: Recording, classes: ClassesStudy) -> str | None:
    """Return a sentence where the log has more force across the stated axis than along it, None where it has not."""
    log, info = recording.forces, recording.info.force
    if log is None or info is None:
        return None
    times_s = np.array([frame.time_s for frame in recording.frames])
    axes = [axis for axis in ("fx", "fy", "fz") if f"{axis}_n" in log.columns and np.isfinite(log.force_n(axis)).any()]
    peaks_n = {
        axis: float(np.nanmax(np.abs(_Means.of(log, replace(info, axis=axis)).around(times_s)), initial=0.0))
        for axis in axes
    }
    largest = max(axes, key=peaks_n.__getitem__)
    if peaks_n[largest] <= CROSS_FORCE * max(peaks_n[info.axis], classes.bounds_n[0]):
        return None
    return (
        f"forces.csv has up to {from_si(peaks_n[largest], 'mn'):.1f} mN along {largest} under the frames, but "
        f"{from_si(peaks_n[info.axis], 'mn'):.1f} mN along {info.axis}: check [force] axis, which is that "
        "along the needle"
    )


@dataclass(frozen=True, eq=False)
class _Means:
    """Means of the contact force over the label's window, at any time."""

    time_s: Array
    total: Array
    half_s: float

    @classmethod
    def of(cls, log: ForceLog, info: ForceInfo) -> "_Means":
        log = log.known(info.axis)
        return cls(log.time_s, np.concatenate([[0.0], np.cumsum(contact_force(log, info))]), info.average_s / 2)

    def around(self, times_s: Array) -> Array:
        """Return the means (time,), NaN where there are no samples."""
        start, stop = (np.searchsorted(self.time_s, times_s + side * self.half_s) for side in (-1.0, 1.0))
        count = np.where(stop > start, stop - start, 1)
        return np.where(stop > start, (self.total[stop] - self.total[start]) / count, np.nan)


def _best_shift(means: _Means, times_s: Array, shown: Array) -> tuple[float, float]:
    """Return the shift of the frames' times under which the log goes best with them, and what it gains in likelihood.

    Frames that a shift moves off the log do not count there, nor in what it is compared with.
    """
    shift_s, best = 0.0, 0.0
    stated_n = means.around(times_s)
    for candidate_s in np.arange(-FARTHEST_S, FARTHEST_S + STEP_S / 2, STEP_S).tolist():
        force_n = means.around(times_s + candidate_s)
        kept = np.isfinite(force_n)
        if abs(candidate_s) < LEAST_SHIFT_S or kept.sum() < max(LEAST_SHARE * len(kept), LEAST_FRAMES):
            continue
        gain = _likelihood(force_n[kept], shown[kept]) - _likelihood(stated_n[kept], shown[kept])
        if gain > best:
            shift_s, best = candidate_s, gain
    return shift_s, best


def _likelihood(force_n: Array, shown: Array) -> float:
    """Return the log likelihood of what frames show, as a parabola of the force with Gaussian scatter of any size."""
    scaled = force_n / max(float(np.abs(force_n).max()), 1e-12)
    design = np.stack([np.ones_like(scaled), scaled, scaled**2], axis=1)
    rest = shown - design @ np.linalg.lstsq(design, shown, rcond=None)[0]
    return -0.5 * len(shown) * float(np.log(rest.var() / max(shown.var(), LEAST_VARIANCE_M2) + LEAST_SCATTER))
