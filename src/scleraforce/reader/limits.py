"""Where an eye and its B-scans lie outside what a model was trained on: sentences for the reader of a result."""

from scleraforce.known.eye import Known, open_doubts
from scleraforce.reader.needle_gap import read_by_fit
from scleraforce.recording.info import OctInfo
from scleraforce.study import Choice, Sampled, Study
from scleraforce.units import HumanUnit, from_si

__all__ = ["slice_limits", "wall_limits"]

Compared = tuple[str, float | None, Sampled, HumanUnit, str]  # what, value, covered range, unit, as printed


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
