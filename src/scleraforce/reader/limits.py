"""Where a recording lies outside what a model was trained on: sentences for the reader of a result."""

from math import degrees
from pathlib import Path

from scleraforce.reader.model import ForceReader
from scleraforce.reader.wall_reader import WallReader
from scleraforce.recording.files import Recording
from scleraforce.recording.info import RecordingInfo
from scleraforce.study import Choice, Sampled, Study
from scleraforce.units import mmhg_to_pa

__all__ = ["limits"]

Compared = tuple[str, float | None, Sampled, float, str]  # what, value, covered range, printed units in one of SI, unit


def limits(reader: ForceReader | WallReader, path: Path, recording: Recording) -> tuple[str, ...]:
    """Return a sentence for each known quantity of a recording that the model's training did not cover.

    Args:
        reader: the model.
        path: of the recording, as given.
        recording: the recording.
    """
    study, info = reader.study, recording.info
    compared = _of_walls(study, info) if isinstance(reader, WallReader) else _of_slices(study, info)
    found = [_outside(*entry) for entry in compared]
    sentences = [f"{path}: {sentence}" for sentence in found if sentence]
    if recording.forces is None:
        sentences.append(f"{path}: no forces.csv: its frames are read, but not scored")
    return tuple(sentences)


def _of_walls(study: Study, info: RecordingInfo) -> tuple[Compared, ...]:
    """Return what the walls of the library covered, which do not depend on where on the eye the needle pushes."""
    reader = study.reader
    return (
        ("gap between B-scan and needle axis", info.needle.slice_gap_m, reader.gap_m, 1e3, "mm"),
        ("wall thickness", info.eye.thickness_m, reader.thickness_m, 1e6, "µm"),
        ("IOP", info.eye.iop_pa, reader.iop_pa, 1 / mmhg_to_pa(1.0), "mmHg"),
        ("tilt of the B-scan", info.oct.plane_tilt_rad, reader.tilt_rad, degrees(1.0), "°"),
    )


def _of_slices(study: Study, info: RecordingInfo) -> tuple[Compared, ...]:
    """Return what a classifier's data set covered."""
    gap = study.dataset.gap_m or Choice((study.needle.gap_m,))
    thickness = Choice(tuple(group.thickness_m for group in study.dataset.group))
    return (
        ("gap between B-scan and needle axis", info.needle.slice_gap_m, gap, 1e3, "mm"),
        ("wall thickness", info.eye.thickness_m, thickness, 1e6, "µm"),
        ("polar angle", info.needle.polar_angle_rad, study.needle.polar_angle_rad, degrees(1.0), "°"),
        ("tilt of the B-scan", info.oct.plane_tilt_rad, study.dataset.tilt_rad, degrees(1.0), "°"),
        ("direction of the B-scan", info.oct.plane_direction_rad, study.dataset.direction_rad, degrees(1.0), "°"),
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
