"""The compiled steps find what those of NumPy and OpenCV find, in every kind of frame."""

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from math import radians

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from shafts import STEEL

from bench_segmentation import draw_frames
from dented_walls import dented_wall
from scleraforce.compiled import SWITCH, can_compile
from scleraforce.laboratory.bscan import draw_shaft, render_bscan
from scleraforce.laboratory.light import Pose, sample_conjunctiva, sample_optics
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation import surface
from scleraforce.segmentation.numpy_steps import NumpySteps
from scleraforce.segmentation.steps import Segmentation, Steps
from scleraforce.segmentation.wall import find_wall_by
from scleraforce.study import OctStudy, Study
from scleraforce.study.fields import fixed

STUDY = Study()
SCALE = PixelScale.of(STUDY.oct)
NOISE = "the signal is too weak"
ROWS = 1e-3  # that boundaries may differ by: sums of products are rounded another way

PLAIN = """
import numpy as np
from scleraforce.compiled import can_compile
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.compiled_steps import CompiledSteps
from scleraforce.segmentation.numpy_steps import NumpySteps
from scleraforce.segmentation.compiling import compile_wall
from scleraforce.segmentation.wall import find_wall_by
assert not can_compile() and not compile_wall()
rng, scale = np.random.default_rng(0), PixelScale(lateral_m=60e-6, depth_m=15e-6)
frame = rng.integers(0, 400, (90, 200)).astype(np.uint16)
frame[30:70] += 1500
steps = CompiledSteps()
for one in (frame, frame, np.where(np.arange(200) % 50 < 3, 0, frame).astype(np.uint16), np.zeros_like(frame)):
    plain, oracle = find_wall_by(steps, one, scale), find_wall_by(NumpySteps(), one, scale)
    assert plain.reason == oracle.reason
    np.testing.assert_allclose(plain.outer_row, oracle.outer_row, atol=1e-3)
    np.testing.assert_allclose(plain.inner_row, oracle.inner_row, atol=1e-3)
"""


