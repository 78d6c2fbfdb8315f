"""Our mechanics beside published theory and measurement: the tables of
real_tissue/README.md.

    python benchmarks/bench_real_tissue.py [--rows N] [TABLE...]

Some minutes on one core, most of it for the flat punch. The stamp above the tables is
that of the page.
"""

import argparse

from provenance.stamps import new_stamp
from real_tissue.tables import TABLES


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument(
        "table", nargs="*", default=list(TABLES), help=f"some of {', '.join(TABLES)}"
    )
    parser.add_argument("--rows", type=int, help="only the first N of each table")
    given = parser.parse_args()
    print(new_stamp("python benchmarks/bench_real_tissue.py"))

    for name in given.table:
        print(f"\n{name}\n\n{TABLES[name](given.rows)}", flush=True)


if __name__ == "__main__":
    main()
