"""Films (AVI, MP4, MOV, MKV) as scanners export them: frames of 8 bits, times as the film plays."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from scleraforce.errors import FrameError
from scleraforce.formats.scan import PictureStream, Scan, Times, check_bytes, frame_names, rising
from scleraforce.recording.pixels import check_size
from scleraforce.units import to_si

__all__ = ["read_film"]


def read_film(path: Path) -> Scan:
    """Return a film's frames; all of them are counted first, as what the file says of their number is not reliable.

    Raises:
        FrameError: it cannot be decoded.
    """
    with _opened(path) as film:
        rows, columns = (int(film.get(what)) for what in (cv2.CAP_PROP_FRAME_HEIGHT, cv2.CAP_PROP_FRAME_WIDTH))
        check_size(path, rows, columns)
        rate_hz, stated = float(film.get(cv2.CAP_PROP_FPS)), int(film.get(cv2.CAP_PROP_FRAME_COUNT))
        times_ms = []
        while film.grab():
            times_ms.append(float(film.get(cv2.CAP_PROP_POS_MSEC)))
    if not times_ms:
        raise FrameError(f"{path}: no frame in it that can be decoded")
    check_bytes(path, len(times_ms) * rows * columns)
    time_s = to_si(np.array(times_ms), "ms")
    notes = [
        f"{path}: a film's compression changes grey levels and fine structure; times are those at which it plays "
        "(--rate-hz where frames were taken at another rate)"
    ]
    if len(times_ms) < stated:
        notes.append(f"{path}: states {stated} frames, of which {len(times_ms)} can be decoded; was it cut off?")
    return Scan(
        names=frame_names(path, len(times_ms)),
        rows=rows,
        columns=columns,
        pictures=lambda: _pictures(path, rows, columns),
        bits=8,
        times=Times(time_s, f"film of {rate_hz:g} frames a second") if rising(time_s) else None,
        notes=tuple(notes),
    )


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    # What is wrong with a film is told once, by us: neither OpenCV nor its FFmpeg says it too.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    film = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
    try:
        if not film.isOpened():
            raise FrameError(f"{path}: damaged or a kind of film that OpenCV does not decode")
        yield film
    finally:
        film.release()
        cv2.utils.logging.setLogLevel(before)


def _pictures(path: Path, rows: int, columns: int) -> PictureStream:
    with _opened(path) as film:
        while True:
            there, picture = film.read()
            if not there:
                return
            if picture.shape[:2] != (rows, columns):
                raise FrameError(f"{path}: its frames change their size")
            yield cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
