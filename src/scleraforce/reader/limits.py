"""Where an eye and its B-scans lie outside what a model was trained on: sentences for the reader of a result."""

from math import hypot

from scleraforce.known.eye import Known, Modulus, open_doubts
from scleraforce.reader.needle_gap import read_by_fit
from scleraforce.recording.info import OctInfo
from scleraforce.study import Choice, LibraryStudy, ReaderStudy, Sampled, Study
from scleraforce.units import HumanUnit, from_si

__all__ = ["outside_training", "slice_limits", "wall_limits"]

Compared = tuple[str, float | None, Sampled, HumanUnit, str]  # what, value, covered range, unit, as printed


def outside_training(known: Known, trained: ReaderStudy, library: LibraryStudy) -> str | None:
    """Return why a model cannot read an eye: what is known of it lies outside what it was trained on; None: inside.

    A value that is not a number is outside. A modulus of the eye's own may lie as far outside as it is uncertain, its
    standard deviation and what errors of the told thickness and IOP make of it: the training told such moduli.

    Args:
        known: of the eye.
        trained: the study's ranges.
        library: whose tissue it was trained on.

    >>> outside_training(Known(thickness_m=1.0e-3), ReaderStudy(), LibraryStudy())
    'wall thickness 1000 µm, the model was trained on 380 to 900 µm'
    """
    reasons = _sentences(
        ("Young's modulus", _uncovered_modulus(known.modulus, trained), trained.youngs_modulus_pa, "mpa", "MPa"),
        ("IOP", known.iop_pa, trained.iop_pa, "mmhg", "mmHg"),
        ("wall thickness", known.thickness_m, trained.thickness_m, "um", "µm"),
        ("gap between B-scan and needle axis", known.gap_m, trained.gap_m, "mm", "mm"),
    )
    if reasons:
        return reasons[0]
    softest, stiffest = library.stiffening_ends
    stiffening = known.stiffening or 0.0
    if not softest <= stiffening <= stiffest:
        return f"stiffening {stiffening:.4g} of the tissue, the model was trained on {softest:g} to {stiffest:g}"
    return None


def _uncovered_modulus(modulus: Modulus | None, trained: ReaderStudy) -> float | None:
    """Return a modulus, Pa, to compare with the training's range; None where it is an eye's own and near enough.

    At a given dent F goes as E t^2 IOP^(1/3) (`learning.reader.samples`), so a calibrated E takes twice the error of
    the thickness and a third of the pressure's.
    """
    if modulus is None:
        return None
    low, high = trained.youngs_modulus_pa.bounds
    told = hypot(2.0 * trained.thickness_noise_fraction, trained.iop_noise_fraction / 3.0)
    reach = hypot(modulus.relative_sd, told) if modulus.source == "own" else 0.0
    return None if low * (1.0 - reach) <= modulus.mean_pa <= high * (1.0 + reach) else modulus.mean_pa


def wall_limits(study: Study, known: Known, scan: OctInfo) -> tuple[str, ...]:
    """Return a sentence for each known quantity that the walls of the library did not cover.

    They do not depend on where on the eye the needle pushes.

    Args:
        study: of the model.
        known: of the eye.
        scan: the plane of the B-scans.
    """
    reader = read_by_fit(study.reader)
    return _sentences(
        ("gap between B-scan and needle axis", known.gap_m, reader.gap_m, "mm", "mm"),
        ("wall thickness", known.thickness_m, reader.thickness_m, "um", "µm"),
        ("IOP", known.iop_pa, reader.iop_pa, "mmhg", "mmHg"),
        ("tilt of the B-scan", scan.plane_tilt_rad, reader.tilt_rad, "deg", "°"),
    )


def slice_limits(study: Study, known: Known, scan: OctInfo) -> tuple[str, ...]:
    """Return a sentence for each known quantity that a classifier's data set did not cover, and on a sealed globe."""
    gap = study.dataset.gap_m or Choice((study.needle.gap_m,))
    thickness = Choice(tuple(group.thickness_m for group in study.dataset.group))
    sealed = open_doubts(None if known.globe is None else known.globe.kind)
    return sealed + _sentences(
        ("gap between B-scan and needle axis", known.gap_m, gap, "mm", "mm"),
        ("wall thickness", known.thickness_m, thickness, "um", "µm"),
        ("polar angle", known.polar_rad, study.needle.polar_angle_rad, "deg", "°"),
        ("tilt of the B-scan", scan.plane_tilt_rad, study.dataset.tilt_rad, "deg", "°"),
        ("direction of the B-scan", scan.plane_direction_rad, study.dataset.direction_rad, "deg", "°"),
    )


def _sentences(*compared: Compared) -> tuple[str, ...]:
    return tuple(sentence for entry in compared if (sentence := _outside(*entry)))


def _outside(name: str, value: float | None, trained: Sampled, unit: HumanUnit, printed: str) -> str | None:
    """Compare in the printed unit, to four digits: what prints alike is alike."""
    if value is None:
        return None
    low, high = (from_si(bound, unit) for bound in trained.bounds)
    found = from_si(value, unit)
    slack = 1e-4 * max(abs(low), abs(high), 1.0)
    if low - slack <= found <= high + slack:
        return None
    covered = f"{low:.4g} {printed}" if low == high else f"{low:.4g} to {high:.4g} {printed}"
    return f"{name} {found:.4g} {printed}, the model was trained on {covered}"
