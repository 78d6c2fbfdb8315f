"""A wall finder that trains in a moment, on scenes that are easy; and one that never learned anything."""

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from scleraforce.models.folder import write_folder
from scleraforce.study import ScenesStudy, Study, WallFinderStudy, format_study, study_hash
from scleraforce.study.fields import Range, fixed

__all__ = ["SMALL_STUDY", "write_blind_finder"]


def _without_disturbance(record: Any) -> Any:
    """A record whose shares are 0 and whose counts are none."""
    shares = {item.name: 0.0 for item in fields(record) if isinstance(getattr(record, item.name), float)}
    counts = {item.name: fixed(0) for item in fields(record) if item.name.endswith("_count")}
    return replace(record, **shares, **counts)


def _easy(scenes: ScenesStudy) -> ScenesStudy:
    return ScenesStudy(
        window=replace(
            scenes.window,
            rows=fixed(64),
            columns=fixed(64),
            pixel_m=Range(min=1e-6, max=100e-6),
            width_m=fixed(10e-3),
            depth_share=fixed(0.4),
            centred_share=1.0,
            facing=fixed(1.0),
            surface_share=Range(min=0.1, max=0.4),
        ),
        eye=replace(_without_disturbance(scenes.eye), half_sphere_share=1.0, wave_m=fixed(0.0)),
        tissue=replace(_without_disturbance(scenes.tissue), corrected_share=1.0, snr_db=fixed(30.0)),
        over=_without_disturbance(scenes.over),
        scanner=replace(_without_disturbance(scenes.scanner), rolloff_db=fixed(0.0)),
    )


SMALL_STUDY = Study(
    scenes=_easy(ScenesStudy()),
    wall_finder=WallFinderStudy(
        rows=32, columns=32, channels=(8, 12), batch_size=8, batches=80, validation_scenes=12, learning_rate=0.01
    ),
)


def write_blind_finder(folder: Path) -> None:
    """Write the model folder of a network with random weights."""
    import torch

    from scleraforce.learning.wall_finder import WallFinderNetwork, finder_bytes

    with torch.random.fork_rng():
        torch.manual_seed(0)
        network = WallFinderNetwork(SMALL_STUDY.wall_finder).eval()
    provenance = {"study_sha256": study_hash(SMALL_STUDY)}
    record = {"kind": "wall-finder", "provenance": provenance}
    write_folder(folder, finder_bytes(network, provenance), format_study(SMALL_STUDY), "Blind.", record)
