"""Values as JSON has them: it knows no NaN and no infinity."""

from collections.abc import Mapping
from math import isfinite
from typing import Any

__all__ = ["finite"]


def finite(value: Any) -> Any:
    """Return a value with null for each number in it that is not finite, and lists for tuples.

    >>> finite({"force_mn": float("nan"), "interval_mn": (1.0, 2.0)})
    {'force_mn': None, 'interval_mn': [1.0, 2.0]}
    """
    match value:
        case Mapping():
            return {key: finite(entry) for key, entry in value.items()}
        case list() | tuple():
            return [finite(entry) for entry in value]
        case float() if not isfinite(value):
            return None
        case _:
            return value
