"""The study: fields with bounds and units, its TOML with the line of each fault,
quantities, unused keys.
"""

import tomllib
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

import click
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import scleraforce as sf
from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.units import SI_PER_UNIT
from scleraforce.front.cli.main import COMMANDS, cli
from scleraforce.front.cli.options import Quantity
from scleraforce.records.fields import (
    QUANTITIES,
    Unit,
    allowed_bounds,
    check_quantity,
    field_key,
    field_unit,
)
from scleraforce.records.study import (
    Choice,
    LibraryStudy,
    NetworkStudy,
    Range,
    Study,
    fixed,
    format_study,
    parse_study,
    preset_toml,
    refuse_unused,
    study_hash,
)

PAPER_STUDY_TOML = preset_toml("ex-vivo")


def human_number(unit: Unit) -> st.SearchStrategy[float]:
    """Any number that the unit's bounds allow, as one would write it in a file (six
    digits).
    """
    low = -1e6 if unit.low is None else unit.low
    high = 1e6 if unit.high is None else unit.high
    return st.floats(low, high, allow_nan=False).map(
        lambda v: min(max(float(f"{v:.6g}"), low), high)
    )


def changed(record: Any, item: Any) -> st.SearchStrategy[Any]:
    """The record with another value in one field."""
    unit = field_unit(item)
    hint = get_type_hints(type(record))[item.name]
    number = human_number(unit).map(unit.to_si)

    if unit.words:
        value: st.SearchStrategy[Any] = st.sampled_from(unit.words)
    elif isinstance(hint, UnionType) and Range in get_args(hint):
        pair = (
            st.tuples(number, number)
            .map(sorted)
            .map(lambda ends: Range(min=ends[0], max=ends[1]))
        )
        value = (
            st.lists(number, min_size=1, max_size=4).map(lambda v: Choice(tuple(v)))
            | pair
        )
    elif get_origin(hint) is tuple or (
        isinstance(hint, UnionType) and NoneType in get_args(hint)
    ):
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


SECTIONS = [
    (section.name, item)
    for section in fields(Study)
    for item in fields(getattr(Study(), section.name))
]


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
            written, read = (
                getattr(getattr(s, section.name), item.name) for s in (study, again)
            )
            assert _close(written, read), (
                f"{section.name}.{item.name}: {written} became {read}"
            )


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
    assert study_hash(replace(Study(), network=NetworkStudy(seed=1))) != study_hash(
        Study()
    )


def test_the_commented_paper_study_names_every_key() -> None:
    for section in fields(Study):
        for item in fields(getattr(Study(), section.name)):
            tables = {
                "group": "[[{}]]",
                "wave": "[[{}]]",
                "region": "[[{}]]",
                "cornea": "[{}]",
            }
            value = getattr(getattr(Study(), section.name), item.name)
            if is_dataclass(value) and section.name == "scenes":
                body = PAPER_STUDY_TOML.partition(f"[scenes.{item.name}]")[2].partition(
                    "\n["
                )[0]
                missing = [
                    field_key(part)
                    for part in fields(value)
                    if f"\n{field_key(part)} =" not in body
                ]
                assert not missing, (
                    f"scenes.{item.name}: missing from paper.toml: {missing}"
                )
                continue

            key = tables.get(item.name, f"{field_key(item)} =").format(
                f"{section.name}.{item.name}"
            )
            assert key in PAPER_STUDY_TOML, (
                f"{section.name}.{key} is missing from paper.toml"
            )


def test_values_are_si_inside_and_exact() -> None:
    study = parse_study(
        "[eye]\nthickness_um = [400, 655.5]\n[needle]\npolar_angle_deg = { min = 0, max"
        " = 45 }"
    )
    assert study.eye.thickness_m == Choice((0.0004, 0.0006555))
    assert study.needle.polar_angle_rad.bounds == pytest.approx(
        (0.0, 0.7853981633974483)
    )
    assert parse_study("[dataset]\ngap_mm = 0.5").dataset.gap_m == fixed(0.0005)
    globe = parse_study('[globe]\nkind = "sealed"\nrigidity_mmhg13_per_ul = 0.02').globe
    assert globe.rigidity_pa13_per_m3 == pytest.approx(
        0.02 * 133.322387415 ** (1 / 3) * 1e9
    )


