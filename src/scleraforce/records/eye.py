"""An eye: modulus, IOP, thickness, globe, tissue, and the discrepancy of its forces.

Each may be missing. A globe is open, sealed with some rigidity, or unknown; the
rigidity is an unknown of fit and filter: normal about a mean, within bounds. Frames of
known force move and narrow it. They also show the discrepancy of an eye's forces from
the library's: tissue stiffens, walls are uneven, corneas have their own stiffness. A
calibration's E absorbs most of that; the rest grows with the force, and frames of the
same eye share it. It is learned per eye, as the discrepancy of a model (Kennedy and
O'Hagan, J. R. Stat. Soc. B 63, 2001):

    ln(F / F_library) = level + growth (F_library / 60 mN - 1/2)
"""

from dataclasses import KW_ONLY, dataclass
from math import inf, sqrt

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import StudyError
from scleraforce.base.normal_distribution import MOST_CORRELATED
from scleraforce.records.fields import (
    check_fields,
    check_kind,
    check_quantity,
    computed,
    declared,
    formed,
    name_fault,
    needed,
    not_in_files,
    optional_quantity,
    quantity,
)
from scleraforce.records.globe import GLOBE_FORM, Globe
from scleraforce.records.tissue_relaxation import RELAXATION_FORM, Relaxation

# growth is that from no force to this one; beyond it the discrepancy is constant
REFERENCE_N = 60e-3
# fields of an eye that a calibration estimates, and no recording states
FOUND_BY_CALIBRATION = (
    "modulus",
    "stiffening",
    "discrepancy",
    "calibrated_lean_rad",
    "iop_assumed",
)
_LARGEST_LOG = 2.0  # of a force's logarithm, in a file


