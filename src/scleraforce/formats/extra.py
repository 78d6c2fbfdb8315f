"""Packages that only some formats need: asked for by name where they are missing."""

from importlib import import_module
from pathlib import Path
from typing import Any

from scleraforce.errors import InputError


def package_for(path: Path, name: str, kind: str) -> Any:
    """Import and return the package that reads or writes a file of a kind.

    Raises:
        InputError: it is not installed.
    """
    try:
        return import_module(name)
    except ImportError as fault:
        package = name.partition(".")[0]
        raise InputError(
            f"{path}: {kind} takes the package {package}, which is not installed: pip install 'scleraforce[formats]'"
        ) from fault
