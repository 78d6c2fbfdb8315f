"""The wall beside the pole under the eye's pressure: motions that are known, and three
dimensions.
"""

import numpy as np
import pytest
from analytic_frames import middling_eye
from analytic_library import RADIUS_M, analytic_library, with_walls

from predicted_walls import Walls, formed_wall
from scleraforce.fit.unknowns import GAP, LATERAL
from scleraforce.library import Library
from scleraforce.library.moving_base import SHEARED, pole_directions
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane
from scleraforce.mechanics.graded_mesh import study_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.records.study import MeshStudy, Study

THICKNESS_M = 0.6e-3


@pytest.fixture(scope="module")
def library() -> Library:
    return analytic_library()


def test_a_wall_that_is_lifted_is_lifted_along_the_eye_s_axis(
    library,
):
    """By 0.1 mm; it also grows evenly, which moves nothing to a side."""
    places = np.random.default_rng(3).uniform(-0.4, 0.4, (1, 2, 50, 3))
    places[..., 2] = np.sqrt(1.0 - places[..., 0] ** 2 - places[..., 1] ** 2)
    undented = library.undented_tpbnc.copy()
    undented[:, 5, ..., 1] -= 1e-4
    lifted = with_walls(library, undented_btpbnc=undented[None])
    thickness_m = library.thickness_m[4:5]
    iop_ratio = library.tension[5] * thickness_m / RADIUS_M
    moved = lifted.base_bulge(thickness_m, iop_ratio, places, np.array([[-0.3, 0.4]]))
    expected = 1e-4 * np.array([-0.3, 0.4, 1.0 - np.sqrt(1.0 - 0.25)])
    np.testing.assert_allclose(moved, np.broadcast_to(expected, moved.shape), atol=1e-6)


@pytest.mark.parametrize("direction", [0.0, 0.7, -2.0])
def test_the_pole_lies_behind_the_contact_along_the_meridian(direction: float):
    contact = Contact(polar_rad=0.6, azimuth_rad=1.1)
    plane = ScanPlane(contact, gap_m=0.0, direction_rad=direction)
    np.testing.assert_allclose(
        pole_directions(0.6, direction),
        [plane.lateral[2], plane.offset[2]],
        atol=1e-15,
    )


def pushed_m(force_ratio: float, poisson_ratio: float) -> float:
    """Motion of the dent per part of the pole's direction (docs/physics.md)."""
    return SHEARED * (1.0 + poisson_ratio) / np.pi * force_ratio / THICKNESS_M


@pytest.mark.parametrize("polar_deg", [20.0, 40.0])
def test_the_needle_s_force_moves_the_dent_as_in_three_dimensions(
    polar_deg: float,
):
    contact = Contact(polar_rad=float(np.radians(polar_deg)))
    study = Study(mesh=MeshStudy(kind="graded", core=4, rings=10))
    wall = LinearWall(study_mesh(study, THICKNESS_M, contact), 0.45)
    moved_nc = 1e-7 * wall.needle_cnc([contact], 0.35e-3)[0]
    top = np.argmin(
        np.linalg.norm(wall.mesh.points_nc - RADIUS_M * contact.normal, axis=1)
    )
    pushed = pushed_m(1e-7, 0.45) * pole_directions(contact.polar_rad, 0.0)[0]
    assert pushed == pytest.approx(float(moved_nc[top] @ contact.meridian), rel=0.1)


def eye(tip_m: float = 0.0, **changed: float) -> np.ndarray:
    """Unknowns of an eye under 300 Pa."""
    at_origin = {"lateral_m": 0.0, "depth_m": 0.0, "shine_m": 0.0}
    wall = {"gap_m": 0.5e-3, "thickness_m": THICKNESS_M, "log_iop": np.log(300.0)}
    return middling_eye(tip_m, **at_origin, **wall, **changed)


def depths(library: Library, unknown: np.ndarray, lateral: np.ndarray) -> np.ndarray:
    """Both boundaries as the fit sees them (boundary, place)."""
    return np.array(
        [np.interp(lateral, *curve.T) for curve in formed_wall(Walls(library), unknown)]
    )


def test_the_fit_s_dent_is_pushed_along_the_section_and_across_it(
    library,
):
    pole = np.array([-0.3, 0.4])
    (force_ratio,) = library.forces(
        np.array([THICKNESS_M]), np.array([1e-3]), np.array([2e-3])
    )
    pushed = pushed_m(force_ratio, library.poisson_ratio) * pole
    assert np.abs(pushed).min() > 20e-6
    # this even wall has nothing else to move
    shifted = eye(2e-3)
    shifted[[GAP, LATERAL]] = 0.5e-3 - pushed[1], pushed[0]
    leaning = eye(2e-3, pole_along=pole[0], pole_across=pole[1])
    lateral = np.linspace(-5e-3, 5e-3, 101)
    np.testing.assert_allclose(
        depths(library, leaning, lateral),
        depths(library, shifted, lateral),
        atol=2e-6,
    )
