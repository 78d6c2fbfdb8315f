"""TIFF, one page or a stack; scale and times from OME-XML, ImageJ, the resolution tags
or JSON axes in Software.
"""

import json
import lzma
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from io import BytesIO
from math import inf, isclose
from pathlib import Path
from struct import unpack
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.errors import FrameError
from scleraforce.recordings.formats import picture_streams
from scleraforce.recordings.formats.picture_streams import (
    METRES,
    SECONDS,
    FrameTimes,
    PictureSource,
    PixelSize,
    inverted_pixels,
    one_grey,
    rising,
)

if TYPE_CHECKING:
    from tifffile import TiffFile, TiffPage, TiffPageSeries

WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE = range(4)  # PhotometricInterpretation
# Compression
DEFLATE = (8, 32946)
PACKBITS = 32773
LZMA = 34925
LZMA_BYTES = 128 * 2**20  # of memory; files of the highest preset take 65 MiB
PLANES_APART = 2  # PlanarConfiguration
ORIENTATIONS = range(1, 9)
# ResolutionUnit
NO_UNIT = 1
INCH = 2
CENTIMETRE = 3
UNIT_NAMES = {NO_UNIT: "none", INCH: "inch", CENTIMETRE: "cm"}
# what ImageJ calls the unit of an image without a scale
NO_UNITS = (
    "pixel",
    "pixels",
    "px",
)
FRAME_AXES = "TZQIRPC"  # that count pages: time, depth of a stack, any
# Axes other than time, which may be of one moment.
SLICES = "Z"
OTHER_AXES = {SLICES: "slices", "C": "channels", "R": "tiles", "P": "phases"}
# of ImageJ's composites; tifffile counts frames without named axes as channels
MOST_CHANNELS = 7
# units in which programs state the resolution of a screen or a printer, asked or not
# ...
PRINTED = (
    25.4e-3,
    1e-2,
)
MOST_PAGES = 100_000
PRINTED_M = 20e-6  # ... which are never finer than this: 1,270 dots per inch


def read_tiff(path: Path, data: bytes | None = None) -> PictureSource:
    """Return a TIFF's frames: its pages, or the one long axis beside rows and columns;
    `data` is its content.
    """
    with _opened(path, data) as file:
        pages = [entry.aspage() for entry in file.pages]
        frames = [page for page in pages if not _is_copy(page, pages[0])]
        for page in pages:
            _check_page(file, page)

        series = [each for each in file.series if not _is_copy(each.keyframe, pages[0])]
        count, rows, columns = _sizes(series)
        axis = _axis(series[0])
        picture_streams.check_bytes(sum(each.nbytes for each in file.series))
        _check_pages(file, pages, len(frames), count)
        orientation = _orientation(frames)
        notes: list[str] = []
        sizes = [
            *_ome_sizes(file, notes),
            *(_resolution(file, page, notes) for page in frames),
        ]
        size, scale_fault = picture_streams.one_size(
            [*sizes, _json_size(frames[0], rows, columns)]
        )
        times, times_fault = _times(file, count, notes, axis)
        kinds = {page.photometric for page in frames}
        copies = any(page.subifds for page in frames)

        for note, holds in (
            (
                "smaller copies of the frames in the file were not read",
                copies or len(frames) < len(pages),
            ),
            (
                (
                    "PhotometricInterpretation is WhiteIsZero: dark and bright were"
                    " exchanged"
                ),
                WHITE_IS_ZERO in kinds,
            ),
            ("colour became grey", kinds & {RGB, PALETTE}),
            (
                f"Orientation {orientation}: the frames were turned as it states",
                orientation != ORIENTATIONS[0],
            ),
        ):
            notes += [note] if holds else []

        names = picture_streams.frame_names(path, count)
        bits = 8 if file.series[0].dtype == np.uint8 else None
        scan = PictureSource(
            names,
            rows,
            columns,
            lambda: _pictures(path, data, (count, rows, columns)),
            bits=bits,
            times=times,
            times_fault=times_fault,
            labels=_labels(file, count),
            one_moment=_one_moment(file, count, axis),
        )
        scan = replace(
            scan, size=size, scale_fault=scale_fault, notes=tuple(dict.fromkeys(notes))
        ).of_file(path)

    # From the fifth orientation on, rows and columns change places, with their sizes.
    shown = scan.turned() if orientation in ORIENTATIONS[4:] else scan
    return replace(
        shown,
        pictures=lambda: (
            picture_streams.as_shown(picture, orientation)
            for picture in scan.pictures()
        ),
    )


