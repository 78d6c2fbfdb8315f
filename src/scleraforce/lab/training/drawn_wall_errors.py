"""The look of drawn walls: uneven forms, and the errors of a segmentation (NumPy and
SciPy only).

A form at rest is added to the dented wall unchanged. The errors imitate the errors that
`python -m figures boundary-errors` measures on rendered frames. No boundary is found
in columns that the scan does not reach at the sides, nor where the surface leaves the
frame.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import convolution_matrix

from scleraforce.base.arrays import Flags, Floats
from scleraforce.fit.prior_of_an_eye import SHINE_MEAN_M, SHINE_SD_M
from scleraforce.fit.unknowns import shining
from scleraforce.library import INNER, OUTER
from scleraforce.records.study import SliceStudy

# Relative, of the curvature: semi-axes within 6 % of the radius (sd 3.5 %) turn it
# along a section by sqrt(5) as much.
CURVATURE_SD = 0.08
SKEW_SD = 0.05
CORNEA_RADIUS_M = 7.8e-3
LIMBUS_M = (2e-3, 6e-3)
LIMBUS_SHARE = 0.3
# Spheres of 12 and 7.8 mm that meet at a ring of 5.5 to 6 mm radius make 0.31 to 0.35
# rad; real eyes are smoother.
LIMBUS_RAD = (0.05, 0.36)
SOFT_M = (0.2e-3, 0.6e-3)
# Relative, of the thickness, a radian from the contact and by the square of the angle:
# waves of 12 % along the globe.
WEDGE_SD = 0.12
BOW_SD = 0.12


@dataclass(frozen=True, kw_only=True)
class WallForms:
    """Forms of walls, each (sample,).

    `curvature` and `skew`, 1/m: the surface's additional curvature, on both sides and
    to the right (to the left less). `limbus_m`: start of the cornea, from the contact;
    negative to the left, far away if it is not in view. `limbus_rad`: turn of the
    surface there, softly over `soft_m`. `wedge` and `bow`: growth of the thickness, m a
    metre along the section and m a square metre.
    """

    curvature: Floats
    skew: Floats
    limbus_m: Floats
    limbus_rad: Floats
    soft_m: Floats
    wedge: Floats
    bow: Floats


def draw_forms(
    thickness_m: Floats, radius_m: Floats, uneven: Flags, rng: np.random.Generator
) -> WallForms:
    """Draw forms (sample,): even spheres, but for the `uneven` ones."""
    count = len(thickness_m)
    numbers = rng.standard_normal((4, count)) * uneven
    side = rng.choice([-1.0, 1.0], count)
    in_view = uneven & (rng.random(count) < LIMBUS_SHARE)

    return WallForms(
        curvature=CURVATURE_SD * numbers[0] / radius_m,
        skew=SKEW_SD * numbers[1] / radius_m,
        limbus_m=side * np.where(in_view, rng.uniform(*LIMBUS_M, count), radius_m),
        limbus_rad=in_view * rng.uniform(*LIMBUS_RAD, count),
        soft_m=rng.uniform(*SOFT_M, count),
        wedge=WEDGE_SD * numbers[2] * thickness_m / radius_m,
        bow=BOW_SD * numbers[3] * thickness_m / radius_m**2,
    )


def added_depths(forms: WallForms, radius_m: Floats, from_contact_m: Floats) -> Floats:
    """Return the depths that forms add to boundaries (sample, boundary, column), m, by
    distances from the contact.
    """
    s = from_contact_m
    column = {name: values[:, None] for name, values in vars(forms).items()}
    outer = 0.5 * (column["curvature"] + column["skew"] * np.sign(s)) * s**2
    beyond_m = np.sign(column["limbus_m"]) * s - np.abs(column["limbus_m"])
    ramp_m = 0.5 * (beyond_m + np.sqrt(beyond_m**2 + column["soft_m"] ** 2))
    cornea = (column["limbus_rad"] > 0.0) * (
        1.0 / CORNEA_RADIUS_M - 1.0 / radius_m[:, None]
    )
    outer += (0.5 * cornea * ramp_m - np.tan(column["limbus_rad"])) * ramp_m
    depths = np.repeat(outer[:, None], 2, axis=1)
    depths[:, INNER] += column["wedge"] * s + column["bow"] * s**2

    return depths


@dataclass(frozen=True, kw_only=True)
class BoundaryErrors:
    """Sizes of the errors; lengths along the columns are standard deviations of the
    Gaussians that smooth noise.
    """

    surface_smoothing_m: float = 0.18e-3
    # a surface that faces the light is seen too high, in the mean
    shine_m: float = SHINE_MEAN_M
    shine_sd_m: float = SHINE_SD_M  # ... from frame to frame
    outer_sd_m: float = 1.7e-6
    # of two parts of equal size
    outer_lengths_m: tuple[float, float] = (
        0.16e-3,
        0.2e-3,
    )
    thickness_scale_sd: float = 6e-3  # of a frame's thickness, relative
    thickness_sd_m: float = 2.1e-6  # on a flat surface
    thickness_lengths_m: tuple[float, float] = (0.3e-3, 1.2e-3)
    # slope at which the thickness's error is twice that on a flat surface
    steep: float = 0.27
    # of the errors' sizes from frame to frame: standard deviation of the logarithm
    spread: float = 0.35
    bumps: float = 0.4  # mean number in a frame
    bump_m: float = 0.1e-3  # mean size
    bump_length_m: float = 0.25e-3
    bump_slope: float = 0.4  # of the surface there, at least
    layer_share: float = 0.015  # of the frames take the layer below for wall
    # least and largest thickness of that
    layer_m: tuple[float, float] = (
        0.1e-3,
        0.25e-3,
    )
    # least and largest length over the slice's width
    layer_stretch: tuple[float, float] = (
        0.3,
        1.5,
    )
    side_loss_share: float = 0.3  # of the sides loses columns
    side_loss_m: float = 0.3e-3  # mean width
    # a surface less than this above the lower edge is seen at this depth
    bottom_m: float = 0.055e-3
    bottom_knee_m: float = 0.02e-3  # ... softly
    # mean depth below it from where on a surface is not found at all
    bottom_reach_m: float = 0.08e-3
    top_m: float = 0.03e-3  # a surface less than this below the upper edge is not found


USUAL = BoundaryErrors()  # of this project's segmentation


def disturb(
    depth_sbc: Floats,
    study: SliceStudy,
    rng: np.random.Generator,
    errors: BoundaryErrors = USUAL,
    scale: float = 1.0,
) -> Floats:
    """Return boundaries as a segmentation might have found them, NaN in columns without
    a found wall.

    `depth_sbc` are m below the frame's upper edge, NaN without wall. `scale` multiplies
    the errors of surface, thickness and scale, and the numbers of bumps and layers.
    """
    known: Flags = np.all(np.isfinite(depth_sbc), axis=1)
    outer = _filled(depth_sbc[:, OUTER], known)
    thickness = _filled(depth_sbc[:, INNER], known) - outer
    slope = np.abs(np.gradient(outer, study.pixel_m, axis=1))
    size = scale * np.exp(errors.spread * rng.standard_normal((len(outer), 2, 1)))
    seen = outer @ _smoothing(study.columns, errors.surface_smoothing_m / study.pixel_m)
    seen += (
        size[:, 0]
        * errors.outer_sd_m
        * _noise(outer.shape, errors.outer_lengths_m, study, rng)
    )
    shine = np.maximum(
        errors.shine_m + errors.shine_sd_m * rng.standard_normal((len(outer), 1)), 0.0
    ) * shining(slope)
    seen -= shine
    growing = errors.thickness_sd_m * (1.0 + (slope / errors.steep) ** 2)
    thickness = thickness * (
        1.0 + scale * errors.thickness_scale_sd * rng.standard_normal((len(outer), 1))
    )
    thickness += (
        size[:, 1]
        * growing
        * _noise(outer.shape, errors.thickness_lengths_m, study, rng)
    )
    thickness += (
        shine
        + _bumps(slope, errors, scale, study, rng)
        + _layers(outer.shape, errors, scale, rng)
    )
    found = known & _within_sides(outer.shape, errors, study, rng)
    below_m = seen - (study.rows * study.pixel_m - errors.bottom_m)
    found &= (seen > errors.top_m) & (
        below_m < rng.exponential(errors.bottom_reach_m, (len(outer), 1))
    )
    seen -= errors.bottom_knee_m * np.logaddexp(0.0, below_m / errors.bottom_knee_m)
    both = np.stack([seen, seen + np.maximum(thickness, 0.0)], axis=1)
    both[~np.broadcast_to(found[:, None], both.shape)] = np.nan

    return both


def _filled(values: Floats, known: Flags) -> Floats:
    """Return values with unknown columns filled from the nearest known one to the left,
    else to the right; else 0.
    """
    column = np.arange(values.shape[1])
    left = np.maximum.accumulate(np.where(known, column, -1), axis=1)
    right = np.minimum.accumulate(
        np.where(known, column, values.shape[1])[:, ::-1], axis=1
    )[:, ::-1]
    nearest = np.where(left >= 0, left, np.minimum(right, values.shape[1] - 1))

    return np.nan_to_num(np.take_along_axis(values, nearest, axis=1))


@lru_cache(maxsize=16)
def _smoothing(columns: int, length: float) -> Floats:
    """Return the matrix (column, column) that smooths rows by a Gaussian, carried on
    straight at both ends.
    """
    reach = int(np.ceil(4.0 * length))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / length) ** 2)
    matrix = np.zeros((columns, columns))
    target = np.arange(columns)

    for offset, weight in zip(
        range(-reach, reach + 1), kernel / kernel.sum(), strict=True
    ):
        at = target + offset
        inside = np.clip(at, 0, columns - 1)
        # beyond an end: 2 f(end) - f(mirrored)
        mirrored = np.clip(2 * inside - at, 0, columns - 1)
        np.add.at(
            matrix, (inside, target), np.where(at == inside, weight, 2.0 * weight)
        )
        np.add.at(matrix, (mirrored, target), np.where(at == inside, 0.0, -weight))

    return matrix


@lru_cache(maxsize=16)
def _colouring(columns: int, length: float) -> Floats:
    """Return the matrix (column + margins, column) that turns white noise into unit
    noise smoothed by a Gaussian.
    """
    reach = int(np.ceil(3.0 * length))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / length) ** 2)
    kernel /= np.sqrt((kernel**2).sum())
    return np.asarray(convolution_matrix(kernel, columns))


def _noise(
    shape: tuple[int, ...],
    lengths_m: tuple[float, ...],
    study: SliceStudy,
    rng: np.random.Generator,
) -> Floats:
    """Return noise of unit variance (sample, column): the sum of parts of equal size,
    one for each length.
    """
    total = np.zeros(shape)
    for length_m in lengths_m:
        colouring = _colouring(shape[1], length_m / study.pixel_m)
        total += rng.standard_normal((shape[0], len(colouring))) @ colouring
    total /= np.sqrt(len(lengths_m))
    return total


def _bumps(
    slope: Floats,
    errors: BoundaryErrors,
    scale: float,
    study: SliceStudy,
    rng: np.random.Generator,
) -> Floats:
    """Return bumps of the thickness, m (sample, column): each on a random steep column,
    its size exponential.
    """
    count = rng.poisson(scale * errors.bumps, len(slope))
    sample = np.repeat(np.arange(len(slope)), count)
    order = rng.random((len(sample), slope.shape[1])) + (
        slope[sample] >= errors.bump_slope
    )
    middle = order.argmax(axis=1)
    steep = slope[sample, middle] >= errors.bump_slope
    height = (
        rng.exponential(errors.bump_m, len(sample))
        * rng.choice([-1.0, 1.0], len(sample))
        * steep
    )
    distance_m = (np.arange(slope.shape[1]) - middle[:, None]) * study.pixel_m
    bumps = np.zeros_like(slope)
    np.add.at(
        bumps,
        sample,
        height[:, None] * np.exp(-0.5 * (distance_m / errors.bump_length_m) ** 2),
    )

    return bumps


def _layers(
    shape: tuple[int, ...],
    errors: BoundaryErrors,
    scale: float,
    rng: np.random.Generator,
) -> Floats:
    """Return the thickness that a layer taken for wall adds, m (sample, column)."""
    count, columns = shape
    added = rng.uniform(*errors.layer_m, (count, 1)) * (
        rng.random((count, 1)) < scale * errors.layer_share
    )
    half = 0.5 * columns * rng.uniform(*errors.layer_stretch, (count, 1))
    middle = columns * rng.random((count, 1))

    return np.where(np.abs(np.arange(columns) - middle) <= half, added, 0.0)


def _within_sides(
    shape: tuple[int, ...],
    errors: BoundaryErrors,
    study: SliceStudy,
    rng: np.random.Generator,
) -> Flags:
    """Return the columns that the scan reaches (sample, column)."""
    hit = rng.random((shape[0], 2)) < errors.side_loss_share
    lost = (
        np.where(hit, rng.exponential(errors.side_loss_m, (shape[0], 2)), 0.0)
        / study.pixel_m
    )
    column = np.arange(shape[1])

    return (column >= lost[:, :1]) & (column < shape[1] - lost[:, 1:])