@pytest.mark.slow
def test_without_numba_the_loops_are_plain_functions_that_find_the_same() -> None:
    """In a process that is told not to compile, as in one that has no Numba."""
    without = {**os.environ, SWITCH: "0"}
    done = subprocess.run([sys.executable, "-c", PLAIN], env=without, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def compiled_steps() -> Steps:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(SWITCH, "1")
        from scleraforce.segmentation.compiled_steps import CompiledSteps

        assert can_compile()
    return CompiledSteps()


def assert_alike(found: Segmentation, oracle: Segmentation) -> None:
    assert found.reason == oracle.reason
    assert (found.usable, found.inner_found, found.needle) == (oracle.usable, oracle.inner_found, oracle.needle)
    if found.reason.startswith(NOISE):
        return  # two paths through noise may be as good as each other, and rounding decides
    np.testing.assert_allclose(found.outer_row, oracle.outer_row, rtol=0.0, atol=ROWS)
    np.testing.assert_allclose(found.inner_row, oracle.inner_row, rtol=0.0, atol=ROWS)
    np.testing.assert_allclose(found.thickness_m, oracle.thickness_m, rtol=1e-5)


def check(steps: Steps, frame: Pixels, scale: PixelScale = SCALE) -> Segmentation:
    """Compare both ways, twice: the second time all steps are taken at once."""
    oracle = find_wall_by(NumpySteps(), frame, scale)
    for _ in range(2):
        assert_alike(find_wall_by(steps, frame, scale), oracle)
    return oracle


@pytest.mark.slow
def test_phantom_frames(compiled_steps: Steps) -> None:
    for frame in draw_frames(24):
        assert check(compiled_steps, frame).usable


@pytest.mark.slow
def test_frames_of_bytes(compiled_steps: Steps) -> None:
    for frame in draw_frames(6):
        check(compiled_steps, (frame >> 4).astype(np.uint8))


@pytest.mark.slow
@pytest.mark.parametrize("angle_deg", [-35.0, 0.0, 20.0])
def test_frames_with_a_needle(compiled_steps: Steps, angle_deg: float) -> None:
    shaft = replace(STEEL, diameter_m=0.3e-3, angle_rad=radians(angle_deg))
    rng = np.random.default_rng(0)
    drawn = replace(sample_optics(STUDY.phantom, STUDY.oct, rng), snr_db=25.0, shadows=())
    needle = draw_shaft(shaft, np.array([0.2e-3, 1.5e-3]), 0.0, STUDY.oct)
    placed = Pose(lateral_m=0.2e-3, depth_m=0.5e-3).place(dented_wall(0.7e-3, 1.0e-3, 1.2e-3))
    assert check(compiled_steps, render_bscan(placed, STUDY.oct, drawn, rng, needle).frame).needle


@pytest.mark.slow
def test_frames_with_a_conjunctiva(compiled_steps: Steps) -> None:
    phantom = replace(STUDY.phantom, conjunctiva_thickness_m=fixed(150e-6))
    for seed in range(3):
        rng = np.random.default_rng(seed)
        over = sample_conjunctiva(phantom, rng)
        optics = replace(sample_optics(STUDY.phantom, STUDY.oct, rng), conjunctiva=over)
        placed = Pose(lateral_m=0.0, depth_m=0.5e-3).place(dented_wall(0.6e-3, 1.0e-3))
        check(compiled_steps, render_bscan(placed, STUDY.oct, optics, rng).frame)


@pytest.mark.slow
@pytest.mark.parametrize(("rows", "columns"), [(512, 512), (300, 700), (1024, 64), (400, 191), (383, 192), (777, 1001)])
def test_another_scanner(compiled_steps: Steps, rows: int, columns: int) -> None:
    scanner = OctStudy(width_m=9e-3, depth_m=5e-3, rows=rows, columns=columns, refractive_index=1.38)
    rng = np.random.default_rng(1)
    placed = Pose(lateral_m=0.0, depth_m=0.9e-3).place(dented_wall(0.7e-3, 0.8e-3))
    frame = render_bscan(placed, scanner, sample_optics(STUDY.phantom, scanner, rng), rng).frame
    check(compiled_steps, frame, PixelScale.of(scanner))


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


@pytest.mark.slow
def test_hostile_frames(compiled_steps: Steps) -> None:
    for frame in hostile_frames():
        check(compiled_steps, frame)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@example(seed=166, rows=87, columns=229, layers=0)
@example(seed=196, rows=365, columns=123, layers=1)
@example(seed=278, rows=365, columns=123, layers=1)
@given(
    seed=st.integers(0, 2**32 - 1), rows=st.integers(16, 420), columns=st.integers(16, 420), layers=st.integers(0, 4)
)
def test_random_images(compiled_steps: Steps, seed: int, rows: int, columns: int, layers: int) -> None:
    """The oracle fits its edges in double, as the loops do: in two of 400 such images single precision moves one."""
    rng = np.random.default_rng(seed)
    frame = rng.integers(0, 400, (rows, columns))
    for _ in range(layers):
        top = int(rng.integers(0, rows))
        frame[top : top + int(rng.integers(1, rows))] += int(rng.integers(0, 8000))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(surface, "_two_levels", surface.two_levels)
        check(compiled_steps, frame.astype(np.uint16))


@pytest.mark.slow
def test_frames_of_changing_size_leave_nothing_behind(compiled_steps: Steps) -> None:
    frame = draw_frames(1)[0]
    first = check(compiled_steps, frame)
    for columns in range(300, 340):
        find_wall_by(compiled_steps, frame[:, :columns], SCALE)
    assert_alike(find_wall_by(compiled_steps, frame, SCALE), first)


@pytest.mark.slow
@pytest.mark.parametrize("columns", [16, 120])
def test_an_empty_frame_of_another_size_in_between_leaves_no_scratch_to_overrun(
    compiled_steps: Steps, columns: int
) -> None:
    frame = draw_frames(1)[0]
    first = find_wall_by(compiled_steps, frame, SCALE)
    empty = find_wall_by(compiled_steps, np.zeros((64, columns), np.uint16), SCALE)
    assert empty.reason.startswith("the frame is empty")
    assert compiled_steps.at_once(frame, SCALE) is None
    assert_alike(find_wall_by(compiled_steps, frame, SCALE), first)
