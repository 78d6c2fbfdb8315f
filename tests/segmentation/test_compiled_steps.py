"""The loops find what the oracle by NumPy and OpenCV finds, in every kind of frame."""

from collections.abc import Iterator
from dataclasses import replace
from math import radians

import numpy as np
import pytest
import wall_arrays
from analytic_frames import STEEL
from hypothesis import example, given, settings, strategies as st

from dented_walls import dented_wall
from scleraforce.laboratory.bscan import draw_shaft, render_bscan
from scleraforce.laboratory.light import Pose, sample_conjunctiva, sample_optics, sample_pose
from scleraforce.mechanics.contact import Section
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.found import Segmentation
from scleraforce.segmentation.wall import find_first_wall
from scleraforce.study import OctStudy, Study, fixed

STUDY = Study()
SCALE = PixelScale.of(STUDY.oct)
NOISE = "the signal is too weak"
ROWS = 1e-3  # that boundaries may differ by: sums of products are rounded another way


def draw_frames(count: int) -> list[Pixels]:
    """Return frames of spherical walls with dents of 0 to 3 mm."""
    rng = np.random.default_rng(0)
    lateral = np.linspace(-8.5e-3, 8.5e-3, 800)
    frames = []
    for dent_m in np.linspace(0.0, 3e-3, count):
        depth = 12e-3 - np.sqrt(12e-3**2 - lateral**2) + dent_m * np.exp(-(lateral**2) / (2 * 1.6e-3**2))
        outer = np.stack([lateral, depth], axis=1)
        section = Section(outer, outer + np.array([0.0, rng.uniform(0.4e-3, 0.9e-3)]))
        optics = sample_optics(STUDY.phantom, STUDY.oct, rng)
        frames.append(render_bscan(sample_pose(STUDY.phantom, rng).place(section), STUDY.oct, optics, rng).frame)
    return frames


def assert_alike(found: Segmentation, oracle: Segmentation) -> None:
    assert found.reason == oracle.reason
    assert (found.usable, found.inner_found, found.needle) == (oracle.usable, oracle.inner_found, oracle.needle)
    if found.reason.startswith(NOISE):
        return  # two paths through noise may be as good as each other, and rounding decides
    np.testing.assert_allclose(found.outer_row, oracle.outer_row, rtol=0.0, atol=ROWS)
    np.testing.assert_allclose(found.inner_row, oracle.inner_row, rtol=0.0, atol=ROWS)
    np.testing.assert_allclose(found.thickness_m, oracle.thickness_m, rtol=1e-5)


def check(frame: Pixels, scale: PixelScale = SCALE) -> Segmentation:
    """Compare with the oracle."""
    oracle = wall_arrays.find_wall(frame, scale)
    assert_alike(find_first_wall(frame, scale), oracle)
    return oracle


@pytest.mark.slow
def test_phantom_frames() -> None:
    for frame in draw_frames(24):
        assert check(frame).usable


def test_frames_of_bytes() -> None:
    for frame in draw_frames(6):
        check((frame >> 4).astype(np.uint8))


@pytest.mark.parametrize("angle_deg", [-35.0, 0.0, 20.0])
def test_frames_with_a_needle(angle_deg: float) -> None:
    shaft = replace(STEEL, diameter_m=0.3e-3, angle_rad=radians(angle_deg))
    rng = np.random.default_rng(0)
    drawn = replace(sample_optics(STUDY.phantom, STUDY.oct, rng), snr_db=25.0, shadows=())
    needle = draw_shaft(shaft, np.array([0.2e-3, 1.5e-3]), 0.0, STUDY.oct)
    placed = Pose(lateral_m=0.2e-3, depth_m=0.5e-3).place(dented_wall(0.7e-3, 1.0e-3, 1.2e-3))
    assert check(render_bscan(placed, STUDY.oct, drawn, rng, needle).frame).needle


def test_frames_with_a_conjunctiva() -> None:
    phantom = replace(STUDY.phantom, conjunctiva_thickness_m=fixed(150e-6))
    for seed in range(3):
        rng = np.random.default_rng(seed)
        over = sample_conjunctiva(phantom, rng)
        optics = replace(sample_optics(STUDY.phantom, STUDY.oct, rng), conjunctiva=over)
        placed = Pose(lateral_m=0.0, depth_m=0.5e-3).place(dented_wall(0.6e-3, 1.0e-3))
        check(render_bscan(placed, STUDY.oct, optics, rng).frame)


@pytest.mark.parametrize(("rows", "columns"), [(512, 512), (300, 700), (1024, 64), (400, 191), (383, 192), (777, 1001)])
def test_another_scanner(rows: int, columns: int) -> None:
    scanner = OctStudy(width_m=9e-3, depth_m=5e-3, rows=rows, columns=columns, refractive_index=1.38)
    rng = np.random.default_rng(1)
    placed = Pose(lateral_m=0.0, depth_m=0.9e-3).place(dented_wall(0.7e-3, 0.8e-3))
    frame = render_bscan(placed, scanner, sample_optics(STUDY.phantom, scanner, rng), rng).frame
    check(frame, PixelScale.of(scanner))


def hostile_frames() -> Iterator[Pixels]:
    rng, frame = np.random.default_rng(0), draw_frames(2)[1]
    yield np.zeros((512, 512), np.uint16)
    yield np.full((512, 512), 65535, np.uint16)
    yield np.minimum(frame.astype(np.uint32) * 40, 65535).astype(np.uint16)
    yield rng.integers(0, 900, (512, 512)).astype(np.uint16)
    yield rng.integers(0, 65536, (16, 16)).astype(np.uint16)
    yield np.where(np.arange(512) == 200, 4000, 0).astype(np.uint16) + np.zeros((512, 1), np.uint16)  # one column
    yield np.where(np.arange(512) % 9 == 4, 0, frame).astype(np.uint16)  # missing columns
    yield np.where(np.arange(512) < 111, 0, frame).astype(np.uint16)  # a black band
    yield np.asfortranarray(frame)
    yield frame[::-1]
    yield frame[:, ::2]


def test_hostile_frames() -> None:
    for frame in hostile_frames():
        check(frame)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@example(seed=166, rows=87, columns=229, layers=0)
@example(seed=196, rows=365, columns=123, layers=1)
@example(seed=278, rows=365, columns=123, layers=1)
@given(
    seed=st.integers(0, 2**32 - 1), rows=st.integers(16, 420), columns=st.integers(16, 420), layers=st.integers(0, 4)
)
def test_random_images(seed: int, rows: int, columns: int, layers: int) -> None:
    rng = np.random.default_rng(seed)
    frame = rng.integers(0, 400, (rows, columns))
    for _ in range(layers):
        top = int(rng.integers(0, rows))
        frame[top : top + int(rng.integers(1, rows))] += int(rng.integers(0, 8000))
    check(frame.astype(np.uint16))


def test_frames_of_changing_size_leave_nothing_behind() -> None:
    frame = draw_frames(1)[0]
    first = check(frame)
    for columns in range(300, 340):
        find_first_wall(frame[:, :columns], SCALE)
    assert_alike(find_first_wall(frame, SCALE), first)
