"""The core of light that `drawn_bscan` and `drawn_scenes` draw with: optics, speckle,
thin curves, displays.
"""

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields, replace
from functools import lru_cache
from math import atan, atan2, ceil, cos, hypot, log, sin, sqrt, tan
from typing import TYPE_CHECKING, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats, Reals, Singles
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.mechanics.tissue_material import lame_constants
from scleraforce.records.study import OctStudy, PhantomStudy, draw

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Complex = NDArray[np.complex64]
Drawn = TypeVar("Drawn", bound="DataclassInstance")

LAYER_POISSON_RATIO = 0.45  # of the conjunctiva
# powers of the intensity with which the counts of a display grow
POWERS = {
    "root": 0.5,
    "linear": 1.0,
}


@dataclass(frozen=True, kw_only=True)
class Shadow:
    """A loss of light below the surface, as of a vessel: centre from the middle column,
    full width at half loss.
    """

    centre_m: float
    width_m: float
    loss_fraction: float


@dataclass(frozen=True, kw_only=True)
class ReflectionLine:
    """A horizontal reflection line across the frame: depth below the top edge, level
    over the noise, full width.
    """

    depth_m: float
    level_db: float
    thickness_m: float


@dataclass(frozen=True, kw_only=True)
class Coverslip:
    """A straight bright line above the tissue (coverslip): height over the highest
    tissue, level over the noise.
    """

    height_m: float
    level_db: float
    thickness_m: float
    tilt_rad: float


@dataclass(frozen=True, kw_only=True)
class PressingNeedle:
    """A needle on a layer: its force and radius, the plane's distance from its axis,
    and where it is across.
    """

    force_n: float
    radius_m: float
    gap_m: float
    lateral_m: float


@dataclass(frozen=True, kw_only=True)
class Conjunctiva:
    """A layer over the wall, with a surface of its own.

    Its thickness along the wall's normal is thickness_m (1 + wave_fraction cos(2 pi x /
    wave_length_m + phase_rad)), x lateral from the frame's middle. `level_db`: its
    backscatter against the wall's; `interface_db`: mirror reflection of the wall's
    surface below it, over the wall's speckle there.

    A needle (`press`) compresses it. The tissue around confines what is below the
    needle, so that under a pressure q it keeps the share exp(-q/M) of its thickness, M
    = lambda + 2 mu at Young's modulus `modulus_pa`. Beside the needle the surface sinks
    as that of a half-space under a flat punch, cut off over the thickness (Johnson,
    Contact Mechanics, sec. 3.8). The wall's own shape is drawn without the layer.
    """

    thickness_m: float
    wave_fraction: float
    wave_length_m: float
    phase_rad: float
    level_db: float
    interface_db: float
    modulus_pa: float
    press: PressingNeedle | None = None

    def thicknesses(self, lateral_m: Floats) -> Floats:
        """Return the thickness along the wall's normal at lateral places, m."""
        wave = np.cos(2.0 * np.pi * lateral_m / self.wave_length_m + self.phase_rad)
        uneven_m = self.thickness_m * (1.0 + self.wave_fraction * wave)
        press = self.press
        if press is None:
            return uneven_m

        lame_lambda, mu = lame_constants(self.modulus_pa, LAYER_POISSON_RATIO)
        pressure_pa = press.force_n / (np.pi * press.radius_m**2)
        away_m = np.maximum(
            np.hypot(lateral_m - press.lateral_m, press.gap_m), press.radius_m
        )
        beside = (
            2.0
            / np.pi
            * np.arcsin(press.radius_m / away_m)
            * np.exp((press.radius_m - away_m) / self.thickness_m)
        )

        return uneven_m * (
            1.0 + np.expm1(-pressure_pa / (lame_lambda + 2.0 * mu)) * beside
        )

    def surface(self, outer: Floats) -> Floats:
        """Return its surface over a wall's, both (point, 2) in m: lateral, and depth,
        which grows downwards.
        """
        along = np.gradient(outer, axis=0)
        upward = (
            np.stack([along[:, 1], -along[:, 0]], axis=1)
            / np.hypot(along[:, 0], along[:, 1])[:, None]
        )
        return outer + self.thicknesses(outer[:, 0])[:, None] * upward


