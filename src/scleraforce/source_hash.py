"""A hash of the source code that decides a result: results of other code are then known and made anew.

The sources of a module are its own file and those of all modules that it imports, in functions too, as far as they
belong to this package (or to the packages that are named). Nothing is imported to find them. Other packages and data
files do not count.
"""

import ast
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path

PACKAGE = Path(__file__).parent


def hash_sources(*modules: str, apart_from: Iterable[str] = (), packages: Mapping[str, Path] | None = None) -> str:
    """Return the SHA-256, in hexadecimal, of the sources of modules; arguments and errors of `sources`.

    >>> hash_sources("scleraforce.units") == hash_sources("scleraforce.units", "scleraforce.errors")
    False
    """
    places = _places(packages)
    return hash_files(sources(*modules, apart_from=apart_from, packages=packages), places)


def hash_files(files: Iterable[Path], packages: Mapping[str, Path] | None = None) -> str:
    """Return the SHA-256, in hexadecimal, of files of the packages: their places there and what they hold."""
    folders = [folder.parent for folder in _places(packages).values()]
    named = {next(file.relative_to(f).as_posix() for f in folders if file.is_relative_to(f)): file for file in files}
    digest = sha256()
    for name, file in sorted(named.items()):
        content = file.read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def sources(
    *modules: str, apart_from: Iterable[str] = (), packages: Mapping[str, Path] | None = None
) -> frozenset[Path]:
    """Return the files of modules and of all that they import.

    Args:
        modules: their full names, like "scleraforce.library.build".
        apart_from: modules that are not followed, and do not count.
        packages: packages to stay within beside this one: name to folder.

    Raises:
        ValueError: there is no such module.
    """
    places, left_out = _places(packages), set(apart_from)
    found: dict[str, Path] = {}
    waiting = list(modules)
    for name in modules:
        if _file(name, places) is None:
            raise ValueError(f"{name}: no such module")
    while waiting:
        name = waiting.pop()
        file = _file(name, places)
        if file is not None and name not in found and name not in left_out:
            found[name] = file
            waiting += [*_imported(file, file.stat().st_mtime_ns), *_parents(name)]
    return frozenset(found.values())


def sources_in_rooms(
    *modules: str, rooms: Collection[str], beside: Collection[str] = (), apart_from: Iterable[str] = ()
) -> list[str]:
    """Return the places in the package of what modules import from some of its rooms, in order.

    Args:
        modules: as of `sources`.
        rooms: folders of the package.
        beside: places of files of other rooms that count, too.
        apart_from: as of `sources`.
    """
    found = (path.relative_to(PACKAGE) for path in sources(*modules, apart_from=apart_from))
    return sorted(path.as_posix() for path in found if path.parts[0] in rooms or path.as_posix() in beside)


def _places(packages: Mapping[str, Path] | None) -> dict[str, Path]:
    return {PACKAGE.name: PACKAGE, **(packages or {})}


def _file(name: str, places: Mapping[str, Path]) -> Path | None:
    """Return the file of a module; None where it is no module of the packages."""
    package, *rest = name.split(".")
    if package not in places:
        return None
    path = places[package].joinpath(*rest)
    candidates = (path.with_name(f"{path.name}.py"), path / "__init__.py")
    return next((file for file in candidates if file.is_file()), None)


@cache
def _imported(file: Path, _changed_ns: int) -> tuple[str, ...]:
    """Return what a file imports; of `from a import b` both a and a.b, either of which may be the module.

    A file is read again where its time of change is another. What is imported for type checkers alone decides no
    result: the package's own face would lead to every module.
    """
    found: list[str] = []
    waiting: list[ast.AST] = [ast.parse(file.read_bytes())]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            waiting += node.orelse
            continue
        waiting += ast.iter_child_nodes(node)
        if isinstance(node, ast.Import):
            found += (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(found)


def _parents(name: str) -> list[str]:
    """Return the packages that are imported with a module."""
    parts = name.split(".")
    return [".".join(parts[:count]) for count in range(1, len(parts))]
