"""Read one image file as a frame: PNG, TIFF, JPEG, or a single DICOM image; rows are depth, columns are lateral.

The size that a file states is checked before memory is taken for its pixels.
"""

import zlib
from os import PathLike
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import FrameImage, Pixels, check_size, grey_pixels, jpeg_size
from scleraforce.whole_files import KINDS, read_bytes

__all__ = ["FrameImage", "Pixels", "check_frame", "read_frame", "read_frame_image"]

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
PNG_HEADER = b"IHDR"


def read_frame(path: str | PathLike[str]) -> Pixels:
    """Read the pixels of one frame, uint8 or uint16 (rows, columns); colour is turned into grey.

    Raises:
        FrameError: naming the file, what was found and what is allowed.

    >>> import scleraforce as sf
    >>> pixels = sf.read_frame("eye-a/frames/0001.png")
    >>> pixels.shape, pixels.dtype.name
    ((512, 512), 'uint16')
    """
    return read_frame_image(path).pixels


def read_frame_image(path: str | PathLike[str]) -> FrameImage:
    """Read one frame with the size of its pixels where its tags know it (DICOM, TIFF).

    The kind of file is told by its content, not by its name. Signed DICOM values are shifted so that the smallest is 0.

    Raises:
        FrameError: naming the file, what was found and what is allowed.
    """
    path = Path(path)
    data = read_bytes(path, KINDS["frame"])
    if data.startswith((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")):
        from scleraforce.recording.tiff_image import read_tiff

        return read_tiff(path, data)
    if data[128:132] == b"DICM":
        from scleraforce.recording.dicom_image import read_dicom

        return read_dicom(path, data)
    if data.startswith(PNG_SIGNATURE):
        _check_png(path, data)
        return FrameImage(grey_pixels(_decode(path, data, cv2.IMREAD_UNCHANGED), path, cv2.COLOR_BGR2GRAY))
    if data.startswith(b"\xff\xd8\xff"):
        _check_jpeg(path, data)
        return FrameImage(grey_pixels(_decode(path, data, cv2.IMREAD_GRAYSCALE), path))
    found = "an empty file" if not data else "not an image that can be read"
    raise FrameError(f"{path}: {found}; give a PNG, TIFF, JPEG or a single DICOM image")


def check_frame(pixels: Pixels, rows: int, columns: int, bits: int, name: str) -> None:
    """Check that a frame is what its recording says.

    Raises:
        FrameError: naming the file, what was found and what was expected.
    """
    if pixels.shape != (rows, columns):
        found = " x ".join(str(size) for size in pixels.shape)
        raise FrameError(f"{name}: {found} pixels (rows x columns); recording.toml says {rows} x {columns}")
    if pixels.dtype == np.uint8 and bits > 8:
        raise FrameError(f"{name}: 8 bits a pixel; recording.toml says {bits}")
    if int(pixels.max()) >= 2**bits:
        raise FrameError(
            f"{name}: a pixel of {int(pixels.max())} is more than {bits} bits; check bits in recording.toml"
        )


def _check_png(path: Path, data: bytes) -> None:
    """Walk the chunks of a PNG: OpenCV would fill what is missing with black and say nothing."""
    at = len(PNG_SIGNATURE)
    if data[at + 4 : at + 8] == PNG_HEADER:
        columns, rows = (int.from_bytes(data[at + 8 + k : at + 12 + k], "big") for k in (0, 4))
        check_size(path, rows, columns)
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        chunk, check = data[at + 4 : at + 8 + length], data[at + 8 + length : at + 12 + length]
        if len(check) < 4:
            break
        if zlib.crc32(chunk) != int.from_bytes(check, "big"):
            raise FrameError(f"{path}: damaged: the check sum of a PNG chunk is wrong")
        if chunk.startswith(b"acTL"):
            raise FrameError(f"{path}: an animated PNG; give a file for each frame")
        if chunk.startswith(b"IEND"):
            return
        at += 12 + length
    raise FrameError(f"{path}: a truncated PNG: its end is missing")


def _check_jpeg(path: Path, data: bytes) -> None:
    if b"\xff\xd9" not in data[-1024:]:
        raise FrameError(f"{path}: a truncated JPEG: its end is missing")
    size = jpeg_size(data)
    if size is None:
        raise FrameError(f"{path}: damaged: a JPEG that does not say how large it is")
    check_size(path, *size)


def _decode(path: Path, data: bytes, flags: int) -> NDArray[Any]:
    try:
        pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error as fault:
        raise FrameError(f"{path}: damaged: {fault.err or 'OpenCV cannot decode it'}") from fault
    if pixels is None:
        raise FrameError(f"{path}: damaged: it starts like an image but cannot be decoded")
    return np.asarray(pixels)
