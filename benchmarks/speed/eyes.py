"""Frames that are read: virtual eyes of the shipped reader's own library, each with what is known of it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from bench_reader import draw_eye
from scleraforce.known import Known
from scleraforce.models import SHIPPED_READER
from scleraforce.reader import ForceReader, load_force_reader
from scleraforce.recording.pixels import PixelScale

__all__ = ["DrawnEye", "draw_eyes", "shipped_reader"]


@dataclass(frozen=True, eq=False)
class DrawnEye:
    """A raw frame of 512 x 512 pixels and 16 bits, and what is known of its eye."""

    frame: NDArray[np.uint16]
    known: Known
    scale: PixelScale


def shipped_reader() -> ForceReader:
    """Return the reader `default`; images are computed on one core from now on."""
    cv2.setNumThreads(1)
    return load_force_reader(SHIPPED_READER)


def draw_eyes(reader: ForceReader, count: int) -> list[DrawnEye]:
    """Return frames of different eyes under 0 to 60 mN."""
    rng, scale = np.random.default_rng(0), PixelScale.of(reader.study.oct)
    return [DrawnEye(*draw_eye(reader.library, reader.study, rng), scale) for _ in range(count)]
