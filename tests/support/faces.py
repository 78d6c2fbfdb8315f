"""Which names of the package a test function uses, and which of them are public.

Public are the names that a package's docstring lists under `Public:` or that its
`__init__` imports, those of `import scleraforce as sf`, the command line's `run`, and
the types in the signatures and fields of public names.
"""

import ast
import builtins
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from sources import parsed

import scleraforce

ROOT = Path(scleraforce.__file__).parent
TESTS = Path(__file__).parents[1]
COMMAND_LINE = "scleraforce.front.cli.main.run"
LISTED = re.compile(r"^    (\w+): ((?:`\w+`(?:,\s+)?)+)", re.MULTILINE)


def module_name(path: Path) -> str:
    """Return the dotted name of a module of the package."""
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


def statements(tree: ast.AST) -> Iterator[ast.stmt]:
    """Yield the statements below a node, without their expressions."""
    for part in ("body", "orelse", "handlers", "finalbody"):
        for node in getattr(tree, part, ()):
            if isinstance(node, ast.stmt):
                yield node
            yield from statements(node)


@cache
def imported_names(path: Path) -> dict[str, str]:
    """Return what a file imports: the name in the file and the full name."""
    found: dict[str, str] = {}
    for node in statements(parsed(path)):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                found[alias.asname or alias.name] = f"{node.module}.{alias.name}"
        elif isinstance(node, ast.Import):
            for alias in node.names:
                first = alias.name.partition(".")[0]
                found[alias.asname or first] = alias.name if alias.asname else first

    return found


@cache
def definitions(path: Path) -> dict[str, ast.stmt]:
    """Return the statements at the top of a file, by each name that they define."""
    found: dict[str, ast.stmt] = {}
    for node in parsed(path).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = node
        elif not isinstance(node, ast.Import | ast.ImportFrom):
            stored = [
                part.id
                for part in ast.walk(node)
                if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)
            ]
            found |= dict.fromkeys(stored, node)

    return found


MODULES = {module_name(path): path for path in ROOT.rglob("*.py")}


@cache
def original_name(name: str) -> str:
    """Return the name of a thing in the module that defines it."""
    module, _, local = name.rpartition(".")
    path = MODULES.get(module)
    while path is not None and local not in definitions(path):
        if local not in imported_names(path):
            break
        name = imported_names(path)[local]
        module, _, local = name.rpartition(".")
        path = MODULES.get(module)

    return name


@cache
def docstring_names(package: Path) -> frozenset[str]:
    """Return the full names that a package's docstring lists under `Public:`; `package`
    is its `__init__`.
    """
    text = ast.get_docstring(parsed(package)) or ""
    return frozenset(
        f"{module_name(package)}.{module}.{name}"
        for module, names in LISTED.findall(text.partition("\nPublic:")[2])
        for name in re.findall(r"\w+", names)
    )


def listed_names() -> set[str]:
    """Return the names that packages list and that their `__init__` imports."""
    found = {COMMAND_LINE}
    for path in ROOT.rglob("__init__.py"):
        names = docstring_names(path).union(imported_names(path).values())
        found |= {original_name(name) for name in names}

    return found


def annotations(node: ast.stmt) -> Iterator[ast.expr]:
    """Yield the annotations of a function, or of a class's fields and methods; of an
    assignment its value, which may be a union of types.
    """
    match node:
        case ast.FunctionDef(args=arguments, returns=returned):
            given = [one.annotation for one in (*arguments.args, *arguments.kwonlyargs)]
            yield from (one for one in (*given, returned) if one is not None)
        case ast.ClassDef(body=body):
            for part in body:
                if (
                    not isinstance(part, ast.FunctionDef)
                    or not part.name.startswith("_")
                    or part.name == "__init__"
                ):
                    yield from annotations(part)
        case ast.AnnAssign(annotation=annotation):
            yield annotation
        case ast.Assign(value=ast.BinOp(op=ast.BitOr()) as union):
            yield union


@cache
def public_names() -> frozenset[str]:
    """Return every public name, by the module that defines it."""
    found = listed_names()
    waiting = [*found]
    while waiting:
        module, _, local = waiting.pop().rpartition(".")
        path = MODULES.get(module)
        if path is None or local not in definitions(path):
            continue
        for annotation in annotations(definitions(path)[local]):
            for part in ast.walk(annotation):
                if not isinstance(part, ast.Name):
                    continue
                name = original_name(f"{module}.{part.id}")
                if name.startswith("scleraforce.") and name not in found:
                    found.add(name)
                    waiting.append(name)

    return frozenset(found)


@cache
def used_names(path: Path, name: str) -> frozenset[str]:
    """Return the package's names that a definition of a test file uses, also by its
    helpers and fixtures.
    """
    found: set[str] = set()
    seen: set[tuple[Path, str]] = set()
    waiting = [(path, name)]
    while waiting:
        place = waiting.pop()
        if place not in seen:
            seen.add(place)
            helpers, names = directly_used(*place)
            waiting += helpers
            found |= names

    return frozenset(found)


@cache
def directly_used(path: Path, name: str) -> tuple[list[tuple[Path, str]], set[str]]:
    """Return the helpers, as file and name, and the package's names that a definition
    itself uses.
    """
    helpers: list[tuple[Path, str]] = []
    names: set[str] = set()
    node = definitions(path).get(name)
    if node is not None:
        for used in names_in(node) - {name}:
            helpers += helpers_named(path, used)
            names |= package_names(path, used, node)

    return helpers, names


def names_in(node: ast.stmt) -> set[str]:
    """Return the names that a definition reads, its parameters (fixtures) among them."""
    found = set()
    for part in ast.walk(node):
        if isinstance(part, ast.Name):
            found.add(part.id)
        elif isinstance(part, ast.arg):
            found.add(part.arg)
    return found


def helpers_named(file: Path, name: str) -> list[tuple[Path, str]]:
    """Return the places of a helper or fixture that a test file may mean by a name."""
    full = imported_names(file).get(name, "")
    module, _, local = full.rpartition(".")
    if hasattr(builtins, name):
        return []
    if name in definitions(file):
        return [(file, name)]
    if full and not full.startswith("scleraforce"):
        helpers = [TESTS / part / f"{module}.py" for part in ("support", "oracles")]
        return [(helper, local) for helper in helpers if helper.is_file()]
    return [(conftest, name) for conftest in conftests_of(file.parent)]


@cache
def conftests_of(folder: Path) -> tuple[Path, ...]:
    """Return the files of fixtures of a folder of tests and of those above it."""
    own = folder / "conftest.py"
    above = () if folder == TESTS.parent else conftests_of(folder.parent)
    return (own, *above) if own.is_file() else above


def package_names(file: Path, name: str, node: ast.stmt) -> set[str]:
    """Return the package's names behind an imported name: of a module the attributes
    that a definition uses.
    """
    full = imported_names(file).get(name, "")
    if full not in MODULES or full == "scleraforce":
        return {original_name(full)} if full.startswith("scleraforce.") else set()
    return {
        original_name(f"{full}.{part.attr}")
        for part in ast.walk(node)
        if isinstance(part, ast.Attribute)
        and isinstance(part.value, ast.Name)
        and part.value.id == name
    }


def names_behind(file: Path, test: str) -> frozenset[str]:
    """Return the names that a test function uses and that are not public."""
    return used_names(file, test) - public_names()
