"""DICOM: bright or dark as zero, palettes, colour; its size is checked before it is decoded."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from dicom_file import write_dicom
from peak_memory import less_than
from pydicom.encaps import encapsulate
from pydicom.uid import DeflatedExplicitVRLittleEndian, JPEGBaseline8Bit, RLELossless

from scleraforce.errors import FrameError
from scleraforce.recording.dicom import read_dicom
from scleraforce.recording.images import read_frame

RAMP = np.arange(40 * 60, dtype=np.uint16).reshape(40, 60)
BYTES = RAMP.astype(np.uint8)


def test_monochrome1_is_turned_round(tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", 4095 - RAMP, PhotometricInterpretation="MONOCHROME1", BitsStored=12, HighBit=11)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)


def test_signed_monochrome1_is_turned_round_and_starts_at_zero(tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", 1000 - RAMP.astype(np.int16), PhotometricInterpretation="MONOCHROME1")
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)


def test_a_palette_gives_the_colours_that_it_stands_for(tmp_path: Path) -> None:
    table = np.arange(255, -1, -1, dtype=np.uint16) * 257
    tags = {f"{name}PaletteColorLookupTableData": table.tobytes() for name in ("Red", "Green", "Blue")}
    tags |= {f"{name}PaletteColorLookupTableDescriptor": [256, 0, 16] for name in ("Red", "Green", "Blue")}
    write_dicom(tmp_path / "a.dcm", BYTES, PhotometricInterpretation="PALETTE COLOR", **tags)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm") // 257, 255 - BYTES)


def test_colour_becomes_grey_as_in_other_formats(tmp_path: Path) -> None:
    colour = np.dstack([BYTES, BYTES // 2, 255 - BYTES])
    tags = {"SamplesPerPixel": 3, "PhotometricInterpretation": "RGB", "PlanarConfiguration": 0}
    write_dicom(tmp_path / "a.dcm", BYTES, PixelData=colour.tobytes(), **tags)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY))


def test_compressed_images_are_read(tmp_path: Path) -> None:
    dataset = write_dicom(tmp_path / "a.dcm", RAMP)
    dataset.compress(RLELossless)
    dataset.save_as(tmp_path / "a.dcm")
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)


@pytest.mark.parametrize("kind", ["HSV", "CMYK", ""])
def test_a_kind_that_is_no_grey_or_colour_is_refused(tmp_path: Path, kind: str) -> None:
    write_dicom(tmp_path / "a.dcm", BYTES, PhotometricInterpretation=kind)
    with pytest.raises(FrameError, match=r"PhotometricInterpretation: .* one of MONOCHROME1"):
        read_frame(tmp_path / "a.dcm")


def rle_bomb(path: Path) -> None:
    header = np.zeros(16, "<u4")
    header[:2] = 1, 64
    packed = header.tobytes() + bytes([129, 0]) * 400_000
    write_dicom(path, BYTES, TransferSyntaxUID=RLELossless, PixelData=encapsulate([packed]))


def large_jpeg(path: Path) -> None:
    stream = cv2.imencode(".jpg", np.zeros((400, 600), np.uint8))[1].tobytes()
    write_dicom(path, BYTES, TransferSyntaxUID=JPEGBaseline8Bit, PixelData=encapsulate([stream]))


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda path: write_dicom(path, RAMP, Rows=60_000, Columns=60_000), "a frame may have 64 million"),
        (
            lambda path: write_dicom(path, RAMP, NumberOfFrames=2_000_000),
            "NumberOfFrames is 2000000, PixelData has 4,800 bytes",
        ),
        (lambda path: write_dicom(path, RAMP, SamplesPerPixel=5000), "with 5000 samples each"),
        (rle_bomb, "more is packed in it than"),
        (large_jpeg, r"of \(400, 600\) pixels, the header says \(40, 60\)"),
        (lambda path: write_dicom(path, RAMP, TransferSyntaxUID=DeflatedExplicitVRLittleEndian), "deflated DICOM"),
    ],
    ids=["header", "frames", "samples", "RLE", "JPEG", "deflated"],
)
def test_the_size_is_checked_before_memory_is_taken(tmp_path: Path, write, message: str) -> None:
    write(tmp_path / "a.dcm")
    content = (tmp_path / "a.dcm").read_bytes()
    with less_than(10e6), pytest.raises(FrameError, match=message):
        read_dicom(tmp_path / "a.dcm", content)
