"""An eye from a response library: its sections, where they end, and the filter on it."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import analytic_library as analytic
import numpy as np
import pytest

from ideal_boundaries import ideal_boundaries
from scleraforce.calibration import assimilation
from scleraforce.calibration.assimilation import FrameStep, Skipped
from scleraforce.calibration.eye_model import EyeConstants, parameter_sections, stated_wall
from scleraforce.calibration.library_eye import library_eye, section_depths
from scleraforce.errors import CalibrationError
from scleraforce.laboratory.light import Pose
from scleraforce.library import Library
from scleraforce.mechanics.contact import Section
from scleraforce.study import Study

STUDY = Study()
STATED = EyeConstants(
    iop_pa=266.0, thickness_m=0.7e-3, gap_m=0.5e-3, polar_rad=0.0, polar_sd_rad=0.0
)  # on the pole: the made-up eye is one of revolution
MODULUS_PA = 0.27e6
SHARP = replace(STUDY, calibration=replace(STUDY.calibration, surface_smoothing_m=0.0))


@pytest.fixture(scope="module")
def library() -> Library:
    return analytic.analytic_library()


def tip_m(force_n: float, stated: EyeConstants = STATED) -> float:
    """The first tip at which the made-up eye carries a force, on a fine grid."""
    tips = np.linspace(0.0, 7.4e-3, 200_000)
    forces = MODULUS_PA * analytic.force_ratio(stated.thickness_m, stated.iop_pa / MODULUS_PA, tips)
    return float(tips[np.argmax(forces >= force_n)])


def exact_section(force_n: float, stated: EyeConstants = STATED) -> Section:
    """The made-up eye's section, from the closed form at thousands of rings."""
    rings = np.linspace(0.0, np.pi / 2 - 1e-3, 4000)
    walls = analytic.curves(stated.thickness_m, stated.iop_pa / MODULUS_PA, tip_m(force_n, stated), rings)
    sides = []
    for distance, depth in np.moveaxis(walls, -1, 1):
        across = stated.gap_m + np.tan(stated.tilt_rad) * depth
        seen = distance > across
        lateral, down = np.sqrt(distance[seen] ** 2 - across[seen] ** 2), depth[seen] / np.cos(stated.tilt_rad)
        sides.append(np.stack([np.append(-lateral[::-1], lateral), np.append(down[::-1], down)], axis=1))
    return Section(*sides)


def frames(forces_n: Sequence[float], rng: np.random.Generator, stated: EyeConstants = STATED) -> list[Any]:
    """Boundaries of the made-up eye, which moves."""
    made = []
    for force_n in forces_n:
        lateral_m, depth_m = rng.uniform(-0.2e-3, 0.2e-3, 2)
        pose = Pose(lateral_m=0.3e-3 + lateral_m, depth_m=0.5e-3 + depth_m, tilt_rad=0.01)
        smoothing_m = STUDY.calibration.surface_smoothing_m
        made.append(ideal_boundaries(exact_section(force_n, stated), pose, STUDY.oct, 5e-6, rng, smoothing_m))
    return made


def run(begun: assimilation.EyeSession, forces_n: Sequence[float], made: Sequence[Any]) -> assimilation.EyeSession:
    for force_n, boundaries in zip(forces_n, made, strict=True):
        begun = assimilation.step(begun, boundaries, force_n)
    return begun


@pytest.mark.parametrize(("force_n", "tilt_rad"), [(0.0, 0.0), (0.02, 0.0), (0.05, 0.0), (0.04, 0.08), (0.04, -0.08)])
def test_sections_are_those_of_the_walls_own_geometry(library: Library, force_n: float, tilt_rad: float) -> None:
    stated = replace(STATED, tilt_rad=tilt_rad)
    model = library_eye(SHARP, stated, library)
    (curves,) = model.curves([stated_wall(stated, MODULUS_PA, force_n, 0.0)])
    exact = exact_section(force_n, stated)
    for mine, other in zip(curves, (exact.outer, exact.inner), strict=True):
        assert np.abs(mine[:, 1] - np.interp(mine[:, 0], *other.T)).max() < 3e-6


def test_thickness_gap_and_pressure_enter_the_sections(library: Library) -> None:
    model = library_eye(SHARP, STATED, library)
    names = ("thickness_m", "gap_m", "iop_pa", "youngs_modulus_pa")
    (curves,) = parameter_sections(model, names, np.array([[0.6e-3, 0.8e-3, 400.0, MODULUS_PA]]), 0.03, 0.0)
    exact = exact_section(0.03, replace(STATED, thickness_m=0.6e-3, gap_m=0.8e-3, iop_pa=400.0))
    for mine, other in zip(curves, (exact.outer, exact.inner), strict=True):
        assert np.abs(mine[:, 1] - np.interp(mine[:, 0], *other.T)).max() < 3e-6


def test_of_a_wall_that_folds_over_the_part_on_top_counts() -> None:
    # From the axis outwards: a floor, a cliff that leans inwards, and the plain that it carries.
    curve = np.array([[0.0, 3.0], [1.0, 3.0], [2.0, 3.0], [1.5, 1.0], [3.0, 1.0], [4.0, 1.0]])
    lateral = np.array([1.0, 1.6, 1.9, 3.5])
    depth = section_depths(curve[None, None], np.eye(6), np.zeros(1), 0.0, lateral, np.zeros((1, 1, 4, 3)))[0, 0]
    assert depth == pytest.approx([3.0, 1.0, 1.0, 1.0])


