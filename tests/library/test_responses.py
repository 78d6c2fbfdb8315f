"""Interpolation of the library, on an eye with a closed form."""

from dataclasses import replace

import numpy as np
import pytest
from analytic_library import (
    analytic_library,
    curves,
    displaced_m3,
    draw_walls,
    force_ratio,
    with_walls,
)

from scleraforce.base.errors import InputError
from scleraforce.library.sealed_eye import iop_ratio_at_dent
from scleraforce.library.wall_responses import CONTACTS
from scleraforce.records.globe import CONSTANT_PRESSURE, PressureLaw
from scleraforce.records.study_of_eye import RIGIDITY_LAWS


@pytest.fixture(scope="module")
def library():
    return analytic_library()


def test_shapes_and_forces_at_the_nodes_and_between_them(library):
    nodes = np.stack(
        [
            array.ravel()
            for array in np.meshgrid(
                library.thickness_m, library.tension, library.tip_m
            )
        ]
    )
    t, tension, d = nodes[:, ::29]
    p = tension * t / library.radius_m
    found = library.at_tip(t, p, d)
    assert found.curves_sbnc == pytest.approx(curves(t, p, d), abs=5e-9)
    assert found.force_ratio == pytest.approx(force_ratio(t, p, d), abs=1e-15)
    rng = np.random.default_rng(0)
    state = *draw_walls(rng, 500), rng.uniform(0.0, 7.5e-3, 500)
    found = library.at_tip(*state)
    assert np.abs(found.curves_sbnc - curves(*state)).max() < 2e-6
    assert found.force_ratio == pytest.approx(force_ratio(*state), rel=5e-3, abs=1e-11)
    assert library.displaced_m3(*state) == pytest.approx(displaced_m3(*state), rel=1e-3)


@pytest.mark.parametrize("axis", ["thicknesses", "ratios", "tips"])
def test_a_finer_grid_gains_at_least_the_third_order(axis):
    rng = np.random.default_rng(1)
    t, p = draw_walls(rng, 300)
    tip = rng.uniform(0.0, 7.5e-3, 300)

    if axis != "ratios":
        # nodes: no other error than that of the axis
        p = rng.choice([1e-3, 0.21], 300) * t / 12e-3

    def error(count):
        fine = {"thicknesses": 24, "ratios": 24, "tips": 160} | {axis: count}
        found = analytic_library(**fine, nodes=5).at_tip(t, p, tip)
        return np.abs(found.force_ratio - force_ratio(t, p, tip)).max()

    coarse = {"thicknesses": 4, "ratios": 4, "tips": 12}[axis]
    assert error(coarse) / error(2 * coarse - 1) > 6.0


def test_a_force_gives_the_tip_that_carries_it_first(library):
    rng = np.random.default_rng(2)
    t, p = draw_walls(rng, 300)
    wanted = rng.uniform(0.0, 0.999, 300) * library.largest_force_ratio(t, p)
    found = library.curves(t, p, wanted)
    fine = np.linspace(0.0, 7.5e-3, 20_001)
    first = np.array(
        [
            fine[np.argmax(force_ratio(*row[:2], fine) >= row[2])]
            for row in zip(t, p, wanted, strict=True)
        ]
    )
    softens = np.array(
        [
            (np.diff(force_ratio(*wall, fine)) < 0.0).any()
            for wall in zip(t, p, strict=True)
        ]
    )
    assert 30 < softens.sum() < 270
    off = np.abs(found.tip_m - first)
    assert np.percentile(off, 95) < 8e-6
    assert library.at_tip(t, p, found.tip_m).force_ratio == pytest.approx(
        wanted, abs=1e-13
    )
    assert found.curves_sbnc[:, 0, 0, 1] == pytest.approx(
        curves(t, p, found.tip_m)[:, 0, 0, 1], abs=1e-6
    )


BURST = (
    "IOP/E: 0.07 is outside the library's range for a wall of 500 µm, 4.17e-05 to"
    " 0.00875; it bursts at 0.0173"
)


@pytest.mark.parametrize(
    ("state", "said"),
    [
        ((0.2e-3, 1e-3, 1e-8), "thickness: 200 µm is outside .*, 350 to 900 µm"),
        ((0.5e-3, 7e-2, 1e-8), BURST),
        ((0.5e-3, 1e-3, 6e-7), r"F/E: 0\.6 mm\^2 is outside .*, 0 to 0\.5 mm\^2"),
        ((0.5e-3, np.nan, 1e-8), "IOP/E: nan"),
        ((0.35e-3, 8e-5, 3e-7), r"F/E: 0\.3 mm\^2 dents .* by more than .* 7\.5 mm"),
    ],
)
def test_a_state_outside_is_named_and_not_covered(library, state, said):
    good = [0.5e-3, 1e-3, 1e-8]
    samples = np.array([good, state, good]).T
    with pytest.raises(InputError, match=said):
        library.curves(*samples)

    assert library.covers(*samples).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda one: {"tip_m": one.tip_m[:-1]}, "of the axes"),
        (lambda one: {"tip_m": one.tip_m[::-1]}, "increase"),
        (lambda one: {"thickness_m": one.thickness_m[:3]}, "at least 4"),
    ],
)
def test_axes_that_do_not_fit_a_library_are_refused(library, change, said):
    with pytest.raises(InputError, match=said):
        replace(library, **change(library))


