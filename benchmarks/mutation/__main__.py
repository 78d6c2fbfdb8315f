"""Share of seeded faults that the default tests find, in one tree or in two trees for
the same faults.

python -m mutation TREE [OTHER] --packages monitor mechanics --count 100 --seed 1

A fault swaps one operator, comparison or bound, or changes one constant. With OTHER,
only faults that both trees offer take part: the same expression in the function of the
same name, in whatever module it is. Each tree is copied, the files of tests of the
function's package that call it run on the copy with `-x` (all, where none was seen to:
see `callers`), and a run that fails or exceeds its limit kills the fault.
"""

import argparse
import ast
import json
import os
import queue
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).parent  # where pytest finds `callers`
SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
BOUNDS = {
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "maximum": "minimum",
    "ceil": "floor",
    "floor": "ceil",
}
# limit of a faulty run: this multiple of the sound run, plus the start
SLOWER = 4.0
START_S = 60.0
SURVIVED = "SURVIVED"
# function, expression, the same with the fault, and which of equal ones
Key = tuple[str, str, str, int]


@dataclass(frozen=True)
class Fault:
    """A place in a module below `src/scleraforce`, as (line, byte) from start to end,
    and the faulty expression.
    """

    module: Path
    start: tuple[int, int]
    end: tuple[int, int]
    faulty: str

    def applied(self, source: bytes) -> bytes:
        """Return the source with the fault."""
        lines = source.splitlines(keepends=True)
        before = (
            b"".join(lines[: self.start[0] - 1])
            + lines[self.start[0] - 1][: self.start[1]]
        )
        after = lines[self.end[0] - 1][self.end[1] :] + b"".join(lines[self.end[0] :])

        return before + b"(" + self.faulty.encode() + b")" + after


def faulty(node: ast.expr) -> str | None:
    """Return an expression with its fault; None if it offers none."""
    wrong = deepcopy(node)
    match wrong:
        case ast.BinOp(op=operator) | ast.BoolOp(op=operator) if (
            type(operator) in SWAPS
        ):
            wrong.op = SWAPS[type(operator)]()  # type: ignore[assignment]  # of the same family
        case ast.Compare(ops=[operator, *_]) if type(operator) in SWAPS:
            wrong.ops[0] = SWAPS[type(operator)]()  # type: ignore[call-overload]  # as above
        case ast.Call(func=ast.Name(id=name) as called) if name in BOUNDS:
            called.id = BOUNDS[name]
        case ast.Call(func=ast.Attribute(attr=name) as called) if name in BOUNDS:
            called.attr = BOUNDS[name]
        case ast.Constant(value=bool(value)):
            wrong.value = not value
        case ast.Constant(value=int(value)):
            wrong.value = value + 1
        case ast.Constant(value=float(value)):
            wrong.value = 1.5 * value or 1.0
        case _:
            return None

    return ast.unparse(wrong)


def expressions(node: ast.AST) -> Iterator[ast.expr]:
    """Yield the expressions that run in a function: no annotation, default, decorator
    or part of a text.
    """
    match node:
        case ast.FunctionDef(body=body):
            parts: list[ast.AST] = list(body)
        case ast.AnnAssign(value=value):
            parts = [] if value is None else [value]
        case _:
            parts = list(ast.iter_child_nodes(node))

    for part in parts:
        if not isinstance(part, ast.JoinedStr | ast.FunctionDef | ast.ClassDef):
            if isinstance(part, ast.expr):
                yield part
            yield from expressions(part)


