"""A study is read from TOML and written back; what cannot be used is an error that names its line."""

from dataclasses import fields, is_dataclass, replace
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

import pytest
from hypothesis import given, settings, strategies as st

from scleraforce.errors import StudyError
from scleraforce.study import (
    Choice,
    NetworkStudy,
    Range,
    Study,
    fixed,
    format_study,
    parse_study,
    preset_toml,
    study_hash,
)
from scleraforce.study.fields import Unit, field_key, field_unit

PAPER_STUDY_TOML = preset_toml("ex-vivo")


def human_number(unit: Unit) -> st.SearchStrategy[float]:
    """Any number that the unit's bounds allow, as one would write it in a file (six digits)."""
    low = -1e6 if unit.low is None else unit.low
    high = 1e6 if unit.high is None else unit.high
    return st.floats(low, high, allow_nan=False).map(lambda v: min(max(float(f"{v:.6g}"), low), high))


def changed(record: Any, item: Any) -> st.SearchStrategy[Any]:
    """The record with another value in one field."""
    unit, hint = field_unit(item), get_type_hints(type(record))[item.name]
    number = human_number(unit).map(unit.to_si)
    if unit.words:
        value: st.SearchStrategy[Any] = st.sampled_from(unit.words)
    elif isinstance(hint, UnionType) and Range in get_args(hint):
        pair = st.tuples(number, number).map(sorted).map(lambda ends: Range(min=ends[0], max=ends[1]))
        value = st.lists(number, min_size=1, max_size=4).map(lambda v: Choice(tuple(v))) | pair
    elif get_origin(hint) is tuple or (isinstance(hint, UnionType) and NoneType in get_args(hint)):
        value = st.just(getattr(record, item.name))
    elif hint is bool:
        value = st.booleans()
    elif hint is int:
        value = st.integers(int(unit.low or 0), int(min(unit.high or 1e6, 10**6)))
    else:
        value = number
    return value.map(lambda v: _replaced(record, item.name, v))


def _replaced(record: Any, name: str, value: Any) -> Any:
    """The record with a new value; the old one where the fields do not fit together."""
    try:
        return replace(record, **{name: value})
    except StudyError:
        return record


SECTIONS = [(section.name, item) for section in fields(Study) for item in fields(getattr(Study(), section.name))]


@st.composite
def studies(draw: st.DrawFn) -> Study:
    """The paper's study with up to eight fields changed."""
    study = Study()
    for name, item in draw(st.lists(st.sampled_from(SECTIONS), max_size=8)):
        if not is_dataclass(item.type):
            study = replace(study, **{name: draw(changed(getattr(study, name), item))})
    return study


@settings(max_examples=30, deadline=None)
@given(studies())
def test_a_study_survives_being_written_and_read(study: Study) -> None:
    again = parse_study(format_study(study))
    assert study_hash(again) == study_hash(parse_study(format_study(again)))
    for section in fields(Study):
        for item in fields(getattr(study, section.name)):
            written, read = (getattr(getattr(s, section.name), item.name) for s in (study, again))
            assert _close(written, read), f"{section.name}.{item.name}: {written} became {read}"


def _close(written: Any, read: Any) -> bool:
    match written:
        case Choice():
            return isinstance(read, Choice) and _close(written.values, read.values)
        case Range():
            return isinstance(read, Range) and _close(written.bounds, read.bounds)
        case tuple():
            return len(written) == len(read) and all(map(_close, written, read))
        case float():
            return bool(read == pytest.approx(written, rel=1e-13, abs=0.0))
        case _:
            return bool(written == read)


def test_the_commented_paper_study_is_the_defaults_and_has_their_hash() -> None:
    assert parse_study(PAPER_STUDY_TOML) == parse_study("") == Study()
    assert study_hash(parse_study(PAPER_STUDY_TOML)) == study_hash(Study())
    assert study_hash(replace(Study(), network=NetworkStudy(seed=1))) != study_hash(Study())


def test_the_commented_paper_study_names_every_key() -> None:
    for section in fields(Study):
        for item in fields(getattr(Study(), section.name)):
            tables = {"group": "[[{}]]", "wave": "[[{}]]", "region": "[[{}]]", "cornea": "[{}]"}
            value = getattr(getattr(Study(), section.name), item.name)
            if is_dataclass(value) and section.name == "scenes":
                body = PAPER_STUDY_TOML.partition(f"[scenes.{item.name}]")[2].partition("\n[")[0]
                missing = [field_key(part) for part in fields(value) if f"\n{field_key(part)} =" not in body]
                assert not missing, f"scenes.{item.name}: missing from paper.toml: {missing}"
                continue
            key = tables.get(item.name, f"{field_key(item)} =").format(f"{section.name}.{item.name}")
            assert key in PAPER_STUDY_TOML, f"{section.name}.{key} is missing from paper.toml"