@dataclass(frozen=True, kw_only=True)
class NeedleShaft:
    """A needle that may cross the B-scan."""

    diameter_m: float
    gap_m: float  # distance of the plane from the contact
    # off the surface's normal in the picture; above 0 it leans to growing columns
    angle_rad: float
    lean_rad: float  # out of the picture, away from the plane
    bevel_rad: float  # between the cut of its end and its axis; pi/2: straight
    above_m: float  # length above the frame that still takes light
    loss_fraction: float  # share of the light lost below it; 1: steel
    level_db: float  # its upper edge over the mean noise
    far_edge_db: float  # its other edge over the upper one

    @property
    def from_normal(self) -> tuple[float, float]:
        """The angle between shaft and normal, and the direction of its lean, from the
        picture's lateral axis.
        """
        across = tan(self.angle_rad)
        out = tan(self.lean_rad)
        return atan(hypot(across, out)), atan2(out, across)

    def in_plane(self, along: Floats, gap_m: float) -> "NeedleShaft":
        """Return the shaft in another plane, of a signed gap; `along`: its lateral
        axis, by this one and its normal.
        """
        up = np.array([tan(self.angle_rad), -tan(self.lean_rad) / cos(self.angle_rad)])
        angle_rad = atan(float(along @ up))
        out = float(along[0] * up[1] - along[1] * up[0])
        return replace(
            self, angle_rad=angle_rad, lean_rad=-atan(out * cos(angle_rad)), gap_m=gap_m
        )


@dataclass(frozen=True, kw_only=True)
class BscanOptics:
    """The optics of one frame. Levels are ratios of detected intensity; depths in
    tissue are geometric.

    Resolutions are full widths at half maximum of the intensity point spread function;
    axially, a Gaussian source of 840 nm and 80 nm width has a coherence length of 2 ln
    2/pi lambda^2/width = 3.9 um.
    """

    snr_db: float  # mean speckle intensity at the wall's surface over the mean noise
    attenuation_per_m: (
        float  # mu: light passes twice, so the detected intensity falls as exp(-2 mu z)
    )
    axial_resolution_m: float
    lateral_resolution_m: float
    reflection_db: float  # mirror reflection at normal incidence over the speckle there
    reflection_angle_rad: float  # it falls with the slope as exp(-(slope/angle)^2)
    choroid_level_db: float  # of a layer below the wall, against the wall's
    choroid_attenuation_per_m: float
    choroid_thickness_m: float
    display_floor_db: float  # intensity of count 0 over the mean noise
    display_range_db: float  # from there to the largest count
    band_m: float  # width of the black band on each side
    shadows: tuple[Shadow, ...] = ()
    lines: tuple[ReflectionLine, ...] = ()
    covers: tuple[Coverslip, ...] = ()
    needle: NeedleShaft | None = None
    conjunctiva: Conjunctiva | None = None
    # counts grow with the intensity's logarithm, its "root" or, "linear", with itself
    display: str = "logarithmic"

    def counts(self, intensity: Singles, largest: float) -> Singles:
        """Return the counts, not yet whole, of intensities over the mean noise;
        brighter than `largest` saturates.
        """
        if self.display in POWERS:
            power = POWERS[self.display]
            darkest, brightest = (
                10.0 ** (db / 10.0)
                for db in (self.display_floor_db, power * self.display_range_db)
            )
            shown = (intensity / np.float32(darkest)) ** np.float32(power)
            counts = (shown - 1.0) * np.float32(largest / (brightest - 1.0))
        else:
            level_db = np.float32(10.0) * np.log10(
                np.maximum(intensity, np.float32(1e-12))
            )
            counts = (level_db - np.float32(self.display_floor_db)) * np.float32(
                largest / self.display_range_db
            )

        return counts.clip(0.0, largest)


@dataclass(frozen=True, kw_only=True)
class Pose:
    """Place of the section's origin in the frame: from the middle column, below the top
    edge; and its rotation.
    """

    lateral_m: float
    depth_m: float
    tilt_rad: float = 0.0

    def place(self, section: WallSection) -> WallSection:
        """Return the section in the frame's own coordinates (lateral from the middle,
        depth from the top edge).
        """
        return WallSection(
            self.place_points(section.outer), self.place_points(section.inner)
        )

    def place_points(self, points: Floats) -> Floats:
        """Return points (point, 2), m, in the frame's own coordinates."""
        c = cos(self.tilt_rad)
        s = sin(self.tilt_rad)
        return points @ np.array([[c, s], [-s, c]]) + np.array(
            [self.lateral_m, self.depth_m]
        )


