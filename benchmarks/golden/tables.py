"""The printed tables: what moved in each group, the largest moves, and each door's
difference from `evaluate`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from golden.answers import Answers, Comparison, Move, Record
from markdown_tables import markdown

REFERENCE = "evaluate"
LISTED = 12  # moves of a group, answers that are missing or new


def group_table(groups: Mapping[str, tuple[Answers, Comparison]]) -> str:
    """Return the moved answers of each group, and its largest move in each unit."""
    head = ["group", "answers", "moved", "missing", "new", "largest moves"]
    rows = [
        [
            group,
            str(len(answers)),
            str(len(comparison.moved)),
            str(len(comparison.missing)),
            str(len(comparison.new)),
            "; ".join(_largest_moves(comparison.moves)) or "none",
        ]
        for group, (answers, comparison) in groups.items()
    ]
    return markdown(head, rows)


def _largest_moves(moves: Sequence[Move]) -> Iterator[str]:
    for unit in dict.fromkeys(move.unit for move in moves):
        of_unit = [move for move in moves if move.unit == unit]
        largest = max(of_unit, key=_magnitude)
        size = (
            f"{len(of_unit)} of {unit}"
            if largest.size is None
            else f"{largest.size:+.4g} {unit}"
        )
        yield f"{size} ({largest.answer} {largest.value})"


def _magnitude(move: Move) -> float:
    return 0.0 if move.size is None else abs(move.size)


def move_lines(group: str, comparison: Comparison) -> Iterator[str]:
    """Yield the largest moves of a group, and the answers that are missing or new."""
    moves = sorted(comparison.moves, key=_magnitude, reverse=True)
    for move in moves[:LISTED]:
        size = "" if move.size is None else f" ({move.size:+.4g} {move.unit})"
        yield f"{group}: {move.answer} {move.value}: {move.words}{size}"
    if len(moves) > LISTED:
        yield f"{group}: {len(moves) - LISTED} more values moved"
    for words, names in (("missing", comparison.missing), ("new", comparison.new)):
        for name in names[:LISTED]:
            yield f"{group}: {name}: {words}"
        if len(names) > LISTED:
            yield f"{group}: {len(names) - LISTED} more are {words}"


@dataclass(frozen=True)
class DoorDifference:
    """How a door answers beside `evaluate`, over the frames that both answer.

    `force_mn` and `interval_mn` are the largest differences of the force and of an end
    of its interval, with the frame's name; None where no frame has both. `forces`
    counts frames that only one of both gives a force; `classes`, `usable` and `reasons`
    count frames with another class, usability or reason.
    """

    door: str
    frames: int
    force_mn: float | None
    force_frame: str
    interval_mn: float | None
    forces: int
    classes: int
    usable: int
    reasons: int


def door_differences(answers: Answers) -> list[DoorDifference]:
    """Return the differences of every door from `evaluate`; names of answers are
    "recording/frame/door".
    """
    frames: dict[str, dict[str, Record]] = {}
    for name, record in answers.items():
        frame, _, door = name.rpartition("/")
        if "class" in record:
            frames.setdefault(frame, {})[door] = record
    doors = dict.fromkeys(door for of in frames.values() for door in of)
    return [
        _door_difference(
            door, {frame: of for frame, of in frames.items() if door in of}
        )
        for door in doors
        if door != REFERENCE
    ]


def _door_difference(
    door: str, frames: Mapping[str, Mapping[str, Record]]
) -> DoorDifference:
    pairs = {
        frame: (of[REFERENCE], of[door])
        for frame, of in frames.items()
        if REFERENCE in of
    }
    forces: dict[str, float] = {}
    ends: list[float] = []
    for frame, (reference, answer) in pairs.items():
        if None in (reference["force_mn"], answer["force_mn"]):
            continue
        forces[frame] = answer["force_mn"] - reference["force_mn"]
        both_ends = zip(reference["interval_mn"], answer["interval_mn"], strict=True)
        ends += [now - before for before, now in both_ends]
    farthest = max(forces, key=lambda frame: abs(forces[frame]), default="")

    def differing(value: str) -> int:
        return sum(one[value] != other[value] for one, other in pairs.values())

    return DoorDifference(
        door=door,
        frames=len(pairs),
        force_mn=forces.get(farthest),
        force_frame=farthest,
        interval_mn=max(ends, key=abs, default=None),
        forces=sum(
            (one["force_mn"] is None) != (other["force_mn"] is None)
            for one, other in pairs.values()
        ),
        classes=differing("class"),
        usable=differing("usable"),
        reasons=differing("reason"),
    )


def door_table(now: Answers, frozen: Answers) -> str:
    """Return each door's difference from `evaluate`, of the force also before."""
    head = [
        "door",
        "frames",
        "force, mN at most",
        "was",
        "in",
        "interval's end, mN at most",
        "force on one side only",
        "other class",
        "other usability",
        "other reason",
    ]
    before = {one.door: one for one in door_differences(frozen)}
    rows = [
        [
            one.door,
            str(one.frames),
            _signed(one.force_mn),
            _signed(before[one.door].force_mn) if one.door in before else "-",
            one.force_frame or "-",
            _signed(one.interval_mn),
            str(one.forces),
            str(one.classes),
            str(one.usable),
            str(one.reasons),
        ]
        for one in door_differences(now)
    ]
    return markdown(head, rows)


def _signed(number: float | None) -> str:
    return "-" if number is None else f"{number:+.4f}"
