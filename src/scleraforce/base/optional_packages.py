"""Packages that come with an extra, imported when they are needed."""

from importlib import import_module
from typing import Any

from scleraforce.base.errors import InputError


def package_for(name: str, kind: str, extra: str = "formats") -> Any:
    """Import and return an optional package, of an `extra`, that reads or writes files
    of a kind.
    """
    try:
        return import_module(name)
    except ImportError as fault:
        found = (
            f"{kind} takes the package {name.partition('.')[0]}, which is not installed"
        )
        raise InputError(f"{found}: pip install 'scleraforce[{extra}]'") from fault
