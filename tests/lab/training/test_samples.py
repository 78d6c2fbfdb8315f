"""Samples of the reader: given values mean what they say, and the slice shows its
wall.
"""

from dataclasses import replace

import numpy as np
import pytest
from analytic_library import bulging, made_up_library
from library_arrays import reached_tips

from predicted_walls import Walls, formed_wall
from scleraforce.base.errors import InputError
from scleraforce.fit.unknowns import (
    DEPTH,
    GAP,
    IOP,
    LATERAL,
    MODULUS,
    NAMES,
    POLE,
    THICKNESS,
    TIP,
)
from scleraforce.lab.training.reader_samples import (
    draw_eyes,
    draw_samples,
    library_of_tissue,
)
from scleraforce.library.moving_base import pole_directions
from scleraforce.library.plane_cut import column_laterals, fill_boundaries
from scleraforce.records.study import ReaderStudy, SliceStudy, fixed

READER = ReaderStudy()
SLICE = SliceStudy()


@pytest.fixture(scope="module")
def eyes(library):
    return draw_eyes(library, READER, 20_000, np.random.default_rng(1))


def test_a_given_modulus_is_a_normal_distribution_that_the_eye_is_drawn_from(
    eyes,
):
    known = np.isfinite(eyes.stated.modulus_pa)
    assert abs((~known).mean() - READER.modulus_missing_fraction) < 0.01
    fitted_pa = eyes.stated.modulus_pa.copy()
    # calibrated with the given thickness and IOP
    own = eyes.stated.modulus_sd_fraction < 0.06
    t, p = (
        np.nan_to_num(getattr(eyes.stated, n) / getattr(eyes, n), nan=1.0)
        for n in ("thickness_m", "iop_pa")
    )
    fitted_pa[own] *= (t**2 * p ** (1 / 3))[own]
    error = (eyes.modulus_pa / fitted_pa - 1.0)[
        known
    ] / eyes.stated.modulus_sd_fraction[known]
    sd = eyes.stated.modulus_sd_fraction[known]

    for part in (sd < 0.02, sd > 0.1):
        assert abs(error[part].mean()) < 0.05
        # a normal distribution that ends at 2.5 standard deviations
        assert abs(error[part].std() - 0.96) < 0.05

    low, high = READER.youngs_modulus_pa.bounds
    assert low <= eyes.modulus_pa[~known].min() < eyes.modulus_pa[~known].max() <= high


def test_the_pressure_under_the_needle_solves_the_law_of_the_globe_that_was_drawn(
    eyes, library
):
    some = slice(0, 300)
    resting = eyes.iop_pa[some] / eyes.modulus_pa[some]
    size = eyes.size[some]
    ratio = eyes.iop_ratio[some]
    thickness = eyes.thickness_m[some] / size
    force = eyes.force_n[some] / (eyes.modulus_pa[some] * size**2)
    volume = (
        library.displaced_m3(
            thickness, ratio, reached_tips(library, thickness, ratio, force)
        )
        * size**3
    )
    rate = eyes.rigidity[some] / np.cbrt(eyes.modulus_pa[some])
    assert (ratio < library.iop_ratio_ends(thickness)[1]).all()
    np.testing.assert_allclose(
        ratio, (np.cbrt(resting) + rate * volume) ** 3, rtol=5e-3
    )
    assert (
        ratio[eyes.rigidity[some] == 0.0] == resting[eyes.rigidity[some] == 0.0]
    ).all()


