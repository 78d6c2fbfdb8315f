"""`sf.simulate` and `sf.phantom`: records, their everyday keywords, the study's values
where nothing is declared.
"""

import inspect
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scleraforce as sf
from scleraforce.front.api.progress import Bars, counting_for
from scleraforce.front.api.simulating import study_with_globe
from scleraforce.records.eye import NO_DISCREPANCY, Eye, Modulus
from scleraforce.records.globe import UNKNOWN, Globe
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup, completed_by_study
from scleraforce.records.study import GlobeStudy, Study
from scleraforce.records.tissue_relaxation import Relaxation

COARSE = sf.parse_study("[mesh]\ndivisions = 6")
SMALL = sf.parse_study("[mesh]\ndivisions = 6\n[oct]\ncolumns = 64\nrows = 48")
WALL: dict[str, Any] = {"thickness_m": 600e-6}
RIGIDITY = 1e8


def test_no_function_takes_more_than_eight_parameters_beside_the_short_forms() -> None:
    for function in (sf.simulate, sf.phantom):
        parameters = inspect.signature(function).parameters.values()
        named = [each for each in parameters if each.kind is not each.VAR_KEYWORD]
        assert len(named) <= 8


def test_records_and_keywords_simulate_the_same_eye() -> None:
    eye = Eye(thickness_m=600e-6, modulus=Modulus.stated(0.4e6), iop_pa=500.0)
    by_records = sf.simulate(COARSE, eye=eye, needle=Needle(gap_m=1e-4), force_n=0.01)
    by_keywords = sf.simulate(
        COARSE,
        **WALL,
        youngs_modulus_pa=0.4e6,
        iop_pa=500.0,
        gap_m=1e-4,
        force_n=0.01,
    )
    assert by_records.tip_m == by_keywords.tip_m
    assert np.array_equal(by_records.slice, by_keywords.slice)
    softer = sf.simulate(COARSE, **WALL, youngs_modulus_pa=0.2e6, force_n=0.01)
    assert softer.tip_m == pytest.approx(2.0 * by_records.tip_m, rel=0.01)


def test_the_studys_values_hold_where_nothing_is_declared() -> None:
    completed = completed_by_study(Setup(eye=Eye("a", iop_pa=500.0)), COARSE)
    low, high = COARSE.needle.polar_angle_rad.bounds
    assert completed.eye.modulus_pa == COARSE.eye.youngs_modulus_pa
    assert completed.eye.iop_pa == 500.0
    assert completed.needle == Needle(
        gap_m=COARSE.needle.gap_m, polar_rad=(low + high) / 2
    )
    assert completed.eye.thickness_m is None


@pytest.mark.parametrize(
    ("globe", "expected"),
    [
        (None, GlobeStudy()),
        (Globe.declared("sealed"), GlobeStudy("sealed")),
        (Globe.declared("sealed", RIGIDITY), GlobeStudy("sealed", RIGIDITY)),
        (
            Globe.declared("sealed", RIGIDITY, "logarithmic", 30.0),
            GlobeStudy("sealed", RIGIDITY, "logarithmic", 30.0),
        ),
    ],
)
def test_a_declared_globe_becomes_the_studys(
    globe: Globe | None, expected: GlobeStudy
) -> None:
    assert study_with_globe(Study(), globe).globe == expected


def test_a_globe_that_is_unknown_makes_no_virtual_eye() -> None:
    with pytest.raises(sf.InputError, match=r"^eye\.globe: unknown; "):
        sf.simulate(COARSE, eye=Eye(globe=UNKNOWN), **WALL, force_n=0.01)


@pytest.mark.parametrize(
    ("records", "field"),
    [
        ({"eye": Eye(iop_pa=300.0, iop_sd_pa=10.0)}, "eye.iop_sd_pa"),
        ({"eye": Eye(radius_m=11e-3)}, "eye.radius_m"),
        ({"eye": Eye(relaxation=Relaxation.declared(()))}, "eye.relaxation"),
        ({"eye": Eye(discrepancy=NO_DISCREPANCY)}, "eye.discrepancy"),
        ({"needle": Needle(diameter_m=0.5e-3)}, "needle.diameter_m"),
        ({"needle": Needle(lean_rad=(0.1, 0.1))}, "needle.lean_rad"),
        ({"scan": Scan(columns=64)}, "scan.columns"),
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


def test_an_eye_without_a_thickness_is_refused(tmp_path: Path) -> None:
    with pytest.raises(sf.InputError, match=r"^thickness_m: not declared"):
        sf.simulate(COARSE, force_n=0.01)
    with pytest.raises(sf.InputError, match=r"^eye pig: thickness_m: not declared"):
        sf.phantom(tmp_path / "eye", COARSE, eye="pig", forces_n=[0.01])


@pytest.mark.parametrize("name", ["a/b", ".x", ""])
def test_a_name_that_no_folder_can_have_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(sf.InputError, match=r"^eye: id: .*; must be a name without /"):
        sf.phantom(tmp_path / "eye", COARSE, eye=name, forces_n=[0.01], **WALL)


def test_a_keyword_that_does_not_exist_is_a_type_error(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="rate_hz"):
        sf.phantom(tmp_path / "eye", COARSE, forces_n=[0.01], **WALL, rate_hz=60.0)
    with pytest.raises(TypeError, match="polar_angle_rad"):
        sf.simulate(COARSE, **WALL, force_n=0.01, polar_angle_rad=0.5)


def test_a_needle_that_moves_and_a_plane_that_is_turned_are_recorded(
    tmp_path: Path,
) -> None:
    counted: list[int] = []
    recording = sf.phantom(
        tmp_path / "eye",
        SMALL,
        forces_n=[0.004],
        eye=Eye("pig", thickness_m=600e-6),
        needle=Needle(polar_rad=0.5, azimuth_rad=0.2),
        scan=Scan(direction_rad=0.3, tilt_rad=0.05),
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


def test_bars_count_the_load_path_and_the_frames(tmp_path: Path) -> None:
    counted: dict[str, int] = {}

    def bar(title: str, total: int) -> Any:
        counted[title] = total
        return counting_for(None, "")(title, total)

    sf.phantom(tmp_path / "eye", SMALL, forces_n=[0.004], **WALL, progress=Bars(bar))
    assert counted == {"load path": 100, "frames": 1}
