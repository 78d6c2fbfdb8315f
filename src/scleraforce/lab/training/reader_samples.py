"""Samples for the reader, drawn from the response library: any number, each of another
eye.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Bytes, Floats, Places
from scleraforce.base.errors import InputError
from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.lab.training.drawn_wall_errors import added_depths, disturb, draw_forms
from scleraforce.library import Library
from scleraforce.library.moving_base import pole_directions
from scleraforce.library.plane_cut import (
    Framing,
    column_laterals,
    fill_boundaries,
    section_motion,
    wall_boundaries,
)
from scleraforce.library.sealed_eye import iop_ratio_under_force
from scleraforce.reading.force_network import (
    GIVEN,
    GivenEyes,
    given_inputs,
    given_modulus,
)
from scleraforce.records.globe import SEALED, UNKNOWN, PressureLaw, sealed_law
from scleraforce.records.study import Range, ReaderStudy, Sampled, SliceStudy

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Samples = TypeVar("Samples", bound="DataclassInstance")

BARELY_INSIDE = 1.0 - 1e-9
ROUNDS = 40
# relative: a modulus given with less was calibrated on the eye itself
CALIBRATED_SD = 0.06
# relative, of that under the needle: arrays and compiled loops draw alike
PRESSURE_TOLERANCE = 1e-5
TISSUES = 8  # stiffenings of tissue that does: what lies between them is learned
TRUNCATED_SD = 2.5  # a given modulus is never farther off than this
TISSUE = 400  # samples of one tissue
CHUNK = 2000  # samples that are drawn together, from a generator of their own
VALIDATION_CHUNK = 2**31  # numbers from here on are chunks of the validation set
# part of the wall kept beyond the slice: a tilted or turned section reaches a little
# farther
BEYOND_SLICE_M = 0.5e-3


@dataclass(frozen=True)
class SampledEyes:
    """Eyes under a needle, the B-scan's tilt and the section's rotation, and their
    known values; (sample,), SI.

    `polar_rad` is the contact's polar angle, `direction_rad` the section's from the
    meridian. `rigidity` is k of the globe, 0 if it is open; `iop_ratio` the pressure
    under the needle over E.
    """

    stated: GivenEyes
    modulus_pa: Floats
    iop_pa: Floats
    thickness_m: Floats
    gap_m: Floats
    size: Floats
    tilt_rad: Floats
    rotation_rad: Floats
    polar_rad: Floats
    direction_rad: Floats
    force_n: Floats
    rigidity: Floats
    iop_ratio: Floats


@dataclass(frozen=True)
class ForceSamples:
    """Samples of forces: known values `given` float32 (sample, len(GIVEN)), beside
    pictures.

    `modulus_pa` is given to the network; `lateral_m`: of the needle axis from the
    picture's middle; (sample,).
    """

    given: NDArray[np.float32]
    force_n: Floats
    modulus_pa: Floats
    lateral_m: Floats

    def __len__(self) -> int:
        return len(self.force_n)


@dataclass(frozen=True)
class ReaderSamples(ForceSamples):
    """With `slices` uint8 (sample, row, column), 0 or 255."""

    slices: Bytes

    def mirrored(self) -> "ReaderSamples":
        """Return the mirror images, left for right: of eyes whose poles lie on the
        other side.
        """
        given = self.given.copy()
        given[:, GIVEN.index("pole along")] *= -1.0
        return replace(
            self, slices=self.slices[:, :, ::-1], given=given, lateral_m=-self.lateral_m
        )


@dataclass(frozen=True)
class RawSamples(ForceSamples):
    """With reduced `frames` float32 (sample, row, column), and the wall's rows in them.

    `boundary_rows` float32 (sample, boundary, column / 2): kept inside the window, NaN
    without wall.
    """

    frames: NDArray[np.float32]
    boundary_rows: NDArray[np.float32]

    def picked(self, order: Places) -> "RawSamples":
        """Return these samples, in this order."""
        return RawSamples(*(getattr(self, item.name)[order] for item in fields(self)))


def concatenated(parts: Sequence[Samples]) -> Samples:
    """Return samples one after the other: all fields of such a record are arrays with a
    row for each.
    """
    kind = type(parts[0])
    return kind(
        *(
            np.concatenate([getattr(part, item.name) for part in parts])
            for item in fields(kind)
        )
    )


def library_of_tissue(
    library: Library, reader: ReaderStudy, rng: np.random.Generator
) -> Library:
    """Return a library of tissue that stiffens, in a share of the draws: 1 + b is
    spread evenly in its logarithm.
    """
    least, most = np.log1p(library.walls.stiffening[[0, -1]])
    stiffens = rng.random() < reader.stiffening_share
    number = rng.integers(1, TISSUES + 1)
    if not stiffens or least == most:
        return library

    drawn = np.expm1(least + (most - least) * number / TISSUES)
    return library.for_stiffening(
        float(np.clip(drawn, *library.walls.stiffening[[0, -1]]))
    )


def draw_samples(
    library: Library,
    reader: ReaderStudy,
    slice_study: SliceStudy,
    count: int,
    rng: np.random.Generator,
) -> ReaderSamples:
    """Draw samples; a `library` `within` the slices' reach is enough, and quicker."""
    eyes, framing, seen = draw_seen(library, reader, slice_study, count, rng)
    slices = fill_boundaries(seen, slice_study)
    stated_pa, _ = given_modulus(eyes.stated, reader)
    return ReaderSamples(
        given_inputs(eyes.stated, reader),
        eyes.force_n,
        stated_pa,
        framing.lateral_m,
        slices,
    )


