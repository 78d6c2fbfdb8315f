"""NIfTI, NRRD, MetaImage: fastest axis first, spacing (1 along every axis: unknown),
PLUS sequences; Thorlabs .oct.
"""

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from scleraforce.base import optional_packages
from scleraforce.base.errors import FrameError
from scleraforce.base.units import to_si
from scleraforce.base.whole_files import opened_regular
from scleraforce.recordings.formats import picture_streams
from scleraforce.recordings.formats.picture_streams import (
    AXES,
    METRES,
    SECONDS,
    FrameNumbers,
    FrameTimes,
    PictureSource,
    PixelSize,
    Steps,
    array_scan,
    rising,
)

Axes = tuple[str, ...] | None

SAME = 1e-3  # spacings that differ by less are rounded
ORIENTATION = re.compile("[UMFNAD]{2,3}", re.IGNORECASE)  # XX: not known
SEQUENCE = "Seq_Frame(\\d+)_{}"
CONVERT = "save it as one file, .mha or .nrrd (3D Slicer, SimpleITK)"


def _stated_steps(
    steps: Sequence[float], units_m: Sequence[float | None]
) -> list[float | None]:
    if all(step in (0.0, 1.0) or not np.isfinite(step) for step in steps[:3]):
        return [None for _ in steps]

    each = zip(steps, units_m, strict=True)
    return [
        (
            step * unit_m
            if unit_m is not None and np.isfinite(step) and step > 0.0
            else None
        )
        for step, unit_m in each
    ]


def _data_file(path: Path, field: str, named: str) -> Path:
    if named.upper().startswith("LIST") or "%" in named:
        raise FrameError(f"{field}{named}: pixels in several files; {CONVERT}")
    if not named or named.upper() == "LOCAL":
        return path
    if PurePath(named).name != named:
        raise FrameError(
            f"its pixels are said to be in {named!r}; import it where they lie"
            " beside it"
        )

    data = path.with_name(named)
    _check_regular(data)
    return data


def _check_regular(path: Path) -> None:
    """Refuse a file of pixels that is missing, or that a library would wait for, as a
    pipe.
    """
    try:
        with opened_regular(path, FrameError):
            pass
    except OSError as fault:
        raise FrameError(f"{path}: {fault.strerror}") from fault


def _check_orientation(orientation: str, axes: Axes) -> None:
    """Check that depth runs away from the probe along the axis that is named depth
    (PLUS).
    """
    letters = orientation.upper() if ORIENTATION.fullmatch(orientation) else ""
    found = f"UltrasoundImageOrientation = {orientation}: depth"

    if "N" in letters:
        raise FrameError(
            f"{found} runs towards the probe; flip its rows, or write it as MF (PLUS:"
            " EditSequenceFile)"
        )

    at = letters.find("F")
    if axes is not None and 0 <= at < len(axes) and axes[at] != "depth":
        raise FrameError(f"{found} is axis {at + 1}; `axes` names {','.join(axes)}")


def _plus_sequence(scan: PictureSource, fields: Mapping[str, str]) -> PictureSource:
    """Return a sequence of PLUS with its stated times, in s, and without its invalid
    frames.
    """
    times = _of_frames(scan, fields, "Timestamp")
    states = _of_frames(scan, fields, "ImageStatus")
    count = len(scan.names)

    kept = [nth for nth in range(count) if states.get(nth, "OK").upper() != "INVALID"]
    if not kept:
        raise FrameError(
            f"Seq_FrameNNNN_ImageStatus = INVALID for all {count} frames; there is"
            " nothing to read"
        )

    if len(kept) < count:
        left_out = ", ".join(str(nth) for nth in range(count) if nth not in kept)
        notes = f"ImageStatus = INVALID: frames {left_out} (from 0) are left out"
        pictures = scan.pictures
        scan = replace(
            scan,
            names=tuple(scan.names[nth] for nth in kept),
            notes=(*scan.notes, notes),
            numbers=(FrameNumbers(np.array(kept), "Seq_FrameNNNN"),),
        )
        scan = replace(
            scan,
            pictures=lambda: (
                each for nth, each in enumerate(pictures()) if nth in set(kept)
            ),
        )

    if not times:
        return scan

    time_s = np.array([float(times[nth]) for nth in kept])
    if not rising(time_s):
        at = next(nth for nth in range(len(kept)) if not rising(time_s[: nth + 1]))
        pair = " and ".join(
            f"{times[nth]} (frame {nth})" for nth in kept[max(0, at - 1) : at + 1]
        )

        return replace(
            scan, times_fault=f"Seq_FrameNNNN_Timestamp does not rise: {pair}"
        )

    return replace(scan, times=FrameTimes(time_s, "Seq_Frame Timestamp"))


