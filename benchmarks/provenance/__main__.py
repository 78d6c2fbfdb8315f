"""`make stale`: which generated figures of the pages are older than their sources.

python -m provenance                          list them
python -m provenance --stamp COMMAND MODULE   print the line for figures that COMMAND has made from MODULE just now
"""

import argparse
import sys

from provenance.stamps import ROOT, new_stamp, read_stamps


def main() -> int:
    """List the figures, or print a stamp; return 0, also where figures are older: a run of them takes long."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--stamp", nargs="+", metavar=("COMMAND", "MODULE"), help="print the line of new figures")
    given = parser.parse_args()
    if given.stamp:
        print(new_stamp(*given.stamp))
        return 0
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *(ROOT / "benchmarks").glob("RESULTS.md")]
    found = [(page, stamp) for page in pages for stamp in read_stamps(page)]
    for page, stamp in found:
        state = "of today's sources" if stamp.current else "OLDER than its sources"
        print(f"{page.relative_to(ROOT)}: {stamp.made_by}, {stamp.commit} of {stamp.day}: {state}")
    if not found:
        print("no page has generated figures with a stamp", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
