"""Impossible quantities are refused in every unit, in options, files and arguments, with the likely unit."""

from pathlib import Path

import click
import numpy as np
import pytest
from small_recordings import calibration_text

import scleraforce as sf
from scleraforce.cli.main import COMMANDS, cli
from scleraforce.cli.options import Quantity
from scleraforce.errors import CalibrationError, InputError, RecordingError, StudyError
from scleraforce.known.calibration_file import read_calibration
from scleraforce.recording.folder import read_info
from scleraforce.study.fields import QUANTITIES, allowed, check_quantity
from scleraforce.units import SI_PER_UNIT

INFO = """[eye]
id = "eye"
thickness_m = {thickness_m}
iop_pa = {iop_pa}
[oct]
columns = 512
rows = 512
bits = 12
width_m = {width_m}
depth_m = 4e-3
[needle]
gauge = 22
slice_gap_m = {slice_gap_m}
polar_angle_rad = {polar_angle_rad}
"""
STATED = {"thickness_m": 650e-6, "iop_pa": 266.0, "width_m": 15e-3, "slice_gap_m": 5e-4, "polar_angle_rad": 0.6}


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
        human, si = allowed(f"{name}_{spec.name}"), allowed(f"{name}_{SI_PER_UNIT[spec.name][0]}")
        assert (human.low, human.high) == (spec.low, spec.high)
        assert (spec.from_si(si.low), spec.from_si(si.high)) == pytest.approx((spec.low, spec.high))
        for number in (spec.low, spec.high):
            check_quantity(f"{name}_{spec.name}", number)


def test_every_option_that_states_a_quantity_has_its_bounds() -> None:
    names = {f"{name}_{unit}" for name, spec in QUANTITIES.items() for unit in (spec.name, SI_PER_UNIT[spec.name][0])}
    context = click.Context(cli)
    stated = {
        (command, option.name): isinstance(option.type, Quantity)
        for command in COMMANDS
        for option in cli.get_command(context, command).params
        if option.name in names
    }
    assert len(stated) > 25
    assert [option for option, checked in stated.items() if not checked] == []


def test_a_recording_with_an_impossible_value_is_refused(tmp_path: Path) -> None:
    for key, value, hint in [
        ("thickness_m", 650, "650 µm"),
        ("iop_pa", 2e5, "200000 "),
        ("width_m", 15, "15 mm"),
        ("slice_gap_m", 0.5, "0.5 mm"),
        ("polar_angle_rad", 35, "35 °"),
    ]:
        path = tmp_path / "recording.toml"
        path.write_text(INFO.format(**STATED))
        assert read_info(path).eye.thickness_m == 650e-6
        path.write_text(INFO.format(**{**STATED, key: value}))
        with pytest.raises(RecordingError) as fault:
            read_info(path)
        assert f"{key}: {value:g} is above" in str(fault.value)
        assert hint in str(fault.value)


def test_a_calibration_with_an_impossible_value_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    for key, value, hint in (("mean_mpa", 300.0, "0.3 MPa (300 kPa)"), ("thickness_um", 0.65, "650 µm (0.65 mm)")):
        path.write_text(calibration_text(eyes={"eye": {key: value}}))
        with pytest.raises(CalibrationError) as fault:
            read_calibration(path)
        assert hint in str(fault.value)


def test_arguments_in_python_are_checked_too(tmp_path: Path) -> None:
    frame = np.zeros((64, 64), np.uint8)
    size = {"width_m": 15e-3, "depth_m": 4e-3}
    with pytest.raises(InputError, match=r"thickness_m: 650 .*did you mean 0\.00065 m \(650 µm\)"):
        sf.read(sf.load_model("default"), frame, thickness_m=650.0, **size)
    with pytest.raises(InputError, match=r"youngs_modulus_pa: .* is below"):
        sf.read(sf.load_model("default"), frame, youngs_modulus_pa=0.3, **size)
    with pytest.raises(InputError, match="thickness"):
        sf.simulate(thickness_m=0.65, force_n=0.02)
    with pytest.raises(InputError, match=r"force_n: 20 .*\(20 mN\)"):
        sf.simulate(thickness_m=650e-6, force_n=20.0)
    with pytest.raises(InputError, match=r"iop_pa"):
        sf.phantom(tmp_path / "p", forces_n=[0.02], thickness_m=650e-6, iop_pa=1e6)
