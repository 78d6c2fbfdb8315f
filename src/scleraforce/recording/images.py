"""Files that OpenCV and NumPy read: PNG, JPEG, NumPy arrays, films; and one frame of any file."""

import os
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.recording import pixels as scans
from scleraforce.recording.dicom import read_dicom
from scleraforce.recording.pixels import Pixels, Scan, Times, as_shown, check_size, named_faults, rising
from scleraforce.recording.tiff import read_tiff
from scleraforce.units import to_si
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
        scan = read_dicom(path, data)
    elif data.startswith(TIFF_MARKS):
        scan = read_tiff(path, data)
    else:
        return _read_picture(path, data)
    if len(scan.names) != 1:
        raise FrameError(f"{path}: {len(scan.names)} frames in one file; give a file for each frame, or import it")
    (pixels,) = scan.pictures()
    if pixels.dtype.kind == "i":
        least = int(pixels.min())
        note = f"{path}: signed pixels: {-least} was added, so that the smallest is 0"
        scan, pixels = replace(scan, notes=(*scan.notes, note)), pixels.astype(np.int64) - least
        pixels = pixels.astype(np.uint16) if int(pixels.max()) < 2**16 else pixels
    with named_faults(path, "image"):
        return scans.grey_pixels(np.ascontiguousarray(pixels)), scan


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
        clear = pixels.ndim == 3 and pixels.shape[-1] == 4 and (pixels[..., 3] != np.iinfo(pixels.dtype).max).any()
        notes = ["its transparency was left out"] if clear else []
        notes += [f"EXIF Orientation {orientation}: turned as it states"] if orientation != UPRIGHT else []
        grey: Pixels = np.ascontiguousarray(as_shown(scans.grey_pixels(pixels, cv2.COLOR_BGR2GRAY), orientation))
    (rows, columns), bits = grey.shape, 8 if grey.itemsize == 1 else None
    scan = Scan((str(path),), rows, columns, lambda: iter([read_image(path)[0]]), bits=bits, notes=tuple(notes))
    return grey, scan.of_file(path)


def _check_png(data: bytes) -> int:
    """Walk the chunks of a PNG and return its EXIF Orientation: OpenCV would fill what is missing with black."""
    at, orientation = len(PNG_SIGNATURE), UPRIGHT
    while at + 12 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        chunk, check = data[at + 4 : at + 8 + length], data[at + 8 + length : at + 12 + length]
        if len(check) < 4:
            break
        if zlib.crc32(chunk) != int.from_bytes(check, "big"):
            raise FrameError("damaged: the check sum of a PNG chunk is wrong")
        if chunk.startswith(b"IHDR"):
            check_size(int.from_bytes(chunk[8:12], "big"), int.from_bytes(chunk[4:8], "big"))
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
    if (frame := scans.jpeg_frame(data)) is None:
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
                return scans.array_scan(path, np.asarray(np.load(path, mmap_mode="r", allow_pickle=False)), axes)
        with np.load(path, allow_pickle=False) as held:
            scans.check_bytes(sum(info.file_size for info in held.zip.infolist()))
            found = {name: held[name] for name in held.files}
        frames = [name for name, value in found.items() if value.ndim in (2, 3) and value.size > 1]
        if array is None and len(frames) != 1:
            listed = ", ".join(found) or "none"
            raise scans.UnansweredError("--array", f"which array has the frames? There are {listed}")
        name = array or frames[0]
        if name not in found:
            raise FrameError(f"no array {name!r}; there are {', '.join(found)}")
        return scans.array_scan(path, np.asarray(found[name]), axes)


GREY_16 = b"Y1\0\x10"  # FFmpeg's tag of gray16le, the only deeper format that OpenCV leaves unchanged
BITS_OF_TRIPLES = {12: 4, 15: 5, 16: 5, 36: 12, 48: 16, 64: 16}  # of a sample, by the bits of a pixel
MATROSKA, SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"
EVEN = 0.05  # of their median, that steps of time may differ to be even


