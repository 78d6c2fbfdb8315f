"""The moments of several planes: their frames paired by time, number or order."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from scleraforce.base.arrays import Floats, Integers
from scleraforce.base.errors import InputError
from scleraforce.recordings.formats.picture_streams import (
    PictureSource,
    PictureStream,
    UnansweredError,
    check_kinds,
    checked_pictures,
    in_order,
)
from scleraforce.recordings.frame_names import file_of, numbers_in
from scleraforce.recordings.frame_order import WAYS, FramesBy
from scleraforce.records.scan import Plane, check_frame_counts

MOST_NAMED = 5  # moments in one note
SHARED = 0.5  # of the shortest step, by which frames of one moment may differ
APART = 0.75  # of it, by which frames of two moments differ


@dataclass(frozen=True, eq=False)
class PairedFrames:
    """Frames of several planes: `scan` has one of each moment, with its time; `frames`
    has all, and `places` their moments and planes.
    """

    scan: PictureSource
    frames: PictureSource
    places: tuple[tuple[int, Plane], ...]
    notes: tuple[str, ...] = ()


def pair_moments(
    scans: Mapping[Plane, PictureSource], by: FramesBy | None
) -> PairedFrames:
    """Pair the frames of planes by their times, else by their numbers, else in order.

    Raises:
        InputError: planes of several lengths, which nothing pairs.
        UnansweredError: numbers in names overlap, and not all of them.
    """
    planes = [*scans]
    each = [*scans.values()]
    check_kinds(each)
    fault = None
    pairs = None

    if all(scan.times is not None for scan in each):
        pairs, fault = _by_time([scan.times.time_s for scan in each if scan.times])
        fault = fault and f"{each[0].names[0]}: {fault}"
    elif all(scan.steps is not None for scan in each):
        pairs = _by_key(
            [scan.steps.tolist() for scan in each if scan.steps is not None]
        )

    if pairs is None:
        check_frame_counts(
            {plane.name: len(scan.names) for plane, scan in scans.items()}
        )
        if by is None and fault is None:
            _check_same_numbers(scans)
        pairs = np.tile(np.arange(len(each[0].names))[:, np.newaxis], len(each))

    if not (pairs >= 0).all(axis=1).any():
        raise InputError(
            f"`planes`: no frame of {planes[0].name!r} is of the moment of one of"
            " another plane; check their times or numbers"
        )

    return _of_pairs(scans, pairs, fault)


def _by_time(times_s: Sequence[Floats]) -> tuple[Integers | None, str | None]:
    """Return the frame of each plane at each moment, -1 where it has none; or why the
    times do not tell.
    """
    steps_s = np.concatenate([np.diff(time_s) for time_s in times_s])
    shortest_s = float(steps_s.min()) if steps_s.size else np.inf
    # Planes that are taken in turns are late by the same time.
    shifted_s = [time_s - _late_s(time_s, times_s[0], shortest_s) for time_s in times_s]
    found = list[tuple[float, dict[int, int]]]()

    for time_s, plane, nth in sorted(
        (float(time_s), plane, nth)
        for plane, of_plane in enumerate(shifted_s)
        for nth, time_s in enumerate(of_plane)
    ):
        near = bool(found) and time_s - found[-1][0] <= SHARED * shortest_s
        if near and plane not in found[-1][1]:
            found[-1][1][plane] = nth
        else:
            found.append((time_s, {plane: nth}))

    for time_s, frames in found:
        for plane, others_s in enumerate(shifted_s):
            apart_s = float(np.abs(others_s - time_s).min())
            if plane not in frames and apart_s < APART * shortest_s:
                same = len({len(each) for each in times_s}) == 1
                apart_s = float(np.ptp(times_s, axis=0).max()) if same else apart_s
                fault = (
                    f"frames of one moment differ by {apart_s:g} s between the planes"
                )
                return None, fault

    rows = [[frames.get(nth, -1) for nth in range(len(times_s))] for _, frames in found]
    return np.array(rows), None


def _late_s(time_s: Floats, first_s: Floats, shortest_s: float) -> float:
    """Return by how much a plane is later than the first one, in the median."""
    before = np.clip(np.searchsorted(first_s, time_s, "right") - 1, 0, len(first_s) - 1)
    after = np.clip(before + 1, 0, len(first_s) - 1)
    late_s = time_s - first_s[before]
    near = np.abs(late_s) <= SHARED * shortest_s * (1.0 + 1e-6)
    return float(np.median(np.where(near, late_s, time_s - first_s[after])))


def _by_key(keys: Sequence[Sequence[int]]) -> Integers:
    place = [{key: nth for nth, key in enumerate(each)} for each in keys]
    shown = sorted(set().union(*place))
    return np.array([[each.get(key, -1) for each in place] for key in shown])


def _check_same_numbers(scans: Mapping[Plane, PictureSource]) -> None:
    numbers = {
        plane.name: set(found.tolist())
        for plane, scan in scans.items()
        if scan.times is None and (found := _numbers(scan)) is not None
    }
    if len(numbers) < len(scans):
        return

    (first, of_first), *others = numbers.items()
    for other, of_other in others:
        if of_first & of_other and (alone := sorted(of_first ^ of_other)):
            lacking = first if alone[0] in of_other else other
            raise UnansweredError(
                "frames_by",
                f"{next(iter(scans.values())).names[0]}: {lacking!r} has no frame"
                f" {alone[0]}: {WAYS}",
            )


def _numbers(scan: PictureSource) -> Integers | None:
    if scan.numbers:
        return scan.numbers[0].values
    files = [file_of(name) for name in scan.names]
    return numbers_in(files) if len(set(files)) == len(files) > 1 else None


def _of_pairs(
    scans: Mapping[Plane, PictureSource], pairs: Integers, fault: str | None
) -> PairedFrames:
    planes = [*scans]
    each = [*scans.values()]
    order = [tuple(pair) for pair in np.argwhere(pairs >= 0).tolist()]
    names = tuple(each[col].names[pairs[row, col]] for row, col in order)
    firsts = np.argmax(pairs >= 0, axis=1)
    rows = range(len(pairs))

    def pictures() -> PictureStream:
        streams = [checked_pictures(scan) for scan in each]
        return (next(streams[col]) for _, col in order)

    def stated(values: Sequence[Floats | Integers]) -> Floats:
        return np.array([values[firsts[row]][pairs[row, firsts[row]]] for row in rows])

    timed = each[0].times is not None and fault is None
    others = all(scan.times is not None for scan in each) or (pairs[:, 0] >= 0).all()
    times = None
    if timed and others and each[0].times is not None:
        time_s = stated([(scan.times or each[0].times).time_s for scan in each])
        times = replace(each[0].times, time_s=time_s)

    steps: Integers | None = None
    if all(scan.steps is not None for scan in each):
        counts = stated([scan.steps for scan in each if scan.steps is not None])
        steps = counts.astype(np.int64)

    notes = dict.fromkeys(note for scan in each for note in scan.notes)
    faults = [fault, *(scan.times_fault for scan in each)]
    whole = replace(
        each[0],
        names=names,
        pictures=pictures,
        times=None,
        steps=None,
        numbers=(),
        labels=None,
        notes=tuple(notes),
        scale_fault=next((s.scale_fault for s in each if s.scale_fault), None),
        times_fault=next((each for each in faults if each), None),
    )
    place = {pair: nth for nth, pair in enumerate(order)}
    shown = [place[row, int(firsts[row])] for row in rows]
    scan = replace(
        whole,
        names=tuple(names[nth] for nth in shown),
        pictures=lambda: in_order(pictures(), shown),
        times=times,
        steps=steps,
    )
    places = tuple((row, planes[col]) for row, col in order)
    return PairedFrames(scan, whole, places, _lacking(planes, pairs, scan))


def _lacking(
    planes: Sequence[Plane], pairs: Integers, scan: PictureSource
) -> tuple[str, ...]:
    """Return a sentence on the moments without a frame of every plane."""
    lacking = np.argwhere(pairs < 0).tolist()
    if not lacking:
        return ()

    listed = [
        f"no {planes[col].name!r} beside {scan.names[row]}" for row, col in lacking
    ]
    more = f", and {len(listed) - MOST_NAMED} more" if len(listed) > MOST_NAMED else ""
    count = len({row for row, _ in lacking})
    return (
        f"{count} of {len(pairs)} moments lack a plane:"
        f" {', '.join(listed[:MOST_NAMED])}{more}",
    )
