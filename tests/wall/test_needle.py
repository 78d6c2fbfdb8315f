"""The needle in a frame: found with its angle and tip, what it hides left out, and
nothing else taken for one.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import radians

import cv2
import numpy as np
import pytest
from analytic_frames import SHARED, STEEL, needs_shared

from dented_walls import dented_wall
from scleraforce.lab.drawn_bscan import draw_shaft, render_bscan
from scleraforce.lab.tissue_light import (
    BscanOptics,
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
from scleraforce.wall.needle_in_frame import needle_entry
from scleraforce.wall.wall import draw_overlay

OCT = OctStudy()
SCALE = PixelScale.of(OCT)
POSE = Pose(lateral_m=0.2e-3, depth_m=0.5e-3)
GAUGES_M = {22: 0.7e-3, 25: 0.5e-3, 30: 0.3e-3, 34: 0.18e-3}


def optics(seed: int = 0, **own: object) -> BscanOptics:
    drawn = sample_optics(Study().phantom, OCT, np.random.default_rng(seed))
    return replace(drawn, **({"snr_db": 25.0, "shadows": ()} | own))


def frame_of(
    shaft: NeedleShaft | None,
    dent_m: float = 1.0e-3,
    seed: int = 0,
    lift_m: float = 0.0,
    **own: object,
):
    """A frame of a wall, its contact at 0.2 mm beside the middle and 0.5 mm deep, and
    where the needle's tip is.
    """
    section = POSE.place(dented_wall(0.7e-3, dent_m, 1.2e-3, points=1501))
    tip_m = np.array([0.2e-3, 0.5e-3 + dent_m - lift_m])
    drawn = None if shaft is None else draw_shaft(shaft, tip_m, 0.0, OCT)
    rng = np.random.default_rng(seed)
    return render_bscan(section, OCT, optics(seed, **own), rng, drawn).frame, tip_m


def surface_error_m(outer_row: np.ndarray, dent_m: float) -> np.ndarray:
    """Return the depth of a found surface below the one of `frame_of`, (column,), m."""
    placed = POSE.place(dented_wall(0.7e-3, dent_m, 1.2e-3, points=1501)).outer
    lateral_m = (np.arange(OCT.columns) + 0.5) * SCALE.lateral_m - OCT.width_m / 2
    return (outer_row + 0.5) * SCALE.depth_m - np.interp(lateral_m, *placed.T)


@pytest.mark.parametrize("gauge", GAUGES_M)
@pytest.mark.parametrize("angle_deg", [-45.0, -20.0, 0.0, 10.0, 30.0])
def test_a_needle_is_found_with_its_angle_and_its_tip(
    gauge: int, angle_deg: float
) -> None:
    shaft = replace(STEEL, diameter_m=GAUGES_M[gauge], angle_rad=radians(angle_deg))
    frame, tip_m = frame_of(shaft, seed=gauge)
    needle = find_wall(frame, SCALE).needle
    assert needle.angle_rad == pytest.approx(radians(angle_deg), abs=radians(3.0))
    assert needle.tip_m == pytest.approx(tip_m, abs=0.35e-3)


@pytest.mark.parametrize(
    ("angle_deg", "out_deg"), [(0.0, 12.0), (12.0, -12.0), (-8.0, 12.0)]
)
def test_the_axis_is_midway_between_two_sides_which_converge_where_the_shaft_leaves_the_plane(
    angle_deg: float, out_deg: float
) -> None:
    both = replace(STEEL, diameter_m=0.7e-3, far_edge_db=0.0)
    shaft = replace(both, angle_rad=radians(angle_deg), lean_rad=radians(out_deg))
    needle = find_wall(frame_of(shaft, 0.4e-3, seed=1)[0], SCALE).needle
    assert needle.axis_rad == pytest.approx(radians(angle_deg), abs=radians(1.5))
    assert abs(needle.angle_rad - radians(angle_deg)) > radians(2.0)  # of one side


def test_a_bevel_in_a_shallow_frame_does_not_tell_the_axis_and_a_long_side_does():
    bevelled = replace(
        STEEL,
        diameter_m=0.7e-3,
        bevel_rad=radians(20.0),
        angle_rad=radians(3.0),
        far_edge_db=0.0,
    )
    assert (
        find_wall(frame_of(bevelled, 0.8e-3, seed=2)[0], SCALE).needle.axis_rad is None
    )
    deep = find_wall(frame_of(bevelled, 2.8e-3, seed=2)[0], SCALE).needle
    assert deep.axis_rad == pytest.approx(radians(3.0), abs=radians(2.5))


@pytest.mark.parametrize("dent_m", [3.2e-3, 4.2e-3])
def test_a_tip_below_the_frame_has_no_place(dent_m: float) -> None:
    frame, tip_m = frame_of(replace(STEEL, angle_rad=radians(10.0)), dent_m)
    needle = find_wall(frame, SCALE).needle
    entry = needle_entry(needle)
    assert entry["angle_deg"] == pytest.approx(10.0, abs=3.0)

    if tip_m[1] > OCT.depth_m:
        assert needle.tip_m is entry["tip_mm"] is None
    else:
        assert needle.tip_m == pytest.approx(tip_m, abs=0.35e-3)


@pytest.mark.parametrize(
    "shaft", [STEEL, replace(STEEL, loss_fraction=0.5), replace(STEEL, bevel_rad=0.4)]
)
@pytest.mark.parametrize("dent_m", [0.05e-3, 1.0e-3, 2.0e-3])
def test_the_wall_is_found_on_both_sides_of_a_needle_and_nothing_behind_it(
    shaft: NeedleShaft, dent_m: float
) -> None:
    frame, _ = frame_of(replace(shaft, angle_rad=radians(-15.0)), dent_m, seed=3)
    found = find_wall(frame, SCALE)
    assert found.usable
    first, after = found.needle.hidden
    assert np.isnan(found.outer_row[first:after]).all()
    assert not found.mask[:, first:after].any()
    off_m = surface_error_m(found.outer_row, dent_m)

    for side in (off_m[first - 60 : first], off_m[after : after + 60]):
        assert np.isfinite(side).mean() > 0.95
        assert np.nanquantile(np.abs(side), 0.9) < 40e-6


BESIDE = 24  # columns


@pytest.mark.parametrize("dent_m", [0.05e-3, 1.0e-3])
def test_right_beside_a_needle_the_wall_ends_where_it_would_without_one_and_a_steep_dent_is_not_smoothed(
    dent_m: float,
) -> None:
    without = find_wall(frame_of(None, dent_m, seed=3)[0], SCALE)
    worst = []

    for diameter_m in (0.3e-3, 0.7e-3):
        found = find_wall(
            frame_of(replace(STEEL, diameter_m=diameter_m), dent_m, seed=3)[0], SCALE
        )
        first, after = found.needle.hidden
        beside = slice(first - BESIDE, first), slice(after, after + BESIDE)
        off = np.abs(found.inner_row - without.inner_row)
        off_m = np.abs(surface_error_m(found.outer_row, dent_m))
        assert max(np.nanmax(off[side]) for side in beside) < 4.0
        worst += [np.nanmax(off_m[side]) for side in beside]

    # 24 um where both flanks are smoothed into each other
    assert dent_m < 1.0e-3 or np.mean(worst) < 18e-6


def not_needles() -> Iterator[tuple[str, dict[str, object]]]:
    yield "nothing", {}
    yield "mirror reflection", {"reflection_db": 30.0, "reflection_angle_rad": 0.2}
    yield (
        "vessels",
        {"shadows": (Shadow(centre_m=0.2e-3, width_m=0.5e-3, loss_fraction=0.9),)},
    )
    yield (
        "shadow alone",
        {"shadows": (Shadow(centre_m=0.2e-3, width_m=0.5e-3, loss_fraction=1.0),)},
    )
    yield (
        "lines",
        {
            "lines": tuple(
                ReflectionLine(depth_m=d, level_db=25.0, thickness_m=20e-6)
                for d in (5e-5, 1e-4, 2e-4)
            )
        },
    )
    covers = tuple(
        Coverslip(
            height_m=0.3e-3, level_db=30.0, thickness_m=20e-6, tilt_rad=radians(tilt)
        )
        for tilt in (-8.0, 5.0)
    )
    yield "coverslips", {"covers": covers}


@pytest.mark.parametrize(("name", "own"), list(not_needles()))
@pytest.mark.parametrize("dent_m", [0.0, 1.0e-3])
def test_nothing_else_is_taken_for_a_needle(
    name: str, own: dict[str, object], dent_m: float
) -> None:
    for seed in range(4):
        frame, _ = frame_of(None, dent_m, seed, **own)
        assert find_wall(frame, SCALE).needle is None, name


def test_a_flare_through_the_tissue_and_a_hair_that_casts_no_shadow_are_not_needles():
    frame, _ = frame_of(None, 0.0)
    flare = frame.copy()
    flare[:, 255:264] = np.maximum(flare[:, 255:264], 3000)
    hair = frame.copy()
    cv2.line(hair, (240, 0), (262, 60), 3500, 2)

    for picture in (flare, hair):
        assert find_wall(picture, SCALE).needle is None


def test_a_line_whose_light_continues_below_the_tissue_is_a_flare() -> None:
    frame, tip_m = frame_of(STEEL, 0.05e-3, seed=5)
    column = round((tip_m[0] + OCT.width_m / 2) / SCALE.lateral_m)
    under = round(tip_m[1] / SCALE.depth_m)
    assert find_wall(frame, SCALE).needle is not None
    begin = under + round(1.0e-3 / SCALE.depth_m)

    for end, seen in (
        (len(frame), False),
        (len(frame) * 3 // 4, True),
    ):
        # a flare does not fade on its way down
        streak = frame.astype(np.int64)
        streak[begin:end, column - 8 : column + 9] += 200
        needle = find_wall(np.clip(streak, 0, 4095).astype(np.uint16), SCALE).needle
        assert (needle is not None) == seen


@needs_shared
@pytest.mark.real
@pytest.mark.parametrize("lateral_um", [8, 12, 16, 20, 31])
def test_the_flare_of_a_real_eye_at_rest_is_not_a_needle(lateral_um: int) -> None:
    path = SHARED / "real-oct" / "dicom" / "anterior-segment.dcm"
    pixels = open_frame(
        recorded_file(path),
        Scan(width_m=15e-3, depth_m=4e-3, refractive_index=1.0),
        Scan(),
        "assumed",
    ).pixels

    for depth_um in (4, 6, 8, lateral_um):
        assert (
            find_wall(
                pixels, PixelScale(lateral_m=1e-6 * lateral_um, depth_m=1e-6 * depth_um)
            ).needle
            is None
        )


def test_the_hidden_wall_does_not_count_as_seen() -> None:
    frame, _ = frame_of(replace(STEEL, diameter_m=1.0e-3), 0.05e-3, seed=3)
    first, after = find_wall(frame, SCALE).needle.hidden
    least = round(0.4 * OCT.columns)  # must show the wall
    beside = (
        least - (after - first) // 2
    ) // 2  # with half of the hidden columns it would be enough
    noise = np.random.default_rng(0).permuted(frame[:40, 60:100].ravel())

    for column in (*range(first - beside), *range(after + beside, OCT.columns)):
        if frame[:, column].any():
            frame[:, column] = np.resize(np.roll(noise, 37 * column), OCT.rows)

    found = find_wall(frame, SCALE)
    assert (found.needle is not None, found.usable) == (True, False)
    assert "of the imaged width, not 40%" in found.reason


def test_an_overlay_shows_the_shaft_in_purple() -> None:
    frame, _ = frame_of(replace(STEEL, angle_rad=radians(-15.0)))
    found = find_wall(frame, SCALE)
    with_shaft, without = (
        draw_overlay(frame, each).astype(int)
        for each in (found, replace(found, needle=None))
    )
    changed = (with_shaft != without).any(axis=2)
    assert np.count_nonzero(changed) > 50
    blue, green, red = (with_shaft - without)[changed].mean(axis=0)
    assert min(blue, red) > green + 20.0


@pytest.mark.real
@needs_shared
def test_a_needle_is_found_in_the_recording_of_one_and_in_none_of_the_others() -> None:
    for name in "abcde":
        for path in sorted(
            (SHARED / "recordings" / f"sample-{name}" / "frames").glob("*.png")
        ):
            pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert (find_wall(pixels, SCALE).needle is not None) == (name == "d"), path


@pytest.mark.real
@needs_shared
def test_a_needle_without_tissue_is_never_usable() -> None:
    scale = PixelScale(lateral_m=3e-3 / 64, depth_m=3e-3 / 512)
    for path in sorted((SHARED / "real-oct" / "needle-volumes").glob("*.npz")):
        with np.load(path) as kept:
            volume = kept["data"]
        for scan in (*volume.swapaxes(0, 1)[::4], *volume.transpose(2, 0, 1)[::4]):
            assert not find_wall(np.ascontiguousarray(scan), scale).usable, path
