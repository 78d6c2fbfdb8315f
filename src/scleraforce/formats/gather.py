"""Sources of all kinds together: the frames, the forces, and whether both are on one clock."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from scleraforce.errors import InputError
from scleraforce.formats.bags import BagTopics, read_bag
from scleraforce.formats.force_log import read_force_text
from scleraforce.formats.log_columns import LogColumn
from scleraforce.formats.log_text import read_log_text
from scleraforce.formats.scan import joined
from scleraforce.formats.sources import SourceOrder, files_of, natural_order, oriented, read_scan, source_kind
from scleraforce.recording.scan import Scan, Times, rising
from scleraforce.recording.tables import ForceLog, checked_samples, gap_notes

SINCE_1970_S = 1e8  # a clock beyond counts from 1970


@dataclass(frozen=True)
class Asked:
    """What was answered on how sources are read."""

    order: SourceOrder = field(default_factory=SourceOrder)
    columns: tuple[LogColumn, ...] = ()
    topics: BagTopics = field(default_factory=BagTopics)


@dataclass(frozen=True, eq=False)
class Gathered:
    """Frames and forces of all sources.

    Attributes:
        files: with the kind of each.
        scan: the frames.
        log: None where no source has forces.
        columns: of the text that the log was read from.
        one_clock: whether one program stamped both (a bag).
        notes: sentences on what is to be known of the sources.
    """

    files: tuple[tuple[Path, str], ...]
    scan: Scan
    log: ForceLog | None
    columns: tuple[LogColumn, ...]
    one_clock: bool
    notes: tuple[str, ...]


def gather(sources: Sequence[Path], asked: Asked, seen: Callable[[int], None] = lambda _: None) -> Gathered:
    """Read all sources; `seen` is called with 1 after each.

    Raises:
        UnansweredError: a source leaves something open that `asked` does not answer.
        InputError: one cannot be read, none has frames, or two have forces.
    """
    files = [(path, source_kind(path)) for path in files_of(sources)]
    scans: list[Scan] = []
    logs: list[tuple[Path, ForceLog]] = []
    columns: tuple[LogColumn, ...] = ()
    notes: list[str] = []
    for path, kind in files:
        if kind == "bag":
            bag = read_bag(path, asked.topics)
            scans += [oriented(path, bag.scan, asked.order)] if bag.scan is not None else []
            if bag.log is not None:
                log = replace(bag.log, notes=gap_notes(path, bag.log.wrench_sc))
                logs.append((path, checked_samples(log, path, f"{path}: message {{}} of the forces".format)))
            notes += bag.notes
        elif kind == "log":
            log, columns = read_force_text(read_log_text(path), asked.columns)
            logs.append((path, log))
        else:
            scans.append(read_scan(path, kind, asked.order))
        seen(1)
    if not scans:
        raise InputError(f"{sources[0]}: no frames in the sources; give images, a volume, a film or a bag with images")
    if len(logs) > 1:
        raise InputError(f"{logs[1][0]}: a second force log beside {logs[0][0]}; import one recording at a time")
    scan = joined(scans)
    notes += [*scan.notes, *_order_note(files, scan), *(note for _, log in logs for note in log.notes)]
    return Gathered(tuple(files), scan, logs[0][1] if logs else None, columns, len(files) == 1, tuple(notes))


def on_one_clock(times: Times, log: ForceLog | None, offset_s: float) -> tuple[Times, ForceLog | None, float]:
    """Return times and log on the log's clock, and from which of its seconds both count now.

    Args:
        times: of the frames.
        log: of the forces.
        offset_s: what the log's clock shows more than the frames'.

    Raises:
        InputError: the frames' times do not rise.
    """
    time_s = times.time_s + offset_s
    if not rising(time_s):
        raise InputError(
            "the frames' times do not rise from each frame to the next; give the files in the order in which they were "
            "taken, or their times by --times or --rate-hz"
        )
    first_s = float(min([time_s[0], *([] if log is None else log.time_s[:1])]))
    origin_s = float(np.floor(first_s)) if first_s > SINCE_1970_S else 0.0
    moved = None if log is None else replace(log, time_s=log.time_s - origin_s)
    return Times(time_s - origin_s, times.source), moved, origin_s


def check_overlap(times: Times, log: ForceLog | None) -> None:
    """Check that frames and forces, on one clock, were taken at one time.

    Raises:
        InputError: the last of one came before the first of the other.
    """
    if log is None or (times.time_s[-1] >= log.time_s[0] and times.time_s[0] <= log.time_s[-1]):
        return
    frames, forces = (f"{each[0]:.3f} to {each[-1]:.3f} s" for each in (times.time_s, log.time_s))
    raise InputError(
        f"the clocks do not overlap: frames at {frames}, forces at {forces}; --clock-offset-s brings both to one clock"
    )


def _order_note(files: Sequence[tuple[Path, str]], scan: Scan) -> tuple[str, ...]:
    """Say where files were given in another order than that of the numbers in their names, and no times order them."""
    paths = [path for path, kind in files if kind not in ("bag", "log")]
    if scan.times is not None or paths == sorted(paths, key=natural_order):
        return ()
    return (f"frames are taken in the order given, {paths[0].name} to {paths[-1].name}; their numbers have another",)