BAD = [
    (
        "[eye]\nradius_mm = 12.0\niris = 3",
        3,
        "eye.iris: unknown key; known here: radius_mm",
    ),
    ("[lens]\nx = 1", 1, "lens: unknown key; known here: eye, mesh"),
    ("eye = 3", 1, "eye: expected a table [eye]"),
    (
        "[eye]\n\npoisson_ratio = 0.6",
        3,
        "eye.poisson_ratio: 0.6 is above the largest allowed value 0.499",
    ),
    (
        "[eye]\nradius_mm = 1",
        2,
        "eye.radius_mm: 1 is below the smallest allowed value 5",
    ),
    ('[eye]\nradius_mm = "wide"', 2, "eye.radius_mm: expected a number, found 'wide'"),
    ("[eye]\nradius_mm = nan", 2, "eye.radius_mm: nan is not a finite number"),
    ("[eye]\nradius_mm = inf", 2, "eye.radius_mm: inf is not a finite number"),
    ("[eye]\nthickness_um = []", 2, "eye.thickness_um: an empty list"),
    (
        "[eye]\nthickness_um = [400, true]",
        2,
        "eye.thickness_um: expected a number, found True",
    ),
    (
        "[eye]\nthickness_um = { min = 500, max = 400 }",
        2,
        "eye.thickness_um: min is larger than max",
    ),
    (
        "[eye]\nthickness_um = { min = 500 }",
        2,
        "eye.thickness_um: a range is { min = a, max = b }",
    ),
    ("[mesh]\norder = 2\ndivisions = 7", 3, "mesh.divisions: 7 is odd"),
    ("[mesh]\norder = 1.5", 2, "mesh.order: expected a whole number, found 1.5"),
    ("[mesh]\norder = true", 2, "mesh.order: expected a whole number, found True"),
    (
        '[mesh]\nkind = "tetrahedra"',
        2,
        "mesh.kind: 'tetrahedra' is not one of automatic, hexahedra",
    ),
    (
        "[classes]\nbounds_mn = [30, 5]",
        2,
        "classes.bounds_mn: give two increasing forces",
    ),
    ("[classes]\nbounds_mn = 5", 2, "classes.bounds_mn: expected a list"),
    (
        "[calibration]\npositive = 1",
        2,
        "calibration.positive: expected true or false, found 1",
    ),
    (
        "[dataset]\ngroup = 3",
        2,
        "dataset.group: expected a list of tables [[dataset.group]]",
    ),
    ("[dataset]\ngroup = []", 2, "dataset.group: give at least one"),
    (
        "[[dataset.group]]\nimages = 3\n[[dataset.group]]\n\nimages = 0",
        5,
        "dataset.group.images: 0 is below the ",
    ),
    (
        "[network]\nhidden = [600, 0]",
        2,
        "network.hidden: 0 is below the smallest allowed value 1",
    ),
    ("[eye]\nradius_mm = 12\n[eye]", 3, "not TOML"),
    (
        "[eye]\nradius_mm = 1" + "0" * 400,
        2,
        "eye.radius_mm: a number of more than 15 digits",
    ),
    (
        "[mesh]\norder = -1" + "0" * 400,
        2,
        "mesh.order: a number of more than 15 digits",
    ),
    (
        "[eye]\nradius_mm.a" + ".a" * 15 + " = 1",
        1,
        "eye.radius_mm: expected a number, found {'a': {'a': ",
    ),
    (
        "[eye]\nthickness_um = [" + "1," * 1001 + "]",
        2,
        "eye.thickness_um: 1001 entries; at most 1000",
    ),
    ("[[dataset.group]]\n" * 1001, 1, "dataset.group: 1001 entries; at most 1000"),
    ('[globe]\nkind = "shut"', 2, "globe.kind: 'shut' is not one of open, sealed"),
    (
        '[globe]\nkind = "sealed"\nleak_time_s = 0.5',
        3,
        "globe.leak_time_s: 0.5; must be 1 s or more, or 0: no leak",
    ),
    (
        "[tissue]\nstiffening = 300.0",
        2,
        "tissue.stiffening: 300 is above the largest allowed value 200",
    ),
]


def test_faults_are_named_with_their_line() -> None:
    for text, line, message in BAD:
        with pytest.raises(StudyError) as fault:
            parse_study(text, "my.toml")

        said = str(fault.value)
        assert message in said
        assert said.startswith(f"my.toml:{line}: ") or f"line {line}" in said
        assert "\n" not in said

    for text in [
        "a = " + "[" * 100_000,
        "a = " + "9" * 5000,
    ]:  # which tomllib does not refuse itself
        with pytest.raises(StudyError, match=r"my\.toml: not TOML"):
            parse_study(text, "my.toml")


