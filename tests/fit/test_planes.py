"""One dent in several planes: the contact in three dimensions, against sections that
are cut in three dimensions.
"""

from dataclasses import replace

import numpy as np
import pytest
from analytic_frames import KNOWN, LATERAL_M, LIBRARY, RANGES, tip_of
from scanned_planes import CROSS, PARALLEL, cut_wall

from scleraforce.fit import unknowns
from scleraforce.fit.one_frame import fit_boundaries
from scleraforce.fit.planes_of_a_moment import (
    TILT,
    PlanesFit,
    SeenPlane,
    SpatialPlace,
    _PlanesProblem,
    fit_planes,
)
from scleraforce.fit.prior_of_an_eye import prior_of
from scleraforce.records.scan import Plane
from scleraforce.records.study import Range

UNKNOWN_GAP = replace(RANGES, gap_m=Range(min=0.0, max=1e-3))
PRIOR = prior_of(replace(KNOWN, needle=replace(KNOWN.needle, gap_m=None)), UNKNOWN_GAP)


def seen_planes(
    planes: tuple[Plane, ...], *wall: object, noise_m: float = 0.0
) -> list[SeenPlane]:
    rng = np.random.default_rng(7)
    found = []

    for plane in planes:
        section = cut_wall(plane, *wall)
        depth = np.stack(
            [np.interp(LATERAL_M, *curve.T) for curve in (section.outer, section.inner)]
        )
        depth += noise_m * rng.standard_normal(depth.shape)
        depth[0] -= 3e-6 * unknowns.shining(np.gradient(depth[0], LATERAL_M))
        found.append(
            SeenPlane(plane.offset_m, plane.direction_rad, LATERAL_M, depth, PRIOR)
        )

    return found


# a cross beside the scanner's axis
BESIDE = (
    Plane("low", 0.3e-3, 0.4),
    Plane("high", -0.2e-3, 1.7),
)


@pytest.mark.parametrize(
    "planes", [CROSS, BESIDE, PARALLEL], ids=["cross", "cross beside", "parallel"]
)
@pytest.mark.parametrize(
    ("contact_m", "tilt_rad"),
    [
        ((0.2e-3, -0.45e-3, 0.5e-3), (0.0, 0.0)),
        ((-0.5e-3, 0.1e-3, 0.4e-3), (0.05, -0.03)),
    ],
    ids=["upright", "tilted"],
)
def test_contact_tilt_and_dent_are_found_without_a_gap(planes, contact_m, tilt_rad):
    tip_m = tip_of(0.02)
    fits, place = fit_planes(
        LIBRARY, seen_planes(planes, tip_m, contact_m, tilt_rad, noise_m=3e-6)
    )
    assert place.contact_m[:2] == pytest.approx(
        contact_m[:2], abs=60e-6 if planes is PARALLEL else 20e-6
    )
    assert place.contact_m[2] == pytest.approx(contact_m[2] + tip_m, abs=30e-6)
    assert place.tilt_rad[0] == pytest.approx(
        tilt_rad[0], abs=2e-2 if planes is PARALLEL else 4e-3
    )

    for plane, fit in zip(planes, fits, strict=True):
        across = -np.sin(plane.direction_rad), np.cos(plane.direction_rad)
        gap_m = plane.offset_m - np.dot(across, contact_m[:2])
        assert fit.unknown[unknowns.GAP] == pytest.approx(
            gap_m, abs=60e-6 if planes is PARALLEL else 20e-6
        )
        assert fit.force_n == fits[0].force_n == pytest.approx(0.02, rel=0.02)
        assert fit.misfit_m < 8e-6


def test_a_cross_knows_the_gap_and_the_force_better_than_one_plane():
    planes = seen_planes(CROSS, tip_of(0.012), (0.3e-3, -0.3e-3, 0.5e-3), noise_m=3e-6)
    alone = fit_boundaries(LIBRARY, LATERAL_M, planes[0].depth_bc, PRIOR)
    (first, _), place = fit_planes(LIBRARY, planes)
    assert first.sd[unknowns.GAP] < 0.2 * alone.sd[unknowns.GAP]
    assert np.ptp(first.interval_n) < 0.9 * np.ptp(alone.interval_n)
    assert place.contact_sd_m[0] == pytest.approx(first.sd[unknowns.LATERAL])
    assert place.contact_sd_m[1] == pytest.approx(first.sd[unknowns.GAP])


