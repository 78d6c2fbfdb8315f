"""What a module offers stands in its `__all__`: nothing public is left out, and nothing else is imported from it."""

import ast
from functools import cache
from pathlib import Path

from parsed import parsed, syntax_nodes

import scleraforce

ROOT = Path(scleraforce.__file__).parent
DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


def dotted(path: Path) -> str:
    """The module's full name."""
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


MODULES = {dotted(path): path for path in sorted(ROOT.rglob("*.py"))}


@cache
def offered(name: str) -> frozenset[str]:
    """What a module's `__all__` lists; nothing where there is none."""
    for node in parsed(MODULES[name]).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return frozenset(ast.literal_eval(node.value))
    return frozenset()


def test_what_is_not_in_all_has_a_leading_underscore() -> None:
    for name in MODULES:
        defined = [node.name for node in parsed(MODULES[name]).body if isinstance(node, DEFINITIONS)]
        left_out = [entry for entry in defined if entry[0] != "_" and entry not in offered(name)]
        assert not left_out, f"{name}: add {', '.join(left_out)} to __all__, or a leading underscore"


def test_a_module_takes_only_what_another_offers() -> None:
    for name in MODULES:
        for node in syntax_nodes(MODULES[name]):
            if isinstance(node, ast.ImportFrom) and node.module in MODULES:
                taken = {alias.name for alias in node.names if f"{node.module}.{alias.name}" not in MODULES}
                hidden = sorted(taken - offered(node.module))
                assert not hidden, f"{name}:{node.lineno}: {', '.join(hidden)}: not in __all__ of {node.module}"


def test_a_module_of_a_package_is_asked_only_for_what_it_offers() -> None:
    for name in MODULES:
        check_what_it_asks_for(name)


def check_what_it_asks_for(name: str) -> None:
    modules = {
        alias.asname or alias.name: f"{node.module}.{alias.name}"
        for node in syntax_nodes(MODULES[name])
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if f"{node.module}.{alias.name}" in MODULES
    }
    for node in syntax_nodes(MODULES[name]):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules:
            other = modules[node.value.id]
            assert node.attr in offered(other), f"{name}:{node.lineno}: {node.attr}: not in __all__ of {other}"


def public(name: str) -> set[str]:
    """What a module defines and offers, other than classes: functions, constants, aliases of types."""
    defined: set[str] = set()
    for node in parsed(MODULES[name]).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            defined.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            defined |= {part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)}
    return defined & offered(name)


def test_a_public_name_stands_for_one_thing() -> None:
    """A command of the terminal and a function of the notebook may be called as the task that they offer."""
    places: dict[str, list[str]] = {}
    for name in MODULES:
        body = parsed(MODULES[name]).body
        classes = {node.name for node in body if isinstance(node, ast.ClassDef) and node.name[0] != "_"}
        edge = name.startswith(("scleraforce.cli.", "scleraforce.notebook"))
        for found in classes if edge else classes | public(name) - {"main"}:
            places.setdefault(found, []).append(name)
    twice = {name: where for name, where in places.items() if where[1:]}
    assert not twice, f"a name stands for one thing: {twice}"