@pytest.mark.parametrize("tilt_rad", [0.0, 0.1])
def test_a_wall_that_moves_as_a_whole_is_the_same_wall_elsewhere(tilt_rad: float) -> None:
    ring = np.linspace(0.0, 4e-3, 4001)
    bowl = np.stack([ring, 2e-3 - 100 * ring**2], axis=1)
    move, gap_m, lateral = np.array([0.1e-3, -0.07e-3, 0.2e-3]), 0.5e-3, np.linspace(-2e-3, 2e-3, 9)
    moved = np.broadcast_to(move, (1, 1, 9, 3))
    found = section_depths(bowl[None, None], np.eye(4001), np.array([gap_m]), tilt_rad, lateral, moved)[0, 0]
    # The plane's point (lateral, gap + Y sin, Y cos) lies on the bowl, moved: a quadratic in Y, solved by iteration.
    plane = np.full(9, 2e-3)
    for _ in range(200):
        across = gap_m + plane * np.sin(tilt_rad) - move[1]
        plane = (2e-3 - 100 * ((lateral - move[0]) ** 2 + across**2) + move[2]) / np.cos(tilt_rad)
    assert found == pytest.approx(plane, abs=(1e-9 if tilt_rad == 0.0 else 4e-6))


def test_sections_go_on_smoothly_where_the_library_ends_and_say_so(library: Library) -> None:
    model = library_eye(SHARP, STATED, library)
    end = float(library.largest_force_ratio(np.array([0.7e-3]), np.array([266.0 / MODULUS_PA]))[0]) * MODULUS_PA
    forces = end * np.exp([-0.03, 0.0, 0.03, 0.3, 1.2])
    states = [replace(stated_wall(STATED, MODULUS_PA, float(force), 0.0), gap_m=0.0) for force in forces]
    dent = model.curves(states)[:, 0, :, 1].max(axis=1)
    assert dent[2] - dent[1] == pytest.approx(dent[1] - dent[0], rel=0.03)
    assert dent[4] - dent[1] == pytest.approx(1.2 * (dent[2] - dent[1]) / 0.03, rel=0.01)
    assert model.outside(states[0]) is None
    assert "F/E" in str(model.outside(states[3]))
    assert "IOP/E" in str(model.outside(stated_wall(STATED, 1e4, 0.0, 0.0)))
    assert np.isfinite(model.curves([stated_wall(STATED, 1e4, 0.03, 0.0), stated_wall(STATED, 1e7, 0.03, 0.0)])).all()


@pytest.mark.slow
def test_one_modulus_fits_low_and_high_forces(library: Library) -> None:
    forces = [0.04, 0.008, 0.055, 0.02, 0.03]
    found = run(assimilation.begin(STUDY, STATED, library), forces, frames(forces, np.random.default_rng(0)))
    assert found.updates == 5
    assert found.mean_pa == pytest.approx(MODULUS_PA, rel=0.01)
    assert abs(found.mean_pa - MODULUS_PA) < 2 * found.sd_pa
    assert found.filter.model.polar_ends_rad == (0.0, 0.0)


@pytest.mark.slow
def test_thickness_is_corrected_when_it_is_uncertain(library: Library) -> None:
    study = replace(STUDY, calibration=replace(STUDY.calibration, thickness_sd_m=50e-6, inner_sd_m=3e-6))
    forces = [0.02, 0.05, 0.01, 0.04, 0.03, 0.055]
    wrong, made = replace(STATED, thickness_m=0.65e-3), frames(forces, np.random.default_rng(1))
    alone = run(assimilation.begin(study, wrong, library), forces, made)
    both = run(assimilation.begin(study, wrong, library, ("e", "thickness")), forces, made)
    assert alone.mean_pa > 1.05 * MODULUS_PA
    assert both.mean_pa == pytest.approx(MODULUS_PA, rel=0.05)


@pytest.mark.slow
def test_a_frame_beyond_the_library_is_left_out_with_its_reason(library: Library) -> None:
    short = replace(library, max_force_ratio=0.1e-6)
    made = frames([0.02, 0.05], np.random.default_rng(2))
    first = assimilation.step(assimilation.begin(STUDY, STATED, short), made[0], 0.02)
    second = assimilation.step(first, made[1], 0.05)
    assert isinstance(first.last, FrameStep)
    assert isinstance(second.last, Skipped)
    assert "F/E" in second.last.reason
    assert second.mean_pa == first.mean_pa
    assert second.updates == 1


def test_an_eye_that_the_library_does_not_have_is_refused(library: Library) -> None:
    with pytest.raises(CalibrationError, match="1000 µm; the library has walls of 350 to 900 µm"):
        library_eye(STUDY, replace(STATED, thickness_m=1e-3), library)
    with pytest.raises(CalibrationError, match="another radius"):
        library_eye(replace(STUDY, eye=replace(STUDY.eye, radius_m=11e-3)), STATED, library)
