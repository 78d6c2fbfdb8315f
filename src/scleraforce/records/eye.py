"""Known inputs of an eye beside its frame: modulus, IOP, thickness, gap, globe,
discrepancy of its forces.

Each may be missing. A globe is open, sealed with some rigidity, or unknown; the
rigidity is an unknown of fit and filter: normal about a mean, within bounds. Frames of
known force move and narrow it. They also show the discrepancy of an eye's forces from
the library's: tissue stiffens, walls are uneven, corneas have their own stiffness. A
calibration's E absorbs most of that; the rest grows with the force, and frames of the
same eye share it. It is learned per eye, as the discrepancy of a model (Kennedy and
O'Hagan, J. R. Stat. Soc. B 63, 2001):

    ln(F / F_library) = level + growth (F_library / 60 mN - 1/2)
"""

from dataclasses import KW_ONLY, dataclass, fields, replace
from math import sqrt

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import StudyError
from scleraforce.base.normal_distribution import MOST_CORRELATED
from scleraforce.records.fields import (
    check_fields,
    computed,
    name_fault,
    option,
    optional_quantity,
    quantity,
)
from scleraforce.records.globe import KnownGlobe, known_globe
from scleraforce.records.study_of_eye import (
    GLOBES,
    RIGIDITY_LAWS,
    check_relaxation,
)
from scleraforce.records.tissue_relaxation import KnownRelaxation

# growth is that from no force to this one; beyond it the discrepancy is constant
REFERENCE_N = 60e-3
_LARGEST_LOG = 2.0  # of a force's logarithm, in a file


@dataclass(frozen=True)
class EyeInfo:
    """The eye: a name, and its known properties (None: unknown).

    `globe`: "open" (infused or vented: the needle leaves the pressure unchanged) or
    "sealed"; a sealed one may have a measured rigidity and its law, and a time constant
    in which it leaks (`records.globe`). `relaxation`: terms of a share and a time
    constant, s (`mechanics.tissue_material`); none: the tissue is elastic.
    """

    id: str
    _: KW_ONLY
    thickness_m: float | None = optional_quantity("thickness_m")
    iop_pa: float | None = optional_quantity("iop_pa")
    globe: str | None = option(None, *GLOBES)
    rigidity_pa13_per_m3: float | None = optional_quantity("rigidity", "mmhg13_per_ul")
    rigidity_law: str | None = option(None, *RIGIDITY_LAWS)
    leak_time_s: float | None = quantity(None, None, 1.0, 1e6)
    relaxation: tuple[tuple[float, ...], ...] | None = quantity(None, None, 0.0, 1e5)

    def __post_init__(self) -> None:
        check_fields(self)
        check_relaxation(self.relaxation or ())
        if fault := name_fault(self.id):
            raise StudyError(f"id: {fault}")

        stated = (self.rigidity_pa13_per_m3, self.rigidity_law, self.leak_time_s)
        for key, value in zip(
            ("rigidity_mmhg13_per_ul", "rigidity_law", "leak_time_s"),
            stated,
            strict=True,
        ):
            if value is not None and self.globe != "sealed":
                found = "missing" if self.globe is None else f'"{self.globe}"'
                raise StudyError(
                    f"{key}: of a sealed globe, globe is {found};"
                    ' write globe = "sealed", or leave it out'
                )


