"""The 3-D wall whose stress relaxes, against what is known exactly about it."""

import numpy as np
import pytest

from figures.pushed_walls import CONTACT, NEEDLE_RADIUS_M, NU, RADIUS_M, THICKNESS_M
from figures.studies.relaxation import RAMP_S, RelaxingWall, pushed
from scleraforce.mechanics.finite_strain_wall import FiniteWall
from scleraforce.mechanics.graded_mesh import graded_mesh
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.loads_and_supports import needle_at
from scleraforce.mechanics.tissue_material import PronySeries

MODULUS_PA = 0.4e6
TIP_M = 0.4e-3
MESH = graded_mesh(RADIUS_M, THICKNESS_M, CONTACT, core=2, rings=3)
NEEDLE = needle_at(MESH, CONTACT, NEEDLE_RADIUS_M)


def felt_n(tissue: PronySeries, iop_pa: float, time_s: list[float]) -> np.ndarray:
    wall = RelaxingWall(FiniteWall(MESH, NU), NEEDLE, MODULUS_PA, tissue)
    return (
        MODULUS_PA * pushed(wall, iop_pa / MODULUS_PA, TIP_M, np.array(time_s))[:, -1]
    )


def elastic_n(modulus_pa: float, iop_pa: float) -> float:
    path = FiniteWall(MESH, NU).load_path(
        NEEDLE,
        PathEnd(max_tip_m=TIP_M),
        youngs_modulus_pa=modulus_pa,
        iop_pa=iop_pa,
        density_kg_m3=0.0,
    )
    return float(path.forces_n[-1])


def test_without_pressure_a_fast_push_relaxes_as_the_wall_does() -> None:
    slow = PronySeries((0.27, 0.33), (1e3, 1e4))  # RAMP_S is an instant
    found_n = felt_n(slow, 0.0, [0.0, 0.5 * RAMP_S, RAMP_S, 500.0, 5000.0])
    expected = elastic_n(MODULUS_PA, 0.0) * slow.left(np.array([0.0, 500.0, 5000.0]))
    assert found_n[2:] == pytest.approx(expected, rel=1e-4)


def test_under_pressure_a_long_hold_ends_at_the_force_of_the_relaxed_modulus() -> None:
    tissue = PronySeries((0.27, 0.33), (0.4, 4.3))
    iop_pa = 1333.0
    found_n = felt_n(tissue, iop_pa, [0.0, 0.5 * RAMP_S, RAMP_S, 3.0, 30.0, 1000.0])
    assert found_n[-1] == pytest.approx(elastic_n(0.4 * MODULUS_PA, iop_pa), rel=1e-4)
    # the pressure's part of the force stays
    assert found_n[-1] > 1.1 * 0.4 * found_n[2]
