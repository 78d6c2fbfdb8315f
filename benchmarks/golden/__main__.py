"""`make golden`: what today's code answers beside the frozen answers, and what moved,
in minutes.

python -m golden                       compare all groups with golden/answers.json
python -m golden --only GROUP...       compare these groups
python -m golden --of NAME...          compare the answers that are of these eyes
python -m golden --freeze              freeze today's answers (with --only, --of: these)
python -m golden --strict              exit code 1 where anything moved
"""

import argparse
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

from golden.answers import (
    FROZEN,
    Answers,
    Comparison,
    Record,
    compared,
    frozen_text,
    read_frozen,
)
from golden.computing import GROUPS, compute
from golden.inputs import ROOT, SHARED
from golden.tables import group_table, move_lines

WORKERS = 2
PACKAGES = ("numpy", "scipy", "numba", "opencv-python-headless", "onnxruntime")


def main(words: list[str] | None = None) -> int:
    """Compute, compare, print; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=GROUPS, default=GROUPS)
    parser.add_argument("--freeze", action="store_true", help="write the answers")
    parser.add_argument("--strict", action="store_true", help="1 where anything moved")
    parser.add_argument("--frozen", type=Path, default=FROZEN, help="file of answers")
    parser.add_argument("--workers", type=int, default=WORKERS)
    parser.add_argument(
        "--of", nargs="+", default=[], metavar="NAME", help="only of these eyes"
    )
    given = parser.parse_args(words)

    start_s = perf_counter()
    computed, failed = compute(tuple(given.only), given.workers, tuple(given.of))
    seconds = perf_counter() - start_s
    print(f"computed in {seconds:.0f} s", file=sys.stderr)
    if failed:
        print("\n".join(f"could not be computed: {words}" for words in failed))
        return 1
    if given.freeze:
        freeze(given.frozen, computed, given.of)
        return 0
    made, frozen = read_frozen(given.frozen)
    if given.of:
        frozen = {group: _of(answers, given.of) for group, answers in frozen.items()}
    moved = report(made, frozen, computed)
    return int(given.strict and moved)


def report(
    made: Record, frozen: Mapping[str, Answers], computed: Mapping[str, Answers]
) -> bool:
    """Print what moved; return whether anything did."""
    comparisons: dict[str, tuple[Answers, Comparison]] = {}
    for group, answers in computed.items():
        before = {
            name: record
            for name, record in frozen.get(group, {}).items()
            if _is_here(name) or name in answers
        }
        comparisons[group] = answers, compared(before, answers)
    print(f"Frozen by {made['commit']} on {made['date']}, {made['platform']}.\n")
    print(group_table(comparisons))
    moved = [group for group, (_, one) in comparisons.items() if not one.is_empty]
    if moved:
        print()
    for group in moved:
        print("\n".join(move_lines(group, comparisons[group][1])))
    return bool(moved)


def _is_here(name: str) -> bool:
    """Return whether an answer is of inputs that are here: those of the shared folder
    may be absent.
    """
    of_shared = name.startswith(("sample-", "real-", "cases/"))
    return SHARED.is_dir() or not of_shared


def _of(answers: Answers, names: Sequence[str]) -> Answers:
    """Return the answers that are of these eyes."""
    return {
        name: record
        for name, record in answers.items()
        if name.partition("/")[0] in names
    }


def freeze(
    path: Path, computed: Mapping[str, Answers], names: Sequence[str] = ()
) -> None:
    """Write answers, in place of frozen ones of the same groups, or of these eyes in
    them.
    """
    groups = read_frozen(path)[1] if path.exists() else {}
    for group, answers in computed.items():
        before = groups.get(group, {}) if names else {}
        replaced = _of(before, names)
        kept = {name: of for name, of in before.items() if name not in replaced}
        groups[group] = {**kept, **answers}
    path.write_text(frozen_text(_made(), groups), encoding="utf-8")
    print(f"wrote {path}", file=sys.stderr)


def _made() -> Record:
    """Return the commit, the day, the versions and the machine that answers are of."""
    commit = subprocess.run(
        ["git", "log", "-1", "--format=%h", "--", "src"],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    ).stdout.strip()
    return {
        "commit": commit,
        "date": datetime.now(UTC).date().isoformat(),
        "platform": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
    }


if __name__ == "__main__":
    sys.exit(main())
