"""DICOM: single frames and stacks, their grey levels, scale and times."""

from io import BytesIO
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from effects import less_than
from foreign_files import COLUMNS, COUNT, FRAMES, pictures_of, sizes_of, write_dicom
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate, generate_frames
from pydicom.sequence import Sequence
from pydicom.uid import (
    DeflatedExplicitVRLittleEndian,
    ExplicitVRBigEndian,
    JPEG2000Lossless,
    JPEGBaseline8Bit,
    JPEGExtended12Bit,
    RLELossless,
)

from scleraforce.errors import FrameError
from scleraforce.recording.dicom import read_dicom
from scleraforce.recording.images import read_frame, read_image
from scleraforce.recording.sources import source_kind

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


def test_a_kind_that_is_no_grey_or_colour_is_refused(tmp_path: Path) -> None:
    for kind in ["HSV", "CMYK", ""]:
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


def test_the_size_is_checked_before_memory_is_taken(tmp_path: Path) -> None:
    for write, message in [
        (lambda path: write_dicom(path, RAMP, Rows=60_000, Columns=60_000), "a frame may have 64 million"),
        (
            lambda path: write_dicom(path, RAMP, NumberOfFrames=2_000_000),
            "NumberOfFrames is 2000000, PixelData has 4,800 bytes",
        ),
        (lambda path: write_dicom(path, RAMP, SamplesPerPixel=5000), "with 5000 samples each"),
        (rle_bomb, "more is packed in it than"),
        (large_jpeg, r"of \(400, 600\) pixels, the header says \(40, 60\)"),
        (lambda path: write_dicom(path, RAMP, TransferSyntaxUID=DeflatedExplicitVRLittleEndian), "deflated DICOM"),
    ]:
        write(tmp_path / "a.dcm")
        content = (tmp_path / "a.dcm").read_bytes()
        with less_than(10e6), pytest.raises(FrameError, match=message):
            read_dicom(tmp_path / "a.dcm", content)


TWELVE = {"BitsStored": 12, "HighBit": 11}


def item(**tags: object) -> Sequence:
    dataset = Dataset()
    for name, value in tags.items():
        setattr(dataset, name, value)
    return Sequence([dataset])


def groups(**tags: object) -> Dataset:
    return item(**tags)[0]


# PS3.5 8.1.1: BitsStored bits that end at HighBit.
def test_bits_are_taken_where_high_bit_says(tmp_path: Path) -> None:
    for high in [11, 13, 15]:
        for compressed in [False, True]:
            dataset = write_dicom(tmp_path / "a.dcm", RAMP << (high - 11), BitsStored=12, HighBit=high)
            if compressed:
                dataset.compress("1.2.840.10008.1.2.5")
                dataset.save_as(tmp_path / "a.dcm")
            pixels, image = read_image(tmp_path / "a.dcm")
            np.testing.assert_array_equal(pixels, RAMP)
            assert any("HighBit" in note for note in image.notes) is (high != 11)
            assert read_dicom(tmp_path / "a.dcm").bits == 12


def test_bits_of_big_endian_pixels_are_taken_where_high_bit_says(tmp_path: Path) -> None:
    for pixels in (RAMP, RAMP.astype(np.int16) - 1200):
        written = write_dicom(tmp_path / "a.dcm", pixels, BitsStored=12, HighBit=15)
        dataset = Dataset()
        dataset.update(written)
        dataset.file_meta = written.file_meta
        dataset.file_meta.TransferSyntaxUID = ExplicitVRBigEndian
        dataset.PixelData = (pixels << 4).astype(">i2").tobytes()
        dataset.save_as(tmp_path / "a.dcm", enforce_file_format=True)
        np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)


