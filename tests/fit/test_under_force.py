"""The pressure of sealed eyes under a force, against the pressure at the dent that the
force makes.
"""

import library_arrays
import numpy as np
import pytest
from analytic_library import analytic_library, draw_walls
from library_arrays import reached_tips

from scleraforce.base.units import SI_PER_UNIT
from scleraforce.library.sealed_eye import iop_ratio_at_dent, iop_ratio_under_force
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw, sealed_law
from scleraforce.records.study_of_eye import RIGIDITY_LAWS

PER_UL = SI_PER_UNIT["mmhg13_per_ul"][1]
LIBRARY = analytic_library()


def sealed_eyes(
    law: str, count: int = 200
) -> tuple[np.ndarray, np.ndarray, np.ndarray, PressureLaw]:
    """Walls, dents and globes, of which some run away."""
    rng = np.random.default_rng(5)
    thickness, resting = draw_walls(rng, count)
    resting = np.minimum(resting, 0.05 * thickness / LIBRARY.radius_m)
    dents = rng.uniform(0.05e-3, 1.2e-3, count)

    return (
        thickness,
        resting,
        dents,
        sealed_law(rng.uniform(0.001, 0.06, count) * PER_UL, law).over(0.4e6),
    )


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_the_pressure_is_that_at_the_dent_which_the_force_makes(law: str) -> None:
    thickness, resting, dents, globe = sealed_eyes(law)
    expected = iop_ratio_at_dent(LIBRARY, thickness, resting, dents, globe)
    stays = np.isfinite(expected)
    walls = (thickness[stays], resting[stays])
    rate = np.asarray(globe.rate)[stays]
    forces = LIBRARY.forces(walls[0], expected[stays], dents[stays])
    first = np.isclose(
        reached_tips(LIBRARY, walls[0], expected[stays], forces),
        dents[stays],
        rtol=1e-9,
    )
    found = iop_ratio_under_force(LIBRARY, *walls, forces, PressureLaw(law, rate))
    assert first.sum() > 60
    assert np.median(expected[stays][first] / walls[1][first]) > 1.2
    np.testing.assert_allclose(found[first], expected[stays][first], rtol=1e-5)


def test_an_open_globe_and_one_without_a_force_keep_their_pressure() -> None:
    thickness, resting, _, globe = sealed_eyes("cube-root")
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
def test_pressures_agree_with_root_finding(law: str) -> None:
    rng = np.random.default_rng(8)
    thickness, resting, _, _ = sealed_eyes(law)
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
