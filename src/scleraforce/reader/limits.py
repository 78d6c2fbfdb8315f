"""Where a recording lies outside what a model was trained on: sentences for the reader of a result."""

from math import degrees
from pathlib import Path

from scleraforce.recording.files import Recording
from scleraforce.study import Choice, Sampled, Study

__all__ = ["limits"]


def limits(study: Study, path: Path, recording: Recording) -> tuple[str, ...]:
    """Return a sentence for each known quantity of a recording that the model's training did not cover.

    Args:
        study: of the model.
        path: of the recording, as given.
        recording: the recording.
    """
    info = recording.info
    gap = study.dataset.gap_m or Choice((study.needle.gap_m,))
    thickness = Choice(tuple(group.thickness_m for group in study.dataset.group))
    compared = (
        ("gap between B-scan and needle axis", info.needle.slice_gap_m, gap, 1e3, "mm"),
        ("wall thickness", info.eye.thickness_m, thickness, 1e6, "µm"),
        ("polar angle", info.needle.polar_angle_rad, study.needle.polar_angle_rad, degrees(1.0), "°"),
        ("tilt of the B-scan", info.oct.plane_tilt_rad, study.dataset.tilt_rad, degrees(1.0), "°"),
        ("direction of the B-scan", info.oct.plane_direction_rad, study.dataset.direction_rad, degrees(1.0), "°"),
    )
    found = [_outside(name, value, trained, factor, unit) for name, value, trained, factor, unit in compared]
    sentences = [f"{path}: {sentence}" for sentence in found if sentence]
    if recording.forces is None:
        sentences.append(f"{path}: no forces.csv: its frames are read, but not scored")
    return tuple(sentences)


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