def test_signed_pixels_are_taken_where_high_bit_says(tmp_path: Path) -> None:
    signed = RAMP.astype(np.int16) - 1200
    for shift in (0, 4):
        write_dicom(tmp_path / "a.dcm", signed << shift, BitsStored=12, HighBit=11 + shift)
        np.testing.assert_array_equal(pictures_of(read_dicom(tmp_path / "a.dcm"))[0], signed)
    write_dicom(tmp_path / "b.dcm", (signed & 0xFFF).astype(np.int16), **TWELVE)  # without an extended sign
    np.testing.assert_array_equal(pictures_of(read_dicom(tmp_path / "b.dcm"))[0], signed)


def test_pixels_that_use_other_bits_are_refused(tmp_path: Path) -> None:
    for pixels, tags in [
        (RAMP + 2000, TWELVE),
        (RAMP, {"BitsStored": 12, "HighBit": 15}),
        (RAMP.astype(np.int16) + 2500, TWELVE),
    ]:
        write_dicom(tmp_path / "a.dcm", pixels, **tags)
        with pytest.raises(FrameError, match=rf"BitsStored is 12, HighBit {tags['HighBit']}, but a pixel is 0x"):
            read_frame(tmp_path / "a.dcm")


def test_an_overlay_in_the_pixels_bits_is_left_out(tmp_path: Path) -> None:
    drawn = RAMP.copy()
    drawn[10:20, 10:20] |= 1 << 15
    dataset = write_dicom(tmp_path / "a.dcm", drawn, **TWELVE)
    dataset.add_new((0x6000, 0x0100), "US", 16)
    dataset.add_new((0x6000, 0x0102), "US", 15)
    dataset.save_as(tmp_path / "a.dcm")
    pixels, image = read_image(tmp_path / "a.dcm")
    np.testing.assert_array_equal(pixels, RAMP)
    assert any("OverlayBitPosition 15" in note for note in image.notes)


def test_cells_that_cannot_be_are_refused(tmp_path: Path) -> None:
    for tags in [{"BitsStored": 12, "HighBit": 16}, {"BitsStored": 12, "HighBit": 8}, {"BitsAllocated": 12}]:
        write_dicom(tmp_path / "a.dcm", RAMP, **tags)
        with pytest.raises(FrameError, match=r"BitsAllocated \d+, BitsStored \d+, HighBit \d+"):
            read_frame(tmp_path / "a.dcm")


def test_bright_tissue_stays_bright(tmp_path: Path) -> None:
    for signed in [False, True]:
        for slope, display in list(product((1.0, -2.0), ("", "MONOCHROME1", "INVERSE"))):
            dark_is_large = (slope < 0.0) != bool(display)
            dark = 4095 - RAMP if dark_is_large else RAMP
            tags = {"RescaleSlope": slope, "RescaleIntercept": 4095.0} | TWELVE
            if display == "MONOCHROME1":
                tags["PhotometricInterpretation"] = display
            elif display:
                tags["PresentationLUTShape"] = display
            write_dicom(tmp_path / "a.dcm", dark.astype(np.int16) - 2048 if signed else dark, **tags)
            pixels, image = read_image(tmp_path / "a.dcm")
            np.testing.assert_array_equal(pixels, RAMP)
            said = " ".join(image.notes)
            assert ("were exchanged" in said) is dark_is_large
            assert ("cancel" in said) is (slope < 0.0 and bool(display))


def test_greys_that_are_not_read_are_refused_by_name(tmp_path: Path) -> None:
    for tags, found in [
        ({"PhotometricInterpretation": "MONOCHROME1", "PresentationLUTShape": "INVERSE"}, "MONOCHROME1 .*INVERSE"),
        ({"PresentationLUTShape": "LIN OD"}, "PresentationLUTShape: LIN OD"),
        ({"RescaleSlope": 0.0}, "RescaleSlope: 0"),
        ({"ModalityLUTSequence": item(LUTExplanation="x")}, "ModalityLUTSequence"),
        ({"VOILUTSequence": item(LUTExplanation="x")}, "VOILUTSequence"),
        ({"PresentationLUTSequence": item(LUTExplanation="x")}, "PresentationLUTSequence"),
        ({"FloatPixelData": bytes(4 * 40 * 60)}, "FloatPixelData"),
        ({"TimezoneOffsetFromUTC": "+9900"}, "TimezoneOffsetFromUTC"),
        ({"TimezoneOffsetFromUTC": "1 h"}, "TimezoneOffsetFromUTC"),
    ]:
        write_dicom(tmp_path / "a.dcm", RAMP, **tags)
        with pytest.raises(FrameError, match=found):
            read_frame(tmp_path / "a.dcm")


