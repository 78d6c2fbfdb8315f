"""Our mechanics beside published theory and measurement: the closed forms, the flat
punch, and the tables.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from figures.pushed_walls import NEEDLE_RADIUS_M as NEEDLE_M, NU, RADIUS_M
from figures.studies.real_tissue import TABLES, pressed
from markdown_tables import lines
from real_tissue.porcine import (
    PunchedEye,
    modulus_by_shell_theory,
    pushed,
    small_load_modulus,
)
from real_tissue.punch import flat_punch_path
from real_tissue.rigidity import mmhg_per_ul, own_mmhg_per_ul
from real_tissue.shells import point, pressure_ratio, shallow, sphere
from real_tissue.walls import bonded_stiffness, disc_wall, fine_meridian, pressed_wall
from scleraforce.base.units import to_si
from scleraforce.mechanics.axisymmetric_wall import (
    AxisymmetricWall,
    EvenWall,
    axisymmetric_path,
)
from scleraforce.mechanics.load_path_tracing import PathEnd, pressurise
from scleraforce.records.globe import sealed_law

PAGE = Path(__file__).parents[2] / "benchmarks" / "real_tissue" / "README.md"
TENSIONS = (0.0, 0.5, 1.0, 2.0, 4.0)


def ratio(tension: float, thickness_m: float) -> float:
    return pressure_ratio(tension, thickness_m, RADIUS_M, NU)


@pytest.mark.parametrize("tension", TENSIONS)
def test_the_integral_over_a_tiny_disc_is_the_point_force_of_vella(
    tension: float,
) -> None:
    thickness_m = 0.2e-3
    pressure = ratio(tension, thickness_m)
    tiny = shallow(thickness_m, RADIUS_M, pressure, 2e-6, NU)
    assert tiny == pytest.approx(point(thickness_m, RADIUS_M, pressure, NU), rel=2e-4)


def test_a_point_force_without_pressure_meets_the_shell_of_reissner() -> None:
    expected = 4.0 * 0.5e-3**2 / (RADIUS_M * np.sqrt(3.0 * (1.0 - NU**2)))
    assert point(0.5e-3, RADIUS_M, 0.0, NU) == pytest.approx(expected)


@pytest.mark.parametrize("thickness_mm", [0.15, 0.25])
@pytest.mark.parametrize("tension", TENSIONS)
def test_thin_walls_are_as_stiff_as_the_closed_form_within_two_percent(
    thickness_mm: float, tension: float
) -> None:
    """The closed form of the whole sphere with shear, of its sizes at rest; of those
    under pressure, 1.2 %.
    """
    thickness_m = 1e-3 * thickness_mm
    pressure = ratio(tension, thickness_m)
    ours = pressed(thickness_m, tension).ours
    assert ours.stiffness_m == pytest.approx(
        sphere(thickness_m, RADIUS_M, pressure, NEEDLE_M, NU), rel=0.021
    )
    under_pressure = sphere(ours.thickness_m, ours.radius_m, pressure, NEEDLE_M, NU)
    assert ours.stiffness_m == pytest.approx(under_pressure, rel=0.012)


@pytest.mark.slow
def test_finer_meshes_change_nothing() -> None:
    thickness_m = 0.25e-3
    pressure = ratio(2.0, thickness_m)
    radius_m = RADIUS_M + 0.5 * thickness_m
    finer = fine_meridian(
        radius_m, thickness_m, NEEDLE_M, inside=12, outside=160, layers=4
    )
    found = pressed_wall(
        disc_wall(finer, NEEDLE_M, NU, symmetric=True), pressure
    ).stiffness_m
    ours = pressed(thickness_m, 2.0).ours.stiffness_m
    assert found == pytest.approx(ours, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("thickness_mm", [0.25, 0.5, 0.8])
def test_the_mesh_of_the_library_is_as_stiff_as_the_fine_one(
    thickness_mm: float,
) -> None:
    """One element below the needle: within 2 % at the outer surface, which sinks in
    below it.
    """
    thickness_m = 1e-3 * thickness_mm
    pressure = ratio(0.5, 1e-3 * thickness_mm)
    even = EvenWall(RADIUS_M, thickness_m, NU, NEEDLE_M)
    path = axisymmetric_path(even, pressure, PathEnd(tips_m=np.array([1e-6, 2e-6])))
    first, second = path.force_ratio_m2[1:] / path.tip_m[1:]
    wall = disc_wall(
        fine_meridian(RADIUS_M, thickness_m, NEEDLE_M), NEEDLE_M, NU, symmetric=False
    )
    assert 2.0 * first - second == pytest.approx(
        pressed_wall(wall, pressure).outer_stiffness_m, rel=0.02
    )


@pytest.mark.slow
def test_a_small_punch_that_touches_with_its_whole_face_is_as_stiff_as_a_disc_that_is_bonded():
    """And before that less, for a flat punch meets a sphere at a point."""
    thickness_m = 1.5e-3
    dents_m = np.linspace(4e-6, 40e-6, 10)
    pressure = ratio(0.5, thickness_m)
    path = flat_punch_path(RADIUS_M, thickness_m, NU, NEEDLE_M, pressure, dents_m)
    mesh = fine_meridian(
        RADIUS_M, thickness_m, NEEDLE_M, inside=10, outside=24, layers=1
    )
    wall = disc_wall(mesh, NEEDLE_M, NU, symmetric=False)
    share = path.slope_m() / bonded_stiffness(wall, pressure, NEEDLE_M)
    assert path.touched[0] < 0.25
    assert share[0] < 0.75
    whole = path.touched == 1.0
    assert whole[-1]
    np.testing.assert_allclose(share[whole], 1.0, atol=0.025)


@pytest.mark.slow
def test_below_the_punch_a_sealed_globe_is_an_open_one_at_its_pressure() -> None:
    size = PunchedEye()
    modulus_pa = 0.3e6
    rigidity = 0.01
    iop = to_si(15.0, "mmhg") / 0.3e6
    dents_m = np.array([0.2e-3, 0.4e-3, 0.6e-3])
    sealed = pushed(modulus_pa, rigidity, size=size, dents_m=dents_m)
    pressure = float(sealed.iop_ratio[-1])
    assert pressure > 1.05 * iop
    mesh = fine_meridian(
        size.radius_m, size.thickness_m, size.punch_m, inside=10, outside=24, layers=1
    )
    wall = AxisymmetricWall(mesh, size.poisson_ratio)
    rise_m = -float(wall.tip @ (pressurise(wall, pressure) - pressurise(wall, iop)))
    assert rise_m > 0.0
    opened = pushed(
        modulus_pa, iop_pa=pressure * modulus_pa, size=size, dents_m=dents_m + rise_m
    )
    assert opened.force_ratio_m2[-1] == pytest.approx(
        sealed.force_ratio_m2[-1], rel=1e-6
    )
    # The law, of the volume that the dent displaces at that pressure: about the punch's
    # area times half the dent.
    displaced = (
        sealed_law(to_si(rigidity, "mmhg13_per_ul"))
        .over(modulus_pa)
        .displaced_m3(iop, pressure)
    )
    assert 0.2 < float(displaced) / (np.pi * size.punch_m**2 * 0.6e-3) < 2.0


def test_shell_theory_gives_the_modulus_that_was_published_for_porcine_sclera() -> None:
    """Leung et al. 2014: 0.13 N/mm are 0.20 +- 0.04 MPa."""
    assert modulus_by_shell_theory(130.0) == pytest.approx(0.20e6, abs=0.015e6)
    assert (
        small_load_modulus(bonded=True)
        < small_load_modulus(bonded=False)
        < modulus_by_shell_theory(130.0)
    )


def test_the_models_own_sphere_is_as_compliant_as_a_thin_balloon() -> None:
    """dP/dV = E t/(2 pi R^4 (1 - nu)) of the middle surface; the volume is that inside,
    thinner by (1 - t/2R)^2.
    """
    thickness_m = 0.1e-3
    modulus_pa = 0.25e6
    middle_m = RADIUS_M - 0.5 * thickness_m
    thin = modulus_pa * thickness_m / (2.0 * np.pi * middle_m**4 * (1.0 - NU))
    found = own_mmhg_per_ul(thickness_m, modulus_pa, 1e-3, half=False)
    assert found == pytest.approx(mmhg_per_ul(thin), rel=0.02)


def cells(table: str) -> list[list[str]]:
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in table.splitlines()
        if line[:1] == "|"
    ]


def alike(first: str, second: str) -> bool:
    """Return True if two cells are equal, up to one unit of the last digit of each
    number.
    """
    number = re.compile(r"[-+]?\d+(?:\.\d+)?")
    if number.sub("#", first) != number.sub("#", second):
        return False

    pairs = zip(number.findall(first), number.findall(second), strict=True)
    return all(
        abs(float(a) - float(b)) <= 1.01 * 10.0 ** -len(a.partition(".")[2])
        for a, b in pairs
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_the_tables_of_the_page_are_recomputed(name: str) -> None:
    head, *found = TABLES[name]()
    made = cells("\n".join(lines(head, found)))
    shown = [
        row
        for row in cells(PAGE.read_text(encoding="utf-8"))
        if len(row) == len(made[0])
    ]

    for row in made:
        assert any(all(map(alike, row, other)) for other in shown), (
            f"{PAGE}: not there, or other: {row}"
        )
