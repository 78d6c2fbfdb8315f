"""Eye models: sections of linear walls, and of the library with the motion of its base
and the form of the wall.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import radians
from typing import Any

import analytic_library as analytic
import numpy as np
import pytest
from analytic_frames import moving

from reference_walls import cut_section, shift_in_plane
from scleraforce.base.errors import CalibrationError
from scleraforce.calibration.filter import eye_filter
from scleraforce.calibration.filter.eye_filter import FrameStep, SkippedFrame
from scleraforce.calibration.filter.eye_parameters import stated_wall
from scleraforce.calibration.filter.library_sections import library_eye
from scleraforce.lab.virtual_eye import scan_plane, simulate_eye
from scleraforce.mechanics.axisymmetric_wall import EvenWall, base_shift
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane, WallSection
from scleraforce.mechanics.meridian_elements import MeridianSize, meridian_mesh
from scleraforce.records.eye import Eye
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import MeshStudy, Study
from scleraforce.wall.wall_in_metres import Boundaries
from virtual_eyes import changed, wall_of

STUDY = Study()
ASIDE = Setup(
    eye=Eye(iop_pa=266.0, thickness_m=0.7e-3, globe=OPEN),
    needle=Needle(gap_m=0.5e-3, polar_rad=radians(35)),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("direction", "tilt", "force_n", "stated_m"),
    [
        (0.0, 0.0, 0.03, 0.7e-3),
        (0.5, 0.0, 0.05, 0.7e-3),
        (0.3, 0.05, 0.03, 0.7e-3),
        # between the thicknesses of walls whose thickness is uncertain
        (0.0, 0.0, 0.03, 0.65e-3),
    ],
)
def test_predicted_section_is_the_cut_through_the_deformed_mesh(
    laboratory, direction: float, tilt: float, force_n: float, stated_m: float
):
    finer = replace(laboratory.study, mesh=MeshStudy(divisions=6))
    laboratory = replace(laboratory, study=finer)
    constants = changed(ASIDE, direction_rad=direction, tilt_rad=tilt)
    stated = changed(constants, thickness_m=stated_m)
    parameters = ("e",) if stated_m == 0.7e-3 else ("e", "thickness")
    model = eye_filter.begin(laboratory.study, stated, None, parameters).filter.model
    wall = laboratory.wall(0.7e-3)
    contact = Contact(polar_rad=wall_of(constants).polar_rad)
    displacement = wall.displacement(
        wall.needle_cnc([contact], 0.35e-3)[0],
        force_n,
        youngs_modulus_pa=0.27e6,
        iop_pa=266.0,
        density_kg_m3=1100.0,
    )
    cut = cut_section(
        wall.mesh,
        ScanPlane(contact, gap_m=0.5e-3, direction_rad=direction, tilt_rad=tilt),
        displacement,
    )
    state = stated_wall(constants, 0.27e6, force_n, contact.polar_rad)
    ((outer, inner),) = replace(model, smoothing_m=0.0).curves([state])
    at = np.linspace(-6.5e-3, 6.5e-3, 300)

    for mine, other in ((outer, cut.outer), (inner, cut.inner)):
        difference = np.interp(at, *mine.T) - np.interp(at, *other.T)
        assert np.abs(difference).max() < 10e-6


# on the pole: the made-up eye is one of revolution
STATED = changed(ASIDE, polar_rad=0.0)
MODULUS_PA = 0.27e6
SHARP = replace(STUDY, calibration=replace(STUDY.calibration, surface_smoothing_m=0.0))


def tip_m(force_n: float, stated: Setup = STATED) -> float:
    """The first tip at which the made-up eye carries a force, on a fine grid."""
    tips = np.linspace(0.0, 7.4e-3, 200_000)
    forces = MODULUS_PA * analytic.force_ratio(
        wall_of(stated).thickness_m, wall_of(stated).iop_pa / MODULUS_PA, tips
    )
    return float(tips[np.argmax(forces >= force_n)])


def exact_section(force_n: float, stated: Setup = STATED) -> WallSection:
    """The made-up eye's section, from the closed form at thousands of rings."""
    rings = np.linspace(0.0, np.pi / 2 - 1e-3, 4000)
    walls = analytic.curves(
        wall_of(stated).thickness_m,
        wall_of(stated).iop_pa / MODULUS_PA,
        tip_m(force_n, stated),
        rings,
    )
    sides = []

    for distance, depth in np.moveaxis(walls, -1, 1):
        across = wall_of(stated).gap_m + np.tan(scan_plane(stated).tilt_rad) * depth
        seen = distance > across
        lateral = np.sqrt(distance[seen] ** 2 - across[seen] ** 2)
        down = depth[seen] / np.cos(scan_plane(stated).tilt_rad)
        sides.append(
            np.stack(
                [np.append(-lateral[::-1], lateral), np.append(down[::-1], down)],
                axis=1,
            )
        )

    return WallSection(*sides)