def draw_seen(
    library: Library,
    reader: ReaderStudy,
    slice_study: SliceStudy,
    count: int,
    rng: np.random.Generator,
) -> tuple[SampledEyes, Framing, Floats]:
    """Draw the eyes of samples, their places in the slices, and the boundaries seen
    (sample, boundary, column), m.
    """
    eyes, framing, walls = draw_framed(library, reader, slice_study, count, rng)
    return eyes, framing, disturb(walls, slice_study, rng, scale=reader.boundary_errors)


def draw_framed(
    library: Library,
    reader: ReaderStudy,
    columns: SliceStudy,
    count: int,
    rng: np.random.Generator,
) -> tuple[SampledEyes, Framing, Floats]:
    """Draw eyes, their places, and the boundaries of their walls, each of another form
    (eye, boundary, column), m.
    """
    eyes = draw_eyes(library, reader, count, rng)
    lateral_m = reader.lateral_m.sample(rng, count)
    depth_m = reader.surface_depth_m.sample(rng, count)
    framing = Framing(lateral_m, depth_m, eyes.size, eyes.rotation_rad)
    gap_m = eyes.gap_m / eyes.size
    place = eyes.thickness_m / eyes.size, eyes.iop_ratio
    walls = library.curves(*place, eyes.force_n / (eyes.modulus_pa * eyes.size**2))
    pole = pole_directions(eyes.polar_rad, eyes.direction_rad)
    moved = section_motion(
        library, walls, place, gap_m, pole, _reach_m(reader, columns)
    )
    true = wall_boundaries(
        walls.curves_sbnc, gap_m, eyes.tilt_rad, framing, columns, moved
    )
    radius_m = library.radius_m * eyes.size
    forms = draw_forms(
        eyes.thickness_m, radius_m, rng.random(count) < reader.uneven_share, rng
    )
    from_contact_m = column_laterals(columns) - framing.lateral_m[:, None]

    return eyes, framing, true.depth_sbc + added_depths(forms, radius_m, from_contact_m)


def _reach_m(reader: ReaderStudy, slice_study: SliceStudy) -> float:
    """Return the reach of slices along a section, from the needle axis, in the
    library's size, m.
    """
    beside_m = max(abs(end) for end in reader.lateral_m.bounds)
    return (
        0.5 * slice_study.columns * slice_study.pixel_m + beside_m
    ) / reader.size.bounds[0]