def test_slopes_that_differ_between_frames_are_refused_with_both(tmp_path: Path) -> None:
    slopes = [item(RescaleSlope=slope, RescaleIntercept=0.0) for slope in (1.0, -1.0)]
    frames = Sequence([groups(PixelValueTransformationSequence=slope) for slope in slopes])
    write_dicom(tmp_path / "a.dcm", FRAMES[:2], PerFrameFunctionalGroupsSequence=frames)
    with pytest.raises(FrameError, match=r"1, 0 of frame 1 and -1, 0 of frame 2"):
        read_dicom(tmp_path / "a.dcm")


def test_a_negative_slope_in_functional_groups_counts_as_well(tmp_path: Path) -> None:
    shared = Sequence([groups(PixelValueTransformationSequence=item(RescaleSlope=-1.0, RescaleIntercept=0.0))])
    write_dicom(tmp_path / "a.dcm", 65535 - FRAMES, SharedFunctionalGroupsSequence=shared)
    np.testing.assert_array_equal(pictures_of(read_dicom(tmp_path / "a.dcm")), FRAMES)


def test_padding_is_dark_and_shifts_nothing(tmp_path: Path) -> None:
    for kind in ["MONOCHROME1", "MONOCHROME2"]:
        for limit in [None, -2998]:
            signed = RAMP.astype(np.int16) - 1000
            if kind == "MONOCHROME1":
                signed = -signed
            padded = signed.copy()
            padded[:5] = -3000
            tags = {"PixelPaddingValue": -3000} | ({} if limit is None else {"PixelPaddingRangeLimit": limit})
            write_dicom(tmp_path / "a.dcm", padded, PhotometricInterpretation=kind, **tags)
            pixels, image = read_image(tmp_path / "a.dcm")
            np.testing.assert_array_equal(pixels[5:], RAMP[5:] - RAMP[5, 0])
            assert (pixels[:5] == 0).all()
            assert any("PixelPaddingValue -3000" in note for note in image.notes)


def test_padding_that_is_dark_already_stays(tmp_path: Path) -> None:
    padded = RAMP + 100
    padded[:5] = 0
    write_dicom(tmp_path / "a.dcm", padded, PixelPaddingValue=0)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), padded)


def test_planes_of_colour_are_read_as_colour(tmp_path: Path) -> None:
    for planar in [0, 1]:
        grey = (RAMP % 200).astype(np.uint8)
        colour = np.stack([grey, grey, grey], axis=0 if planar else -1)
        tags = {"SamplesPerPixel": 3, "PhotometricInterpretation": "RGB", "PlanarConfiguration": planar}
        write_dicom(tmp_path / "a.dcm", grey, PixelData=colour.tobytes(), **tags)
        pixels, image = read_image(tmp_path / "a.dcm")
        np.testing.assert_array_equal(pixels, grey)
        assert any("colour became grey" in note for note in image.notes)


def test_samples_that_are_not_those_of_the_kind_are_refused(tmp_path: Path) -> None:
    for kind, samples in [("MONOCHROME2", 3), ("RGB", 1), ("PALETTE COLOR", 3)]:
        pixels = bytes(40 * 60 * samples)
        tags = {"SamplesPerPixel": samples, "PhotometricInterpretation": kind, "PlanarConfiguration": 0}
        write_dicom(tmp_path / "a.dcm", RAMP.astype(np.uint8), PixelData=pixels, **tags)
        with pytest.raises(FrameError, match=f"SamplesPerPixel {samples}, PhotometricInterpretation {kind}"):
            read_frame(tmp_path / "a.dcm")


