"""The force under each frame of a recording, from its force log.

The log is noisy and stepped, so: contact force (sign times axis) -> zero-phase low-pass -> minus the tare, the mean
before the first contact -> mean over `average_s` centred on the frame -> class. Samples without a force (NaN) are gaps
of the log; a frame whose window has one, or too few samples, has no label.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import RecordingError
from scleraforce.recording.files import Recording
from scleraforce.recording.info import ForceInfo
from scleraforce.recording.tables import GOOD_SAMPLE_RATE_HZ, ForceLog, FrameEntry
from scleraforce.study import ClassesStudy
from scleraforce.units import from_si

Samples = NDArray[np.float64]

# A push by hand or robot takes 0.2 s or more; above 5 Hz lie the sensor's noise and the robot's vibration.
CUTOFF_HZ = 5.0
BLOCK_S = 0.1  # step of the search for the first contact
AFTER_S = 1.0  # how long a rise must stay to count as contact
LEAST_RISE_N = 1e-3  # a fifth of the lowest class bound
SIGNIFICANCE = 5.0  # standard errors
GUARD_S = 0.1  # left out before the contact
LONGEST_GAP_S = 1.0 / CUTOFF_HZ  # the filter knows nothing across a longer one
# In N no log has what a log in mN has. Sensors that tell the classes apart have 3 to 30 mN of noise, and no needle is
# pushed by a hundred times the highest class bound (3 N in the paper's study; the sclera gives way at about 1 N).
LARGEST_NOISE_N = 0.3
LARGEST_FORCE_BOUNDS = 100.0


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A frame with its label: force in N and class (both None where the log has no force around it).

    `excluded` says why an evaluation must leave the trial out, and is None where it counts.
    """

    file: str
    time_s: float
    measured_force_n: float | None
    target: int | None
    excluded: str | None = None


def label_frames(recording: Recording, classes: ClassesStudy, max_force_n: float | None = None) -> tuple[Trial, ...]:
    """Label every frame of a recording, in its order.

    Args:
        recording: the recording.
        classes: the bounds of the force classes.
        max_force_n: trials above it are marked as excluded (the paper's 60 mN, sec. 3.1); None: no limit.

    Raises:
        RecordingError: no frame has force samples around it, the forces cannot be in N,
            or a frame that is not pierced is pulled by more than the lowest class bound (wrong sign, or a log that
            starts in contact).
    """
    log, info = recording.forces, recording.info.force
    if log is None or info is None:
        return tuple(_unlabelled(frame, None) for frame in recording.frames)
    force_n = contact_force(log, info)
    windows = [_samples_around(log, force_n, frame.time_s, info.average_s) for frame in recording.frames]
    labels_n = [None if isinstance(window, str) else float(force_n[window].mean()) for window in windows]
    if all(label_n is None for label_n in labels_n):
        raise _no_label(recording, log, str(windows[0]))
    _check_unit(recording, log.force_n(info.axis), labels_n, classes)
    return tuple(
        _unlabelled(frame, str(window)) if label_n is None else _trial(recording, frame, label_n, classes, max_force_n)
        for frame, label_n, window in zip(recording.frames, labels_n, windows, strict=True)
    )


def label_notes(recording: Recording, trials: Sequence[Trial]) -> tuple[str, ...]:
    """Return sentences on what the force log leaves open: samples without a force, a low rate, frames without a label.

    Args:
        recording: the recording.
        trials: its frames, labelled.
    """
    if recording.forces is None:
        return ()
    without = [trial for trial in trials if trial.measured_force_n is None]
    if not without:
        return recording.forces.notes
    reason = f"{without[0].file}: {without[0].excluded}"
    return (
        *recording.forces.notes,
        f"{len(without)} of {len(trials)} frames have no label and are left out ({reason})",
    )


def _unlabelled(frame: FrameEntry, reason: str | None) -> Trial:
    excluded = "pierced" if frame.pierced else reason
    return Trial(file=frame.file, time_s=frame.time_s, measured_force_n=None, target=None, excluded=excluded)


