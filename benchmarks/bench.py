"""Run every benchmark of this folder, one after the other, each in a process of its own.

    python benchmarks/bench.py [NAME...] [--model MODEL] [--recording RECORDING] [--finder MODEL]

`bench_NAME.py` prints its tables; NAME picks some. Those that read frames need a model of kind "reader", the monitor a
recording of `scleraforce phantom` too, that of the wall finder a model of that kind: without them they are left out,
by name. Times on a shared machine tell ratios,
not seconds.
"""

import argparse
import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent
NEEDED = {
    "live_reader": ["{model}"],
    "monitor": ["latency", "{model}", "{recording}"],
    "monitor_sessions": ["{model}"],
    "reader": ["{model}"],
    "wall_finder": ["{finder}"],
}


def main() -> int:
    """Run the named benchmarks, or all; return 0 if none failed, 1 if one did, 2 if there is no such benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("name", nargs="*")
    parser.add_argument("--model", help='of kind "reader"')
    parser.add_argument("--recording", help="virtual acquisition")
    parser.add_argument("--finder", help='of kind "wall-finder"')
    given = parser.parse_args()
    known = {path.stem.removeprefix("bench_"): path for path in sorted(FOLDER.glob("bench_*.py"))}
    if unknown := set(given.name) - set(known):
        print(f"error: {', '.join(sorted(unknown))}: no such benchmark; known: {', '.join(known)}", file=sys.stderr)
        return 2
    had = {key: value for key in ("model", "recording", "finder") if (value := getattr(given, key))}
    failed, left_out = [], []
    for name in given.name or known:
        needed = NEEDED.get(name, [])
        if any(word.strip("{}") not in had for word in needed if word[0] == "{"):
            left_out.append(f"{name} ({' '.join(word.strip('{}').upper() for word in needed if word[0] == '{')})")
            continue
        print(f"== {name} ==", flush=True)
        command = [sys.executable, str(known[name]), *(word.format(**had) for word in needed)]
        if subprocess.run(command, check=False).returncode:
            failed.append(name)
        print(flush=True)
    if left_out:
        print(f"left out, for what they need is not given: {', '.join(left_out)}")
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
