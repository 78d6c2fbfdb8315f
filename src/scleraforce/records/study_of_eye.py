"""The eye of a study and its needle; tissue, mechanics, globe, supports and form belong
to virtual eyes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any

from scleraforce.base.errors import StudyError
from scleraforce.base.units import from_si
from scleraforce.records.fields import (
    Choice,
    Range,
    Sampled,
    StudySection,
    allowed_bounds,
    option,
    quantity,
)


@dataclass(frozen=True, kw_only=True)
class EyeStudy(StudySection):
    """The half-sphere and its material (paper sec. 2.1, 2.2)."""

    radius_m: float = quantity(12.0, "mm", 5.0, 30.0)
    poisson_ratio: float = quantity(0.45, None, 0.0, 0.499)
    density_kg_m3: float = quantity(1100.0, None, 0.0, 5000.0)
    iop_pa: float = quantity(2.0, "mmhg", 0.0, 80.0)
    thickness_m: Sampled = quantity(
        Choice((400.0, 500.0, 600.0, 700.0, 800.0)), "um", 300.0, 1200.0
    )
    youngs_modulus_pa: float = quantity(
        0.25,
        "mpa",
        allowed_bounds("youngs_modulus").low,
        allowed_bounds("youngs_modulus").high,
    )


@dataclass(frozen=True)
class MeshStudy(StudySection):
    """The mesh: quads on the sphere, extruded inward ("graded" towards the contact, as
    finite strain always is).

    "automatic": graded where a wall serves one contact alone, as in `simulate`, or is a
    whole globe on a bed; otherwise "hexahedra", so that the walls of `phantom`,
    `calibrate` and `generate` are alike. `divisions` and `level` belong to "hexahedra":
    a study that sets them gets it.
    """

    kind: str = option("automatic", "automatic", "hexahedra", "graded")
    divisions: int = quantity(10, None, 2, 200)
    level: int = quantity(1, None, 0, 6)
    core: int = quantity(6, None, 2, 40)
    rings: int = quantity(14, None, 1, 200)
    layers: int = quantity(1, None, 1, 20)
    order: int = quantity(2, None, 1, 2)

    def _check(self) -> None:
        if self.divisions % 2:
            raise StudyError(
                f"divisions: {self.divisions} is odd; a half cube needs an even number"
                " per edge"
            )
        if self.core % 2:
            raise StudyError(
                f"core: {self.core} is odd; the square under the needle needs an even"
                " number per side"
            )

    @property
    def grades_alone(self) -> bool:
        """A wall that serves one contact alone is graded."""
        cube = self.divisions, self.level
        return self.kind == "graded" or (
            self.kind == "automatic" and cube == (MeshStudy.divisions, MeshStudy.level)
        )


@dataclass(frozen=True, kw_only=True)
class NeedleStudy(StudySection):
    """The needle (22G: 0.7 mm) and where it pushes; in finite strain its force may tilt
    against the normal.
    """

    outer_diameter_m: float = quantity(0.7, "mm", 0.1, 5.0)
    gap_m: float = quantity(0.5, "mm", 0.0, 5.0)
    polar_angle_rad: Sampled = quantity(Range(min=25.0, max=45.0), "deg", 0.0, 80.0)
    max_force_n: float = quantity(60.0, "mn", 1.0, 1000.0)
    tilt_rad: float = quantity(0.0, "deg", 0.0, 30.0)
    tilt_direction_rad: float = quantity(0.0, "deg", -360.0, 360.0)


@dataclass(frozen=True)
class MechanicsStudy(StudySection):
    """Linear mechanics, or finite strain; `follower`: the pressure stays normal to the
    wall as it bends.
    """

    kind: str = option("linear", "linear", "finite-strain")
    follower: bool = True


@dataclass(frozen=True)
class TissueStudy(StudySection):
    """The wall's material beside Young's modulus and Poisson's ratio, in finite strain.

    `stiffening` is b of `mechanics.tissue_material`, without a unit; 0: neo-Hookean. In
    tension, at a strain of 5 %, the tangent modulus is 0.92 E with b = 0, and 0.93,
    1.12 and 1.62 E with 1, 10 and 30.

    `softer_through`: E along the wall over that of the matrix between the fibres, which
    shear through the wall meets; `stiffer_around`: E around the eye's axis over E along
    the meridian, whose geometric mean is E (`neo_hookean_solid`).

    `relaxation` (term, 2): the share of a held force that is lost in the end, and its
    time constant in s, drawn for each eye (`mechanics.tissue_material`); no terms: the
    tissue is elastic.
    """

    stiffening: float = quantity(0.0, None, 0.0, 200.0)
    softer_through: float = quantity(1.0, None, 1.0, 100.0)
    stiffer_around: float = quantity(1.0, None, 1.0, 10.0)
    relaxation: tuple[tuple[Sampled, ...], ...] = quantity((), None, 0.0, 1e5)

    def _check(self) -> None:
        check_relaxation(
            [
                [value.bounds[1 - place] for place, value in enumerate(term)]
                for term in self.relaxation
            ]
        )


def check_relaxation(terms: Sequence[Sequence[float]]) -> None:
    """Check terms of relaxation: the largest shares and the shortest times."""
    if any(len(term) != 2 for term in terms):
        raise StudyError(
            "relaxation: a term is a share and a time constant in s: [[0.12, 1.2],"
            " [0.15, 12.0]]"
        )
    if (
        not all(0.0 <= share < 1.0 for share, _ in terms)
        or not sum(share for share, _ in terms) < 1.0
    ):
        raise StudyError(
            "relaxation: shares are 0 or more and add up to less than 1: a part of the"
            " force is left"
        )
    if not all(time_s > 0.0 for _, time_s in terms):
        raise StudyError(
            "relaxation: a time constant is 0 s or may be; give a time above 0"
        )


def relaxation_terms(text: str) -> tuple[tuple[float, float], ...]:
    """Return terms of a share and a time constant, s, from their text; "none" has no
    terms: elastic tissue.

    >>> relaxation_terms("0.12:1.2,0.15:12"), relaxation_terms("none")
    (((0.12, 1.2), (0.15, 12.0)), ())

    Raises:
        StudyError: it is no such text, or has impossible terms.
    """
    if text.strip() == "none":
        return ()

    try:
        share_time = [tuple(map(float, term.split(":"))) for term in text.split(",")]
        terms = tuple((share, time_s) for share, time_s in share_time)
    except ValueError as fault:
        raise StudyError(
            f"relaxation: {text!r:.60}; give none, or SHARE:SECONDS,... like"
            " 0.12:1.2,0.15:12"
        ) from fault

    check_relaxation(terms)
    if not all(isfinite(time_s) for _, time_s in terms):
        raise StudyError("relaxation: a time constant is not finite; give seconds")

    return terms


def relaxation_text(terms: Sequence[Sequence[float]]) -> str:
    """Return the text of terms, which `relaxation_terms` reads.

    >>> relaxation_text([(0.12, 1.2), (0.15, 12.0)]), relaxation_text(())
    ('0.12:1.2,0.15:12.0', 'none')

    Raises:
        StudyError: the terms are impossible.
    """
    check_relaxation(terms)
    return ",".join(":".join(map(repr, map(float, term))) for term in terms) or "none"


@dataclass(frozen=True, kw_only=True)
class SupportsStudy(StudySection):
    """The paper's clamped base; or an eye's supports in the head: an elastic bed,
    straps of rectus muscles, or both.

    `bed`, `bed-and-straps`: a whole globe whose lower half lies on springs; their
    stiffness is a pressure per metre of displacement. The bed's defaults: an eye gives
    way by some tenths of a millimetre under 0.1 N, as under an air-puff tonometer, and
    turns about its axis by 1 degree under 0.6 g cm (Simonsz, Vision Research 24, 1984,
    961). Straps: muscles, passive or held in the primary position, of 0.03 to 1 g a
    degree each (20 N/m is 0.4).
    """

    kind: str = option("clamped", "clamped", "bed", "straps", "bed-and-straps")
    bed_stiffness_pa_per_m: float = quantity(1.4, "kpa_per_mm", 1e-3, 1e6)
    bed_shear_stiffness_pa_per_m: float = quantity(0.04, "kpa_per_mm", 1e-3, 1e6)
    strap_stiffness_n_per_m: float = quantity(20.0, None, 0.0, 1e6)
    medial_azimuth_rad: float = quantity(0.0, "deg", -360.0, 360.0)

    @property
    def has_bed(self) -> bool:
        """The eye is a whole globe on a bed."""
        return self.kind in ("bed", "bed-and-straps")

    @property
    def has_straps(self) -> bool:
        """The rectus muscles hold the eye, too."""
        return self.kind in ("straps", "bed-and-straps")


GLOBES = ("open", "sealed")
RIGIDITY_LAWS = ("cube-root", "logarithmic")


@dataclass(frozen=True)
class GlobeStudy(StudySection):
    """An open globe (infused or vented), as in the paper, or a sealed one, whose
    pressure rises with the dent.

    `rigidity_pa13_per_m3` is k of `rigidity_law` (`records.globe`); the default is
    that of enucleated human eyes (van der Werff 1981). `leak_time_s`: of the displaced
    volume that has left a sealed globe; 0: it does not leak.
    """

    kind: str = option("open", *GLOBES)
    rigidity_pa13_per_m3: float = quantity(
        0.03,
        "mmhg13_per_ul",
        allowed_bounds("rigidity").low,
        allowed_bounds("rigidity").high,
    )
    rigidity_law: str = option("cube-root", *RIGIDITY_LAWS)
    leak_time_s: float = quantity(0.0, None, 0.0, 1e6)

    def _check(self) -> None:
        if 0.0 < self.leak_time_s < 1.0:
            raise StudyError(
                f"leak_time_s: {self.leak_time_s:g}; must be 1 s or more, or 0: no leak"
            )

    def with_known(
        self, kind: str | None, rigidity_pa13_per_m3: float | None
    ) -> "GlobeStudy":
        """Return the globe with its known kind and rigidity; None: unknown."""
        known: dict[str, Any] = {}
        if kind is not None:
            known["kind"] = kind
        if rigidity_pa13_per_m3 is not None:
            known["rigidity_pa13_per_m3"] = rigidity_pa13_per_m3

        return replace(self, **known)


MOST_UNEVEN = 0.5  # sum of the waves' amplitudes


@dataclass(frozen=True, kw_only=True)
class WaveStudy(StudySection):
    """One wave of the wall's thickness: a Legendre polynomial of the angle to an axis,
    times the amplitude.

    Degree 1: thick on the axis's side and thin on the other; 2: thick at both ends of
    the axis; 3: two waves around.
    """

    amplitude_fraction: float = quantity(10.0, "percent", -40.0, 40.0)
    degree: int = quantity(1, None, 1, 3)
    polar_rad: float = quantity(0.0, "deg", 0.0, 180.0)
    azimuth_rad: float = quantity(0.0, "deg", -360.0, 360.0)


@dataclass(frozen=True, kw_only=True)
class RegionStudy(StudySection):
    """A spherical cap of another modulus; the default is as wide as the cornea: 11.5 mm
    across on an eye of 24 mm.

    `edge_rad`: width over which the modulus goes over into the rest's, half of it on
    either side of the cap's edge.
    """

    modulus_ratio: float = quantity(1.0, None, 0.05, 20.0)
    half_angle_rad: float = quantity(28.6, "deg", 1.0, 180.0)
    edge_rad: float = quantity(5.0, "deg", 0.1, 90.0)
    polar_rad: float = quantity(0.0, "deg", 0.0, 180.0)
    azimuth_rad: float = quantity(0.0, "deg", -360.0, 360.0)


@dataclass(frozen=True, kw_only=True)
class CorneaStudy(StudySection):
    """A cornea of another radius than the globe's; the defaults are a human eye's.

    The outer surface inside the limbus, a ring of `limbus_radius_m` about the cornea's
    axis, is a sphere of `radius_m` through the ring. Across the ring, `edge_m` wide as
    measured along the globe, it goes over into the globe smoothly.
    """

    radius_m: float = quantity(7.8, "mm", 2.0, 30.0)
    limbus_radius_m: float = quantity(5.75, "mm", 1.0, 20.0)
    edge_m: float = quantity(2.0, "mm", 0.5, 10.0)
    polar_rad: float = quantity(0.0, "deg", 0.0, 90.0)
    azimuth_rad: float = quantity(0.0, "deg", -360.0, 360.0)

    def _check(self) -> None:
        if not self.limbus_radius_m < self.radius_m:
            ring, cornea = (
                f"{from_si(value, 'mm'):g}"
                for value in (self.limbus_radius_m, self.radius_m)
            )
            raise StudyError(
                f"limbus_radius_mm: {ring}; must be below the cornea's radius_mm,"
                f" {cornea}"
            )


@dataclass(frozen=True)
class FormStudy(StudySection):
    """Semi-axes as shares of the radius, of the whole eye; waves of the thickness,
    regions, and a cornea.
    """

    semi_axes: tuple[float, ...] = quantity((1.0, 1.0, 1.0), None, 0.7, 1.3)
    wave: tuple[WaveStudy, ...] = ()
    region: tuple[RegionStudy, ...] = ()
    cornea: CorneaStudy | None = None

    def _check(self) -> None:
        if len(self.semi_axes) != 3:
            raise StudyError("semi_axes: give three ratios, like [1.0, 1.0, 1.0]")
        if sum(abs(wave.amplitude_fraction) for wave in self.wave) > MOST_UNEVEN:
            raise StudyError(
                f"wave: the amplitudes add up to more than {MOST_UNEVEN:.0%}"
            )
