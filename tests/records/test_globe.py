"""A globe: what is declared of it, its rigidities, its file."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from scleraforce.base.errors import StudyError
from scleraforce.base.units import SI_PER_UNIT
from scleraforce.records.decoder import format_record, parse_record
from scleraforce.records.eye import Eye
from scleraforce.records.globe import OPEN, SEALED, UNKNOWN, Globe
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]


def test_a_globe_is_open_or_as_rigid_as_its_declaration_allows():
    assert Globe.declared(None) is UNKNOWN
    assert (UNKNOWN.lowest / PER_UL, UNKNOWN.highest / PER_UL) == pytest.approx(
        (0.0, 0.06)
    )
    assert Globe.declared("open", law="logarithmic") is OPEN
    assert (OPEN.band, OPEN.can_be_sealed, OPEN.pressure_law(OPEN.mean).is_sealed) == (
        (0.0, 0.0),
        False,
        False,
    )
    assert Globe.declared("sealed") == SEALED
    assert (SEALED.lowest / PER_UL, SEALED.highest / PER_UL) == pytest.approx(
        (0.005, 0.06)
    )

    for globe in (UNKNOWN, SEALED):
        assert globe.can_be_sealed
        even = np.linspace(globe.lowest, globe.highest, 100_001)
        assert (globe.mean, globe.sd) == pytest.approx(
            (even.mean(), even.std()), rel=1e-4
        )
        assert 0.9 <= ((even >= globe.band[0]) & (even <= globe.band[1])).mean() < 0.96


def test_a_stated_rigidity_is_known_to_some_percent_under_its_law():
    for law in (None, *RIGIDITY_LAWS):
        globe = Globe.declared("sealed", 0.02 * PER_UL, law)
        assert (globe.kind, globe.law, globe.calibrated) == (
            "sealed",
            law or "cube-root",
            False,
        )
        low, high = globe.band
        assert (low / PER_UL, high / PER_UL) == pytest.approx(
            (0.0174, 0.0226), abs=1e-4
        )
        assert globe.lowest < low < 0.02 * PER_UL < high < globe.highest
        assert Globe.declared("sealed", law=law) == replace(
            SEALED, law=law or "cube-root"
        )


def test_a_rigidity_makes_the_globe_of_its_law():
    for law in RIGIDITY_LAWS:
        globe = Globe.declared("sealed", law=law).pressure_law(
            np.array([0.01, 0.03]) * PER_UL
        )
        assert globe.law == law
        slopes = globe.stiffness(SI_PER_UNIT["mmhg"][1] * 15.0)
        assert slopes[1] == pytest.approx(3.0 * slopes[0])
        # Pa a microlitre at 15 mmHg, where all laws agree
        assert slopes[1] * 1e-9 == pytest.approx(73.0, abs=0.1)


@dataclass(frozen=True)
class EyeFile:
    """A file that has an eye alone."""

    eye: Eye


LINES = {
    "": None,
    'globe = "open"\n': OPEN,
    'globe = "sealed"\n': SEALED,
    'globe = "sealed"\nleak_time_s = 20.0\n': replace(SEALED, leak_time_s=20.0),
    'globe = "sealed"\nrigidity_law = "logarithmic"\n': replace(
        SEALED, law="logarithmic"
    ),
    'globe = "sealed"\nrigidity_mmhg13_per_ul = 0.02\nrigidity_law = "cube-root"\n': (
        Globe.declared("sealed", float(f"{0.02 * PER_UL:.15g}"))
    ),
    'globe = "sealed"\nrigidity_mmhg13_per_ul = 0.02\nrigidity_law = "logarithmic"\n'
    "leak_time_s = 60.0\n": Globe.declared(
        "sealed", float(f"{0.02 * PER_UL:.15g}"), "logarithmic", 60.0
    ),
}


@pytest.mark.parametrize("lines", LINES)
def test_a_recording_states_a_globe_or_none(lines):
    text = '[eye]\nid = "e"\n' + lines
    found = parse_record(EyeFile, text, "recording.toml")
    assert found.eye.globe == LINES[lines]
    assert format_record(found) == text


def test_a_file_says_nothing_of_an_unknown_globe():
    assert format_record(EyeFile(Eye("e", globe=UNKNOWN))) == '[eye]\nid = "e"\n'


@pytest.mark.parametrize(
    "key",
    ["rigidity_mmhg13_per_ul = 0.02", 'rigidity_law = "cube-root"', "leak_time_s = 9"],
)
@pytest.mark.parametrize(
    ("globe", "found"), [('globe = "open"\n', '"open"'), ("", "missing")]
)
def test_what_is_measured_of_a_sealed_globe_is_refused_of_another(globe, found, key):
    name = key.partition(" ")[0]
    with pytest.raises(
        StudyError, match=f"{name}: of a sealed globe, globe is {found};"
    ):
        parse_record(EyeFile, f'[eye]\nid = "e"\n{globe}{key}\n', "recording.toml")
