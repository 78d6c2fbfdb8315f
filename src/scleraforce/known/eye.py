"""What is known of an eye beside its frame: modulus, IOP, thickness, gap. Each may be missing."""

from dataclasses import dataclass, fields, replace
from math import sqrt

from scleraforce.known.calibration_file import CalibrationSummary
from scleraforce.known.discrepancy import ForceDiscrepancy
from scleraforce.known.globe import KnownGlobe, completed_globe, known_globe
from scleraforce.recording.folder import EyeInfo, RecordingInfo
from scleraforce.units import from_si

STATED_MODULUS_SD = 0.03  # relative, of a modulus that comes without its uncertainty
POPULATION_SD = 0.12  # relative: eyes differ by so much (paper, Table 2), also where a file knows too few to tell
LEAST_MODULUS_SD = 0.01  # relative: below it mechanics and segmentation are what is uncertain
NAMED_EYES = 8  # of a calibration file, in a sentence
SEALED = "eye.globe is sealed, and linear mechanics takes every eye for an open one: forces are read too low"


@dataclass(frozen=True, kw_only=True)
class Modulus:
    """Young's modulus with its standard deviation, Pa, and where it comes from ("own", "population", "stated")."""

    mean_pa: float
    sd_pa: float
    source: str

    @property
    def relative_sd(self) -> float:
        """Standard deviation over mean, never less than 1 %.

        >>> Modulus(mean_pa=250e3, sd_pa=10e3, source="own").relative_sd
        0.04
        """
        return max(self.sd_pa / self.mean_pa, LEAST_MODULUS_SD)

    @classmethod
    def stated(cls, mean_pa: float) -> "Modulus":
        """A modulus that someone gives, without saying how sure it is."""
        return cls(mean_pa=mean_pa, sd_pa=STATED_MODULUS_SD * mean_pa, source="stated")


@dataclass(frozen=True, kw_only=True)
class Known:
    """What is known of an eye and of the B-scan's place; None: unknown.

    `gap_m` is the distance of the B-scan plane from the needle axis, `polar_rad` the polar angle of the contact,
    `direction_rad` that of the plane's lateral axis from the meridian.
    `globe` is what was told of the globe; None, nothing, is read as `globe.UNKNOWN`. `stiffening` is b of the tissue
    (`mechanics.stiffening`); None is read as 0, tissue that does not stiffen. `discrepancy` goes with an eye's own
    modulus.
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

    @property
    def has_own_modulus(self) -> bool:
        """Whether E was found on frames of the eye."""
        return self.modulus is not None and self.modulus.source == "own"

    @property
    def scatter(self) -> float:
        """By how much intervals are wider for what the eye's frames of known force showed (`ForceDiscrepancy`)."""
        return 1.0 if self.discrepancy is None else self.discrepancy.scatter


NOTHING_KNOWN = Known()


def known_of_recording(info: RecordingInfo) -> Known:
    """Return what a recording states about its eye; it never states the modulus, which a calibration may add."""
    needle = info.needle
    return Known(
        modulus=None,
        iop_pa=info.eye.iop_pa,
        thickness_m=info.eye.thickness_m,
        gap_m=needle.slice_gap_m,
        polar_rad=needle.polar_angle_rad,
        direction_rad=info.oct.plane_direction_rad,
        globe=told_globe(info.eye),
    )


def told_globe(eye: EyeInfo) -> KnownGlobe | None:
    """Return what a recording says of its globe; None: nothing."""
    if eye.globe is None:
        return None
    return known_globe(eye.globe, eye.rigidity_pa13_per_m3, eye.rigidity_law)


def stated_eye(eye: str, known: Known) -> EyeInfo:
    """Return what a recording of an eye may state of it: what was told; what a calibration found stands in its file."""
    globe = known.globe
    if globe is None or globe.kind != "sealed":
        told = None if globe is None or globe.kind == "unknown" else globe.kind
        return EyeInfo(eye, thickness_m=known.thickness_m, iop_pa=known.iop_pa, globe=told)
    return EyeInfo(
        eye,
        thickness_m=known.thickness_m,
        iop_pa=known.iop_pa,
        globe=globe.kind,
        rigidity_pa13_per_m3=globe.mean if globe.rigidity_told and not globe.calibrated else None,
        rigidity_law=globe.law,
    )


