"""Records say what they hold: numbers of one record are told apart by their names, never by their order alone."""

from dataclasses import fields, is_dataclass
from functools import cache
from importlib import import_module
from inspect import isclass, isfunction
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


def test_no_class_overrides_a_method_that_one_of_the_package_has_implemented() -> None:
    overridden = [
        f"{one.__module__}.{one.__name__}.{name} overrides that of {base.__name__}"
        for one in classes()
        for base in one.__mro__[1:]
        if base.__module__.startswith("scleraforce.")
        for name, value in vars(base).items()
        if name in vars(one) and name[:2] != "__" and isfunction(value) and not is_abstract(base, value)
    ]
    assert not overridden, f"use composition: {overridden}"


def is_abstract(base: type, method: object) -> bool:
    return getattr(base, "_is_protocol", False) or getattr(method, "__isabstractmethod__", False)


def test_no_record_reaches_into_the_dictionary_of_another() -> None:
    reaching = [
        str(path.relative_to(ROOT)) for path in ROOT.rglob("*.py") if "__dict__" in path.read_text(encoding="utf-8")
    ]
    assert not reaching, f"use `dataclasses.replace`: {reaching}"
