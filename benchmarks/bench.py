"""Run every benchmark of this folder, one after the other, each in a process of its own.

    python benchmarks/bench.py [NAME...]

`bench_NAME.py` prints its tables; NAME picks some. Times on a shared machine tell ratios, not seconds.
"""

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent


def main(names: list[str]) -> int:
    """Run the named benchmarks, or all; return how many failed."""
    known = {path.stem.removeprefix("bench_"): path for path in sorted(FOLDER.glob("bench_*.py"))}
    if unknown := set(names) - set(known):
        print(f"error: {', '.join(sorted(unknown))}: no such benchmark; known: {', '.join(known)}", file=sys.stderr)
        return 2
    failed = 0
    for name in names or known:
        print(f"== {name} ==", flush=True)
        failed += subprocess.run([sys.executable, str(known[name])], check=False).returncode != 0
        print(flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