def open_doubts(globe: str | None) -> tuple[str, ...]:
    """Return a sentence on what linear mechanics makes of a globe; none of an open or unknown one.

    >>> open_doubts("open")
    ()
    """
    return (SEALED,) if globe == "sealed" else ()


def completed(told: Known, stated: Known) -> Known:
    """Return what was told of an eye, and what else was stated; likewise of a globe of the kind that was told.

    >>> completed(Known(gap_m=0.4e-3), Known(gap_m=0.5e-3, iop_pa=266.0)) == Known(gap_m=0.4e-3, iop_pa=266.0)
    True
    """
    missing = [item.name for item in fields(Known) if getattr(told, item.name) is None]
    globe = completed_globe(told.globe, stated.globe)
    return replace(told, **{**{name: getattr(stated, name) for name in missing}, "globe": globe})


def known_of_eye(known: Known, summary: CalibrationSummary, eye: str) -> Known:
    """Return what is known of an eye once a calibration adds its modulus.

    A modulus goes with the stiffening of its tissue; one of the eye's own with the wall's thickness that it was
    calibrated with, and with what was found of its globe, unless a kind was told then and another one is told now. Of
    an eye whose calibration diverged nothing of its modulus is known, and nothing of the globe where its frames
    contradict what was told of that: the file's is unknown then.
    """
    modulus = calibrated_modulus(summary, eye)
    own = summary.eyes.get(eye)
    if own is not None and not own.usable:
        return replace(known, modulus=None, globe=None if own.globe.kind == "unknown" else known.globe)
    if own is None or modulus is None or modulus.source != "own":
        return replace(known, modulus=modulus, stiffening=summary.population_stiffening)
    globe = own.globe if known.globe is None or own.globe.kind in (known.globe.kind, "unknown") else known.globe
    return replace(
        known,
        modulus=modulus,
        thickness_m=own.thickness_m,
        globe=globe,
        stiffening=own.stiffening,
        discrepancy=own.discrepancy,
    )


def calibrated_modulus(summary: CalibrationSummary, eye: str) -> Modulus | None:
    """Return an eye's own modulus where a calibration found it, else its population's with the spread of eyes.

    None for an eye whose calibration diverged: it is not one of those that the model describes, so nothing is known of
    its modulus; likewise where that holds for all eyes. The spread is at least the paper's. A single eye says nothing
    of it, and may itself lie off the mean by as much: the eye that is read then differs from it by the spread of two
    eyes.
    """
    own = summary.eyes.get(eye)
    if own is not None and own.usable:
        return Modulus(mean_pa=own.mean_pa, sd_pa=own.sd_pa, source="own")
    if own is not None or not any(other.usable for other in summary.eyes.values()):
        return None
    mean_pa = summary.population_mean_pa
    if summary.population_sd_pa is None:
        return Modulus(mean_pa=mean_pa, sd_pa=sqrt(2.0) * POPULATION_SD * mean_pa, source="population")
    return Modulus(mean_pa=mean_pa, sd_pa=max(summary.population_sd_pa, POPULATION_SD * mean_pa), source="population")


def foreign_modulus(summary: CalibrationSummary, eye: str) -> str | None:
    """Return a sentence where an eye is read without a modulus of its own, None where it has one.

    It names the eye and the file's eyes, for the id may be mistyped.
    """
    own = summary.eyes.get(eye)
    if own is not None and own.usable:
        return None
    there = "is not in" if own is None else f"is not usable ({own.status}) in"
    names = ", ".join(list(summary.eyes)[:NAMED_EYES]) + (", ..." if len(summary.eyes) > NAMED_EYES else "")
    modulus = calibrated_modulus(summary, eye)
    count = "1 eye" if len(summary.eyes) == 1 else f"{len(summary.eyes)} eyes"
    read = (
        "as one of unknown modulus"
        + (" in a globe of which nothing is known" if own and own.globe.kind == "unknown" else "")
        if modulus is None
        else (
            f"with the population's modulus, {from_si(modulus.mean_pa, 'mpa'):.3g} MPa +- "
            f"{from_si(modulus.relative_sd, 'percent'):.0f} %"
        )
    )
    return f"{eye} {there} {summary.path}, which has {count} ({names}): read {read}"
