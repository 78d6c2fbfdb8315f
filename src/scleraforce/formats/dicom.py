"""DICOM, one image or many frames: Ophthalmic Tomography and what older anterior-segment scanners write."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scleraforce.errors import FrameError
from scleraforce.formats.greys import one_grey
from scleraforce.formats.scan import PictureStream, Scan, Times, check_bytes, even_times, frame_names, rising
from scleraforce.recording.dicom_image import (
    DEFLATED,
    bright,
    check_image,
    damage_named,
    grey_kind,
    pixel_spacing,
    turned_round,
)
from scleraforce.recording.scaled_frame import Sourced
from scleraforce.units import from_si, to_si

if TYPE_CHECKING:
    import pydicom

__all__ = ["read_dicom_scan"]

PIXEL_SPACING = "DICOM's pixel spacing"
HEAD_BYTES = 1024  # in which the transfer syntax stands
FRAME_TIMES = ("FrameReferenceDateTime", "FrameAcquisitionDateTime")  # when it was taken comes before when it began


def read_dicom_scan(path: Path) -> Scan:
    """Return a DICOM file's frames.

    Raises:
        FrameError: naming the file, what was found and what is allowed.
    """
    import pydicom

    with damage_named(path):
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        if DEFLATED in head:
            raise FrameError(f"{path}: a deflated DICOM file, whose size is not known before; save it uncompressed")
        dataset = pydicom.dcmread(path)
        count = int(dataset.get("NumberOfFrames", None) or 1)
        check_image(path, dataset, count)
        rows, columns = int(dataset.Rows), int(dataset.Columns)
        check_bytes(path, count * rows * columns * (int(dataset.BitsAllocated) // 8))
        _check_codec(path, dataset)
        _check_one_scale(path, dataset)
        depth_m, lateral_m = pixel_spacing(dataset)
        scan = Scan(
            names=frame_names(path, count),
            rows=rows,
            columns=columns,
            pictures=lambda: _pictures(path),
            bits=_bits(dataset),
            depth_pixel_m=None if depth_m is None else Sourced(depth_m, PIXEL_SPACING),
            lateral_pixel_m=None if lateral_m is None else Sourced(lateral_m, PIXEL_SPACING),
            times=_times(dataset, count),
            notes=_notes(path, dataset),
        )
        return scan.turned() if turned_round(dataset) else scan


def _notes(path: Path, dataset: "pydicom.Dataset") -> tuple[str, ...]:
    notes = []
    if grey_kind(dataset) == "MONOCHROME1":
        notes.append(f"{path}: MONOCHROME1: dark and bright were exchanged")
    if turned_round(dataset):
        notes.append(f"{path}: this scanner writes A-scans along the rows: rows and columns were exchanged")
    return tuple(notes)


def _pictures(path: Path) -> PictureStream:
    import pydicom
    from pydicom.pixels.utils import iter_pixels

    with damage_named(path):
        dataset = pydicom.dcmread(path)
        for pixels in iter_pixels(dataset):
            yield one_grey(bright(path, dataset, np.asarray(pixels)), path)


def _check_codec(path: Path, dataset: "pydicom.Dataset") -> None:
    """Check that the compression of the pixels can be undone with the packages that are installed."""
    from pydicom.pixels.decoders.base import get_decoder

    syntax = dataset.file_meta.TransferSyntaxUID
    if not syntax.is_compressed:
        return
    try:
        there = get_decoder(syntax).is_available
    except NotImplementedError as fault:
        raise FrameError(
            f"{path}: compressed as {syntax.name}, which no package reads; save it uncompressed"
        ) from fault
    if not there:
        raise FrameError(
            f"{path}: compressed as {syntax.name}; reading it takes a package: pip install 'scleraforce[formats]'"
        )


def _check_one_scale(path: Path, dataset: "pydicom.Dataset") -> None:
    """Check that frames which state their scale one by one state the same one: a recording has no other."""
    groups = dataset.get("PerFrameFunctionalGroupsSequence", None) or []
    measures = [measure for group in groups for measure in group.get("PixelMeasuresSequence", None) or []]
    scales = {(depth_m, lateral_m) for depth_m, lateral_m in map(pixel_spacing, measures) if depth_m and lateral_m}
    if len(scales) > 1:
        ends = [f"{from_si(depth_m, 'mm'):g} x {from_si(lateral_m, 'mm'):g} mm" for depth_m, lateral_m in
                (min(scales), max(scales))]  # fmt: skip
        raise FrameError(f"{path}: pixels of {' in one frame and '.join(ends)} in another; export them apart")


def _bits(dataset: "pydicom.Dataset") -> int | None:
    """Return the bits that grey pixels use; a palette or colour gives 8 or 16, whatever was stored."""
    stored = int(dataset.get("BitsStored", 0))
    if not grey_kind(dataset).startswith("MONOCHROME"):
        return 8 if grey_kind(dataset) != "PALETTE COLOR" and stored == 8 else None
    return stored if 1 <= stored <= 16 and not int(dataset.get("PixelRepresentation", 0)) else None


def _times(dataset: "pydicom.Dataset", count: int) -> Times | None:
    """Return the frames' times: of each, by their steps, or of the one image; None where they are not stated."""
    for name in FRAME_TIMES:
        stated = [_frame_time(group, name) for group in dataset.get("PerFrameFunctionalGroupsSequence", None) or []]
        time_s = np.array([np.nan if moment is None else moment for moment in stated], dtype=np.float64)
        if len(stated) == count and rising(time_s):
            return Times(time_s, f"DICOM's {name}")
    steps_ms = np.asarray(dataset.get("FrameTimeVector", None) or [], dtype=np.float64)
    if len(steps_ms) == count and rising(time_s := np.cumsum(to_si(steps_ms, "ms"))):
        return Times(time_s - time_s[0], "DICOM's FrameTimeVector")
    step_ms = float(dataset.get("FrameTime", None) or 0.0)
    if count > 1 and (times := even_times(count, to_si(step_ms, "ms"), "DICOM's FrameTime")):
        return times
    moment = _seconds(dataset.get("AcquisitionDateTime", None))
    return Times(np.array([moment]), "DICOM's AcquisitionDateTime") if count == 1 and moment is not None else None


def _frame_time(group: "pydicom.Dataset", name: str) -> float | None:
    content: Any = group.get("FrameContentSequence", None)
    return _seconds(content[0].get(name, None)) if content else None


def _seconds(stated: Any) -> float | None:
    """Return seconds since 1970 of a DICOM date and time; where it names no zone, of UTC."""
    from pydicom.valuerep import DT

    try:
        moment = DT(stated) if stated else None
    except ValueError:
        return None
    if not isinstance(moment, datetime):
        return None
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
