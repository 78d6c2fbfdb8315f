"""Read one image file as a frame: PNG, TIFF, JPEG, or a single DICOM image; rows are depth, columns are lateral."""

import zlib
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import Pixels, as_shown, check_size, grey_pixels, jpeg_frame
from scleraforce.recording.scan import Scan, UnansweredError, array_scan, check_bytes, named_faults
from scleraforce.whole_files import KINDS, read_bytes

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_EXIF = b"Exif\0\0"
ORIENTATION_TAG, UPRIGHT = 0x0112, 1
TIFF_MARKS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def read_frame(path: str | PathLike[str]) -> Pixels:
    """Read the pixels of one frame, uint8 or uint16 (rows, columns); colour is turned into grey.

    Raises:
        FrameError: naming the file, what was found and what is allowed.

    >>> import scleraforce as sf
    >>> pixels = sf.read_frame("eye-a/frames/0001.png")
    >>> pixels.shape, pixels.dtype.name
    ((512, 512), 'uint16')
    """
    return read_image(Path(path))[0]


def read_image(path: Path) -> tuple[Pixels, Scan]:
    """Read one frame, and its file's metadata as a scan of one; signed values are shifted so that the smallest is 0."""
    data = read_bytes(path, KINDS["frame"])
    if data[128:132] == b"DICM":  # before TIFF: a preamble may be the head of one
        from scleraforce.recording.dicom import read_dicom

        scan = read_dicom(path, data)
    elif data.startswith(TIFF_MARKS):
        from scleraforce.recording.tiff import read_tiff

        scan = read_tiff(path, data)
    else:
        return _read_picture(path, data)
    if len(scan.names) != 1:
        raise FrameError(f"{path}: {len(scan.names)} frames in one file; give a file for each frame, or import it")
    (pixels,) = scan.pictures()
    if pixels.dtype.kind == "i":
        least = int(pixels.min())
        note = f"{path}: signed pixels: {-least} was added, so that the smallest is 0"
        scan = replace(scan, notes=(*scan.notes, note))
        pixels = pixels.astype(np.int64) - least
        pixels = pixels.astype(np.uint16) if int(pixels.max()) < 2**16 else pixels
    with named_faults(path, "image"):
        return grey_pixels(np.ascontiguousarray(pixels)), scan


def _read_picture(path: Path, data: bytes) -> tuple[Pixels, Scan]:
    with named_faults(path, "image"):
        if data.startswith(PNG_SIGNATURE):
            orientation, flags = _check_png(data), cv2.IMREAD_UNCHANGED
        elif data.startswith(b"\xff\xd8\xff"):
            orientation, flags = _check_jpeg(data), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        else:
            found = "an empty file" if not data else "not an image that can be read"
            raise FrameError(f"{found}; give a PNG, TIFF, JPEG or a single DICOM image")
        decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
        if decoded is None:
            raise FrameError("damaged: it starts like an image but cannot be decoded")
        pixels: NDArray[Any] = np.asarray(decoded)
        notes = []
        if pixels.ndim == 3 and pixels.shape[-1] == 4 and not (pixels[..., 3] == np.iinfo(pixels.dtype).max).all():
            notes.append("its transparency was left out")
        if orientation != UPRIGHT:
            notes.append(f"EXIF Orientation {orientation}: the frame was turned as it states")
        grey: Pixels = np.ascontiguousarray(as_shown(grey_pixels(pixels, cv2.COLOR_BGR2GRAY), orientation))
    (rows, columns), bits = grey.shape, 8 if grey.itemsize == 1 else None
    scan = Scan((str(path),), rows, columns, lambda: iter([read_image(path)[0]]), bits=bits, notes=tuple(notes))
    return grey, scan.of_file(path)


def _check_png(data: bytes) -> int:
    """Walk the chunks of a PNG and return its EXIF Orientation: OpenCV would fill what is missing with black."""
    at, orientation = len(PNG_SIGNATURE), UPRIGHT
    if data[at + 4 : at + 8] == b"IHDR":
        columns, rows = (int.from_bytes(data[at + 8 + k : at + 12 + k], "big") for k in (0, 4))
        check_size(rows, columns)
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        chunk, check = data[at + 4 : at + 8 + length], data[at + 8 + length : at + 12 + length]
        if len(check) < 4:
            break
        if zlib.crc32(chunk) != int.from_bytes(check, "big"):
            raise FrameError("damaged: the check sum of a PNG chunk is wrong")
        if chunk.startswith(b"acTL"):
            raise FrameError("an animated PNG; give a file for each frame")
        if chunk.startswith(b"eXIf"):
            orientation = _exif_orientation(chunk[4:])
        if chunk.startswith(b"IEND"):
            return orientation
        at += 12 + length
    raise FrameError("a truncated PNG: its end is missing")


def _check_jpeg(data: bytes) -> int:
    if b"\xff\xd9" not in data[-1024:]:
        raise FrameError("a truncated JPEG: its end is missing")
    frame = jpeg_frame(data)
    if frame is None:
        raise FrameError("damaged: a JPEG that does not say how large it is")
    check_size(*frame[:2])
    at = data[: 2**17].find(JPEG_EXIF)
    return UPRIGHT if at < 0 else _exif_orientation(data[at + len(JPEG_EXIF) :])


def _exif_orientation(exif: bytes) -> int:
    """Return the Orientation that the first directory of EXIF data states; it has the form of a TIFF."""
    order: Literal["little", "big"] = "little" if exif.startswith(b"II") else "big"
    begin = int.from_bytes(exif[4:8], order)
    count = int.from_bytes(exif[begin : begin + 2], order)
    for at in range(begin + 2, min(begin + 2 + 12 * count, len(exif)), 12):
        if int.from_bytes(exif[at : at + 2], order) == ORIENTATION_TAG:
            found = int.from_bytes(exif[at + 8 : at + 10], order) or UPRIGHT
            if not UPRIGHT <= found <= 8:
                raise FrameError(f"EXIF Orientation {found}; it is 1 to 8")
            return found
    return UPRIGHT


def read_numpy(path: Path, axes: tuple[str, ...] | None, array: str | None) -> Scan:
    """Return the frames of an array; `array` is its name in a .npz, by default the only one of two or three axes."""
    with named_faults(path, "NumPy file of numbers"):
        with path.open("rb") as file:
            if file.read(2) != b"PK":
                return array_scan(path, np.asarray(np.load(path, mmap_mode="r", allow_pickle=False)), axes)
        with np.load(path, allow_pickle=False) as held:
            check_bytes(sum(info.file_size for info in held.zip.infolist()))
            found = {name: held[name] for name in held.files}
        frames = [name for name, value in found.items() if value.ndim in (2, 3) and value.size > 1]
        if array is None and len(frames) != 1:
            raise UnansweredError("--array", f"which array has the frames? There are {', '.join(found) or 'none'}")
        name = array or frames[0]
        if name not in found:
            raise FrameError(f"no array {name!r}; there are {', '.join(found)}")
        return array_scan(path, np.asarray(found[name]), axes)
