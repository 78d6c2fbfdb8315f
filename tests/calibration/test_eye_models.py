"""Sections of linear walls."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from reference_walls import cut_section
from scleraforce.calibration.filter import eye_filter
from scleraforce.calibration.filter.eye_parameters import stated_wall
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane
from scleraforce.records.eye import Eye
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import MeshStudy
from virtual_eyes import changed, wall_of

ASIDE = Setup(
    eye=Eye(iop_pa=266.0, thickness_m=0.7e-3, globe=OPEN),
    needle=Needle(gap_m=0.5e-3, polar_rad=radians(35)),
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("direction", "tilt", "force_n", "stated_m"),
    [
        (0.0, 0.0, 0.03, 0.7e-3),
        (0.5, 0.0, 0.05, 0.7e-3),
        (0.3, 0.05, 0.03, 0.7e-3),
        # between the thicknesses of walls whose thickness is uncertain
        (0.0, 0.0, 0.03, 0.65e-3),
    ],
)
def test_predicted_section_is_the_cut_through_the_deformed_mesh(
    laboratory, direction: float, tilt: float, force_n: float, stated_m: float
):
    finer = replace(laboratory.study, mesh=MeshStudy(divisions=6))
    laboratory = replace(laboratory, study=finer)
    constants = changed(ASIDE, direction_rad=direction, tilt_rad=tilt)
    stated = changed(constants, thickness_m=stated_m)
    parameters = ("e",) if stated_m == 0.7e-3 else ("e", "thickness")
    model = eye_filter.begin(laboratory.study, stated, parameters).filter.model
    wall = laboratory.wall(0.7e-3)
    contact = Contact(polar_rad=wall_of(constants).polar_rad)
    displacement = wall.displacement(
        wall.needle_cnc([contact], 0.35e-3)[0],
        force_n,
        youngs_modulus_pa=0.27e6,
        iop_pa=266.0,
        density_kg_m3=1100.0,
    )
    cut = cut_section(
        wall.mesh,
        ScanPlane(contact, gap_m=0.5e-3, direction_rad=direction, tilt_rad=tilt),
        displacement,
    )
    state = stated_wall(constants, 0.27e6, force_n, contact.polar_rad)
    ((outer, inner),) = replace(model, smoothing_m=0.0).curves([state])
    at = np.linspace(-6.5e-3, 6.5e-3, 300)

    for mine, other in ((outer, cut.outer), (inner, cut.inner)):
        difference = np.interp(at, *mine.T) - np.interp(at, *other.T)
        assert np.abs(difference).max() < 10e-6