def _check_unit(recording: Recording, raw_n: Samples, labels_n: Sequence[float | None], classes: ClassesStudy) -> None:
    """Refuse forces that cannot be in N: by the labels, and by the sensor's noise.

    The noise is taken from the mean difference of neighbours, in which neither pushes nor a few knocks matter.
    """
    largest_n = LARGEST_FORCE_BOUNDS * classes.bounds_n[-1]
    sizes_n = np.abs([0.0 if label_n is None else label_n for label_n in labels_n])
    peak = int(np.argmax(sizes_n))
    noise_n = float(np.abs(np.diff(raw_n[np.isfinite(raw_n)])).mean()) * np.sqrt(np.pi) / 2.0
    if sizes_n[peak] > largest_n:
        found = f"{sizes_n[peak]:.4g} N under {recording.frames[peak].file}, more than {largest_n:.4g} N"
    elif noise_n > LARGEST_NOISE_N:
        found = f"a noise of {noise_n:.2g} N, more than the {from_si(LARGEST_NOISE_N, 'mn'):g} mN of a coarse sensor"
    else:
        return
    axis = "" if recording.info.force is None else f": {recording.info.force.axis}_n"
    raise RecordingError(
        f"{recording.path / 'forces.csv'}{axis}: {found}; the columns are in N: multiply forces in mN by 0.001, "
        "in gram-force by 0.00981"
    )


def _trial(
    recording: Recording, frame: FrameEntry, force_n: float, classes: ClassesStudy, max_force_n: float | None
) -> Trial:
    if force_n < -classes.bounds_n[0] and not frame.pierced:
        raise RecordingError(
            f"{recording.path / 'forces.csv'}: the needle would pull with {-from_si(force_n, 'mn'):.1f} mN at the time "
            f"of {frame.file}, {frame.time_s:g} s; check contact_sign, and that the log starts before the first contact"
        )
    excluded = "pierced" if frame.pierced else None
    if max_force_n is not None and force_n > max_force_n:
        excluded = excluded or f"above the largest force of the study, {from_si(max_force_n, 'mn'):g} mN"
    return Trial(
        file=frame.file,
        time_s=frame.time_s,
        measured_force_n=force_n,
        target=classes.classify(force_n),
        excluded=excluded,
    )