def draw_eyes(
    library: Library, reader: ReaderStudy, count: int, rng: np.random.Generator
) -> SampledEyes:
    """Draw eyes that the library holds, with forces up to its largest for each."""
    stated_pa, stated_sd, modulus_pa = _moduli(reader, count, rng)
    iop_pa, thickness_m, size = (np.empty(count) for _ in range(3))
    plain = rng.random(count) < reader.plain_share
    missing = np.arange(count)

    for _ in range(ROUNDS):
        # a corner of the ranges may lie outside the library: draw these again
        iop_pa[missing] = log_even(reader.iop_pa, len(missing), rng)
        thickness_m[missing] = reader.thickness_m.sample(rng, len(missing))
        size[missing] = np.where(
            plain[missing], 1.0, reader.size.sample(rng, len(missing))
        )
        ratios = (
            thickness_m[missing] / size[missing],
            iop_pa[missing] / modulus_pa[missing],
        )

        missing = missing[~library.covers(*ratios, np.zeros(len(missing)))]
        if not len(missing):
            break
    else:
        raise InputError(
            "the library holds hardly any eye of [reader]; make one that covers its"
            " ranges"
        )

    gap_m = reader.gap_m.sample(rng, count)
    largest_n = (
        library.largest_force_ratio(thickness_m / size, iop_pa / modulus_pa)
        * modulus_pa
        * size**2
    )
    stated_iop_pa = _stated(
        iop_pa, reader.iop_noise_fraction, reader.iop_missing_fraction, rng
    )
    stated_thickness_m = _stated(
        thickness_m,
        reader.thickness_noise_fraction,
        reader.thickness_missing_fraction,
        rng,
    )
    stated_gap_m = _stated(
        gap_m, reader.gap_noise_fraction, reader.gap_missing_fraction, rng
    )
    # At a given dent F goes as E t^2 IOP^(1/3) (docs/reader.md): a calibration keeps
    # the product (NaN: missing).
    t, p = (
        np.nan_to_num(factor, nan=1.0)
        for factor in (stated_thickness_m / thickness_m, stated_iop_pa / iop_pa)
    )
    stated_pa *= np.where(stated_sd < CALIBRATED_SD, 1.0 / (t**2 * np.cbrt(p)), 1.0)
    angles = reader.tilt_rad, reader.rotation_rad
    tilt_rad, rotation_rad = (
        np.where(plain, 0.0, angle.sample(rng, count)) for angle in angles
    )
    small = rng.random(len(largest_n)) < reader.small_force_share
    top_n = np.minimum(
        np.where(small, reader.small_force_n, reader.max_force_n),
        largest_n * BARELY_INSIDE,
    )
    force_n = top_n * rng.random(len(largest_n))
    rigidity, low, high = _globes(reader, count, rng)
    pole, stated_pole = _poles(reader, count, rng)
    values = (stated_iop_pa, stated_thickness_m, stated_gap_m)
    tissue = np.full(count, library.stiffening)
    stated = GivenEyes(stated_pa, stated_sd, *values, low, high, *stated_pole, tissue)
    iop_ratio = _pressures(
        library, (thickness_m, iop_pa, modulus_pa, size), rigidity, force_n, rng
    )
    eye = (stated, modulus_pa, iop_pa, thickness_m, gap_m, size)

    return SampledEyes(
        *eye, tilt_rad, rotation_rad, *pole, force_n, rigidity, iop_ratio
    )