def test_the_line_of_a_key_of_many_parts_is_named() -> None:
    deep = "[eye]\nradius_mm.a" + ".a" * 2000 + " = 1"
    with pytest.raises(StudyError, match=r"^my\.toml:2: a key of more than 20 parts"):
        parse_study(deep, "my.toml")


@given(
    st.sampled_from(sorted(SI_PER_UNIT)),
    st.integers(-99_999, 99_999),
    st.integers(-3, 3),
)
def test_a_short_decimal_survives_the_way_to_si_and_back(
    name: str, digits: int, exponent: int
) -> None:
    human = float(f"{digits}e{exponent}")
    unit = Unit(name)
    assert unit.from_si(unit.to_si(human)) == human


def test_samples_follow_their_distribution_and_the_generator() -> None:
    values = Range(min=2.0, max=3.0).sample(np.random.default_rng(1), 1000)
    assert values.shape == (1000,)
    assert 2.0 <= values.min() < 2.01
    assert 2.99 < values.max() <= 3.0
    np.testing.assert_array_equal(
        values, Range(min=2.0, max=3.0).sample(np.random.default_rng(1), 1000)
    )
    values, counts = np.unique(
        Choice((1.0, 5.0, 9.0)).sample(np.random.default_rng(0), 3000),
        return_counts=True,
    )
    assert values.tolist() == [1.0, 5.0, 9.0]
    assert np.all(np.abs(counts - 1000) < 4 * np.sqrt(3000 * 2 / 9))


def test_stiffenings_of_a_library_are_one_or_enough_for_splines_over_a_range() -> None:
    for count in [2, 3]:
        with pytest.raises(
            StudyError, match=rf"^stiffenings: {count}; give 1, or at least 4$"
        ):
            LibraryStudy(stiffenings=count)

    with pytest.raises(
        StudyError, match=r"^stiffening: a range has to be given.*stiffenings = 1$"
    ):
        LibraryStudy(stiffening=fixed(5.0))

    held = Range(min=2.0, max=20.0)
    assert LibraryStudy(stiffening=held).stiffening_ends == (2.0, 20.0)
    assert LibraryStudy(stiffening=held, stiffenings=1).stiffening_ends == (2.0, 2.0)


def test_a_slip_of_the_unit_is_named() -> None:
    for key, number, hint in [
        ("thickness_um", 0.65, "650 µm (0.65 mm)"),
        ("thickness_m", 650.0, "0.00065 m (650 µm)"),
        ("youngs_modulus_mpa", 300.0, "0.3 MPa (300 kPa)"),
        ("youngs_modulus_mpa", 250_000.0, "0.25 MPa (250000 Pa)"),
        ("iop_mmhg", 2000.0, "15 mmHg (2000 Pa)"),
        ("width_m", 15.0, "0.015 m (15 mm)"),
        ("force_n", 20.0, "0.02 N (20 mN)"),
        ("force_mn", 20_000.0, "20 mN (20000 µN)"),
        ("polar_angle_rad", 35.0, "0.6109 rad (35 °)"),
    ]:
        with pytest.raises(StudyError) as fault:
            check_quantity(key, number)

        assert str(fault.value).startswith(f"{key}: {number:g} is ")
        assert f"did you mean {hint}?" in str(fault.value)

    for number in [float("nan"), float("inf"), -1.0, 1e9]:  # without a likely unit
        with pytest.raises(StudyError) as fault:
            check_quantity("rigidity_mmhg13_per_ul", number)

        assert "did you mean" not in str(fault.value)


def test_bounds_are_the_same_in_both_units() -> None:
    for name in QUANTITIES:
        spec = QUANTITIES[name]
        human = allowed_bounds(f"{name}_{spec.name}")
        si = allowed_bounds(f"{name}_{SI_PER_UNIT[spec.name][0]}")
        assert (human.low, human.high) == (spec.low, spec.high)
        assert (spec.from_si(si.low), spec.from_si(si.high)) == pytest.approx(
            (spec.low, spec.high)
        )

        for number in (spec.low, spec.high):
            check_quantity(f"{name}_{spec.name}", number)


def test_every_option_that_states_a_quantity_has_its_bounds() -> None:
    names = {
        f"{name}_{unit}"
        for name, spec in QUANTITIES.items()
        for unit in (spec.name, SI_PER_UNIT[spec.name][0])
    }
    context = click.Context(cli)
    stated = {
        (command, option.name): isinstance(option.type, Quantity)
        for command in COMMANDS
        for option in cli.get_command(context, command).params
        if option.name in names
    }
    assert len(stated) > 25
    assert [option for option, checked in stated.items() if not checked] == []