def drawn_record(
    kind: type[Drawn],
    ranges: object,
    rng: np.random.Generator,
    prefix: str = "",
    **given: object,
) -> Drawn:
    """Draw a record: fields without a default from the range of `prefix` + name, or as
    given (functions are called).
    """
    values = {}
    for name in (
        item.name
        for item in fields(kind)
        if item.name in given or item.default is MISSING
    ):
        value = (
            given[name] if name in given else draw(getattr(ranges, prefix + name), rng)
        )
        values[name] = value() if callable(value) else value

    return kind(**values)


def sample_optics(
    phantom: PhantomStudy, oct_study: OctStudy, rng: np.random.Generator
) -> BscanOptics:
    """Draw the optics of one frame, every effect independently."""
    half_width_m = oct_study.width_m / 2
    optics = drawn_record(BscanOptics, phantom, rng, display=phantom.display)
    shadows = tuple(
        drawn_record(
            Shadow,
            phantom,
            rng,
            "shadow_",
            centre_m=float(rng.uniform(-half_width_m, half_width_m)),
        )
        for _ in range(int(draw(phantom.shadow_count, rng)))
    )
    lines = tuple(
        drawn_record(ReflectionLine, phantom, rng, "line_")
        for _ in range(int(draw(phantom.line_count, rng)))
    )
    covers = tuple(
        drawn_record(
            Coverslip,
            phantom,
            rng,
            "cover_",
            thickness_m=lambda: draw(phantom.line_thickness_m, rng),
        )
        for _ in range(int(draw(phantom.cover_count, rng)))
    )

    return replace(optics, shadows=shadows, lines=lines, covers=covers)


def sample_conjunctiva(
    phantom: PhantomStudy, rng: np.random.Generator
) -> Conjunctiva | None:
    """Draw the conjunctiva of one recording; None if its thickness is 0."""
    thickness_m = draw(phantom.conjunctiva_thickness_m, rng)
    if thickness_m == 0.0:
        return None

    given = {
        "thickness_m": thickness_m,
        "phase_rad": lambda: float(rng.uniform(-np.pi, np.pi)),
    }
    return drawn_record(Conjunctiva, phantom, rng, "conjunctiva_", **given)


def sample_needle(
    phantom: PhantomStudy, diameter_m: float, gap_m: float, rng: np.random.Generator
) -> NeedleShaft | None:
    """Draw the needle of one recording; None if the study has none."""
    if not draw(phantom.needle_count, rng):
        return None
    return drawn_record(
        NeedleShaft, phantom, rng, "needle_", diameter_m=diameter_m, gap_m=gap_m
    )


def transmission(shadows: Sequence[Shadow], columns_m: Floats) -> Singles:
    """Return the share of the light that shadows let through in each column,
    (column,).
    """
    left = np.ones(len(columns_m))
    for shadow in shadows:
        across = (columns_m - shadow.centre_m) / (shadow.width_m / 2)
        # flat bottom, soft edges
        left *= 1.0 - shadow.loss_fraction * np.exp(-log(2.0) * across**4)

    return left.astype(np.float32)


def add_ridge(
    field: Complex,
    depth_rows: Reals,
    amplitude: Reals,
    sigma_rows: float,
    rng: np.random.Generator,
) -> None:
    """Add a thin bright curve with a random phase in each column to the field; NaN
    depths are left out.
    """
    sigma = max(sigma_rows, 0.4)  # not narrower than a pixel shows
    column = np.flatnonzero(
        np.isfinite(depth_rows)
        & np.isfinite(amplitude)
        & (np.abs(depth_rows) < 2 * len(field))
    )
    depth = depth_rows[column]
    strength = amplitude[column] * np.exp(2j * np.pi * rng.random(len(column)))
    reach = ceil(4 * sigma)
    row = np.floor(depth).astype(int) + np.arange(-reach, reach + 1)[:, None]
    profile = np.exp(-(((row + 0.5 - depth) / sigma) ** 2) / 2)
    seen = (row >= 0) & (row < len(field))
    field[row[seen], np.broadcast_to(column, row.shape)[seen]] += (profile * strength)[
        seen
    ].astype(np.complex64)