def _poles(
    reader: ReaderStudy, count: int, rng: np.random.Generator
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Return polar angles of contacts and directions of sections, and their given
    values, (sample,) each.
    """
    pole = reader.polar_angle_rad.sample(rng, count), rng.uniform(-np.pi, np.pi, count)
    stated = [
        angle + reader.pole_noise_rad * rng.standard_normal(count) for angle in pole
    ]
    missing = zip(
        (reader.polar_missing_fraction, reader.direction_missing_fraction),
        stated,
        strict=True,
    )
    polar, direction = (
        np.where(rng.random(count) < share, np.nan, angle) for share, angle in missing
    )

    return pole, (np.abs(polar), direction)


def _pressures(
    library: Library,
    eye: tuple[Floats, ...],
    rigidity: Floats,
    force_n: Floats,
    rng: np.random.Generator,
) -> Floats:
    """Return the pressure under the needle over E (sample,); forces that drive it
    beyond the library are lowered.
    """
    thickness_m, iop_pa, modulus_pa, size = eye
    # volumes go as size^3
    thickness = thickness_m / size
    globe = sealed_law(rigidity * size**3).over(modulus_pa)
    highest = BARELY_INSIDE * library.iop_ratio_ends(thickness)[1]
    ratio = iop_pa / modulus_pa
    left = np.flatnonzero(rigidity > 0.0)
    resting = ratio.copy()

    for _ in range(ROUNDS):
        force_ratio = force_n[left] / (modulus_pa[left] * size[left] ** 2)
        one = PressureLaw(globe.law, np.asarray(globe.rate)[left])
        wall = library, thickness[left], resting[left]
        ratio[left] = iop_ratio_under_force(*wall, force_ratio, one, PRESSURE_TOLERANCE)

        left = left[ratio[left] >= highest[left]]
        if not len(left):
            return ratio

        force_n[left] *= rng.random(len(left))

    raise InputError(
        "the library holds hardly any sealed eye of [reader]; make one that covers its"
        " pressures"
    )


def _globes(
    reader: ReaderStudy, count: int, rng: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """Return rigidities of globes and the ends of the given band of each, (sample,) in
    Pa^(1/3)/m^3.
    """
    rigidity = np.zeros(count)
    low = np.zeros(count)
    high = np.zeros(count)
    drawn = rng.random(count)
    missing = rng.random(count) < reader.rigidity_missing_fraction
    sealed = drawn >= reader.globe_open_fraction + reader.globe_missing_fraction
    unknown = (drawn >= reader.globe_open_fraction) & ~sealed

    for which, globe in ((unknown, UNKNOWN), (sealed & missing, SEALED)):
        rigidity[which] = rng.uniform(globe.lowest, globe.highest, count)[which]
        low[which], high[which] = globe.band

    stated = sealed & ~missing
    middle = rng.uniform(UNKNOWN.lowest, UNKNOWN.highest, count)
    sd = log_even(reader.rigidity_sd_pa13_per_m3, count, rng)
    own = middle + sd * np.clip(rng.standard_normal(count), -TRUNCATED_SD, TRUNCATED_SD)
    ends = (own, middle - NINETY_PERCENT * sd, middle + NINETY_PERCENT * sd)

    for values, found in zip(ends, (rigidity, low, high), strict=True):
        found[stated] = np.clip(values, UNKNOWN.lowest, UNKNOWN.highest)[stated]

    return rigidity, low, high


def _moduli(
    reader: ReaderStudy, count: int, rng: np.random.Generator
) -> tuple[Floats, Floats, Floats]:
    """Return given moduli, their relative standard deviations (NaN: missing), and the
    eyes' true moduli (sample,).

    The true modulus is drawn from the given distribution; without one, evenly from the
    range.
    """
    middle_pa = reader.youngs_modulus_pa.sample(rng, count)
    sd = log_even(reader.modulus_sd_fraction, count, rng)
    error = np.clip(rng.standard_normal(count), -TRUNCATED_SD, TRUNCATED_SD)
    missing = rng.random(count) < reader.modulus_missing_fraction
    own_pa = np.where(missing, middle_pa, middle_pa * (1.0 + sd * error))
    return np.where(missing, np.nan, middle_pa), np.where(missing, np.nan, sd), own_pa


def _stated(
    values: Floats, noise: float, missing: float, rng: np.random.Generator
) -> Floats:
    """Return given values: off by relative noise, NaN if they are missing."""
    stated = values * (1.0 + noise * rng.standard_normal(len(values)))
    return np.where(rng.random(len(values)) < missing, np.nan, stated)


def log_even(values: Sampled, count: int, rng: np.random.Generator) -> Floats:
    """Draw from a range with its logarithm evenly spread, or from a choice."""
    if not isinstance(values, Range):
        return values.sample(rng, count)
    low, high = np.log(values.bounds)
    return np.exp(rng.uniform(low, high, count))


class SampleSource:
    """A source of samples: the same chunk for the same seed and number."""

    def __init__(
        self, library: Library, reader: ReaderStudy, slice_study: SliceStudy
    ) -> None:
        """Keep only the part of a library that slices can show: it is quicker."""
        reach_m = _reach_m(reader, slice_study) + reader.gap_m.bounds[1]
        self.library = library.within(reach_m + BEYOND_SLICE_M)
        self.reader = reader
        self.slice_study = slice_study

    def chunk(self, number: int, count: int = CHUNK) -> ReaderSamples:
        """Draw a chunk of samples."""
        rng = np.random.default_rng([self.reader.seed, number])
        parts = [min(TISSUE, count - first) for first in range(0, count, TISSUE)]
        libraries = [library_of_tissue(self.library, self.reader, rng) for _ in parts]
        of_tissues = zip(libraries, parts, strict=True)

        return concatenated(
            [
                draw_samples(each, self.reader, self.slice_study, n, rng)
                for each, n in of_tissues
            ]
        )


def validation_chunks(
    draw: Callable[[int, int], Samples], count: int, size: int
) -> list[Samples]:
    """Draw samples that no training sees, from streams of their own, in chunks of at
    most `size`.
    """
    return [
        draw(VALIDATION_CHUNK + n, min(size, count - n * size))
        for n in range(-(-count // size))
    ]
