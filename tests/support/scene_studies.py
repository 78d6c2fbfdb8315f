"""Sections of `[scenes]` with single values in place of ranges."""

from dataclasses import fields, replace
from typing import Any

from scleraforce.records.fields import fixed


def varied(record: Any, **values: Any) -> Any:
    """The record with other values, a number for a range's only one."""
    ranges = {name for name in values if not isinstance(getattr(record, name), float)}
    numbers = {
        name: fixed(values[name])
        for name in ranges
        if isinstance(values[name], int | float)
    }

    return replace(record, **(values | numbers))


def only(record: Any, share: float = 0.0, count: int = 0, **values: Any) -> Any:
    """A record with the same share of everything, and the same count, but for the
    values given.
    """
    given = {item.name: getattr(record, item.name) for item in fields(record)}
    same = {
        name: share
        for name, value in given.items()
        if name.endswith("_share") and isinstance(value, float)
    }

    return varied(
        record,
        **(same | {name: count for name in given if name.endswith("_count")} | values),
    )