def test_arguments_in_python_are_checked_too(tmp_path: Path) -> None:
    frame = np.zeros((64, 64), np.uint8)
    size = {"width_m": 15e-3, "depth_m": 4e-3}

    with pytest.raises(
        InputError, match=r"thickness_m: 650 .*did you mean 0\.00065 m \(650 µm\)"
    ):
        sf.read(sf.load_model("default"), frame, thickness_m=650.0, **size)

    with pytest.raises(InputError, match=r"youngs_modulus_pa: .* is below"):
        sf.read(sf.load_model("default"), frame, youngs_modulus_pa=0.3, **size)

    with pytest.raises(InputError, match="thickness"):
        sf.simulate(thickness_m=0.65, force_n=0.02)

    with pytest.raises(InputError, match=r"force_n: 20 .*\(20 mN\)"):
        sf.simulate(thickness_m=650e-6, force_n=20.0)

    with pytest.raises(InputError, match=r"iop_pa"):
        sf.phantom(tmp_path / "p", forces_n=[0.02], thickness_m=650e-6, iop_pa=1e6)


def test_a_key_is_refused_with_the_reason_and_the_remedy() -> None:
    why = (
        "(linear mechanics knows no tissue that stiffens, and a library has a range of"
        " it, [library])"
    )
    stiff = "[tissue]\nstiffening = 10.0"
    formed = "[needle]\ntilt_deg = 5.0\n[[form.wave]]\ndegree = 2"

    for text, work, said in (
        (
            stiff,
            ("simulate", "linear"),
            f"linear mechanics {why}; leave it out, or give `mechanics=finite-strain`",
        ),
        (
            stiff,
            ("generate", "finite-strain"),
            f"`generate` with finite-strain mechanics {why}; leave it out",
        ),
        (
            stiff,
            ("train kind=reader", None),
            f"not used by `train kind=reader` {why}; leave it out",
        ),
        (
            formed,
            ("simulate", "linear"),
            (
                "study: form.wave, needle.tilt_deg: not used by `simulate` with linear "
                "mechanics; leave them out, or give `mechanics=finite-strain`"
            ),
        ),
        (
            "[[form.wave]]\ndegree = 2",
            ("generate", "linear"),
            "with linear mechanics; leave it out",
        ),
        (
            "[eye]\ndensity_kg_m3 = 1000.0",
            ("generate", "finite-strain"),
            "leave it out, or give `mechanics=linear`",
        ),
    ):
        with pytest.raises(StudyError) as found:
            refuse_unused(parse_study(text), *work)

        assert str(found.value).endswith(said)


def test_a_key_that_another_one_switches_off_is_refused() -> None:
    for text, message in (
        (
            "[supports]\nbed_stiffness_kpa_per_mm = 1.0",
            r"bed_stiffness_kpa_per_mm: has no effect",
        ),
        (
            '[supports]\nkind = "straps"\nbed_shear_stiffness_kpa_per_mm = 0.1',
            r'"straps"; .* give "bed" or',
        ),
        (
            '[supports]\nkind = "bed"\nstrap_stiffness_n_per_m = 9.0',
            r'strap_stiffness_n.*kind = "bed"',
        ),
        (
            "[supports]\nmedial_azimuth_deg = 60.0",
            r'medial_azimuth_deg: has no .*kind = "clamped"',
        ),
        (
            "[needle]\ntilt_direction_deg = 60.0",
            r"tilt_direction_deg: has no effect with needle\.tilt",
        ),
    ):
        with pytest.raises(StudyError, match=message):
            refuse_unused(parse_study(text), "simulate", "finite-strain")


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * 100_000) + " = 1",
        "x = {" + ".".join("a" * 100_000) + " = 1}",
        '["' + '"."'.join("a" * 60_000) + '"]',
        "a . " * 50_000 + "a = 1",
        "'a'." * 50_000 + "a = 1",
        "[[" + ".".join(["eye"] * 50_000) + "]]",
    ],
    ids=range(6),
)
def test_a_key_of_many_parts_is_refused_before_it_is_parsed(
    text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The parser takes minutes for such a file of 200 kB."""
    monkeypatch.setattr(tomllib, "loads", None)
    with pytest.raises(StudyError, match="a key of more than 20 parts"):
        parse_study(text, "study.toml")


def test_texts_with_many_points_are_no_keys_of_many_parts() -> None:
    text = '[eye]  # www.a.b.c.d, 1.0.2.3.4.5\nid = "' + ". ".join(["a b"] * 40) + '"\n'
    with pytest.raises(StudyError, match=r"eye\.id: unknown key"):
        parse_study(text, "study.toml")
