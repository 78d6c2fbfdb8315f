"""What a contact beside the pole rises under the pressure, and what its dent displaces (Maxwell's reciprocity)."""

from dataclasses import replace

import numpy as np
import pytest
from analytic_library import RADIUS_M, analytic_library

from scleraforce.library.base import contact_rises, rise_slope
from scleraforce.mechanics.axisymmetric import axisymmetric_path
from scleraforce.mechanics.meridian import MeridianSize

NU, NEEDLE_M = 0.45, 0.35e-3


def moved_half_spheres(grown_tp: np.ndarray, lifted_tp: np.ndarray) -> np.ndarray:
    """Curves (t, p, 1, n, 2) of half-spheres that grow and are lifted, both in m."""
    angle = np.linspace(0.0, np.pi / 2, 121)
    radius = RADIUS_M + grown_tp[..., None]
    curves = np.stack([radius * np.sin(angle), RADIUS_M - radius * np.cos(angle) - lifted_tp[..., None]], axis=-1)
    return curves[:, :, None].astype(np.float32)


def test_the_rise_is_the_motion_along_the_contact_s_normal() -> None:
    grown, lifted = 1e-4 * np.array([[0.0, 1.0, 2.0]]), 1e-4 * np.array([[0.0, 0.5, 3.0]])
    polar = np.radians([0.0, 20.0, 55.0])
    rises = contact_rises(moved_half_spheres(grown, lifted), polar, RADIUS_M)
    np.testing.assert_allclose(rises, grown + lifted * np.cos(polar)[:, None, None], atol=2e-9)


def test_the_slope_is_the_derivative_by_the_pressure() -> None:
    tension, thinness = np.geomspace(2e-4, 0.3, 16), np.array([0.03, 0.07])
    ratio = tension * thinness[:, None]
    slope = rise_slope(5e-3 * ratio + 40.0 * ratio**2, thinness, tension)
    np.testing.assert_allclose(slope, 5e-3 + 80.0 * ratio, rtol=7e-3)


def test_a_contact_on_the_pole_displaces_what_is_stored_and_one_beside_it_what_its_rise_says() -> None:
    library, tips = analytic_library(nodes=41), np.linspace(1e-4, 3e-3, 7)
    walls = np.full(7, 0.6e-3), np.full(7, 8e-4)
    pole, beside = library.for_contact(0.0), library.for_contact(0.6)
    rise = contact_rises(library.undented_tpbnc, np.zeros(1), RADIUS_M)[0]  # the same at all angles
    slope = rise_slope(rise, library.thickness_m / RADIUS_M, library.tension)
    at = np.interp(8e-4 * RADIUS_M / 0.6e-3, library.tension, slope[4])
    more = (beside.forces(*walls, tips) - pole.forces(*walls, tips)) * at
    found = beside.displaced_m3(*walls, tips) - pole.displaced_m3(*walls, tips)
    np.testing.assert_allclose(found, more, rtol=0.1)
    assert (found > 0.0).all()


def test_a_contact_that_rises_less_displaces_less() -> None:
    library = analytic_library(nodes=41)
    undented = library.undented_tpbnc.copy()
    angle = np.arctan2(undented[0, 0, 0, :, 0], RADIUS_M - undented[0, 0, 0, :, 1])
    undented[..., 1] -= 6e-3 * library.tension[:, None, None] * np.cos(angle) ** 2  # the middle rises most
    bulging = replace(library, undented_tpbnc=undented)
    at = np.array([0.6e-3]), np.array([8e-4]), np.array([1e-3])
    fewer = [other.for_contact(0.6).displaced_m3(*at)[0] for other in (library, bulging)]
    # Rises of 6 mm times the tension: along the pole's normal, and along the contact's by cos^3.
    per_ratio = 6e-3 * RADIUS_M / 0.6e-3
    force, beside = (library.for_contact(polar).forces(*at)[0] for polar in (0.0, 0.6))
    expected = per_ratio * (beside * np.cos(0.6) ** 3 - force)
    assert fewer[1] - fewer[0] == pytest.approx(expected, rel=0.02)
    assert expected < 0.0


@pytest.mark.parametrize("iop_ratio", [5e-4, 5e-3])
def test_what_a_dent_displaces_is_the_force_times_the_rise_and_the_work_s_slope_by_the_pressure(
    iop_ratio: float,
) -> None:
    """The identity behind `contact_rise`, on the pole, where everything is known: dV = F w' + d/dp (work)."""
    step, tips = 0.02, np.linspace(0.05e-3, 1.5e-3, 30)
    paths = [
        axisymmetric_path(
            RADIUS_M, 0.55e-3, NU, NEEDLE_M, iop_ratio * (1 + share), tips_m=tips, size=MeridianSize(48, 1)
        )
        for share in (-step, 0.0, step)
    ]
    rise = [-float(path.curves_sbnc[0, 0, 0, 1]) for path in paths]
    work = [np.trapezoid(path.force_ratio_m2, path.tip_m) for path in paths]
    change = 2 * step * iop_ratio
    expected = paths[1].force_ratio_m2[-1] * (rise[2] - rise[0]) / change + (work[2] - work[0]) / change
    # The force is spread over the needle's end, the dent is that of its middle: the identity is of the mean.
    assert paths[1].displaced_m3[-1] == pytest.approx(expected, rel=0.02)
