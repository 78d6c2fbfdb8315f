"""Frames of uneven walls as those of even ones: what the eye's form adds is taken off before the filter sees it.

The filter's eye is an even sphere. Where a cornea is in view, or the wall grows thicker along the section, the fit of
the frame (`fitting.library_fit`) says what that adds to the boundaries, whatever E is; small forms stay: they may be
noise.
"""

from dataclasses import replace

import numpy as np

from scleraforce.calibration.eye_model import known_of_constants
from scleraforce.calibration.library_eye import LibraryEye
from scleraforce.fitting.library_fit import NO_WALL_M, fit_boundaries
from scleraforce.fitting.prior import form_size, prior_of
from scleraforce.fitting.resting_form import form_depths
from scleraforce.fitting.unknowns import FORM
from scleraforce.known.eye import Modulus
from scleraforce.segmentation.observations import Boundaries
from scleraforce.study import CalibrationStudy, ReaderStudy

CLEAR = 4.0  # forms that are smaller than so many times their spread are left


def without_form(eye: LibraryEye, boundaries: Boundaries, study: CalibrationStudy) -> Boundaries:
    """Return the boundaries of a frame without what the eye's form adds, where that is clear.

    Args:
        eye: the model.
        boundaries: of the frame.
        study: the prior of the modulus.
    """
    modulus = Modulus(mean_pa=study.prior_mean_pa, sd_pa=study.prior_sd_pa, source="population")
    known = known_of_constants(eye.constants, modulus)
    prior = prior_of(known, ReaderStudy())  # nothing is left for it to say
    fit = fit_boundaries(eye.library, boundaries.lateral_m, boundaries.depth_m, prior, eye.smoothing_m)
    if fit is None or fit.misfit_m > NO_WALL_M or form_size(fit.unknown) < CLEAR:
        return boundaries
    from_contact_m = boundaries.lateral_m - fit.contact_m
    both = (np.full_like(from_contact_m, is_inner) for is_inner in (0.0, 1.0))
    added = [form_depths(fit.unknown[FORM], from_contact_m, is_inner)[0] for is_inner in both]
    return replace(boundaries, depth_m=boundaries.depth_m - np.stack(added))
