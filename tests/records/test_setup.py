"""A setup: what a recording states, and what completes it."""

from dataclasses import replace

import numpy as np
import pytest

from scleraforce.base.units import SI_PER_UNIT
from scleraforce.records.decoder import format_record, parse_record
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, SEALED, Globe
from scleraforce.records.needle import Needle, gauge_diameter_m, lean_ends
from scleraforce.records.recording_info import ForceInfo, RecordingInfo
from scleraforce.records.scan import Plane, Scan
from scleraforce.records.setup import NOTHING_KNOWN, Setup
from scleraforce.records.tissue_relaxation import Relaxation

PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]
SCAN = Scan(columns=512, rows=512, bits=12, width_m=15e-3, depth_m=4e-3)
NEEDLE = Needle(diameter_m=gauge_diameter_m(22), gap_m=0.5e-3, polar_rad=0.6)


FULL = """\
[eye]
id = "mine"
thickness_m = 0.0006
thickness_sd_m = 2e-05
iop_pa = 2000.0
iop_sd_pa = 100.0
radius_m = 0.0115
radius_sd_m = 0.0002
globe = "sealed"
rigidity_mmhg13_per_ul = 0.02
rigidity_law = "logarithmic"
leak_time_s = 60.0
relaxation = [[0.1, 2.0], [0.2, 30.0]]

[oct]
columns = 512
rows = 256
bits = 12
width_m = 0.015
depth_m = 0.004
plane_direction_rad = 0.3
plane_tilt_rad = 0.1
refractive_index = 1.38
plane = []

[needle]
gauge = 22
slice_gap_m = 0.0005
polar_angle_rad = 0.6
lean_rad = 0.2
lean_azimuth_rad = -1.0

[force]
axis = "fz"
contact_sign = -1
average_s = 0.2
range_n = 5.0
"""
INFO = RecordingInfo(
    eye=Eye(
        "mine",
        thickness_m=0.6e-3,
        thickness_sd_m=20e-6,
        iop_pa=2000.0,
        iop_sd_pa=100.0,
        radius_m=11.5e-3,
        radius_sd_m=0.2e-3,
        globe=Globe.declared(
            "sealed", float(f"{0.02 * PER_UL:.15g}"), "logarithmic", 60.0
        ),
        relaxation=Relaxation.declared([[0.1, 2.0], [0.2, 30.0]]),
    ),
    scan=Scan(
        columns=512,
        rows=256,
        bits=12,
        width_m=15e-3,
        depth_m=4e-3,
        direction_rad=0.3,
        tilt_rad=0.1,
        refractive_index=1.38,
    ),
    needle=Needle(
        diameter_m=0.7e-3,
        gap_m=0.5e-3,
        polar_rad=0.6,
        lean_rad=lean_ends(0.2),
        lean_azimuth_rad=-1.0,
    ),
    force=ForceInfo("fz", -1, 0.2, 5.0),
)


def test_a_recordings_file_has_every_key_once_and_comes_back():
    assert parse_record(RecordingInfo, FULL, "recording.toml") == INFO
    assert format_record(INFO) == FULL


def test_a_file_has_no_finding_of_a_calibration():
    found = replace(
        INFO.eye,
        modulus=Modulus.stated(0.3e6),
        stiffening=4.0,
        calibrated_lean_rad=0.2,
        unlearned=INFO.eye,
        globe=replace(INFO.eye.globe, calibrated=True),
        relaxation=replace(INFO.eye.relaxation, source="holds"),
    )
    measured = (
        "rigidity_mmhg13_per_ul = 0.02\n",
        "relaxation = [[0.1, 2.0], [0.2, 30.0]]\n",
    )
    declared = FULL
    for line in measured:
        declared = declared.replace(line, "")
    assert format_record(replace(INFO, eye=found)) == declared


def test_a_setup_turned_to_another_plane_has_its_direction_and_no_gap():
    turned = INFO.setup.turned(0.5)
    assert turned.scan == replace(INFO.scan, direction_rad=0.8)
    assert turned.needle == replace(INFO.needle, gap_m=None)
    assert turned.eye == INFO.eye
    assert NOTHING_KNOWN.turned(0.5) == NOTHING_KNOWN
    far = Setup(scan=Scan(direction_rad=6.0)).turned(6.0).scan.direction_rad
    assert far == pytest.approx(12.0 - 4.0 * np.pi)


def test_a_given_value_is_kept_and_a_missing_one_is_taken_from_what_is_stated():
    given = Setup(
        eye=Eye(iop_pa=1500.0),
        needle=Needle(gap_m=0.4e-3),
        scan=Scan(direction_rad=0.1),
    )
    stated = replace(INFO.setup, scan=replace(INFO.scan, tilt_rad=0.0))
    assert given.completed_by(stated) == Setup(
        # the stated uncertainty was that of another pressure
        eye=replace(INFO.eye, iop_pa=1500.0, iop_sd_pa=None),
        needle=replace(INFO.needle, gap_m=0.4e-3),
        scan=replace(stated.scan, direction_rad=0.1),
    )
    assert NOTHING_KNOWN.completed_by(NOTHING_KNOWN) == NOTHING_KNOWN


LOGARITHMIC = Globe.declared("sealed", 0.02 * PER_UL, "logarithmic")
NUMBER = Globe.declared("sealed", 0.03 * PER_UL)
LEAKING = replace(SEALED, leak_time_s=30.0)


@pytest.mark.parametrize(
    ("given", "stated", "globe"),
    [
        (SEALED, LOGARITHMIC, LOGARITHMIC),
        (NUMBER, LOGARITHMIC, replace(NUMBER, law="logarithmic")),
        (LOGARITHMIC, LEAKING, replace(LOGARITHMIC, leak_time_s=30.0)),
        (replace(SEALED, leak_time_s=60.0), LEAKING, replace(SEALED, leak_time_s=60.0)),
        (OPEN, LOGARITHMIC, OPEN),
        (None, LOGARITHMIC, LOGARITHMIC),
        (OPEN, None, OPEN),
    ],
)
def test_a_given_globe_is_completed_by_a_stated_one_of_its_kind_alone(
    given, stated, globe
):
    completed = Setup(eye=Eye(globe=given)).completed_by(Setup(eye=Eye(globe=stated)))
    assert completed.eye.globe == globe


def test_planes_and_transposition_are_completed_too():
    planes = (Plane("a", 0.0, 0.0), Plane("b", 0.0, 1.5))
    stated = Setup(scan=Scan(planes=planes, transposed=True))
    scan = Setup().completed_by(stated).scan
    assert (scan.planes, scan.transposed) == (planes, True)
