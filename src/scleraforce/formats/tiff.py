"""TIFF, one page or a stack, of whole numbers or floats; scale and times as ImageJ, OME, JSON and plain tags state."""

import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from mmap import ACCESS_READ, mmap
from pathlib import Path
from struct import unpack
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.formats.faults import named_faults
from scleraforce.formats.greys import one_grey
from scleraforce.formats.scan import PictureStream, Scan, Times, check_bytes, even_times, frame_names, rising
from scleraforce.formats.stated_units import SECONDS
from scleraforce.recording.scaled_frame import Sourced
from scleraforce.recording.tiff_image import METRES, check_page, page_scale, upright

if TYPE_CHECKING:
    import tifffile

__all__ = ["read_tiff_scan"]

FRAME_AXES = "TZQIRPC"  # that count pages: time, depth of a stack, any


def read_tiff_scan(path: Path) -> Scan:
    """Return a TIFF's frames: its pages, or the one long axis beside rows and columns.

    Raises:
        FrameError: naming the file, what was found and what is allowed.
    """
    with _opened(path) as file:
        series = file.series[0]
        count, rows, columns = _sizes(path, file.series)
        page = file.pages.first
        check_bytes(path, sum(each.nbytes for each in file.series))
        with path.open("rb") as opened, mmap(opened.fileno(), 0, access=ACCESS_READ) as data:
            for entry in file.pages:
                check_page(path, entry.aspage(), data)
            if not _is_whole(file, count, data):
                raise FrameError(f"{path}: damaged: its end is missing, or pages that it states")
        depth, lateral = _pixel_m(file, page, rows, columns)
        times = _times(file, count)
    return Scan(
        names=frame_names(path, count),
        rows=rows,
        columns=columns,
        pictures=lambda: _pictures(path, (count, rows, columns)),
        bits=8 if series.dtype == np.uint8 else None,
        depth_pixel_m=depth,
        lateral_pixel_m=lateral,
        times=times,
    )


@contextmanager
def _opened(path: Path) -> "Iterator[tifffile.TiffFile]":
    import tifffile

    tifffile.logger().setLevel("CRITICAL")  # what is wrong with a file is told once, by us
    with named_faults(path, "TIFF"), tifffile.TiffFile(path) as file:
        yield file


def _sizes(path: Path, several: "Sequence[tifffile.TiffPageSeries]") -> tuple[int, int, int]:
    """Return how many frames, rows and columns there are; pages that were written one by one are a series each."""
    if len(several) > 1:
        sizes = {(*_sizes(path, [series]), series.dtype) for series in several}
        count, rows, columns, _ = next(iter(sizes))
        if len(sizes) > 1 or count > 1:
            raise FrameError(f"{path}: {len(several)} series of images; save the one with the frames alone")
        return len(several), rows, columns
    series = several[0]
    length = dict(zip(series.axes, series.shape, strict=True))
    others = [axis for axis, size in length.items() if axis not in "YXS" and size > 1]
    if not {"Y", "X"} <= set(length) or len(others) > 1 or not set(others) <= set(FRAME_AXES):
        found = ", ".join(f"{axis} {size}" for axis, size in length.items())
        raise FrameError(f"{path}: axes {found}; give a stack of frames with one axis beside rows (Y) and columns (X)")
    return length[others[0]] if others else 1, length["Y"], length["X"]


def _is_whole(file: "tifffile.TiffFile", count: int, data: mmap) -> bool:
    """Return whether all that a file refers to lies in it: tifffile leaves out pages that it cannot reach."""
    if file.imagej_metadata and int(file.imagej_metadata.get("images", 1)) != count:
        return False
    last, form = file.pages[-1].aspage(), file.tiff
    tags = last.offset + form.tagnosize
    (number,) = unpack(form.tagnoformat, data[last.offset : tags])
    after = tags + number * form.tagsize
    (following,) = unpack(form.offsetformat, data[after : after + form.offsetsize])
    pages = [entry.aspage() for entry in file.pages]
    ends = [at + size for page in pages for at, size in zip(page.dataoffsets, page.databytecounts, strict=True)]
    return following == 0 and max(ends) <= len(data)


