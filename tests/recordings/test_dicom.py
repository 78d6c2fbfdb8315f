"""DICOM: single frames and stacks, their grey levels, scale and times."""

from io import BytesIO

import cv2
import numpy as np
import pytest
from effects import less_than
from foreign_files import (
    COUNT,
    FRAMES,
    NO_SIZES,
    SIZES_M,
    check_scan,
    item,
    sizes_of,
    write_dicom,
)
from pydicom import uid
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate, generate_frames
from pydicom.sequence import Sequence

from scleraforce.base.errors import FrameError
from scleraforce.recordings.formats.dicom_files import read_dicom
from scleraforce.recordings.formats.image_files import read_frame, read_image

RAMP = np.arange(40 * 60, dtype=np.uint16).reshape(40, 60)
BYTES = RAMP.astype(np.uint8)
SIGNED = RAMP.astype(np.int16) - 1200
TWELVE = {"BitsStored": 12, "HighBit": 11}
COLOUR = {
    "SamplesPerPixel": 3,
    "PhotometricInterpretation": "RGB",
    "PlanarConfiguration": 0,
}


def sequence(**tags):
    return Sequence([item(**tags)])


def each_frame(*items):
    """Return items, of one group each, as a sequence of frames."""
    return Sequence([item[0] for item in items])


def scan_of(folder, pixels, **tags):
    write_dicom(folder / "a.dcm", pixels, **tags)
    return read_dicom(folder / "a.dcm")


def frame_of(folder, pixels, **tags):
    """Write and read one frame, and return it with its notes."""
    write_dicom(folder / "a.dcm", pixels, **tags)
    read, scan = read_image(folder / "a.dcm")
    return read, " ".join(scan.notes)


