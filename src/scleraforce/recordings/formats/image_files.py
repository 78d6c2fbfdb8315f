"""Files that OpenCV and NumPy read: PNG, JPEG, NumPy arrays, films; and one frame of
any file.
"""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.base.errors import FrameError
from scleraforce.base.units import to_si
from scleraforce.base.whole_files import KINDS, read_bytes
from scleraforce.recordings.formats import picture_streams
from scleraforce.recordings.formats.dicom_files import read_dicom
from scleraforce.recordings.formats.picture_streams import (
    FrameTimes,
    PictureSource,
    as_shown,
    check_image_size,
    named_faults,
    rising,
)
from scleraforce.recordings.formats.tiff_files import read_tiff
from scleraforce.records.frame import Pixels

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"
ORIENTATION_TAG = 0x0112
UPRIGHT = 1
TIFF_MARKS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")


def read_frame(path: str | PathLike[str]) -> Pixels:
    """Read the pixels of one frame, uint8 or uint16 (rows, columns); colour is turned
    into grey.

    Raises:
        FrameError: naming the file, what was found and what is allowed.

    >>> import scleraforce as sf
    >>> pixels = sf.read_frame("eye-a/frames/0001.png")
    >>> pixels.shape, pixels.dtype.name
    ((512, 512), 'uint16')
    """
    return read_image(Path(path))[0]


def read_image(path: Path) -> tuple[Pixels, PictureSource]:
    """Read one frame, and its file's metadata as a scan of one; signed values are
    shifted so that the smallest is 0.
    """
    data = read_bytes(path, KINDS["frame"])
    if data[128:132] == b"DICM":  # before TIFF: a preamble may be the head of one
        scan = read_dicom(path, data)
    elif data.startswith(TIFF_MARKS):
        scan = read_tiff(path, data)
    else:
        return read_picture(path, data)

    if len(scan.names) != 1:
        raise FrameError(
            f"{path}: {len(scan.names)} frames in one file; give a file for each frame,"
            " or import it"
        )

    (pixels,) = scan.pictures()
    if pixels.dtype.kind == "i":
        least = int(pixels.min())
        note = f"{path}: signed pixels: {-least} was added, so that the smallest is 0"
        scan = replace(scan, notes=(*scan.notes, note))
        pixels = pixels.astype(np.int64) - least
        pixels = pixels.astype(np.uint16) if int(pixels.max()) < 2**16 else pixels

    with named_faults(path, "image"):
        return picture_streams.grey_pixels(np.ascontiguousarray(pixels)), scan


def read_picture(path: Path | str, data: bytes) -> tuple[Pixels, PictureSource]:
    """Read a PNG or JPEG, as `read_image` does; `path` is for messages."""
    with named_faults(path, "image"):
        if not data.startswith((PNG_SIGNATURE, JPEG_SIGNATURE)):
            found = "an empty file" if not data else "not an image that can be read"
            raise FrameError(f"{found}; give a PNG, TIFF, JPEG or a single DICOM image")

        orientation = _checked_orientation(data)
        of_jpeg = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        flags = of_jpeg if data.startswith(JPEG_SIGNATURE) else cv2.IMREAD_UNCHANGED

        decoded = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
        if decoded is None:
            raise FrameError("damaged: it starts like an image but cannot be decoded")

        pixels: NDArray[Any] = np.asarray(decoded)
        clear = (
            pixels.ndim == 3
            and pixels.shape[-1] == 4
            and (pixels[..., 3] != np.iinfo(pixels.dtype).max).any()
        )
        notes = ["its transparency was left out"] if clear else []
        notes += (
            [f"EXIF Orientation {orientation}: turned as it states"]
            if orientation != UPRIGHT
            else []
        )
        grey: Pixels = np.ascontiguousarray(
            as_shown(
                picture_streams.grey_pixels(pixels, cv2.COLOR_BGR2GRAY), orientation
            )
        )

    rows, columns = grey.shape
    bits = 8 if grey.itemsize == 1 else None
    scan = PictureSource(
        (str(path),),
        rows,
        columns,
        lambda: iter([read_image(Path(path))[0]]),
        bits=bits,
        notes=tuple(notes),
    )

    return grey, scan.of_file(path)


def _checked_orientation(data: bytes) -> int:
    """Check a PNG or JPEG, whose missing parts OpenCV 4 fills with black, and return
    its EXIF Orientation.
    """
    # 7 ms: not for DICOM and TIFF files, and the help
    from PIL import Image

    with Image.open(BytesIO(data)) as image:
        check_image_size(image.height, image.width)
        if getattr(image, "is_animated", False):
            raise FrameError(
                f"several pictures in one {image.format}; give a file for each frame"
            )

        exif = Image.Exif()
        exif.load(image.info.get("exif", b""))
        orientation = int(exif.get(ORIENTATION_TAG) or UPRIGHT)
        if not UPRIGHT <= orientation <= 8:
            raise FrameError(f"EXIF Orientation {orientation}; it is 1 to 8")
        if image.format == "JPEG" and b"\xff\xd9" not in data[-1024:]:
            raise FrameError("a truncated JPEG: its end is missing")

        image.verify()  # of a PNG: check sums, and its end

    return orientation