@dataclass(frozen=True, kw_only=True)
class ForceDiscrepancy:
    """Means and standard deviations of level and growth, which are normal, and their
    correlation.

    All are given E and the globe's rigidity at their means; one standard deviation of
    these above it moves level and growth by `level_by` and `growth_by` (by E, by the
    rigidity), since an eye's frames determine all of them together. `scatter`:
    residuals of single frames in standard deviations of their expectation. `largest_n`:
    the largest of their forces, N, beyond which the eye is extrapolated; `widest_gap`:
    the widest gap between two of them, or below the first, as a share of the largest.
    None if unknown.
    """

    level: float = computed(-_LARGEST_LOG, _LARGEST_LOG)
    growth: float = computed(-_LARGEST_LOG, _LARGEST_LOG)
    level_sd: float = computed(0.0, _LARGEST_LOG)
    growth_sd: float = computed(0.0, _LARGEST_LOG)
    correlation: float = computed(-MOST_CORRELATED, MOST_CORRELATED)
    level_by: tuple[float, float] = computed(
        -_LARGEST_LOG, _LARGEST_LOG, default=(0.0, 0.0)
    )
    growth_by: tuple[float, float] = computed(
        -_LARGEST_LOG, _LARGEST_LOG, default=(0.0, 0.0)
    )
    scatter: float = computed(0.0, 100.0, default=1.0)
    largest_n: float | None = computed(0.0, 3.0, default=None)
    widest_gap: float | None = computed(0.0, 1.0, default=None)

    def corrected_n(
        self,
        library_n: Floats,
        level_z: Floats | float = 0.0,
        growth_z: Floats | float = 0.0,
        eye_z: Floats | tuple[float, float] = (0.0, 0.0),
    ) -> Floats:
        """Return the forces of the eye for the library's forces, N.

        `level_z` and `growth_z` are standard normal numbers that draw level and growth
        (0: the mean); `eye_z` (..., 2) are the deviations of E and rigidity from their
        means, in standard deviations.
        """
        level = self.level + self.level_sd * level_z + np.asarray(eye_z) @ self.level_by
        across = self.correlation * level_z + sqrt(1.0 - self.correlation**2) * growth_z
        growth = (
            self.growth + self.growth_sd * across + np.asarray(eye_z) @ self.growth_by
        )
        return library_n * np.exp(level + growth * beside_middle(library_n))

    def at_reference(self) -> tuple[float, float]:
        """Return mean and standard deviation of ln(F / F_library) at 60 mN."""
        half = 0.5 * self.growth_sd
        variance = (
            self.level_sd**2 + half**2 + 2.0 * self.correlation * self.level_sd * half
        )
        return self.level + 0.5 * self.growth, sqrt(variance)


NO_DISCREPANCY = ForceDiscrepancy(
    level=0.0, growth=0.0, level_sd=0.0, growth_sd=0.0, correlation=0.0
)


def beside_middle(library_n: Floats) -> Floats:
    """Return the factor of the growth: the distance of forces from the middle of the
    range, -1/2 to 1/2.
    """
    return np.clip(library_n / REFERENCE_N, 0.0, 1.0) - 0.5


STATED_MODULUS_SD = 0.03  # relative, of a modulus that comes without its uncertainty
# relative: eyes differ by so much (paper, Table 2), also where a file knows too few to
# tell
POPULATION_SD = 0.12
# relative: below it mechanics and segmentation are what is uncertain
LEAST_MODULUS_SD = 0.01
_SEALED_DOUBT = (
    "eye.globe is sealed, and linear mechanics takes every eye for an open one: forces"
    " are read too low"
)


# Sources of a modulus, in words; of an eye's own: by known forces, or by the shape of
# its dents alone.
MODULUS_SOURCES = {
    "own": "calibrated",
    "shape": "from shape, without force",
    "population": "mean of the calibrated eyes",
    "stated": "given",
}
OWN_SOURCES = ("own", "shape")


@dataclass(frozen=True, kw_only=True)
class Modulus:
    """Young's modulus with its standard deviation, Pa, and where it comes from
    (`MODULUS_SOURCES`).
    """

    mean_pa: float
    sd_pa: float
    source: str

    @property
    def relative_sd(self) -> float:
        """Standard deviation over mean, at least 1 %."""
        return max(self.sd_pa / self.mean_pa, LEAST_MODULUS_SD)

    @classmethod
    def stated(cls, mean_pa: float) -> "Modulus":
        """A modulus that is given without its uncertainty."""
        return cls(mean_pa=mean_pa, sd_pa=STATED_MODULUS_SD * mean_pa, source="stated")


