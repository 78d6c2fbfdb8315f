"""Sections of linear eyes."""

from dataclasses import replace
from math import radians
from typing import Any

import numpy as np
import pytest

from reference_walls import cut_section
from scleraforce.calibration.eye_model import EyeConstants, lagrange, stated_wall
from scleraforce.calibration.registration import parameter_sections
from scleraforce.mechanics.contact import Contact, ScanPlane

STATED = EyeConstants(iop_pa=266.0, thickness_m=0.7e-3, gap_m=0.5e-3, polar_rad=radians(35), polar_sd_rad=0.0)


@pytest.mark.slow
@pytest.mark.parametrize(("direction", "tilt", "force_n"), [(0.0, 0.0, 0.03), (0.5, 0.0, 0.05), (0.3, 0.05, 0.03)])
def test_predicted_section_is_the_cut_through_the_deformed_mesh(
    laboratory: Any, direction: float, tilt: float, force_n: float
) -> None:
    constants = replace(STATED, direction_rad=direction, tilt_rad=tilt)
    model, wall = laboratory.model(constants), laboratory.wall(0.7e-3)
    contact = Contact(polar_rad=constants.polar_rad)
    displacement = wall.displacement(
        wall.needle_cnc([contact], 0.35e-3)[0], force_n, youngs_modulus_pa=0.27e6, iop_pa=266.0, density_kg_m3=1100.0
    )
    cut = cut_section(wall.mesh, ScanPlane(contact, gap_m=0.5e-3, direction_rad=direction, tilt_rad=tilt), displacement)
    state = stated_wall(constants, 0.27e6, force_n, contact.polar_rad)
    ((outer, inner),) = replace(model, smoothing_m=0.0).curves([state])
    at = np.linspace(-6.5e-3, 6.5e-3, 300)
    for mine, other in ((outer, cut.outer), (inner, cut.inner)):
        difference = np.interp(at, *mine.T) - np.interp(at, *other.T)
        assert np.abs(difference).max() < 10e-6


def test_only_the_ratio_of_loads_to_modulus_counts(laboratory: Any) -> None:
    model = laboratory.model(STATED)
    wall = replace(stated_wall(STATED, 0.2e6, 0.02, STATED.polar_rad), iop_pa=200.0)
    one = model.curves([wall])
    heavier = replace(model, weight_pa_m=2 * model.weight_pa_m)
    other = heavier.curves([replace(wall, youngs_modulus_pa=0.4e6, force_n=0.04, iop_pa=400.0)])
    np.testing.assert_allclose(one, other, atol=1e-15)


def test_a_larger_gap_moves_the_section_away_from_the_dent(laboratory: Any) -> None:
    model = laboratory.model(STATED)
    values = np.array([[0.2e6, 0.4e-3], [0.2e6, 0.7e-3]])
    near, far = parameter_sections(model, ("youngs_modulus_pa", "gap_m"), values, 0.03, radians(35))
    at = np.array([-0.2e-3, 0.0, 0.2e-3])
    assert (np.interp(at, *near[0].T) > np.interp(at, *far[0].T) + 20e-6).all()


@pytest.mark.slow
def test_responses_between_thicknesses_are_those_of_a_wall_of_that_thickness(laboratory: Any) -> None:
    stated = replace(STATED, polar_rad=0.6)
    uncertain = laboratory.model(replace(stated, thickness_m=0.65e-3), thickness_uncertain=True)
    exact = laboratory.model(stated)
    names = ("youngs_modulus_pa", "thickness_m")
    between = parameter_sections(uncertain, names, np.array([[0.27e6, 0.7e-3]]), 0.03, 0.6)[0]
    true = parameter_sections(exact, names[:1], np.array([[0.27e6]]), 0.03, 0.6)[0]
    at = np.linspace(-6e-3, 6e-3, 200)
    for boundary in (0, 1):
        np.testing.assert_allclose(np.interp(at, *between[boundary].T), np.interp(at, *true[boundary].T), atol=2e-6)


def test_lagrange_weights_reproduce_a_parabola() -> None:
    nodes = (1.0, 2.0, 4.0)
    assert lagrange(nodes, 3.0) @ np.square(nodes) == pytest.approx(9.0)