@dataclass(frozen=True, kw_only=True)
class ForceDiscrepancy:
    """Means and standard deviations of level and growth, which are normal, and their
    correlation.

    All hold at the mean E and the mean rigidity of the globe; one standard deviation
    more of either moves level and growth by `level_by` and `growth_by` (by E, by the
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


# Scales of Cauchy's prior, whose density falls slowly, of level and growth: forces of
# most eyes are hardly off (uneven ones, computed in three dimensions, drift by 0.035
# from none to the largest), forces of tissue that stiffens by up to 1.
LEVEL_SCALE = 0.02
GROWTH_SCALE = 0.035
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
    """Young's modulus with its standard deviation, Pa, and its source: "own" of the
    eye's own frames and forces, "shape" of its frames alone, "population" of other
    eyes, "stated" without a calibration. A modulus of the eye's own is read with the
    discrepancy of its forces.

    >>> import scleraforce as sf
    >>> sf.Modulus.stated(0.3e6).sd_pa
    9000.0
    """

    mean_pa: float
    sd_pa: float
    source: str

    def __post_init__(self) -> None:
        if not (0.0 < self.mean_pa < inf and 0.0 <= self.sd_pa < inf):
            raise StudyError(
                f"modulus: {self.mean_pa} ± {self.sd_pa} Pa; give a mean above 0 and a"
                " standard deviation of 0 or more"
            )
        if self.source not in MODULUS_SOURCES:
            raise StudyError(
                f"modulus: source: {self.source!r} is not one of"
                f" {', '.join(MODULUS_SOURCES)}"
            )

    @property
    def relative_sd(self) -> float:
        """Standard deviation over mean, at least 1 %."""
        return max(self.sd_pa / self.mean_pa, LEAST_MODULUS_SD)

    @classmethod
    def stated(cls, mean_pa: float) -> "Modulus":
        """Return a modulus that is given without its uncertainty, taken as 3 %.

        Raises:
            StudyError: it is out of bounds.
        """
        check_quantity("youngs_modulus_pa", mean_pa)
        return cls(mean_pa=mean_pa, sd_pa=STATED_MODULUS_SD * mean_pa, source="stated")


# values of an eye, and the fields of their standard deviations
UNCERTAIN = {
    "iop_pa": "iop_sd_pa",
    "thickness_m": "thickness_sd_m",
    "radius_m": "radius_sd_m",
}


@dataclass(frozen=True)
class Eye:
    """An eye, as far as it is known; None always means: not declared.

    Attributes:
        name: names the eye in a calibration and in tables. None: no calibration's own
            values are found.
        modulus: Young's modulus of the wall. None: anything that the model was trained
            for, which makes forces unsure by as much.
        iop_pa: pressure at rest. None: the range of the model's training, which widens
            the interval.
        iop_sd_pa: standard deviation of `iop_pa`. None: 5 % of it.
        thickness_m: of the wall. None: as the picture shows it, within the range of the
            model's training; nothing then checks the wall that is found.
        thickness_sd_m: standard deviation of `thickness_m`. None: 15 um.
        radius_m: of the globe's outer surface; one that is more than 12 % off the
            model's is refused. None: the model's, 12 mm, within what the picture shows
            of its curvature (3 %). Networks take no radius, a monitor for its second
            opinion alone.
        radius_sd_m: standard deviation of `radius_m`. None: 2 % of it.
        globe: open or sealed. None: it may be either, and the interval spans both.
        stiffening: b of the tissue (`mechanics.tissue_material`). None: 0.
        relaxation: how the tissue relaxes. None: it is read as elastic.
        discrepancy: of the eye's forces from the library's; belongs to a modulus of its
            own. None: none.
        iop_assumed: True: `iop_pa` is not declared, but the pressure of the
            calibration; the modulus is right only together with it.
        calibrated_lean_rad: of the needle that calibrated `modulus`, which then is of
            forces along the wall's normal. None: of forces along that needle.
        unlearned: the eye before a monitor learned its E: models read both. None: no
            monitor has.

    Raises:
        StudyError: a value is out of bounds, or an uncertainty without its value.

    >>> import scleraforce as sf
    >>> eye = sf.Eye("eye-a", iop_pa=2000.0, thickness_m=500e-6)
    >>> eye.modulus is None
    True
    """

    name: str | None = needed(key="id")
    _: KW_ONLY
    thickness_m: float | None = optional_quantity("thickness_m")
    thickness_sd_m: float | None = quantity(None, None, 1e-7, 3e-3)
    iop_pa: float | None = optional_quantity("iop_pa")
    iop_sd_pa: float | None = quantity(None, None, 1e-3, 15e3)
    radius_m: float | None = quantity(None, None, 3e-3, 30e-3)
    radius_sd_m: float | None = quantity(None, None, 1e-6, 10e-3)
    globe: Globe | None = formed(GLOBE_FORM)
    relaxation: Relaxation | None = formed(RELAXATION_FORM)
    modulus: Modulus | None = not_in_files()
    stiffening: float | None = not_in_files()
    discrepancy: ForceDiscrepancy | None = not_in_files()
    iop_assumed: bool | None = not_in_files()
    calibrated_lean_rad: float | None = not_in_files()
    unlearned: "Eye | None" = not_in_files()

    def __post_init__(self) -> None:
        check_fields(self)
        check_kind("modulus", self.modulus, Modulus, "Modulus.stated(0.3e6)")
        check_kind("globe", self.globe, Globe, 'Globe.declared("open")')
        check_kind("relaxation", self.relaxation, Relaxation, "Relaxation.declared([])")
        check_kind("name", self.name, str, '"eye-a"')
        if self.stiffening is not None and not 0.0 <= self.stiffening < inf:
            raise StudyError(f"stiffening: {self.stiffening!r}; give 0 or more")
        if self.name is not None and (fault := name_fault(self.name)):
            raise StudyError(f"name: {fault}")

        for value, sd in UNCERTAIN.items():
            if getattr(self, sd) is not None and getattr(self, value) is None:
                raise StudyError(
                    f"{sd}: the uncertainty of {value}, which is missing; give both, or"
                    " leave it out"
                )

    @property
    def declared_iop_pa(self) -> float | None:
        """Pressure at rest that was declared."""
        return None if self.iop_assumed else self.iop_pa

    @property
    def assumed_iop_pa(self) -> float | None:
        """Pressure at rest that was not declared, but taken or found."""
        return self.iop_pa if self.iop_assumed else None

    @property
    def modulus_pa(self) -> float:
        """Young's modulus, the mean; raises `InputError` if it is not declared."""
        return declared(self.modulus, "eye: modulus").mean_pa

    @property
    def leak_time_s(self) -> float | None:
        """Time constant in which the globe leaks; None: not declared."""
        return None if self.globe is None else self.globe.leak_time_s

    @property
    def before_learning(self) -> "Eye":
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

    @property
    def scatter(self) -> float:
        """Factor of intervals from the scatter of the eye's frames of known force."""
        return 1.0 if self.discrepancy is None else self.discrepancy.scatter

    def declared(self) -> "Eye":
        """Return what was declared of the eye, without the findings of a
        calibration.
        """
        relaxation = self.relaxation
        if relaxation is not None and relaxation.source != "declared":
            relaxation = None

        return Eye(
            self.name,
            thickness_m=self.thickness_m,
            thickness_sd_m=self.thickness_sd_m,
            iop_pa=self.declared_iop_pa,
            iop_sd_pa=self.iop_sd_pa,
            radius_m=self.radius_m,
            radius_sd_m=self.radius_sd_m,
            globe=None if self.globe is None else self.globe.as_declared(),
            relaxation=relaxation,
        )


def open_doubts(globe: Globe | None) -> tuple[str, ...]:
    """Return a sentence if linear mechanics, which takes every globe for open, reads a
    sealed one.
    """
    return (_SEALED_DOUBT,) if globe is not None and globe.kind == "sealed" else ()
