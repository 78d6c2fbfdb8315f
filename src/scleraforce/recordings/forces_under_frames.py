"""The force under each frame of a recording, from its force log, whether log and frames
agree, and punctures.

The log is noisy and stepped, so: contact force (sign times axis) -> zero-phase low-pass
-> minus the tare, the mean before the first contact -> mean over `average_s` centred on
the frame -> class. Floats without a force (NaN) are gaps of the log; a frame with a gap
or too few samples in its window has no label.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import pi, tan

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import RecordingError
from scleraforce.base.units import from_si
from scleraforce.recordings import clock_offsets
from scleraforce.recordings.frame_and_force_tables import (
    GOOD_SAMPLE_RATE_HZ,
    ForceLog,
    FrameEntry,
)
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.recording_info import ForceInfo
from scleraforce.records.remark import Remark
from scleraforce.records.study import ClassesStudy

# A push by hand or robot takes 0.2 s or more; above 5 Hz lie the sensor's noise and the
# robot's vibration.
CUTOFF_HZ = 5.0
BLOCK_S = 0.1  # step of the search for the first contact
AFTER_S = 1.0  # how long a rise must stay to count as contact
LEAST_RISE_N = 1e-3  # a fifth of the lowest class bound
SIGNIFICANCE = 5.0  # standard errors
GUARD_S = 0.1  # left out before the contact
LEAST_TARE_S = (
    0.5  # behind samples without a force; 0.6 mN of a noise of 4 mN at 100 Hz
)
LONGEST_GAP_S = 1.0 / CUTOFF_HZ  # the filter knows nothing across a longer one
# In N no log has what a log in mN has. Sensors that tell the classes apart have 3 to 30
# mN of noise, and no needle is pushed by a hundred times the highest class bound (3 N
# in the paper's study; the sclera gives way at about 1 N).
LARGEST_NOISE_N = 0.3
LARGEST_FORCE_BOUNDS = 100.0
UNSURE = 0.2  # of the lowest class bound: a label that is less sure is worth a note


@dataclass(frozen=True, kw_only=True)
class Trial:
    """A frame with its label: force in N and class, both None if the log has no force
    around it.

    `excluded` says why an evaluation must leave the trial out; None if it counts.
    """

    file: str
    time_s: float
    measured_force_n: float | None
    target: int | None
    excluded: str | None = None


def label_frames(
    recording: Recording, classes: ClassesStudy, max_force_n: float | None = None
) -> tuple[Trial, ...]:
    """Label every frame of a recording, in its order; trials above `max_force_n` are
    marked as excluded.

    Raises:
        RecordingError: no frame has force samples around it, the forces cannot be in N,
            samples without a force leave no tare, or a frame that is not pierced is
            pulled by more than the lowest class bound (wrong sign, or a log that starts
            in contact).
    """
    labels = labels_n(recording)
    if (fault := _tare_fault(recording, classes)) is not None:
        raise RecordingError(f"{recording.path / 'forces.csv'}: {fault}")
    if recording.forces is not None and all(isinstance(label, str) for label in labels):
        raise _no_label(recording, recording.forces, str(labels[0]))
    if (fault := unit_fault(recording, labels, classes)) is not None:
        way = (
            "the columns are in N: multiply forces in mN by 0.001, in gram-force by"
            " 0.00981"
        )
        raise RecordingError(f"{recording.path / 'forces.csv'}: {fault}; {way}")

    each = zip(recording.frames, labels, strict=True)
    return tuple(
        _trial(recording, frame, label, classes, max_force_n) for frame, label in each
    )


def labels_n(recording: Recording) -> Sequence[float | str | None]:
    """Return the force under each frame in N, or why it has none; None without a
    log.
    """
    log = recording.forces
    info = recording.info.force
    if log is None or info is None:
        return [None] * len(recording.frames)

    force_n = contact_force(log, info)
    windows = [
        _samples_around(log, force_n, frame.time_s, info.average_s)
        for frame in recording.frames
    ]

    return [
        window if isinstance(window, str) else float(force_n[window].mean())
        for window in windows
    ]


def label_remarks(recording: Recording, trials: Sequence[Trial]) -> tuple[Remark, ...]:
    """Return remarks on gaps of the force log: samples without a force, a low rate,
    frames without a label.
    """
    if recording.forces is None:
        return ()

    without = [trial for trial in trials if trial.measured_force_n is None]
    lost = [f"{each.file}: {each.excluded}" for each in without[:1]]
    sentences = (
        f"{len(without)} of {len(trials)} frames have no label and are left out"
        f" ({reason})"
        for reason in lost
    )
    unlabelled = (Remark(WITHOUT_LABEL, words) for words in sentences)

    return *recording.forces.remarks, *unlabelled


def unsure_remark(sds_n: Sequence[float], classes: ClassesStudy) -> tuple[Remark, ...]:
    """Return a remark if labels are less sure than a fifth of the lowest class bound,
    in the median of their standard deviations, N.
    """
    median_n = float(np.median(sds_n)) if sds_n else 0.0
    if median_n <= UNSURE * classes.bounds_n[0]:
        return ()

    words = (
        f"the labels are sure to {from_si(median_n, 'mn'):.2f} mN (standard deviation,"
        " median): the force changes while it is averaged; are the clocks one, or is"
        " average_s too long for a moving needle?"
    )
    return (Remark("labels-unsure", words, ("average_s",)),)


def unit_fault(
    recording: Recording, labels: Sequence[float | str | None], classes: ClassesStudy
) -> str | None:
    """Return why forces cannot be in N: by the labels, and by the sensor's noise; None
    if they can.

    The noise is taken from the mean difference of neighbours, on which pushes and a few
    knocks have no effect.
    """
    log = recording.forces
    info = recording.info.force
    if log is None or info is None:
        return None

    largest_n = LARGEST_FORCE_BOUNDS * classes.bounds_n[-1]
    sizes_n = np.abs([label if isinstance(label, float) else 0.0 for label in labels])
    raw_n = log.known(info.axis).force_n(info.axis)
    peak = int(np.argmax(sizes_n))
    noise_n = (
        float(np.abs(np.diff(raw_n)).mean()) * np.sqrt(np.pi) / 2.0
        if len(raw_n) > 1
        else 0.0
    )

    if sizes_n[peak] > largest_n:
        under = f"under {recording.frames[peak].file}, more than {largest_n:.4g} N"
        return f"{info.axis}_n: {sizes_n[peak]:.4g} N {under}"

    coarse = f"more than the {from_si(LARGEST_NOISE_N, 'mn'):g} mN of a coarse sensor"
    return (
        f"{info.axis}_n: a noise of {noise_n:.2g} N, {coarse}"
        if noise_n > LARGEST_NOISE_N
        else None
    )


def _tare_fault(recording: Recording, classes: ClassesStudy) -> str | None:
    """Return why a log without forces in its beginning has no tare, None if it has
    one.
    """
    log = recording.forces
    info = recording.info.force
    if log is None or info is None:
        return None

    places = np.flatnonzero(np.isfinite(log.force_n(info.axis)))
    missing_s = places[:1].sum() / log.sample_rate_hz
    if missing_s < LEAST_TARE_S:
        return None

    raw_n = info.contact_sign * log.force_n(info.axis)[places]
    count = tare_samples(raw_n, log.sample_rate_hz)
    tare_s = count / log.sample_rate_hz
    before = f"the first {missing_s:.3g} s have no force"
    way = "record a sensor that works before the first contact"
    if tare_s < LEAST_TARE_S:
        return (
            f"{before}, and {tare_s:.2g} s are left for the tare, of"
            f" {LEAST_TARE_S:g} s at least; {way}"
        )

    second = min(max(round(AFTER_S * log.sample_rate_hz), 1), len(raw_n))
    total_n = np.concatenate([[0.0], np.cumsum(raw_n - raw_n[:count].mean())])
    lowest_n = float((total_n[second:] - total_n[:-second]).min()) / second
    if lowest_n >= -classes.bounds_n[0]:
        return None

    fall = f"{-from_si(lowest_n, 'mn'):.1f} mN below the tare after them"
    return f"{before}, and it falls to {fall}, which was in contact; {way}"


def _trial(
    recording: Recording,
    frame: FrameEntry,
    label: float | str | None,
    classes: ClassesStudy,
    max_force_n: float | None,
) -> Trial:
    force_n, reason = (label, None) if isinstance(label, float) else (None, label)
    if force_n is not None and force_n < -classes.bounds_n[0] and not frame.pierced:
        found = (
            f"would pull with {-from_si(force_n, 'mn'):.1f} mN at the time of"
            f" {frame.file}, {frame.time_s:g} s"
        )
        way = "check contact_sign, and that the log starts before the first contact"
        raise RecordingError(
            f"{recording.path / 'forces.csv'}: the needle {found}; {way}"
        )

    if force_n is not None and max_force_n is not None and force_n > max_force_n:
        reason = (
            f"above the largest force of the study, {from_si(max_force_n, 'mn'):g} mN"
        )

    target = None if force_n is None else classes.classify(force_n)
    excluded = "pierced" if frame.pierced else reason
    return Trial(
        file=frame.file,
        time_s=frame.time_s,
        measured_force_n=force_n,
        target=target,
        excluded=excluded,
    )


def contact_force(log: ForceLog, info: ForceInfo) -> Floats:
    """Return the filtered and tared contact force at each sample of a log, in N, shape
    (samples,), NaN in gaps.

    The tare is one value, before the first contact: later drift of the sensor stays in
    the force.
    """
    every_n = info.contact_sign * log.force_n(info.axis)
    known = np.isfinite(every_n)
    raw_n = every_n[known]
    if not len(raw_n):
        return every_n

    every_n[known] = (
        low_pass(raw_n, log.time_s[known])
        - raw_n[: tare_samples(raw_n, log.sample_rate_hz)].mean()
    )
    return every_n


def tare_samples(raw_n: Floats, rate_hz: float) -> int:
    """Return the number of samples, from the first, whose mean is the tare: all before
    the first contact.
    """
    contact = first_contact(raw_n, rate_hz)
    return (
        len(raw_n)
        if contact is None
        else max(contact - round(GUARD_S * rate_hz), (contact + 1) // 2)
    )


def low_pass(force_n: Floats, time_s: Floats) -> Floats:
    """Return a force without components above 5 Hz and without delay, shape (samples,).

    A Butterworth filter of order 2, forward and backward, on an even clock: half the
    amplitude passes at 5 Hz; a step is followed within 0.1 s and overshoots by 4 %. If
    the clock jitters, samples are interpolated to its mean rate and back. Parts between
    gaps of more than 0.2 s are filtered separately, so that the work grows with the
    samples and not with the time that they span.
    """
    breaks = np.flatnonzero(np.diff(time_s) > LONGEST_GAP_S) + 1
    parts = zip(np.split(force_n, breaks), np.split(time_s, breaks), strict=True)
    return np.concatenate([_low_pass(part_n, part_s) for part_n, part_s in parts])


def _low_pass(force_n: Floats, time_s: Floats) -> Floats:
    span_s = float(time_s[-1] - time_s[0])
    if span_s < LONGEST_GAP_S / 4.0:
        return np.full_like(force_n, force_n.mean())

    # Sparse samples among short gaps are taken to a clock on which the filter exists:
    # 20 for each sample at most.
    steps = max(len(time_s) - 1, round(span_s * GOOD_SAMPLE_RATE_HZ))
    rate_hz = steps / span_s
    even_s = time_s[0] + np.arange(steps + 1) / rate_hz
    smooth_n = low_passed(np.interp(even_s, time_s, force_n), CUTOFF_HZ / rate_hz)

    return np.asarray(np.interp(time_s, even_s, smooth_n), dtype=np.float64)


def low_passed(values: Floats, cutoff: float) -> Floats:
    """Return evenly sampled values without delay; half the amplitude passes at
    `cutoff`, in cycles a sample.

    The gain of both runs is 1 / (1 + (tan(pi f) / tan(pi cutoff))^4), by the bilinear
    transform. Beyond its ends a series is mirrored; six periods of the cutoff are
    enough for its two ends not to see each other.
    """
    reach = round(6.0 / cutoff)
    size = 1 << (len(values) + 2 * reach).bit_length()
    whole = np.pad(values, (reach, size - reach - len(values)), mode="reflect")
    gain = 1.0 / (1.0 + (np.tan(pi * np.fft.rfftfreq(size)) / tan(pi * cutoff)) ** 4)
    return np.fft.irfft(np.fft.rfft(whole) * gain, size)[reach : reach + len(values)]


def first_contact(force_n: Floats, rate_hz: float) -> int | None:
    """Return the sample at which the first contact begins, or None without contact.

    Contact is the first rise of the mean that is large (1 mN) and certain (5 standard
    errors of the noise, which is taken from the differences of neighbours), and that
    stays for a second: the mean of a second against the mean of all earlier samples.
    Means see a rise below the 5 mN of a sensor step, because the noise dithers it. The
    beginning is then the knee of a level and a straight line that fit the samples best.
    A first touch of less than about 1.5 mN is not distinguished from the noise: it goes
    into the tare.
    """
    block = max(round(BLOCK_S * rate_hz), 1)
    after = round(AFTER_S * rate_hz)
    starts = np.arange(2 * block, len(force_n) - after + 1, block)
    total = np.concatenate([[0.0], np.cumsum(force_n)])
    rise_n = (total[starts + after] - total[starts]) / after - total[starts] / starts
    noise_n = float(np.diff(force_n).std()) / np.sqrt(2.0) if len(starts) else 0.0

    sure = rise_n > np.maximum(
        LEAST_RISE_N, SIGNIFICANCE * noise_n * np.sqrt(1.0 / after + 1.0 / starts)
    )
    if not sure.any():
        return None

    start = int(starts[int(np.argmax(sure))])
    begin = max(start - 10 * after, 0)  # earlier samples pin the level
    # a slow push may begin before its rise is certain
    earliest = max(start - after // 2, start // 2) - begin

    return begin + _begin_of_rise(
        force_n[begin : start + after], earliest, max(block // 10, 1)
    )


def _begin_of_rise(force_n: Floats, earliest: int, step: int) -> int:
    """Return the knee of the level followed by a straight line that fits the samples
    best (least squares).
    """
    sample = np.arange(len(force_n), dtype=np.float64)
    knees = np.arange(earliest, len(force_n) - step, step)
    explained = []

    for knee in knees:  # one at a time: all of them take a gigabyte where a log is fast
        ramp = np.maximum(sample - knee, 0.0)
        ramp -= ramp.mean()
        explained.append((ramp @ force_n) ** 2 / (ramp @ ramp))

    return int(knees[int(np.argmax(explained))])


def _no_label(recording: Recording, log: ForceLog, reason: str) -> RecordingError:
    first = recording.frames[0]
    last = recording.frames[-1]
    path = recording.path
    spans = f"{log.time_s[0]:g} to {log.time_s[-1]:g} s"

    if last.time_s < log.time_s[0] or first.time_s > log.time_s[-1]:
        found = (
            f"frames.csv has {first.time_s:g} to {last.time_s:g} s, forces.csv {spans}"
        )
        return RecordingError(
            f"{path}: the clocks do not overlap: {found}; bring both to one clock"
        )

    found = f"no frame has a label; {first.file}: {reason}"
    return RecordingError(f"{path / 'frames.csv'}: {found}; forces.csv spans {spans}")


def _samples_around(
    log: ForceLog, force_n: Floats, time_s: float, average_s: float
) -> slice | str:
    """Return the samples of a frame's window, or why it has no label.

    At the ends of the log, half of the window is enough, with samples on both sides of
    the frame.
    """
    start, middle, stop = np.searchsorted(
        log.time_s, [time_s - average_s / 2, time_s, time_s + average_s / 2 + 1e-9]
    )
    expected = average_s * log.sample_rate_hz
    if middle in (start, stop) or stop - start < expected / 2 - 1e-6:
        # its clock is rounded
        place = f"within {average_s / 2:g} s of its time {time_s:g} s"
        return f"{stop - start} force samples {place}, about {expected:.0f} are needed"
    if missing := int(np.isnan(force_n[start:stop]).sum()):
        return f"{missing} of the {stop - start} force samples around it have no force"

    return slice(int(start), int(stop))


# a needle that is pushed along its axis has no more than that share of the force across
# it
CROSS_FORCE = 2.0
OTHER_SIZE = 3.0  # moduli of the training differ by less from the middle of their range
LEAST_FRAMES = 6  # fewer prove nothing
# Minus the logarithm of the probability that unrelated dents fit a log as well: 5 %.
# The least of 63 virtual and other recordings has 3.3, of 8 frames, and 61 have more
# than 6.
RELATED = 3.0
CONTRADICTED = "log-contradicted"
WITHOUT_LABEL = "frames-without-label"
UNRELATED = "forces.csv is unrelated to the frames"


def log_doubts(
    recording: Recording,
    classes: ClassesStudy,
    dents: Floats,
    read_n: Sequence[float | None] = (),
) -> tuple[Remark, ...]:
    """Return a remark on a log that does not fit its frames.

    `dents` (measure, frame) grow with the dent of a frame
    (`clock_offsets.estimate_clocks`); NaN: unknown. `read_n` are forces that were read
    in the frames, whose size is compared as well.
    """
    across = axis_doubt(recording, classes)
    log = recording.forces
    info = recording.info.force
    if across:
        return (Remark(CONTRADICTED, across, ("axis",)),)
    if log is None or info is None:
        return ()

    times_s = np.array([frame.time_s for frame in recording.frames])
    stated_n = _means(log, info)(times_s)
    if read_n:
        values_n = np.array([np.nan if n is None else n for n in read_n], np.float64)
        both = np.isfinite(values_n) & np.isfinite(stated_n)
        other_size = _size_doubt(stated_n[both], values_n[both], classes)
        if other_size:
            return (Remark(CONTRADICTED, other_size),)

    return clock_doubts(recording, classes, dents)


def clock_doubts(
    recording: Recording, classes: ClassesStudy, dents: Floats
) -> tuple[Remark, ...]:
    """Return a remark if the dents (measure, frame) fit the log at other times than
    stated, or not at all; raises nothing, and is silent where they do not tell.
    """
    log = recording.forces
    info = recording.info.force
    if log is None or info is None:
        return ()

    times_s = np.array([frame.time_s for frame in recording.frames])
    contact_n = contact_force(log, info)
    found = clock_offsets.estimate_clocks(times_s, dents, log.time_s, contact_n)
    if found is not None and found.contradicts():
        side = "later" if found.offset_s > 0.0 else "earlier"
        size_s = abs(found.offset_s)
        taken = f"about {size_s:.2g} s {side} than frames.csv says"
        if found.drift_s:
            # `calibration_lines` breaks this into lines before the command line puts
            # the flag, which is as long, in place of the field
            return _clock_doubt(
                "the clocks of frames.csv and forces.csv drift: the frames fit as if"
                f" taken {taken}, and {found.drift_s:+.2g} s from first to last;"
                " import again with `clock_offset_s` auto"
            )
        return _clock_doubt(
            f"the frames' times are off: they fit forces.csv as if taken {taken}; bring"
            " both to one clock"
        )

    stated_n = _means(log, info)(times_s)
    seen = np.isfinite(dents).any(axis=0) & np.isfinite(stated_n)
    if found is not None and found.parts and not _related(recording, dents):
        listed = ", ".join(
            f"frames {first + 1} to {last + 1} {offset_s:+.1f} s"
            for first, last, offset_s in found.parts
        )
        return _clock_doubt(
            f"the clocks of frames.csv and forces.csv differ, by parts: {listed}; a"
            " clock paused or was set: give each frame its own time"
        )
    varied = seen.sum() >= LEAST_FRAMES and np.ptp(stated_n[seen]) > classes.bounds_n[0]
    if varied and not _related(recording, dents):
        words = f"{UNRELATED}; check that both are of one session, and their clocks"
        return (Remark(CONTRADICTED, words),)

    return ()


def _clock_doubt(words: str) -> tuple[Remark]:
    return (Remark("clock-contradicted", words, ("clock_offset_s",)),)


def _related(recording: Recording, dents: Floats) -> bool:
    """Return whether dents and forces at the stated times belong together, or cannot be
    compared.
    """
    log = recording.forces
    info = recording.info.force
    assert log is not None  # `clock_doubts`
    assert info is not None
    times_s = np.array([frame.time_s for frame in recording.frames])
    found = clock_offsets.relation(times_s, dents, log.time_s, contact_force(log, info))
    return found is None or found >= RELATED


def _size_doubt(stated_n: Floats, read_n: Floats, classes: ClassesStudy) -> str | None:
    pushed = np.maximum(read_n, stated_n) > classes.bounds_n[0]
    if pushed.sum() < LEAST_FRAMES // 2:
        return None

    ratio = float(np.median(stated_n[pushed] / np.maximum(read_n[pushed], 1e-6)))
    if 1.0 / OTHER_SIZE < ratio < OTHER_SIZE:
        return None

    way = (
        "check its unit (N), [force] axis, the clocks of frames.csv and forces.csv, and"
        " what is known of the eye"
    )
    return (
        f"forces.csv has {max(ratio, 0.0):.2g} times the force that the frames show, in"
        f" the median: {way}"
    )


def axis_doubt(recording: Recording, classes: ClassesStudy) -> str | None:
    """Return a sentence if the log has more force across the stated axis than along it,
    else None.
    """
    log = recording.forces
    info = recording.info.force
    if log is None or info is None:
        return None

    times_s = np.array([frame.time_s for frame in recording.frames])
    axes = [
        axis
        for axis in ("fx", "fy", "fz")
        if f"{axis}_n" in log.columns and np.isfinite(log.force_n(axis)).any()
    ]
    means = {axis: _means(log, replace(info, axis=axis))(times_s) for axis in axes}
    peaks_n = {
        axis: float(np.nanmax(np.abs(mean_n), initial=0.0))
        for axis, mean_n in means.items()
    }

    largest = max(axes, key=peaks_n.__getitem__)
    if peaks_n[largest] <= CROSS_FORCE * max(peaks_n[info.axis], classes.bounds_n[0]):
        return None

    across, along = (
        f"{from_si(peaks_n[axis], 'mn'):.1f} mN along {axis}"
        for axis in (largest, info.axis)
    )
    return (
        f"forces.csv has up to {across} under the frames, but {along}: check [force]"
        " axis, that along the needle"
    )


def _means(log: ForceLog, info: ForceInfo) -> Callable[[Floats], Floats]:
    log = log.known(info.axis)
    total = np.concatenate([[0.0], np.cumsum(contact_force(log, info))])

    def around(times_s: Floats) -> Floats:
        start, stop = (
            np.searchsorted(log.time_s, times_s + side * info.average_s / 2)
            for side in (-1.0, 1.0)
        )
        count = np.where(stop > start, stop - start, 1)
        return np.where(stop > start, (total[stop] - total[start]) / count, np.nan)

    return around


# A puncture is a sudden fall of the force in a log. Its limits:
BEFORE_S = 0.08  # of the levels on either side of the fall
BETWEEN_S = 0.02  # from level to level, at most
FALL_SHARE = 0.4  # of the level before, at least
LEAST_FALL_N = 2e-3
DEVIATIONS = 6.0  # of the noise of a level, at least
# Share of the fall by which a level itself may change; beyond it the needle goes back
# slowly.
LEVEL = 0.25
STIFFNESS_N_M = 100.0  # of a steep wall: what the needle went back explains as much
# without contact for so long, a push is over
LIFTED_N = 2e-3
LIFTED_S = 0.5


def log_punctures(log: ForceLog, force_n: Floats, travel_m: Floats) -> list[float]:
    """Return the times of sudden falls to another level of contact, s.

    `force_n`: the contact force at each sample, tared and not filtered. `travel_m`: the
    needle's travel there, NaN where it is not known. A fall to no contact is taken for
    a needle that lets go.
    """
    count = max(round(BEFORE_S * log.sample_rate_hz), 2)
    gap = max(round(BETWEEN_S * log.sample_rate_hz), 1)
    # of a level
    noise_n = float(np.abs(np.diff(force_n)).mean()) * np.sqrt(np.pi / count) / 2.0
    sums_n = np.concatenate([[0.0], np.cumsum(force_n)])
    means_n = (sums_n[count:] - sums_n[:-count]) / count  # of the samples from each on
    first = np.arange(count, len(force_n) - 3 * count - gap)  # of the level before
    earlier_n, before_n, after_n, later_n = (
        means_n[first + shift] for shift in (-count, 0, count + gap, 2 * count + gap)
    )
    fall_n = before_n - after_n
    half = count // 2
    back_m = np.nan_to_num(
        travel_m[first + half] - travel_m[first + count + gap + half]
    )
    least_n = np.maximum(
        FALL_SHARE * before_n, LEAST_FALL_N
    ) + STIFFNESS_N_M * np.maximum(back_m, 0.0)
    sudden = (fall_n >= np.maximum(least_n, DEVIATIONS * np.sqrt(2.0) * noise_n)) & (
        np.maximum(np.abs(earlier_n - before_n), np.abs(after_n - later_n))
        <= LEVEL * fall_n + 2.0 * noise_n
    )
    touches = np.minimum(after_n, later_n) >= max(LIFTED_N, 3.0 * noise_n)
    found = np.flatnonzero(sudden & touches)
    runs = np.split(found, np.flatnonzero(np.diff(found) > 1) + 1) if len(found) else []
    steepest = [run[np.argmax(fall_n[run])] for run in runs]

    return [float(log.time_s[first[place] + count]) for place in steepest]


def with_punctures(recording: Recording) -> Recording:
    """Return a recording whose frames after a puncture in its force log, in the same
    push, are marked as pierced.
    """
    log = recording.forces
    info = recording.info.force
    if log is None or info is None:
        return replace(
            recording,
            frames=tuple(replace(entry, pierced=False) for entry in recording.frames),
        )

    log = log.known(info.axis)
    times_s = np.array([frame.time_s for frame in recording.frames])
    raw_n = info.contact_sign * log.force_n(info.axis)
    tared_n = raw_n - raw_n[: tare_samples(raw_n, log.sample_rate_hz)].mean()
    known = [
        (frame.time_s, frame.travel_m)
        for frame in recording.frames
        if frame.travel_m is not None
    ]
    there_m = np.full(len(log.time_s), np.nan)

    if known:
        at_s, stated_m = np.array(known).T
        there_m = np.interp(log.time_s, at_s, stated_m, left=np.nan, right=np.nan)

    pierced = after_punctures(
        times_s,
        log_punctures(log, tared_n, there_m),
        log.time_s,
        contact_force(log, info),
    )
    each = zip(recording.frames, pierced, strict=True)

    return replace(
        recording,
        frames=tuple(replace(entry, pierced=is_pierced) for entry, is_pierced in each),
    )


def after_punctures(
    times_s: Floats, punctures_s: Sequence[float], contact_s: Floats, contact_n: Floats
) -> list[bool]:
    """Return of each frame whether a puncture lies before it, in the same push.

    `contact_n` (sample,): the contact force at `contact_s`, by which a push ends.
    """
    touching_s = contact_s[np.abs(contact_n) >= LIFTED_N]
    lifted = np.flatnonzero(np.diff(touching_s) > LIFTED_S)
    ends_s = np.append(touching_s[lifted], touching_s[-1:]) + LIFTED_S

    def within(pierced_s: float, at_s: float) -> bool:
        end_s = ends_s[ends_s > pierced_s]
        return pierced_s <= at_s and (not len(end_s) or at_s < end_s[0])

    return [
        any(within(pierced_s, at_s) for pierced_s in punctures_s)
        for at_s in times_s.tolist()
    ]
