"""Frames of virtual eyes, drawn from the library of the bundled reader."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.tissue_light import Pose, sample_optics
from scleraforce.library import Library
from scleraforce.library.plane_cut import cut_surfaces
from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study

SURFACE_M = 0.45e-3  # of the undented wall below the frame's top


@dataclass(frozen=True, eq=False)
class DrawnEye:
    """A raw frame of 512 x 512 pixels and 16 bits, and the known inputs of its eye."""

    frame: NDArray[np.uint16]
    setup: Setup
    scale: PixelScale


def shipped_reader() -> ForceReader:
    """Return the reader `default`; OpenCV uses one core from now on."""
    cv2.setNumThreads(1)
    return load_force_reader(SHIPPED_READER)


def draw_eyes(reader: ForceReader, count: int) -> list[DrawnEye]:
    """Return frames of different eyes under 0 to 60 mN."""
    rng = np.random.default_rng(0)
    scale = PixelScale.of(reader.study.oct)
    return [
        DrawnEye(*_draw_eye(reader.library, reader.study, rng), scale)
        for _ in range(count)
    ]


def _draw_eye(
    library: Library, study: Study, rng: np.random.Generator
) -> tuple[NDArray[np.uint16], Setup]:
    """Return a raw frame of an eye of the library, and the known inputs."""
    modulus_pa = rng.uniform(0.22e6, 0.5e6)
    iop_pa = rng.uniform(150.0, 500.0)
    thickness_m = rng.uniform(0.45e-3, 0.85e-3)
    gap_m = rng.uniform(0.4e-3, 0.9e-3)
    wall = np.array([thickness_m]), np.array([iop_pa / modulus_pa])
    largest = min(
        float(library.largest_force_ratio(*wall)[0]),
        study.needle.max_force_n / modulus_pa,
    )
    ratio = np.array([0.999 * largest * rng.random()])
    curves_bnc = library.curves(*wall, ratio).curves_sbnc[0]
    section = Pose(lateral_m=0.0, depth_m=SURFACE_M).place(
        cut_surfaces(curves_bnc, gap_m, 0.0)
    )
    optics = sample_optics(study.phantom, study.oct, rng)
    frame = render_bscan(section, study.oct, optics, rng).frame
    return frame, Setup(
        eye=Eye(
            globe=OPEN,
            modulus=Modulus(mean_pa=modulus_pa, sd_pa=0.015 * modulus_pa, source="own"),
            iop_pa=iop_pa,
            thickness_m=thickness_m,
        ),
        needle=Needle(gap_m=gap_m),
    )