def _of_frames(
    scan: PictureSource, fields: Mapping[str, str], name: str
) -> dict[int, str]:
    found = {
        int(match[1]): value
        for field, value in fields.items()
        if (match := re.fullmatch(SEQUENCE.format(name), field, re.IGNORECASE))
    }
    if found and sorted(found) != list(range(len(scan.names))):
        stated = (
            f"Seq_FrameNNNN_{name} of {len(found)} frames, {min(found)} to"
            f" {max(found)}, where the axis named frame"
        )
        raise FrameError(
            f"{stated} has {len(scan.names)}; write it again, or correct `axes`"
        )

    return found


SAMPLE_BYTES = 8  # of the widest type of NRRD
NIFTI_UNITS = {0: "", 1: "m", 2: "mm", 3: "micron"}
# kinds other than components
NRRD_AXES = (
    "",
    "???",
    "none",
    "domain",
    "space",
    "time",
    "list",
    "point",
    "stub",
)
NRRD_IN_MM = re.compile(r"(left|right|scanner|[LR]A[SI]\b|[LR]P[SI]\b)", re.IGNORECASE)


def read_nifti(path: Path, axes: Axes) -> PictureSource:
    """Return a NIfTI volume's frames; times from a fourth axis in seconds."""
    with picture_streams.named_faults(path, "NIfTI"):
        for beside in map(path.with_suffix, (".hdr", ".img")):
            if os.path.lexists(beside):
                _check_regular(beside)

        image = optional_packages.package_for("nibabel", "NIfTI").load(path)
        header = image.header
        shape = header.get_data_shape()
        size = int(np.prod(shape, dtype=np.int64)) * header.get_data_dtype().itemsize
        picture_streams.check_bytes(size)
        plane = max(1, size // max(1, int(np.prod(shape[2:], dtype=np.int64))))

        with image.file_map["image"].get_prepare_fileobj("rb") as file:
            file.seek(image.dataobj.offset + size)
            if len(file.read(plane)) >= plane:
                sizes = " x ".join(map(str, shape))
                raise FrameError(
                    f"dim states {sizes} pixels, and more follow; correct dim, or write"
                    " the file again"
                )

        unscaled = (image.dataobj.slope, image.dataobj.inter) == (1.0, 0.0)
        array = np.asarray(image.dataobj.get_unscaled() if unscaled else image.dataobj)
        note = (
            f"pixels were scaled by scl_slope {image.dataobj.slope:g},"
            f" {image.dataobj.inter:g}"
        )
        scan = array_scan(path, array, axes, _nifti_steps(header))

        scan = replace(scan, notes=() if unscaled else (note,)).of_file(path)
        if (
            len(shape) < 4
            or axes is None
            or axes[-1] != "frame"
            or array.shape[3] != len(scan.names)
        ):
            return scan

        unit_s = SECONDS.get(header.get_xyzt_units()[1], 0.0)
        times = picture_streams.even_times(
            len(scan.names), float(header.get_zooms()[3]) * unit_s, "NIfTI's pixdim"
        )
        start_s = float(header["toffset"]) * unit_s

        return replace(
            scan, times=times and replace(times, time_s=times.time_s + start_s)
        )


def _nifti_steps(header: Any) -> list[Steps]:
    code = int(header["xyzt_units"]) & 7
    if code not in NIFTI_UNITS:
        raise FrameError(
            f"xyzt_units: {code} is not a NIfTI unit of length; correct it (1 m, 2 mm,"
            " 3 micron)"
        )

    pixdim = [float(step) for step in header.get_zooms()]
    units_m = [METRES.get(NIFTI_UNITS[code])] * len(pixdim)
    found: list[Steps] = [(_stated_steps(pixdim, units_m), "NIfTI's pixdim")]

    affine, sform_code = header.get_sform(coded=True)
    if sform_code:
        sform = np.linalg.norm(affine[:3, :3], axis=0).tolist()[: len(pixdim)]
        found.append((_stated_steps([*sform, *pixdim[3:]], units_m), "NIfTI's sform"))

    return found


def read_nrrd(path: Path, axes: Axes) -> PictureSource:
    """Return an NRRD's frames; axes labelled frame, depth and lateral need not be
    named.
    """
    with picture_streams.named_faults(path, "NRRD"):
        nrrd = optional_packages.package_for("nrrd", "NRRD")
        with path.open("rb") as file:
            header = nrrd.read_header(file)
            start = file.tell()

        for axis, (kind, size) in enumerate(
            zip(header.get("kinds", []), header["sizes"], strict=False), start=1
        ):
            if size > 1 and kind.lower() not in NRRD_AXES:
                raise FrameError(
                    f"kinds: axis {axis} of {size} is {kind!r}; give grey frames, of"
                    " one channel"
                )

        count = int(np.prod(header["sizes"], dtype=np.int64)) * SAMPLE_BYTES
        picture_streams.check_bytes(count)
        data = _data_file(
            path,
            "data file: ",
            str(header.get("data file", header.get("datafile", ""))),
        )

        if header["encoding"].lower() in ("gzip", "gz"):
            picture_streams.unpacked_bytes(
                data.read_bytes()[start if data == path else 0 :], count
            )

        array, _ = nrrd.read(str(path), index_order="F")
        named = axes or _nrrd_axes(header, array.shape)
        _check_orientation(str(header.get("UltrasoundImageOrientation", "")), named)
        scan = array_scan(path, array, named, _nrrd_steps(header, array.ndim))
        scan = replace(scan, times=_nrrd_times(header, len(scan.names)))

        return _plus_sequence(
            scan, {name: str(value) for name, value in header.items()}
        ).of_file(path)


def _nrrd_axes(header: Any, shape: tuple[int, ...]) -> Axes:
    """Return the axes that labels name; a list, as in sequences of 3D Slicer, is that
    of the frames.
    """
    labels, kinds = (
        header.get(name, [""] * len(shape)) for name in ("labels", "kinds")
    )
    named = [
        "frame" if kind == "list" else label
        for label, kind in zip(labels, kinds, strict=True)
    ]
    long = tuple(name for name, size in zip(named, shape, strict=True) if size > 1)

    return long if sorted(long) in (sorted(AXES), sorted(AXES[1:])) else None


def _nrrd_times(header: Any, count: int) -> FrameTimes | None:
    for axis, kind in enumerate(header.get("kinds", [])):
        unit_s = SECONDS.get(str(header.get("units", [""] * (axis + 1))[axis]))
        values = str(header.get(f"axis {axis} index values", "")).split()
        if kind == "list" and unit_s and len(values) == count:
            time_s = np.array(values, dtype=np.float64) * unit_s
            return (
                FrameTimes(time_s, f"NRRD's axis {axis} index values")
                if rising(time_s)
                else None
            )

    return None


def _nrrd_steps(header: Any, count: int) -> list[Steps]:
    found = list[Steps]()
    unit_m = None

    if "space directions" in header:
        # its unit is mm, as NRRD's programs take it
        anatomical = NRRD_IN_MM.match(str(header.get("space", "")))
        names = {
            str(unit)
            for unit in header.get("space units") or ["mm" if anatomical else ""]
        }
        if len(names) > 1:
            raise FrameError(
                f"space units: {' and '.join(sorted(names))}; give all directions"
                " in one"
            )

        unit_m = METRES.get(names.pop())
        lengths = np.linalg.norm(
            np.array(header["space directions"], dtype=np.float64), axis=1
        ).tolist()
        found.append(
            (_stated_steps(lengths, [unit_m] * count), "NRRD's space directions")
        )

    units_m = [
        METRES.get(str(unit), unit_m) for unit in header.get("units", [""] * count)
    ]
    spacings = [float(spacing) for spacing in header.get("spacings", [np.nan] * count)]

    return [*found, (_stated_steps(spacings, units_m), "NRRD's spacings")]


HEADER_BYTES = 2**26
TYPES = {
    "MET_CHAR": "i1",
    "MET_UCHAR": "u1",
    "MET_SHORT": "i2",
    "MET_USHORT": "u2",
    "MET_INT": "i4",
    "MET_UINT": "u4",
    "MET_LONG": "i4",
    "MET_ULONG": "u4",
    "MET_LONG_LONG": "i8",
    "MET_ULONG_LONG": "u8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
BYTE_ORDERS = ("BinaryDataByteOrderMSB", "ElementByteOrderMSB")


def read_metaimage(path: Path, axes: Axes) -> PictureSource:
    """Return a MetaImage's frames; its spacing is in mm. Sequences of PLUS have times,
    and frames that are invalid.
    """
    with picture_streams.named_faults(path, "MetaImage"):
        fields, start = _header(path)
        _check(fields)
        notes = []
        if orientation := fields.get("ultrasoundimageorientation", ""):
            notes.append(f"UltrasoundImageOrientation = {orientation}")

        array = _pixels(path, fields, start, notes)
        _check_orientation(orientation, axes)
        scan = replace(
            array_scan(path, array, axes, _steps(fields)), notes=tuple(notes)
        )

        return _plus_sequence(scan, fields).of_file(path)


def _header(path: Path) -> tuple[dict[str, str], int]:
    fields: dict[str, str] = {}
    with path.open("rb") as file:
        while file.tell() < HEADER_BYTES and (line := file.readline(HEADER_BYTES)):
            name, _, value = (
                part.strip() for part in line.decode("latin-1").partition("=")
            )
            if not name or name.startswith("#"):
                continue
            if fields.setdefault(name.lower(), value) != value:
                raise FrameError(
                    f"{name} is stated twice: {fields[name.lower()]!r} and {value!r};"
                    " correct it"
                )
            if name.lower() == "elementdatafile":
                return fields, file.tell()

    raise FrameError("damaged: its header has no ElementDataFile")


def _check(fields: dict[str, str]) -> None:
    if int(channels := fields.get("elementnumberofchannels", "1")) != 1:
        raise FrameError(
            f"ElementNumberOfChannels = {channels}; give grey frames, of one channel"
        )
    if missing := [
        field for field in ("DimSize", "ElementType") if field.lower() not in fields
    ]:
        raise FrameError(f"damaged: its header has no {missing[0]}")

    axes = len(fields["dimsize"].split())
    for field in ("TransformMatrix", "Orientation", "Rotation"):
        values = np.array(fields.get(field.lower(), "").split(), dtype=np.float64)
        lengths = np.linalg.norm(values.reshape(axes, -1), axis=1)
        if values.size == axes**2 and not np.allclose(lengths, 1.0, atol=SAME):
            found = (
                f"{field} has directions of length"
                f" {' x '.join(f'{length:.6g}' for length in lengths)}, not 1"
            )
            raise FrameError(f"{found}; put the whole scale into ElementSpacing")


def _flag(fields: dict[str, str], name: str, default: bool) -> bool:
    return (
        fields[name.lower()][:1].lower() in ("t", "1")
        if name.lower() in fields
        else default
    )


def _pixels(
    path: Path, fields: dict[str, str], start: int, notes: list[str]
) -> NDArray[Any]:
    """Return the pixels, their first axis the fastest."""
    kind = TYPES.get(fields["elementtype"].upper())
    if kind is None:
        raise FrameError(
            f"ElementType = {fields['elementtype']}; one of {', '.join(TYPES)}"
        )

    orders = {
        _flag(fields, name, False) for name in BYTE_ORDERS if name.lower() in fields
    }
    if len(orders) > 1:
        raise FrameError(
            f"{' and '.join(BYTE_ORDERS)} contradict each other; correct one of them"
        )

    dtype = np.dtype((">" if True in orders else "<") + kind)
    shape = [int(length) for length in fields["dimsize"].split()]
    size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    picture_streams.check_bytes(size)
    data_path = _data_file(path, "ElementDataFile = ", fields["elementdatafile"])
    local = data_path == path
    skipped = int(fields.get("headersize", "0"))
    with opened_regular(data_path, FrameError) as file:
        data = file.read()

    data = data[(start if local else 0) + max(skipped, 0) :]

    if not _flag(fields, "BinaryData", True):
        return (
            np.array(data.split())
            .astype(dtype.newbyteorder("="))
            .reshape(shape, order="F")
        )

    data = (
        picture_streams.unpacked_bytes(data, size)
        if _flag(fields, "CompressedData", False)
        else data
    )
    data = data[max(len(data) - size, 0) :] if skipped == -1 else data
    if len(data) != size:
        stated = (
            f"DimSize = {fields['dimsize']} of {fields['elementtype']} take {size}"
            f" (HeaderSize = {skipped})"
        )
        raise FrameError(
            f"damaged: {data_path.name} has {len(data)} bytes of pixels; {stated}"
        )

    if not orders and dtype.itemsize > 1:
        notes.append(f"no {BYTE_ORDERS[0]}; taken as False")

    return (
        np.frombuffer(data, dtype)
        .astype(dtype.newbyteorder("="))
        .reshape(shape, order="F")
    )


def _steps(fields: dict[str, str]) -> list[Steps]:
    """Return the spacing in mm; the size of an element by default, as MetaIO takes
    it.
    """
    found: list[Steps] = []
    for field in ("ElementSpacing", "ElementSize"):
        values = [float(value) for value in fields.get(field.lower(), "").split()]
        if values and len(values) != len(fields["dimsize"].split()):
            raise FrameError(
                f"{field} has {len(values)} numbers, and DimSize {fields['dimsize']};"
                " correct it"
            )

        found += (
            [(_stated_steps(values, [METRES["mm"]] * len(values)), field)]
            if values
            else []
        )

    return found


HEADER = "Header.xml"
INTENSITY = "Intensity"
XML_BYTES = 2**22
OCT_KIND = "Thorlabs .oct file"
SAMPLE = np.dtype("<f4")


def read_thorlabs(path: Path) -> PictureSource:
    """Return the frames of Thorlabs' .oct (ThorImage OCT 4, 5): sizes in mm, intensity
    in dB, depth fastest.
    """
    with picture_streams.named_faults(path, OCT_KIND), ZipFile(path) as archive:
        if archive.getinfo(HEADER).file_size > XML_BYTES:
            raise FrameError(f"{HEADER} of more than {XML_BYTES} bytes")
        if b"<!DOCTYPE" in (text := archive.read(HEADER)) or b"<!ENTITY" in text:
            raise FrameError(f"{HEADER} defines entities, which a scanner does not")

        header = ElementTree.fromstring(text)
        entry, name = _intensity(archive, header)

        rows, columns, count = (
            int(entry.get(f"Size{axis}", "1" if axis == "Y" else "0")) for axis in "ZXY"
        )
        if not (rows and columns):
            raise FrameError(
                f"{HEADER}: {name} has no {'SizeZ' if columns else 'SizeX'}; store it"
                " again in ThorImage"
            )
        if (stated_bytes := entry.get("BytesPerPixel", "4")) != str(SAMPLE.itemsize):
            raise FrameError(
                f"{HEADER}: {name} has BytesPerPixel = {stated_bytes}; 4 (floats, in"
                " dB) are read"
            )

        stated = archive.getinfo(name).file_size
        picture_streams.check_image_size(rows, columns)
        picture_streams.check_bytes(stated)

        if count < 1 or stated != rows * columns * count * SAMPLE.itemsize:
            raise FrameError(
                f"{name} has {stated} bytes; the header says {rows} x {columns} x"
                f" {count} floats"
            )

        in_file, in_header = (
            PixelSize(
                f"Thorlabs' {field}",
                depth_m=_pixel_m(range_z, rows),
                lateral_m=_pixel_m(range_x, columns),
            )
            for field, range_z, range_x in (
                ("RangeZ, RangeX", entry.get("RangeZ"), entry.get("RangeX")),
                (
                    "SizeReal",
                    *(
                        header.findtext(f".//Image/SizeReal/Size{axis}")
                        for axis in "ZX"
                    ),
                ),
            )
        )
        size, scale_fault = picture_streams.one_size([in_file, in_header])
        notes = tuple(
            f"{HEADER} states RefractiveIndex = {each.text}"
            for each in header.iter("RefractiveIndex")
        )
        scan = PictureSource(
            picture_streams.frame_names(path, count),
            rows,
            columns,
            lambda: _pictures(path, name, (columns, rows)),
        )

        return replace(scan, size=size, scale_fault=scale_fault, notes=notes).of_file(
            path
        )


def _intensity(
    archive: ZipFile, header: ElementTree.Element
) -> tuple[ElementTree.Element, str]:
    names = {name.replace("\\", "/"): name for name in archive.namelist()}
    entries = [
        (entry, (entry.text or "").strip().replace("\\", "/"))
        for entry in header.iter("DataFile")
    ]

    found = [
        (entry, names[inside])
        for entry, inside in entries
        if INTENSITY in inside and inside in names
    ]
    if not found:
        raise FrameError(
            "no processed intensity in it; store it in ThorImage beside the spectra"
        )
    if len(found) > 1:
        listed = " and ".join(name for _, name in found)
        raise FrameError(
            f"{len(found)} files of intensity, {listed}; export the one that is meant"
            " as TIFF"
        )

    return found[0]


def _pixel_m(range_mm: str | None, count: int) -> float | None:
    return (
        to_si(float(range_mm), "mm") / count
        if range_mm and float(range_mm) > 0.0
        else None
    )


def _pictures(
    path: Path, name: str, shape: tuple[int, int]
) -> picture_streams.PictureStream:
    size = shape[0] * shape[1] * SAMPLE.itemsize
    with (
        picture_streams.named_faults(path, OCT_KIND),
        ZipFile(path) as archive,
        archive.open(name) as file,
    ):
        while data := file.read(size):
            yield np.frombuffer(data, dtype=SAMPLE).reshape(shape).T
