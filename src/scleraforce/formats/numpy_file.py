"""NumPy's .npy, and .npz with one array or a chosen one; pickled objects are refused."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.formats.axes import array_scan
from scleraforce.formats.scan import UnansweredError
from scleraforce.recording.faults import named_faults
from scleraforce.recording.scan import Scan, check_bytes


def read_numpy(path: Path, axes: tuple[str, ...] | None, array: str | None) -> Scan:
    """Return the frames of an array; a file of one array is read from the disk as it is needed.

    Args:
        path: of the file.
        axes: in the order of the array's indices.
        array: name of that with the frames in a .npz; None: the only one of two or three axes.

    Raises:
        UnansweredError: axes or array are open.
        FrameError: it cannot be read.
    """
    with named_faults(path, "NumPy file of numbers"):
        return array_scan(path, _loaded(path, array), axes)


def _loaded(path: Path, array: str | None) -> NDArray[Any]:
    with path.open("rb") as file:
        if file.read(2) != b"PK":
            return np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
    with np.load(path, allow_pickle=False) as held:
        check_bytes(path, sum(info.file_size for info in held.zip.infolist()))
        found = {name: held[name] for name in held.files}
    frames = {name: value for name, value in found.items() if value.ndim in (2, 3) and value.size > 1}
    if array is None and len(frames) != 1:
        raise UnansweredError("--array", f"{path}: which array has the frames? There are {', '.join(found) or 'none'}")
    name = array or next(iter(frames))
    if name not in found:
        raise FrameError(f"{path}: no array {name!r}; there are {', '.join(found)}")
    return np.asarray(found[name])
