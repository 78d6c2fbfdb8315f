"""The wall in frames whose truth is known, under everything that disturbs a real
one.
"""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from analytic_frames import SHARED, needs_shared
from poses import sample_pose

from dented_walls import dented_wall
from scleraforce.calibration.answer_metrics import dice
from scleraforce.lab.drawn_bscan import Bscan, render_bscan
from scleraforce.lab.tissue_light import Coverslip, Pose, ReflectionLine, sample_optics
from scleraforce.lab.virtual_eye import LinearSections
from scleraforce.records.eye import Eye
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import OctStudy, Study
from scleraforce.wall.find_wall import find_wall
from virtual_eyes import changed

STUDY = Study()
SCALE = PixelScale.of(STUDY.oct)
AT_TOP = Pose(lateral_m=0.0, depth_m=0.6e-3)
CLEAR = {
    "snr_db": 25.0,
    "attenuation_per_m": 800.0,
    "choroid_level_db": -10.0,
    "shadows": (),
}


def phantom(
    thickness_m: float,
    dent_m: float,
    seed: int = 0,
    scanner: OctStudy = STUDY.oct,
    pose: Pose = AT_TOP,
    width_m: float = 1.6e-3,
    **optics: object,
) -> Bscan:
    rng = np.random.default_rng(seed)
    drawn = sample_optics(STUDY.phantom, scanner, rng)
    section = pose.place(dented_wall(thickness_m, dent_m, width_m))
    return render_bscan(section, scanner, replace(drawn, **CLEAR | optics), rng)


@pytest.fixture
def bscan() -> Bscan:
    return phantom(0.7e-3, 1.5e-3, seed=1)


def sloping(degrees: float) -> dict[str, object]:
    tilt_rad = np.radians(degrees)
    return {
        "scanner": OctStudy(width_m=3e-3, depth_m=4e-3),
        "pose": Pose(lateral_m=0.0, depth_m=1.5e-3, tilt_rad=tilt_rad),
        "band_m": 0.0,
    }


def pixels_of(pixel_um: float) -> dict[str, object]:
    pixel_m = pixel_um / 1e6
    columns = min(512, int(14e-3 / pixel_m))
    size = {"width_m": columns * pixel_m, "depth_m": 512 * pixel_m}
    return {
        "scanner": OctStudy(rows=512, columns=columns, **size),
        "axial_resolution_m": pixel_m,
        "lateral_resolution_m": 2 * pixel_m,
        "band_m": 0.0,
    }


LINES = tuple(
    ReflectionLine(depth_m=depth_m, level_db=25.0, thickness_m=12e-6)
    for depth_m in (0.1e-3, 0.3e-3, 1.5e-3, 3.0e-3)
)


def covers(tilt_rad: float) -> tuple[Coverslip, ...]:
    light = {"level_db": 30.0, "thickness_m": 16e-6}
    heights_m = (0.12e-3, 0.3e-3)
    return tuple(Coverslip(height_m=m, tilt_rad=tilt_rad, **light) for m in heights_m)


WALLS = {
    **{f"{um} um thick": (um * 1e-6, 1.0e-3, {}) for um in (400, 700, 1000)},
    "lines": (0.7e-3, 1.5e-3, {"lines": LINES}),
    "covers": (0.7e-3, 1.0e-3, {"covers": covers(0.0)}),
    "tilted covers": (0.7e-3, 1.0e-3, {"covers": covers(0.03)}),
    **{f"slope of {deg}": (0.7e-3, 0.0, sloping(deg)) for deg in (-40.0, 20.0, 40.0)},
    **{f"pixel of {um} um": (0.7e-3, 0.0, pixels_of(um)) for um in (5, 10, 20, 30)},
    "optical depth": (0.6e-3, 0.0, {"scanner": OctStudy(refractive_index=1.38)}),
}