@dataclass(frozen=True, kw_only=True)
class Known:
    """Known inputs of an eye and of the B-scan's place; None: unknown.

    `gap_m` is the distance of the B-scan plane from the needle axis, `polar_rad` the
    polar angle of the contact, `direction_rad` that of the plane's lateral axis from
    the meridian. `globe` is by default `UNKNOWN`; `stiffening` is b of the tissue
    (`mechanics.tissue_material`), by default 0. `discrepancy` belongs to an eye's own
    modulus. Tissue whose `relaxation` is not known is read as elastic; a globe without
    `leak_time_s` does not leak. `lean_rad` has the ends of the angle between the needle
    and the wall's normal, `lean_azimuth_rad` its direction on its way up, from the
    plane's lateral axis. A calibration's modulus is of forces along the normal if it
    knew the lean, `calibrated_lean_rad`; otherwise of forces along its needle.
    `unlearned` is the eye before a monitor learned its E, None where none did: models
    read both (`reading.reading_models`).
    """

    modulus: Modulus | None = None
    iop_pa: float | None = None
    thickness_m: float | None = None
    gap_m: float | None = None
    polar_rad: float | None = None
    direction_rad: float | None = None
    globe: KnownGlobe | None = None
    stiffening: float | None = None
    discrepancy: ForceDiscrepancy | None = None
    relaxation: KnownRelaxation | None = None
    lean_rad: tuple[float, float] | None = None
    lean_azimuth_rad: float | None = None
    calibrated_lean_rad: float | None = None
    leak_time_s: float | None = None
    unlearned: "Known | None" = None

    @property
    def before_learning(self) -> "Known":
        """The eye as it was known before a monitor learned its E."""
        return self if self.unlearned is None else self.unlearned

    @property
    def has_own_modulus(self) -> bool:
        """True if E was found on frames of the eye."""
        return self.modulus is not None and self.modulus.source in OWN_SOURCES

    @property
    def has_calibrated_modulus(self) -> bool:
        """True if E was found on frames of the eye or of others."""
        return self.modulus is not None and self.modulus.source != "stated"

    def turned(self, turn_rad: float) -> "Known":
        """Return the eye beside a plane at another angle about the needle's axis, whose
        gap is unknown.
        """
        direction_rad = (
            None if self.direction_rad is None else self.direction_rad + turn_rad
        )
        return replace(self, direction_rad=direction_rad, gap_m=None)

    @property
    def scatter(self) -> float:
        """Factor of intervals from the scatter of the eye's frames of known force."""
        return 1.0 if self.discrepancy is None else self.discrepancy.scatter


NOTHING_KNOWN = Known()


def one_lean(ends_rad: tuple[float, float] | None) -> float | None:
    """Return the lean of two ends that are the same, else None."""
    return ends_rad[0] if ends_rad is not None and ends_rad[0] == ends_rad[1] else None


def stated_globe(eye: EyeInfo) -> KnownGlobe | None:
    """Return the globe that a recording states; None: unknown."""
    return (
        None
        if eye.globe is None
        else known_globe(eye.globe, eye.rigidity_pa13_per_m3, eye.rigidity_law)
    )


def stated_eye(eye: str, known: Known) -> EyeInfo:
    """Return a recording's statements on a known eye, without the findings of a
    calibration.
    """
    globe = known.globe
    relaxation = known.relaxation
    terms = None
    if relaxation is not None and relaxation.source == "declared":
        terms = tuple(zip(relaxation.shares, relaxation.times_s, strict=True))

    stated = EyeInfo(
        eye, thickness_m=known.thickness_m, iop_pa=known.iop_pa, relaxation=terms
    )
    if globe is None or globe.kind == "unknown":
        return stated
    if globe.kind == "open":
        return replace(stated, globe="open")

    rigidity = globe.mean if globe.rigidity_told and not globe.calibrated else None
    stated = replace(stated, globe="sealed", leak_time_s=known.leak_time_s)
    return replace(stated, rigidity_pa13_per_m3=rigidity, rigidity_law=globe.law)


def open_doubts(globe: str | None) -> tuple[str, ...]:
    """Return a sentence if linear mechanics, which takes every globe for open, reads a
    sealed one.
    """
    return (_SEALED_DOUBT,) if globe == "sealed" else ()


def completed_eye(given: Known, stated: Known) -> Known:
    """Return the given inputs of an eye, completed by the stated ones, also by a globe
    of the same kind.

    >>> both = completed_eye(Known(gap_m=0.4e-3), Known(gap_m=0.5e-3, iop_pa=266.0))
    >>> both == Known(gap_m=0.4e-3, iop_pa=266.0)
    True
    """
    missing = [item.name for item in fields(Known) if getattr(given, item.name) is None]
    globe = given.globe or stated.globe

    if (
        given.globe is not None
        and stated.globe is not None
        and given.globe.kind == stated.globe.kind
    ):
        globe = (
            replace(given.globe, law=stated.globe.law)
            if given.globe.rigidity_told
            else stated.globe
        )

    return replace(
        given, **{**{name: getattr(stated, name) for name in missing}, "globe": globe}
    )
