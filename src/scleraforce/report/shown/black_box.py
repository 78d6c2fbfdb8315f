"""A log of the monitor's decisions: how long it watched, when it withdrew and why, what was torn."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scleraforce.errors import InputError, MessageError
from scleraforce.report.files import AMBER, BLACK, BLUE, GREY, RED, inches, styled
from scleraforce.report.shown.kinds import LOG_FILES, Thing
from scleraforce.service.console.board import sentence_of
from scleraforce.service.decision_log import LogPart, read_log
from scleraforce.service.messages import Entry

LISTED = 12  # withdrawals
SHADES = {"NOT_READY": GREY, "WATCHING": BLUE, "WITHDRAW": RED}


@dataclass(frozen=True)
class DecisionsRead:
    """What a log holds: decisions in order, notes, and how many parts were torn or damaged."""

    decisions: tuple[Entry, ...]
    notes: tuple[str, ...]
    torn: int

    @property
    def withdrawals(self) -> tuple[Entry, ...]:
        """The decisions at which the state became WITHDRAW."""
        pairs = pairwise([None, *self.decisions])
        return tuple(after for before, after in pairs if after is not None and after.state == "WITHDRAW"
                     and (before is None or before.state != "WITHDRAW"))  # fmt: skip


def read_decisions(path: Path) -> DecisionsRead:
    """Read a log: a file, the folder of its files, or the folder of a black box.

    Raises:
        InputError: there is no decision or note in it, a file of it is no regular one, or a whole record is none of a
            monitor.
    """
    folder = path / "log" if (path / "log").is_dir() else path
    for file in folder.glob(LOG_FILES):
        if not file.is_file():
            raise InputError(f"{file}: no regular file; a log has nothing else")
    decisions, notes, torn = [], [], 0
    for part in read_log(folder):
        if part.record is None:
            torn += 1
        elif part.record.get("kind") == "entry":
            decisions.append(_entry(part))
        else:
            notes.append(str(part.record.get("text", "")))
    if not decisions and not notes:
        raise InputError(f"{folder}: no whole record of a decision log in it")
    return DecisionsRead(tuple(decisions), tuple(notes), torn)


def show_black_box(path: Path) -> Thing:
    """Look at the log of a black box.

    Raises:
        InputError: as `read_decisions`.
    """
    log = read_decisions(path)
    forces_mn = [entry.force_mn for entry in log.decisions if entry.force_mn is not None]
    causes = Counter(entry.cause or "?" for entry in log.withdrawals)
    frames = sum(entry.event == "frame" for entry in log.decisions)
    rows = [
        ("decisions", f"{len(log.decisions)}, {frames} of them on a frame"),
        ("span", _span(log.decisions)),
        ("forces", f"{min(forces_mn):.1f} to {max(forces_mn):.1f} mN" if forces_mn else ""),
        ("lost frames", str(log.decisions[-1].lost) if log.decisions else ""),
        ("withdrawals", ", ".join(f"{count} {cause}" for cause, count in causes.items()) or "none"),
        ("notes", str(len(log.notes))),
        ("torn", f"{log.torn} parts could not be read" if log.torn else "nothing"),
    ]
    facts = {
        "decisions": len(log.decisions),
        "frames": frames,
        "withdrawals": [
            {"number": entry.number, "time_s": entry.time_s, "cause": entry.cause, "message": entry.message}
            for entry in log.withdrawals
        ],
        "notes": log.notes,
        "torn": log.torn,
    }
    return Thing(
        kind="decision log",
        facts=facts,
        rows=tuple((name, words) for name, words in rows if words),
        lines=tuple(_listed(log.withdrawals)),
        draw=lambda: draw_decisions(log.decisions),
    )


@styled
def draw_decisions(decisions: Sequence[Entry]) -> Figure:
    """Draw the read force with its interval over time; the ground says the state, a line each withdrawal."""
    figure = Figure(figsize=inches(170, 70))
    axes = figure.subplots()
    start_s = decisions[0].at_s if decisions else 0.0
    read = [entry for entry in decisions if entry.force_mn is not None and entry.interval_mn is not None]
    at_s = np.array([entry.at_s - start_s for entry in read])
    ends_mn = np.array([entry.interval_mn for entry in read], dtype=float).reshape(-1, 2)
    axes.fill_between(at_s, *ends_mn.T, color=AMBER, alpha=0.35, linewidth=0, label="90 % interval")
    axes.plot(
        at_s, np.array([entry.force_mn for entry in read], dtype=float), color=BLACK, linewidth=0.8, label="force"
    )
    for state, (begin_s, end_s) in _stretches(decisions):
        axes.axvspan(begin_s - start_s, end_s - start_s, color=SHADES[state], alpha=0.12, linewidth=0)
    for state, shade in SHADES.items():
        axes.fill_between([], [], color=shade, alpha=0.12, label=state)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("force [mN]")
    axes.set_ylim(bottom=0.0)
    figure.legend(loc="outside upper left", ncols=5)
    return figure


def _stretches(decisions: Sequence[Entry]) -> Iterator[tuple[str, tuple[float, float]]]:
    """Yield each state with the time from its first decision to the next state's."""
    changes = [after for before, after in pairwise([None, *decisions]) if after is not None
               and (before is None or before.state != after.state)]  # fmt: skip
    ends = [*changes[1:], decisions[-1]] if changes else []
    for begin, end in zip(changes, ends, strict=True):
        yield begin.state, (begin.at_s, end.at_s)


def _entry(part: LogPart) -> Entry:
    assert part.record is not None
    try:
        return Entry.from_json(part.record.get("entry"))
    except MessageError as fault:
        raise InputError(f"{part.file}: byte {part.offset}: entry: {fault}") from fault


def _span(decisions: Sequence[Entry]) -> str:
    if not decisions:
        return ""
    begin = datetime.fromtimestamp(decisions[0].time_s, UTC)
    return f"{decisions[-1].at_s - decisions[0].at_s:.4g} s from {begin:%Y-%m-%d %H:%M:%S} UTC"


def _listed(withdrawals: Sequence[Entry]) -> Iterator[str]:
    for entry in withdrawals[:LISTED]:
        when = datetime.fromtimestamp(entry.time_s, UTC)
        yield f"{when:%H:%M:%S} UTC, decision {entry.number}: {sentence_of(entry.cause or '')}"
    if len(withdrawals) > LISTED:
        yield f"... and {len(withdrawals) - LISTED} more"
