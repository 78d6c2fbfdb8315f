"""Share of seeded faults that the default tests of a tree find.

python -m mutation TREE --packages live mechanics --count 100 --seed 1

A fault swaps one operator, comparison or bound, or changes one constant. The tree is
copied, the files of tests of the function's package that call it run on the copy with
`-x` (all, where none was seen to: see `callers`), and a run that fails or exceeds its
limit kills the fault.
"""

import argparse
import ast
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

HERE = Path(__file__).parent  # where pytest finds `callers`
SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Mult: ast.Div,
    ast.And: ast.Or,
    ast.Lt: ast.LtE,
    ast.Gt: ast.GtE,
    ast.Eq: ast.NotEq,
}
SWAPS |= {after: before for before, after in SWAPS.items()}
BOUNDS = {"min": "max", "minimum": "maximum", "ceil": "floor"}
BOUNDS |= {after: before for before, after in BOUNDS.items()}
# limit of a faulty run: this multiple of the sound run, plus the start
SLOWER = 4.0
START_S = 60.0
SURVIVED = "SURVIVED"


@dataclass(frozen=True)
class Fault:
    """An expression of a function in a module below `src/scleraforce`, as (line, byte)
    from start to end, and what takes its place.
    """

    module: Path
    function: str
    start: tuple[int, int]
    end: tuple[int, int]
    sound: str
    faulty: str

    def applied(self, source: bytes) -> bytes:
        """Return the source with the fault."""
        lines = source.splitlines(keepends=True)
        line, column = self.start
        before = b"".join(lines[: line - 1]) + lines[line - 1][:column]
        line, column = self.end
        after = lines[line - 1][column:] + b"".join(lines[line:])
        return before + b"(" + self.faulty.encode() + b")" + after

    def __str__(self) -> str:
        place = f"{self.module}:{self.start[0]} {self.function}"
        return f"{place}: {self.sound} -> {self.faulty}"


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


def faults_of(tree: Path, packages: list[str]) -> Iterator[Fault]:
    """Yield the faults that modules of some packages (none: all) offer."""
    root = tree / "src" / "scleraforce"
    files = [file for name in packages or [""] for file in (root / name).rglob("*.py")]
    for file in sorted(files):
        for name, function in functions(ast.parse(file.read_bytes())):
            for node in expressions(function):
                wrong = faulty(node)
                line = node.end_lineno
                column = node.end_col_offset
                if wrong is not None and line is not None and column is not None:
                    yield Fault(
                        file.relative_to(root),
                        name,
                        (node.lineno, node.col_offset),
                        (line, column),
                        ast.unparse(node),
                        wrong,
                    )


class Copy:
    """A copy of a tree in which faults are tried one after the other."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._sound_s: dict[str, float] = {}

    def passes(
        self, tests: list[str], settings: dict[str, str], limit_s: float | None = None
    ) -> bool | None:
        """Run the default tests of folders or files; return None if they exceed a
        limit.
        """
        command = [sys.executable, "-m", "pytest", "-x", "-q"]
        command += ["-p", "no:cacheprovider", "-p", "callers", *tests]
        path = os.pathsep.join([str(self.folder / "src"), str(HERE)])
        cache = str(self.folder / "cache")
        with subprocess.Popen(
            command,
            cwd=self.folder,
            env=os.environ | settings | {"PYTHONPATH": path, "XDG_CACHE_HOME": cache},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as run:
            try:
                return run.wait(limit_s) == 0
            except subprocess.TimeoutExpired:
                os.killpg(run.pid, signal.SIGKILL)
                return None

    def package_of(self, fault: Fault) -> str:
        """Return the folder of the tests that try a fault; "" for all of them."""
        package = fault.module.parts[0]
        return package if (self.folder / "tests" / package).is_dir() else ""

    def try_sound(self, package: str) -> float:
        """Run a package's tests without a fault, once; note what each calls, and return
        the seconds that this took.
        """
        if package not in self._sound_s:
            note = {"MUTATION_NOTE": str(self._note(package))}
            start = time.perf_counter()
            if not self.passes([f"tests/{package}"], note):
                raise SystemExit(f"tests/{package} fails without a fault")
            self._sound_s[package] = time.perf_counter() - start
            print(f"tests/{package}: {self._sound_s[package]:.0f} s", flush=True)

        return self._sound_s[package]

    def _note(self, package: str) -> Path:
        return self.folder / f"called-by-{package}.json"

    def outcome(self, fault: Fault) -> str:
        """Return what becomes of a fault by the files of tests that call the faulty
        function; by all of its package where none was seen to.
        """
        package = self.package_of(fault)
        limit_s = SLOWER * self.try_sound(package) + START_S
        noted = self._note(package).read_text(encoding="utf-8")
        name = f"{fault.module}:{fault.function}"
        files = {
            test.partition("::")[0]
            for test, called in json.loads(noted).items()
            if name in called
        }
        file = self.folder / "src" / "scleraforce" / fault.module
        sound = file.read_bytes()
        file.write_bytes(fault.applied(sound))
        try:
            passed = self.passes(sorted(files) or [f"tests/{package}"], {}, limit_s)
        finally:
            file.write_bytes(sound)

        return {True: SURVIVED, False: "killed", None: "too slow"}[passed]


def copy_tree(tree: Path, folder: Path) -> None:
    """Copy the files that git tracks."""
    names = subprocess.run(
        ["git", "ls-files"], cwd=tree, capture_output=True, text=True, check=True
    ).stdout
    for name in names.splitlines():
        if (tree / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(tree / name, folder / name)


def main() -> None:
    """Draw faults, run the tests on them, and print the share that they kill."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tree", type=Path, help="a checkout")
    parser.add_argument("--packages", nargs="+", default=[], help="all by default")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    offered = list(faults_of(given.tree, given.packages))
    drawn = random.Random(given.seed).sample(offered, min(given.count, len(offered)))
    print(f"{len(drawn)} of {len(offered)} faults, seed {given.seed}")
    killed = 0
    with TemporaryDirectory(prefix="scleraforce-mutation-") as folder:
        copy_tree(given.tree.resolve(), Path(folder))
        copied = Copy(Path(folder))
        for fault in drawn:
            outcome = copied.outcome(fault)
            killed += outcome != SURVIVED
            print(f"{outcome:<9} {fault}", flush=True)

    print(f"{killed} of {len(drawn)} killed, {100 * killed / len(drawn):.0f} %")


if __name__ == "__main__":
    main()
