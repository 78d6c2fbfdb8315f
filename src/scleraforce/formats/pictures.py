"""Single PNG and JPEG frames: they state neither scale nor time."""

from pathlib import Path

from scleraforce.formats.scan import Scan
from scleraforce.recording.images import read_frame_image

__all__ = ["read_picture"]


def read_picture(path: Path) -> Scan:
    """Return a picture as a scan of one frame; it is read again whenever its pixels are asked for.

    Raises:
        FrameError: it cannot be read.
    """
    pixels = read_frame_image(path).pixels
    rows, columns = pixels.shape
    bits = 8 if pixels.dtype.itemsize == 1 else None
    return Scan(
        names=(str(path),),
        rows=rows,
        columns=columns,
        pictures=lambda: iter([read_frame_image(path).pixels]),
        bits=bits,
    )