@contextmanager
def _opened(path: Path, data: bytes | None) -> "Iterator[TiffFile]":
    # 13 ms: not for a recording of PNG files
    import tifffile

    tifffile.logger().setLevel("CRITICAL")  # we report faults ourselves, once
    file = path if data is None else BytesIO(data)

    with (
        picture_streams.named_faults(path, "TIFF"),
        tifffile.TiffFile(file, _multifile=False) as opened,
    ):
        _check_chain(opened)
        yield opened


def _check_chain(file: "TiffFile") -> None:
    """Follow the pages, each of which has the next one's place, once."""
    tiff = file.tiff
    at = _number(file, tiff.offsetsize, tiff.offsetsize, tiff.offsetformat)
    seen = set[int]()

    while at:
        if at in seen:
            raise FrameError("damaged: its pages go round")
        if len(seen) == MOST_PAGES:
            raise FrameError(f"more than {MOST_PAGES} pages; save it as several files")

        seen.add(at)
        tags = _number(file, at, tiff.tagnosize, tiff.tagnoformat)
        after = at + tiff.tagnosize + (tags or 0) * tiff.tagsize
        at = tags and _number(file, after, tiff.offsetsize, tiff.offsetformat)


def _number(file: "TiffFile", at: int, size: int, form: str) -> int | None:
    """Return a number in the file; None beyond its end."""
    data = _read(file, at, size) if at < file.filehandle.size else b""
    return int(unpack(form, data)[0]) if len(data) == size else None


def _read(file: "TiffFile", at: int, count: int) -> bytes:
    handle = file.filehandle
    handle.seek(at)
    return handle.read(min(count, handle.size))


def _is_copy(page: "TiffPage", first: "TiffPage") -> bool:
    return bool(page.is_reduced) and page.shape != first.shape


def _check_page(file: "TiffFile", page: "TiffPage") -> None:
    kind = getattr(page.photometric, "name", page.photometric)
    if page.photometric not in (WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE):
        raise FrameError(
            f"a TIFF of kind {kind}; save it as grey (black is zero) or RGB"
        )

    picture_streams.check_image_size(
        page.imagelength, page.imagewidth, page.samplesperpixel
    )
    if page.photometric != RGB and page.samplesperpixel > 1:
        found = (
            f"SamplesPerPixel {page.samplesperpixel}, PhotometricInterpretation {kind}"
        )
        raise FrameError(f"{found}: several channels; save the one with the frames")

    picture_streams.check_image_size(max(2, page.tilelength), max(2, page.tilewidth))
    most = int(np.prod(page.chunks)) * 8

    for at, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        if page.compression in DEFLATE:
            picture_streams.unpacked_bytes(_read(file, at, count), most)
        elif page.compression == PACKBITS:
            picture_streams.check_packbits(_read(file, at, count), most)
        elif page.compression == LZMA:
            unpacker = lzma.LZMADecompressor(memlimit=LZMA_BYTES)
            picture_streams.unpacked_bytes(_read(file, at, count), most, unpacker)
            if unpacker.unused_data:  # tifffile would unpack it, too
                raise FrameError("damaged: data follows the end of its LZMA stream")


def _sizes(several: "Sequence[TiffPageSeries]") -> tuple[int, int, int]:
    """Return the number of frames, rows and columns; pages that were written one by one
    are a series each.
    """
    if len(several) > 1:
        sizes = {(*_sizes([series]), series.dtype) for series in several}
        count, rows, columns, _ = next(iter(sizes))
        if len(sizes) > 1 or count > 1:
            found = " and ".join(
                f"{series.shape} {series.dtype}" for series in several[:2]
            )
            raise FrameError(
                f"{len(several)} series of images ({found}); save the one with the"
                " frames alone"
            )

        return len(several), rows, columns

    series = several[0]
    length = dict(zip(series.axes, series.shape, strict=True))

    others = [axis for axis, size in length.items() if axis not in "YXS" and size > 1]
    if (
        not {"Y", "X"} <= set(length)
        or len(others) > 1
        or not set(others) <= set(FRAME_AXES)
    ):
        found = ", ".join(f"{axis} {size}" for axis, size in length.items())
        raise FrameError(
            f"axes {found}; give a stack of frames with one axis beside rows (Y) and"
            " columns (X)"
        )

    return length[others[0]] if others else 1, length["Y"], length["X"]