def test_a_force_that_is_not_finite_is_refused(library):
    broken = library.walls.force_ratio_btpd.copy()
    broken[0, 2, 2, 2] = np.inf
    with pytest.raises(InputError, match="not finite"):
        with_walls(library, force_ratio_btpd=broken)


@pytest.mark.parametrize("law", RIGIDITY_LAWS)
def test_the_pressure_of_a_sealed_globe_is_the_lowest_that_solves_its_law(library, law):
    rng = np.random.default_rng(6)
    t, p = draw_walls(rng, 150)
    tip = rng.uniform(0.0, 3e-3, 150)
    globe = PressureLaw(law, np.exp(rng.uniform(*np.log([1e5, 1e8]), 150)))
    found = iop_ratio_at_dent(library, t, p, tip, globe)
    ratios = np.geomspace(1e-3, 0.21, 20_001)[:, None] * t / library.radius_m
    missing = (
        globe.level(ratios) - globe.level(p) - globe.rate * displaced_m3(t, ratios, tip)
    )
    first = np.where(
        (missing >= 0.0).any(axis=0),
        ratios[np.argmax(missing >= 0.0, axis=0), np.arange(150)],
        np.nan,
    )
    assert 15 < np.isfinite(first).sum() < 135
    # Where the law is met only just, or just not, either may be.
    close = np.isfinite(found) & np.isfinite(first)
    assert (np.isfinite(found) != np.isfinite(first)).sum() <= 2
    off = np.abs(found[close] / first[close] - 1.0)
    assert np.quantile(off, 0.95) < 1e-3
    # where the pressure is about to run away, a small error of the volume moves it far
    assert off.max() < 0.03
    assert (found[close] >= p[close] * (1.0 - 1e-9)).all()


def test_an_open_globe_keeps_its_pressure_and_so_does_one_without_a_dent(library):
    t, p = draw_walls(np.random.default_rng(7), 20)
    assert np.array_equal(
        iop_ratio_at_dent(library, t, p, np.full(20, 1e-3), CONSTANT_PRESSURE), p
    )
    assert iop_ratio_at_dent(
        library, t, p, np.zeros(20), PressureLaw(rate=1e6)
    ) == pytest.approx(p, rel=1e-4)

    with pytest.raises(InputError, match=r"tip: 8 mm is outside"):
        iop_ratio_at_dent(library, t, p, np.full(20, 8e-3), CONSTANT_PRESSURE)


WALL = {"thickness_m": 0.6e-3, "youngs_modulus_pa": 0.3e6, "iop_pa": 300.0}


@pytest.mark.parametrize("rigidity", [0.0, 3e8])
def test_an_eye_answers_with_the_force_of_a_dent_and_the_dent_of_a_force(
    library, rigidity
):
    eye = library.eye(**WALL, rigidity_pa13_per_m3=rigidity, polar_angle_rad=0.0)
    forces_n = np.linspace(0.0, eye.max_force_n, 40).reshape(5, 8)
    dents_m = eye.dent_m(forces_n)
    assert dents_m.shape == (5, 8)
    assert (np.diff(dents_m.ravel()) > 0.0).all()
    assert eye.force_n(dents_m) == pytest.approx(forces_n, rel=1e-3)
    assert eye.dent_m(float(forces_n[2, 3])) == pytest.approx(dents_m[2, 3])
    ratio = eye.pressure_pa(dents_m) / 0.3e6
    assert eye.force_n(dents_m) == pytest.approx(
        0.3e6 * force_ratio(0.6e-3, ratio, dents_m), rel=5e-3, abs=1e-6
    )
    rise_pa13 = rigidity * displaced_m3(0.6e-3, ratio, dents_m)
    assert np.cbrt(eye.pressure_pa(dents_m)) == pytest.approx(
        np.cbrt(300.0) + rise_pa13, rel=1e-3
    )

    for answer, value in (
        (eye.force_n, 7.6e-3),
        (eye.dent_m, 1.01 * eye.max_force_n),
        (eye.dent_m, -1e-3),
    ):
        with pytest.raises(InputError, match="is outside this eye's range, 0 to "):
            answer(value)


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"thickness_m": 0.2e-3}, "thickness: 200 µm"),
        ({"iop_pa": 9e4}, "IOP/E: 0.3 is"),
        ({"polar_angle_rad": 1.0}, "polar angle: 57.3 deg is outside"),
        ({"stiffening": 3.0}, "stiffening"),
    ],
    ids=str,
)
def test_an_eye_outside_the_library_is_refused(library, fault, said):
    with pytest.raises(InputError, match=said):
        library.eye(**WALL | fault)


def test_the_tables_of_a_contact_are_made_once():
    library = analytic_library(thicknesses=4, ratios=4, tips=5)
    beside = library.for_contact(0.3)
    assert library.for_contact(0.3) is beside
    assert library.for_contact(0.2).contact_polar_rad == 0.2
    for number in range(2 * CONTACTS):
        library.for_contact(0.01 * number)
    assert library.for_contact(0.3) is not beside
