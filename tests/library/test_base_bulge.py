"""The wall beside the pole under the eye's pressure: motions that are known, and three dimensions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_library import RADIUS_M, analytic_library, bulging, with_walls

from predicted_walls import Walls, formed_wall
from reference_walls import cut_section
from scleraforce.calibration.eye_model import EyeConstants, stated_wall
from scleraforce.calibration.library_eye import LibraryEye, library_eye
from scleraforce.library import unknowns as at
from scleraforce.library.base import base_bulge, base_push, pole_directions, undented_motion
from scleraforce.library.responses import Library
from scleraforce.library.store import build_library, open_library
from scleraforce.mechanics.contact import Contact, ScanPlane
from scleraforce.mechanics.finite_strain import FiniteWall
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.loads import needle_at
from scleraforce.study import LibraryStudy, Range, Study

ANGLES = np.linspace(0.0, np.pi / 2, 91)
THICKNESS = np.array([0.6e-3])


def places(rng: np.random.Generator, count: int) -> np.ndarray:
    """Unit vectors to places around the needle axis (1, 2, place, 3)."""
    found = rng.uniform(-0.4, 0.4, (1, 2, count, 3))
    found[..., 2] = np.sqrt(1.0 - found[..., 0] ** 2 - found[..., 1] ** 2)
    return found


def test_a_wall_that_is_lifted_is_lifted_along_the_eye_s_axis() -> None:
    motion = np.broadcast_to([0.0, 1e-4], (1, 2, 91, 2))
    moved = base_bulge(motion, ANGLES, places(np.random.default_rng(3), 50), np.array([[-0.3, 0.4]]))
    expected = 1e-4 * np.array([-0.3, 0.4, 1.0 - np.sqrt(1.0 - 0.25)])
    np.testing.assert_allclose(moved, np.broadcast_to(expected, moved.shape), atol=1e-12)


def test_the_motion_counts_from_the_sphere_at_rest() -> None:
    grown = 1e-4
    radii = RADIUS_M - np.array([0.0, 0.6e-3])[:, None] + grown
    undented = np.stack([radii * np.sin(ANGLES), RADIUS_M - radii * np.cos(ANGLES)], axis=-1)[None]
    expected = np.broadcast_to(grown * np.stack([np.sin(ANGLES), np.cos(ANGLES)], -1), (1, 2, 91, 2))
    np.testing.assert_allclose(undented_motion(undented, ANGLES, RADIUS_M, THICKNESS), expected, atol=1e-12)


def test_the_pole_lies_behind_the_contact_along_the_meridian() -> None:
    contact = Contact(polar_rad=0.6, azimuth_rad=1.1)
    for direction in (0.0, 0.7, -2.0):
        plane = ScanPlane(contact, gap_m=0.0, direction_rad=direction)
        expected = np.array([0.0, 0.0, 1.0]) @ np.stack([plane.lateral, plane.offset], axis=1)
        np.testing.assert_allclose(pole_directions(0.6, direction), expected, atol=1e-15)


@pytest.mark.parametrize("polar_deg", [20.0, 40.0])
def test_the_needle_s_force_moves_the_dent_as_in_three_dimensions(polar_deg: float) -> None:
    contact, force_ratio = Contact(polar_rad=float(np.radians(polar_deg))), 1e-7
    wall = LinearWall(graded_mesh(RADIUS_M, 0.6e-3, contact), 0.45)
    displacement = force_ratio * wall.needle_cnc([contact], 0.35e-3)[0]
    tip = displacement[np.argmin(np.linalg.norm(wall.mesh.points_nc - RADIUS_M * contact.normal, axis=1))]
    pushed = base_push(np.array([force_ratio]), THICKNESS, 0.45)[0] * pole_directions(contact.polar_rad, 0.0)[0]
    assert pushed == pytest.approx(float(tip @ contact.meridian), rel=0.1)


def eye(tip_m: float = 0.0) -> np.ndarray:
    """Unknowns (1, unknown) of an eye under 300 Pa, the pole above the needle."""
    unknown = np.zeros((1, len(at.NAMES)))
    values = tip_m, 0.5e-3, 0.6e-3, np.log(0.3e6), np.log(300.0)
    unknown[0, [at.TIP, at.GAP, at.THICKNESS, at.MODULUS, at.IOP]] = values
    return unknown


def stated(direction_rad: float | None) -> EyeConstants:
    return EyeConstants(
        iop_pa=300.0, thickness_m=0.6e-3, gap_m=0.5e-3, polar_rad=0.6, polar_sd_rad=0.0, direction_rad=direction_rad
    )


def calibrating(constants: EyeConstants, lateral: np.ndarray) -> LibraryEye:
    library = bulging(analytic_library()).within(0.9 * RADIUS_M).for_contact(constants.polar_rad)
    return LibraryEye(constants, library, lateral, (constants.polar_rad,), np.zeros((1, 2, len(lateral), 3)))


def test_calibration_and_fit_see_the_same_section() -> None:
    lateral, constants, unknown = np.arange(-6e-3, 6.01e-3, 0.1e-3), stated(0.8), eye()
    model = calibrating(constants, lateral)
    theirs = model.curves([stated_wall(constants, 0.3e6, 1e-9, 0.6)])[0]
    even = formed_wall(Walls(model.library), unknown[0])
    unknown[0, at.POLE] = pole_directions(0.6, 0.8)
    mine = formed_wall(Walls(model.library), unknown[0])
    for boundary in (0, 1):
        found, upright = (np.interp(lateral, *curves[boundary].T) for curves in (mine, even))
        np.testing.assert_allclose(found, theirs[boundary, :, 1], atol=3e-6)
        assert np.abs(upright - theirs[boundary, :, 1]).max() > 10e-6


def test_the_fit_s_dent_is_pushed_along_the_section_and_across_it() -> None:
    library, pole, unknown = analytic_library(), np.array([-0.3, 0.4]), eye(2e-3)
    force_ratio = library.forces(THICKNESS, np.array([1e-3]), np.array([2e-3]))
    pushed = base_push(force_ratio, THICKNESS, library.poisson_ratio)[0] * pole
    shifted = unknown.copy()
    shifted[0, [at.GAP, at.LATERAL]] = 0.5e-3 - pushed[1], pushed[0]
    expected = formed_wall(Walls(library), shifted[0])  # this even wall has nothing else to move
    unknown[0, at.POLE] = pole
    found = formed_wall(Walls(library), unknown[0])
    assert np.abs(pushed).min() > 20e-6
    lateral = np.linspace(-5e-3, 5e-3, 101)
    for mine, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(np.interp(lateral, *mine.T), np.interp(lateral, *theirs.T), atol=2e-6)


def test_where_no_direction_is_stated_a_calibration_sees_an_even_section() -> None:
    lateral, uneven = np.linspace(-6e-3, 6e-3, 121), []
    for constants in (stated(0.0), stated(None)):
        depth = calibrating(constants, lateral).curves([stated_wall(constants, 0.3e6, 0.01, 0.6)])[0, :, :, 1]
        uneven.append(np.abs(depth - depth[:, ::-1]).max())
    assert uneven[0] > 5e-6
    assert uneven[1] < 1e-12


@pytest.mark.slow
@pytest.mark.long
def test_sections_of_a_sealed_eye_agree_with_three_dimensions(tmp_path: Path) -> None:
    """A soft wall whose pressure has risen threefold, 41 degrees from the pole."""
    grid = LibraryStudy(thickness_m=Range(min=450.0e-6, max=650.0e-6), thicknesses=4, tips=24,
                        tension=Range(min=2e-2, max=0.2), tensions=6, max_tip_m=4e-3, elements=48,
                        stiffenings=1)  # fmt: skip
    path = tmp_path / "library.zarr"
    build_library(Study(library=grid), path)
    polar, direction, thickness_m, modulus_pa, pressure_pa = float(np.radians(41.0)), 1.8, 0.52e-3, 0.26e6, 1530.0
    contact, dent_m = Contact(polar_rad=polar), 1.0e-3
    wall = FiniteWall(graded_mesh(RADIUS_M, thickness_m, contact, core=6, rings=14), 0.45)
    states = wall.load_path(
        needle_at(wall.mesh, contact, 0.35e-3),
        youngs_modulus_pa=modulus_pa, iop_pa=pressure_pa, density_kg_m3=0.0, max_force_n=np.inf, max_tip_m=dent_m,
    )  # fmt: skip
    plane = ScanPlane(contact, gap_m=0.42e-3, direction_rad=direction)
    cut = cut_section(wall.mesh, plane, states.displacement_snc[-1])
    constants = EyeConstants(
        iop_pa=pressure_pa, thickness_m=thickness_m, gap_m=0.42e-3, polar_rad=polar, polar_sd_rad=0.0,
        direction_rad=direction,
    )  # fmt: skip
    study = Study(library=grid)
    study = replace(study, calibration=replace(study.calibration, surface_smoothing_m=0.0))
    eye = library_eye(study, constants, open_library(path))
    still = with_walls(eye.library, undented_btpbnc=_sphere(eye.library)[None])
    even = replace(eye, library=still, moves_pbxc=0 * eye.moves_pbxc)
    force_n = float(eye.library.forces(*(np.array([v]) for v in (thickness_m, pressure_pa / modulus_pa, dent_m)))[0])
    state = stated_wall(constants, modulus_pa, force_n * modulus_pa, polar)
    off = [_off_m(model.curves([state])[0], (cut.outer, cut.inner)) for model in (eye, even)]
    assert off[0] < 4e-6
    assert off[1] > 2 * off[0]


def _sphere(library: Library) -> np.ndarray:
    """Walls that the pressure does not move."""
    undented = library.undented_tpbnc.astype(np.float64)
    angle = np.arctan2(undented[0, 0, 0, :, 0], RADIUS_M - undented[0, 0, 0, :, 1])
    radii = RADIUS_M - np.stack([np.zeros_like(library.thickness_m), library.thickness_m], axis=1)[:, None, :, None]
    at_rest = np.stack([radii * np.sin(angle), RADIUS_M - radii * np.cos(angle)], axis=-1)
    return np.broadcast_to(at_rest, undented.shape).astype(np.float32)


def _off_m(curves: np.ndarray, cut: tuple[np.ndarray, np.ndarray]) -> float:
    """Root mean square distance of two sections in depth, after the best shift and turn of one of them."""
    lateral = np.arange(-6e-3, 6.01e-3, 0.2e-3)
    rest, basis = [], []
    for mine, theirs in zip(curves, cut, strict=True):
        depth = np.interp(lateral, *theirs.T)
        slope = np.gradient(depth, lateral)
        rest.append(depth - np.interp(lateral, *mine.T))
        basis.append(np.stack([np.ones_like(lateral), slope, lateral + slope * depth], axis=1))
    matrix, off = np.concatenate(basis), np.concatenate(rest)
    return float(np.sqrt(np.mean((off - matrix @ np.linalg.lstsq(matrix, off, rcond=None)[0]) ** 2)))
