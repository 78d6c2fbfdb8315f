"""The needle in a frame: found with its angle and tip, what it hides left out, and
nothing else taken for one.
"""

from dataclasses import replace
from math import radians

import cv2
import numpy as np
import pytest
from analytic_frames import SHARED, STEEL, needs_shared

from dented_walls import dented_wall
from scleraforce.lab.drawn_bscan import draw_shaft, render_bscan
from scleraforce.lab.tissue_light import (
    Coverslip,
    NeedleShaft,
    Pose,
    ReflectionLine,
    Shadow,
    sample_optics,
)
from scleraforce.recordings.recording_folder import open_frame, recorded_file
from scleraforce.records.scan import PixelScale, Scan
from scleraforce.records.study import OctStudy, Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.needle_in_frame import SeenNeedle, needle_entry
from scleraforce.wall.wall import Segmentation, draw_overlay

OCT = OctStudy()
SCALE = PixelScale.of(OCT)
POSE = Pose(lateral_m=0.2e-3, depth_m=0.5e-3)
GAUGES_M = {22: 0.7e-3, 25: 0.5e-3, 30: 0.3e-3, 34: 0.18e-3}


def leaning(degrees: float, **shaft: float) -> NeedleShaft:
    return replace(STEEL, angle_rad=radians(degrees), **shaft)


def frame_of(
    shaft: NeedleShaft | None, dent_m: float = 1.0e-3, seed: int = 0, **own: object
) -> np.ndarray:
    """A frame of a wall, its contact at 0.2 mm beside the middle and 0.5 mm deep, with
    a needle's tip in its dent.
    """
    section = POSE.place(dented_wall(0.7e-3, dent_m, 1.2e-3, points=1501))
    drawn = None if shaft is None else draw_shaft(shaft, tip_of(dent_m), 0.0, OCT)
    clear = {"snr_db": 25.0, "shadows": ()} | own
    optics = sample_optics(Study().phantom, OCT, np.random.default_rng(seed))
    rng = np.random.default_rng(seed)
    return render_bscan(section, OCT, replace(optics, **clear), rng, drawn).frame


def tip_of(dent_m: float) -> np.ndarray:
    return np.array([0.2e-3, 0.5e-3 + dent_m])


def wall_of(*frame: object, **own: object) -> Segmentation:
    return find_wall(frame_of(*frame, **own), SCALE)


def needle_in(frame: np.ndarray) -> SeenNeedle | None:
    return find_wall(frame, SCALE).needle


def surface_error_m(found: Segmentation, dent_m: float) -> np.ndarray:
    """Return the depth of a found surface below the one of `frame_of`, (column,), m."""
    placed = POSE.place(dented_wall(0.7e-3, dent_m, 1.2e-3, points=1501)).outer
    lateral_m = (np.arange(OCT.columns) + 0.5) * SCALE.lateral_m - OCT.width_m / 2
    depth_m = (found.outer_row + 0.5) * SCALE.depth_m
    return depth_m - np.interp(lateral_m, *placed.T)


@pytest.mark.parametrize("gauge", GAUGES_M)
@pytest.mark.parametrize("angle_deg", [-45.0, -20.0, 0.0, 10.0, 30.0])
def test_a_needle_is_found_with_its_angle_and_its_tip(gauge, angle_deg):
    shaft = leaning(angle_deg, diameter_m=GAUGES_M[gauge])
    needle = wall_of(shaft, seed=gauge).needle
    assert needle.angle_rad == pytest.approx(radians(angle_deg), abs=radians(3.0))
    assert needle.tip_m == pytest.approx(tip_of(1.0e-3), abs=0.35e-3)


BRIGHT = {"diameter_m": 0.7e-3, "far_edge_db": 0.0}  # both sides


@pytest.mark.parametrize(
    ("angle_deg", "out_deg"), [(0.0, 12.0), (12.0, -12.0), (-8.0, 12.0)]
)
def test_the_axis_is_midway_between_two_sides_which_converge_where_the_shaft_leaves_the_plane(
    angle_deg, out_deg
):
    shaft = leaning(angle_deg, lean_rad=radians(out_deg), **BRIGHT)
    needle = wall_of(shaft, 0.4e-3, seed=1).needle
    assert needle.axis_rad == pytest.approx(radians(angle_deg), abs=radians(1.5))
    assert abs(needle.angle_rad - radians(angle_deg)) > radians(2.0)  # of one side


