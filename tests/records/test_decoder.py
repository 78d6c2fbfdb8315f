"""One decoder for all files: keys of fields, forms of fields, places in messages."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest

from scleraforce.base.errors import StudyError
from scleraforce.base.units import from_si, to_si
from scleraforce.records.decoder import (
    parse_json_record,
)
from scleraforce.records.fields import Unit, computed, one_line
from scleraforce.records.needle import Needle, gauge_diameter_m, lean_ends


@dataclass(frozen=True, kw_only=True)
class Tip:
    size_m: float = computed(1.0, 100.0, "um", key="size_in_um")


@dataclass(frozen=True, kw_only=True)
class Shelf:
    """Fields that stand in a table of their own, and records in lists and by name."""

    widest_m: float = computed(0.0, 50.0, "mm", key="drawer.width_mm")
    label: str = one_line("")
    tips: Mapping[str, Tip] = field(default_factory=dict)
    listed: tuple[Tip, ...] = ()
    spare: Tip | None = None
    ends_n: tuple[float, float] = computed(-1.0, 1.0, default=(0.0, 0.0))
    needle: Needle | None = field(default=None, metadata={"key": "other"})


WHOLE = {
    "drawer": {"width_mm": 7},
    "tips": {"a": {"size_in_um": 3}},
    "listed": [{"size_in_um": 4}],
    "ends_n": [0, 0.5],
    "other": {"gauge": 22, "lean_rad": 0.2},
    "spare": None,
    "more": 1,
}


def test_keys_of_a_table_within_forms_and_records_by_name_are_read():
    needle = Needle(diameter_m=gauge_diameter_m(22), lean_rad=lean_ends(0.2))
    assert parse_json_record(Shelf, json.dumps(WHOLE), "shelf.json") == Shelf(
        widest_m=7e-3,
        tips={"a": Tip(size_m=3e-6)},
        listed=(Tip(size_m=4e-6),),
        ends_n=(0.0, 0.5),
        needle=needle,
    )


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"drawer": 3}, "drawer: expected an object, found 3"),
        ({"drawer": {}}, "drawer.width_mm: missing"),
        (
            {"drawer": {"width_mm": 7000}},
            "drawer.width_mm: 7000 is above .*50; .* 7 mm",
        ),
        ({"label": "a\nb"}, r"label: expected a text of one line, found 'a\\nb'"),
        ({"label": 3}, "label: expected a text, found 3"),
        ({"tips": {"b": {}}}, "tips.b.size_in_um: missing"),
        ({"tips": {"b\n": []}}, r"'tips.b\\n': expected an object, found \[\]"),
        ({"listed": [{}]}, r"listed\[0\].size_in_um: missing"),
        ({"ends_n": [0.0]}, r"ends_n: expected 2 entries, found \[0.0\]"),
        ({"ends_n": 0.0}, "ends_n: expected a list, found 0.0"),
        ({"ends_n": [0.0, 1.1]}, "ends_n: 1.1 is above the largest allowed value 1"),
        ({"ends_n": [10**16, 0.0]}, "ends_n: a number of more than 15 digits"),
        ({"other": {"gauge": 2}}, "other.gauge: 2 is below .* 10"),
        ({"other": {"gauge": 22.5}}, "other.gauge: expected a whole number"),
        ({"other": {"gauge": None}}, "other.gauge: expected a whole number"),
    ],
)
def test_a_fault_of_json_is_named_with_its_path(changed, said):
    with pytest.raises(StudyError, match=f"^shelf.json: {said}"):
        parse_json_record(Shelf, json.dumps(WHOLE | changed), "shelf.json")


@pytest.mark.parametrize("text", ["", "[]", "3", '{"drawer": NaN}'])
def test_what_is_no_object_of_json_is_refused(text):
    with pytest.raises(StudyError, match=r"^shelf.json: (not JSON|expected an object)"):
        parse_json_record(Shelf, text, "shelf.json")


def test_an_exact_unit_does_not_round():
    number = 0.1 + 0.2
    rounded = Unit("mmhg")
    exact = Unit("mmhg", exact=True)
    assert rounded.to_si(number) != exact.to_si(number) == to_si(number, "mmhg")
    assert exact.from_si(number) == from_si(number, "mmhg")
