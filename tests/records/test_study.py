"""The study: fields with bounds and units, its TOML with the line of each fault,
quantities, unused keys.
"""

import re
import tomllib
from contextlib import suppress
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import scleraforce as sf
from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.units import SI_PER_UNIT
from scleraforce.records.fields import (
    QUANTITIES,
    allowed_bounds,
    check_quantity,
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


def values(default, unit):
    """Other values of a field, as one would write them in a file (six digits)."""
    low = -1e6 if unit.low is None else unit.low
    high = 1e6 if unit.high is None else unit.high
    number = st.floats(low, high, allow_nan=False).map(
        lambda value: unit.to_si(min(max(float(f"{value:.6g}"), low), high))
    )
    if unit.words:
        return st.sampled_from(unit.words)

    match default:
        case Choice() | Range():
            choices = st.lists(number, min_size=1, max_size=4).map(
                lambda drawn: Choice(tuple(drawn))
            )
            pairs = st.tuples(number, number).map(sorted)
            return choices | pairs.map(lambda ends: Range(min=ends[0], max=ends[1]))
        case bool():
            return st.booleans()
        case int():
            return st.integers(int(low), int(high))
        case float():
            return number
        case _:
            return st.just(default)


FIELDS = [
    (section.name, item)
    for section in fields(Study)
    for item in fields(getattr(Study(), section.name))
]


@st.composite
def studies(draw):
    """The paper's study with up to eight fields changed, where they fit together."""
    study = Study()
    for name, item in draw(st.lists(st.sampled_from(FIELDS), max_size=8)):
        section = getattr(study, name)
        value = draw(values(getattr(section, item.name), field_unit(item)))
        with suppress(StudyError):
            study = replace(study, **{name: replace(section, **{item.name: value})})
    return study


@settings(max_examples=30, deadline=None)
@given(studies())
def test_a_study_survives_being_written_and_read(study):
    again = parse_study(format_study(study))
    assert again == study
    assert study_hash(again) == study_hash(study)


def test_the_commented_paper_study_is_the_defaults_and_has_their_hash():
    assert parse_study(PAPER_STUDY_TOML) == parse_study("") == Study()
    assert study_hash(parse_study(PAPER_STUDY_TOML)) == study_hash(Study())
    assert study_hash(replace(Study(), network=NetworkStudy(seed=1))) != study_hash(
        Study()
    )


def test_values_are_si_inside_and_exact():
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
    ('[eye]\nradius_mm = "wide"', 2, "eye.radius_mm: expected a number, found 'wide'"),
    ("[eye]\nradius_mm = nan", 2, "eye.radius_mm: nan is not a finite number"),
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
    ("[eye]\nradius_mm = 12\n[eye]", 3, "not TOML"),
    (
        "[eye]\nradius_mm = 1" + "0" * 400,
        2,
        "eye.radius_mm: a number of more than 15 digits",
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


@pytest.mark.parametrize(("text", "line", "message"), BAD, ids=range(len(BAD)))
def test_faults_are_named_with_their_line(text, line, message):
    with pytest.raises(StudyError) as fault:
        parse_study(text, "my.toml")

    said = str(fault.value)
    assert message in said
    assert said.startswith(f"my.toml:{line}: ") or f"line {line}" in said
    assert "\n" not in said


@pytest.mark.parametrize("value", ["[" * 100_000, "9" * 5000], ids=range(2))
def test_what_the_parser_of_toml_does_not_refuse_itself_is_refused(value):
    with pytest.raises(StudyError, match=r"my\.toml: not TOML"):
        parse_study(f"a = {value}", "my.toml")


def test_samples_follow_their_distribution_and_the_generator():
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


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"stiffenings": 3}, "^stiffenings: 3; give 1, or at least 4$"),
        ({"stiffening": fixed(5.0)}, "^stiffening: a range has to be given"),
    ],
)
def test_stiffenings_of_a_library_are_one_or_enough_for_splines(values, said):
    with pytest.raises(StudyError, match=said):
        LibraryStudy(**values)


def test_the_ends_of_a_librarys_stiffening_are_those_of_its_range_or_one():
    held = Range(min=2.0, max=20.0)
    assert LibraryStudy(stiffening=held).stiffening_ends == (2.0, 20.0)
    assert LibraryStudy(stiffening=held, stiffenings=1).stiffening_ends == (2.0, 2.0)


@pytest.mark.parametrize(
    ("key", "number", "hint"),
    [
        ("thickness_um", 0.65, "650 µm (0.65 mm)"),
        ("thickness_m", 650.0, "0.00065 m (650 µm)"),
        ("youngs_modulus_mpa", 300.0, "0.3 MPa (300 kPa)"),
        ("youngs_modulus_mpa", 250_000.0, "0.25 MPa (250000 Pa)"),
        ("iop_mmhg", 2000.0, "15 mmHg (2000 Pa)"),
        ("force_mn", 20_000.0, "20 mN (20000 µN)"),
        ("polar_angle_rad", 35.0, "0.6109 rad (35 °)"),
    ],
)
def test_a_slip_of_the_unit_is_named(key, number, hint):
    did_you_mean = re.escape(f"; did you mean {hint}?")
    with pytest.raises(StudyError, match=f"^{key}: {number:g} is .*{did_you_mean}"):
        check_quantity(key, number)


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -1.0, 1e9])
def test_no_unit_is_named_where_none_is_likely(number):
    with pytest.raises(StudyError, match=r"^rigidity_mmhg13_per_ul: [^;]*$"):
        check_quantity("rigidity_mmhg13_per_ul", number)