def spacing(**mm: list[float]) -> dict[str, object]:
    """Tags of spacings at the top and, by `shared` and `frames`, in functional groups."""
    tags: dict[str, object] = {name: value for name, value in mm.items() if name[0].isupper()}
    if "shared" in mm:
        tags["SharedFunctionalGroupsSequence"] = Sequence(
            [groups(PixelMeasuresSequence=item(PixelSpacing=mm["shared"]))]
        )
    if "frames" in mm:
        tags["PerFrameFunctionalGroupsSequence"] = Sequence(
            [groups(PixelMeasuresSequence=item(PixelSpacing=mm["frames"]))]
        )
    return tags


def test_two_scales_in_one_file_are_refused_with_both(tmp_path: Path) -> None:
    for tags, found in [
        (spacing(PixelSpacing=[0.004, 0.0125], shared=[0.01, 0.02]), "0.01 x 0.02 mm"),
        (spacing(PixelSpacing=[0.004, 0.0125], frames=[0.004, 0.02]), "PixelSpacing of frame 1"),
        (spacing(PixelSpacing=[0.004, 0.0125], ImagerPixelSpacing=[0.005, 0.0125]), "ImagerPixelSpacing"),
        (spacing(PixelSpacing=[0.004, 0.0125], NominalScannedPixelSpacing=[0.1, 0.1]), "NominalScannedPixelSpacing"),
        (spacing(shared=[0.004, 0.0125], frames=[0.01, 0.02]), "0.01 x 0.02 mm"),
        (spacing(PixelSpacing=[0.004, 0.0125]) | {"PixelAspectRatio": [1, 2]}, "PixelAspectRatio 1:2"),
        (spacing(PixelSpacing=[0.004, 0.0125]) | {"PixelAspectRatio": [1, 1]}, "PixelAspectRatio 1:1"),
        (
            spacing(PixelSpacing=[0.004, 0.0125])
            | {
                "SequenceOfUltrasoundRegions": item(
                    PhysicalUnitsXDirection=3, PhysicalUnitsYDirection=3, PhysicalDeltaX=0.1, PhysicalDeltaY=0.2
                )
            },
            "SequenceOfUltrasoundRegions",
        ),
    ]:
        write_dicom(tmp_path / "a.dcm", RAMP, **tags)
        _, image = read_image(tmp_path / "a.dcm")
        assert sizes_of(image) == (None, None)
        assert "0.004 x 0.0125 mm" in image.scale_fault
        assert found in image.scale_fault


def test_one_scale_that_is_stated_twice_is_read(tmp_path: Path) -> None:
    for tags in [
        spacing(PixelSpacing=[0.004, 0.0125], shared=[0.004, 0.0125], frames=[0.004, 0.0125]),
        spacing(PixelSpacing=[0.004, 0.0125]) | {"PixelAspectRatio": [8, 25]},
        spacing(PixelSpacing=[0.004, 0.0125])
        | {
            "SequenceOfUltrasoundRegions": item(
                PhysicalUnitsXDirection=3, PhysicalUnitsYDirection=3, PhysicalDeltaX=0.00125, PhysicalDeltaY=0.0004
            )
        },
    ]:
        write_dicom(tmp_path / "a.dcm", RAMP, **tags)
        _, image = read_image(tmp_path / "a.dcm")
        assert image.scale_fault is None
        assert sizes_of(image) == pytest.approx((4e-6, 12.5e-6))


def test_an_aspect_ratio_alone_is_no_scale(tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", RAMP, PixelAspectRatio=[1, 2])
    _, image = read_image(tmp_path / "a.dcm")
    assert (*sizes_of(image), image.scale_fault) == (None, None, None)


def test_a_file_that_begins_as_a_tiff_is_dicom(tmp_path: Path) -> None:
    write_dicom(tmp_path / "a.dcm", RAMP)
    held = BytesIO()
    tifffile.imwrite(held, np.zeros((8, 8), np.uint8))
    data = (tmp_path / "a.dcm").read_bytes()
    (tmp_path / "a.dcm").write_bytes(held.getvalue()[:128].ljust(128, b"\0") + data[128:])
    assert source_kind(tmp_path / "a.dcm") == "dicom"
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)


