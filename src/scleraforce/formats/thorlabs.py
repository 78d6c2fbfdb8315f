"""Thorlabs' .oct (ThorImage OCT 4 and 5): a zip archive with Header.xml and the intensity in dB, float32.

The layout is that of Thorlabs' own MATLAB functions (OCTFileGetRealData): depth runs fastest, then the A-scan, then the
B-scan; sizes and ranges (mm) are attributes of the file's entry in the header. Depth is optical unless the program was
told a refractive index.
"""

from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np

from scleraforce.errors import FrameError
from scleraforce.formats.scan import PictureStream, Scan, check_bytes, frame_names
from scleraforce.recording.faults import named_faults
from scleraforce.recording.pixels import check_size
from scleraforce.recording.scaled_frame import Sourced
from scleraforce.units import to_si

__all__ = ["read_thorlabs"]

HEADER, INTENSITY = "Header.xml", "Intensity"
HEADER_BYTES = 2**22
KIND = "Thorlabs .oct file"
SAMPLE = np.dtype("<f4")


def read_thorlabs(path: Path) -> Scan:
    """Return the frames of a .oct file: B-scans of the processed intensity.

    Raises:
        FrameError: it has none, or cannot be read.
    """
    with named_faults(path, KIND), ZipFile(path) as archive:
        entry, name = _intensity(path, archive)
        rows, columns, count = (int(entry.get(f"Size{axis}", "1")) for axis in "ZXY")
        stated = archive.getinfo(name).file_size
        depth, lateral = _pixel_m(entry, "RangeZ", rows), _pixel_m(entry, "RangeX", columns)
    check_size(path, rows, columns)
    check_bytes(path, stated)
    if count < 1 or stated != rows * columns * count * SAMPLE.itemsize:
        raise FrameError(f"{path}: {name} has {stated} bytes; the header says {rows} x {columns} x {count} floats")
    return Scan(
        names=frame_names(path, count),
        rows=rows,
        columns=columns,
        pictures=lambda: _pictures(path, name, (columns, rows)),
        depth_pixel_m=depth,
        lateral_pixel_m=lateral,
    )


def _intensity(path: Path, archive: ZipFile) -> tuple[ElementTree.Element, str]:
    """Return the header's entry of the intensity, and the name of its file in the archive."""
    if archive.getinfo(HEADER).file_size > HEADER_BYTES:
        raise FrameError(f"{path}: {HEADER} of more than {HEADER_BYTES} bytes")
    text = archive.read(HEADER)
    if b"<!DOCTYPE" in text or b"<!ENTITY" in text:
        raise FrameError(f"{path}: {HEADER} defines entities, which a scanner does not")
    names = {name.replace("\\", "/"): name for name in archive.namelist()}
    for entry in ElementTree.fromstring(text).iter("DataFile"):
        inside = (entry.text or "").strip().replace("\\", "/")
        if INTENSITY in inside and inside in names:
            return entry, names[inside]
    raise FrameError(f"{path}: no processed intensity in it; store it in ThorImage beside the spectra")


def _pixel_m(entry: ElementTree.Element, attribute: str, count: int) -> Sourced | None:
    range_mm = float(entry.get(attribute, "0"))
    return Sourced(to_si(range_mm, "mm") / count, f"Thorlabs' {attribute}") if range_mm > 0.0 and count > 0 else None


def _pictures(path: Path, name: str, shape: tuple[int, int]) -> PictureStream:
    size = shape[0] * shape[1] * SAMPLE.itemsize
    with named_faults(path, KIND), ZipFile(path) as archive, archive.open(name) as file:
        while data := file.read(size):
            yield np.frombuffer(data, dtype=SAMPLE).reshape(shape).T