@pytest.mark.parametrize("name", QUANTITIES)
def test_bounds_are_the_same_in_both_units(name):
    unit = QUANTITIES[name]
    si = allowed_bounds(f"{name}_{SI_PER_UNIT[unit.name][0]}")
    ends = (unit.low, unit.high)
    assert (unit.from_si(si.low), unit.from_si(si.high)) == pytest.approx(ends)
    for number in ends:
        check_quantity(f"{name}_{unit.name}", number)


def test_arguments_in_python_are_checked_too(tmp_path):
    frame = np.zeros((64, 64), np.uint8)
    scale = {"width_m": 15e-3, "depth_m": 4e-3}
    with pytest.raises(InputError, match=r"thickness_m: 650 .*did you mean 0\.00065 m"):
        sf.read(sf.load_model("default"), frame, thickness_m=650.0, **scale)
    with pytest.raises(InputError, match=r"force_n: 20 .*\(20 mN\)"):
        sf.simulate(thickness_m=650e-6, force_n=20.0)
    with pytest.raises(InputError, match="iop_pa"):
        sf.phantom(tmp_path / "p", forces_n=[0.02], thickness_m=650e-6, iop_pa=1e6)


WAVE = "[[form.wave]]\ndegree = 2"
STIFF = "[tissue]\nstiffening = 10.0"
WHY = (
    "(linear mechanics knows no tissue that stiffens, and a library has a range of"
    " it, [library])"
)


@pytest.mark.parametrize(
    ("text", "work", "said"),
    [
        (
            STIFF,
            ("simulate", "linear"),
            f"linear mechanics {WHY}; leave it out, or give `mechanics=finite-strain`",
        ),
        (
            STIFF,
            ("generate", "finite-strain"),
            f"`generate` with finite-strain mechanics {WHY}; leave it out",
        ),
        (
            STIFF,
            ("train kind=reader", None),
            f"not used by `train kind=reader` {WHY}; leave it out",
        ),
        (
            f"[needle]\ntilt_deg = 5.0\n{WAVE}",
            ("simulate", "linear"),
            "study: form.wave, needle.tilt_deg: not used by `simulate` with linear "
            "mechanics; leave them out, or give `mechanics=finite-strain`",
        ),
        (WAVE, ("generate", "linear"), "with linear mechanics; leave it out"),
        (
            "[eye]\ndensity_kg_m3 = 1000.0",
            ("generate", "finite-strain"),
            "leave it out, or give `mechanics=linear`",
        ),
    ],
)
def test_a_key_is_refused_with_the_reason_and_the_remedy(text, work, said):
    with pytest.raises(StudyError, match=f"{re.escape(said)}$"):
        refuse_unused(parse_study(text), *work)


@pytest.mark.parametrize(
    ("table", "lines", "message"),
    [
        (
            "supports",
            "bed_stiffness_kpa_per_mm = 1.0",
            "bed_stiffness_kpa_per_mm: has no effect",
        ),
        (
            "supports",
            'kind = "straps"\nbed_shear_stiffness_kpa_per_mm = 0.1',
            '"straps"; .* give "bed" or',
        ),
        (
            "supports",
            'kind = "bed"\nstrap_stiffness_n_per_m = 9.0',
            'strap_stiffness_n.*kind = "bed"',
        ),
        (
            "supports",
            "medial_azimuth_deg = 60.0",
            'medial_azimuth_deg: has no .*kind = "clamped"',
        ),
        (
            "needle",
            "tilt_direction_deg = 60.0",
            r"tilt_direction_deg: has no effect with needle\.tilt",
        ),
    ],
)
def test_a_key_that_another_one_switches_off_is_refused(table, lines, message):
    with pytest.raises(StudyError, match=message):
        refuse_unused(parse_study(f"[{table}]\n{lines}"), "simulate", "finite-strain")


@pytest.mark.parametrize(
    "text",
    [
        ".".join("a" * 100_000) + " = 1",
        "x = {" + ".".join("a" * 100_000) + " = 1}",
        '["' + '"."'.join("a" * 60_000) + '"]',
        "a . " * 50_000 + "a = 1",
        "'a'." * 50_000 + "a = 1",
        "[[" + ".".join(["eye"] * 50_000) + "]]",
        "[eye]\nradius_mm.a" + ".a" * 2000 + " = 1",
    ],
    ids=range(7),
)
def test_a_key_of_many_parts_is_refused_before_it_is_parsed(text, monkeypatch):
    """The parser takes minutes for such a file of 200 kB."""
    monkeypatch.setattr(tomllib, "loads", None)
    line = 1 + text.count("\n")
    with pytest.raises(
        StudyError, match=rf"^study\.toml:{line}: a key of more than 20"
    ):
        parse_study(text, "study.toml")


def test_texts_with_many_points_are_no_keys_of_many_parts():
    text = '[eye]  # www.a.b.c.d, 1.0.2.3.4.5\nid = "' + ". ".join(["a b"] * 40) + '"\n'
    with pytest.raises(StudyError, match=r"eye\.id: unknown key"):
        parse_study(text, "study.toml")
