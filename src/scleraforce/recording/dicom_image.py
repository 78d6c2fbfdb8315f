"""Read a single DICOM image as a frame: bright or dark as zero, palettes, colour; and the size of its pixels."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import FrameImage, check_size, grey_pixels, inverted, jpeg_size, unpacked_bytes
from scleraforce.units import to_si

if TYPE_CHECKING:
    import pydicom

__all__ = [
    "DEFLATED",
    "bright",
    "check_image",
    "damage_named",
    "grey_kind",
    "pixel_spacing",
    "read_dicom",
    "turned_round",
]

# Zeiss writes the A-scans of its Visante along the rows of the image, so depth runs along the columns' index.
A_SCANS_ALONG_ROWS = {("Carl Zeiss Meditec", "1000")}
KINDS_READ = (
    "MONOCHROME1", "MONOCHROME2", "PALETTE COLOR", "RGB", "YBR_FULL", "YBR_FULL_422", "YBR_ICT", "YBR_RCT",
)  # fmt: skip
DEFLATED = b"1.2.840.10008.1.2.1.99"  # the transfer syntax of a file that is inflated as a whole
NEEDED = ("Rows", "Columns", "BitsAllocated", "BitsStored", "PixelRepresentation", "PixelData")  # to know the pixels
RLE_HEADER = 64  # bytes, the number and the places of the segments


def read_dicom(path: Path, data: bytes) -> FrameImage:
    """Read a DICOM image.

    Raises:
        FrameError: naming the file, what was found and what is allowed.
    """
    with damage_named(path):
        return _read(path, data)


@contextmanager
def damage_named(path: Path) -> Iterator[None]:
    """Take over-long private tags, as scanners write them, and name the file in whatever the reading of it raises.

    Raises:
        FrameError: what was read is damaged.
    """
    from pydicom import config  # here, so that reading PNG needs OpenCV only

    before = config.settings.reading_validation_mode
    config.settings.reading_validation_mode = config.IGNORE
    try:
        yield
    except FrameError:
        raise
    except Exception as fault:  # pydicom and its codecs raise whatever the damage leads to
        raise FrameError(f"{path}: damaged or an unknown kind of DICOM: {' '.join(str(fault).split())}") from fault
    finally:
        config.settings.reading_validation_mode = before


def _read(path: Path, data: bytes) -> FrameImage:
    import pydicom

    if DEFLATED in data:
        raise FrameError(f"{path}: a deflated DICOM file, whose size is not known before; save it without compression")
    dataset = pydicom.dcmread(io.BytesIO(data))
    frames = int(dataset.get("NumberOfFrames", None) or 1)
    if frames != 1:
        raise FrameError(f"{path}: {frames} frames in one DICOM file; give a file for each frame")
    check_image(path, dataset, 1)
    pixels = _unsigned(bright(path, dataset, np.asarray(dataset.pixel_array)))
    depth_m, lateral_m = pixel_spacing(dataset)
    if turned_round(dataset):
        pixels, depth_m, lateral_m = np.ascontiguousarray(pixels.swapaxes(0, 1)), lateral_m, depth_m
    return FrameImage(grey_pixels(pixels, path), depth_pixel_m=depth_m, lateral_pixel_m=lateral_m)


def turned_round(dataset: "pydicom.Dataset") -> bool:
    """Return whether the scanner is one that writes A-scans along the rows of its images."""
    maker = (str(dataset.get("Manufacturer", "")).strip(), str(dataset.get("ManufacturerModelName", "")).strip())
    return maker in A_SCANS_ALONG_ROWS


def check_image(path: Path, dataset: "pydicom.Dataset", frames: int) -> None:
    """Check what a data set says of its images, and that none of the compressed ones is larger.

    Raises:
        FrameError: naming the file, what was found and what is allowed.
    """
    missing = [name for name in NEEDED if dataset.get(name, None) is None]
    if missing:
        raise FrameError(f"{path}: a DICOM file without {', '.join(missing)}; export it anew")
    kind = grey_kind(dataset)
    if kind not in KINDS_READ:
        raise FrameError(f"{path}: PhotometricInterpretation: {kind or 'missing'}; one of {', '.join(KINDS_READ)}")
    rows, columns, samples = int(dataset.Rows), int(dataset.Columns), int(dataset.get("SamplesPerPixel", 1))
    check_size(path, rows, columns, samples)
    syntax = dataset.file_meta.TransferSyntaxUID
    if not syntax.is_compressed:
        return
    from pydicom.encaps import generate_frames
    from pydicom.uid import RLELossless

    for packed in generate_frames(dataset.PixelData, number_of_frames=frames):
        if syntax == RLELossless:
            _check_rle(path, packed, rows * columns)
        elif (size := jpeg_size(packed)) != (rows, columns):
            found = f"the compressed image is of {size} pixels, the header says {rows, columns}"
            raise FrameError(f"{path}: damaged: {found}")


def _check_rle(path: Path, packed: bytes, largest: int) -> None:
    """Check that no segment, one byte of each pixel, gives more bytes than there are pixels (and one to be even)."""
    count = int.from_bytes(packed[:4], "little")
    places = np.frombuffer(packed[4:RLE_HEADER], dtype="<u4")[: min(count, 15)].tolist()
    for begin, end in zip(places, [*places[1:], len(packed)], strict=True):
        if unpacked_bytes(packed[begin:end], largest + 1) > largest + 1:
            raise FrameError(f"{path}: damaged: more is packed in it than the {largest} pixels that its header says")


def grey_kind(dataset: "pydicom.Dataset") -> str:
    """Return the photometric interpretation of a data set, "" where it has none."""
    return str(dataset.get("PhotometricInterpretation", "")).strip()


def bright(path: Path, dataset: "pydicom.Dataset", pixels: NDArray[Any]) -> NDArray[Any]:
    """Return pixels that are brighter the larger they are; signed ones stay signed.

    Raises:
        FrameError: a pixel has more bits than the data set says.
    """
    from pydicom.pixels.processing import apply_color_lut

    kind = grey_kind(dataset)
    if kind == "PALETTE COLOR":
        return np.asarray(apply_color_lut(pixels, dataset))
    if not np.issubdtype(pixels.dtype, np.signedinteger):
        return inverted(pixels, int(dataset.BitsStored), path) if kind == "MONOCHROME1" else pixels
    return -pixels.astype(np.int64) if kind == "MONOCHROME1" else pixels


def _unsigned(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return signed pixels so that the smallest is 0; unsigned ones as they are."""
    if not np.issubdtype(pixels.dtype, np.signedinteger):
        return pixels
    wide = pixels.astype(np.int64) - int(pixels.min())
    return wide.astype(np.uint16 if int(wide.max()) < 2**16 else np.int64)


def pixel_spacing(dataset: "pydicom.Dataset") -> tuple[float | None, float | None]:
    """Return the distance of rows and of columns in m, from whichever standard tag has them, else None."""
    places = [dataset]
    for name in ("SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"):
        for group in dataset.get(name, None) or []:
            places += list(group.get("PixelMeasuresSequence", None) or [])
    for place in places:
        for name in ("PixelSpacing", "ImagerPixelSpacing", "NominalScannedPixelSpacing"):
            spacing = place.get(name, None)
            if spacing is not None and len(spacing) == 2 and min(float(value) for value in spacing) > 0.0:
                return to_si(float(spacing[0]), "mm"), to_si(float(spacing[1]), "mm")
    return None, None