def _pictures(path: Path, shape: tuple[int, int, int]) -> PictureStream:
    with _opened(path) as file:
        pages = list(file.pages)
        if len(pages) == shape[0]:
            for page in pages:
                full = page.aspage()
                yield one_grey(upright(path, full, np.asarray(full.asarray())), path)
        else:  # ImageJ writes large stacks as one page, followed by the others
            yield from np.asarray(file.asarray(series=0)).reshape(shape)


def _pixel_m(
    file: "tifffile.TiffFile", page: "tifffile.TiffPage", rows: int, columns: int
) -> tuple[Sourced | None, Sourced | None]:
    """Return the distance of rows and of columns, and which tag states it."""
    steps_m: tuple[float | None, float | None] = page_scale(file, page)
    source = "OME" if file.ome_metadata else "ImageJ's unit" if file.imagej_metadata else "XResolution, YResolution"
    if steps_m == (None, None):
        steps_m, source = _json_steps(page, rows, columns), "JSON axes in the Software tag"
    depth, lateral = (None if step_m is None else Sourced(step_m, source) for step_m in steps_m)
    return depth, lateral


def _json_steps(page: "tifffile.TiffPage", rows: int, columns: int) -> tuple[float | None, float | None]:
    """Return the steps of axes that a JSON text in the Software tag lists value by value, as myOCT writes them."""
    tag = page.tags.get("Software")
    try:
        axes = json.loads(tag.value)["metadata"] if tag is not None else {}
        depth_m, lateral_m = (_step_m(axes.get(name), size) for name, size in (("z", rows), ("x", columns)))
    except (ValueError, TypeError, KeyError, AttributeError):
        return None, None
    return depth_m, lateral_m


def _step_m(axis: Any, size: int) -> float | None:
    """Return the even step of an axis {"values": [...], "units": "mm"} of so many values, else None."""
    values = np.asarray(axis["values"], dtype=np.float64) if axis else np.zeros(0)
    unit_m = METRES.get(str(axis.get("units", ""))) if axis else None
    if values.shape != (size,) or unit_m is None:
        return None
    steps: NDArray[np.float64] = np.diff(values)
    step = float(steps.mean())
    return abs(step) * unit_m if step and np.allclose(steps, step, rtol=0.01) else None


def _times(file: "tifffile.TiffFile", count: int) -> Times | None:
    """Return times of frames from ImageJ's frame interval, or OME's planes or increment."""
    if file.ome_metadata:
        return _ome_times(file.ome_metadata, count)
    interval = (file.imagej_metadata or {}).get("finterval")
    unit_s = SECONDS.get(str((file.imagej_metadata or {}).get("tunit", "sec")))
    if not isinstance(interval, int | float) or unit_s is None:
        return None
    return even_times(count, interval * unit_s, "ImageJ's finterval")


def _ome_times(xml: str, count: int) -> Times | None:
    planes = [_attributes(plane) for plane in re.findall(r"<(?:\w+:)?Plane\b[^>]*>", xml)]
    if len(planes) == count and all("DeltaT" in plane for plane in planes):
        units_s = [SECONDS.get(plane.get("DeltaTUnit", "s")) for plane in planes]
        if None not in units_s:
            time_s = np.array([float(plane["DeltaT"]) for plane in planes]) * np.array(units_s, dtype=np.float64)
            return Times(time_s, "OME's DeltaT") if rising(time_s) else None
    pixels = re.search(r"<(?:\w+:)?Pixels\b[^>]*>", xml)
    stated = _attributes(pixels.group()) if pixels else {}
    unit_s = SECONDS.get(stated.get("TimeIncrementUnit", "s"))
    return even_times(count, float(stated.get("TimeIncrement", "0")) * (unit_s or 0.0), "OME's TimeIncrement")


def _attributes(element: str) -> dict[str, str]:
    return dict(re.findall(r'([\w:]+)\s*=\s*"([^"]*)"', element))
