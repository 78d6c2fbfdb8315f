"""Which axis of an array is which: of the frames, of their rows (depth) and of their columns (lateral)."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError, InputError
from scleraforce.formats.scan import UnansweredError
from scleraforce.recording.pixels import Sourced, check_size
from scleraforce.recording.scan import Scan, check_bytes, frame_names

AXES = ("frame", "depth", "lateral")


def parse_axes(text: str) -> tuple[str, ...]:
    """Return the axes that a text names.

    >>> parse_axes("lateral, depth,frame")
    ('lateral', 'depth', 'frame')

    Raises:
        InputError: they are not those of frames.
    """
    names = tuple(name.strip() for name in text.split(","))
    if sorted(names) not in (sorted(AXES), sorted(AXES[1:])):
        raise InputError(f"--axes: {text!r}; give {','.join(AXES)} in the order of the file, or depth,lateral of one")
    return names


def array_scan(
    path: Path, array: NDArray[Any], axes: tuple[str, ...] | None, pixel_m: tuple[Sourced | None, ...] = ()
) -> Scan:
    """Return an array of frames as a scan; axes of length 1 do not count.

    Args:
        path: of the file.
        array: of two or three axes longer than 1.
        axes: names of those, in their order; None: not known.
        pixel_m: step along each axis of `array`, where it is known.

    Raises:
        UnansweredError: `axes` is None.
        FrameError: the axes are not as many, or the frames cannot be used.
    """
    sizes = " x ".join(map(str, array.shape))
    long = [axis for axis, size in enumerate(array.shape) if size > 1]
    steps_m = [pixel_m[axis] if pixel_m else None for axis in long]
    array = array.squeeze()
    if array.ndim not in (2, 3):
        raise FrameError(f"{path}: an array of {sizes}; give frames x rows x columns, or one frame")
    if array.dtype.kind not in "uif":
        raise FrameError(f"{path}: pixels of type {array.dtype}; give whole numbers or floats, one of a pixel (grey)")
    if axes is None:
        names = ",".join(AXES[-array.ndim :])
        question = f"which axis is which? Name {names} in the order of the sizes"
        raise UnansweredError("--axes", f"{path}: an array of {sizes}: {question}")
    if array.ndim == 2:
        axes = tuple(name for name in axes if name != "frame")
    if len(axes) != array.ndim:
        raise FrameError(f"{path}: --axes names {len(axes)} axes ({','.join(axes)}); the array is of {sizes}")
    check_bytes(path, array.nbytes)
    frames = np.transpose(array, [axes.index(name) for name in AXES if name in axes])
    frames = frames if frames.ndim == 3 else frames[np.newaxis]
    rows, columns = frames.shape[1:]
    check_size(path, rows, columns)
    depth_m, lateral_m = (steps_m[axes.index(name)] for name in AXES[1:])
    return Scan(
        names=frame_names(path, len(frames)),
        rows=rows,
        columns=columns,
        pictures=lambda: iter(frames),
        bits=8 if frames.dtype == np.uint8 else None,
        depth_pixel_m=depth_m,
        lateral_pixel_m=lateral_m,
    )
