"""`sf.simulate` and `sf.phantom`: records, their everyday keywords, the study's values
where nothing is declared.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scleraforce as sf
from scleraforce.records.eye import NO_DISCREPANCY
from scleraforce.records.globe import UNKNOWN
from scleraforce.records.setup import Setup, completed_by_study

COARSE = sf.parse_study("[mesh]\ndivisions = 4\nlevel = 0")
SMALL = sf.parse_study(
    "[mesh]\ndivisions = 4\nlevel = 0\n[oct]\ncolumns = 64\nrows = 48"
)
WALL: dict[str, Any] = {"thickness_m": 600e-6}


def test_records_and_keywords_simulate_the_same_eye() -> None:
    eye = sf.Eye(thickness_m=600e-6, modulus=sf.Modulus.stated(0.4e6), iop_pa=500.0)
    needle = sf.Needle(gap_m=1e-4)
    by_records = sf.simulate(COARSE, eye=eye, needle=needle, force_n=0.01)
    short = {"youngs_modulus_pa": 0.4e6, "iop_pa": 500.0, "gap_m": 1e-4}
    by_keywords = sf.simulate(COARSE, **WALL, **short, force_n=0.01)
    assert by_records.tip_m == by_keywords.tip_m
    assert np.array_equal(by_records.slice, by_keywords.slice)
    softer = sf.simulate(COARSE, **WALL, youngs_modulus_pa=0.2e6, force_n=0.01)
    assert softer.tip_m == pytest.approx(2.0 * by_records.tip_m, rel=0.01)


def test_the_studys_values_hold_where_nothing_is_declared() -> None:
    completed = completed_by_study(Setup(eye=sf.Eye("a", iop_pa=500.0)), COARSE)
    middle = sum(COARSE.needle.polar_angle_rad.bounds) / 2
    assert completed.eye.modulus_pa == COARSE.eye.youngs_modulus_pa
    assert completed.eye.iop_pa == 500.0
    assert completed.needle == sf.Needle(gap_m=COARSE.needle.gap_m, polar_rad=middle)
    assert completed.eye.thickness_m is None


def test_a_declared_globe_is_that_of_the_virtual_eye(tmp_path: Path) -> None:
    globe = sf.Globe.declared("sealed", 1e8, "logarithmic", 30.0)
    eye = sf.Eye(thickness_m=600e-6, globe=globe)
    small = sf.parse_study(
        "[mesh]\ncore = 2\nrings = 4\n[oct]\ncolumns = 64\nrows = 48"
    )
    sf.phantom(
        tmp_path / "eye", small, eye=eye, forces_n=[0.002], mechanics="finite-strain"
    )
    made = json.loads((tmp_path / "eye" / "truth.json").read_text())["globe"]
    assert [*made.values()] == ["sealed", pytest.approx(1e8), "logarithmic", 30.0]


@pytest.mark.parametrize(
    ("records", "field"),
    [
        ({"eye": sf.Eye(iop_pa=300.0, iop_sd_pa=10.0)}, "eye.iop_sd_pa"),
        ({"eye": sf.Eye(radius_m=11e-3)}, "eye.radius_m"),
        ({"eye": sf.Eye(relaxation=sf.Relaxation.declared(()))}, "eye.relaxation"),
        ({"eye": sf.Eye(discrepancy=NO_DISCREPANCY)}, "eye.discrepancy"),
        ({"needle": sf.Needle(diameter_m=0.5e-3)}, "needle.diameter_m"),
        ({"needle": sf.Needle(lean_rad=(0.1, 0.1))}, "needle.lean_rad"),
        ({"scan": sf.Scan(columns=64)}, "scan.columns"),
    ],
)
def test_a_field_that_no_virtual_eye_is_made_of_is_refused(
    records: dict[str, Any], field: str, tmp_path: Path
) -> None:
    with pytest.raises(sf.InputError, match=f"^{field}: not used by `phantom`; "):
        sf.phantom(tmp_path / "eye", COARSE, forces_n=[0.01], **WALL, **records)

    if "scan" not in records:
        with pytest.raises(sf.InputError, match=f"^{field}: not used by `simulate`; "):
            sf.simulate(COARSE, force_n=0.01, **WALL, **records)


@pytest.mark.parametrize(
    ("eye", "words"),
    [
        ("pig", "eye pig: thickness_m: not declared"),
        (sf.Eye(thickness_m=6e-4, globe=UNKNOWN), r"eye\.globe: unknown; "),
        (sf.Eye("a/b", thickness_m=6e-4), "eye: id: .*; must be a name without /"),
        (sf.Eye(".x", thickness_m=6e-4), "eye: id: .*; must be a name without /"),
        ("", "eye: id: .*; must be a name without /"),
    ],
)
def test_an_eye_that_cannot_be_made_is_refused(
    eye: sf.Eye | str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(sf.InputError, match=f"^{words}"):
        sf.phantom(tmp_path / "eye", COARSE, eye=eye, forces_n=[0.01])


def test_a_simulation_needs_a_thickness() -> None:
    with pytest.raises(sf.InputError, match=r"^thickness_m: not declared"):
        sf.simulate(COARSE, force_n=0.01)


def test_a_needle_that_moves_and_a_plane_that_is_turned_are_recorded(
    tmp_path: Path,
) -> None:
    counted: list[int] = []
    recording = sf.phantom(
        tmp_path / "eye",
        SMALL,
        forces_n=[0.004],
        eye=sf.Eye("pig", thickness_m=600e-6),
        needle=sf.Needle(polar_rad=0.5, azimuth_rad=0.2),
        scan=sf.Scan(direction_rad=0.3, tilt_rad=0.05),
        motion=sf.Motion(rate_hz=2.0, ramp_n_per_s=0.02, hold_s=0.5),
        progress=counted.append,
        seed=4,
    )
    info = recording.info
    truth = json.loads((tmp_path / "eye" / "truth.json").read_text())
    assert len(recording.frames) == sum(counted)
    assert (info.eye.name, info.needle.polar_rad) == ("pig", 0.5)
    assert (info.scan.direction_rad, info.scan.tilt_rad) == (0.3, 0.05)
    assert (truth["seed"], truth["eye"]["azimuth_rad"]) == (4, 0.2)
    assert truth["path"]["forces_n"]
