"""MetaImage (MHA, MHD), by the specification of MetaIO; its spacing is in mm.

Axes are named in the order of the file, the fastest first.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.formats.axes import array_scan
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
from scleraforce.recording.scan import METRES, Scan, check_bytes

HEADER_BYTES = 2**26
TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip
NOT_READ = ("HeaderSizePerSlice", "HeaderSizesPerDataFile")
CONVERT = "convert it to one .mha file (3D Slicer, SimpleITK)"


def read_metaimage(path: Path, axes: Axes) -> Scan:
    """Return a MetaImage's frames; its spacing is in mm. Sequences of PLUS have times, and frames that are invalid.

    Raises:
        UnansweredError: axes are open.
        FrameError: it cannot be read, or contradicts itself.
    """
    with named_faults(path, "MetaImage"):
        fields, start = _header(path)
        notes = _check(path, fields)
        array, order_notes = _pixels(path, fields, start)
        steps, spacing_notes = _steps(path, fields)
        check_orientation(path, fields.get("ultrasoundimageorientation", ""), axes)
        scan = array_scan(path, array, axes, steps)
        scan = replace(scan, notes=(*scan.notes, *notes, *order_notes, *spacing_notes))
        return plus_sequence(path, scan, fields)


def _header(path: Path) -> tuple[dict[str, str], int]:
    """Return the header's fields, by their names in small letters, and where it ends.

    Raises:
        FrameError: it has no end, or one field twice.
    """
    fields: dict[str, str] = {}
    with path.open("rb") as file:
        while file.tell() < HEADER_BYTES and (line := file.readline(HEADER_BYTES)):
            name, _, value = (part.strip() for part in line.decode("latin-1").partition("="))
            if not name or name.startswith("#"):
                continue
            if fields.setdefault(name.lower(), value) != value:
                raise FrameError(f"{path}: {name} is stated twice: {fields[name.lower()]!r} and {value!r}; correct it")
            if name.lower() == "elementdatafile":
                return fields, file.tell()
    raise FrameError(f"{path}: damaged: its header has no ElementDataFile")


def _check(path: Path, fields: dict[str, str]) -> list[str]:
    """Refuse by name what is not read.

    Raises:
        FrameError: the file uses it.
    """
    if (kind := fields.get("objecttype", "Image")).lower() != "image":
        raise FrameError(f"{path}: ObjectType = {kind}; give one of ObjectType = Image")
    for field in NOT_READ:
        if field.lower() in fields:
            raise FrameError(f"{path}: {field} = {fields[field.lower()]}: not read; {CONVERT}")
    if int(channels := fields.get("elementnumberofchannels", "1")) != 1:
        raise FrameError(f"{path}: ElementNumberOfChannels = {channels}; give grey frames, of one channel")
    if missing := [field for field in ("DimSize", "ElementType") if field.lower() not in fields]:
        raise FrameError(f"{path}: damaged: its header has no {missing[0]}")
    sizes, count = fields["dimsize"].split(), fields.get("ndims", "")
    if count and int(count) != len(sizes):
        raise FrameError(f"{path}: NDims = {count}, and DimSize has {len(sizes)} numbers; correct one of them")
    for field in ("TransformMatrix", "Orientation", "Rotation"):
        values = np.array(fields.get(field.lower(), "").split(), dtype=np.float64)
        side = len(sizes)
        if values.size == side**2 and not np.allclose(
            np.linalg.norm(values.reshape(side, side), axis=1), 1.0, atol=SAME
        ):
            lengths = listed(np.linalg.norm(values.reshape(side, side), axis=1).tolist())
            raise FrameError(
                f"{path}: {field} has directions of length {lengths}, not 1, beside ElementSpacing = "
                f"{fields.get('elementspacing', '(missing)')}; put the whole scale into ElementSpacing"
            )
    orientation = fields.get("ultrasoundimageorientation")
    return [f"{path}: UltrasoundImageOrientation = {orientation}"] if orientation else []


def _flag(path: Path, fields: dict[str, str], *names: str) -> bool | None:
    """Return a field that is true or false, under one of several names; None: it is not there.

    Raises:
        FrameError: it is neither, or two names state both.
    """
    stated = {name: fields[name.lower()] for name in names if name.lower() in fields}
    for name, value in stated.items():
        if value[:1].lower() not in ("t", "f", "1", "0"):
            raise FrameError(f"{path}: {name} = {value}; give True or False")
    found = {value[:1].lower() in ("t", "1") for value in stated.values()}
    if len(found) > 1:
        listed = " and ".join(f"{name} = {value}" for name, value in stated.items())
        raise FrameError(f"{path}: {listed}; correct one of them")
    return next(iter(found), None)


def _pixels(path: Path, fields: dict[str, str], start: int) -> tuple[NDArray[Any], list[str]]:
    """Return the pixels, their first axis the fastest, and notes.

    Raises:
        FrameError: they are stored in a way that is not read, or are not as many as the header says.
    """
    kind = TYPES.get(fields["elementtype"].upper())
    if kind is None:
        raise FrameError(f"{path}: ElementType = {fields['elementtype']}; one of {', '.join(TYPES)}")
    big = _flag(path, fields, "BinaryDataByteOrderMSB", "ElementByteOrderMSB")
    dtype = np.dtype((">" if big else "<") + kind)
    shape = [int(length) for length in fields["dimsize"].split()]
    size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    check_bytes(path, size)
    name = fields["elementdatafile"]
    if name.upper().startswith("LIST") or "%" in name:
        raise FrameError(f"{path}: ElementDataFile = {name}: pixels in several files; {CONVERT}")
    local = name.upper() == "LOCAL"
    data_path = path if local else data_file(path, name)
    skipped = int(fields.get("headersize", "0"))
    packed = _flag(path, fields, "CompressedData")
    if skipped < -1 or (skipped > 0 and local) or (skipped and packed):
        where = "pixels in the same file" if local else "CompressedData = True"
        raise FrameError(f"{path}: HeaderSize = {skipped} beside {where}; {CONVERT}")
    text = _flag(path, fields, "BinaryData") is False
    with data_path.open("rb") as file:
        file.seek((start if local else 0) + max(skipped, 0))
        if text:
            if packed:
                raise FrameError(f"{path}: BinaryData = False and CompressedData = True; correct one of them")
            return _text_pixels(path, file.read(), dtype.newbyteorder("=")).reshape(shape, order="F"), []
        data = unpacked(data_path, file.read(), size) if packed else file.read()
    if skipped == -1:
        data = data[len(data) - size :] if len(data) > size else data
    if len(data) != size:
        raise FrameError(
            f"{data_path}: damaged: {len(data)} bytes of pixels; DimSize = {fields['dimsize']} of "
            f"{fields['elementtype']} take {size} (HeaderSize = {skipped})"
        )
    array = np.frombuffer(data, dtype).astype(dtype.newbyteorder("=")).reshape(shape, order="F")
    unknown = big is None and dtype.itemsize > 1
    return array, [f"{path}: no BinaryDataByteOrderMSB; taken as False"] if unknown else []


def _text_pixels(path: Path, data: bytes, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return pixels written as text (BinaryData = False).

    Raises:
        FrameError: a number is none of the type.
    """
    values = np.array(data.split()).astype(np.float64)
    pixels = values.astype(dtype) if dtype.kind == "f" else np.clip(values, -(2.0**53), 2.0**53).astype(np.int64)
    pixels = pixels.astype(dtype)
    if dtype.kind != "f" and (wrong := np.flatnonzero(pixels != values)).size:
        raise FrameError(f"{path}: pixel {wrong[0]} is {values[wrong[0]]:g}, which is no number of type {dtype}")
    return pixels


def _steps(path: Path, fields: dict[str, str]) -> tuple[tuple[Sourced | None, ...], list[str]]:
    """Return the spacing in mm; the size of an element where no spacing is stated, as MetaIO takes it.

    Raises:
        FrameError: the numbers are not as many as the axes.
    """
    found = {}
    for field in ("ElementSpacing", "ElementSize"):
        values = [float(value) for value in fields.get(field.lower(), "").split()]
        if values and len(values) != len(fields["dimsize"].split()):
            raise FrameError(f"{path}: {field} has {len(values)} numbers, and DimSize {fields['dimsize']}; correct it")
        steps = stated_steps(values, [METRES["mm"]] * len(values), field)
        if any(steps):
            found[field] = (values, steps)
    if not found:
        return (), []
    name, (values, steps) = next(iter(found.items()))
    sizes = found.get("ElementSize", (values,))[0]
    differ = not np.allclose(sizes, values, rtol=SAME)
    words = f"{path}: ElementSize = {listed(sizes)}, and {name} = {listed(values)}, which is taken"
    return steps, [words] if differ else []
