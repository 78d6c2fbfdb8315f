"""Films (AVI, MP4, MOV, MKV) with the times at which they play; OpenCV keeps 8 bits, and 16 bits of grey, alone."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import check_size
from scleraforce.recording.scan import PictureStream, Scan, Times, check_bytes, frame_names, named_faults, rising
from scleraforce.units import to_si

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
        check_bytes(len(times_ms) * rows * columns * (2 if deep else 1))
    time_s = to_si(np.array(times_ms), "ms")
    steps_s, pace = np.diff(time_s), f"film of {rate_hz:g} frames a second"
    if steps_s.size and np.ptp(steps_s) > EVEN * np.median(steps_s):
        pace = f"film's time stamps, {steps_s.min():.3g} to {steps_s.max():.3g} s apart"
    notes = [
        "a film's compression changes grey levels and fine structure; times are those at which it plays, from its "
        "first frame on (--rate-hz where frames were taken at another rate)"
    ]
    with path.open("rb") as file:  # Matroska states no number of frames
        known = "" if file.read(4) == MATROSKA else f"states {stated} frames, of which "
    count = len(times_ms)
    if _ends_early(path):
        notes.append(f"{known}{count} can be decoded: it was cut off, for it ends before the end that it states")
    elif known and count < stated:
        notes.append(
            f"holds {stated} frames and plays {count}; the others are empty, hidden by an edit list or damaged"
        )
    shape, bits, times = (rows, columns), None if deep else 8, Times(time_s, pace) if rising(time_s) else None
    scan = Scan(frame_names(path, count), *shape, lambda: _pictures(path, shape, deep), bits=bits, times=times)
    return replace(scan, notes=tuple(notes)).of_file(path)


def _is_deep(path: Path, film: cv2.VideoCapture) -> bool:
    tag = (int(film.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) & 0xFFFFFFFF).to_bytes(4, "little")
    if tag == GREY_16:
        return True
    bits = _bits_of(tag)
    if bits != 8:
        depth = "an unknown number of" if bits is None else bits
        raise FrameError(
            f"pixels of {depth} bits (FFmpeg's pixel format {tag!r}); 8 bits, and 16 of grey, are read unchanged; "
            f"write it so: ffmpeg -i {path.name} -pix_fmt gray16le -c:v ffv1 grey.mkv"
        )
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


def _pictures(path: Path, shape: tuple[int, int], deep: bool) -> PictureStream:
    with _opened(path) as film:
        if deep:
            film.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        while True:
            there, picture = film.read()
            if not there:
                return
            if picture.shape[:2] != shape:
                raise FrameError(f"its frames change their size, from {shape} to {picture.shape[:2]}")
            if picture.dtype != (np.uint16 if deep else np.uint8):
                raise FrameError(f"decoded as {picture.dtype}, not with the {16 if deep else 8} bits that it has")
            yield cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
