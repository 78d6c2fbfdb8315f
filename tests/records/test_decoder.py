"""One decoder for all files: keys of fields, forms of fields, places in messages."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pytest

from scleraforce.base.errors import StudyError
from scleraforce.base.units import from_si, to_si
from scleraforce.records.decoder import (
    Source,
    decode_record,
    format_record,
    parse_json_record,
    parse_record,
)
from scleraforce.records.fields import (
    StudySection,
    TableForm,
    Unit,
    computed,
    formed,
    not_in_files,
    one_line,
    option,
    optional_quantity,
    quantity,
    required,
)


def read_diameter(values: Mapping[str, Any]) -> float:
    if "gauge" not in values:
        raise StudyError("gauge: missing; give the needle's gauge")
    return {27: 0.4e-3, 22: 0.7e-3}[values["gauge"]]


def read_lean(values: Mapping[str, Any]) -> tuple[float, float] | None:
    if "lean_deg" in values and "leans_deg" in values:
        raise StudyError("leans_deg: give this or lean_deg")
    ends = values.get("leans_deg", (values.get("lean_deg"),) * 2)
    return None if ends[0] is None else ends


def write_lean(ends: tuple[float, float]) -> dict[str, Any]:
    is_one = ends[0] == ends[1]
    return {
        "lean_deg": ends[0] if is_one else None,
        "leans_deg": None if is_one else ends,
    }


LEAN = Unit("deg", low=0.0, high=75.0)
DIAMETER_FORM = TableForm(
    {"gauge": (int, Unit(low=10, high=36))},
    read_diameter,
    lambda diameter_m: {"gauge": {0.4e-3: 27, 0.7e-3: 22}[diameter_m]},
)
LEAN_FORM = TableForm(
    {"lean_deg": (float, LEAN), "leans_deg": (tuple[float, ...], LEAN)},
    read_lean,
    write_lean,
)


@dataclass(frozen=True, kw_only=True)
class Tip(StudySection):
    name: str = required("round", "sharp", key="shape")
    size_m: float = computed(1.0, 100.0, "um", key="size_in_um")


@dataclass(frozen=True, kw_only=True)
class Needle(StudySection):
    id: str | None = quantity(None, key="label")
    diameter_m: float | None = formed(DIAMETER_FORM)
    gap_m: float | None = optional_quantity("gap_m", key="slice_gap_m")
    lean_rad: tuple[float, float] | None = formed(LEAN_FORM)
    hub: str | None = option(None, "steel", "plastic", key="hub_of")
    stress: Tip | None = not_in_files()
    tips: tuple[Tip, ...] = field(default=(), metadata={"key": "tip"})


@dataclass(frozen=True, kw_only=True)
class Tray:
    needle: Needle
    spare: Needle | None = field(default=None, metadata={"key": "other"})


WHOLE = """\
[needle]
label = "mine"
gauge = 27
slice_gap_m = 0.0004
leans_deg = [5.0, 10.0]
hub_of = "steel"
[[needle.tip]]
shape = "round"
size_in_um = 20.0
[[needle.tip]]
shape = "sharp"
size_in_um = 2.0

