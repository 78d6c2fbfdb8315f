"""TIFF, one page or a stack: white or black as zero, palettes, colour, orientation; its scale and times.

Scale and times come from OME-XML, ImageJ's description, the resolution tags or JSON axes in the Software tag.
"""

import json
import lzma
import re
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from math import isclose, isfinite
from mmap import ACCESS_READ, mmap
from pathlib import Path
from struct import unpack
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import as_shown, check_size, inverted, one_grey, unpacked_bytes
from scleraforce.recording.scan import (
    METRES,
    SECONDS,
    PictureStream,
    PixelSize,
    Scan,
    Times,
    check_bytes,
    even_times,
    frame_names,
    named_faults,
    one_size,
    rising,
)

if TYPE_CHECKING:
    import tifffile


def _ome_pixels(xml: str) -> list[dict[str, str]]:
    """Return the attributes of all elements `Pixels`, whatever their name space."""
    return [element.attrib for element in ElementTree.fromstring(xml).iter() if _local(element) == "Pixels"]


def _local(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def _ome_sizes(path: Path, xml: str, notes: list[str]) -> list[PixelSize]:
    """Return the physical sizes of a pixel that OME-XML states; their unit is the micrometre where it names none."""
    found = []
    for stated in _ome_pixels(xml):
        units = {stated.get(f"PhysicalSize{axis}Unit", "µm") for axis in "XY"} - set(METRES)
        notes += [f"{path}: OME's unit {unit!r} is not known: the scale is not either" for unit in sorted(units)]
        found.append(PixelSize("OME", depth_m=_ome_size(stated, "Y"), lateral_m=_ome_size(stated, "X")))
    return found


def _ome_size(stated: dict[str, str], axis: str) -> float | None:
    unit_m = METRES.get(stated.get(f"PhysicalSize{axis}Unit", "µm"))
    size = float(stated.get(f"PhysicalSize{axis}", "nan"))
    return size * unit_m if unit_m and isfinite(size) and size > 0.0 else None


def _ome_times(path: Path, xml: str, count: int, notes: list[str]) -> Times | None:
    """Return the times of planes, else even ones by the increment of time; None where neither is stated."""
    stated = next(iter(_ome_pixels(xml)), {})
    step_s = float(stated.get("TimeIncrement", "0")) * SECONDS.get(stated.get("TimeIncrementUnit", "s"), 0.0)
    planes = [element.attrib for element in ElementTree.fromstring(xml).iter() if _local(element) == "Plane"]
    if len(planes) == count and all("DeltaT" in plane for plane in planes):
        units_s = [SECONDS.get(plane.get("DeltaTUnit", "s")) for plane in planes]
        if None not in units_s:
            time_s = np.array([float(plane["DeltaT"]) for plane in planes]) * np.array(units_s, dtype=np.float64)
            if step_s and count > 1 and not isclose(found_s := float(np.diff(time_s).mean()), step_s, rel_tol=0.01):
                notes.append(f"{path}: OME's TimeIncrement is {step_s:g} s, DeltaT has {found_s:.4g} s: DeltaT counts")
            return Times(time_s, "OME's DeltaT") if rising(time_s) else None
    return even_times(count, step_s, "OME's TimeIncrement")


WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE = range(4)  # PhotometricInterpretation
DEFLATE, PACKBITS, LZMA = (8, 32946), 32773, 34925  # Compression
PLANES_APART = 2  # PlanarConfiguration
ORIENTATIONS = range(1, 9)
NO_UNIT, INCH, CENTIMETRE = 1, 2, 3  # ResolutionUnit
UNIT_NAMES = {NO_UNIT: "none", INCH: "inch", CENTIMETRE: "cm"}
NO_UNITS = ("pixel", "pixels", "px")  # what ImageJ calls the unit of an image without a scale
FRAME_AXES = "TZQIRPC"  # that count pages: time, depth of a stack, any
PRINTED = (25.4e-3, 1e-2)  # units in which programs state the resolution of a screen or a printer, asked or not ...
PRINTED_M = 20e-6  # ... which are never finer than this: 1,270 dots per inch


def read_tiff(path: Path, data: bytes | None = None) -> Scan:
    """Return a TIFF's frames: its pages, or the one long axis beside rows and columns.

    `data` is the file's content if it has been read.
    """
    with _opened(path, data) as file:
        with _held(path, data) as held:
            for entry in file.pages:
                _check_page(path, entry.aspage(), held)
            first = file.series[0].keyframe
            full_size = [each for each in file.series if not _is_copy(each.keyframe, first)]
            count, rows, columns = _sizes(path, full_size)
            check_bytes(path, sum(each.nbytes for each in file.series))
            _check_pages(path, file, count, held)
        pages = _frame_pages(file)
        orientation = _orientation(path, pages)
        sizes, notes = _pixel_sizes(path, file, pages, rows, columns)
        times = _times(path, file, count, notes)
        depth, lateral, scale_fault = one_size(path, sizes)
        kinds = {page.photometric for page in pages}
        if len(pages) < len(file.pages) or any(page.subifds for page in pages):
            notes.append(f"{path}: smaller copies of the frames in the file were not read")
        if WHITE_IS_ZERO in kinds:
            notes.append(f"{path}: PhotometricInterpretation is WhiteIsZero: dark and bright were exchanged")
        if kinds & {RGB, PALETTE}:
            notes.append(f"{path}: colour became grey")
        if orientation != ORIENTATIONS[0]:
            notes.append(f"{path}: Orientation {orientation}: the frames were turned as it states")
        scan = Scan(
            names=frame_names(path, count),
            rows=rows,
            columns=columns,
            pictures=lambda: _pictures(path, data, (count, rows, columns)),
            bits=8 if file.series[0].dtype == np.uint8 else None,
            depth_pixel_m=depth,
            lateral_pixel_m=lateral,
            times=times,
            notes=tuple(notes),
            scale_fault=scale_fault,
        )
    return scan if orientation == ORIENTATIONS[0] else _shown(scan, orientation)


def _shown(scan: Scan, orientation: int) -> Scan:
    """Return a scan turned by its Orientation; from 5 on rows and columns change places, with their sizes."""
    shown = scan.turned() if orientation in ORIENTATIONS[4:] else scan
    return replace(shown, pictures=lambda: (as_shown(picture, orientation) for picture in scan.pictures()))


@contextmanager
def _opened(path: Path, data: bytes | None) -> "Iterator[tifffile.TiffFile]":
    import tifffile  # here, so that reading PNG needs OpenCV only

    tifffile.logger().setLevel("CRITICAL")  # we report faults ourselves, once
    file = path if data is None else BytesIO(data)
    with named_faults(path, "TIFF"), tifffile.TiffFile(file, _multifile=False) as opened:
        yield opened


@contextmanager
def _held(path: Path, data: bytes | None) -> Iterator[bytes | mmap]:
    if data is not None:
        yield data
        return
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as held:
        yield held


def _check_page(path: Path, page: "tifffile.TiffPage", data: bytes | mmap) -> None:
    """Check the stated size of a page, and that its packed data are not larger."""
    if page.photometric not in (WHITE_IS_ZERO, BLACK_IS_ZERO, RGB, PALETTE):
        kind = getattr(page.photometric, "name", page.photometric)
        raise FrameError(f"{path}: a TIFF of kind {kind}; save it as grey (black is zero) or RGB")
    check_size(path, page.imagelength, page.imagewidth, page.samplesperpixel)
    if page.photometric != RGB and page.samplesperpixel > 1:
        kind = getattr(page.photometric, "name", page.photometric)
        found = f"SamplesPerPixel {page.samplesperpixel}, PhotometricInterpretation {kind}"
        raise FrameError(f"{path}: {found}: several channels; save the one with the frames")
    _check_compression(path, page)
    check_size(path, max(2, page.tilelength), max(2, page.tilewidth))
    if page.imagedepth != 1 or page.bitspersample > 64:
        raise FrameError(f"{path}: a TIFF of {page.imagedepth} layers of {page.bitspersample} bits; give one frame")
    largest = int(np.prod(page.chunks)) * 8
    for at, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        if _unpacks_to_more(page.compression, data[at : at + count], largest):
            raise FrameError(f"{path}: damaged: more is packed in it than the {page.shape} pixels that it states")


def _check_compression(path: Path, page: "tifffile.TiffPage") -> None:
    from tifffile import TIFF

    for kinds, kind, option in (
        (TIFF.DECOMPRESSORS, page.compression, "compression"),
        (TIFF.UNPREDICTORS, page.predictor, "predictor"),
    ):
        try:
            kinds[kind]
        except KeyError as fault:
            name = getattr(kind, "name", kind)
            word = "compressed as" if option == "compression" else "its Predictor is"
            raise FrameError(
                f"{path}: {word} {name}; save it without {option}, or as ZIP (deflate), or install what reads it: "
                "pip install imagecodecs"
            ) from fault


def _unpacks_to_more(compression: int, packed: bytes, largest: int) -> bool:
    """Return whether a strip or tile gives more bytes than its pixels have at most."""
    if compression in DEFLATE:
        return len(zlib.decompressobj().decompress(packed, largest + 1)) > largest
    if compression == LZMA:
        return len(lzma.LZMADecompressor().decompress(packed, largest + 1)) > largest
    return compression == PACKBITS and unpacked_bytes(packed, largest) > largest


def _frame_pages(file: "tifffile.TiffFile") -> "list[tifffile.TiffPage]":
    pages = [entry.aspage() for entry in file.pages]
    return [page for page in pages if not _is_copy(page, pages[0])]


def _is_copy(page: "tifffile.TiffPage", first: "tifffile.TiffPage") -> bool:
    """Return whether a page is a smaller copy of the first."""
    return bool(page.is_reduced) and page.shape != first.shape


def _sizes(path: Path, several: "Sequence[tifffile.TiffPageSeries]") -> tuple[int, int, int]:
    """Return the number of frames, rows and columns; pages that were written one by one are a series each."""
    if len(several) > 1:
        sizes = {(*_sizes(path, [series]), series.dtype) for series in several}
        count, rows, columns, _ = next(iter(sizes))
        if len(sizes) > 1 or count > 1:
            found = " and ".join(f"{series.shape} {series.dtype}" for series in several[:2])
            raise FrameError(f"{path}: {len(several)} series of images ({found}); save the one with the frames alone")
        return len(several), rows, columns
    series = several[0]
    length = dict(zip(series.axes, series.shape, strict=True))
    others = [axis for axis, size in length.items() if axis not in "YXS" and size > 1]
    if not {"Y", "X"} <= set(length) or len(others) > 1 or not set(others) <= set(FRAME_AXES):
        found = ", ".join(f"{axis} {size}" for axis, size in length.items())
        raise FrameError(f"{path}: axes {found}; give a stack of frames with one axis beside rows (Y) and columns (X)")
    return length[others[0]] if others else 1, length["Y"], length["X"]


def _check_pages(path: Path, file: "tifffile.TiffFile", count: int, data: bytes | mmap) -> None:
    """Check that all pages are in the file: tifffile leaves out pages that it cannot reach."""
    pages = [entry.aspage() for entry in file.pages]
    last, form = pages[-1], file.tiff
    tags = last.offset + form.tagnosize
    (number,) = unpack(form.tagnoformat, data[last.offset : tags])
    after = tags + number * form.tagsize
    (following,) = unpack(form.offsetformat, data[after : after + form.offsetsize])
    ends = [at + size for page in pages for at, size in zip(page.dataoffsets, page.databytecounts, strict=True)]
    if following != 0 or max(ends) > len(data):
        raise FrameError(f"{path}: damaged: its end is missing, or pages that it states")
    stated = int((file.imagej_metadata or {}).get("images", count))
    if stated != count:
        raise FrameError(f"{path}: damaged: ImageJ's description states images={stated}, the file has {count}")
    there = len(_frame_pages(file))
    if None in (page for series in file.series for page in series.pages) or there not in (1, count):
        kind = "OME-XML" if file.ome_metadata else "its description"
        raise FrameError(
            f"{path}: {kind} states {count} frames, the file has {there} pages; save all frames in one file"
        )


def _orientation(path: Path, pages: "Sequence[tifffile.TiffPage]") -> int:
    found = [int(page.tags.valueof("Orientation", default=0)) or ORIENTATIONS[0] for page in pages]
    other = next((each for each in found if each != found[0]), found[0])
    if other != found[0]:
        raise FrameError(f"{path}: Orientation {found[0]} and {other} in one file; save all frames with one")
    if other not in ORIENTATIONS:
        raise FrameError(f"{path}: Orientation {other}; TIFF has 1 to 8")
    return other


def _pictures(path: Path, data: bytes | None, shape: tuple[int, int, int]) -> PictureStream:
    """Yield the frames as they are stored; larger is brighter."""
    with _opened(path, data) as file:
        pages = _frame_pages(file)
        if len(pages) == shape[0]:
            for page in pages:
                yield one_grey(_bright(path, page, np.asarray(page.asarray())), path)
        else:  # ImageJ writes large stacks as one page, followed by the others
            for picture in np.asarray(file.asarray(series=0)).reshape(*shape, -1):
                plain = picture if picture.shape[-1] > 1 else picture[..., 0]
                yield one_grey(_bright(path, pages[0], plain), path)


def _bright(path: Path, page: "tifffile.TiffPage", pixels: NDArray[Any]) -> NDArray[Any]:
    """Return pixels with larger values brighter, colours last."""
    if page.photometric == PALETTE and page.colormap is not None:
        # Values of 16 bits; some programs write 8 bits all the same.
        colours = np.asarray(page.colormap)
        colours = (colours if colours.max() < 256 else colours >> 8).astype(np.uint8)
        return np.moveaxis(colours[:, pixels], 0, -1)
    if page.planarconfig == PLANES_APART and pixels.ndim == 3:
        pixels = np.moveaxis(pixels, 0, -1)
    return inverted(pixels, page.bitspersample, path) if page.photometric == WHITE_IS_ZERO else pixels


def _pixel_sizes(
    path: Path, file: "tifffile.TiffFile", pages: "Sequence[tifffile.TiffPage]", rows: int, columns: int
) -> tuple[list[PixelSize], list[str]]:
    """Return the sizes of a pixel that the fields of a file state, in the order of their precedence, and notes."""
    notes: list[str] = []
    sizes = _ome_sizes(path, file.ome_metadata, notes) if file.ome_metadata else []
    sizes += [_resolution(path, file, page, notes) for page in pages]
    sizes.append(_json_size(pages[0], rows, columns))
    return sizes, list(dict.fromkeys(notes))


def _resolution(path: Path, file: "tifffile.TiffFile", page: "tifffile.TiffPage", notes: list[str]) -> PixelSize:
    """Return the size that X and YResolution state, in ImageJ's unit or in ResolutionUnit.

    ImageJ itself reads the two tags in the unit of its description and ignores ResolutionUnit, but for `um` beside
    centimetres, which are per centimetre (ij/io/FileOpener.java, decodeDescriptionString).
    """
    kind = int(page.resolutionunit)
    tag_m = {INCH: 25.4e-3, CENTIMETRE: 1e-2}.get(kind)
    names = [str((file.imagej_metadata or {}).get(name, "")).strip() for name in ("yunit", "unit")]
    units = [names[0] or names[1], names[1]]
    source, units_m = "ImageJ's unit", [_metres(unit) for unit in units]
    if names[1] and names[1] not in NO_UNITS and units_m[1] is None:
        notes.append(f"{path}: ImageJ's unit {names[1]!r} is not known: the scale is not either")
    if not names[1]:
        source, units_m = "XResolution, YResolution", [tag_m, tag_m]
        if tag_m and "ResolutionUnit" not in page.tags and "XResolution" in page.tags:
            notes.append(f"{path}: no ResolutionUnit: by the standard of TIFF it is the inch")
    elif "ResolutionUnit" in page.tags and tag_m and units_m != [tag_m, tag_m]:
        if kind == CENTIMETRE and units == ["um", "um"]:
            units_m = [tag_m, tag_m]
        taken = "ResolutionUnit" if units_m == [tag_m, tag_m] else "ImageJ's unit"
        notes.append(
            f"{path}: ImageJ's unit is {units[1]}, ResolutionUnit {UNIT_NAMES[kind]}: {taken} counts, as in ImageJ"
        )
    depth_m, lateral_m = (
        _size(page, tag, unit_m) for tag, unit_m in zip(("YResolution", "XResolution"), units_m, strict=True)
    )
    printed = units_m[0] in PRINTED and depth_m == lateral_m and (depth_m or 0.0) >= PRINTED_M
    return PixelSize(source, depth_m=None if printed else depth_m, lateral_m=None if printed else lateral_m)


def _metres(unit: str) -> float | None:
    r"""Return a unit in m, as programs write it: case and Java's escapes do not matter.

    >>> _metres("\\u00B5m"), _metres("Micron"), _metres("pixel")
    (1e-06, 1e-06, None)
    """
    plain = re.sub(r"\\u([0-9a-fA-F]{4})", lambda code: chr(int(code[1], 16)), unit)
    return METRES.get(plain, METRES.get(plain.lower()))


def _size(page: "tifffile.TiffPage", name: str, unit_m: float | None) -> float | None:
    """Return the size of a pixel in m, where the tag has a number of them for each unit."""
    count, units = page.tags.valueof(name, default=(0, 0))
    return units / count * unit_m if unit_m and count > 0 and units > 0 else None


def _json_size(page: "tifffile.TiffPage", rows: int, columns: int) -> PixelSize:
    """Return the steps of axes that a JSON text in the Software tag lists value by value, as myOCT writes them."""
    source = "JSON axes in the Software tag"
    tag = page.tags.get("Software")
    try:
        axes = json.loads(tag.value)["metadata"] if tag is not None else {}
        return PixelSize(source, depth_m=_step_m(axes.get("z"), rows), lateral_m=_step_m(axes.get("x"), columns))
    except (ValueError, TypeError, KeyError, AttributeError):
        return PixelSize(source, depth_m=None, lateral_m=None)


def _step_m(axis: Any, size: int) -> float | None:
    """Return the even step of an axis {"values": [...], "units": "mm"} of `size` values, else None."""
    values = np.asarray(axis["values"], dtype=np.float64) if axis else np.zeros(0)
    unit_m = METRES.get(str(axis.get("units", ""))) if axis else None
    if values.shape != (size,) or unit_m is None:
        return None
    steps: NDArray[np.float64] = np.diff(values)
    step = float(steps.mean())
    return abs(step) * unit_m if step and np.allclose(steps, step, rtol=0.01) else None


def _times(path: Path, file: "tifffile.TiffFile", count: int, notes: list[str]) -> Times | None:
    """Return times of frames from ImageJ's frame interval, or OME's planes or increment."""
    if file.ome_metadata:
        return _ome_times(path, file.ome_metadata, count, notes)
    interval = (file.imagej_metadata or {}).get("finterval")
    unit_s = SECONDS.get(str((file.imagej_metadata or {}).get("tunit", "sec")))
    if not isinstance(interval, int | float) or unit_s is None:
        return None
    return even_times(count, interval * unit_s, "ImageJ's finterval")
