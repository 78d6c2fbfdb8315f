"""The pressure of sealed eyes under a force, against root finding."""

import library_arrays
import numpy as np
import pytest
from analytic_library import analytic_library, draw_walls

from scleraforce.base.units import SI_PER_UNIT
from scleraforce.library.sealed_eye import iop_ratio_under_force
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw, sealed_law
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]
LIBRARY = analytic_library()


def walls(count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Thicknesses and resting pressures over E."""
    thickness, resting = draw_walls(np.random.default_rng(5), count)
    return thickness, np.minimum(resting, 0.05 * thickness / LIBRARY.radius_m)


def test_an_open_globe_and_one_without_a_force_keep_their_pressure():
    thickness, resting = walls()
    globe = sealed_law(0.03 * PER_UL).over(0.4e6)
    forces = np.full(len(thickness), 5e-8)
    np.testing.assert_array_equal(
        iop_ratio_under_force(LIBRARY, thickness, resting, forces, CONSTANT_PRESSURE),
        resting,
    )
    np.testing.assert_array_equal(
        iop_ratio_under_force(LIBRARY, thickness, resting, 0.0 * forces, globe), resting
    )
    some = PressureLaw(
        "cube-root", np.where(np.arange(len(thickness)) % 2, globe.rate, 0.0)
    )
    found = iop_ratio_under_force(LIBRARY, thickness, resting, forces, some)
    np.testing.assert_array_equal(found[::2], resting[::2])
    assert (found[1::2] > resting[1::2]).all()


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_pressures_agree_with_root_finding(law: str):
    rng = np.random.default_rng(8)
    thickness, resting = walls()
    falling = rng.random(len(thickness)) < 0.1
    rigidity = np.where(falling, -0.002, rng.uniform(0.0, 0.2, len(thickness))) * PER_UL
    globe = sealed_law(rigidity, law).over(0.4e6)
    forces = rng.uniform(0.0, 1.2, len(thickness)) * LIBRARY.largest_force_ratio(
        thickness, resting
    )
    found = iop_ratio_under_force(LIBRARY, thickness, resting, forces, globe)
    expected = library_arrays.iop_ratio_under_force(
        LIBRARY, thickness, resting, forces, globe
    )
    highest = LIBRARY.iop_ratio_ends(thickness)[1]
    assert np.count_nonzero(expected > (1.0 - 1e-9) * highest) > 5
    assert np.count_nonzero(expected < resting) > 2
    np.testing.assert_allclose(found, expected, rtol=1e-6)
