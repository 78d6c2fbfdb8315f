"""Values within the limits of JSON, which has no NaN and no infinity."""

import json
from collections import Counter
from collections.abc import Mapping
from math import isfinite
from typing import Any


def finite_json(value: Any) -> Any:
    """Return a value with null for each number in it that is not finite, and lists for
    tuples.

    >>> finite_json({"force_mn": float("nan"), "interval_mn": (1.0, 2.0)})
    {'force_mn': None, 'interval_mn': [1.0, 2.0]}
    """
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, (list, tuple)):
        return [finite_json(entry) for entry in value]
    if not isinstance(value, str | int | None) and isinstance(value, Mapping):
        # the cheaper question first
        return {key: finite_json(entry) for key, entry in value.items()}

    return value


def parse_json(content: str | bytes) -> Any:
    """Read untrusted JSON: no number that is not finite or very long, no repeated key,
    no deep nesting; or ValueError.

    >>> parse_json('{"force_mn": NaN}')
    Traceback (most recent call last):
    ValueError: not JSON: NaN is not a number of JSON
    """
    try:
        return json.loads(
            content,
            parse_constant=_refuse,
            parse_float=_finite_float,
            parse_int=_short_int,
            object_pairs_hook=_once,
        )
    except RecursionError as fault:
        raise ValueError("not JSON: nested too deep") from fault
    except ValueError as fault:
        raise ValueError(f"not JSON: {fault}") from fault


def _refuse(name: str) -> None:
    raise ValueError(f"{name} is not a number of JSON")


def _finite_float(digits: str) -> float:
    if not isfinite(number := float(digits)):
        raise ValueError(f"{digits[:20]} is too large a number")
    return number


def _short_int(digits: str) -> int:
    if len(digits) > 40:
        # floats hold longer ones, but nothing that is counted here needs them
        raise ValueError(f"{digits[:20]}... has {len(digits)} digits")
    return int(digits)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        counts = Counter(key for key, _ in pairs)  # in one pass, however many there are
        twice = next(key for key, count in counts.items() if count > 1)
        raise ValueError(f"{twice!r} is twice in one object")
    return found