def frames(forces_n: Sequence[float], rng: np.random.Generator) -> list[Boundaries]:
    """Boundaries of the made-up eye, which moves."""
    return moving([exact_section(force_n) for force_n in forces_n], rng)


def run(
    begun: eye_filter.EyeSession, forces_n: Sequence[float], made: Sequence[Any]
) -> eye_filter.EyeSession:
    for force_n, boundaries in zip(forces_n, made, strict=True):
        begun = eye_filter.step(begun, boundaries, force_n)
    return begun


@pytest.mark.parametrize(
    ("force_n", "wall"),
    [
        (0.0, {}),
        (0.02, {}),
        (0.05, {}),
        (0.04, {"tilt_rad": 0.08}),
        (0.04, {"tilt_rad": -0.08}),
        (0.03, {"thickness_m": 0.6e-3, "gap_m": 0.8e-3, "iop_pa": 400.0}),
    ],
)
def test_sections_have_the_walls_own_geometry_and_depend_on_thickness_gap_and_pressure(
    library, force_n: float, wall: dict[str, float]
):
    stated = changed(STATED, **wall)
    model = library_eye(SHARP, changed(STATED, tilt_rad=stated.scan.tilt_rad), library)
    (curves,) = model.curves([stated_wall(stated, MODULUS_PA, force_n, 0.0)])
    exact = exact_section(force_n, stated)

    for mine, other in zip(curves, (exact.outer, exact.inner), strict=True):
        off_m = mine[:, 1] - np.interp(mine[:, 0], *other.T)
        assert np.abs(off_m).max() < 3e-6


@pytest.mark.slow
def test_thickness_is_corrected_when_it_is_uncertain(library):
    study = replace(
        STUDY,
        calibration=replace(STUDY.calibration, thickness_sd_m=50e-6, inner_sd_m=3e-6),
    )
    forces = [0.02, 0.05, 0.01, 0.04, 0.03, 0.055]
    wrong = changed(STATED, thickness_m=0.65e-3)
    made = frames(forces, np.random.default_rng(1))
    alone = run(eye_filter.begin(study, wrong, library), forces, made)
    both = run(
        eye_filter.begin(study, wrong, library, ("e", "thickness")), forces, made
    )
    assert alone.modulus.mean_pa > 1.05 * MODULUS_PA
    assert both.modulus.mean_pa == pytest.approx(MODULUS_PA, rel=0.05)


@pytest.mark.slow
def test_a_frame_beyond_the_library_is_left_out_with_its_reason(
    library,
):
    short = replace(library, max_force_ratio=0.1e-6)
    made = frames([0.02, 0.05], np.random.default_rng(2))
    first = eye_filter.step(eye_filter.begin(STUDY, STATED, short), made[0], 0.02)
    second = eye_filter.step(first, made[1], 0.05)
    assert isinstance(first.last, FrameStep)
    assert isinstance(second.last, SkippedFrame)
    assert "F/E" in second.last.reason
    assert second.modulus.mean_pa == first.modulus.mean_pa
    assert second.updates == 1


def test_an_eye_that_the_library_does_not_have_is_refused(library):
    with pytest.raises(
        CalibrationError, match="1000 µm; the library has walls of 350 to 900 µm"
    ):
        library_eye(STUDY, changed(STATED, thickness_m=1e-3), library)
    with pytest.raises(CalibrationError, match="another radius"):
        library_eye(
            replace(STUDY, eye=replace(STUDY.eye, radius_m=11e-3)), STATED, library
        )


