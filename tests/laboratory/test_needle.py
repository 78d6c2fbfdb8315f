"""The needle that is drawn into a B-scan: where it lies, what it hides, and that it changes nothing where it is not."""

from dataclasses import replace
from math import pi, radians, tan

import numpy as np
import pytest
from analytic_frames import STEEL

from scleraforce.laboratory.bscan import draw_shaft, render_bscan
from scleraforce.laboratory.light import NeedleShaft, Pose, sample_optics
from scleraforce.laboratory.phantom import needle_tip, plan_phantom, render_frame
from scleraforce.laboratory.virtual_eye import PhantomEye
from scleraforce.mechanics.contact import Section
from scleraforce.study import OctStudy, Study, fixed

OCT = OctStudy()
DEPTH_M, LATERAL_M = OCT.depth_m / OCT.rows, OCT.width_m / OCT.columns
TIP_M = np.array([0.2e-3, 2e-3])
EYE = PhantomEye(
    id="eye", thickness_m=0.6e-3, youngs_modulus_pa=0.3e6, iop_pa=266.0, gap_m=0.05e-3, polar_rad=radians(35.0)
)
# Mean counts of bands of 64 rows; single counts are rounded otherwise by other processors.
BEFORE = [
    [868.323, 2806.102, 838.279, 459.913, 456.422, 460.023, 456.789, 459.12],
    [1092.613, 1623.599, 472.971, 457.971, 457.191, 458.58, 458.477, 457.5],
]


def width_m(shaft: NeedleShaft, row: int = 128) -> float:
    """The shaft's width along the columns, from the area of 40 rows: finer than a column."""
    inside = draw_shaft(shaft, TIP_M, 0.0, replace(OCT, columns=8192)).inside[row : row + 40]
    return float(inside.sum()) / 40 * OCT.width_m / 8192


@pytest.mark.parametrize("gap_m", [0.0, 0.1e-3, 0.24e-3])
def test_a_plane_beside_the_axis_cuts_the_chord_of_the_cylinder(gap_m: float) -> None:
    chord_m = 2.0 * np.sqrt(0.25e-3**2 - gap_m**2)
    assert width_m(replace(STEEL, gap_m=gap_m)) == pytest.approx(chord_m, abs=5e-6)


def test_a_plane_beyond_the_radius_meets_no_needle() -> None:
    shaft = draw_shaft(replace(STEEL, gap_m=0.26e-3), TIP_M, 0.0, OCT)
    assert not shaft.inside.any()
    assert (shaft.light == 1.0).all()


def test_a_shaft_leans_by_its_angle_off_the_surfaces_normal() -> None:
    angle_rad, tilt_rad = radians(30.0), radians(5.0)
    inside = draw_shaft(replace(STEEL, angle_rad=angle_rad), TIP_M, tilt_rad, OCT).inside
    column = np.arange(OCT.columns)
    middle = [float(column[inside[row]].mean()) for row in (60, 180)]
    assert (middle[0] - middle[1]) * LATERAL_M == pytest.approx(120 * DEPTH_M * tan(angle_rad - tilt_rad), rel=0.05)


def test_a_shaft_ends_at_its_tip_and_a_bevel_is_pointed() -> None:
    straight, bevelled = (
        draw_shaft(replace(STEEL, angle_rad=0.2, bevel_rad=bevel), TIP_M, 0.0, OCT).inside for bevel in (pi / 2, 0.4)
    )
    for inside in (straight, bevelled):
        last = np.flatnonzero(inside.any(axis=1))[-1]
        assert (last + 0.5) * DEPTH_M == pytest.approx(TIP_M[1], abs=0.06e-3)
    row = int(1.8e-3 / DEPTH_M)
    assert bevelled[row].sum() < 0.6 * straight[row].sum()


def test_below_steel_there_is_no_light_and_below_glass_a_part() -> None:
    column, below = int((TIP_M[0] + OCT.width_m / 2) / LATERAL_M), int(3e-3 / DEPTH_M)
    for loss in (1.0, 0.4):
        light = draw_shaft(replace(STEEL, loss_fraction=loss), TIP_M, 0.0, OCT).light
        assert light[below, column] == pytest.approx(1.0 - loss)
        assert light[below, column + 40] == 1.0


def test_a_shaft_above_the_frame_takes_light_as_far_up_as_it_reaches() -> None:
    dark = {
        above_m: (draw_shaft(replace(STEEL, angle_rad=0.7, above_m=above_m), TIP_M, 0.0, OCT).light[-1] < 1.0).sum()
        for above_m in (0.0, 1e-3)
    }
    assert (dark[1e-3] - dark[0.0]) * LATERAL_M == pytest.approx(1e-3 * tan(0.7), abs=2 * LATERAL_M)


def flat_wall() -> Section:
    lateral = np.linspace(-9e-3, 9e-3, 201)
    outer = np.stack([lateral, np.zeros_like(lateral)], axis=1)
    return Section(outer, outer + np.array([0.0, 0.6e-3]))


def test_frames_without_a_needle_are_those_of_before() -> None:
    """The means are those of the frames that the code drew before it knew needles."""
    plan = plan_phantom(EYE, (0.004, 0.02), Study(), 3)
    frames = [render_frame(frame, flat_wall(), Study()).frame for frame in plan.frames]
    means = np.mean(np.reshape(frames, (2, 8, 64, 512)), axis=(2, 3))
    np.testing.assert_allclose(means, BEFORE, rtol=0, atol=2e-3)
    assert all(frame.optics.needle is None for frame in plan.frames)


def test_a_needle_is_one_in_a_recording_and_leaves_every_other_number_as_it_was() -> None:
    study = replace(Study(), phantom=replace(Study().phantom, needle_count=fixed(1)))
    with_needle, without = (plan_phantom(EYE, (0.004, 0.02), each, 3) for each in (study, Study()))
    needles = {frame.optics.needle for frame in with_needle.frames}
    assert len(needles) == 1
    assert needles.pop().gap_m == EYE.gap_m
    assert [replace(frame.optics, needle=None) for frame in with_needle.frames] == [f.optics for f in without.frames]
    section = flat_wall()
    frame = with_needle.frames[0]
    assert needle_tip(frame, section) == pytest.approx((frame.pose.lateral_m, frame.pose.depth_m))
    assert (render_frame(frame, section, study).frame != render_frame(without.frames[0], section, study).frame).any()


def test_the_shadow_of_a_steel_needle_is_as_dark_as_the_noise() -> None:
    rng = np.random.default_rng(0)
    optics = replace(sample_optics(Study().phantom, OCT, rng), shadows=(), snr_db=30.0, reflection_db=20.0)
    pose = Pose(lateral_m=0.0, depth_m=2e-3)
    shaft = draw_shaft(replace(STEEL, diameter_m=0.7e-3), np.array([0.0, 2e-3]), 0.0, OCT)
    frame = render_bscan(pose.place(flat_wall()), OCT, optics, rng, shaft).frame.astype(float)
    wall, above, middle = slice(265, 320), slice(150, 240), slice(251, 261)
    assert frame[wall, middle].mean() == pytest.approx(frame[above, 100:200].mean(), rel=0.05)
    assert frame[wall, 100:200].mean() > 2.0 * frame[wall, middle].mean()
    surface = slice(253, 260)  # the mirror reflection is in the shadow, too
    assert frame[surface, middle].max() < 0.8 * frame[surface, 100:200].max(axis=0).mean()