def jpeg_2000(pixels: np.ndarray) -> bytes:
    image, held = pytest.importorskip("PIL.Image").fromarray(pixels), BytesIO()
    image.save(held, format="JPEG2000", irreversible=False, no_jp2=True)
    return held.getvalue()


def test_jpeg_2000_whose_type_is_not_that_of_the_header_is_refused_by_field(tmp_path: Path) -> None:
    stream = jpeg_2000(RAMP)
    write_dicom(tmp_path / "a.dcm", RAMP, TransferSyntaxUID=JPEG2000Lossless, PixelData=encapsulate([stream]))
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)
    write_dicom(tmp_path / "a.dcm", RAMP, TransferSyntaxUID=JPEG2000Lossless, PixelData=encapsulate([stream]), **TWELVE)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)
    bright, dim = jpeg_2000(RAMP + 2000), jpeg_2000(RAMP.astype(np.uint8))
    for packed, tags, found in (
        (
            stream,
            {"PixelRepresentation": 1},
            r"PixelRepresentation is 1 \(signed\), its JPEG 2000 image has unsigned pixels",
        ),
        (bright, TWELVE, "BitsStored is 12, HighBit 11, but a pixel is 0x"),
        (dim, {}, "BitsStored is 16, its JPEG 2000 image has 8 bits"),
        (stream, {"BitsStored": 12}, "HighBit is 15, BitsStored 12, and the pixels are compressed as JPEG 2000"),
    ):
        write_dicom(
            tmp_path / "a.dcm", RAMP, TransferSyntaxUID=JPEG2000Lossless, PixelData=encapsulate([packed]), **tags
        )
        with pytest.raises(FrameError, match=found):
            read_frame(tmp_path / "a.dcm")


def test_jpeg_extended_of_12_bits_is_refused_by_name_and_of_8_bits_read(tmp_path: Path) -> None:
    image, held = pytest.importorskip("PIL.Image").fromarray(RAMP.astype(np.uint8)), BytesIO()
    image.save(held, format="JPEG", quality=100)
    stream = held.getvalue()
    tags = {"TransferSyntaxUID": JPEGExtended12Bit, "PixelData": encapsulate([stream])}
    write_dicom(tmp_path / "a.dcm", RAMP.astype(np.uint8), **tags)
    assert np.abs(read_frame(tmp_path / "a.dcm").astype(int) - RAMP.astype(np.uint8)).max() <= 2
    at = stream.index(b"\xff\xc0")
    twelve = stream[: at + 1] + b"\xc1" + stream[at + 2 : at + 4] + bytes([12]) + stream[at + 5 :]
    tags["PixelData"] = encapsulate([twelve])
    write_dicom(tmp_path / "a.dcm", RAMP, **TWELVE, **tags)
    with pytest.raises(FrameError, match=r"JPEG Extended .*1\.2\.840\.10008\.1\.2\.4\.51.* 12 bits .*uncompressed"):
        read_frame(tmp_path / "a.dcm")


def test_a_number_of_frames_that_the_pixels_are_not_for_is_refused_with_both(tmp_path: Path) -> None:
    for stated in [1, 3, 6]:
        write_dicom(tmp_path / "a.dcm", FRAMES, NumberOfFrames=stated)
        with pytest.raises(FrameError, match=rf"NumberOfFrames is {stated}, PixelData has .* 5 frames"):
            read_dicom(tmp_path / "a.dcm")


