"""Where an eye and its B-scans lie outside what a model was trained on: sentences for the reader of a result."""

from math import degrees

from scleraforce.known.eye import Known, sealed_doubts
from scleraforce.recording.info import OctInfo
from scleraforce.study import Choice, Sampled, Study
from scleraforce.units import mmhg_to_pa

__all__ = ["slice_limits", "wall_limits"]

Compared = tuple[str, float | None, Sampled, float, str]  # what, value, covered range, printed units in one of SI, unit


def wall_limits(study: Study, known: Known, scan: OctInfo) -> tuple[str, ...]:
    """Return a sentence for each known quantity that the walls of the library did not cover, and on a sealed globe.

    They do not depend on where on the eye the needle pushes.

    Args:
        study: of the model.
        known: of the eye.
        scan: the plane of the B-scans.
    """
    reader = study.reader
    return _sentences(
        known,
        ("gap between B-scan and needle axis", known.gap_m, reader.gap_m, 1e3, "mm"),
        ("wall thickness", known.thickness_m, reader.thickness_m, 1e6, "µm"),
        ("IOP", known.iop_pa, reader.iop_pa, 1 / mmhg_to_pa(1.0), "mmHg"),
        ("tilt of the B-scan", scan.plane_tilt_rad, reader.tilt_rad, degrees(1.0), "°"),
    )


def slice_limits(study: Study, known: Known, scan: OctInfo) -> tuple[str, ...]:
    """Return a sentence for each known quantity that a classifier's data set did not cover; arguments as above."""
    gap = study.dataset.gap_m or Choice((study.needle.gap_m,))
    thickness = Choice(tuple(group.thickness_m for group in study.dataset.group))
    return _sentences(
        known,
        ("gap between B-scan and needle axis", known.gap_m, gap, 1e3, "mm"),
        ("wall thickness", known.thickness_m, thickness, 1e6, "µm"),
        ("polar angle", known.polar_rad, study.needle.polar_angle_rad, degrees(1.0), "°"),
        ("tilt of the B-scan", scan.plane_tilt_rad, study.dataset.tilt_rad, degrees(1.0), "°"),
        ("direction of the B-scan", scan.plane_direction_rad, study.dataset.direction_rad, degrees(1.0), "°"),
    )


def _sentences(known: Known, *compared: Compared) -> tuple[str, ...]:
    return (*sealed_doubts(known.globe), *(sentence for entry in compared if (sentence := _outside(*entry))))


def _outside(name: str, value: float | None, trained: Sampled, factor: float, unit: str) -> str | None:
    """Compare in the printed unit, to four digits: what prints alike is alike."""
    if value is None:
        return None
    low, high = (bound * factor for bound in trained.bounds)
    slack = 1e-4 * max(abs(low), abs(high), 1.0)
    if low - slack <= value * factor <= high + slack:
        return None
    covered = f"{low:.4g} {unit}" if low == high else f"{low:.4g} to {high:.4g} {unit}"
    return f"{name} {value * factor:.4g} {unit}, the model was trained on {covered}"
