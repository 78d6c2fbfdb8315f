"""The monitor as it runs: how soon it answers, how long it lasts, what faults and
hostile clients do to it.

    python benchmarks/bench_monitor.py KIND MODEL RECORDING [OPTIONS]

    KIND     its options
    latency  [--frames 100000] [--json FILE]
    soak     [--frames 300000] [--rate-hz 100]
    faults   [--times 100] [--deaths 20]
    hostile  [--connections 10000]
    session  [--rate-hz 1000] [--seconds 60] [--receiver] [--pages 1]

MODEL is of kind "reader", RECORDING a virtual acquisition of `scleraforce phantom` at
100 frames a second, with forces to 40 mN. The monitor is the command that users start,
on the first core; scanner, robot and its companions are on the others.
docs/monitor_figures.md says what is measured.
"""

import argparse
import json
import sys
from pathlib import Path

from monitor_service import faults, hostile, latency, session, soak
from scleraforce.base.errors import ScleraforceError

PARTS = {
    "latency": latency,
    "soak": soak,
    "faults": faults,
    "hostile": hostile,
    "session": session,
}


def main() -> int:
    """Run one part, print its tables, and keep its figures where that is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parts = parser.add_subparsers(dest="part", required=True)

    for name, part in PARTS.items():
        options = parts.add_parser(
            name, help=part.__doc__.split("\n\n")[0] if part.__doc__ else ""
        )
        options.add_argument("model", type=Path)
        options.add_argument("recording", type=Path)
        options.add_argument("--seed", type=int, default=0)
        options.add_argument("--json", type=Path, help="file for the figures")
        part.add_options(options)

    given = parser.parse_args()
    try:
        result = PARTS[given.part].run(given)
    except ScleraforceError as fault:
        print(f"error: {fault}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130

    if given.json:
        given.json.write_text(
            json.dumps({"part": given.part, **result}, indent=1) + "\n",
            encoding="utf-8",
        )

    return 0


if __name__ == "__main__":
    sys.exit(main())