def test_more_compressed_images_than_frames_are_refused(tmp_path: Path) -> None:
    image, held = pytest.importorskip("PIL.Image").fromarray(RAMP.astype(np.uint8)), BytesIO()
    image.save(held, format="JPEG")
    packed = encapsulate([held.getvalue()] * 3)
    write_dicom(tmp_path / "a.dcm", RAMP.astype(np.uint8), TransferSyntaxUID=JPEGBaseline8Bit, PixelData=packed)
    with pytest.raises(FrameError, match="NumberOfFrames is 1, PixelData has 3 compressed images"):
        read_frame(tmp_path / "a.dcm")


def test_times_that_contradict_each_other_are_named(tmp_path: Path) -> None:
    for tags, found in [
        ({"FrameTimeVector": [0.0, 10.0, 10.0]}, "FrameTimeVector has 3 values, NumberOfFrames is 5"),
        ({"FrameTime": 40.0, "FrameTimeVector": [0.0, 10.0, 10.0, 10.0, 10.0]}, "FrameTime is 40 ms"),
        ({"FrameTime": 40.0, "FrameIncrementPointer": 0x00181065}, "FrameTimeVector, which is missing"),
    ]:
        write_dicom(tmp_path / "a.dcm", FRAMES, **tags)
        scan = read_dicom(tmp_path / "a.dcm")
        assert scan.times is None
        assert found in scan.times_fault


def test_frame_increment_pointer_decides_between_two_steps_of_time(tmp_path: Path) -> None:
    steps = {"FrameTime": 40.0, "FrameTimeVector": [0.0, 10.0, 10.0, 10.0, 10.0]}
    for pointer, step_s in ((0x00181063, 0.04), (0x00181065, 0.01)):
        write_dicom(tmp_path / "a.dcm", FRAMES, FrameIncrementPointer=pointer, **steps)
        np.testing.assert_allclose(read_dicom(tmp_path / "a.dcm").times.time_s, step_s * np.arange(5))


def test_times_without_a_zone_are_those_of_the_files_zone(tmp_path: Path) -> None:
    for stated, zone, shift_s in [("", "", 0), ("", "+0100", -3600), ("", "-0530", 19800), ("+0100", "-0500", -3600)]:
        tags = {"TimezoneOffsetFromUTC": zone} if zone else {}
        write_dicom(tmp_path / "a.dcm", RAMP, AcquisitionDateTime=f"20260102030405.5{stated}", **tags)
        assert read_dicom(tmp_path / "a.dcm").times.time_s[0] == 1767323045.5 + shift_s


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


def test_steps_of_time_are_added_up(tmp_path: Path) -> None:
    for tags, time_s in [
        ({"FrameTime": 40.0}, [0.0, 0.04, 0.08, 0.12, 0.16]),
        ({"FrameTimeVector": [0.0, 10.0, 20.0, 10.0, 5.0]}, [0.0, 0.01, 0.03, 0.04, 0.045]),
        ({"FrameTimeVector": [7.0, 10.0, 20.0, 10.0, 5.0]}, [0.0, 0.01, 0.03, 0.04, 0.045]),
    ]:
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


def test_lossless_jpegs_of_all_kinds_are_read(tmp_path: Path) -> None:
    for syntax in ["1.2.840.10008.1.2.4.70", "1.2.840.10008.1.2.4.80", "1.2.840.10008.1.2.4.90"]:
        for stored in [13, 16]:
            for least in [0, -2400]:
                frames = (
                    FRAMES if least == 0 else FRAMES[1:2].astype(np.int16) + least
                )  # GDCM writes one signed frame alone
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


def test_frames_of_several_scales_are_refused(tmp_path: Path) -> None:
    for widths_mm in [(0.01, 0.01), (0.01, 0.02)]:
        measures = [group(PixelSpacing=[0.004, width_mm]) for width_mm in widths_mm]
        frames = Sequence([group(PixelMeasuresSequence=Sequence([measure])) for measure in measures])
        write_dicom(tmp_path / "a.dcm", FRAMES[:2], PerFrameFunctionalGroupsSequence=frames)
        if len(set(widths_mm)) == 1:
            assert read_dicom(tmp_path / "a.dcm").lateral_pixel_m.value == pytest.approx(10e-6)
            continue
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
