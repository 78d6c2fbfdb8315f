"""Sources as syntax trees, and scripts of the folder `examples` as modules."""

import ast
import importlib.util
from functools import cache
from pathlib import Path
from types import ModuleType


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def syntax_nodes(path: Path) -> tuple[ast.AST, ...]:
    """Every node of that tree, in the order of `ast.walk`."""
    return tuple(ast.walk(parsed(path)))


EXAMPLES = Path(__file__).parents[2] / "examples"


def example_module(name: str) -> ModuleType:
    """Load `name`, like "slicer/bridge"; what it imports has to be there."""
    spec = importlib.util.spec_from_file_location(
        Path(name).name, EXAMPLES / f"{name}.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)

    return module
