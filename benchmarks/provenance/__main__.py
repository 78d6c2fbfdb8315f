"""`make stale`: which generated figures of the pages today's code would no longer make.

python -m provenance                  list them
python -m provenance --stamp COMMAND  print the line for figures just made by COMMAND,
                                      and note what decides them
"""

import argparse
import sys

from provenance.behaviour import behaviour, keep, moved_since
from provenance.stamps import ROOT, new_stamp, read_stamps

SHOWN = 3  # entries that moved


def main() -> int:
    """List the figures, or print a stamp; return 0, also where figures are out of date:
    a run of them takes long.
    """
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument(
        "--stamp", metavar="COMMAND", help="print the line of new figures"
    )
    given = parser.parse_args()
    now = behaviour()

    if given.stamp:
        stamp = new_stamp(given.stamp)
        keep(stamp, now)
        print(stamp)
        return 0

    pages = [
        ROOT / "README.md",
        *sorted((ROOT / "docs").rglob("*.md")),
        *(ROOT / "benchmarks").rglob("*.md"),
    ]
    found = [(page, stamp) for page in pages for stamp in read_stamps(page)]

    for page, stamp in found:
        state = _state(moved_since(stamp, now))
        print(
            f"{page.relative_to(ROOT)}: {stamp.made_by}, {stamp.commit} of {stamp.day}:"
            f" {state}"
        )

    if not found:
        print("no page has generated figures with a stamp", file=sys.stderr)

    return 0


def _state(moved: list[str] | None) -> str:
    if moved is None:
        return "unknown: no fingerprint of that run"
    if not moved:
        return "what decides them has not moved"
    more = f" and {len(moved) - SHOWN} more" if len(moved) > SHOWN else ""
    return f"OUT OF DATE: moved since: {', '.join(moved[:SHOWN])}{more}"


if __name__ == "__main__":
    sys.exit(main())
