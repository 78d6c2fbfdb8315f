"""Eye models: sections of linear walls, and of the library with the motion of its base
and the form of the wall.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import radians
from typing import Any

import analytic_library as analytic
import numpy as np
import pytest
from analytic_frames import moving
from analytic_library import analytic_library

from reference_walls import cut_section, shift_in_plane
from scleraforce.base.errors import CalibrationError
from scleraforce.calibration.filter import eye_filter
from scleraforce.calibration.filter.eye_filter import FrameStep, SkippedFrame
from scleraforce.calibration.filter.eye_parameters import stated_wall
from scleraforce.calibration.filter.library_sections import (
    base_moves,
    library_eye,
    without_form,
)
from scleraforce.calibration.filter.section_registration import parameter_sections
from scleraforce.lab.training.drawn_wall_errors import WallForms
from scleraforce.lab.training.interval_measurement import (
    VirtualEye,
    draw_eye,
    draw_frames,
)
from scleraforce.lab.virtual_eye import scan_plane
from scleraforce.library import Library
from scleraforce.mechanics.axisymmetric_wall import EvenWall, base_shift
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane, WallSection
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.mechanics.meridian_elements import MeridianSize, meridian_mesh
from scleraforce.records.eye import Eye
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range, ReaderStudy, Study, fixed
from scleraforce.wall.wall_in_metres import Boundaries
from virtual_eyes import changed, wall_of

ASIDE = Setup(
    eye=Eye(iop_pa=266.0, thickness_m=0.7e-3, globe=OPEN),
    needle=Needle(gap_m=0.5e-3, polar_rad=radians(35)),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("direction", "tilt", "force_n"),
    [(0.0, 0.0, 0.03), (0.5, 0.0, 0.05), (0.3, 0.05, 0.03)],
)
def test_predicted_section_is_the_cut_through_the_deformed_mesh(
    laboratory: Any, direction: float, tilt: float, force_n: float
) -> None:
    constants = changed(ASIDE, direction_rad=direction, tilt_rad=tilt)
    model = laboratory.model(constants)
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


@pytest.mark.slow
def test_responses_between_thicknesses_belong_to_a_wall_of_that_thickness(
    laboratory: Any,
) -> None:
    stated = changed(ASIDE, polar_rad=0.6)
    uncertain = laboratory.model(
        changed(stated, thickness_m=0.65e-3), thickness_uncertain=True
    )
    exact = laboratory.model(stated)
    names = ("youngs_modulus_pa", "thickness_m")
    between = parameter_sections(
        uncertain, names, np.array([[0.27e6, 0.7e-3]]), 0.03, 0.6
    )[0]
    true = parameter_sections(exact, names[:1], np.array([[0.27e6]]), 0.03, 0.6)[0]
    at = np.linspace(-6e-3, 6e-3, 200)

    for boundary in (0, 1):
        np.testing.assert_allclose(
            np.interp(at, *between[boundary].T),
            np.interp(at, *true[boundary].T),
            atol=2e-6,
        )


STUDY = Study()
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
    return [
        boundaries
        for _, boundaries in moving(
            [exact_section(force_n) for force_n in forces_n], rng
        )
    ]


def run(
    begun: eye_filter.EyeSession, forces_n: Sequence[float], made: Sequence[Any]
) -> eye_filter.EyeSession:
    for force_n, boundaries in zip(forces_n, made, strict=True):
        begun = eye_filter.step(begun, boundaries, force_n)
    return begun


def off_m(curves: np.ndarray, force_n: float, stated: Setup) -> float:
    """The largest distance of curves from the exact section."""
    exact = exact_section(force_n, stated)
    sides = zip(curves, (exact.outer, exact.inner), strict=True)
    return max(
        np.abs(mine[:, 1] - np.interp(mine[:, 0], *other.T)).max()
        for mine, other in sides
    )


def test_sections_have_the_walls_own_geometry_and_depend_on_thickness_gap_and_pressure(
    library: Library,
) -> None:
    for force_n, tilt_rad in (
        (0.0, 0.0),
        (0.02, 0.0),
        (0.05, 0.0),
        (0.04, 0.08),
        (0.04, -0.08),
    ):
        stated = changed(STATED, tilt_rad=tilt_rad)
        model = library_eye(SHARP, stated, library)
        (curves,) = model.curves([stated_wall(stated, MODULUS_PA, force_n, 0.0)])
        assert off_m(curves, force_n, stated) < 3e-6

    model = library_eye(SHARP, STATED, library)
    names = ("thickness_m", "gap_m", "iop_pa", "youngs_modulus_pa")
    (curves,) = parameter_sections(
        model, names, np.array([[0.6e-3, 0.8e-3, 400.0, MODULUS_PA]]), 0.03, 0.0
    )
    assert (
        off_m(
            curves,
            0.03,
            changed(STATED, thickness_m=0.6e-3, gap_m=0.8e-3, iop_pa=400.0),
        )
        < 3e-6
    )


def test_sections_continue_smoothly_beyond_the_library_and_report_it(
    library: Library,
) -> None:
    model = library_eye(SHARP, STATED, library)
    end = (
        float(
            library.largest_force_ratio(
                np.array([0.7e-3]), np.array([266.0 / MODULUS_PA])
            )[0]
        )
        * MODULUS_PA
    )
    forces = end * np.exp([-0.03, 0.0, 0.03, 0.3, 1.2])
    states = [
        replace(stated_wall(STATED, MODULUS_PA, float(force), 0.0), gap_m=0.0)
        for force in forces
    ]
    dent = model.curves(states)[:, 0, :, 1].max(axis=1)
    assert dent[2] - dent[1] == pytest.approx(dent[1] - dent[0], rel=0.03)
    assert dent[4] - dent[1] == pytest.approx(
        1.2 * (dent[2] - dent[1]) / 0.03, rel=0.01
    )
    assert model.outside(states[0]) is None
    assert "F/E" in str(model.outside(states[3]))
    assert "IOP/E" in str(model.outside(stated_wall(STATED, 1e4, 0.0, 0.0)))
    assert np.isfinite(
        model.curves(
            [stated_wall(STATED, 1e4, 0.03, 0.0), stated_wall(STATED, 1e7, 0.03, 0.0)]
        )
    ).all()


@pytest.mark.slow
def test_thickness_is_corrected_when_it_is_uncertain(library: Library) -> None:
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
    library: Library,
) -> None:
    short = replace(library, max_force_ratio=0.1e-6)
    made = frames([0.02, 0.05], np.random.default_rng(2))
    first = eye_filter.step(eye_filter.begin(STUDY, STATED, short), made[0], 0.02)
    second = eye_filter.step(first, made[1], 0.05)
    assert isinstance(first.last, FrameStep)
    assert isinstance(second.last, SkippedFrame)
    assert "F/E" in second.last.reason
    assert second.modulus.mean_pa == first.modulus.mean_pa
    assert second.updates == 1


def test_an_eye_that_the_library_does_not_have_is_refused(library: Library) -> None:
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
LATERAL = np.linspace(-6e-3, 6e-3, 25)
FORCE_RATIO = 0.1e-6


@pytest.mark.slow
def test_along_the_plane_the_motion_is_that_of_the_shift() -> None:
    polar_rad = wall_of(TURNED).polar_rad
    moved = FORCE_RATIO * base_moves(STUDY, TURNED, polar_rad, LATERAL)
    shift = base_shift(EvenWall(12e-3, 0.65e-3, 0.45, 0.35e-3), polar_rad)
    mesh = meridian_mesh(12e-3, 0.65e-3, 0.35e-3, np.pi / 2, MeridianSize())
    rings = np.stack(
        [mesh.points_nc[nodes, 0] for nodes in (mesh.outer_n, mesh.inner_n)]
    )

    for side in (-1.0, 1.0):
        lateral_bn = side * np.sqrt(
            np.maximum(rings**2 - wall_of(TURNED).gap_m ** 2, 0.0)
        )
        expected = shift_in_plane(
            shift,
            0.0,
            FORCE_RATIO,
            lateral_bn,
            wall_of(TURNED).gap_m,
            scan_plane(TURNED).direction_rad,
        )

        for boundary in (0, 1):
            here = (rings[boundary] > wall_of(TURNED).gap_m) & (
                np.abs(lateral_bn[boundary]) < 6e-3
            )
            at = lateral_bn[boundary][here]

            for mine, theirs in ((0, 0), (2, 1)):
                found = np.interp(at, LATERAL, moved[boundary, :, mine])
                assert np.abs(found - expected[boundary, here, theirs]).max() < 1e-6


@pytest.mark.slow
def test_the_dent_moves_across_a_plane_that_lies_across_the_meridian() -> None:
    # The tip's own motion in 3-D: along the meridian, so across a plane whose lateral
    # axis is the parallel.
    contact = Contact(polar_rad=wall_of(TURNED).polar_rad)
    wall = LinearWall(graded_mesh(12e-3, 0.65e-3, contact), 0.45)
    displacement = FORCE_RATIO * wall.needle_cnc([contact], 0.35e-3)[0]
    tip = displacement[
        np.argmin(np.linalg.norm(wall.mesh.points_nc - 12e-3 * contact.normal, axis=1))
    ]
    crosswise = changed(TURNED, gap_m=1e-6, direction_rad=radians(90))
    moved = (
        FORCE_RATIO
        * base_moves(STUDY, crosswise, wall_of(TURNED).polar_rad, np.array([1e-6]))[
            0, 0
        ]
    )
    offset = np.cross(contact.normal, contact.parallel)
    assert moved[1] == pytest.approx(float(tip @ offset), rel=0.05)
    assert abs(moved[1]) > 20e-6
    assert moved[0] == pytest.approx(0.0, abs=1e-6)


EVEN_STUDY = Study(
    reader=ReaderStudy(
        uneven_share=0.0,
        iop_noise_fraction=0.0,
        thickness_noise_fraction=0.0,
        gap_noise_fraction=0.0,
        thickness_m=Range(min=500e-6, max=700e-6),
        iop_pa=Range(min=200.0, max=400.0),
        lateral_m=fixed(0.0),
    )
)
RIGHT = {
    "curvature": 0.0,
    "skew": 0.0,
    "wedge": 0.0,
    "bow": 0.0,
    "limbus_m": 3.2e-3,
    "limbus_rad": 0.3,
    "soft_m": 3e-4,
}
OPEN_EYE = 0
FRAMES = 6


@pytest.fixture(scope="module")
def eye() -> VirtualEye:
    library = analytic_library(thicknesses=5, ratios=5, tips=24)
    return draw_eye(EVEN_STUDY, library, OPEN_EYE, np.random.default_rng(5))


def removed(eye: VirtualEye, model: Any) -> tuple[Boundaries, np.ndarray]:
    """The boundaries of a frame, and the part of the form that is removed from them."""
    seen = draw_frames(eye, EVEN_STUDY, 1, np.random.default_rng(2))[0].boundaries
    return (
        seen,
        seen.depth_m - without_form(model, seen, EVEN_STUDY.calibration).depth_m,
    )


def with_cornea(eye: VirtualEye) -> VirtualEye:
    return replace(
        eye,
        forms=WallForms(**{name: np.array([value]) for name, value in RIGHT.items()}),
    )


def test_a_form_is_removed_where_the_eye_has_it(eye: VirtualEye) -> None:
    """A cornea from both boundaries alike, a wall that grows thicker from the inner one
    alone, nothing if even.
    """
    _, off = removed(eye, eye.model)
    assert not np.nan_to_num(off).any()
    _, off = removed(with_cornea(eye), eye.model)
    assert np.nanmin(off) < -0.2e-3  # the cornea is higher
    np.testing.assert_allclose(off[1], off[0], atol=30e-6)
    wedge = 0.03
    seen, off = removed(
        replace(eye, forms=replace(eye.forms, wedge=np.array([wedge]))), eye.model
    )
    known = np.isfinite(off).all(axis=0)  # the scan does not reach every side
    assert known.mean() > 0.8
    assert np.polyfit(seen.lateral_m[known], (off[1] - off[0])[known], 1)[
        0
    ] == pytest.approx(wedge, rel=0.1)
