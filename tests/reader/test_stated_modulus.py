"""A stated modulus is not one that was fitted to frames of the eye: its intervals are wider."""

from dataclasses import replace

import numpy as np
import pytest

from scleraforce.calibration.eye_model import known_of_constants
from scleraforce.errors import CalibrationError
from scleraforce.known import STATED_MODULUS_SD, Modulus
from scleraforce.learning.virtual_eyes import draw_eye, draw_frames
from scleraforce.library.fit import fit_boundaries
from scleraforce.library.prior import prior_of
from scleraforce.reader.answer import fit_reading
from scleraforce.reader.intervals import score
from scleraforce.reader.model import load_force_reader

EYES, FRAMES = range(60, 90), 8


@pytest.mark.slow
@pytest.mark.long
def test_intervals_of_eyes_with_a_stated_modulus_hold() -> None:
    """With the factors of eyes that were calibrated, 60 % of these intervals held."""
    reader = load_force_reader("default")
    study, held = reader.study, dict[str, list[float]](stated=[], own=[])
    for number in EYES:
        rng = np.random.default_rng([77, number])
        try:
            eye = draw_eye(study, reader.library, number, rng)
        except CalibrationError:
            continue
        frames = draw_frames(eye, study, FRAMES, rng)
        stated_pa = eye.wall.youngs_modulus_pa * (1.0 + STATED_MODULUS_SD * rng.standard_normal())
        known = replace(
            known_of_constants(eye.stated, Modulus.stated(stated_pa)), stiffening=eye.model.library.stiffening
        )
        library = reader.library.for_stiffening(eye.model.library.stiffening).for_contact(eye.wall.polar_rad)
        prior, smoothing_m = prior_of(known, study.reader), study.calibration.surface_smoothing_m
        seen = [frame.boundaries for frame in frames]
        fits = [fit_boundaries(library, each.lateral_m, each.depth_m, prior, smoothing_m) for each in seen]
        for source, shares in held.items():
            other = replace(known, modulus=replace(Modulus.stated(stated_pa), source=source))
            scores = [
                score(fit_reading(fit, study.classes.bounds_n, reader.factors.of_fit(other, fit)), frame.force_n)
                for fit, frame in zip(fits, frames, strict=True)
                if fit is not None
            ]
            shares.append(float(np.mean(np.array(scores) <= 1.0)))
    assert np.mean(held["stated"]) > 0.85
    assert np.mean(held["own"]) < 0.75
