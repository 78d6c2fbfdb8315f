"""The printed tables: what moved in each group, and the largest moves."""

from collections.abc import Iterator, Mapping, Sequence

from golden.answers import Answers, Comparison, Move
from markdown_tables import markdown

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
