"""The recordings that answers are frozen of: virtual eyes that anyone can make, and the
shared ones where they are.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import scleraforce as sf

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared"

COARSE = "[mesh]\ncore = 4\nrings = 8\n"  # two seconds an eye; no answer is of accuracy
FORCES_N = (0.012, 0.024, 0.036, 0.004, 0.015, 0.034, 0.002, 0.028)
CROSS = (sf.Plane("along", 0.0, 0.0), sf.Plane("across", 0.0, pi / 2))


@dataclass(frozen=True)
class VirtualEye:
    """A virtual eye: the parts of its study beside the mesh, and the arguments of
    `sf.phantom`.
    """

    study: str = ""
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def record(self, folder: Path) -> None:
        """Make its recording."""
        arguments = {
            "forces_n": FORCES_N,
            "thickness_m": 650e-6,
            "youngs_modulus_pa": 0.3e6,
            "globe": "open",
            "mechanics": "finite-strain",
            **self.arguments,
        }
        study = sf.parse_study(COARSE + self.study)
        sf.phantom(folder, study, eye=folder.name, **arguments)


DAMAGED = "damaged"
DENSE = "dense"  # of tissue that relaxes
MOVING = "moving"
PLANES = "planes"
RELAXATION = "relaxation = [[0.12, 1.2], [0.15, 12.0]]"
UNEVEN_FORM = """
[form]
semi_axes = [1.05, 0.96, 1.0]
wave = [{ amplitude_percent = 12.0, degree = 2, polar_deg = 50.0, azimuth_deg = 20.0 }]
region = [{ modulus_ratio = 0.7 }]
[needle]
tilt_deg = 8.0
tilt_direction_deg = 60.0
"""
COVERED_WALL = """
[phantom]
conjunctiva_thickness_um = 150.0
needle_count = 1
needle_lean_deg = 20.0
"""
OTHER_SCANNER = """
[oct]
width_mm = 12.0
depth_mm = 3.5
columns = 300
rows = 384
bits = 16
refractive_index = 1.38
[phantom]
display = "root"
"""
VIRTUAL_EYES: Mapping[str, VirtualEye] = {
    "plain": VirtualEye(),
    "sealed": VirtualEye(
        arguments={"globe": "sealed", "youngs_modulus_pa": 0.35e6, "seed": 1}
    ),
    "living": VirtualEye(
        arguments={
            "globe": "sealed",
            "youngs_modulus_pa": 1.5e6,
            "iop_pa": 2000.0,
            "thickness_m": 600e-6,
            "seed": 2,
        }
    ),
    "relaxing": VirtualEye(
        study=f"[tissue]\n{RELAXATION}\n",
        arguments={"youngs_modulus_pa": 0.4e6, "seed": 3},
    ),
    "uneven": VirtualEye(
        study=UNEVEN_FORM, arguments={"youngs_modulus_pa": 0.4e6, "seed": 4}
    ),
    "covered": VirtualEye(
        study=COVERED_WALL, arguments={"youngs_modulus_pa": 0.4e6, "seed": 5}
    ),
    "stiffening": VirtualEye(
        study="[tissue]\nstiffening = 8.0\n",
        arguments={"globe": "sealed", "youngs_modulus_pa": 0.4e6, "seed": 6},
    ),
    "scanner": VirtualEye(
        study=OTHER_SCANNER, arguments={"youngs_modulus_pa": 0.4e6, "seed": 7}
    ),
    PLANES: VirtualEye(
        arguments={"forces_n": FORCES_N[:4], "scan": sf.Scan(planes=CROSS), "seed": 8}
    ),
    MOVING: VirtualEye(
        arguments={
            "forces_n": (0.010, 0.024, 0.005),
            "motion": sf.Motion(rate_hz=10.0),
            "seed": 9,
        }
    ),
    DAMAGED: VirtualEye(arguments={"seed": 10}),
    "leaking": VirtualEye(
        study="[globe]\nleak_time_s = 30.0\n",
        arguments={"globe": "sealed", "youngs_modulus_pa": 0.35e6, "seed": 11},
    ),
    DENSE: VirtualEye(
        study=f"[tissue]\n{RELAXATION}\n",
        arguments={
            "forces_n": (0.010, 0.024, 0.005),
            "motion": sf.Motion(rate_hz=10.0),
            "seed": 12,
        },
    ),
}


def make_recording(name: str, folder: Path) -> None:
    """Make the recording of a virtual eye."""
    VIRTUAL_EYES[name].record(folder)
    if name == DAMAGED:
        _damage(folder)
    if name == DENSE:
        _declare_relaxation(folder)


def shared_recordings() -> dict[str, Path]:
    """Return the shared recordings, by their names; none where the folder is absent."""
    folders = sorted((SHARED / "recordings").glob("*/recording.toml"))
    return {path.parent.name: path.parent for path in folders}


def frame_files(recording: Path) -> list[Path]:
    """Return the frames of a recording, in their order in time."""
    opened = sf.read_recording(recording)
    return [opened.frame_path(frame) for frame in opened.frames]


def _damage(recording: Path) -> None:
    """Spoil most frames, each in a way of its own, and correct the wall of the first
    one by hand.
    """
    files = frame_files(recording)
    first = _pixels(files[0])
    drawn = np.where(sf.segment(files[0]).mask == 255, 255, 0).astype(np.uint8)
    sf.save_wall(recording, files[0].name, np.roll(drawn, 2, axis=0), author="golden")

    noise = np.random.default_rng(0).integers(0, 4096, first.shape)
    spoilt = [
        np.full_like(first, 600),
        noise.astype(first.dtype),
        np.roll(_pixels(files[3]), -150, axis=0),
        np.minimum(_pixels(files[4]), 900),
        _pixels(files[5])[:, ::-1],
    ]
    spoilt[3][:, 200:330] = 0
    for file, pixels in zip(files[1:], spoilt, strict=False):
        assert cv2.imwrite(str(file), pixels)


def _declare_relaxation(recording: Path) -> None:
    """Let recording.toml state how the tissue relaxes."""
    place = recording / "recording.toml"
    text = place.read_text(encoding="utf-8")
    place.write_text(text.replace("[eye]", f"[eye]\n{RELAXATION}"), encoding="utf-8")


def _pixels(file: Path) -> np.ndarray[Any, Any]:
    return np.array(sf.read_frame(file))
