"""Volumes of frames as NIfTI, MetaImage (MHA, MHD) and NRRD have them, with their spacing and its unit.

Axes are named in the order of the file, the fastest first. A spacing of exactly 1 along every axis is what programs
write where they know none, and counts as none.
"""

import re
import zlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from scleraforce.errors import FrameError
from scleraforce.formats.axes import AXES, array_scan
from scleraforce.formats.extra import package_for
from scleraforce.formats.scan import LARGEST_BYTES, Scan, Times, check_bytes, even_times, rising
from scleraforce.formats.stated_units import SECONDS
from scleraforce.recording.faults import named_faults
from scleraforce.recording.scaled_frame import Sourced
from scleraforce.recording.tiff_image import METRES

__all__ = ["read_metaimage", "read_nifti", "read_nrrd"]

Axes = tuple[str, ...] | None

HEADER_BYTES = 2**16
SAMPLE_BYTES = 8  # of the widest type of NRRD and MetaImage
GZIP_OR_ZLIB = zlib.MAX_WBITS | 32


def read_nifti(path: Path, axes: Axes) -> Scan:
    """Return a NIfTI volume's frames; times from a fourth axis in seconds.

    Raises:
        UnansweredError: axes are open.
        FrameError: it cannot be read.
    """
    nibabel = package_for(path, "nibabel", "NIfTI")
    with named_faults(path, "NIfTI"):
        image = nibabel.load(path)
        header = image.header
        check_bytes(path, int(np.prod(header.get_data_shape(), dtype=np.int64)) * header.get_data_dtype().itemsize)
        unscaled = (image.dataobj.slope, image.dataobj.inter) == (1.0, 0.0)
        array = np.asarray(image.dataobj.get_unscaled() if unscaled else image.dataobj)
        unit, unit_of_time = header.get_xyzt_units()
        steps = [float(step) for step in header.get_zooms()]
        scan = array_scan(path, array, axes, _stated(steps, METRES.get(unit), "NIfTI's pixdim"))
        if len(steps) < 4 or axes is None or axes[-1] != "frame" or array.shape[3] != len(scan.names):
            return scan
        step_s = steps[3] * SECONDS.get(unit_of_time, 0.0)
        return replace(scan, times=even_times(len(scan.names), step_s, "NIfTI's pixdim"))


def read_metaimage(path: Path, axes: Axes) -> Scan:
    """Return a MetaImage's frames; its spacing is in mm.

    Raises:
        UnansweredError: axes are open.
        FrameError: it cannot be read.
    """
    metaimageio = package_for(path, "metaimageio", "MetaImage")
    with named_faults(path, "MetaImage"):
        stated = _metaimage_header(path)
        size = [int(length) for length in stated["DimSize"].split()]
        count = int(np.prod(size, dtype=np.int64)) * SAMPLE_BYTES
        check_bytes(path, count)
        data = _data_file(path, stated["ElementDataFile"].removesuffix("LOCAL"))
        if stated.get("CompressedData", "").upper() == "TRUE":
            _check_packed(data, b"LOCAL" if data == path else b"", count)
        array, header = metaimageio.read(path)
        steps = header["ElementSpacing"]
        spacing = _stated(steps.tolist(), METRES["mm"], "ElementSpacing") if steps is not None else ()
        return array_scan(path, array.T, axes, spacing)


def read_nrrd(path: Path, axes: Axes) -> Scan:
    """Return an NRRD's frames; axes labelled frame, depth and lateral need not be named.

    Raises:
        UnansweredError: axes are open.
        FrameError: it cannot be read.
    """
    nrrd = package_for(path, "nrrd", "NRRD")
    with named_faults(path, "NRRD"):
        header = nrrd.read_header(str(path))
        count = int(np.prod(header["sizes"], dtype=np.int64)) * SAMPLE_BYTES
        check_bytes(path, count)
        data = _data_file(path, str(header.get("data file", header.get("datafile", ""))))
        if header["encoding"] in ("gzip", "gz"):
            _check_packed(data, b"\n\n" if data == path else b"", count)
        array, _ = nrrd.read(str(path), index_order="F")
        steps, unit = _nrrd_steps(header, array.ndim)
        named = axes or _nrrd_axes(header, array.shape)
        scan = array_scan(path, array, named, _stated(steps, METRES.get(unit), "NRRD's spacing"))
        return replace(scan, times=_nrrd_times(header, len(scan.names)))


