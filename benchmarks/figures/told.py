"""What the recordings of the figures say of their eyes: about as wrong as what a user measures.

Pressure, thickness, gap, contact and direction are off by what `[reader]` says of those that a reader is told
(`iop_noise_fraction` and the others): the eyes that its intervals are measured on are told as wrongly.
"""

import os
import shutil
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from figures.commands import made
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.recordings import recording_key
from scleraforce.recording.folder import RecordingInfo, read_info
from scleraforce.study import ReaderStudy
from scleraforce.study.toml import format_record
from scleraforce.whole_files import write_whole

__all__ = ["as_told", "tell"]


def tell(folder: FiguresFolder, eyes: Iterable[FigureEye]) -> FiguresFolder:
    """Return the folder whose recordings are told so, with the same frames and force logs; make what is not there."""
    told = FiguresFolder(folder.work("told"))
    for drawn in eyes:
        key = recording_key(drawn)
        made(told.recording(drawn), key, partial(_write, folder.recording(drawn), drawn.seed))
        made(told.made(drawn), key, partial(_linked, folder.made(drawn)))
    return told


def _write(recording: Path, seed: int, told: Path) -> None:
    shutil.copytree(recording, told, copy_function=_linked, ignore=shutil.ignore_patterns("truth.json"))
    info = as_told(read_info(recording / "recording.toml"), ReaderStudy(), np.random.default_rng((seed, 1)))
    write_whole(format_record(info), told / "recording.toml")  # a new file: the links of the old one stay


def _linked(source: str | Path, target: str | Path) -> None:
    try:
        os.link(source, target)
    except OSError:  # a file system without links
        shutil.copyfile(source, target)


def as_told(info: RecordingInfo, reader: ReaderStudy, rng: np.random.Generator) -> RecordingInfo:
    """Return what a recording says as a user would have measured it.

    Args:
        info: the truth, with all of what is measured.
        reader: how wrong that is.
        rng: source of all randomness.
    """
    eye, needle, scanner = info.eye, info.needle, info.oct
    assert eye.iop_pa is not None
    assert eye.thickness_m is not None
    assert needle.polar_angle_rad is not None
    assert scanner.plane_direction_rad is not None
    iop, thickness, gap, polar, direction = rng.standard_normal(5).tolist()
    turned_rad = scanner.plane_direction_rad + reader.pole_noise_rad * direction
    return replace(
        info,
        eye=replace(
            eye,
            iop_pa=eye.iop_pa * (1.0 + reader.iop_noise_fraction * iop),
            thickness_m=eye.thickness_m * (1.0 + reader.thickness_noise_fraction * thickness),
        ),
        needle=replace(
            needle,
            slice_gap_m=needle.slice_gap_m * (1.0 + reader.gap_noise_fraction * gap),
            polar_angle_rad=abs(needle.polar_angle_rad + reader.pole_noise_rad * polar),
        ),
        oct=replace(scanner, plane_direction_rad=turned_rad),
    )