def test_a_bevel_in_a_shallow_frame_does_not_tell_the_axis_and_a_long_side_does():
    bevelled = leaning(3.0, bevel_rad=radians(20.0), **BRIGHT)
    assert wall_of(bevelled, 0.8e-3, seed=2).needle.axis_rad is None
    deep = wall_of(bevelled, 2.8e-3, seed=2).needle
    assert deep.axis_rad == pytest.approx(radians(3.0), abs=radians(2.5))


@pytest.mark.parametrize("dent_m", [3.2e-3, 4.2e-3])
def test_a_tip_below_the_frame_has_no_place(dent_m):
    needle = wall_of(leaning(10.0), dent_m).needle
    entry = needle_entry(needle)
    assert entry["angle_deg"] == pytest.approx(10.0, abs=3.0)
    if tip_of(dent_m)[1] > OCT.depth_m:
        assert needle.tip_m is entry["tip_mm"] is None
    else:
        assert needle.tip_m == pytest.approx(tip_of(dent_m), abs=0.35e-3)


@pytest.mark.parametrize("shaft", [{}, {"loss_fraction": 0.5}, {"bevel_rad": 0.4}])
@pytest.mark.parametrize("dent_m", [0.05e-3, 1.0e-3, 2.0e-3])
def test_the_wall_is_found_on_both_sides_of_a_needle_and_nothing_behind_it(
    shaft, dent_m
):
    found = wall_of(leaning(-15.0, **shaft), dent_m, seed=3)
    assert found.usable
    first, after = found.needle.hidden
    assert np.isnan(found.outer_row[first:after]).all()
    assert not found.mask[:, first:after].any()
    off_m = surface_error_m(found, dent_m)
    for side in (off_m[first - 60 : first], off_m[after : after + 60]):
        assert np.isfinite(side).mean() > 0.95
        assert np.nanquantile(np.abs(side), 0.9) < 40e-6


@pytest.mark.parametrize("dent_m", [0.05e-3, 1.0e-3])
def test_right_beside_a_needle_the_wall_ends_where_it_would_without_one_and_a_steep_dent_is_not_smoothed(
    dent_m,
):
    without = wall_of(None, dent_m, seed=3)
    worst_m = []
    for diameter_m in (0.3e-3, 0.7e-3):
        found = wall_of(leaning(0.0, diameter_m=diameter_m), dent_m, seed=3)
        first, after = found.needle.hidden
        off = np.abs(found.inner_row - without.inner_row)
        off_m = np.abs(surface_error_m(found, dent_m))
        for side in (slice(first - 24, first), slice(after, after + 24)):
            assert np.nanmax(off[side]) < 4.0
            worst_m.append(np.nanmax(off_m[side]))

    # 24 um where both flanks are smoothed into each other
    assert dent_m < 1.0e-3 or np.mean(worst_m) < 18e-6


LIGHT = {"level_db": 25.0, "thickness_m": 20e-6}
NO_NEEDLES = {
    "nothing": {},
    "mirror reflection": {"reflection_db": 30.0, "reflection_angle_rad": 0.2},
    **{
        f"shadow of {lost}": {
            "shadows": (Shadow(centre_m=0.2e-3, width_m=0.5e-3, loss_fraction=lost),)
        }
        for lost in (0.9, 1.0)
    },
    "lines": {
        "lines": tuple(ReflectionLine(depth_m=d, **LIGHT) for d in (5e-5, 1e-4, 2e-4))
    },
    "coverslips": {
        "covers": tuple(
            Coverslip(height_m=0.3e-3, tilt_rad=radians(tilt), **LIGHT)
            for tilt in (-8.0, 5.0)
        )
    },
}


@pytest.mark.parametrize("name", NO_NEEDLES)
@pytest.mark.parametrize("dent_m", [0.0, 1.0e-3])
def test_nothing_else_is_taken_for_a_needle(name, dent_m):
    for seed in range(2):
        assert wall_of(None, dent_m, seed, **NO_NEEDLES[name]).needle is None, seed