def _stated(steps: Sequence[float], unit_m: float | None, source: str) -> tuple[Sourced | None, ...]:
    """Return the step along each axis, None where it is not known."""
    if unit_m is None or all(step in (0.0, 1.0) or not np.isfinite(step) for step in steps[:3]):
        return tuple(None for _ in steps)
    return tuple(Sourced(step * unit_m, source) if np.isfinite(step) and step > 0.0 else None for step in steps)


def _metaimage_header(path: Path) -> dict[str, str]:
    with path.open("rb") as file:
        before, key, after = file.read(HEADER_BYTES).partition(b"ElementDataFile")
    text = (before + key + after.partition(b"\n")[0]).decode("ascii", "replace")
    return dict(re.findall(r"^\s*(\w+)\s*=\s*(.*?)\s*$", text, flags=re.MULTILINE))


def _data_file(path: Path, named: str) -> Path:
    """Return the file that holds the pixels of a header: its own where it names none, else one beside it.

    Raises:
        FrameError: it names one elsewhere.
    """
    if not named:
        return path
    if PurePath(named).name != named:
        raise FrameError(f"{path}: its pixels are said to be in {named!r}; import it where they lie beside it")
    return path.with_name(named)


def _nrrd_axes(header: Any, shape: tuple[int, ...]) -> Axes:
    """Return the axes that labels name; a list, as in sequences of 3D Slicer, is that of the frames."""
    labels = header.get("labels", [""] * len(shape))
    kinds = header.get("kinds", [""] * len(shape))
    named = ["frame" if kind == "list" else label for label, kind in zip(labels, kinds, strict=True)]
    long = tuple(name for name, size in zip(named, shape, strict=True) if size > 1)
    return long if sorted(long) in (sorted(AXES), sorted(AXES[1:])) else None


def _nrrd_times(header: Any, count: int) -> Times | None:
    """Return the index values of a sequence of 3D Slicer, where they are in a unit of time."""
    for axis, kind in enumerate(header.get("kinds", [])):
        unit_s = SECONDS.get(str(header.get("units", [""] * (axis + 1))[axis]))
        values = str(header.get(f"axis {axis} index values", "")).split()
        if kind == "list" and unit_s and len(values) == count:
            time_s = np.array(values, dtype=np.float64) * unit_s
            return Times(time_s, f"NRRD's axis {axis} index values") if rising(time_s) else None
    return None


def _nrrd_steps(header: Any, count: int) -> tuple[list[float], str]:
    """Return the spacing of each axis (NaN: none) and its unit; in an anatomical space that is mm."""
    if "space directions" in header:
        steps = [float(np.linalg.norm(direction)) for direction in header["space directions"]]
        units = header.get("space units") or ["mm"]
        return steps, str(units[0])
    spacings = header.get("spacings", [np.nan] * count)
    units = [unit for unit in header.get("units", []) if unit in METRES]
    return [float(spacing) for spacing in spacings], units[0] if units else ""


def _check_packed(path: Path, mark: bytes, most: int) -> None:
    """Check that the zlib or gzip stream behind a mark in a file gives no more bytes than its header says.

    Raises:
        FrameError: it gives more.
    """
    data = path.read_bytes()
    unpacked, rest = 0, data[data.find(mark) + len(mark) :].lstrip(b"\r\n")
    stream = zlib.decompressobj(GZIP_OR_ZLIB)
    while rest and not stream.eof and unpacked <= min(most, LARGEST_BYTES):
        unpacked += len(stream.decompress(rest, 2**24))
        rest = stream.unconsumed_tail
    if unpacked > most:
        raise FrameError(f"{path}: damaged: more is packed in it than its header says")