def circular_gaussian(shape: tuple[int, ...], rng: np.random.Generator) -> Complex:
    """Return independent complex circular Gaussian values of mean intensity 1."""
    pairs = rng.standard_normal((*shape, 2), dtype=np.float32) * np.float32(sqrt(0.5))
    return pairs.view(np.complex64)[..., 0]


def seen_through(field: Complex, sigma_rows: float, sigma_columns: float) -> Complex:
    """Filter a field of independent scatterers with a Gaussian point spread function
    that keeps the mean intensity.
    """
    parts = np.ascontiguousarray(field).view(np.float32).reshape(*field.shape, 2)
    seen = cv2.sepFilter2D(
        parts,
        -1,
        _kernel(sigma_columns),
        _kernel(sigma_rows),
        borderType=cv2.BORDER_REFLECT_101,
    )

    return np.ascontiguousarray(seen, dtype=np.float32).view(np.complex64)[..., 0]


def seen_intensity(
    intensity: Singles, sigma_rows: float, sigma_columns: float
) -> Singles:
    """Return the mean intensity of a field that is `seen_through`, of the scatterers'
    intensity.
    """
    down = np.square(_kernel(sigma_rows))
    across = np.square(_kernel(sigma_columns))
    seen = cv2.sepFilter2D(
        intensity, -1, across, down, borderType=cv2.BORDER_REFLECT_101
    )
    return seen.astype(np.float32, copy=False)


def _kernel(sigma: float) -> Floats:
    """Return a sampled Gaussian of unit energy, shape (2 reach + 1,)."""
    reach = ceil(3.5 * sigma)
    values = np.exp(-((np.arange(-reach, reach + 1) / max(sigma, 1e-6)) ** 2) / 2)
    return values / np.sqrt((values**2).sum())


def amplitude_sigma(intensity_width_m: float) -> float:
    """Return the standard deviation of a Gaussian amplitude from the full width at half
    maximum of its intensity.
    """
    return intensity_width_m / (2.0 * sqrt(log(2.0)))


def decibel(level_db: float) -> float:
    """Return a ratio of intensities from dB."""
    return float(10.0 ** (level_db / 10.0))


def ratios(levels_db: Floats | float) -> Floats:
    """Return ratios of intensities from levels in dB."""
    return np.power(10.0, np.asarray(levels_db) / 10.0)


# levels over the mean noise; the lowest stands for none
NO_LIGHT_DB = -15.0
TOP_DB = 60.0
STEP_DB = 0.25
LEVELS = round((TOP_DB - NO_LIGHT_DB) / STEP_DB) + 1
QUANTILES = 64


class Displayed:
    """Tables of frames' counts, over the largest, by mean level over the noise, dB,
    (frame, row, column).
    """

    def __init__(self, optics: Sequence[BscanOptics]) -> None:
        counts = np.stack([each.counts(_intensities(), 1.0) for each in optics])
        self._mean = counts.mean(axis=2)
        self._variance = counts.var(axis=2)
        self._first = (np.arange(len(optics), dtype=np.int32) * LEVELS)[:, None, None]

    def mean(self, level_db: Singles) -> Singles:
        """Return the mean count."""
        return self._mean.take(self._place(level_db))

    def moments(self, level_db: Singles) -> tuple[Singles, Singles]:
        """Return the mean count and its variance over speckle."""
        place = self._place(level_db)
        return self._mean.take(place), self._variance.take(place)

    def _place(self, level_db: Singles) -> NDArray[np.int32]:
        nearest = (
            (level_db - np.float32(NO_LIGHT_DB)) * np.float32(1.0 / STEP_DB)
            + np.float32(0.5)
        ).astype(np.int32)
        return np.clip(nearest, 0, LEVELS - 1) + self._first


@lru_cache(maxsize=1)
def _intensities() -> Singles:
    """Return quantiles of intensities over the mean noise, (level, quantile); the first
    level is without light.
    """
    light = 10.0 ** (0.1 * (NO_LIGHT_DB + STEP_DB * np.arange(LEVELS)))
    light[0] = 0.0
    # of an exponential distribution of mean 1
    quantiles = -np.log1p(-(np.arange(QUANTILES) + 0.5) / QUANTILES)
    return ((1.0 + light)[:, None] * quantiles).astype(np.float32)
