"""Records say what they hold: numbers of one record are told apart by their names, never by their order alone."""

from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from inspect import isclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import scleraforce

ROOT = Path(scleraforce.__file__).parent


@cache
def classes() -> tuple[type, ...]:
    """Every class that a module of the package defines."""
    found: list[type] = []
    for path in sorted(ROOT.rglob("*.py")):
        name = ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)
        if path.stem not in {"__init__", "__main__"}:
            defined = vars(import_module(name)).values()
            found += (one for one in defined if isclass(one) and one.__module__ == name)
    return tuple(found)


def is_number(annotation: Any) -> bool:
    """Whether a field is a float, or is one where there is a value, with or without its unit."""
    if get_origin(annotation) is Annotated:
        return is_number(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return all(is_number(one) for one in get_args(annotation) if one is not NoneType)
    return annotation in (float, "float", "float | None")


def frozen_records() -> list[type]:
    return [one for one in classes() if is_dataclass(one) and one.__dataclass_params__.frozen]


def test_records_of_several_numbers_take_them_by_name_only() -> None:
    ordered = {}
    for record in frozen_records():
        numbers = [item for item in fields(record) if item.init and is_number(item.type)]
        positional = [item.name for item in numbers if not item.kw_only]
        if positional and len(numbers) > 1:
            ordered[f"{record.__module__}.{record.__name__}"] = positional
    assert not ordered, f"make these fields keyword-only: {ordered}"
