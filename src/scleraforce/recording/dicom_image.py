"""Read a single DICOM image as a frame: bright or dark as zero, palettes, colour; and the size of its pixels."""

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import FrameImage, check_size, grey_pixels, inverted, jpeg_size, unpacked_bytes
from scleraforce.units import to_si

if TYPE_CHECKING:
    import pydicom

__all__ = ["read_dicom"]

# Zeiss writes the A-scans of its Visante along the rows of the image, so depth runs along the columns' index.
A_SCANS_ALONG_ROWS = {("Carl Zeiss Meditec", "1000")}
KINDS_READ = (
    "MONOCHROME1", "MONOCHROME2", "PALETTE COLOR", "RGB", "YBR_FULL", "YBR_FULL_422", "YBR_ICT", "YBR_RCT",
)  # fmt: skip
DEFLATED = b"1.2.840.10008.1.2.1.99"  # the transfer syntax of a file that is inflated as a whole
RLE_HEADER = 64  # bytes, the number and the places of the segments


def read_dicom(path: Path, data: bytes) -> FrameImage:
    """Read a DICOM image.

    Raises:
        FrameError: naming the file, what was found and what is allowed.
    """
    from pydicom import config  # here, so that reading PNG needs OpenCV only

    before = config.settings.reading_validation_mode
    config.settings.reading_validation_mode = config.IGNORE  # scanners write over-long private tags
    try:
        return _read(path, data)
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
    kind = str(dataset.get("PhotometricInterpretation", "")).strip()
    _check_header(path, dataset, kind)
    pixels = _bright(path, dataset, np.asarray(dataset.pixel_array), kind)
    maker = (str(dataset.get("Manufacturer", "")).strip(), str(dataset.get("ManufacturerModelName", "")).strip())
    depth_m, lateral_m = _spacing(dataset)
    if maker in A_SCANS_ALONG_ROWS:
        pixels, depth_m, lateral_m = np.ascontiguousarray(pixels.swapaxes(0, 1)), lateral_m, depth_m
    return FrameImage(grey_pixels(pixels, path), depth_pixel_m=depth_m, lateral_pixel_m=lateral_m)


def _check_header(path: Path, dataset: "pydicom.Dataset", kind: str) -> None:
    """Check what the data set says of its image, and that the compressed image is no larger."""
    frames = int(dataset.get("NumberOfFrames", None) or 1)
    if frames != 1:
        raise FrameError(f"{path}: {frames} frames in one DICOM file; give a file for each frame")
    if kind not in KINDS_READ:
        raise FrameError(f"{path}: PhotometricInterpretation: {kind or 'missing'}; one of {', '.join(KINDS_READ)}")
    rows, columns, samples = int(dataset.Rows), int(dataset.Columns), int(dataset.get("SamplesPerPixel", 1))
    check_size(path, rows, columns, samples)
    syntax = dataset.file_meta.TransferSyntaxUID
    if not syntax.is_compressed:
        return
    from pydicom.encaps import generate_frames
    from pydicom.uid import RLELossless

    packed = next(generate_frames(dataset.PixelData, number_of_frames=1))
    if syntax == RLELossless:
        _check_rle(path, packed, rows * columns)
    elif (size := jpeg_size(packed)) != (rows, columns):
        raise FrameError(f"{path}: damaged: the compressed image is of {size} pixels, the header says {rows, columns}")


def _check_rle(path: Path, packed: bytes, largest: int) -> None:
    """Check that no segment, one byte of each pixel, gives more bytes than there are pixels (and one to be even)."""
    count = int.from_bytes(packed[:4], "little")
    places = np.frombuffer(packed[4:RLE_HEADER], dtype="<u4")[: min(count, 15)].tolist()
    for begin, end in zip(places, [*places[1:], len(packed)], strict=True):
        if unpacked_bytes(packed[begin:end], largest + 1) > largest + 1:
            raise FrameError(f"{path}: damaged: more is packed in it than the {largest} pixels that its header says")


def _bright(path: Path, dataset: "pydicom.Dataset", pixels: NDArray[Any], kind: str) -> NDArray[Any]:
    """Return unsigned pixels that are brighter the larger they are; the smallest signed one becomes 0."""
    from pydicom.pixels.processing import apply_color_lut

    if kind == "PALETTE COLOR":
        return np.asarray(apply_color_lut(pixels, dataset))
    if not np.issubdtype(pixels.dtype, np.signedinteger):
        return inverted(pixels, int(dataset.BitsStored), path) if kind == "MONOCHROME1" else pixels
    wide = pixels.astype(np.int64) * (-1 if kind == "MONOCHROME1" else 1)
    wide -= int(wide.min())
    return wide.astype(np.uint16 if int(wide.max()) < 2**16 else np.int64)


def _spacing(dataset: "pydicom.Dataset") -> tuple[float | None, float | None]:
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