def test_values_are_si_inside_and_exact() -> None:
    study = parse_study("[eye]\nthickness_um = [400, 655.5]\n[needle]\npolar_angle_deg = { min = 0, max = 45 }")
    assert study.eye.thickness_m == Choice((0.0004, 0.0006555))
    assert study.needle.polar_angle_rad.bounds == pytest.approx((0.0, 0.7853981633974483))
    assert parse_study("[dataset]\ngap_mm = 0.5").dataset.gap_m == fixed(0.0005)
    globe = parse_study('[globe]\nkind = "sealed"\nrigidity_mmhg13_per_ul = 0.02').globe
    assert globe.rigidity_pa13_per_m3 == pytest.approx(0.02 * 133.322387415 ** (1 / 3) * 1e9)


BAD = [
    ("[eye]\nradius_mm = 12.0\niris = 3", 3, "eye.iris: unknown key; known here: radius_mm"),
    ("[lens]\nx = 1", 1, "lens: unknown key; known here: eye, mesh"),
    ("eye = 3", 1, "eye: expected a table [eye]"),
    ("[eye]\n\npoisson_ratio = 0.6", 3, "eye.poisson_ratio: 0.6 is above the largest allowed value 0.499"),
    ("[eye]\nradius_mm = 1", 2, "eye.radius_mm: 1 is below the smallest allowed value 5"),
    ('[eye]\nradius_mm = "wide"', 2, "eye.radius_mm: expected a number, found 'wide'"),
    ("[eye]\nradius_mm = nan", 2, "eye.radius_mm: nan is not a finite number"),
    ("[eye]\nradius_mm = inf", 2, "eye.radius_mm: inf is not a finite number"),
    ("[eye]\nthickness_um = []", 2, "eye.thickness_um: an empty list"),
    ("[eye]\nthickness_um = [400, true]", 2, "eye.thickness_um: expected a number, found True"),
    ("[eye]\nthickness_um = { min = 500, max = 400 }", 2, "eye.thickness_um: min is larger than max"),
    ("[eye]\nthickness_um = { min = 500 }", 2, "eye.thickness_um: a range is { min = a, max = b }"),
    ("[mesh]\norder = 2\ndivisions = 7", 3, "mesh.divisions: 7 is odd"),
    ("[mesh]\norder = 1.5", 2, "mesh.order: expected a whole number, found 1.5"),
    ("[mesh]\norder = true", 2, "mesh.order: expected a whole number, found True"),
    ('[mesh]\nkind = "tetrahedra"', 2, "mesh.kind: 'tetrahedra' is not one of automatic, hexahedra"),
    ("[classes]\nbounds_mn = [30, 5]", 2, "classes.bounds_mn: give two increasing forces"),
    ("[classes]\nbounds_mn = 5", 2, "classes.bounds_mn: expected a list"),
    ("[calibration]\npositive = 1", 2, "calibration.positive: expected true or false, found 1"),
    ("[dataset]\ngroup = 3", 2, "dataset.group: expected a list of tables [[dataset.group]]"),
    ("[dataset]\ngroup = []", 2, "dataset.group: give at least one"),
    (
        "[[dataset.group]]\nimages = 3\n[[dataset.group]]\n\nimages = 0",
        5,
        "dataset.group.images: 0 is below the smallest allowed value 1",
    ),
    ("[network]\nhidden = [600, 0]", 2, "network.hidden: 0 is below the smallest allowed value 1"),
    ("[eye]\nradius_mm = 12\n[eye]", 3, "not TOML"),
    ("[eye]\nradius_mm = 1" + "0" * 400, 2, "eye.radius_mm: a number of more than 15 digits"),
    ("[mesh]\norder = -1" + "0" * 400, 2, "mesh.order: a number of more than 15 digits"),
    ("[eye]\nradius_mm.a" + ".a" * 2000 + " = 1", 1, "eye.radius_mm: expected a number, found {'a': {'a': "),
    ("[eye]\nthickness_um = [" + "1," * 1001 + "]", 2, "eye.thickness_um: 1001 entries; at most 1000"),
    ("[[dataset.group]]\n" * 1001, 1, "dataset.group: 1001 entries; at most 1000"),
    ('[globe]\nkind = "shut"', 2, "globe.kind: 'shut' is not one of open, sealed"),
    ('[globe]\nkind = "sealed"\nleak_time_s = 0.5', 3, "globe.leak_time_s: 0.5; must be 1 s or more, or 0: no leak"),
    ("[tissue]\nstiffening = 300.0", 2, "tissue.stiffening: 300 is above the largest allowed value 200"),
]


def test_faults_are_named_with_their_line() -> None:
    for text, line, message in BAD:
        with pytest.raises(StudyError) as fault:
            parse_study(text, "my.toml")
        said = str(fault.value)
        assert message in said
        assert said.startswith(f"my.toml:{line}: ") or f"line {line}" in said
        assert "\n" not in said
    for text in ["a = " + "[" * 100_000, "a = " + "9" * 5000]:  # which tomllib does not refuse itself
        with pytest.raises(StudyError, match=r"my\.toml: not TOML"):
            parse_study(text, "my.toml")
