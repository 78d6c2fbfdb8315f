"""Values as JSON has them: it knows no NaN and no infinity."""

import json
from collections.abc import Mapping
from math import isfinite
from typing import Any

__all__ = ["finite", "parse_json"]


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


def parse_json(content: str | bytes) -> Any:
    """Read JSON that somebody gives.

    >>> parse_json('{"force_mn": NaN}')
    Traceback (most recent call last):
    ValueError: not JSON: NaN is no number of JSON

    Raises:
        ValueError: no JSON, numbers that are not finite or have thousands of digits, or nested too deep.
    """
    try:
        return json.loads(content, parse_constant=_refuse, parse_float=_finite_float)
    except RecursionError as fault:
        raise ValueError("not JSON: nested too deep") from fault
    except ValueError as fault:
        raise ValueError(f"not JSON: {fault}") from fault


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is no number of JSON")


def _finite_float(digits: str) -> float:
    if not isfinite(number := float(digits)):
        raise ValueError(f"{digits[:20]} is too large a number")
    return number