@pytest.mark.parametrize(
    "planes", [CROSS, BESIDE, PARALLEL], ids=["cross", "cross beside", "parallel"]
)
def test_a_fit_that_starts_from_another_prior_s_ends_where_a_search_does(
    planes,
):
    seen = seen_planes(
        planes, tip_of(0.02), (0.2e-3, -0.45e-3, 0.5e-3), (0.03, -0.02), noise_m=2e-6
    )
    stiffer = replace(KNOWN.eye.modulus, mean_pa=1.2 * KNOWN.eye.modulus.mean_pa)
    prior = prior_of(
        replace(
            KNOWN,
            needle=replace(KNOWN.needle, gap_m=None),
            eye=replace(KNOWN.eye, modulus=stiffer),
        ),
        UNKNOWN_GAP,
    )
    searched, _ = fit_planes(LIBRARY, [replace(one, prior=prior) for one in seen])
    found = PlanesFit(tuple(seen), *fit_planes(LIBRARY, seen)).with_priors(
        LIBRARY, [prior, prior], 0.0
    )
    assert found.fits[0].force_n > 1.05 * 0.02

    for one, other in zip(found.fits, searched, strict=True):
        assert one.force_n == pytest.approx(other.force_n, rel=2e-3)
        assert one.unknown[unknowns.GAP] == pytest.approx(
            other.unknown[unknowns.GAP], abs=3e-6
        )

    assert found.whole.misfit_m == max(fit.misfit_m for fit in found.fits)
    assert found.whole.loss == pytest.approx(
        0.5 * (found.fits[0].loss + found.fits[1].loss)
    )


@pytest.mark.parametrize("planes", [CROSS, PARALLEL], ids=["cross", "parallel"])
def test_the_gradient_is_that_of_the_cost(planes):
    """The weight of a column changes with the wall's slope, which the method leaves
    out.
    """
    seen = seen_planes(
        planes, tip_of(0.015), (0.2e-3, -0.4e-3, 0.5e-3), (0.03, -0.02), noise_m=1e-6
    )
    problem = _PlanesProblem.of(LIBRARY, seen, 0.0)
    alone = [
        fit_boundaries(LIBRARY, one.lateral_m, one.depth_bc, one.prior) for one in seen
    ]
    here = min(problem.starts(alone), key=lambda start: problem.evaluate(start)[1])
    here[TILT] += 0.02
    terms, _ = problem.evaluate(here)
    sd = 1.0 / np.sqrt(np.diag(terms.normal))

    for place in (
        unknowns.TIP,
        unknowns.LATERAL,
        unknowns.DEPTH,
        unknowns.ROTATION,
        unknowns.GAP,
        unknowns.THICKNESS,
        unknowns.INNER_OFFSET,
        TILT,
        TILT + 1,
    ):
        step = np.zeros(len(here))
        step[place] = 0.05 * sd[place]
        ends = [problem.evaluate(here + sign * step)[1] for sign in (-1, 1)]
        slope = -(ends[1] - ends[0]) / (4.0 * step[place]) * sd[place]
        assert slope == pytest.approx(
            terms.gradient[place] * sd[place], rel=0.05, abs=0.2
        )


def test_a_plane_alone_and_one_that_shows_too_little():
    planes = seen_planes(CROSS, tip_of(0.012), (0.0, -0.4e-3, 0.5e-3))
    (only,), place = fit_planes(LIBRARY, planes[:1])
    assert place is None
    assert only.force_n == pytest.approx(0.012, rel=0.05)
    few = replace(planes[1], depth_bc=np.full_like(planes[1].depth_bc, np.nan))
    assert fit_planes(LIBRARY, [planes[0], few]) == ((), None)


@pytest.mark.parametrize(
    ("directions", "tells"), [((0.4, 1.7), True), ((0.0, 0.1), False), ((0.4,), False)]
)
def test_two_planes_that_cross_tell_the_lean_of_a_needle_and_parallel_ones_do_not(
    directions, tells
):
    tilt = 0.05, -0.03
    shaft = np.tan([0.3, -0.2])
    place = SpatialPlace((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), tilt, (0.0, 0.0))
    normal = np.append(np.tan(tilt), 1.0)
    needle = np.append(shaft, 1.0)
    lean = np.arccos(normal @ needle / np.linalg.norm(normal) / np.linalg.norm(needle))
    angles = [
        np.arctan(np.array([np.cos(turn), np.sin(turn)]) @ shaft) for turn in directions
    ]
    found = place.with_shafts(directions, angles).lean_rad
    assert found == (pytest.approx(lean) if tells else None)
