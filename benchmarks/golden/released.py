"""`make counts`: what the code takes beside what the last release took, in a minute.

python -m golden.released            compare; exit code 1 where a count got worse
python -m golden.released --release  keep today's counts as those of a release

Counts are those of the group `counts` of the golden answers: modules imported, loops
compiled, files opened, passes over a frame, memory allocated, factorizations and
solves. Less of each is faster. Seconds are in benchmarks/RESULTS.md.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from golden.answers import Answers
from golden.computing import compute
from markdown_tables import markdown
from provenance.stamps import new_stamp
from scleraforce.base.version import __version__

GROUP = "counts"
RELEASED = Path(__file__).with_name("released.json")
WORSE = 1.10  # times the release's count


@dataclass(frozen=True)
class Change:
    """A count of a piece of work at the last release and now; None: not counted."""

    work: str
    what: str
    released: int | None
    now: int | None

    @property
    def is_worse(self) -> bool:
        """True if it is more than the limit allows; a count that was 0 stays 0."""
        if self.released is None or self.now is None:
            return False
        return self.now > WORSE * self.released

    @property
    def words(self) -> str:
        """Words for the last column."""
        if self.released is None:
            return "new"
        if self.now is None:
            return "no longer counted"
        if self.is_worse:
            return "**worse**"
        return ""


def changes(released: Answers, now: Answers) -> Iterator[Change]:
    """Yield each count that moved since the release, or that only one of both has."""
    for work in dict.fromkeys((*released, *now)):
        before = released.get(work, {})
        after = now.get(work, {})
        for what in dict.fromkeys((*before, *after)):
            change = Change(work, what, before.get(what), after.get(what))
            if change.released != change.now:
                yield change


def table_of(found: list[Change]) -> str:
    """Return the counts that moved, as a table."""
    return markdown(
        ["work", "count", "release", "now", ""],
        [
            [
                change.work,
                change.what,
                _number(change.released),
                _number(change.now),
                change.words,
            ]
            for change in found
        ],
    )


def _number(count: int | None) -> str:
    return "-" if count is None else str(count)


def read_released(path: Path) -> tuple[str, Answers]:
    """Return which release counts are of, and the counts."""
    content = json.loads(path.read_text(encoding="utf-8"))
    return content["made"], content["counts"]


def released_text(made: str, counts: Mapping[str, Mapping[str, int]]) -> str:
    """Return the text of the file of a release."""
    ordered = {work: dict(counts[work]) for work in sorted(counts)}
    return json.dumps({"made": made, "counts": ordered}, indent=1) + "\n"


def main(words: list[str] | None = None) -> int:
    """Count, compare, print; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--release", action="store_true", help="keep today's counts")
    given = parser.parse_args(words)

    computed, failed = compute((GROUP,), 1)
    if failed:
        print("\n".join(f"could not be counted: {fault}" for fault in failed))
        return 1

    counts = computed[GROUP]
    if given.release:
        made = f"{__version__}. {new_stamp('make counts')}"
        RELEASED.write_text(released_text(made, counts), encoding="utf-8")
        print(f"wrote {RELEASED}", file=sys.stderr)
        return 0

    made, released = read_released(RELEASED)
    found = list(changes(released, counts))
    print(f"Release {made}\n")
    print(table_of(found) if found else "No count has moved.")
    worse = [change for change in found if change.is_worse]
    if worse:
        print(
            f"\n{len(worse)} of the counts got worse by more than {WORSE - 1.0:.0%}:"
            " mend them, or say in the change why they have to be more and run"
            " `python -m golden.released --release`"
        )
    return int(bool(worse))


if __name__ == "__main__":
    sys.exit(main())
