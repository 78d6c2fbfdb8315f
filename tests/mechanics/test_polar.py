"""The effect of the base on a needle beside the pole, against geometry and against three dimensions."""

import numpy as np
import pytest

from reference_walls import cut_section, polar_path, shift_in_plane
from scleraforce.errors import InputError
from scleraforce.library.base import base_angle
from scleraforce.mechanics.axisymmetric import axisymmetric_path
from scleraforce.mechanics.contact import Contact, ScanPlane
from scleraforce.mechanics.finite_strain import FiniteWall
from scleraforce.mechanics.graded import graded_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.loads import needle_at
from scleraforce.mechanics.meridian import MeridianSize
from scleraforce.mechanics.polar import base_shift

RADIUS, NEEDLE, NU, GAP = 12e-3, 0.35e-3, 0.45, 0.5e-3
EYE = (RADIUS, 0.8e-3, NU, NEEDLE)
IOP_RATIO = 266.0 / 0.38e6


@pytest.mark.parametrize("polar_deg", [10.0, 35.0, 50.0])
def test_base_lies_where_the_direction_meets_its_plane(polar_deg: float) -> None:
    contact = Contact(polar_rad=np.radians(polar_deg))
    azimuths = np.linspace(0.0, 2.0 * np.pi, 9)
    angles = base_angle(contact.polar_rad, azimuths)
    sideways = np.outer(np.cos(azimuths), contact.meridian) + np.outer(np.sin(azimuths), contact.parallel)
    points = np.cos(angles)[:, None] * contact.normal + np.sin(angles)[:, None] * sideways
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-12)


@pytest.mark.slow
def test_on_the_pole_nothing_changes() -> None:
    tips = np.array([0.5e-3, 2e-3])
    beside = polar_path((*EYE, IOP_RATIO), 0.0, tips)
    np.testing.assert_array_equal(beside.force_ratio_m2, axisymmetric_path(*EYE, IOP_RATIO, tips_m=tips).force_ratio_m2)
    shift = base_shift(*EYE, polar_rad=0.0)
    dent = 8.3e3  # m per F/E, the linear wall's tip
    assert np.abs(shift.needle_mbnc).max() < 0.005 * dent  # the 3-D mesh under the needle


@pytest.mark.slow
def test_shift_takes_the_linear_curves_to_three_dimensions() -> None:
    contact = Contact(polar_rad=np.radians(45.0))
    iop_ratio, force_ratio = IOP_RATIO, 2e-9
    wall = LinearWall(graded_mesh(RADIUS, 0.8e-3, contact), NU)
    displacement_nc = iop_ratio * wall.pressure_nc + force_ratio * wall.needle_cnc([contact], NEEDLE)[0]
    shift = base_shift(*EYE, polar_rad=contact.polar_rad)
    path = axisymmetric_path(*EYE, iop_ratio, tips_m=np.array([1e-6, 2e-5]))
    share = force_ratio / path.force_ratio_m2[-1]
    curves = path.curves_sbnc[0] + share * (path.curves_sbnc[-1] - path.curves_sbnc[0])
    for direction_rad in (0.0, 1.0, 2.5):
        section = cut_section(wall.mesh, ScanPlane(contact, gap_m=GAP, direction_rad=direction_rad), displacement_nc)
        for side in (-1.0, 1.0):
            lateral_bn = side * np.sqrt(np.maximum(curves[..., 0] ** 2 - GAP**2, 0.0))
            lateral, depth = np.moveaxis(
                shift_in_plane(shift, iop_ratio, force_ratio, lateral_bn, GAP, direction_rad)[0], -1, 0
            )
            shown = (curves[0, :, 0] > 0.7e-3) & (curves[0, :, 0] < 6.5e-3)
            expected = np.interp((lateral_bn[0] + lateral)[shown], *section.outer.T)
            np.testing.assert_allclose((curves[0, :, 1] + depth)[shown], expected, atol=4e-6)


@pytest.mark.long
@pytest.mark.slow
def test_a_needle_near_the_base_meets_the_force_of_three_dimensions() -> None:
    contact = Contact(polar_rad=np.radians(50.0))
    mesh = graded_mesh(RADIUS, 0.8e-3, contact)
    tip_m, modulus_pa = 2.5e-3, 0.38e6
    loads = {"youngs_modulus_pa": modulus_pa, "iop_pa": 266.0, "density_kg_m3": 0.0, "max_force_n": 1.0}
    solid = FiniteWall(mesh, NU).load_path(needle_at(mesh, contact, NEEDLE), **loads, max_tip_m=tip_m)
    forces = [
        polar_path((*EYE, IOP_RATIO), angle, np.array([tip_m])).force_ratio_m2[-1] for angle in (0.0, contact.polar_rad)
    ]
    expected = solid.forces_n[-1] / modulus_pa
    assert forces[1] == pytest.approx(expected, rel=0.01)
    assert abs(forces[1] - expected) < 0.5 * abs(forces[0] - expected)


@pytest.mark.parametrize("polar_deg", [-1.0, 60.0])
def test_polar_angles_out_of_range_are_refused(polar_deg: float) -> None:
    with pytest.raises(InputError, match="polar angle"):
        base_shift(*EYE, polar_rad=np.radians(polar_deg), size=MeridianSize(16))