def read_film(path: Path) -> Scan:
    """Return a film's frames; all of them are counted first, as the stated number is not reliable."""
    with _opened(path) as film:
        rows, columns = (int(film.get(what)) for what in (cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH))
        check_size(rows, columns)
        deep = _is_deep(path, film)
        rate_hz, stated = float(film.get(cv2.CAP_PROP_FPS)), int(film.get(cv2.CAP_PROP_FRAME_COUNT))
        times_ms = []
        while film.grab():
            times_ms.append(float(film.get(cv2.CAP_PROP_POS_MSEC)))
        if not times_ms:
            raise FrameError("no frame in it that can be decoded")
        scans.check_bytes(len(times_ms) * rows * columns * (2 if deep else 1))
    time_s = to_si(np.array(times_ms), "ms")
    steps_s, pace = np.diff(time_s), f"film of {rate_hz:g} frames a second"
    if steps_s.size and np.ptp(steps_s) > EVEN * np.median(steps_s):
        pace = f"film's time stamps, {steps_s.min():.3g} to {steps_s.max():.3g} s apart"
    notes = ["a film's compression changes grey levels and fine structure; its times are those at which it plays "
             "(--rate-hz where frames were taken at another rate)"]  # fmt: skip
    with path.open("rb") as file:  # Matroska states no number of frames
        known = "" if file.read(4) == MATROSKA else f"states {stated} frames, of which "
    count = len(times_ms)
    if _ends_early(path):
        notes.append(f"{known}{count} can be decoded: it was cut off, for it ends before the end that it states")
    elif known and count < stated:
        notes.append(f"holds {stated} frames and plays {count}; the others are empty, hidden or damaged")
    shape, bits, times = (rows, columns), None if deep else 8, Times(time_s, pace) if rising(time_s) else None
    scan = Scan(scans.frame_names(path, count), *shape, lambda: _pictures(path, shape, deep), bits=bits, times=times)
    return replace(scan, notes=tuple(notes)).of_file(path)


def _is_deep(path: Path, film: cv2.VideoCapture) -> bool:
    tag = (int(film.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF).to_bytes(4, "little")
    if tag == GREY_16:
        return True
    if (bits := _bits_of(tag)) != 8:
        found = f"pixels of {bits or 'an unknown number of'} bits (FFmpeg's pixel format {tag!r})"
        way = f"ffmpeg -i {path.name} -pix_fmt gray16le -c:v ffv1 grey.mkv"
        raise FrameError(f"{found}; 8 bits, and 16 of grey, are read unchanged; write it so: {way}")
    return False


def _bits_of(tag: bytes) -> int | None:
    r"""Return the bits of a sample by FFmpeg's tag of the pixel format (libavcodec/raw.c); None: not known.

    >>> _bits_of(b"I420"), _bits_of(b"Y1\0\x0a"), _bits_of(b"\x0c\x0b3Y"), _bits_of(b"P010"), _bits_of(bytes(4))
    (8, 10, 12, 10, None)
    """
    for each in (tag, tag[::-1]):
        if re.match(rb"[YG][1-4]|BA", each) and 0 < each[3] <= 32:
            return each[3]
        if each[:3] in (b"RGB", b"BGR", b"RBA", b"BRA", b"XYZ"):
            return BITS_OF_TRIPLES.get(each[3], 8)
    if deep := re.fullmatch(rb"[PYXv]\d(10|12|16)", tag):
        return int(deep[1])
    return 8 if tag.isalnum() or tag == b"PAL\x08" else None


def _ends_early(path: Path) -> bool:
    """Return whether the last part of a film (a RIFF chunk, an MP4 box, Matroska's segment) goes beyond its end."""
    whole, at = path.stat().st_size, 0
    with path.open("rb") as file:
        while at < whole:
            file.seek(at)
            head = file.read(16)
            if head[:4] in (MATROSKA, SEGMENT):
                length = 9 - head[4].bit_length()
                size = int.from_bytes(head[4 : 4 + length], "big") & ((1 << 7 * length) - 1)
                if size == (1 << 7 * length) - 1:  # not known when it was written
                    return False
                at += 4 + length + size
            elif head[:4] in (b"RIFF", b"JUNK"):
                at += 8 + int.from_bytes(head[4:8], "little")
                at += at % 2
            elif head[4:8].isalnum():
                size = int.from_bytes(head[:4], "big")
                size = int.from_bytes(head[8:16], "big") if size == 1 else size
                if size < 8:  # to the end
                    return False
                at += size
            else:
                return False
    return at > whole + 1  # the last chunk may lack its padding


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    # We report faults of a film ourselves, once; OpenCV and its FFmpeg stay quiet.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    film = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
    try:
        with named_faults(path, "film"):
            if not film.isOpened():
                raise FrameError("damaged or a kind of film that OpenCV does not decode")
            yield film
    finally:
        film.release()
        cv2.utils.logging.setLogLevel(before)


def _pictures(path: Path, shape: tuple[int, int], deep: bool) -> scans.PictureStream:
    with _opened(path) as film:
        if deep:
            film.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        while (picture := film.read()[1]) is not None:
            if picture.shape[:2] != shape:
                raise FrameError(f"its frames change their size, from {shape} to {picture.shape[:2]}")
            if picture.dtype != (np.uint16 if deep else np.uint8):
                raise FrameError(f"decoded as {picture.dtype}, not with the {16 if deep else 8} bits that it has")
            yield cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
