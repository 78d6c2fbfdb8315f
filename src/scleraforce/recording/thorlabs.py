"""Thorlabs' .oct (ThorImage OCT 4, 5): sizes (mm), intensity (dB, float32, depth fastest) as in OCTFileGetRealData."""

from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import Sourced, check_size
from scleraforce.recording.scan import PictureStream, Scan, check_bytes, frame_names, named_faults
from scleraforce.units import to_si

HEADER, INTENSITY = "Header.xml", "Intensity"
HEADER_BYTES = 2**22
KIND = "Thorlabs .oct file"
SAMPLE = np.dtype("<f4")
SAME = 1e-3  # extents that differ by less are rounded


def read_thorlabs(path: Path) -> Scan:
    """Return the frames of a .oct file: B-scans of the processed intensity."""
    with named_faults(path, KIND), ZipFile(path) as archive:
        header = _header(archive)
        entry, name = _intensity(archive, header)
        rows, columns, count = (int(entry.get(f"Size{axis}", "1" if axis == "Y" else "0")) for axis in "ZXY")
        if not (rows and columns):
            raise FrameError(f"{HEADER}: {name} has no {'SizeZ' if columns else 'SizeX'}; store it again in ThorImage")
        if (stated_bytes := entry.get("BytesPerPixel", "4")) != str(SAMPLE.itemsize):
            raise FrameError(f"{HEADER}: {name} has BytesPerPixel = {stated_bytes}; 4 (floats, in dB) are read")
        stated = archive.getinfo(name).file_size
        check_size(rows, columns)
        check_bytes(stated)
        if count < 1 or stated != rows * columns * count * SAMPLE.itemsize:
            raise FrameError(f"{name} has {stated} bytes; the header says {rows} x {columns} x {count} floats")
        return Scan(
            names=frame_names(path, count),
            rows=rows,
            columns=columns,
            pictures=lambda: _pictures(path, name, (columns, rows)),
            depth_pixel_m=_pixel_m(header, entry, "Z", rows),
            lateral_pixel_m=_pixel_m(header, entry, "X", columns),
            notes=tuple(f"{HEADER} states RefractiveIndex = {each.text}" for each in header.iter("RefractiveIndex")),
        ).of_file(path)


def _header(archive: ZipFile) -> ElementTree.Element:
    if archive.getinfo(HEADER).file_size > HEADER_BYTES:
        raise FrameError(f"{HEADER} of more than {HEADER_BYTES} bytes")
    text = archive.read(HEADER)
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise FrameError(f"{HEADER} defines entities, which a scanner does not")
    return ElementTree.fromstring(text)


def _intensity(archive: ZipFile, header: ElementTree.Element) -> tuple[ElementTree.Element, str]:
    names = {name.replace("\\", "/"): name for name in archive.namelist()}
    entries = [(entry, (entry.text or "").strip().replace("\\", "/")) for entry in header.iter("DataFile")]
    found = [(entry, names[inside]) for entry, inside in entries if INTENSITY in inside and inside in names]
    if not found:
        raise FrameError("no processed intensity in it; store it in ThorImage beside the spectra")
    if len(found) > 1:
        listed = " and ".join(name for _, name in found)
        raise FrameError(f"{len(found)} files of intensity, {listed}; export the one that is meant as TIFF")
    return found[0]


def _pixel_m(header: ElementTree.Element, entry: ElementTree.Element, axis: str, count: int) -> Sourced | None:
    of_image, of_file = header.findtext(f".//Image/SizeReal/Size{axis}"), entry.get(f"Range{axis}")
    if of_image and of_file and not np.isclose(float(of_image), float(of_file), rtol=SAME):
        raise FrameError(f"{HEADER}: SizeReal states Size{axis} {of_image} mm, and Range{axis} is {of_file} mm")
    range_mm = float(of_file or "0")
    return Sourced(to_si(range_mm, "mm") / count, f"Thorlabs' Range{axis}") if range_mm > 0.0 else None


def _pictures(path: Path, name: str, shape: tuple[int, int]) -> PictureStream:
    size = shape[0] * shape[1] * SAMPLE.itemsize
    with named_faults(path, KIND), ZipFile(path) as archive, archive.open(name) as file:
        while data := file.read(size):
            yield np.frombuffer(data, dtype=SAMPLE).reshape(shape).T
