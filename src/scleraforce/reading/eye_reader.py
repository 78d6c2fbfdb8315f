"""A reader of one eye: frames in their order in, answers out."""

import numpy as np

from scleraforce.base.arrays import Counts
from scleraforce.reading.answer import Answer
from scleraforce.reading.reading_models import Reader
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup

THICKNESS_M = 0.6e-3  # of the wall, if unknown

SURFACE = 0.2  # depth of the apex, of the frame's

# counts; the tissue's are added
NOISE = (0, 400)

TISSUE = (600, 1600)

WARMING_FRAMES = 20


def warming_frame(
    shape: tuple[int, int],
    scale: PixelScale,
    radius_m: float,
    thickness_m: float | None = None,
) -> Counts:
    """Return a raw B-scan (row, column) of the wall of an eye at rest, the same at each
    call.
    """
    rows, columns = shape
    rng = np.random.default_rng(0)
    lateral_m = (np.arange(columns) + 0.5 - columns / 2) * scale.lateral_m
    falls_m = radius_m - np.sqrt(np.maximum(radius_m**2 - lateral_m**2, 0.0))
    depth_m = (
        np.arange(rows)[:, None] + 0.5 - SURFACE * rows
    ) * scale.depth_m - falls_m
    is_tissue = (depth_m > 0.0) & (
        depth_m < (thickness_m or THICKNESS_M) * scale.refractive_index
    )
    noise, tissue = (
        rng.integers(*counts, shape, dtype=np.uint16) for counts in (NOISE, TISSUE)
    )

    return noise + np.where(is_tissue, tissue, np.uint16(0))


class LiveReader:
    """Reads the frames of one eye in the control loop, one after the other.

    It reads some frames at the start, so that the first real one takes no longer than
    the others.
    """

    def __init__(self, reader: Reader, setup: Setup, refractive_index: float) -> None:
        self._reader = reader
        self._known = setup
        self._refractive_index = refractive_index
        scanner = reader.study.oct
        scale = PixelScale.of(reader.study.oct)
        frame = warming_frame(
            (scanner.rows, scanner.columns),
            scale,
            reader.study.eye.radius_m,
            setup.eye.thickness_m,
        )

        for _ in range(WARMING_FRAMES):
            self.read(frame, scale)

    def adopt(self, setup: Setup) -> float | None:
        """Read the next frames with the eye as learned, if the model can read such an
        eye.

        The wall's steepest stiffness is returned, N/m; None if it is not known or the
        eye was not adopted.
        """
        if self._reader.refusal(setup) is not None:
            return None
        self._known = setup
        return self._reader.steepest_n_m(setup)

    def read(self, frame: Pixels, scale: PixelScale) -> Answer:
        """Read one raw frame (`Reader.read_live`); the scanner's refractive index takes
        precedence over the scale's.
        """
        scale = PixelScale(
            lateral_m=scale.lateral_m,
            depth_m=scale.depth_m,
            refractive_index=self._refractive_index,
        )
        return self._reader.read_live(frame, scale, self._known)
