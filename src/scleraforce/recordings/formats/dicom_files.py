"""DICOM, one image or many frames: bright or dark as zero, palettes, colour; the size
of its pixels and its times.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime, tzinfo
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.errors import FrameError
from scleraforce.base.units import to_si
from scleraforce.recordings.formats import picture_streams
from scleraforce.recordings.formats.picture_streams import (
    FrameNumbers,
    FrameTimes,
    OtherPictureError,
    PictureSource,
    PixelSize,
    inverted_pixels,
    one_grey,
    rising,
)

if TYPE_CHECKING:
    from pydicom import Dataset, FileDataset

GREY_KINDS = ("MONOCHROME1", "MONOCHROME2")
KINDS_READ = (
    *GREY_KINDS,
    "PALETTE COLOR",
    "RGB",
    "YBR_FULL",
    "YBR_FULL_422",
    "YBR_ICT",
    "YBR_RCT",
)
SAMPLES = dict.fromkeys((*GREY_KINDS, "PALETTE COLOR"), 1)  # the others have three
# What turns stored values into grey levels in another way than along a straight line.
TABLES = ("ModalityLUTSequence", "VOILUTSequence", "PresentationLUTSequence")
# Zeiss writes the A-scans of its Visante along the rows of the image, so depth runs
# along the columns' index.
A_SCANS_ALONG_ROWS = {("Carl Zeiss Meditec", "1000")}  # by manufacturer and model
# attributes needed to know the pixels
NEEDED = (
    "Rows",
    "Columns",
    "BitsAllocated",
    "BitsStored",
    "PixelRepresentation",
    "PixelData",
)
FLOATS = ("FloatPixelData", "DoubleFloatPixelData")
CELL_BITS = (8, 16, 32)  # BitsAllocated
JPEG_BEGINS = (b"\xff\xd8\xff", b"\xff\x4f\xff\x51")
SPACINGS = ("PixelSpacing", "ImagerPixelSpacing", "NominalScannedPixelSpacing")
# the moment of the frame, else its beginning
FRAME_TIMES = (
    "FrameReferenceDateTime",
    "FrameAcquisitionDateTime",
)
# of one image, in their order of precedence: the tag of the time and of its day
IMAGE_TIMES = (
    ("AcquisitionTime", "AcquisitionDate"),
    ("ContentTime", "ContentDate"),
)
DAYS = ("AcquisitionDate", "ContentDate", "SeriesDate", "StudyDate")
# of one image, and of each of several
IMAGE_NUMBERS = ("TemporalPositionIdentifier", "InstanceNumber")
FRAME_NUMBERS = ("TemporalPositionIndex", "InStackPositionNumber")
# Pictures from the front: their SOP classes, modality and words of ImageType.
FRONT_CLASSES = {
    "1.2.840.10008.5.1.4.1.1.77.1.5.1": "Ophthalmic Photography",
    "1.2.840.10008.5.1.4.1.1.77.1.5.2": "Ophthalmic Photography",
    "1.2.840.10008.5.1.4.1.1.77.1.5.5": "Wide Field Ophthalmic Photography",
    "1.2.840.10008.5.1.4.1.1.77.1.5.6": "Wide Field Ophthalmic Photography",
    "1.2.840.10008.5.1.4.1.1.77.1.5.7": "Ophthalmic OCT En Face",
}
FRONT_MODALITIES = ("OPTENF",)
FRONT_WORDS = ("ENFACE", "FUNDUS", "SLO", "LOCALIZER", "REDFREE")
# what FrameIncrementPointer names
FRAME_TIME = 0x00181063
FRAME_TIME_VECTOR = 0x00181065


def read_dicom(path: Path, data: bytes | None = None) -> PictureSource:
    """Return a DICOM file's frames; `data` is the file's content if it has been
    read.
    """
    with _opened(path, data) as dataset:
        count = int(dataset.get("NumberOfFrames", None) or 1)
        _check_view(dataset)
        _check_image(dataset, count)
        rows = int(dataset.Rows)
        columns = int(dataset.Columns)
        picture_streams.check_bytes(
            count * rows * columns * (int(dataset.BitsAllocated) // 8)
        )
        dark_large, notes = _dark_is_large(dataset)

        maker = tuple(
            str(dataset.get(name, "")).strip()
            for name in ("Manufacturer", "ManufacturerModelName")
        )
        if maker in A_SCANS_ALONG_ROWS:
            notes.append(
                "this scanner writes A-scans along the rows: rows and columns were"
                " exchanged"
            )

        size, scale_fault = picture_streams.one_size(_pixel_sizes(dataset))
        times, times_fault = _times(dataset, count)
        numbers = _numbers_of(dataset, count)
        times = _in_stated_order(times, numbers)
        names = picture_streams.frame_names(path, count)
        bits = _bits(dataset)
        scan = PictureSource(
            names,
            rows,
            columns,
            lambda: _pictures(path, data, dark_large),
            bits=bits,
            notes=tuple(notes),
        )
        scan = replace(
            scan,
            size=size,
            scale_fault=scale_fault,
            times=times,
            times_fault=times_fault,
            other_times=_other_times(dataset, times, count),
            one_moment=_several_moments(numbers),
            numbers=numbers,
            series=str(dataset.get("SeriesInstanceUID", None) or "") or None,
        ).of_file(path)

    return scan.turned() if maker in A_SCANS_ALONG_ROWS else scan


@contextmanager
def _opened(path: Path, data: bytes | None) -> "Iterator[FileDataset]":
    # 140 ms: not for a recording of PNG files
    from pydicom import config, dcmread
    from pydicom.filereader import _read_file_meta_info, read_preamble
    from pydicom.uid import DeflatedExplicitVRLittleEndian

    with config.disable_value_validation(), picture_streams.named_faults(path, "DICOM"):
        with path.open("rb") if data is None else BytesIO(data) as file:
            read_preamble(file, force=False)
            if (
                _read_file_meta_info(file).get("TransferSyntaxUID", None)
                == DeflatedExplicitVRLittleEndian
            ):
                raise FrameError(
                    "a deflated DICOM file, whose size is not known in advance; save it"
                    " uncompressed"
                )

            file.seek(0)
            dataset = dcmread(file)

        yield dataset


def _grey_kind(dataset: "Dataset") -> str:
    return str(dataset.get("PhotometricInterpretation", "")).strip()


def _cell(dataset: "Dataset") -> tuple[int, int, int]:
    stored = int(dataset.BitsStored)
    high = dataset.get("HighBit", None)
    return int(dataset.BitsAllocated), stored, stored - 1 if high is None else int(high)


def _places(dataset: "Dataset", sequence: str) -> "Iterator[tuple[str, Dataset]]":
    """Yield the data set and the items of a sequence in its functional groups, each
    with its place in words.
    """
    yield "", dataset
    for groups in (
        "SharedFunctionalGroupsSequence",
        "PerFrameFunctionalGroupsSequence",
    ):
        for nth, group in enumerate(dataset.get(groups, None) or []):
            place = (
                f" of frame {nth + 1}"
                if groups.startswith("PerFrame")
                else f" of {groups}"
            )
            for item in group.get(sequence, None) or []:
                yield place, item


def _check_view(dataset: "FileDataset") -> None:
    """Refuse a picture from the front, which has no depth."""
    sop = str(dataset.get("SOPClassUID", ""))
    modality = str(dataset.get("Modality", ""))
    words = dataset.get("ImageType", None) or ()
    words = [words] if isinstance(words, str) else [str(word) for word in words]
    front = [
        word for word in words if re.sub(r"[\W_]", "", word.upper()) in FRONT_WORDS
    ]

    for stated, is_front in (
        (f"SOPClassUID is {FRONT_CLASSES.get(sop)}", sop in FRONT_CLASSES),
        (f"Modality is {modality}", modality in FRONT_MODALITIES),
        (f"ImageType has {', '.join(front)}", bool(front)),
    ):
        if is_front:
            raise OtherPictureError(
                f"{stated}: a picture from the front, not a B-scan; leave it out"
            )


def _check_image(dataset: "FileDataset", frames: int) -> None:
    if floats := [name for name in FLOATS if name in dataset]:
        raise FrameError(
            f"pixels are floats ({floats[0]}); export whole numbers (PixelData)"
        )
    if missing := [name for name in NEEDED if dataset.get(name, None) is None]:
        raise FrameError(f"a DICOM file without {', '.join(missing)}; export it anew")

    kind = _grey_kind(dataset)
    if kind not in KINDS_READ:
        raise FrameError(
            f"PhotometricInterpretation: {kind or 'missing'}; one of"
            f" {', '.join(KINDS_READ)}"
        )

    rows = int(dataset.Rows)
    columns = int(dataset.Columns)
    samples = int(dataset.get("SamplesPerPixel", 1))
    picture_streams.check_image_size(rows, columns, samples)

    if samples != SAMPLES.get(kind, 3):
        found = f"SamplesPerPixel {samples}, PhotometricInterpretation {kind}"
        raise FrameError(f"{found}, which has {SAMPLES.get(kind, 3)}; export it anew")

    allocated, stored, high = _cell(dataset)
    if allocated not in CELL_BITS or not 1 <= stored <= high + 1 <= allocated:
        found = f"BitsAllocated {allocated}, BitsStored {stored}, HighBit {high}"
        raise FrameError(
            f"{found}; a pixel has 8, 16 or 32 bits, and BitsStored of them end at"
            " HighBit"
        )
    if dataset.file_meta.TransferSyntaxUID.is_compressed:
        _check_compressed(dataset, frames)
        return

    size = (
        rows * columns * (2 if kind == "YBR_FULL_422" else samples) * (allocated // 8)
    )
    if len(dataset.PixelData) // size != frames:
        found = (
            f"PixelData has {len(dataset.PixelData):,} bytes, which are"
            f" {len(dataset.PixelData) / size:.4g} frames"
        )
        raise FrameError(
            f"damaged: NumberOfFrames is {frames}, {found}; export it anew"
        )


def _check_compressed(dataset: "FileDataset", frames: int) -> None:
    """Check what pydicom does not: images beyond NumberOfFrames, and JPEG 2000 of
    another type than the header's.
    """
    # 140 ms, pydicom, as in `_opened`
    from pydicom.encaps import generate_fragments, generate_frames
    from pydicom.pixels.utils import get_j2k_parameters
    from pydicom.uid import JPEG2000TransferSyntaxes, RLELossless

    syntax = dataset.file_meta.TransferSyntaxUID

    _, stored, high = _cell(dataset)
    if high != stored - 1 and syntax != RLELossless:
        found = (
            f"HighBit is {high}, BitsStored {stored}, and the pixels are compressed as"
            f" {syntax.name}"
        )
        raise FrameError(f"{found}; save it uncompressed")

    table, *packed = generate_fragments(dataset.PixelData)
    count = (
        len(packed)
        if syntax == RLELossless
        else sum(each.startswith(JPEG_BEGINS) for each in (table, *packed))
    )
    if count > frames:
        raise FrameError(
            f"damaged: NumberOfFrames is {frames}, PixelData has {count} compressed"
            " images"
        )

    if syntax == RLELossless:
        for stream in generate_frames(dataset.PixelData, number_of_frames=frames):
            _check_rle(stream, int(dataset.Rows) * int(dataset.Columns))
    if syntax not in JPEG2000TransferSyntaxes:
        return

    signs = ("unsigned", "signed")
    for image in map(
        get_j2k_parameters, generate_frames(dataset.PixelData, number_of_frames=frames)
    ):
        if image["is_signed"] != bool(stated := dataset.PixelRepresentation):
            found = f"PixelRepresentation is {stated} ({signs[bool(stated)]})"
            raise FrameError(
                f"{found}, its JPEG 2000 image has {signs[image['is_signed']]} pixels;"
                " save it uncompressed"
            )
        # Values of more bits are right where they fit, which `_stored_values` checks.
        if image["precision"] < stored:
            found = (
                f"BitsStored is {stored}, its JPEG 2000 image has {image['precision']}"
                " bits"
            )
            raise FrameError(f"{found}; save it uncompressed")


def _check_rle(packed: bytes, pixels: int) -> None:
    """Check that no segment, one byte of each pixel, gives more bytes than there are
    pixels (and one to be even).
    """
    # 140 ms, pydicom, as in `_opened`
    from pydicom.pixels.decoders.rle import _rle_parse_header

    for begin, end in pairwise([*_rle_parse_header(packed[:64]), len(packed)]):
        picture_streams.check_packbits(packed[begin:end], pixels + 1)


def _dark_is_large(dataset: "Dataset") -> tuple[bool, list[str]]:
    """Return whether larger stored values are darker, and notes on the treatment of the
    values.

    A negative RescaleSlope turns the values, MONOCHROME1 or the PresentationLUTShape
    INVERSE their display; one of each cancel. The two of the display are one inversion
    in PS3.3 C.8.11.3 (DX) and two in other readers, so both together are refused.
    """
    kind = _grey_kind(dataset)
    shape = str(dataset.get("PresentationLUTShape", None) or "IDENTITY")

    for place, item in _places(dataset, "FrameVOILUTSequence"):
        for table in (name for name in TABLES if item.get(name, None)):
            raise FrameError(
                f"{table}{place}: a table of grey levels, which is not read; export it"
                " applied"
            )

    if shape not in ("IDENTITY", "INVERSE"):
        raise FrameError(f"PresentationLUTShape: {shape}; IDENTITY or INVERSE")
    if kind == "MONOCHROME1" and shape == "INVERSE":
        both = "PhotometricInterpretation MONOCHROME1 and PresentationLUTShape INVERSE"
        raise FrameError(
            f"{both}: one inversion to some programs, two to others; export it as"
            " MONOCHROME2"
        )

    slope = _slope(dataset)
    _, stored, high = _cell(dataset)
    padding = dataset.get("PixelPaddingValue", None)
    possible = {
        f"RescaleSlope {slope:g}": slope < 0.0,
        "MONOCHROME1": kind == "MONOCHROME1",
    }

    turns = [
        name
        for name, turned in (
            possible | {"PresentationLUTShape INVERSE": shape == "INVERSE"}
        ).items()
        if turned
    ]
    if turns and kind not in GREY_KINDS:
        raise FrameError(
            f"{turns[0]} and PhotometricInterpretation {kind}; export it as MONOCHROME2"
        )

    notes = {
        "colour became grey": kind not in GREY_KINDS,
        f"{' and '.join(turns)}: dark and bright were exchanged": len(turns) == 1,
        f"{' and '.join(turns)} cancel: pixels stay as stored": len(turns) == 2,
        f"HighBit is {high}, BitsStored {stored}: pixels were shifted": (
            high != stored - 1
        ),
        (
            f"PixelPaddingValue {padding}: such pixels become as dark as the darkest of"
            " their frame"
        ): padding is not None,
    }
    return len(turns) == 1, [note for note, holds in notes.items() if holds]


def _slope(dataset: "Dataset") -> float:
    found = [
        (
            place,
            (
                float(item.RescaleSlope),
                float(item.get("RescaleIntercept", None) or 0.0),
            ),
        )
        for place, item in _places(dataset, "PixelValueTransformationSequence")
        if item.get("RescaleSlope", None) is not None
    ]
    if not found:
        return 1.0

    slope = found[0][1][0]
    if other := next((each for each in found if each[1] != found[0][1]), None):
        two = " and ".join(
            f"{scale[0]:g}, {scale[1]:g}{place}" for place, scale in (found[0], other)
        )
        raise FrameError(
            f"RescaleSlope and RescaleIntercept {two}; export frames of one scale of"
            " grey"
        )
    if not np.isfinite(slope) or slope == 0.0:
        raise FrameError(f"RescaleSlope: {slope:g}; it is a number other than 0")

    return slope


def _bits(dataset: "Dataset") -> int | None:
    """Return the bits that grey pixels use; a palette or colour gives 8 or 16, whatever
    was stored.
    """
    kind = _grey_kind(dataset)
    stored = int(dataset.BitsStored)
    known = (
        stored <= 16 and not int(dataset.PixelRepresentation)
        if kind in GREY_KINDS
        else stored == 8
    )

    return stored if known and kind != "PALETTE COLOR" else None


def _pictures(
    path: Path, data: bytes | None, dark_large: bool
) -> picture_streams.PictureStream:
    """Yield the frames as they are stored; larger is brighter, signed ones stay
    signed.
    """
    # 140 ms, pydicom, as in `_opened`
    from pydicom.pixels.processing import apply_color_lut
    from pydicom.pixels.utils import iter_pixels

    with _opened(path, data) as dataset:
        kind = _grey_kind(dataset)
        for pixels in iter_pixels(dataset, correct_unused_bits=False):
            values = _stored_values(dataset, np.asarray(pixels))
            if kind == "PALETTE COLOR":
                yield one_grey(np.asarray(apply_color_lut(values, dataset)))
            elif kind in GREY_KINDS:
                bright = (
                    inverted_pixels(values, int(dataset.BitsStored))
                    if dark_large
                    else values
                )
                yield _without_padding(dataset, values, bright)
            else:
                yield one_grey(values)


def _stored_values(dataset: "Dataset", cells: NDArray[Any]) -> NDArray[Any]:
    """Return the values that BitsStored bits up to HighBit hold (PS3.5 8.1.1); no other
    bit may be set.
    """
    allocated, stored, high = _cell(dataset)
    if stored == allocated or cells.dtype.itemsize * 8 != allocated:
        # codecs give smaller cells where these suffice
        return cells

    cells = np.ascontiguousarray(cells, cells.dtype.newbyteorder("="))
    # keeps the sign of signed ones
    values = (cells << (allocated - high - 1)) >> (allocated - stored)
    plain, shown = (
        each.view(f"u{each.dtype.itemsize}")
        for each in (cells, values << (high + 1 - stored))
    )

    # a sign may end at HighBit
    stray = (plain != shown) & (
        plain != shown & plain.dtype.type((1 << (high + 1)) - 1)
    )
    if stray.any():
        found = f"a pixel is {int(plain[stray][0]):#x}"
        raise FrameError(
            f"BitsStored is {stored}, HighBit {high}, but {found}, which has other"
            " bits; export it anew"
        )

    return values


def _without_padding(
    dataset: "Dataset", values: NDArray[Any], bright: NDArray[Any]
) -> NDArray[Any]:
    """Return a picture whose pixels of PixelPaddingValue, up to PixelPaddingRangeLimit,
    are as dark as its darkest.
    """
    value, limit = (
        dataset.get(name, None)
        for name in ("PixelPaddingValue", "PixelPaddingRangeLimit")
    )
    if value is None:
        return bright

    first = int(value)
    last = int(value if limit is None else limit)
    stored = int(dataset.BitsStored)

    if values.dtype.kind == "i":
        # some programs write the negative ones without their sign
        first, last = (
            end - (1 << stored) if end >= 1 << (stored - 1) else end
            for end in (first, last)
        )

    padded = (values >= min(first, last)) & (values <= max(first, last))
    if not padded.any() or padded.all():
        return bright

    darkest = bright[~padded].min()
    return np.where(
        padded,
        darkest if values.dtype.kind == "i" else np.minimum(bright, darkest),
        bright,
    )


def _pixel_sizes(dataset: "Dataset") -> list[PixelSize]:
    sizes = []
    for place, item in _places(dataset, "PixelMeasuresSequence"):
        for name in SPACINGS:
            spacing = _numbers(item, name)
            if len(spacing) == 2 and min(spacing) > 0.0:
                depth_m, lateral_m = (to_si(length, "mm") for length in spacing)
                sizes.append(
                    PixelSize(
                        f"DICOM's {name}{place}", depth_m=depth_m, lateral_m=lateral_m
                    )
                )

    ratio = _numbers(dataset, "PixelAspectRatio")
    if sizes and len(ratio) == 2 and min(ratio) > 0.0:
        depth_m = sizes[0].depth_m or 0.0
        source = f"PixelAspectRatio {ratio[0]:g}:{ratio[1]:g}"
        sizes.append(
            PixelSize(source, depth_m=depth_m, lateral_m=depth_m * ratio[1] / ratio[0])
        )

    return sizes


def _numbers(item: "Dataset", name: str) -> list[float]:
    value = item.get(name, None)
    return [] if value is None else np.atleast_1d(value).astype(np.float64).tolist()


def _in_stated_order(
    times: FrameTimes | None, numbers: Sequence[FrameNumbers]
) -> FrameTimes | None:
    """Return times of even steps for frames that are stored in another order."""
    order = next((each for each in numbers if len(set(each.values.tolist())) > 1), None)
    if times is None or order is None or times.source[8:] in FRAME_TIMES:
        return times
    if len(set(order.values.tolist())) < len(order.values):
        return times

    ranks = np.argsort(np.argsort(order.values))
    return replace(times, time_s=times.time_s[ranks])


def _zone(dataset: "Dataset") -> tzinfo | None:
    stated = str(dataset.get("TimezoneOffsetFromUTC", None) or "+0000").strip()
    try:
        return datetime.strptime(stated, "%z").tzinfo
    except ValueError as fault:
        raise FrameError(
            f"TimezoneOffsetFromUTC: {stated!r}; like +0100, from -1200 to +1400"
        ) from fault


def _times(dataset: "Dataset", count: int) -> tuple[FrameTimes | None, str | None]:
    zone = _zone(dataset)
    for name in FRAME_TIMES:
        contents = [
            item.get(name, None)
            for place, item in _places(dataset, "FrameContentSequence")
            if place
        ]
        # None becomes NaN
        time_s = np.array(
            [_seconds(stated, zone) for stated in contents], dtype=np.float64
        )
        if len(contents) == count and rising(np.sort(time_s)):
            return FrameTimes(time_s, f"DICOM's {name}"), None

    if count == 1:
        moment = _seconds(dataset.get("AcquisitionDateTime", None), zone)
        return (
            None
            if moment is None
            else FrameTimes(np.array([moment]), "DICOM's AcquisitionDateTime")
        ), None

    steps_ms = _numbers(dataset, "FrameTimeVector")
    pointers = _numbers(dataset, "FrameIncrementPointer")
    step_ms = float(dataset.get("FrameTime", None) or 0.0)

    by_step = step_ms > 0.0 and (FRAME_TIME in pointers or not steps_ms)
    if steps_ms and not by_step:
        if len(steps_ms) != count:
            return (
                None,
                (
                    f"FrameTimeVector has {len(steps_ms)} values, NumberOfFrames is"
                    f" {count}"
                ),
            )

        time_s = np.cumsum(to_si(np.array(steps_ms), "ms"))
        if (
            step_ms > 0.0
            and FRAME_TIME_VECTOR not in pointers
            and not np.allclose(steps_ms[1:], step_ms, rtol=0.01)
        ):
            return (
                None,
                f"FrameTime is {step_ms:g} ms, FrameTimeVector has {steps_ms[1]:g} ms",
            )
        if rising(time_s):
            return FrameTimes(time_s - time_s[0], "DICOM's FrameTimeVector"), None

    if FRAME_TIME_VECTOR in pointers and not steps_ms:
        return None, "FrameIncrementPointer names FrameTimeVector, which is missing"

    return picture_streams.even_times(
        count, to_si(step_ms, "ms"), "DICOM's FrameTime"
    ), None


def _other_times(
    dataset: "Dataset", times: FrameTimes | None, count: int
) -> tuple[FrameTimes, ...]:
    """Return the times that a file states beside the first, for one among others."""
    steps = ("DICOM's FrameTime", "DICOM's FrameTimeVector")
    if count > 1 and (times is None or times.source not in steps):
        return ()

    offsets_s = times.time_s if count > 1 and times is not None else np.zeros(1)
    zone = _zone(dataset)
    found = {
        "AcquisitionDateTime": _seconds(dataset.get("AcquisitionDateTime", None), zone)
    }
    for name, own_day in IMAGE_TIMES:
        time = str(dataset.get(name, None) or "").replace(":", "")
        days = (str(dataset.get(day, None) or "") for day in (own_day, *DAYS))
        day = next((re.sub(r"\D", "", each) for each in days if each), "19700101")
        found[name] = _seconds(f"{day}{time}" if time else None, zone)

    return tuple(
        FrameTimes(moment + offsets_s, f"DICOM's {name}")
        for name, moment in found.items()
        if moment is not None
    )


def _several_moments(numbers: Sequence[FrameNumbers]) -> str | None:
    """Return why frames are of several moments and of several places at each."""
    values = [each.values.tolist() for each in numbers]
    names = " and ".join(each.source.removeprefix("DICOM's ") for each in numbers)
    both = len(values) > 1 and len(values[0]) > 1
    mixed = both and all(1 < len(set(each)) < len(each) for each in values)
    return f"{names} both repeat: slices of several volumes" if mixed else None


def _numbers_of(dataset: "Dataset", count: int) -> tuple[FrameNumbers, ...]:
    """Return the numbers that order one image among others, or the frames in a file."""
    stated = {
        name: [dataset.get(name, None)] if count == 1 else [] for name in IMAGE_NUMBERS
    }
    contents = [
        item for place, item in _places(dataset, "FrameContentSequence") if place
    ]
    stated |= {
        name: [item.get(name, None) for item in contents]
        for name in FRAME_NUMBERS
        if count > 1
    }

    return tuple(
        FrameNumbers(np.array(values, dtype=np.int64), f"DICOM's {name}")
        for name, values in stated.items()
        if len(values) == count and None not in values
    )


def _seconds(stated: Any, zone: tzinfo | None) -> float | None:
    """Return seconds since 1970 of a DICOM date and time; its own zone takes precedence
    (PS3.3 C.12.1.1).
    """
    # 140 ms, pydicom, as in `_opened`
    from pydicom.valuerep import DT

    try:
        moment = DT(stated) if stated else None
    except ValueError:
        return None

    if not isinstance(moment, datetime):
        return None

    return (moment if moment.tzinfo else moment.replace(tzinfo=zone)).timestamp()