def _check_pages(
    file: "TiffFile", pages: "Sequence[TiffPage]", there: int, count: int
) -> None:
    """Check that tifffile reached all pages: `there` pages of frames are in it, `count`
    frames are stated.
    """
    after = file.pages.next_page_offset  # where the place of a further page is
    ends = [
        at + size
        for page in pages
        for at, size in zip(page.dataoffsets, page.databytecounts, strict=True)
    ]
    if (
        after is None
        or any(_read(file, after, file.tiff.offsetsize))
        or max(ends) > file.filehandle.size
    ):
        raise FrameError("damaged: its end is missing, or pages that it states")

    stated = int((file.imagej_metadata or {}).get("images", count))
    if stated != count:
        raise FrameError(
            f"damaged: ImageJ's description states images={stated}, the file has"
            f" {count}"
        )
    if None in (
        page for series in file.series for page in series.pages
    ) or there not in (1, count):
        kind = "OME-XML" if file.ome_metadata else "its description"
        raise FrameError(
            f"{kind} states {count} frames, the file has {there} pages; save all frames"
            " in one file"
        )


def _orientation(pages: "Sequence[TiffPage]") -> int:
    found = sorted(
        {
            int(page.tags.valueof("Orientation", default=0)) or ORIENTATIONS[0]
            for page in pages
        }
    )
    if len(found) > 1:
        raise FrameError(
            f"Orientation {found[0]} and {found[1]} in one file; save all frames"
            " with one"
        )
    if found[0] not in ORIENTATIONS:
        raise FrameError(f"Orientation {found[0]}; TIFF has 1 to 8")

    return found[0]


def _pictures(
    path: Path, data: bytes | None, shape: tuple[int, int, int]
) -> picture_streams.PictureStream:
    with _opened(path, data) as file:
        first = file.pages[0].aspage()
        several = [each for each in file.series if not _is_copy(each.keyframe, first)]
        # OME-XML may state another order than that of the pages in the file.
        listed = [page for each in several for page in each.pages if page is not None]
        entries = listed if len(listed) == shape[0] else file.pages
        pages = [
            page for entry in entries if not _is_copy(page := entry.aspage(), first)
        ]
        if len(pages) == shape[0]:
            for page in pages:
                yield one_grey(_bright(page, np.asarray(page.asarray())))
        else:  # ImageJ writes large stacks as one page, followed by the others
            for picture in np.asarray(file.asarray(series=0)).reshape(*shape, -1):
                plain = picture if picture.shape[-1] > 1 else picture[..., 0]
                yield one_grey(_bright(first, plain))


def _bright(page: "TiffPage", pixels: NDArray[Any]) -> NDArray[Any]:
    if page.photometric == PALETTE and page.colormap is not None:
        # Values of 16 bits; some programs write 8 bits all the same.
        colours = np.asarray(page.colormap)
        colours = (colours if colours.max() < 256 else colours >> 8).astype(np.uint8)
        return np.moveaxis(colours[:, pixels], 0, -1)

    if page.planarconfig == PLANES_APART and pixels.ndim == 3:
        pixels = np.moveaxis(pixels, 0, -1)
    return (
        inverted_pixels(pixels, page.bitspersample)
        if page.photometric == WHITE_IS_ZERO
        else pixels
    )


def _of_ome(file: "TiffFile", kind: str) -> list[dict[str, str]]:
    elements = (
        ElementTree.fromstring(file.ome_metadata).iter() if file.ome_metadata else ()
    )
    return [
        element.attrib for element in elements if element.tag.rpartition("}")[2] == kind
    ]