def read_numpy(
    path: Path, axes: tuple[str, ...] | None, array: str | None
) -> PictureSource:
    """Return the frames of an array; `array` is its name in a .npz, by default the only
    one of two or three axes.
    """
    with named_faults(path, "NumPy file of numbers"):
        with path.open("rb") as file:
            if file.read(2) != b"PK":
                return picture_streams.array_scan(
                    path,
                    np.asarray(np.load(path, mmap_mode="r", allow_pickle=False)),
                    axes,
                )

        with np.load(path, allow_pickle=False) as held:
            picture_streams.check_bytes(
                sum(info.file_size for info in held.zip.infolist())
            )
            found = {name: held[name] for name in held.files}

        frames = [
            name
            for name, value in found.items()
            if value.ndim in (2, 3) and value.size > 1
        ]
        if array is None and len(frames) != 1:
            listed = ", ".join(found) or "none"
            raise picture_streams.UnansweredError(
                "array", f"which array has the frames? There are {listed}"
            )

        name = array or frames[0]
        if name not in found:
            raise FrameError(f"no array {name!r}; there are {', '.join(found)}")

        return picture_streams.array_scan(path, np.asarray(found[name]), axes)


# FFmpeg's tag of gray16le, the only deeper format that OpenCV leaves unchanged
GREY_16 = b"Y1\0\x10"
BITS_OF_PIXELS = (8, 24, 32)  # of 8 bits a sample, which some tags end in
MATROSKA = b"\x1a\x45\xdf\xa3"
EVEN = 0.05  # of their median, that steps of time may differ to be even


def read_film(path: Path) -> PictureSource:
    """Return a film's frames; all of them are counted first, as the stated number is
    not reliable.
    """
    with _opened(path) as film:
        rows, columns = (
            int(film.get(what))
            for what in (cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH)
        )
        check_image_size(rows, columns)
        deep = _is_deep(path, film)
        rate_hz = float(film.get(cv2.CAP_PROP_FPS))
        stated = int(film.get(cv2.CAP_PROP_FRAME_COUNT))
        times_ms = []

        while film.grab():
            times_ms.append(float(film.get(cv2.CAP_PROP_POS_MSEC)))

        if not times_ms:
            raise FrameError("no frame in it that can be decoded")

        picture_streams.check_bytes(len(times_ms) * rows * columns * (2 if deep else 1))

    time_s = to_si(np.array(times_ms), "ms")
    steps_s = np.diff(time_s)
    pace = f"film of {rate_hz:g} frames a second"
    if steps_s.size and np.ptp(steps_s) > EVEN * np.median(steps_s):
        pace = f"film's time stamps, {steps_s.min():.3g} to {steps_s.max():.3g} s apart"

    notes = [
        "a film's compression changes grey levels and fine structure; its times are"
        " those at which it plays (`rate_hz` where frames were taken at another rate)"
    ]
    count = len(times_ms)

    with path.open("rb") as file:
        if count < stated and file.read(4) != MATROSKA:
            # which states no number of frames
            notes.append(
                f"states {stated} frames and plays {count}: cut off, or the others are"
                " empty, hidden or damaged"
            )

    shape = (rows, columns)
    bits = None if deep else 8
    times = FrameTimes(time_s, pace) if rising(time_s) else None
    scan = PictureSource(
        picture_streams.frame_names(path, count),
        *shape,
        lambda: _pictures(path, shape, deep),
        bits=bits,
        times=times,
    )

    return replace(scan, notes=tuple(notes)).of_file(path)


def _is_deep(path: Path, film: cv2.VideoCapture) -> bool:
    tag = (int(film.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF).to_bytes(
        4, "little"
    )
    if tag == GREY_16:
        return True
    if not _has_8_bits(tag):
        way = f"ffmpeg -i {path.name} -pix_fmt gray16le -c:v ffv1 grey.mkv"
        raise FrameError(
            f"FFmpeg's pixel format {tag!r}; 8 bits, and 16 of grey, are read"
            f" unchanged; write it so: {way}"
        )

    return False


def _has_8_bits(tag: bytes) -> bool:
    r"""Return whether a sample has 8 bits by FFmpeg's tag of the pixel format
    (libavcodec/raw.c).

    >>> tags = b"I420", b"RGB\x18", b"Y1\0\x0a", b"\x0c\x0b3Y", b"P010", bytes(4)
    >>> [_has_8_bits(tag) for tag in tags]
    [True, True, False, False, False, False]
    """
    return (tag.isalnum() and not re.fullmatch(rb"[PYXv]\d(10|12|16)", tag)) or tag[
        3
    ] in BITS_OF_PIXELS


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    # We report faults of a film ourselves, once; OpenCV and its FFmpeg stay quiet.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    film = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)

    try:
        with named_faults(path, "film"):
            if not film.isOpened():
                raise FrameError(
                    "damaged or a kind of film that OpenCV does not decode"
                )

            yield film
    finally:
        film.release()
        cv2.utils.logging.setLogLevel(before)


def _pictures(
    path: Path, shape: tuple[int, int], deep: bool
) -> picture_streams.PictureStream:
    with _opened(path) as film:
        if deep:
            film.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        while (picture := film.read()[1]) is not None:
            if picture.shape[:2] != shape:
                raise FrameError(
                    f"its frames change their size, from {shape} to {picture.shape[:2]}"
                )
            if picture.dtype != (np.uint16 if deep else np.uint8):
                raise FrameError(
                    f"decoded as {picture.dtype}, not with the {16 if deep else 8} bits"
                    " that it has"
                )

            yield (
                cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
                if picture.ndim == 3
                else picture
            )
