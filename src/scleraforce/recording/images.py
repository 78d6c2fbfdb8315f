"""Read one image file as a frame: PNG, TIFF, JPEG, or a single DICOM image; rows are depth, columns are lateral."""

import io
import zlib
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.whole_files import KINDS, read_bytes

if TYPE_CHECKING:
    import pydicom

__all__ = ["FrameImage", "check_frame", "read_frame", "read_frame_image"]

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_PIXELS = 64 * 2**20
# Zeiss writes the A-scans of its Visante along the rows of the image, so depth runs along the columns' index.
A_SCANS_ALONG_ROWS = {("Carl Zeiss Meditec", "1000")}


@dataclass(frozen=True)
class FrameImage:
    """A frame: `pixels` uint8 or uint16 (rows, columns); sizes of a pixel where the file says so, else None."""

    pixels: Pixels
    depth_pixel_m: float | None = None
    lateral_pixel_m: float | None = None


def read_frame(path: str | PathLike[str]) -> Pixels:
    """Read the pixels of one frame, uint8 or uint16 (rows, columns); colour is turned into grey.

    Raises:
        FrameError: naming the file, what was found and what would do.
    """
    return read_frame_image(path).pixels


def read_frame_image(path: str | PathLike[str]) -> FrameImage:
    """Read one frame with the size of its pixels where its tags know it (DICOM).

    The kind of file is told by its content, not by its name. Signed DICOM values are shifted so that the smallest is 0.

    Raises:
        FrameError: naming the file, what was found and what would do.
    """
    path = Path(path)
    data = read_bytes(path, KINDS["frame"])
    if data.startswith((b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")):
        return FrameImage(_grey(_read_tiff(path, data), path))
    if data[128:132] == b"DICM":
        return _read_dicom(path, data)
    if data.startswith(PNG_SIGNATURE):
        _check_png(path, data)
        return FrameImage(_grey(_decode(path, data, cv2.IMREAD_UNCHANGED), path))
    if data.startswith(b"\xff\xd8\xff"):
        if b"\xff\xd9" not in data[-1024:]:
            raise FrameError(f"{path}: a truncated JPEG: its end is missing")
        return FrameImage(_grey(_decode(path, data, cv2.IMREAD_GRAYSCALE), path))
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
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        chunk, check = data[at + 4 : at + 8 + length], data[at + 8 + length : at + 12 + length]
        if len(check) < 4:
            break
        if zlib.crc32(chunk) != int.from_bytes(check, "big"):
            raise FrameError(f"{path}: damaged: the check sum of a PNG chunk is wrong")
        if chunk.startswith(b"IEND"):
            return
        at += 12 + length
    raise FrameError(f"{path}: a truncated PNG: its end is missing")


def _decode(path: Path, data: bytes, flags: int) -> NDArray[Any]:
    try:
        pixels = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error as fault:
        raise FrameError(f"{path}: damaged: {fault.err or 'OpenCV cannot decode it'}") from fault
    if pixels is None:
        raise FrameError(f"{path}: damaged: it starts like an image but cannot be decoded")
    return np.asarray(pixels)


def _read_tiff(path: Path, data: bytes) -> NDArray[Any]:
    import tifffile  # here, so that reading PNG needs OpenCV only

    try:
        with tifffile.TiffFile(io.BytesIO(data)) as file:
            if len(file.pages) != 1:
                raise FrameError(f"{path}: {len(file.pages)} pages; give a file for each frame")
            pixels = np.asarray(file.pages[0].asarray())
    except FrameError:
        raise
    except Exception as fault:  # tifffile and its codecs raise whatever the damage leads to
        raise FrameError(f"{path}: damaged or an unknown kind of TIFF: {fault}") from fault
    if pixels.ndim == 3 and pixels.shape[-1] >= 3:
        pixels = cv2.cvtColor(np.ascontiguousarray(pixels[..., :3]), cv2.COLOR_RGB2BGR)  # the order that OpenCV reads
    return pixels


def _read_dicom(path: Path, data: bytes) -> FrameImage:
    import pydicom  # here, so that reading PNG needs OpenCV only
    from pydicom import config

    before = config.settings.reading_validation_mode
    config.settings.reading_validation_mode = config.IGNORE  # scanners write over-long private tags
    try:
        dataset = pydicom.dcmread(io.BytesIO(data))
        pixels = np.asarray(dataset.pixel_array)
        maker = (str(dataset.get("Manufacturer", "")).strip(), str(dataset.get("ManufacturerModelName", "")).strip())
        depth_m, lateral_m = _dicom_spacing(dataset)
    except Exception as fault:  # pydicom and its codecs raise whatever the damage leads to
        raise FrameError(f"{path}: damaged or an unknown kind of DICOM: {' '.join(str(fault).split())}") from fault
    finally:
        config.settings.reading_validation_mode = before
    if pixels.ndim == 3 and pixels.shape[-1] > 4:
        raise FrameError(f"{path}: {pixels.shape[0]} frames in one DICOM file; give a file for each frame")
    if pixels.ndim == 3:
        pixels = cv2.cvtColor(np.ascontiguousarray(pixels[..., :3]), cv2.COLOR_RGB2BGR)
    if np.issubdtype(pixels.dtype, np.signedinteger):
        pixels = pixels.astype(np.int64) - int(pixels.min())
        pixels = pixels.astype(np.uint16 if int(pixels.max()) < 2**16 else np.int64)
    if maker in A_SCANS_ALONG_ROWS:
        pixels, depth_m, lateral_m = np.ascontiguousarray(pixels.T), lateral_m, depth_m
    return FrameImage(_grey(pixels, path), depth_m, lateral_m)


def _dicom_spacing(dataset: "pydicom.Dataset") -> tuple[float | None, float | None]:
    """Return the distance of rows and of columns in m, from whichever standard tag has them, else None."""
    places = [dataset]
    for name in ("SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"):
        for group in dataset.get(name, None) or []:
            places += list(group.get("PixelMeasuresSequence", None) or [])
    for place in places:
        for name in ("PixelSpacing", "ImagerPixelSpacing", "NominalScannedPixelSpacing"):
            spacing = place.get(name, None)
            if spacing is not None and len(spacing) == 2 and min(float(value) for value in spacing) > 0.0:
                return float(spacing[0]) * 1e-3, float(spacing[1]) * 1e-3
    return None, None


def _grey(pixels: NDArray[Any], path: Path) -> Pixels:
    """Return grey uint8 or uint16 pixels (rows, columns), or say why that is not possible."""
    if np.issubdtype(pixels.dtype, np.floating):
        lost = int(np.count_nonzero(~np.isfinite(pixels)))
        found = f"{lost} pixels that are NaN or infinite" if lost else f"{pixels.dtype} pixels"
        raise FrameError(f"{path}: {found}; give whole numbers of 8 or 16 bits")
    if pixels.dtype not in (np.uint8, np.uint16):
        raise FrameError(f"{path}: {pixels.dtype} pixels; give whole numbers of 8 or 16 bits")
    if pixels.ndim == 3 and pixels.shape[-1] in (3, 4):
        pixels = np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels[..., :3]), cv2.COLOR_BGR2GRAY))
    elif pixels.ndim == 3 and pixels.shape[-1] == 1:
        pixels = pixels[..., 0]
    if pixels.ndim != 2 or min(pixels.shape) < 2 or pixels.size > MAX_PIXELS:
        raise FrameError(f"{path}: an image of shape {pixels.shape}; give one frame, rows x columns")
    return pixels
