"""Recordings whose declared values have the errors of users' measurements.

Pressure, thickness, gap, contact, direction and lean have the noise of `[reader]`
(`iop_noise_fraction` and the others; a lean that of the pole), like the eyes that the
intervals are measured on.
"""

import os
import shutil
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.recordings import recording_key
from figures.reuse import made
from scleraforce.base.whole_files import write_whole
from scleraforce.recordings.recording_folder import read_info
from scleraforce.records.decoder import format_record
from scleraforce.records.needle import lean_ends
from scleraforce.records.recording_info import RecordingInfo
from scleraforce.records.study import ReaderStudy


def declare(folder: FiguresFolder, eyes: Iterable[FigureEye]) -> FiguresFolder:
    """Return the folder of these recordings, with the same frames and force logs; make
    the missing ones.
    """
    told = FiguresFolder(folder.work("told"))
    for drawn in eyes:
        key = recording_key(drawn)
        made(
            told.recording(drawn),
            key,
            partial(_write, folder.recording(drawn), drawn.seed),
        )
        made(told.made(drawn), key, partial(_linked, folder.made(drawn)))

    return told


def _write(recording: Path, seed: int, told: Path) -> None:
    shutil.copytree(
        recording,
        told,
        copy_function=_linked,
        ignore=shutil.ignore_patterns("truth.json"),
    )
    info = as_declared(
        read_info(recording / "recording.toml"),
        ReaderStudy(),
        np.random.default_rng((seed, 1)),
    )
    # a new file: the links of the old one stay
    write_whole(format_record(info), told / "recording.toml")


def _linked(source: str | Path, target: str | Path) -> None:
    try:
        os.link(source, target)
    except OSError:  # a file system without links
        shutil.copyfile(source, target)


def as_declared(
    info: RecordingInfo, reader: ReaderStudy, rng: np.random.Generator
) -> RecordingInfo:
    """Return a recording's values as a user would have measured them.

    Args:
        info: the true values, all of them.
        reader: size of the errors.
        rng: source of all randomness.
    """
    eye = info.eye
    needle = info.needle
    scanner = info.scan
    assert eye.iop_pa is not None
    assert eye.thickness_m is not None
    assert needle.polar_rad is not None
    assert scanner.direction_rad is not None
    iop, thickness, gap, polar, direction, lean = rng.standard_normal(6).tolist()
    turned_rad = scanner.direction_rad + reader.pole_noise_rad * direction

    return replace(
        info,
        eye=replace(
            eye,
            iop_pa=eye.iop_pa * (1.0 + reader.iop_noise_fraction * iop),
            thickness_m=eye.thickness_m
            * (1.0 + reader.thickness_noise_fraction * thickness),
        ),
        needle=replace(
            needle,
            gap_m=needle.gap_m * (1.0 + reader.gap_noise_fraction * gap),
            polar_rad=abs(needle.polar_rad + reader.pole_noise_rad * polar),
            lean_rad=(
                None
                if needle.lean_rad is None
                else lean_ends(abs(needle.lean_rad[0] + reader.pole_noise_rad * lean))
            ),
        ),
        scan=replace(scanner, direction_rad=turned_rad),
    )
