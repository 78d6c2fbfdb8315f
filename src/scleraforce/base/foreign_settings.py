"""Other packages' settings files in the current folder, which are not to be read: the
folder may be anybody's.

Numba reads one at its import and before each compilation, Matplotlib at its import.
"""

import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, ModuleType

# Of each module, the line that names the file, and what it has to be.
LINES = {
    "numba.core.config": (
        b"_config_fname = '.numba_config.yaml'",
        f"_config_fname = {os.devnull!r}".encode(),
    ),
    "matplotlib": (b"        yield 'matplotlibrc'\n", b""),
}


def leave_unread(module: str) -> None:
    """Keep a module of `LINES` from reading its file, if it is not imported yet."""
    if module not in sys.modules and not any(
        isinstance(finder, _Finder) and finder.module == module
        for finder in sys.meta_path
    ):
        sys.meta_path.insert(0, _Finder(module))


class _Finder(MetaPathFinder):
    def __init__(self, module: str) -> None:
        self.module = module

    def find_spec(
        self,
        fullname: str,
        path: Sequence[str] | None,
        target: ModuleType | None = None,
    ) -> ModuleSpec | None:
        if fullname != self.module:
            return None

        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(fullname, spec.loader.path)

        return spec


class _Loader(SourceFileLoader):
    def get_code(self, fullname: str) -> CodeType | None:
        """Compile the module with another line in place of its own."""
        source = self.get_data(self.path).replace(*LINES[fullname])
        return self.source_to_code(source, self.path)