def test_a_mirror_image_is_the_sample_of_the_mirrored_eye(library, monkeypatch):
    bulged = bulging(library)
    plain = replace(
        READER,
        plain_share=0.0,
        uneven_share=0.0,
        boundary_errors=0.0,
        lateral_m=fixed(0.4e-3),
    )
    image = draw_samples(bulged, plain, SLICE, 60, np.random.default_rng(8)).mirrored()

    def draw_mirrored(*arguments):
        eyes = draw_eyes(*arguments)
        stated = replace(eyes.stated, direction_rad=np.pi - eyes.stated.direction_rad)
        turned = {
            "rotation_rad": -eyes.rotation_rad,
            "direction_rad": np.pi - eyes.direction_rad,
        }

        return replace(eyes, stated=stated, **turned)

    monkeypatch.setattr(
        "scleraforce.lab.training.reader_samples.draw_eyes", draw_mirrored
    )
    drawn = draw_samples(
        bulged,
        replace(plain, lateral_m=fixed(-0.4e-3)),
        SLICE,
        60,
        np.random.default_rng(8),
    )
    np.testing.assert_allclose(image.given, drawn.given, atol=1e-6)
    np.testing.assert_array_equal(image.lateral_m, drawn.lateral_m)
    inner = np.s_[:, :, 25:115]  # sides are lost as in a frame
    assert (image.slices == drawn.slices)[inner].mean() > 0.999
    assert (image.slices[:, :, ::-1] == drawn.slices)[inner].mean() < 0.99


def test_without_errors_a_slice_is_what_the_fit_predicts_of_an_eye_beside_the_pole(
    library,
):
    bulged = bulging(library)
    plain = replace(
        READER,
        plain_share=1.0,
        uneven_share=0.0,
        boundary_errors=0.0,
        lateral_m=fixed(0.4e-3),
        surface_depth_m=fixed(0.5e-3),
        polar_angle_rad=fixed(0.7),
        gap_m=fixed(0.6e-3),
    )
    count = 60
    drawn = draw_samples(bulged, plain, SLICE, count, np.random.default_rng(8))
    eyes = draw_eyes(bulged, plain, count, np.random.default_rng(8))
    agreeing = []
    upright = []

    for n in range(count):
        unknown = np.zeros(len(NAMES))
        thickness = eyes.thickness_m[n : n + 1]
        ratio = eyes.iop_ratio[n : n + 1]
        unknown[TIP] = bulged.tips(
            thickness, ratio, eyes.force_n[n : n + 1] / eyes.modulus_pa[n]
        )[0]
        unknown[[LATERAL, DEPTH, GAP, THICKNESS]] = 0.4e-3, 0.5e-3, 0.6e-3, thickness[0]
        unknown[MODULUS] = np.log(eyes.modulus_pa[n])
        unknown[IOP] = np.log(ratio[0] * eyes.modulus_pa[n])

        for pole, shares in (
            (pole_directions(0.7, eyes.direction_rad[n]), agreeing),
            ((0.0, 0.0), upright),
        ):
            unknown[POLE] = pole
            placed = formed_wall(Walls(bulged), unknown)
            depths = np.stack(
                [np.interp(column_laterals(SLICE), *curve.T) for curve in placed]
            )
            expected = fill_boundaries(depths[None], SLICE)[0]
            shares.append(
                (expected[1:38, 25:115] == drawn.slices[n][1:38, 25:115]).mean()
            )

    assert np.median(agreeing) > 0.99
    assert np.mean(agreeing) > np.mean(upright) + 0.01


def test_a_library_without_eyes_of_the_study_is_refused(library):
    with pytest.raises(InputError, match="hardly any eye"):
        draw_eyes(
            library,
            replace(READER, thickness_m=fixed(1.1e-3)),
            10,
            np.random.default_rng(0),
        )


def test_the_stiffest_tissue_is_the_librarys_which_may_have_no_other(library):
    rng = np.random.default_rng(4)
    always = replace(READER, stiffening_share=1.0)

    for most in (10.0, 30.0, 33.0):
        held = made_up_library(most)
        assert max(
            library_of_tissue(held, always, rng).stiffening for _ in range(60)
        ) == pytest.approx(most, rel=1e-12)

    never = replace(READER, stiffening_share=0.0)
    assert all(library_of_tissue(library, always, rng) is library for _ in range(20))
    assert all(library_of_tissue(held, never, rng) is held for _ in range(20))