def _ome_sizes(file: "TiffFile", notes: list[str]) -> list[PixelSize]:
    """Return the physical sizes of a pixel that OME-XML states; their unit is the
    micrometre where it names none.
    """
    found = []
    for stated in _of_ome(file, "Pixels"):
        sizes_m: list[float | None] = []
        for axis in "YX":
            unit = stated.get(f"PhysicalSize{axis}Unit", "µm")
            size = float(stated.get(f"PhysicalSize{axis}", "nan"))
            notes += (
                []
                if unit in METRES
                else [f"OME's unit {unit!r} is not known: the scale is not either"]
            )
            sizes_m.append(
                size * METRES[unit] if unit in METRES and 0.0 < size < inf else None
            )

        found.append(PixelSize("OME", depth_m=sizes_m[0], lateral_m=sizes_m[1]))

    return found


def _resolution(file: "TiffFile", page: "TiffPage", notes: list[str]) -> PixelSize:
    """Return the size that X and YResolution state, in ImageJ's unit or in
    ResolutionUnit.

    ImageJ itself reads the two tags in the unit of its description and ignores
    ResolutionUnit, but for `um` beside centimetres, which are per centimetre
    (ij/io/FileOpener.java, decodeDescriptionString).
    """
    kind = int(page.resolutionunit)
    tag_m = {INCH: 25.4e-3, CENTIMETRE: 1e-2}.get(kind)
    deep, unit = (
        str((file.imagej_metadata or {}).get(name, "")).strip()
        for name in ("yunit", "unit")
    )
    source = "ImageJ's unit"

    units_m = [_metres(deep or unit), _metres(unit)]
    if unit and unit not in NO_UNITS and units_m[1] is None:
        notes.append(f"ImageJ's unit {unit!r} is not known: the scale is not either")

    if not unit:
        source = "XResolution, YResolution"
        units_m = [tag_m, tag_m]
        if tag_m and "ResolutionUnit" not in page.tags and "XResolution" in page.tags:
            notes.append("no ResolutionUnit: by the standard of TIFF it is the inch")
    elif "ResolutionUnit" in page.tags and tag_m and units_m != [tag_m, tag_m]:
        if kind == CENTIMETRE and unit == "um" == (deep or unit):
            units_m = [tag_m, tag_m]
        taken = "ResolutionUnit" if units_m == [tag_m, tag_m] else "ImageJ's unit"
        notes.append(
            f"ImageJ's unit is {unit}, ResolutionUnit {UNIT_NAMES[kind]}: {taken}"
            " counts, as in ImageJ"
        )

    depth_m, lateral_m = map(
        partial(_size, page), ("YResolution", "XResolution"), units_m
    )
    printed = (
        units_m[0] in PRINTED and depth_m == lateral_m and (depth_m or 0.0) >= PRINTED_M
    )

    return PixelSize(
        source,
        depth_m=None if printed else depth_m,
        lateral_m=None if printed else lateral_m,
    )


def _metres(unit: str) -> float | None:
    r"""Return a unit in m, as programs write it: case and Java's escapes (\u00B5m) do
    not matter.
    """
    plain = re.sub(r"\\u([0-9a-fA-F]{4})", lambda code: chr(int(code[1], 16)), unit)
    return METRES.get(plain, METRES.get(plain.lower()))


def _size(page: "TiffPage", name: str, unit_m: float | None) -> float | None:
    count, units = page.tags.valueof(name, default=(0, 0))
    return units / count * unit_m if unit_m and count > 0 and units > 0 else None


def _json_size(page: "TiffPage", rows: int, columns: int) -> PixelSize:
    """Return the steps of axes that a JSON text in the Software tag lists value by
    value, as myOCT writes them.
    """
    depth_m = None
    lateral_m = None

    with suppress(ValueError, TypeError, KeyError, AttributeError):
        axes = json.loads(page.tags["Software"].value)["metadata"]
        depth_m = _step_m(axes.get("z"), rows)
        lateral_m = _step_m(axes.get("x"), columns)

    return PixelSize(
        "JSON axes in the Software tag", depth_m=depth_m, lateral_m=lateral_m
    )