[other]
gauge = 22
lean_deg = 30.0
tip = []
"""


def test_a_field_stands_under_its_key_or_in_its_form_and_comes_back() -> None:
    tray = parse_record(Tray, WHOLE, "tray.toml")
    assert tray.needle == Needle(
        id="mine",
        diameter_m=0.4e-3,
        gap_m=0.4e-3,
        lean_rad=(0.0872664625997165, 0.174532925199433),
        hub="steel",
        tips=(Tip(name="round", size_m=20e-6), Tip(name="sharp", size_m=2e-6)),
    )
    assert tray.spare is not None
    assert tray.spare.lean_rad == (0.523598775598299,) * 2
    assert format_record(tray) == WHOLE


KEYS = "label, gauge, slice_gap_m, lean_deg, leans_deg, hub_of, tip"


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        ("hub_of", "hub", f"6: needle.hub: unknown key; known here: {KEYS}"),
        ("hub_of", "stress", f"6: needle.stress: unknown key; known here: {KEYS}"),
        ("hub_of", "diameter_m", f"6: needle.diameter_m: unknown key; .*{KEYS}"),
        ('"steel"', '"wood"', "6: needle.hub_of: 'wood' is not one of steel, plastic"),
        ("gauge = 27", "gauge = 2", "3: needle.gauge: 2 is below the smallest .* 10"),
        ("gauge = 27", "gauge = 2.5", "3: needle.gauge: expected a whole number"),
        ("gauge = 27", "", "1: needle.gauge: missing; give the needle's gauge"),
        ("gauge = 22", "", "14: other.gauge: missing; give the needle's gauge"),
        ("10.0]", "90.0]", "5: needle.leans_deg: 90 is above the largest .* 75"),
        ("hub_of", "lean_deg = 1\nhub_of", "5: needle.leans_deg: give this or lean_d"),
        ("= 0.0004", "= 0.4", r"4: needle.slice_gap_m: 0.4 is above .*0.0004 m"),
        ("= 2.0", "= 0.2", "12: needle.tip.size_in_um: 0.2 is below"),
        ("size_in_um = 2.0", "", "7: needle.tip.size_in_um: missing"),
        ("= 2.0", "= 2.0\nx = 1", "13: needle.tip.x: unknown key; .*shape, size_in_um"),
    ],
)
def test_a_fault_is_named_by_the_key_of_the_file_and_its_line(
    before: str, after: str, said: str
) -> None:
    with pytest.raises(StudyError, match=f"^tray.toml:{said}"):
        parse_record(Tray, WHOLE.replace(before, after, 1), "tray.toml")


JSON = Source("tray.json")


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"gauge": 27, "hub_of": 3}, "needles.a.hub_of: expected a text, found 3"),
        ({"gauge": None}, "needles.a.gauge: expected a whole number, found None"),
        ({"gauge": 27, "tip": [{}]}, r"needles.a.tip\[0\].shape: missing"),
        (
            {"gauge": 27, "tip": [{"shape": "round", "size_in_um": -1}]},
            r"needles.a.tip\[0\].size_in_um: -1 is below",
        ),
        ({}, "needles.a.gauge: missing"),
    ],
)
def test_plain_content_of_another_kind_of_file_is_read_with_its_places(
    table: dict[str, Any], said: str
) -> None:
    with pytest.raises(StudyError, match=f"^tray.json: {said}"):
        decode_record(Needle, table, JSON, ("needles", "a"))


def test_null_is_none_and_other_keys_may_be_passed_over() -> None:
    table = {"gauge": 22, "label": None, "more": 1, "slice_gap_m": 0}
    found = decode_record(Needle, table, JSON)
    assert found == Needle(diameter_m=0.7e-3, gap_m=0.0)
    with pytest.raises(StudyError, match=f"more: unknown key; known here: {KEYS}"):
        decode_record(Needle, table, Source("tray.toml", {}))


def test_an_exact_unit_does_not_round() -> None:
    number = 0.1 + 0.2
    rounded = Unit("mmhg")
    exact = Unit("mmhg", exact=True)
    assert rounded.to_si(number) != exact.to_si(number) == to_si(number, "mmhg")
    assert exact.from_si(number) == from_si(number, "mmhg")


@dataclass(frozen=True, kw_only=True)
class Shelf:
    """Fields that stand in a table of their own, and records by name."""

    widest_m: float = computed(0.0, 50.0, "mm", key="drawer.width_mm")
    label: str = one_line("")
    tips: Mapping[str, Tip] = field(default_factory=dict)
    ends_n: tuple[float, float] = computed(-1.0, 1.0, default=(0.0, 0.0))


def test_keys_of_a_table_within_and_records_by_name_are_read() -> None:
    tips = {"a": {"shape": "round", "size_in_um": 3}}
    text = json.dumps(
        {"drawer": {"width_mm": 7}, "tips": tips, "ends_n": [0, 0.5], "more": 1}
    )
    assert parse_json_record(Shelf, text, "shelf.json") == Shelf(
        widest_m=7e-3, tips={"a": Tip(name="round", size_m=3e-6)}, ends_n=(0.0, 0.5)
    )


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"drawer": 3}, "drawer: expected an object, found 3"),
        ({"drawer": {}}, "drawer.width_mm: missing"),
        (
            {"drawer": {"width_mm": 7000}},
            r"drawer.width_mm: 7000 is above the largest allowed value 50; .* 7 mm",
        ),
        ({"label": "a\nb"}, r"label: expected a text of one line, found 'a\\nb'"),
        ({"label": 3}, "label: expected a text, found 3"),
        ({"tips": {"b": {}}}, "tips.b.shape: missing"),
        ({"tips": {"b\n": []}}, r"'tips.b\\n': expected an object, found \[\]"),
        ({"ends_n": [0.0]}, r"ends_n: expected 2 entries, found \[0.0\]"),
        ({"ends_n": 0.0}, "ends_n: expected a list, found 0.0"),
        ({"ends_n": [0.0, 1.1]}, "ends_n: 1.1 is above the largest allowed value 1"),
        ({"ends_n": [10**16, 0.0]}, "ends_n: a number of more than 15 digits"),
    ],
)
def test_a_fault_of_json_is_named_with_its_path(
    changed: dict[str, Any], said: str
) -> None:
    text = json.dumps({"drawer": {"width_mm": 7}} | changed)
    with pytest.raises(StudyError, match=f"^shelf.json: {said}"):
        parse_json_record(Shelf, text, "shelf.json")


@pytest.mark.parametrize("text", ["", "[]", "3", '{"drawer": NaN}'])
def test_what_is_no_object_of_json_is_refused(text: str) -> None:
    with pytest.raises(StudyError, match=r"^shelf.json: (not JSON|expected an object)"):
        parse_json_record(Shelf, text, "shelf.json")
