"""DICOM of one and of many frames, plain and compressed."""

from pathlib import Path

import numpy as np
import pytest
from dicom_file import write_dicom
from format_frames import COLUMNS, COUNT, FRAMES, pictures_of
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate, generate_frames
from pydicom.sequence import Sequence
from pydicom.uid import DeflatedExplicitVRLittleEndian, RLELossless

from scleraforce.errors import FrameError
from scleraforce.recording.dicom import read_dicom

REAL = Path(__file__).parents[3] / "shared" / "real-oct" / "dicom" / "anterior-segment.dcm"
TOMOGRAPHY = "1.2.840.10008.5.1.4.1.1.77.1.5.4"  # Ophthalmic Tomography Image Storage


def group(**tags: object) -> Dataset:
    dataset = Dataset()
    for name, value in tags.items():
        setattr(dataset, name, value)
    return dataset


def test_ophthalmic_tomography_has_frames_scale_and_the_time_of_each(tmp_path: Path) -> None:
    measures = group(PixelSpacing=[0.004, 0.015], SliceThickness=0.1)
    moments = ["20260102030405.000", "20260102030405.250", "20260102030405.500", "20260102030406", "20260102030407.5"]
    frames = [group(FrameContentSequence=Sequence([group(FrameReferenceDateTime=moment)])) for moment in moments]
    write_dicom(
        tmp_path / "a.dcm", FRAMES, SOPClassUID=TOMOGRAPHY, BitsStored=13, HighBit=12,
        SharedFunctionalGroupsSequence=Sequence([group(PixelMeasuresSequence=Sequence([measures]))]),
        PerFrameFunctionalGroupsSequence=Sequence(frames),
    )  # fmt: skip
    scan = read_dicom(tmp_path / "a.dcm")
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert scan.bits == 13
    assert (scan.depth_pixel_m.value, scan.lateral_pixel_m.value) == pytest.approx((4e-6, 15e-6))
    np.testing.assert_allclose(scan.times.time_s - scan.times.time_s[0], [0.0, 0.25, 0.5, 1.0, 2.5], atol=1e-6)
    assert scan.times.time_s[0] == 1767323045.0  # 2026-01-02 03:04:05 UTC


@pytest.mark.parametrize(
    ("tags", "time_s"),
    [
        ({"FrameTime": 40.0}, [0.0, 0.04, 0.08, 0.12, 0.16]),
        ({"FrameTimeVector": [0.0, 10.0, 20.0, 10.0, 5.0]}, [0.0, 0.01, 0.03, 0.04, 0.045]),
        ({"FrameTimeVector": [7.0, 10.0, 20.0, 10.0, 5.0]}, [0.0, 0.01, 0.03, 0.04, 0.045]),
    ],
)
def test_steps_of_time_are_added_up(tmp_path: Path, tags: dict[str, object], time_s: list[float]) -> None:
    write_dicom(tmp_path / "a.dcm", FRAMES, **tags)
    np.testing.assert_allclose(read_dicom(tmp_path / "a.dcm").times.time_s, time_s)