def _step_m(axis: Any, size: int) -> float | None:
    values = np.asarray((axis or {}).get("values", ()), np.float64)
    unit_m = METRES.get((axis or {}).get("units", ""))
    if values.shape != (size,) or unit_m is None:
        return None

    steps = np.diff(values)
    even = steps.mean() and np.allclose(steps, steps.mean(), rtol=0.01)
    return abs(float(steps.mean())) * unit_m if even else None


def _labels(file: "TiffFile", count: int) -> tuple[str, ...] | None:
    """Return the names that ImageJ gives slices, such as those of their files."""
    stated = (file.imagej_metadata or {}).get("Labels", None) or ()
    names = tuple(str(each).partition("\n")[0].strip() for each in stated)
    return names if len(names) == len(set(names)) == count and all(names) else None


def _axis(series: "TiffPageSeries") -> str:
    """Return the one long axis beside rows and columns; "" if there is none."""
    sizes = zip(series.axes, series.shape, strict=True)
    return next((axis for axis, size in sizes if axis not in "YXS" and size > 1), "")


def _one_moment(file: "TiffFile", count: int, axis: str) -> str | None:
    """Return why frames are of one moment: channels, or slices with a step."""
    imagej = file.imagej_metadata or {}
    kind = OTHER_AXES.get(axis)
    program = "OME" if file.ome_metadata else "ImageJ" if imagej else "its description"
    stated = f"{program} states {count} {kind} ({axis.lower()})"
    if kind is None or (axis == "C" and imagej and count > MOST_CHANNELS):
        return None
    if axis != SLICES:
        return stated

    spacing = imagej.get("spacing", None)
    if isinstance(spacing, int | float) and spacing:
        return f"{stated}, {abs(spacing):g} {imagej.get('unit', '')} apart"

    for pixels in _of_ome(file, "Pixels"):
        if step := pixels.get("PhysicalSizeZ"):
            unit = pixels.get("PhysicalSizeZUnit", "µm")
            return f"{stated}, {float(step):g} {unit} apart"

    return None


def _times(
    file: "TiffFile", count: int, notes: list[str], axis: str
) -> tuple[FrameTimes | None, str | None]:
    """Return the times of frames, and why those that are stated are not theirs."""
    other = OTHER_AXES.get(axis)
    imagej = file.imagej_metadata or {}
    if not file.ome_metadata:
        interval = imagej.get("finterval")
        unit_s = SECONDS.get(str(imagej.get("tunit", "sec")))
        step_s = (
            interval * unit_s
            if isinstance(interval, int | float) and unit_s is not None
            else 0.0
        )
        return _even_times(count, step_s, "ImageJ's finterval", other)

    stated = next(iter(_of_ome(file, "Pixels")), {})
    step_s = float(stated.get("TimeIncrement", "0")) * SECONDS.get(
        stated.get("TimeIncrementUnit", "s"), 0.0
    )
    index = f"The{axis}" if axis in ("Z", "C") else "TheT"
    planes = sorted(
        _of_ome(file, "Plane"), key=lambda plane: int(plane.get(index, "0") or 0)
    )

    units_s = [
        SECONDS.get(plane.get("DeltaTUnit", "s"))
        for plane in planes
        if "DeltaT" in plane
    ]
    if len(planes) == len(units_s) == count and None not in units_s:
        time_s = np.array([float(plane["DeltaT"]) for plane in planes]) * np.array(
            units_s, dtype=np.float64
        )
        if (
            step_s
            and count > 1
            and not isclose(
                found_s := float(np.diff(time_s).mean()), step_s, rel_tol=0.01
            )
        ):
            notes.append(
                f"OME's TimeIncrement is {step_s:g} s, DeltaT has {found_s:.4g} s:"
                " DeltaT counts"
            )

        return (FrameTimes(time_s, "OME's DeltaT") if rising(time_s) else None), None

    return _even_times(count, step_s, "OME's TimeIncrement", other)


def _even_times(
    count: int, step_s: float, source: str, other: str | None
) -> tuple[FrameTimes | None, str | None]:
    """Return times in even steps, which are not those of `other` than moments."""
    if other is not None and step_s > 0.0:
        return None, f"{source} is between moments, and the {count} frames are {other}"

    return picture_streams.even_times(count, step_s, source), None