def functions(node: ast.AST, scope: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield each function with its qualified name."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.ClassDef):
            name = f"{scope}{child.name}"
            if isinstance(child, ast.FunctionDef):
                yield name, child
            yield from functions(child, f"{name}.")


def faults_of(tree: Path, packages: list[str]) -> dict[Key, Fault]:
    """Return the faults that modules of some packages (none: all) offer; functions of
    one name are left out.
    """
    root = tree / "src" / "scleraforce"
    files = [file for name in packages or [""] for file in (root / name).rglob("*.py")]
    found = [
        (name, node, file)
        for file in sorted(files)
        for name, node in functions(ast.parse(file.read_bytes()))
    ]
    named = Counter(name for name, *_ in found)
    offered: dict[Key, Fault] = {}

    for name, function, file in found:
        equal: Counter[tuple[str, str]] = Counter()
        for node in expressions(function) if named[name] == 1 else ():
            wrong = faulty(node)
            if (
                wrong is not None
                and node.end_lineno is not None
                and node.end_col_offset is not None
            ):
                pair = (ast.unparse(node), wrong)
                start = (node.lineno, node.col_offset)
                end = (node.end_lineno, node.end_col_offset)
                offered[(name, *pair, equal[pair])] = Fault(
                    file.relative_to(root), start, end, wrong
                )
                equal[pair] += 1

    return offered


class Copy:
    """A copy of a tree in which faults are tried."""

    def __init__(self, folder: Path, noted: Path) -> None:
        """Take a folder with the copy, and one with what the sound tests showed."""
        self.folder = folder
        self.noted = noted
        self.printed = folder / "printed.txt"  # by the last run

    def passes(
        self, tests: list[str], settings: dict[str, str], limit_s: float | None = None
    ) -> bool | None:
        """Run the default tests of folders or files; return None if they exceed a
        limit.
        """
        command = [sys.executable, "-m", "pytest", "-x", "-q"]
        command += ["-p", "no:cacheprovider", "-p", "callers"]
        command += tests
        environment = os.environ | settings
        environment["PYTHONPATH"] = os.pathsep.join(
            [str(self.folder / "src"), str(HERE)]
        )
        environment["XDG_CACHE_HOME"] = str(self.folder / "cache")

        with (
            self.printed.open("w", encoding="utf-8") as printed,
            subprocess.Popen(
                command,
                cwd=self.folder,
                env=environment,
                stdout=printed,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            ) as run,
        ):
            try:
                return run.wait(limit_s) == 0
            except subprocess.TimeoutExpired:
                os.killpg(run.pid, signal.SIGKILL)
                return None

    def try_sound(self, package: str) -> float:
        """Run a package's tests without a fault, note what each calls, and return the
        seconds that this took.
        """
        note = {"MUTATION_NOTE": str(self.noted / f"{package}.json")}
        start = time.perf_counter()
        if not self.passes([f"tests/{package}"], note):
            end = self.printed.read_text(encoding="utf-8")[-2000:]
            raise SystemExit(f"tests/{package} fails without a fault:\n{end}")

        return time.perf_counter() - start

    def outcome(self, fault: Fault, function: str, seconds: float) -> str:
        """Return what becomes of a fault by the files of tests that call the faulty
        function; by all of its package where none was seen to.
        """
        package = package_of(self.folder, fault)
        noted = self.noted / f"{package}.json"
        called = f"{fault.module}:{function}"
        calls = json.loads(noted.read_text(encoding="utf-8"))
        files = {test.partition("::")[0] for test in calls if called in calls[test]}
        tests = sorted(files) or [f"tests/{package}"]
        file = self.folder / "src" / "scleraforce" / fault.module
        sound = file.read_bytes()
        file.write_bytes(fault.applied(sound))

        try:
            passed = self.passes(tests, {}, SLOWER * seconds + START_S)
        finally:
            file.write_bytes(sound)

        return {True: SURVIVED, False: "killed", None: "too slow"}[passed]


def package_of(tree: Path, fault: Fault) -> str:
    """Return the folder of the tests that try a fault; "" for all of them."""
    package = fault.module.parts[0]
    return package if (tree / "tests" / package).is_dir() else ""


def copy_tree(tree: Path, folder: Path) -> None:
    """Copy the files that git tracks."""
    names = subprocess.run(
        ["git", "ls-files"], cwd=tree, capture_output=True, text=True, check=True
    ).stdout
    for name in names.splitlines():
        if (tree / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(tree / name, folder / name)


def try_faults(
    tree: Path, faults: list[tuple[Key, Fault]], workers: int, work: Path
) -> int:
    """Try each fault on copies of a tree, print what became of it, and return how many
    were killed.
    """
    noted = work / "noted"
    noted.mkdir()
    first = Copy(work / "0", noted)
    copy_tree(tree, first.folder)
    packages = sorted({package_of(first.folder, fault) for _, fault in faults})
    seconds = {package: first.try_sound(package) for package in packages}
    print({package: round(s) for package, s in seconds.items()}, "s", flush=True)

    copies = queue.SimpleQueue[Copy]()
    copies.put(first)
    for number in range(1, workers):
        folder = work / str(number)
        shutil.copytree(first.folder, folder)  # with what the sound tests compiled
        copies.put(Copy(folder, noted))

    def dies(drawn: tuple[Key, Fault]) -> bool:
        key, fault = drawn
        copied = copies.get()
        try:
            outcome = copied.outcome(
                fault, key[0], seconds[package_of(copied.folder, fault)]
            )
        finally:
            copies.put(copied)

        place = f"{fault.module}:{fault.start[0]} {key[0]}: {key[1]} -> {key[2]}"
        print(f"{outcome:<9} {place}", flush=True)

        return outcome != SURVIVED

    with ThreadPoolExecutor(workers) as pool:
        return sum(pool.map(dies, faults))


def main() -> int:
    """Draw faults, run the tests of each tree on them, and print the share that each
    tree's tests kill.
    """
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "trees",
        nargs="+",
        type=Path,
        metavar="TREE",
        help="checkouts; one, or two to compare",
    )
    parser.add_argument(
        "--packages", nargs="+", default=[], help="of the first tree; by default all"
    )
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2, help="copies tried at once")
    given = parser.parse_args()
    first, *others = (
        faults_of(tree, given.packages if n == 0 else [])
        for n, tree in enumerate(given.trees)
    )
    shared = [key for key in sorted(first) if all(key in other for other in others)]
    drawn = random.Random(given.seed).sample(shared, min(given.count, len(shared)))
    print(f"{len(drawn)} of {len(shared)} faults, seed {given.seed}")

    for tree, offered in zip(given.trees, (first, *others), strict=True):
        faults = [(key, offered[key]) for key in drawn]
        with TemporaryDirectory(prefix="scleraforce-mutation-") as folder:
            killed = try_faults(tree.resolve(), faults, given.workers, Path(folder))

        print(
            f"{tree}: {killed} of {len(drawn)} killed,"
            f" {100 * killed / max(len(drawn), 1):.0f} %"
        )

    return 0


if __name__ == "__main__":
    sys.exit(main())