def test_what_no_tag_states_stays_open(tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", FRAMES)
    scan = read_dicom(tmp_path / "a.dcm")
    assert (scan.times, scan.depth_pixel_m, scan.lateral_pixel_m) == (None, None, None)


def test_a_single_image_has_the_time_at_which_it_was_acquired(tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", FRAMES[0], AcquisitionDateTime="20260102030405.5+0100")
    assert read_dicom(tmp_path / "a.dcm").times.time_s[0] == 1767323045.5 - 3600


def test_dark_and_bright_are_exchanged_alike_in_all_frames_and_that_is_said(tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", 8191 - FRAMES, PhotometricInterpretation="MONOCHROME1", BitsStored=13, HighBit=12)
    scan = read_dicom(tmp_path / "a.dcm")
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert "dark and bright were exchanged" in scan.notes[0]


def test_signed_pixels_keep_their_sign_for_one_shift_of_all(tmp_path: Path) -> None:
    signed = FRAMES.astype(np.int16) - 2000
    write_dicom(tmp_path / "a.dcm", signed)
    scan = read_dicom(tmp_path / "a.dcm")
    np.testing.assert_array_equal(pictures_of(scan), signed)
    assert scan.bits is None
    write_dicom(tmp_path / "b.dcm", signed, PhotometricInterpretation="MONOCHROME1")
    np.testing.assert_array_equal(pictures_of(read_dicom(tmp_path / "b.dcm")), -signed.astype(int))


def test_a_scanner_that_writes_a_scans_along_rows_is_turned(tmp_path: Path) -> None:
    maker = {"Manufacturer": "Carl Zeiss Meditec", "ManufacturerModelName": "1000", "PixelSpacing": [0.015, 0.004]}
    write_dicom(tmp_path / "a.dcm", FRAMES.swapaxes(1, 2).copy(), **maker)
    scan = read_dicom(tmp_path / "a.dcm")
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert (scan.depth_pixel_m.value, scan.lateral_pixel_m.value) == pytest.approx((4e-6, 15e-6))


def test_frames_packed_as_rle_are_read_and_a_bomb_among_them_is_not(tmp_path: Path) -> None:
    dataset = write_dicom(tmp_path / "a.dcm", FRAMES)
    dataset.compress(RLELossless)
    dataset.save_as(tmp_path / "a.dcm")
    np.testing.assert_array_equal(pictures_of(read_dicom(tmp_path / "a.dcm")), FRAMES)
    fitting = next(generate_frames(dataset.PixelData, number_of_frames=COUNT))
    large = write_dicom(tmp_path / "b.dcm", np.zeros((400, COLUMNS), np.uint16))
    large.compress(RLELossless)
    bomb = next(generate_frames(large.PixelData, number_of_frames=1))
    dataset.PixelData = encapsulate([fitting, bomb, *[fitting] * (COUNT - 2)])
    dataset.save_as(tmp_path / "a.dcm")
    with pytest.raises(FrameError, match="damaged: more is packed in it"):
        read_dicom(tmp_path / "a.dcm")


@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2.4.70", "1.2.840.10008.1.2.4.80", "1.2.840.10008.1.2.4.90"])
@pytest.mark.parametrize("stored", [13, 16])
@pytest.mark.parametrize("least", [0, -2400])  # unsigned, signed
def test_lossless_jpegs_of_all_kinds_are_read(tmp_path: Path, syntax: str, stored: int, least: int) -> None:
    frames = FRAMES if least == 0 else FRAMES[1:2].astype(np.int16) + least  # GDCM writes one signed frame alone
    gdcm = pytest.importorskip("gdcm")
    tags = {"SOPClassUID": "1.2.840.10008.5.1.4.1.1.7", "SOPInstanceUID": "1.2.3"}
    write_dicom(tmp_path / "a.dcm", frames.squeeze(), BitsStored=stored, HighBit=stored - 1, **tags)
    reader = gdcm.ImageReader()
    reader.SetFileName(str(tmp_path / "a.dcm"))
    assert reader.Read()
    change = gdcm.ImageChangeTransferSyntax()
    types = {"70": gdcm.TransferSyntax.JPEGLosslessProcess14_1, "80": gdcm.TransferSyntax.JPEGLSLossless,
             "90": gdcm.TransferSyntax.JPEG2000Lossless}  # fmt: skip
    change.SetTransferSyntax(gdcm.TransferSyntax(types[syntax[-2:]]))
    change.SetInput(reader.GetImage())
    assert change.Change()
    writer = gdcm.ImageWriter()
    writer.SetFileName(str(tmp_path / "b.dcm"))
    writer.SetFile(reader.GetFile())
    writer.SetImage(change.GetOutput())
    assert writer.Write()
    np.testing.assert_array_equal(pictures_of(read_dicom(tmp_path / "b.dcm")), frames)


def test_a_deflated_file_and_one_without_pixels_are_refused(tmp_path: Path) -> None:
    dataset = write_dicom(tmp_path / "a.dcm", FRAMES, TransferSyntaxUID=DeflatedExplicitVRLittleEndian)
    with pytest.raises(FrameError, match="deflated"):
        read_dicom(tmp_path / "a.dcm")
    dataset = write_dicom(tmp_path / "a.dcm", FRAMES)
    del dataset.PixelData
    dataset.save_as(tmp_path / "a.dcm")
    with pytest.raises(FrameError, match=r"a\.dcm: a DICOM file without PixelData"):
        read_dicom(tmp_path / "a.dcm")


def test_tags_that_are_missing_are_named(tmp_path: Path) -> None:
    dataset = write_dicom(tmp_path / "a.dcm", FRAMES)
    del dataset.Rows, dataset.BitsStored
    dataset.save_as(tmp_path / "a.dcm")
    with pytest.raises(FrameError, match=r"a\.dcm: a DICOM file without Rows, BitsStored; export it anew"):
        read_dicom(tmp_path / "a.dcm")


@pytest.mark.parametrize("widths_mm", [(0.01, 0.01), (0.01, 0.02)])
def test_frames_of_several_scales_are_refused(tmp_path: Path, widths_mm: tuple[float, float]) -> None:
    measures = [group(PixelSpacing=[0.004, width_mm]) for width_mm in widths_mm]
    frames = Sequence([group(PixelMeasuresSequence=Sequence([measure])) for measure in measures])
    write_dicom(tmp_path / "a.dcm", FRAMES[:2], PerFrameFunctionalGroupsSequence=frames)
    if len(set(widths_mm)) == 1:
        assert read_dicom(tmp_path / "a.dcm").lateral_pixel_m.value == pytest.approx(10e-6)
        return
    scan = read_dicom(tmp_path / "a.dcm")
    assert (scan.depth_pixel_m, scan.lateral_pixel_m) == (None, None)
    for found in ("PixelSpacing of frame 1", "0.004 x 0.01 mm", "PixelSpacing of frame 2", "0.004 x 0.02 mm"):
        assert found in scan.scale_fault


def test_more_frames_than_the_pixels_are_for_is_damage(tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", FRAMES, NumberOfFrames=COUNT + 1)
    with pytest.raises(FrameError, match=r"a\.dcm: damaged"):
        pictures_of(read_dicom(tmp_path / "a.dcm"))


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/real-oct")
def test_a_real_visante_file_is_turned_and_states_its_time_but_no_scale() -> None:
    scan = read_dicom(REAL)
    assert (scan.rows, scan.columns) == (1024, 512)
    assert scan.depth_pixel_m is None
    assert scan.times.source == "DICOM's AcquisitionDateTime"
    picture = pictures_of(scan)[0]
    bright = picture > np.percentile(picture, 99)
    assert bright[: len(bright) // 2].sum() > 3 * bright[len(bright) // 2 :].sum()  # the eye's front lies on top