@pytest.mark.parametrize("name", WALLS)
def test_a_wall_is_found_with_its_thickness_along_the_normal(name):
    thickness_m, dent_m, shown = WALLS[name]
    drawn = phantom(thickness_m, dent_m, **shown)
    found = find_wall(drawn.frame, PixelScale.of(shown.get("scanner", STUDY.oct)))
    assert found.inner_found
    least, rel = (0.9, 0.07) if "pixel" in name else (0.95, 0.05)
    assert dice(found.mask, drawn.truth_mask) > least
    assert found.thickness_m == pytest.approx(thickness_m, rel=rel)


EYES = {
    "thickness_m": (0.3e-3, 1.2e-3),
    "youngs_modulus_pa": (0.2e6, 0.5e6),
    "gap_m": (0.35e-3, 1e-3),
    "polar_rad": (0.44, 0.78),
    "direction_rad": (-3.1, 3.1),
}


@pytest.mark.slow
def test_phantoms_over_the_range_of_their_parameters_reach_the_dice_that_was_asked_for():
    rng = np.random.default_rng(2)
    reached = list[float]()
    study = replace(STUDY, mesh=replace(STUDY.mesh, divisions=8, level=0))
    for number in range(5):
        drawn = {name: rng.uniform(*ends) for name, ends in EYES.items()}
        eye = changed(Setup(eye=Eye(f"{number}", iop_pa=266.0)), **drawn)
        for section in LinearSections(eye, study)(list(rng.uniform(0.0, 0.06, 8))):
            optics = sample_optics(study.phantom, study.oct, rng)
            placed = sample_pose(study.phantom, rng).place(section)
            shown = render_bscan(placed, study.oct, optics, rng)
            reached.append(dice(find_wall(shown.frame, SCALE).mask, shown.truth_mask))

    assert np.mean(reached) >= 0.95
    assert np.percentile(reached, 5) >= 0.90


@pytest.mark.parametrize("choroid_m", [100e-6, 130e-6, 250e-6])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_wall_ends_where_the_choroid_begins_however_thin_that_is(seed, choroid_m):
    light = {"snr_db": 33.0, "attenuation_per_m": 900.0, "lines": (), "covers": ()}
    choroid = {"choroid_level_db": -8.5, "display_range_db": 40.0}
    thin = {"choroid_thickness_m": choroid_m}
    drawn = phantom(0.76e-3, 0.0, seed, **light, **choroid, **thin)
    found = find_wall(drawn.frame, SCALE)
    truth = drawn.truth_mask > 0
    last = len(truth) - truth[::-1].argmax(axis=0) - 0.5
    seen = truth.any(axis=0) & np.isfinite(found.inner_row) & (last < len(truth) - 10)
    off_m = np.abs(found.inner_row - last)[seen] * SCALE.depth_m
    assert found.thickness_m == pytest.approx(0.76e-3, rel=0.02)
    assert np.mean(off_m > 60e-6) < 0.02


def test_black_bands_show_no_wall_and_missing_columns_are_bridged(bscan):
    found = find_wall(bscan.frame, SCALE)
    frame = bscan.frame.copy()
    band = ~frame.any(axis=0)
    assert band.sum() > 20
    assert not found.mask[:, band].any()
    assert np.isnan(found.outer_row[band]).all()
    frame[:, 150:180] = 0
    frame[:, [60, 220, 300, 301, 410]] = 0
    assert dice(find_wall(frame, SCALE).mask, bscan.truth_mask) > 0.95


def test_iris_and_lens_below_the_wall_are_not_wall(bscan):
    frame = bscan.frame.copy()
    plain = find_wall(bscan.frame, SCALE)
    frame[430:480, 40:470] = np.random.default_rng(0).integers(1500, 4000, (50, 430))
    assert np.nanmax(np.abs(find_wall(frame, SCALE).outer_row - plain.outer_row)) < 3.0


def test_a_dent_that_leaves_the_window_leaves_a_gap():
    drawn = phantom(0.5e-3, 5.0e-3, width_m=1.8e-3)
    found = find_wall(drawn.frame, SCALE)
    assert found.usable
    assert not drawn.truth_mask[:, 250:262].any()
    assert np.isnan(found.outer_row[250:262]).all()
    assert dice(found.mask, drawn.truth_mask) > 0.93