def test_palettes_become_grey(tmp_path):
    table = np.arange(255, -1, -1, dtype=np.uint16) * 257
    tags = {"PhotometricInterpretation": "PALETTE COLOR"}
    for name in ("Red", "Green", "Blue"):
        tags[f"{name}PaletteColorLookupTableData"] = table.tobytes()
        tags[f"{name}PaletteColorLookupTableDescriptor"] = [256, 0, 16]
    pixels, _ = frame_of(tmp_path, BYTES, **tags)
    np.testing.assert_array_equal(pixels // 257, 255 - BYTES)


@pytest.mark.parametrize("planar", [0, 1])
def test_colours_become_grey(tmp_path, planar):
    colour = np.dstack([BYTES, BYTES // 2, 255 - BYTES])
    stored = np.moveaxis(colour, -1, 0) if planar else colour
    tags = COLOUR | {"PlanarConfiguration": planar, "PixelData": stored.tobytes()}
    pixels, notes = frame_of(tmp_path, BYTES, **tags)
    np.testing.assert_array_equal(pixels, cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY))
    assert "colour became grey" in notes


LONG_RLE = np.array([1, 64, *[0] * 14], "<u4").tobytes() + bytes([129, 0]) * 400_000


def packed(syntax, *streams):
    return {"TransferSyntaxUID": syntax, "PixelData": encapsulate([*streams])}


@pytest.mark.parametrize(
    ("pixels", "tags", "message"),
    [
        (RAMP, {"Rows": 60_000, "Columns": 60_000}, "a frame may have 64 million"),
        (RAMP, {"NumberOfFrames": 2_000_000}, "is 2000000, PixelData has 4,800 bytes"),
        (RAMP, {"SamplesPerPixel": 5000}, "with 5000 samples each"),
        (BYTES, packed(uid.RLELossless, LONG_RLE), "more is packed in it than"),
        (
            np.zeros((2000, 8000), np.uint16),
            {"TransferSyntaxUID": uid.DeflatedExplicitVRLittleEndian},
            "deflated DICOM.*save it uncompressed",
        ),
    ],
)
def test_the_size_is_checked_before_memory_is_taken(tmp_path, pixels, tags, message):
    write_dicom(tmp_path / "a.dcm", pixels, **tags)
    content = (tmp_path / "a.dcm").read_bytes()
    with less_than(10e6), pytest.raises(FrameError, match=message):
        read_dicom(tmp_path / "a.dcm", content)


# PS3.5 8.1.1: BitsStored bits that end at HighBit.
@pytest.mark.parametrize("high", [11, 13, 15])
@pytest.mark.parametrize("compressed", [False, True])
def test_bits_are_taken_where_high_bit_says(tmp_path, high, compressed):
    tags = {"BitsStored": 12, "HighBit": high}
    dataset = write_dicom(tmp_path / "a.dcm", RAMP << (high - 11), **tags)
    if compressed:
        dataset.compress(uid.RLELossless)
        dataset.save_as(tmp_path / "a.dcm")

    pixels, scan = read_image(tmp_path / "a.dcm")
    np.testing.assert_array_equal(pixels, RAMP)
    assert any("HighBit" in note for note in scan.notes) is (high != 11)
    assert scan.bits == 12


@pytest.mark.parametrize("pixels", [RAMP, SIGNED])
def test_pixels_of_the_other_byte_order_are_read(tmp_path, pixels):
    written = write_dicom(tmp_path / "a.dcm", pixels, BitsStored=12, HighBit=15)
    dataset = Dataset()
    dataset.update(written)
    dataset.file_meta = written.file_meta
    dataset.file_meta.TransferSyntaxUID = uid.ExplicitVRBigEndian
    dataset.PixelData = (pixels << 4).astype(">i2").tobytes()
    dataset.save_as(tmp_path / "a.dcm", enforce_file_format=True)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)


@pytest.mark.parametrize(
    ("pixels", "tags"),
    [
        (SIGNED, {}),
        (SIGNED, TWELVE),
        (SIGNED << 4, {"BitsStored": 12, "HighBit": 15}),
        ((SIGNED & 0xFFF).astype(np.int16), TWELVE),  # without an extended sign
        (-SIGNED, {"PhotometricInterpretation": "MONOCHROME1"}),
    ],
)
def test_signed_pixels_keep_their_sign(tmp_path, pixels, tags):
    scan = scan_of(tmp_path, pixels, **tags)
    check_scan(scan, SIGNED[None])
    assert scan.bits is None
    # a frame alone begins at zero
    np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("slope", [1.0, -2.0])
@pytest.mark.parametrize(
    "display",
    [
        {},
        {"PhotometricInterpretation": "MONOCHROME1"},
        {"PresentationLUTShape": "INVERSE"},
    ],
)
def test_bright_tissue_stays_bright(tmp_path, signed, slope, display):
    dark_is_large = (slope < 0.0) != bool(display)
    dark = 4095 - RAMP if dark_is_large else RAMP
    pixels = dark.astype(np.int16) - 2048 if signed else dark
    tags = {"RescaleSlope": slope, "RescaleIntercept": 4095.0, **TWELVE, **display}
    pixels, notes = frame_of(tmp_path, pixels, **tags)
    np.testing.assert_array_equal(pixels, RAMP)
    assert ("were exchanged" in notes) is dark_is_large
    assert ("cancel" in notes) is (slope < 0.0 and bool(display))


def slope_of_a_frame(slope):
    shift = sequence(RescaleSlope=slope, RescaleIntercept=0.0)
    return sequence(PixelValueTransformationSequence=shift)


def test_a_slope_of_all_frames_is_applied(tmp_path):
    shared = {"SharedFunctionalGroupsSequence": slope_of_a_frame(-1.0)}
    check_scan(scan_of(tmp_path, 65535 - FRAMES, **shared))


def colour(kind, samples):
    return {
        **COLOUR,
        "SamplesPerPixel": samples,
        "PhotometricInterpretation": kind,
        "PixelData": bytes(40 * 60 * samples),
    }


TWO_SLOPES = each_frame(slope_of_a_frame(1.0), slope_of_a_frame(-1.0))
INVERSE = {
    "PhotometricInterpretation": "MONOCHROME1",
    "PresentationLUTShape": "INVERSE",
}


@pytest.mark.parametrize(
    ("pixels", "tags", "found"),
    [
        (BYTES, {"PhotometricInterpretation": "HSV"}, "one of MONOCHROME1"),
        (BYTES, {"PhotometricInterpretation": ""}, "one of MONOCHROME1"),
        (RAMP, INVERSE, "MONOCHROME1 .*ERSE"),
        (RAMP, {"PresentationLUTShape": "LIN OD"}, "PresentationLUTShape: LIN OD"),
        (RAMP, {"RescaleSlope": 0.0}, "RescaleSlope: 0"),
        *(
            (RAMP, {name: sequence(LUTExplanation="x")}, name)
            for name in (
                "ModalityLUTSequence",
                "VOILUTSequence",
                "PresentationLUTSequence",
            )
        ),
        (RAMP, {"FloatPixelData": bytes(4 * 40 * 60)}, "FloatPixelData"),
        (RAMP, {"TimezoneOffsetFromUTC": "+9900"}, "TimezoneOffsetFromUTC"),
        (RAMP, {"TimezoneOffsetFromUTC": "1 h"}, "TimezoneOffsetFromUTC"),
        (
            FRAMES[:2],
            {"PerFrameFunctionalGroupsSequence": TWO_SLOPES},
            "1, 0 of frame 1 and -1, 0 of frame 2",
        ),
        (
            RAMP,
            {**TWELVE, "HighBit": 16},
            "BitsAllocated 16, BitsStored 12, HighBit 16",
        ),
        (RAMP, {**TWELVE, "HighBit": 8}, "BitsAllocated 16, BitsStored 12, HighBit 8"),
        (RAMP, {"BitsAllocated": 12}, "BitsAllocated 12, BitsStored 16, HighBit 15"),
        (RAMP + 2000, TWELVE, "BitsStored is 12, HighBit 11, but a pixel is 0x"),
        (RAMP, {**TWELVE, "HighBit": 15}, "12, HighBit 15, but a pixel is 0x"),
        (
            RAMP.astype(np.int16) + 2500,
            TWELVE,
            "BitsStored is 12, HighBit 11, but a pixel is 0x",
        ),
        (BYTES, colour("MONOCHROME2", 3), "SamplesPerPixel 3, Photo.* MONOCHROME2"),
        (BYTES, colour("RGB", 1), "SamplesPerPixel 1, Photo.* RGB"),
        (BYTES, colour("PALETTE COLOR", 3), "SamplesPerPixel 3, Photo.* PALETTE"),
        *(
            (FRAMES, {"NumberOfFrames": n}, f"s is {n}, PixelData has .* 5 frames")
            for n in (1, 3, 6)
        ),
    ],
)
def test_what_is_not_read_is_refused_by_its_field(tmp_path, pixels, tags, found):
    with pytest.raises(FrameError, match=rf"a\.dcm: .*{found}"):
        list(scan_of(tmp_path, pixels, **tags).pictures())


def test_missing_fields_are_named(tmp_path):
    dataset = write_dicom(tmp_path / "a.dcm", FRAMES)
    del dataset.Rows, dataset.BitsStored
    dataset.save_as(tmp_path / "a.dcm")
    with pytest.raises(FrameError, match="file without Rows, BitsStored; export it"):
        read_dicom(tmp_path / "a.dcm")


@pytest.mark.parametrize("kind", ["MONOCHROME2", "MONOCHROME1"])
@pytest.mark.parametrize("limit", [{}, {"PixelPaddingRangeLimit": -2998}])
def test_padding_is_as_dark_as_the_darkest_pixel(tmp_path, kind, limit):
    sign = 1 if kind == "MONOCHROME2" else -1
    padded = sign * (RAMP.astype(np.int16) - 1000)
    padded[:5] = -3000
    tags = {"PixelPaddingValue": -3000, "PhotometricInterpretation": kind, **limit}
    pixels, notes = frame_of(tmp_path, padded, **tags)
    np.testing.assert_array_equal(pixels[5:], RAMP[5:] - RAMP[5, 0])
    assert not pixels[:5].any()
    assert "PixelPaddingValue -3000" in notes


def test_padding_that_is_dark_already_stays(tmp_path):
    padded = RAMP + 100
    padded[:5] = 0
    pixels, _ = frame_of(tmp_path, padded, PixelPaddingValue=0)
    np.testing.assert_array_equal(pixels, padded)


def groups(kind, *spacings):
    """Return the functional groups, "Shared" or "PerFrame", of a spacing each."""
    each = [
        sequence(PixelMeasuresSequence=sequence(PixelSpacing=spacing))
        for spacing in spacings
    ]
    return {f"{kind}FunctionalGroupsSequence": each_frame(*each)}


USUAL = [0.004, 0.015]
ONE = {"PixelSpacing": USUAL}


@pytest.mark.parametrize(
    ("tags", "found"),
    [
        (ONE | groups("Shared", [0.01, 0.02]), "0.01 x 0.02 mm"),
        (ONE | groups("PerFrame", [0.004, 0.02]), "PixelSpacing of frame 1"),
        (ONE | {"ImagerPixelSpacing": [0.005, 0.015]}, "ImagerPixelSpacing"),
        (ONE | {"NominalScannedPixelSpacing": [0.1, 0.1]}, "NominalScannedPixelSpac"),
        (groups("Shared", USUAL) | groups("PerFrame", [0.01, 0.02]), "0.01 x 0.02 mm"),
        (groups("PerFrame", USUAL, [0.004, 0.02]), "PixelSpacing of frame 2"),
        (ONE | {"PixelAspectRatio": [1, 2]}, "PixelAspectRatio 1:2"),
        (ONE | {"PixelAspectRatio": [1, 1]}, "PixelAspectRatio 1:1"),
    ],
)
def test_two_scales_in_one_file_are_named_and_give_none(tmp_path, tags, found):
    scan = scan_of(tmp_path, RAMP, **tags)
    assert sizes_of(scan) == NO_SIZES
    assert "0.004 x 0.015 mm" in scan.scale_fault
    assert found in scan.scale_fault


@pytest.mark.parametrize(
    ("tags", "sizes_m"),
    [
        (ONE | groups("Shared", USUAL) | groups("PerFrame", USUAL, USUAL), SIZES_M),
        (ONE | {"PixelAspectRatio": [4, 15]}, SIZES_M),
        ({"PixelAspectRatio": [1, 2]}, NO_SIZES),
        ({}, NO_SIZES),
    ],
)
def test_a_scale_that_is_stated_twice_is_read(tmp_path, tags, sizes_m):
    scan = scan_of(tmp_path, RAMP, **tags)
    check_scan(scan, RAMP[None], sizes_m)
    assert (scan.times, scan.scale_fault) == (None, None)


def encoded(pixels, **options):
    held = BytesIO()
    pytest.importorskip("PIL.Image").fromarray(pixels).save(held, **options)
    return held.getvalue()


J2K = {"format": "JPEG2000", "irreversible": False, "no_jp2": True}
STREAM = encoded(RAMP, **J2K)
SMALL = encoded(BYTES, format="JPEG", quality=100)
LARGE = encoded(np.zeros((400, 600), np.uint8), format="JPEG")
AT = SMALL.index(b"\xff\xc0")
TWELVE_BITS = (
    SMALL[: AT + 1] + b"\xc1" + SMALL[AT + 2 : AT + 4] + bytes([12]) + SMALL[AT + 5 :]
)
LOSSLESS = uid.JPEG2000Lossless
EXTENDED = uid.JPEGExtended12Bit
BASELINE = uid.JPEGBaseline8Bit


@pytest.mark.parametrize("tags", [{}, TWELVE])
def test_compressed_images_are_read(tmp_path, tags):
    pixels, _ = frame_of(tmp_path, RAMP, **packed(LOSSLESS, STREAM), **tags)
    np.testing.assert_array_equal(pixels, RAMP)
    pixels, _ = frame_of(tmp_path, BYTES, **packed(EXTENDED, SMALL))
    np.testing.assert_allclose(pixels.astype(int), BYTES, atol=2)


@pytest.mark.parametrize(
    ("pixels", "sent", "tags", "found"),
    [
        (
            RAMP,
            packed(LOSSLESS, STREAM),
            {"PixelRepresentation": 1},
            r"is 1 \(signed\), its JPEG 2000 image has unsigned pixels",
        ),
        (
            RAMP,
            packed(LOSSLESS, encoded(RAMP + 2000, **J2K)),
            TWELVE,
            "BitsStored is 12, HighBit 11, but a pixel is 0x",
        ),
        (
            RAMP,
            packed(LOSSLESS, encoded(BYTES, **J2K)),
            {},
            "BitsStored is 16, its JPEG 2000 image has 8 bits",
        ),
        (
            RAMP,
            packed(LOSSLESS, STREAM),
            {"BitsStored": 12},
            "HighBit is 15, BitsStored 12, .* compressed as JPEG 2000",
        ),
        (
            RAMP,
            packed(EXTENDED, TWELVE_BITS),
            TWELVE,
            "JPEG Extended' for samples with 12-bit",
        ),
        (BYTES, packed(BASELINE, LARGE), {}, "damaged"),
        (
            BYTES,
            packed(BASELINE, *[SMALL] * 3),
            {},
            "is 1, PixelData has 3 compressed images",
        ),
    ],
    ids=range(7),
)
def test_compressed_images_of_another_type_than_the_header_are_refused_by_field(
    tmp_path, pixels, sent, tags, found
):
    with pytest.raises(FrameError, match=found):
        frame_of(tmp_path, pixels, **sent, **tags)


@pytest.mark.parametrize(
    "kind", ["JPEGLosslessProcess14_1", "JPEGLSLossless", "JPEG2000Lossless"]
)
@pytest.mark.parametrize("stored", [13, 16])
@pytest.mark.parametrize("least", [0, -2400])
def test_lossless_jpegs_of_gdcm_are_read(tmp_path, kind, stored, least):
    gdcm = pytest.importorskip("gdcm")
    # GDCM writes one signed frame alone
    frames = FRAMES if least == 0 else FRAMES[1:2].astype(np.int16) + least
    tags = {
        "SOPClassUID": uid.SecondaryCaptureImageStorage,
        "SOPInstanceUID": "1.2.3",
        "BitsStored": stored,
        "HighBit": stored - 1,
    }
    write_dicom(tmp_path / "a.dcm", frames.squeeze(), **tags)
    reader = gdcm.ImageReader()
    reader.SetFileName(str(tmp_path / "a.dcm"))
    assert reader.Read()
    change = gdcm.ImageChangeTransferSyntax()
    change.SetTransferSyntax(gdcm.TransferSyntax(getattr(gdcm.TransferSyntax, kind)))
    change.SetInput(reader.GetImage())
    assert change.Change()
    writer = gdcm.ImageWriter()
    writer.SetFileName(str(tmp_path / "b.dcm"))
    writer.SetFile(reader.GetFile())
    writer.SetImage(change.GetOutput())
    assert writer.Write()
    check_scan(read_dicom(tmp_path / "b.dcm"), frames)


BEGIN_S = 1767323045.0  # 2026-01-02 03:04:05 UTC


def test_ophthalmic_tomography_has_upright_frames_scale_and_the_time_of_each(tmp_path):
    seconds = ("05.000", "05.250", "05.500", "06", "07.5")
    frames = [
        sequence(
            FrameContentSequence=sequence(FrameReferenceDateTime=f"202601020304{each}")
        )
        for each in seconds
    ]
    scan = scan_of(
        tmp_path,
        FRAMES,
        SOPClassUID="1.2.840.10008.5.1.4.1.1.77.1.5.4",
        BitsStored=13,
        HighBit=12,
        PerFrameFunctionalGroupsSequence=each_frame(*frames),
        **groups("Shared", USUAL),
    )
    times_s = BEGIN_S + np.array([0.0, 0.25, 0.5, 1.0, 2.5])
    check_scan(scan, FRAMES, SIZES_M, times_s)
    assert scan.bits == 13


def test_a_maker_that_writes_a_scans_along_the_rows_is_turned(tmp_path):
    maker = {
        "Manufacturer": "Carl Zeiss Meditec",
        "ManufacturerModelName": "1000",
        "PixelSpacing": USUAL[::-1],
    }
    scan = scan_of(tmp_path, FRAMES.swapaxes(1, 2).copy(), **maker)
    check_scan(scan, FRAMES, SIZES_M)


@pytest.mark.parametrize(
    ("stated", "tags", "shift_s"),
    [
        ("", {}, 0),
        ("", {"TimezoneOffsetFromUTC": "+0100"}, -3600),
        ("", {"TimezoneOffsetFromUTC": "-0530"}, 19800),
        ("+0100", {"TimezoneOffsetFromUTC": "-0500"}, -3600),
    ],
)
def test_the_time_of_a_frame_is_in_its_zone(tmp_path, stated, tags, shift_s):
    moment = f"20260102030405.5{stated}"
    scan = scan_of(tmp_path, RAMP, AcquisitionDateTime=moment, **tags)
    assert scan.times.time_s[0] == BEGIN_S + 0.5 + shift_s


VECTOR = {"FrameTimeVector": [0.0, 10.0, 20.0, 10.0, 5.0]}
TWO = {"FrameTime": 40.0, **VECTOR}
BY_STEP_S = [0.0, 0.04, 0.08, 0.12, 0.16]
BY_VECTOR_S = [0.0, 0.01, 0.03, 0.04, 0.045]


@pytest.mark.parametrize(
    ("tags", "time_s"),
    [
        ({"FrameTime": 40.0}, BY_STEP_S),
        (VECTOR, BY_VECTOR_S),
        ({"FrameTimeVector": [7.0, 10.0, 20.0, 10.0, 5.0]}, BY_VECTOR_S),
        (TWO | {"FrameIncrementPointer": 0x00181063}, BY_STEP_S),
        (TWO | {"FrameIncrementPointer": 0x00181065}, BY_VECTOR_S),
    ],
)
def test_steps_of_time_are_added_up(tmp_path, tags, time_s):
    check_scan(scan_of(tmp_path, FRAMES, **tags), time_s=time_s)


@pytest.mark.parametrize(
    ("tags", "found"),
    [
        (
            {"FrameTimeVector": [0.0, 10.0, 10.0]},
            "FrameTimeVector has 3 values, NumberOfFrames is 5",
        ),
        (TWO, "FrameTime is 40 ms"),
        (
            {"FrameTime": 40.0, "FrameIncrementPointer": 0x00181065},
            "FrameTimeVector, which is missing",
        ),
    ],
)
def test_steps_of_time_that_contradict_are_named(tmp_path, tags, found):
    scan = scan_of(tmp_path, FRAMES, **tags)
    assert scan.times is None
    assert found in scan.times_fault


def test_frames_packed_as_rle_are_read_and_longer_ones_are_not(tmp_path):
    dataset = write_dicom(tmp_path / "a.dcm", FRAMES)
    dataset.compress(uid.RLELossless)
    dataset.save_as(tmp_path / "a.dcm")
    check_scan(read_dicom(tmp_path / "a.dcm"))
    first, _, *others = generate_frames(dataset.PixelData, number_of_frames=COUNT)
    dataset.PixelData = encapsulate([first, LONG_RLE, *others])
    dataset.save_as(tmp_path / "a.dcm")
    with pytest.raises(FrameError, match="damaged: more is packed in it"):
        read_dicom(tmp_path / "a.dcm")
