"""Where a recording lies outside what a model was trained on: sentences for the reader of a result."""

from math import degrees
from pathlib import Path

from scleraforce.known.eye import Known, known_of_recording
from scleraforce.reader.model import ForceReader
from scleraforce.reader.wall_reader import WallReader
from scleraforce.recording.files import Recording
from scleraforce.recording.info import OctInfo
from scleraforce.study import Choice, Sampled, Study
from scleraforce.units import mmhg_to_pa

__all__ = ["limits", "limits_of"]

Compared = tuple[str, float | None, Sampled, float, str]  # what, value, covered range, printed units in one of SI, unit


def limits(reader: ForceReader | WallReader, path: Path, recording: Recording) -> tuple[str, ...]:
    """Return a sentence for each known quantity of a recording that the model's training did not cover.

    Args:
        reader: the model.
        path: of the recording, as given.
        recording: the recording.
    """
    sentences = limits_of(reader, str(path), known_of_recording(recording.info), recording.info.oct)
    if recording.forces is None:
        return (*sentences, f"{path}: no forces.csv: its frames are read, but not scored")
    return sentences


def limits_of(reader: ForceReader | WallReader, place: str, known: Known, scan: OctInfo) -> tuple[str, ...]:
    """Return a sentence for each known quantity of an eye and its B-scans that the model's training did not cover.

    Args:
        reader: the model.
        place: that the sentences begin with.
        known: of the eye.
        scan: the plane of the B-scans.
    """
    study = reader.study
    compared = _of_walls(study, known, scan) if isinstance(reader, WallReader) else _of_slices(study, known, scan)
    return tuple(f"{place}: {sentence}" for entry in compared if (sentence := _outside(*entry)))


def _of_walls(study: Study, known: Known, scan: OctInfo) -> tuple[Compared, ...]:
    """Return what the walls of the library covered, which do not depend on where on the eye the needle pushes."""
    reader = study.reader
    return (
        ("gap between B-scan and needle axis", known.gap_m, reader.gap_m, 1e3, "mm"),
        ("wall thickness", known.thickness_m, reader.thickness_m, 1e6, "µm"),
        ("IOP", known.iop_pa, reader.iop_pa, 1 / mmhg_to_pa(1.0), "mmHg"),
        ("tilt of the B-scan", scan.plane_tilt_rad, reader.tilt_rad, degrees(1.0), "°"),
    )


def _of_slices(study: Study, known: Known, scan: OctInfo) -> tuple[Compared, ...]:
    """Return what a classifier's data set covered."""
    gap = study.dataset.gap_m or Choice((study.needle.gap_m,))
    thickness = Choice(tuple(group.thickness_m for group in study.dataset.group))
    return (
        ("gap between B-scan and needle axis", known.gap_m, gap, 1e3, "mm"),
        ("wall thickness", known.thickness_m, thickness, 1e6, "µm"),
        ("polar angle", known.polar_rad, study.needle.polar_angle_rad, degrees(1.0), "°"),
        ("tilt of the B-scan", scan.plane_tilt_rad, study.dataset.tilt_rad, degrees(1.0), "°"),
        ("direction of the B-scan", scan.plane_direction_rad, study.dataset.direction_rad, degrees(1.0), "°"),
    )


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