def test_where_the_inner_boundary_cannot_be_seen_the_mask_ends_one_millimetre_below():
    endless = phantom(2.5e-3, 0.0, attenuation_per_m=900.0)
    found = find_wall(endless.frame, SCALE)
    assert (found.usable, found.inner_found) == (True, False)
    assert np.isnan(found.thickness_m)
    depth_m = (found.inner_row - found.outer_row) * SCALE.depth_m
    np.testing.assert_allclose(depth_m[np.isfinite(depth_m)], 1e-3, rtol=1e-6)


CORNER = np.triu(np.ones((512, 512), bool)) & (np.arange(512) < 200)[:, None]
RNG = np.random.default_rng(0)


@pytest.mark.parametrize(
    ("frame", "reason"),
    [
        (np.zeros((512, 512), np.uint16), "empty"),
        (np.full((512, 512), 900, np.uint16), "empty"),
        (np.where(CORNER, 2095, 4095).astype(np.uint16), "saturated"),
        (RNG.integers(0, 900, (512, 512)).astype(np.uint16), "signal is too weak"),
        (RNG.integers(0, 200, (300, 400)).astype(np.uint8), "signal is too weak"),
    ],
)
def test_a_frame_without_a_wall_is_not_usable_and_says_why(frame, reason):
    found = find_wall(frame, SCALE)
    assert not found.usable
    assert reason in found.reason


def test_too_little_of_the_window_is_not_usable(bscan):
    frame = bscan.frame.copy()
    noise = frame[380:400, 100:400].ravel()
    frame[:, 140:490] = np.random.default_rng(0).choice(noise, (512, 350))
    found = find_wall(frame, SCALE)
    assert not found.usable
    assert "covers" in found.reason


@pytest.mark.parametrize(
    "frame",
    [
        np.zeros((20, 20, 3), np.uint8),
        np.zeros((20, 20)),
        np.zeros((8, 200), np.uint8),
    ],
)
def test_other_arrays_are_refused(frame):
    with pytest.raises(ValueError, match="frame of"):
        find_wall(frame, SCALE)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"lateral_m": 0.0}, "metres"),
        ({"refractive_index": 2.5}, r"index of 2\.5: tissue lies between 1"),
    ],
)
def test_impossible_scales_are_refused(values, words):
    with pytest.raises(ValueError, match=words):
        PixelScale(**{"lateral_m": 1e-6, "depth_m": 1e-6} | values)


@pytest.mark.real
@needs_shared
@pytest.mark.parametrize(
    "path",
    sorted((SHARED / "real-oct" / "tissue-surface").glob("*.tif")),
    ids=lambda path: path.stem,
)
def test_tissue_surfaces_of_a_foreign_scanner_meet_the_bar_of_their_makers(path: Path):
    with tifffile.TiffFile(path) as file:
        frame = file.pages[0].asarray()
        axes = json.loads(file.pages[0].tags["Software"].value)["metadata"]

    lateral_m, depth_m = (
        abs(np.diff(axes[axis]["values"][:2])[0]) / 1e3 for axis in "xz"
    )
    mask = path.with_name(f"{path.stem}_mask.png")
    above = cv2.imread(str(mask), cv2.IMREAD_UNCHANGED) == 255
    surface = len(above) - 1 - above[::-1].argmax(axis=0)
    found = find_wall(frame, PixelScale(lateral_m=lateral_m, depth_m=depth_m))
    error = np.abs(found.outer_row - surface)[above.any(axis=0)]
    assert np.isnan(error).mean() < 0.10
    assert np.nanmean(error) < 10.0
    assert np.nanpercentile(error, 90) < 40.0


@pytest.mark.real
@needs_shared
@pytest.mark.parametrize(("name", "um"), [("sample-a", 720), ("sample-b", 570)])
def test_every_frame_of_the_sample_recordings_shows_a_wall_of_one_thickness(name, um):
    for path in sorted((SHARED / "recordings" / name / "frames").glob("*.png")):
        found = find_wall(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), SCALE)
        assert found.usable, path
        assert found.inner_found, path
        assert found.thickness_m * 1e6 == pytest.approx(um, rel=0.06), path