TURNED = Setup(
    eye=Eye(iop_pa=266.0, thickness_m=0.65e-3, globe=OPEN),
    needle=Needle(gap_m=0.6e-3, polar_rad=radians(40)),
    scan=Scan(direction_rad=0.7),
)
FORCE_RATIO = 0.1e-6


@pytest.mark.slow
def test_along_the_plane_the_motion_is_that_of_the_shift(library):
    polar_rad = wall_of(TURNED).polar_rad
    gap_m = wall_of(TURNED).gap_m
    model = library_eye(STUDY, TURNED, library)
    moved = FORCE_RATIO * model.moves_pbxc[0]
    shift = base_shift(EvenWall(12e-3, 0.65e-3, 0.45, 0.35e-3), polar_rad)
    mesh = meridian_mesh(12e-3, 0.65e-3, 0.35e-3, np.pi / 2, MeridianSize())
    rings = np.stack(
        [mesh.points_nc[nodes, 0] for nodes in (mesh.outer_n, mesh.inner_n)]
    )

    for side in (-1.0, 1.0):
        lateral_bn = side * np.sqrt(np.maximum(rings**2 - gap_m**2, 0.0))
        direction_rad = scan_plane(TURNED).direction_rad
        expected = shift_in_plane(
            shift, 0.0, FORCE_RATIO, lateral_bn, gap_m, direction_rad
        )

        for boundary in (0, 1):
            here = (rings[boundary] > gap_m) & (np.abs(lateral_bn[boundary]) < 6e-3)
            at = lateral_bn[boundary][here]

            for mine, theirs in ((0, 0), (2, 1)):
                found = np.interp(at, model.lateral_m, moved[boundary, :, mine])
                assert np.abs(found - expected[boundary, here, theirs]).max() < 1e-6


@pytest.mark.slow
def test_the_dent_moves_across_a_plane_that_lies_across_the_meridian(
    library,
):
    """As the tip does in 3-D: along the meridian, so across a plane whose lateral axis
    is the parallel.
    """
    contact = Contact(polar_rad=wall_of(TURNED).polar_rad)
    force_n = FORCE_RATIO * STUDY.eye.youngs_modulus_pa
    whole = simulate_eye(STUDY, 0.65e-3, force_n, contact)
    away_m = np.linalg.norm(whole.mesh.points_nc - 12e-3 * contact.normal, axis=1)
    tip = whole.needle_nc[np.argmin(away_m)]
    crosswise = changed(TURNED, gap_m=1e-6, direction_rad=radians(90))
    model = library_eye(STUDY, crosswise, library)
    moved = FORCE_RATIO * model.moves_pbxc[0, 0]
    along, across = (np.interp(0.0, model.lateral_m, moved[:, axis]) for axis in (0, 1))
    offset = np.cross(contact.normal, contact.parallel)
    assert across == pytest.approx(float(tip @ offset), rel=0.05)
    assert abs(across) > 20e-6
    assert along == pytest.approx(0.0, abs=1e-6)


def no_form(across_m: np.ndarray) -> np.ndarray:
    return np.zeros_like(across_m)


def cornea(across_m: np.ndarray) -> np.ndarray:
    """A surface that is steeper and more bent beyond the limbus."""
    beyond_m = np.maximum(across_m - 3.2e-3, 0.0)
    return 0.5 * 45.0 * beyond_m**2 - 0.3 * beyond_m


@pytest.mark.parametrize("form", [no_form, cornea])
def test_the_form_of_an_eye_does_not_move_its_modulus(
    library, form: Callable[[np.ndarray], np.ndarray]
):
    forces_n = [0.03, 0.015]
    made = [
        replace(seen, depth_m=seen.depth_m + form(seen.lateral_m - 0.3e-3))
        for seen in frames(forces_n, np.random.default_rng(1))
    ]
    found = run(eye_filter.begin(STUDY, STATED, library), forces_n, made)
    assert found.modulus.mean_pa == pytest.approx(MODULUS_PA, rel=0.04)
