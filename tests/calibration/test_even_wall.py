"""A cornea in view is taken off the boundaries before the filter sees them; even walls stay as they are."""

from dataclasses import replace

import numpy as np
import pytest
from analytic_library import analytic_library

from scleraforce.calibration.library_eye import without_form
from scleraforce.learning.virtual_eyes import VirtualEye, calibrated, draw_eye, draw_frames
from scleraforce.learning.walls import Forms
from scleraforce.study import Range, ReaderStudy, Study, fixed

STUDY = Study(
    reader=ReaderStudy(
        uneven_share=0.0, iop_noise_fraction=0.0, thickness_noise_fraction=0.0, gap_noise_fraction=0.0,
        thickness_m=Range(min=500e-6, max=700e-6), iop_pa=Range(min=200.0, max=400.0), lateral_m=fixed(0.0),
    )
)  # fmt: skip
RIGHT = {"curvature": 0.0, "skew": 0.0, "wedge": 0.0, "bow": 0.0, "limbus_m": 3.2e-3, "limbus_rad": 0.3, "soft_m": 3e-4}
OPEN_EYE, FRAMES = 0, 6


@pytest.fixture(scope="module")
def eye() -> VirtualEye:
    library = analytic_library(thicknesses=5, ratios=5, tips=24)
    return draw_eye(STUDY, library, OPEN_EYE, np.random.default_rng(5))


def boundaries(eye: VirtualEye):
    return draw_frames(eye, STUDY, 1, np.random.default_rng(2))[0].boundaries


def test_an_even_wall_stays_as_it_is(eye: VirtualEye) -> None:
    seen = boundaries(eye)
    np.testing.assert_array_equal(without_form(eye.model, seen, STUDY.calibration).depth_m, seen.depth_m)


def test_a_cornea_is_taken_off_both_boundaries_alike(eye: VirtualEye) -> None:
    cornea = replace(eye, forms=Forms(**{name: np.array([value]) for name, value in RIGHT.items()}))
    seen = boundaries(cornea)
    off = seen.depth_m - without_form(eye.model, seen, STUDY.calibration).depth_m
    assert np.nanmin(off) < -0.2e-3  # the cornea lies higher
    np.testing.assert_allclose(off[1], off[0], atol=30e-6)


def test_a_wall_that_grows_thicker_along_the_section_is_so_on_its_inner_boundary_alone(eye: VirtualEye) -> None:
    wedge = 0.03
    seen = boundaries(replace(eye, forms=replace(eye.forms, wedge=np.array([wedge]))))
    off = seen.depth_m - without_form(eye.model, seen, STUDY.calibration).depth_m
    known = np.isfinite(off).all(axis=0)  # the scan does not reach every side
    assert known.mean() > 0.8
    thicker = np.polyfit(seen.lateral_m[known], (off[1] - off[0])[known], 1)[0]
    assert thicker == pytest.approx(wedge, rel=0.1)


@pytest.mark.slow
def test_a_cornea_in_view_hardly_changes_the_modulus(eye: VirtualEye) -> None:
    cornea = replace(eye, forms=Forms(**{name: np.array([value]) for name, value in RIGHT.items()}))
    moduli_pa = []
    for one in (eye, cornea):
        frames = draw_frames(one, STUDY, FRAMES, np.random.default_rng(6))
        known, _ = calibrated(one, frames, STUDY, eye.model.library, np.random.default_rng(7))
        assert known.modulus is not None
        moduli_pa.append(known.modulus.mean_pa)
    assert moduli_pa == pytest.approx([eye.wall.youngs_modulus_pa] * 2, rel=0.05)
