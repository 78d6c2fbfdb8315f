"""Volumes of frames as NIfTI and NRRD have them, with their spacing and its unit.

Axes are named in the order of the file, the fastest first. A spacing of exactly 1 along every axis is what programs
write where they know none, and counts as none.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.formats.axes import AXES, array_scan
from scleraforce.formats.extra import package_for
from scleraforce.formats.volume_files import (
    SAME,
    Axes,
    check_orientation,
    data_file,
    listed,
    plus_sequence,
    stated_steps,
    unpacked,
)
from scleraforce.recording.faults import named_faults
from scleraforce.recording.pixels import Sourced
from scleraforce.recording.scan import METRES, SECONDS, Scan, Times, check_bytes, even_times, rising

SAMPLE_BYTES = 8  # of the widest type of NRRD
NIFTI_UNITS = {0: "", 1: "m", 2: "mm", 3: "micron"}
NRRD_AXES = ("", "???", "none", "domain", "space", "time", "list", "point", "stub")  # kinds that are no components
NRRD_IN_MM = re.compile(r"(left|right|scanner|[LR]A[SI]\b|[LR]P[SI]\b)", re.IGNORECASE)
PACKED = ("gzip", "gz", "bzip2", "bz2")


def read_nifti(path: Path, axes: Axes) -> Scan:
    """Return a NIfTI volume's frames; times from a fourth axis in seconds.

    Raises:
        UnansweredError: axes are open.
        FrameError: it cannot be read, or contradicts itself.
    """
    nibabel = package_for(path, "nibabel", "NIfTI")
    with named_faults(path, "NIfTI"):
        image = nibabel.load(path)
        header = image.header
        shape = header.get_data_shape()
        size = int(np.prod(shape, dtype=np.int64)) * header.get_data_dtype().itemsize
        check_bytes(path, size)
        _check_nifti_end(path, image, size)
        unscaled = (image.dataobj.slope, image.dataobj.inter) == (1.0, 0.0)
        array = np.asarray(image.dataobj.get_unscaled() if unscaled else image.dataobj)
        steps, notes = _nifti_steps(path, header, shape)
        scan = array_scan(path, array, axes, steps)
        if not unscaled:
            notes.append(f"{path}: pixels were scaled by scl_slope {image.dataobj.slope:g}, {image.dataobj.inter:g}")
        scan = replace(scan, notes=(*scan.notes, *notes))
        if len(shape) < 4 or axes is None or axes[-1] != "frame" or array.shape[3] != len(scan.names):
            return scan
        unit_s = SECONDS.get(header.get_xyzt_units()[1], 0.0)
        times = even_times(len(scan.names), float(header.get_zooms()[3]) * unit_s, "NIfTI's pixdim")
        start_s = float(header["toffset"]) * unit_s
        return replace(scan, times=times and replace(times, time_s=times.time_s + start_s))


def _check_nifti_end(path: Path, image: Any, size: int) -> None:
    """Check that no further slice is behind the last one that the header states.

    Raises:
        FrameError: there is one.
    """
    file_map = image.file_map["image"]
    plane = max(1, size // max(1, int(np.prod(image.shape[2:], dtype=np.int64))))
    with file_map.get_prepare_fileobj("rb") as file:
        file.seek(image.dataobj.offset + size)
        more = len(file.read(plane))
    if more >= plane:
        raise FrameError(
            f"{file_map.filename or path}: dim states {' x '.join(map(str, image.shape))} pixels, and more follow; "
            "correct dim, or write the file again"
        )


def _nifti_steps(path: Path, header: Any, shape: tuple[int, ...]) -> tuple[tuple[Sourced | None, ...], list[str]]:
    """Return the spacing of each axis as pixdim and sform state it, and notes.

    Raises:
        FrameError: both state one, and another; or the unit is none of NIfTI's.
    """
    code = int(header["xyzt_units"]) & 7
    if code not in NIFTI_UNITS:
        raise FrameError(f"{path}: xyzt_units: {code} is no unit of length in NIfTI; correct it (1 m, 2 mm, 3 micron)")
    unit_m = METRES.get(NIFTI_UNITS[code])
    pixdim = [float(step) for step in header.get_zooms()]
    affine, sform_code = header.get_sform(coded=True)
    pixdim_steps = stated_steps(pixdim, [unit_m] * len(pixdim), "NIfTI's pixdim")
    if affine is None or not sform_code:
        return pixdim_steps, []
    sform = np.linalg.norm(affine[:3, :3], axis=0).tolist()[: len(pixdim)]
    sform_steps = stated_steps(sform, [unit_m] * len(sform), "NIfTI's sform")
    both = f"pixdim states a spacing of {listed(pixdim[:3])} and sform (code {sform_code}) of {listed(sform)}"
    if not any(sform_steps):
        others = (
            [f"{path}: {both}, as programs write where they know none; pixdim is taken"] if any(pixdim_steps) else []
        )
        return pixdim_steps, others
    if not any(pixdim_steps):
        return (*sform_steps, *pixdim_steps[3:]), [f"{path}: {both}; sform is taken"]
    if any(abs(a - b) > SAME * b for a, b, size in zip(pixdim, sform, shape, strict=False) if size > 1):
        raise FrameError(f"{path}: {both}; correct one of them")
    return pixdim_steps, []


def read_nrrd(path: Path, axes: Axes) -> Scan:
    """Return an NRRD's frames; axes labelled frame, depth and lateral need not be named.

    Raises:
        UnansweredError: axes are open.
        FrameError: it cannot be read, or contradicts itself.
    """
    nrrd = package_for(path, "nrrd", "NRRD")
    with named_faults(path, "NRRD"):
        with path.open("rb") as file:
            header = nrrd.read_header(file)
            start = file.tell()
        _check_nrrd(path, header)
        count = int(np.prod(header["sizes"], dtype=np.int64)) * SAMPLE_BYTES
        check_bytes(path, count)
        data = data_file(path, str(header.get("data file", header.get("datafile", ""))))
        if header["encoding"].lower() in ("gzip", "gz"):
            unpacked(data, data.read_bytes()[start if data == path else 0 :], count)
        array, _ = nrrd.read(str(path), index_order="F")
        named = axes or _nrrd_axes(header, array.shape)
        check_orientation(path, str(header.get("UltrasoundImageOrientation", "")), named)
        scan = array_scan(path, array, named, _nrrd_steps(path, header, array.ndim))
        times = _nrrd_times(header, len(scan.names))
        return plus_sequence(path, replace(scan, times=times), {name: str(value) for name, value in header.items()})


def _check_nrrd(path: Path, header: Any) -> None:
    """Refuse by name what is not read.

    Raises:
        FrameError: the file uses it.
    """
    if header["type"] == "block":
        raise FrameError(f"{path}: type: block; give whole numbers or floats")
    for axis, (kind, size) in enumerate(zip(header.get("kinds", []), header["sizes"], strict=False)):
        if size > 1 and kind.lower() not in NRRD_AXES:
            raise FrameError(f"{path}: kinds: axis {axis + 1} of {size} is {kind!r}; give grey frames, of one channel")
    place = str(header.get("data file", header.get("datafile", "")))
    if place.startswith("LIST") or "%" in place:
        raise FrameError(
            f"{path}: data file: {place}: pixels in several files; save it as one .nrrd (unu save, 3D Slicer)"
        )
    for field in ("byte skip", "line skip"):
        skipped = header.get(field, header.get(field.replace(" ", ""), 0))
        if skipped and header["encoding"].lower() in PACKED:
            raise FrameError(
                f"{path}: {field}: {skipped} beside encoding: {header['encoding']}; save it as one .nrrd (unu save, "
                "3D Slicer)"
            )


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


def _nrrd_steps(path: Path, header: Any, count: int) -> tuple[Sourced | None, ...]:
    """Return the spacing of each axis, by space directions or else by spacings, each in its own unit.

    Raises:
        FrameError: both are stated, and differ.
    """
    units = [str(unit) for unit in header.get("units", [""] * count)]
    spacings = [float(spacing) for spacing in header.get("spacings", [np.nan] * count)]
    _check_ends(path, header, spacings)
    if "space directions" not in header:
        return stated_steps(spacings, [METRES.get(unit) for unit in units], "NRRD's spacings")
    directions = np.array(header["space directions"], dtype=np.float64)
    lengths = np.linalg.norm(directions, axis=1).tolist()
    in_space = _space_units(path, header, directions)
    for axis, (spacing, length) in enumerate(zip(spacings, lengths, strict=True), start=1):
        if np.isfinite(spacing) and np.isfinite(length) and abs(spacing - length) > SAME * length:
            raise FrameError(
                f"{path}: axis {axis}: spacings states {spacing:g}, and space directions {length:g}; correct one"
            )
        if units[axis - 1] in METRES and np.isfinite(length) and METRES[units[axis - 1]] != in_space[axis - 1]:
            raise FrameError(
                f"{path}: axis {axis}: units states {units[axis - 1]!r}, and space units "
                f"{header.get('space units', 'nothing')}; correct one of them"
            )
    return stated_steps(lengths, in_space, "NRRD's space directions")


def _check_ends(path: Path, header: Any, spacings: Sequence[float]) -> None:
    """Check that spacings are those between the first and the last sample, or between the edges of both.

    Raises:
        FrameError: one is not.
    """
    ends = [
        header.get(f"axis {name}", header.get(f"axis{name}", [np.nan] * len(spacings))) for name in ("mins", "maxs")
    ]
    for axis, (step, size, low, high) in enumerate(zip(spacings, header["sizes"], *ends, strict=True), start=1):
        fits = any(abs(abs(high - low) - step * steps) <= SAME * step * steps for steps in (size, size - 1))
        if np.isfinite([step, low, high]).all() and not fits:
            raise FrameError(
                f"{path}: axis {axis}: spacings states {step:g}, and {size} samples from axis mins {low:g} to maxs "
                f"{high:g} have another; correct one of them"
            )


def _space_units(path: Path, header: Any, directions: NDArray[np.float64]) -> list[float | None]:
    """Return the unit of each axis, in m; of an anatomical space it is mm, as NRRD's programs take it.

    Raises:
        FrameError: an axis runs along directions of several units.
    """
    sides = directions.shape[1]
    anatomical = NRRD_IN_MM.match(str(header.get("space", "")))
    names = [str(unit) for unit in header.get("space units") or ["mm" if anatomical else ""] * sides]
    found: list[float | None] = []
    for axis, direction in enumerate(directions, start=1):
        along = {METRES.get(name) for name, part in zip(names, direction, strict=True) if part}
        if len(along) > 1 and np.isfinite(direction).all():
            raise FrameError(f"{path}: axis {axis} runs along directions of several space units, {' '.join(names)}")
        found.append(next(iter(along), None))
    return found
