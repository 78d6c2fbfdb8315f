"""A frame of the ring for a page: 8 bits, no larger than a screen shows, with the outline of its wall."""

import json

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.service.companions.messages import Outline

WHITE_PERCENTILE = 99.5
FADING = 0.99  # of the white level from picture to picture, so that a single bright frame does not darken the next ones


class Pictures:
    """Makes pictures of frames, each once, however many pages show it.

    A picture is the length of its header (4 bytes, little-endian), the header (JSON: `frame`, `rows`, `columns` of the
    pixels that follow, `outline`), the pixels (row, column), one byte each.
    """

    def __init__(self, ring: FrameRing) -> None:
        self._ring = ring
        self._made: tuple[tuple[int, int], bytes] = ((0, 0), b"")
        self._white = 1.0

    def of(self, frame: int, outline: Outline | None, most_pixels: int) -> bytes | None:
        """Return the picture of a frame, of `most_pixels` along either side; None if the frame is gone."""
        if self._made[0] == (frame, most_pixels):
            return self._made[1]
        pixels = self._ring.get(frame)
        if pixels is None:
            return None
        self._made = (frame, most_pixels), self._picture(frame, pixels, outline, most_pixels)
        return self._made[1]

    def _picture(self, frame: int, pixels: NDArray[np.uint16], outline: Outline | None, most_pixels: int) -> bytes:
        white = float(np.percentile(pixels[::4, ::4], WHITE_PERCENTILE))
        self._white = max(white, FADING * self._white, 1.0)
        rows, columns = (min(length, most_pixels) for length in pixels.shape)
        if (rows, columns) != pixels.shape:
            pixels = cv2.resize(pixels, (columns, rows), interpolation=cv2.INTER_AREA).astype(np.uint16)
        shown = cv2.convertScaleAbs(pixels, alpha=255 / self._white)
        lines = {"step": outline.step, "outer": outline.outer, "inner": outline.inner} if outline else None
        header = json.dumps({"frame": frame, "rows": rows, "columns": columns, "outline": lines}).encode()
        return len(header).to_bytes(4, "little") + header + shown.tobytes()