def contact_force(log: ForceLog, info: ForceInfo) -> Samples:
    """Return the filtered and tared contact force at each sample of a log, in N, shape (samples,).

    It is NaN where the log has no force. The tare is one value, from before the first contact: what the sensor drifts
    after that stays in the force.
    """
    every_n = info.contact_sign * log.force_n(info.axis)
    known = np.isfinite(every_n)
    raw_n = every_n[known]
    if not len(raw_n):
        return every_n
    contact = first_contact(raw_n, log.sample_rate_hz)
    guard = round(GUARD_S * log.sample_rate_hz)
    before = len(raw_n) if contact is None else max(contact - guard, (contact + 1) // 2)
    tare_n = float(raw_n[:before].mean())
    every_n[known] = low_pass(raw_n, log.time_s[known]) - tare_n
    return every_n


def low_pass(force_n: Samples, time_s: Samples) -> Samples:
    """Return a force freed of what is faster than 5 Hz, without delay, shape (samples,).

    A Butterworth filter of order 2, run forward and backward (Gustafsson 1996), on an even clock: half the amplitude
    passes at 5 Hz; a step is followed within 0.1 s and overshoots by 4 %. Where the clock jitters, samples are
    interpolated to its mean rate and back. What gaps of more than 0.2 s part is filtered on its own, so that the work
    grows with the samples and not with the time that they span.
    """
    breaks = np.flatnonzero(np.diff(time_s) > LONGEST_GAP_S) + 1
    parts = zip(np.split(force_n, breaks), np.split(time_s, breaks), strict=True)
    return np.concatenate([_low_pass(part_n, part_s) for part_n, part_s in parts])


def _low_pass(force_n: Samples, time_s: Samples) -> Samples:
    """Filter samples without a long gap."""
    from scipy import signal  # half a second, which who only reads frames does not wait for

    span_s = float(time_s[-1] - time_s[0])
    if span_s < LONGEST_GAP_S / 4.0:
        return np.full_like(force_n, force_n.mean())
    # Sparse samples among short gaps are taken to a clock on which the filter exists: 20 for each sample at most.
    steps = max(len(time_s) - 1, round(span_s * GOOD_SAMPLE_RATE_HZ))
    rate_hz = steps / span_s
    even_s = time_s[0] + np.arange(steps + 1) / rate_hz
    sections = signal.butter(2, CUTOFF_HZ, fs=rate_hz, output="sos")
    even_n = np.interp(even_s, time_s, force_n)
    reach = min(round(3 * rate_hz / CUTOFF_HZ), len(even_n) - 1)
    smooth_n = signal.sosfiltfilt(sections, even_n, padtype="even", padlen=reach)
    return np.asarray(np.interp(time_s, even_s, smooth_n), dtype=np.float64)


def first_contact(force_n: Samples, rate_hz: float) -> int | None:
    """Return the sample at which the first contact begins, or None where there is no contact.

    Contact is the first rise of the mean that is large (1 mN) and certain (5 standard errors of the noise, which is
    taken from the differences of neighbours), and that stays for a second: the mean of a second against the mean of all
    that came before. Means see a rise below the 5 mN of a sensor step, because the noise dithers it. The beginning is
    then where a level followed by a straight line fits the samples best. A first touch of less than about 1.5 mN is not
    told from the noise: it goes into the tare.
    """
    block = max(round(BLOCK_S * rate_hz), 1)
    after = round(AFTER_S * rate_hz)
    starts = np.arange(2 * block, len(force_n) - after + 1, block)
    if not len(starts):
        return None
    total = np.concatenate([[0.0], np.cumsum(force_n)])
    rise_n = (total[starts + after] - total[starts]) / after - total[starts] / starts
    noise_n = float(np.diff(force_n).std()) / np.sqrt(2.0)
    sure = rise_n > np.maximum(LEAST_RISE_N, SIGNIFICANCE * noise_n * np.sqrt(1.0 / after + 1.0 / starts))
    if not sure.any():
        return None
    start = int(starts[int(np.argmax(sure))])
    begin = max(start - 10 * after, 0)  # what came before pins the level
    earliest = max(start - after // 2, start // 2) - begin  # a slow push may begin before its rise is certain
    return begin + _begin_of_rise(force_n[begin : start + after], earliest, max(block // 10, 1))


def _begin_of_rise(force_n: Samples, earliest: int, step: int) -> int:
    """Return the knee of the level followed by a straight line that fits the samples best (least squares)."""
    sample = np.arange(len(force_n), dtype=np.float64)
    knees = np.arange(earliest, len(force_n) - step, step)
    explained = []
    for knee in knees:  # one at a time: all of them take a gigabyte where a log is fast
        ramp = np.maximum(sample - knee, 0.0)
        ramp -= ramp.mean()
        explained.append((ramp @ force_n) ** 2 / (ramp @ ramp))
    return int(knees[int(np.argmax(explained))])


def _no_label(recording: Recording, log: ForceLog, reason: str) -> RecordingError:
    """Return what to say of a recording none of whose frames has a label; `reason` is that of the first frame."""
    first, last = recording.frames[0], recording.frames[-1]
    if last.time_s < log.time_s[0] or first.time_s > log.time_s[-1]:
        return RecordingError(
            f"{recording.path}: the clocks do not overlap: frames.csv has {first.time_s:g} to {last.time_s:g} s, "
            f"forces.csv {log.time_s[0]:g} to {log.time_s[-1]:g} s; bring both to one clock"
        )
    return RecordingError(
        f"{recording.path / 'frames.csv'}: no frame has a label; {first.file}: {reason}; forces.csv spans "
        f"{log.time_s[0]:g} to {log.time_s[-1]:g} s"
    )


def _samples_around(log: ForceLog, force_n: Samples, time_s: float, average_s: float) -> slice | str:
    """Return the samples of a frame's window, or why it has no label.

    At the ends of the log, half of the window is enough, with samples on both sides of the frame.
    """
    start, middle, stop = np.searchsorted(log.time_s, [time_s - average_s / 2, time_s, time_s + average_s / 2 + 1e-9])
    expected = average_s * log.sample_rate_hz
    if middle in (start, stop) or stop - start < expected / 2 - 1e-6:  # its clock is rounded
        return (
            f"{stop - start} force samples within {average_s / 2:g} s of its time {time_s:g} s, about "
            f"{expected:.0f} are needed"
        )
    missing = int(np.isnan(force_n[start:stop]).sum())
    if missing:
        return f"{missing} of the {stop - start} force samples around it are no forces"
    return slice(int(start), int(stop))
