"""A script of the folder `examples`, as a module."""

import importlib.util
from pathlib import Path
from types import ModuleType

__all__ = ["example_module"]

EXAMPLES = Path(__file__).parents[2] / "examples"


def example_module(name: str) -> ModuleType:
    """Load `name`, like "slicer/bridge"; what it imports has to be there."""
    spec = importlib.util.spec_from_file_location(Path(name).name, EXAMPLES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