def test_a_flare_through_the_tissue_and_a_hair_that_casts_no_shadow_are_not_needles():
    flare = frame_of(None, 0.0)
    hair = flare.copy()
    flare[:, 255:264] = np.maximum(flare[:, 255:264], 3000)
    cv2.line(hair, (240, 0), (262, 60), 3500, 2)
    assert needle_in(flare) is needle_in(hair) is None


@pytest.mark.parametrize(("end", "seen"), [(512, False), (384, True)])
def test_a_line_whose_light_continues_below_the_tissue_is_a_flare(end, seen):
    """A flare does not fade on its way down."""
    frame = frame_of(STEEL, 0.05e-3, seed=5).astype(np.int64)
    tip_m = tip_of(0.05e-3)
    column = round((tip_m[0] + OCT.width_m / 2) / SCALE.lateral_m)
    begin = round((tip_m[1] + 1.0e-3) / SCALE.depth_m)
    frame[begin:end, column - 8 : column + 9] += 200
    needle = needle_in(np.clip(frame, 0, 4095).astype(np.uint16))
    assert (needle is not None) == seen


def test_the_hidden_wall_does_not_count_as_seen():
    frame = frame_of(leaning(0.0, diameter_m=1.0e-3), 0.05e-3, seed=3)
    first, after = needle_in(frame).hidden
    least = round(0.4 * OCT.columns)  # must show the wall
    # with half of the hidden columns it would be enough
    beside = (least - (after - first) // 2) // 2
    noise = np.random.default_rng(0).permuted(frame[:40, 60:100].ravel())
    for column in (*range(first - beside), *range(after + beside, OCT.columns)):
        if frame[:, column].any():
            frame[:, column] = np.resize(np.roll(noise, 37 * column), OCT.rows)

    found = find_wall(frame, SCALE)
    assert (found.needle is not None, found.usable) == (True, False)
    assert "of the imaged width, not 40%" in found.reason


def test_an_overlay_shows_the_shaft_in_purple():
    frame = frame_of(leaning(-15.0))
    found = find_wall(frame, SCALE)
    walls = (found, replace(found, needle=None))
    with_shaft, without = (draw_overlay(frame, wall).astype(int) for wall in walls)
    changed = (with_shaft != without).any(axis=2)
    assert np.count_nonzero(changed) > 50
    blue, green, red = (with_shaft - without)[changed].mean(axis=0)
    assert min(blue, red) > green + 20.0


@needs_shared
@pytest.mark.real
@pytest.mark.parametrize("lateral_um", [8, 12, 16, 20, 31])
def test_the_flare_of_a_real_eye_at_rest_is_not_a_needle(lateral_um):
    path = SHARED / "real-oct" / "dicom" / "anterior-segment.dcm"
    scan = Scan(width_m=15e-3, depth_m=4e-3, refractive_index=1.0)
    pixels = open_frame(recorded_file(path), scan, Scan(), "assumed").pixels
    for depth_um in (4, 6, 8, lateral_um):
        scale = PixelScale(lateral_m=1e-6 * lateral_um, depth_m=1e-6 * depth_um)
        assert find_wall(pixels, scale).needle is None


@pytest.mark.real
@needs_shared
@pytest.mark.parametrize("name", "abcde")
def test_a_needle_is_found_in_the_recording_of_one_and_in_none_of_the_others(name):
    frames = SHARED / "recordings" / f"sample-{name}" / "frames"
    for path in sorted(frames.glob("*.png")):
        needle = needle_in(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
        assert (needle is not None) == (name == "d"), path


@pytest.mark.real
@needs_shared
def test_a_needle_without_tissue_is_never_usable():
    scale = PixelScale(lateral_m=3e-3 / 64, depth_m=3e-3 / 512)
    for path in sorted((SHARED / "real-oct" / "needle-volumes").glob("*.npz")):
        with np.load(path) as kept:
            volume = kept["data"]
        for scan in (*volume.swapaxes(0, 1)[::4], *volume.transpose(2, 0, 1)[::4]):
            assert not find_wall(np.ascontiguousarray(scan), scale).usable, path
