"""Values of DICOM pixels: which bits they are, and whether larger ones are brighter."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError

if TYPE_CHECKING:
    import pydicom

GREY_KINDS = ("MONOCHROME1", "MONOCHROME2")
OVERLAYS = range(0x6000, 0x6020, 2)  # groups
# What turns stored values into grey levels in another way than along a straight line.
TABLES = ("ModalityLUTSequence", "VOILUTSequence", "PresentationLUTSequence")


def grey_kind(dataset: "pydicom.Dataset") -> str:
    """Return the photometric interpretation of a data set, "" where it has none."""
    return str(dataset.get("PhotometricInterpretation", "")).strip()


def cell(dataset: "pydicom.Dataset") -> tuple[int, int, int]:
    """Return BitsAllocated, BitsStored and HighBit."""
    stored = int(dataset.BitsStored)
    high = dataset.get("HighBit", None)
    return int(dataset.BitsAllocated), stored, stored - 1 if high is None else int(high)


def places(dataset: "pydicom.Dataset", sequence: str) -> "Iterator[tuple[str, pydicom.Dataset]]":
    """Yield the data set and the items of a sequence in its functional groups, each with its place in words."""
    yield "", dataset
    for groups in ("SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"):
        for nth, group in enumerate(dataset.get(groups, None) or []):
            place = f" of frame {nth + 1}" if groups.startswith("PerFrame") else f" of {groups}"
            for item in group.get(sequence, None) or []:
                yield place, item


def dark_is_large(path: Path, dataset: "pydicom.Dataset") -> tuple[bool, list[str]]:
    """Return whether larger stored values are darker, and notes on what becomes of the values.

    A negative RescaleSlope turns the values, MONOCHROME1 or the PresentationLUTShape INVERSE their display; one of each
    cancel. The two of the display are one inversion in PS3.3 C.8.11.3 (DX) and two in other readers, so both together
    are refused.

    Raises:
        FrameError: fields contradict each other, or a table turns values into grey levels.
    """
    kind, shape = grey_kind(dataset), str(dataset.get("PresentationLUTShape", None) or "IDENTITY")
    for place, item in places(dataset, "FrameVOILUTSequence"):
        table = next((name for name in TABLES if item.get(name, None)), None)
        if table:
            raise FrameError(f"{path}: {table}{place}: a table of grey levels, which is not read; export it applied")
    if shape not in ("IDENTITY", "INVERSE"):
        raise FrameError(f"{path}: PresentationLUTShape: {shape}; IDENTITY or INVERSE")
    if kind == "MONOCHROME1" and shape == "INVERSE":
        raise FrameError(
            f"{path}: PhotometricInterpretation MONOCHROME1 and PresentationLUTShape INVERSE: programs differ in "
            "whether these are one inversion or two; export it as MONOCHROME2"
        )
    slope = _slope(path, dataset)
    notes = [f"{path}: colour became grey"] if kind not in GREY_KINDS else []
    turns = [f"RescaleSlope {slope:g}"] if slope < 0.0 else []
    turns += ["MONOCHROME1"] if kind == "MONOCHROME1" else []
    turns += ["PresentationLUTShape INVERSE"] if shape == "INVERSE" else []
    if turns and kind not in GREY_KINDS:
        raise FrameError(f"{path}: {turns[0]} and PhotometricInterpretation {kind}; export it as MONOCHROME2")
    if len(turns) == 1:
        notes.append(f"{path}: {turns[0]}: dark and bright were exchanged")
    elif turns:
        notes.append(f"{path}: {turns[0]} and {turns[1]} cancel: pixels stay as stored")
    return len(turns) == 1, notes + _cell_notes(path, dataset)


def _cell_notes(path: Path, dataset: "pydicom.Dataset") -> list[str]:
    """Return notes on bits and values that are not those of the picture."""
    _, stored, high = cell(dataset)
    padding = dataset.get("PixelPaddingValue", None)
    notes = [f"{path}: HighBit is {high}, BitsStored {stored}: pixels were shifted"] if high != stored - 1 else []
    if overlays := _overlay_bits(dataset):
        bits = ", ".join(map(str, overlays))
        notes.append(f"{path}: OverlayBitPosition {bits}: overlays in the pixels' bits were left out")
    if padding is not None:
        notes.append(f"{path}: PixelPaddingValue {padding}: such pixels become as dark as the darkest of their frame")
    return notes


def _slope(path: Path, dataset: "pydicom.Dataset") -> float:
    """Return the RescaleSlope of all frames, 1 where none is stated.

    Raises:
        FrameError: there are several, with their RescaleIntercept, or it is 0.
    """
    found = [
        (place, (float(item.RescaleSlope), float(item.get("RescaleIntercept", None) or 0.0)))
        for place, item in places(dataset, "PixelValueTransformationSequence")
        if item.get("RescaleSlope", None) is not None
    ]
    if not found:
        return 1.0
    first, scale = found[0]
    for place, other in found:
        if other != scale:
            raise FrameError(
                f"{path}: RescaleSlope and RescaleIntercept {scale[0]:g}, {scale[1]:g}{first} and {other[0]:g}, "
                f"{other[1]:g}{place}; export frames of one scale of grey"
            )
    if not np.isfinite(scale[0]) or scale[0] == 0.0:
        raise FrameError(f"{path}: RescaleSlope: {scale[0]:g}; it is a number other than 0")
    return scale[0]


def _overlay_bits(dataset: "pydicom.Dataset") -> list[int]:
    """Return the bits beside BitsStored in which overlays are stored, as older files have them."""
    _, stored, high = cell(dataset)
    found: list[int] = []
    for group in OVERLAYS:
        position, data = dataset.get((group, 0x0102), None), dataset.get((group, 0x3000), None)
        bit = None if position is None or data is not None else position.value
        if bit is not None and not high - stored < int(bit) <= high:
            found.append(int(bit))
    return found


def stored_values(path: Path, dataset: "pydicom.Dataset", cells: NDArray[Any]) -> NDArray[Any]:
    """Return the values that BitsStored bits up to HighBit hold (PS3.5 8.1.1).

    Raises:
        FrameError: pixels use other bits as well, and no overlay is declared in them.
    """
    allocated, stored, high = cell(dataset)
    if stored == allocated or cells.dtype.itemsize * 8 != allocated:  # codecs give smaller cells where these suffice
        return cells
    cells = np.ascontiguousarray(cells, cells.dtype.newbyteorder("="))
    shift = high + 1 - stored
    values = (cells << (allocated - high - 1)) >> (allocated - stored)  # keeps the sign of signed ones
    above, below = (1 << allocated) - (1 << (high + 1)), (1 << shift) - 1
    drawn = sum(1 << bit for bit in _overlay_bits(dataset))
    plain = cells.view(f"u{cells.dtype.itemsize}")
    stray = plain & plain.dtype.type((above | below) & ~drawn)
    if cells.dtype.kind == "i":
        stray[(values < 0) & (stray == (above & ~drawn))] = 0
    if stray.any():
        found = f"a pixel is {int(plain[stray != 0][0]):#x}"
        raise FrameError(
            f"{path}: BitsStored is {stored}, HighBit {high}, but {found}, which has other bits; export it anew"
        )
    return values


def without_padding(dataset: "pydicom.Dataset", values: NDArray[Any], bright: NDArray[Any]) -> NDArray[Any]:
    """Return a picture whose pixels of PixelPaddingValue, up to PixelPaddingRangeLimit, are as dark as its darkest."""
    ends = [dataset.get(name, None) for name in ("PixelPaddingValue", "PixelPaddingRangeLimit")]
    if ends[0] is None:
        return bright
    stored = int(dataset.BitsStored)
    first, last = (int(ends[0] if end is None else end) for end in ends)
    if values.dtype.kind == "i":  # some programs write the negative ones without their sign
        first, last = (end - (1 << stored) if end >= 1 << (stored - 1) else end for end in (first, last))
    padded = (values >= min(first, last)) & (values <= max(first, last))
    if not padded.any() or padded.all():
        return bright
    darkest = bright[~padded].min()
    return np.where(padded, darkest if values.dtype.kind == "i" else np.minimum(bright, darkest), bright)
