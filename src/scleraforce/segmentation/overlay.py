"""A frame as a picture that people look at: grey, with the boundaries that were found drawn in."""

import cv2
import numpy as np

from scleraforce.arrays import Bytes
from scleraforce.recording.pixels import Pixels
from scleraforce.segmentation.found import Segmentation

SURFACE, INNER, INNER_NOT_SEEN = (0, 0, 255), (0, 255, 0), (255, 128, 0)  # blue, green, red, as OpenCV has them
DARKEST, BRIGHTEST = 1.0, 99.7  # percentiles of the pixels that are lit
SUBPIXEL_BITS = 4
SHAFT = (0, 255, 255)  # yellow


def draw_overlay(pixels: Pixels, found: Segmentation, size: tuple[int, int] | None = None) -> Bytes:
    """Return a frame in colour with its boundaries: surface red, inner green or blue (not seen), needle yellow.

    The picture is (row, column, 3), blue, green, red, as OpenCV writes it; `size` are its rows and columns, by default
    the frame's.
    """
    rows, columns = size or pixels.shape
    lit = pixels[pixels > 0]
    low, high = np.percentile(lit, [DARKEST, BRIGHTEST]) if len(lit) else (0.0, 1.0)
    grey = np.clip((pixels - low) * (255.0 / max(high - low, 1.0)), 0, 255).astype(np.uint8)
    if grey.shape != (rows, columns):
        method = cv2.INTER_AREA if rows * columns < grey.size else cv2.INTER_LINEAR
        grey = np.asarray(cv2.resize(grey, (columns, rows), interpolation=method), dtype=np.uint8)
    picture = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    stretch_xy = np.array([columns / pixels.shape[1], rows / pixels.shape[0]])
    width = max(1, min(rows, columns) // 300)
    lines, inner = [], INNER if found.inner_found else INNER_NOT_SEEN
    for boundary, colour in ((found.inner_row, inner), (found.outer_row, SURFACE)):
        there = np.flatnonzero(np.isfinite(boundary))
        runs = np.split(there, np.flatnonzero(np.diff(there) > 1) + 1)
        lines += [(np.stack([run, boundary[run]], axis=1), colour) for run in runs]
    if found.needle is not None:
        lines.append((np.array([found.needle.top, found.needle.tip]), SHAFT))
    for places_xy, colour in lines:
        centres_xy = (places_xy + 0.5) * stretch_xy - 0.5
        points = np.rint(centres_xy * 2**SUBPIXEL_BITS).astype(np.int32)
        cv2.polylines(picture, [points], False, colour, width, cv2.LINE_AA, SUBPIXEL_BITS)
    return np.asarray(picture, dtype=np.uint8)
