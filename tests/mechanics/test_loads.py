import numpy as np
import pytest

from reference_r1 import gaussian_load
from scleraforce.errors import InputError
from scleraforce.mechanics.contact import Contact
from scleraforce.mechanics.elements import volume_points
from scleraforce.mechanics.loads import gravity_load, needle_loads, pressure_load
from scleraforce.mechanics.mesh import HexMesh, build_mesh

R, T, NEEDLE = 12e-3, 0.5e-3, 0.35e-3
KINDS = {"8 nodes": {"order": 1}, "27 nodes": {"order": 2}}
CONTACTS = [
    Contact(polar_rad=0.0),
    Contact(polar_rad=np.radians(35.0), azimuth_rad=0.3),
    Contact(polar_rad=np.radians(54.7), azimuth_rad=np.pi / 4),
    Contact(polar_rad=1.4, azimuth_rad=-2.0),
]


@pytest.fixture(scope="module", params=KINDS)
def mesh(request: pytest.FixtureRequest) -> HexMesh:
    return build_mesh(R, T, **KINDS[request.param])


def test_the_pressure_lifts_with_its_value_times_the_area_of_the_opening(mesh: HexMesh) -> None:
    """Exactly so for any mesh, by the divergence theorem: the area is that of the polygon or curve of the base."""
    load = pressure_load(mesh)
    area = np.pi * (R - T) ** 2
    np.testing.assert_allclose(load.sum(axis=0), [0, 0, area], atol=(2e-3 if mesh.order == 1 else 1e-6) * area)
    moment = np.cross(mesh.points_nc, load).sum(axis=0)
    np.testing.assert_allclose(moment, 0.0, atol=1e-12 * area * R)


def test_gravity_pulls_down_with_the_weight_of_the_wall(mesh: HexMesh) -> None:
    points = volume_points(mesh)
    load = gravity_load(mesh, points)
    np.testing.assert_allclose(load.sum(axis=0), [0, 0, -points.volumes_ep.sum()], rtol=1e-13, atol=1e-20)


def test_the_needles_resultant_is_one_newton_along_the_inward_normal(mesh: HexMesh) -> None:
    loads = needle_loads(mesh, CONTACTS, NEEDLE)
    np.testing.assert_allclose(loads.sum(axis=1), [-c.normal for c in CONTACTS], atol=1e-13)


def test_the_needles_force_acts_on_its_axis_over_its_disc() -> None:
    mesh = build_mesh(R, T)
    for contact, load in zip(CONTACTS, needle_loads(mesh, CONTACTS, NEEDLE), strict=True):
        amount = -load @ contact.normal
        centre = amount @ mesh.points_nc
        np.testing.assert_allclose(np.cross(centre, contact.normal), 0.0, atol=2e-4 * NEEDLE)
        # Second moment of a uniform disc: radius^2 / 4 about a diameter.
        for axis in (contact.meridian, contact.parallel):
            assert amount @ (mesh.points_nc @ axis) ** 2 == pytest.approx(NEEDLE**2 / 4, rel=1e-2)
        loaded = np.flatnonzero(amount)
        assert np.linalg.norm(mesh.points_nc[loaded] - R * contact.normal, axis=1).max() < 2e-3
        assert set(loaded) <= set(mesh.outer_qn.ravel())


@pytest.mark.parametrize("polar_deg", [89.0, 90.0, 120.0])
def test_a_needle_that_reaches_over_the_base_is_an_input_error(polar_deg: float) -> None:
    with pytest.raises(InputError, match=r"polar angle.*over the base"):
        needle_loads(build_mesh(R, T), [Contact(polar_rad=0.5), Contact(polar_rad=np.radians(polar_deg))], NEEDLE)


def test_the_gaussian_load_of_r1_is_normalised_and_has_the_mean_of_its_weight(mesh: HexMesh) -> None:
    contact, spread = CONTACTS[1], 2e-3
    load = gaussian_load(mesh, contact, spread)
    np.testing.assert_allclose(load.sum(axis=0), -contact.normal, atol=1e-13)
    # On a sphere |x - R d|^2 = 2 R^2 (1 - c), so the weight is exp(k c) and the mean of c is coth k - 1/k.
    k = (R / spread) ** 2
    mean_cosine = -(load @ contact.normal) @ (mesh.points_nc @ contact.normal) / R
    assert mean_cosine == pytest.approx(1.0 / np.tanh(k) - 1.0 / k, abs=2e-3 if mesh.order == 1 else 1e-4)
