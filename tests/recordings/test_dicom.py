"""DICOM: single frames and stacks, their grey levels, scale and times."""

from io import BytesIO
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
from effects import less_than
from foreign_files import COUNT, FRAMES, pictures_of, sizes_of, write_dicom
from pydicom import uid
from pydicom.dataset import Dataset
from pydicom.encaps import encapsulate, generate_frames
from pydicom.sequence import Sequence

from scleraforce.base.errors import FrameError
from scleraforce.recordings.formats.dicom_files import read_dicom
from scleraforce.recordings.formats.image_files import read_frame, read_image
from scleraforce.recordings.formats.picture_streams import PictureSource

RAMP = np.arange(40 * 60, dtype=np.uint16).reshape(40, 60)
BYTES = RAMP.astype(np.uint8)
SIGNED = RAMP.astype(np.int16) - 1200
TWELVE = {"BitsStored": 12, "HighBit": 11}
COLOUR = {
    "SamplesPerPixel": 3,
    "PhotometricInterpretation": "RGB",
    "PlanarConfiguration": 0,
}


def item(**tags: object) -> Sequence:
    dataset = Dataset()
    for name, value in tags.items():
        setattr(dataset, name, value)
    return Sequence([dataset])


def each_frame(*items: Sequence) -> Sequence:
    """Return items, of one group each, as a sequence of frames."""
    return Sequence([item[0] for item in items])


def scan_of(folder: Path, pixels: np.ndarray, **tags: object) -> PictureSource:
    write_dicom(folder / "a.dcm", pixels, **tags)
    return read_dicom(folder / "a.dcm")


def frame_of(
    folder: Path, pixels: np.ndarray, **tags: object
) -> tuple[np.ndarray, str]:
    """Write and read one frame, and return it with its notes."""
    write_dicom(folder / "a.dcm", pixels, **tags)
    read, scan = read_image(folder / "a.dcm")
    return read, " ".join(scan.notes)


def test_palettes_and_colours_become_grey(tmp_path):
    table = np.arange(255, -1, -1, dtype=np.uint16) * 257
    tags = {
        f"{name}PaletteColorLookupTableData": table.tobytes()
        for name in ("Red", "Green", "Blue")
    }
    tags |= {
        f"{name}PaletteColorLookupTableDescriptor": [256, 0, 16]
        for name in ("Red", "Green", "Blue")
    }
    pixels, _ = frame_of(
        tmp_path, BYTES, PhotometricInterpretation="PALETTE COLOR", **tags
    )
    np.testing.assert_array_equal(pixels // 257, 255 - BYTES)
    colour = np.dstack([BYTES, BYTES // 2, 255 - BYTES])

    for planar in (0, 1):
        stored = np.moveaxis(colour, -1, 0) if planar else colour
        tags = COLOUR | {"PlanarConfiguration": planar}
        pixels, notes = frame_of(tmp_path, BYTES, PixelData=stored.tobytes(), **tags)
        np.testing.assert_array_equal(pixels, cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY))
        assert "colour became grey" in notes


DEFLATED = uid.DeflatedExplicitVRLittleEndian
LONG_RLE = np.array([1, 64, *[0] * 14], "<u4").tobytes() + bytes([129, 0]) * 400_000


def packed(syntax: str, *streams: bytes, **tags: object) -> dict[str, object]:
    return {"TransferSyntaxUID": syntax, "PixelData": encapsulate([*streams]), **tags}


def test_the_size_is_checked_before_memory_is_taken(tmp_path):
    for pixels, tags, message in [
        (RAMP, {"Rows": 60_000, "Columns": 60_000}, "a frame may have 64 million"),
        (RAMP, {"NumberOfFrames": 2_000_000}, "is 2000000, PixelData has 4,800 bytes"),
        (RAMP, {"SamplesPerPixel": 5000}, "with 5000 samples each"),
        (BYTES, packed(uid.RLELossless, LONG_RLE), "more is packed in it than"),
        (
            np.zeros((2000, 8000), np.uint16),
            {"TransferSyntaxUID": DEFLATED},
            "deflated DICOM.*save it uncompressed",
        ),
    ]:
        write_dicom(tmp_path / "a.dcm", pixels, **tags)
        content = (tmp_path / "a.dcm").read_bytes()
        with less_than(10e6), pytest.raises(FrameError, match=message):
            read_dicom(tmp_path / "a.dcm", content)


# PS3.5 8.1.1: BitsStored bits that end at HighBit.
def test_bits_are_taken_where_high_bit_says(tmp_path):
    for high, compressed in product((11, 13, 15), (False, True)):
        dataset = write_dicom(
            tmp_path / "a.dcm", RAMP << (high - 11), BitsStored=12, HighBit=high
        )
        if compressed:
            dataset.compress("1.2.840.10008.1.2.5")
            dataset.save_as(tmp_path / "a.dcm")

        pixels, scan = read_image(tmp_path / "a.dcm")
        np.testing.assert_array_equal(pixels, RAMP)
        assert any("HighBit" in note for note in scan.notes) is (high != 11)
        assert scan.bits == 12

    for pixels in (RAMP, SIGNED):
        written = write_dicom(tmp_path / "a.dcm", pixels, BitsStored=12, HighBit=15)
        dataset = Dataset()
        dataset.update(written)
        dataset.file_meta = written.file_meta
        dataset.file_meta.TransferSyntaxUID = uid.ExplicitVRBigEndian
        dataset.PixelData = (pixels << 4).astype(">i2").tobytes()
        dataset.save_as(tmp_path / "a.dcm", enforce_file_format=True)
        np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)


def test_signed_pixels_keep_their_sign(tmp_path):
    for pixels, tags in [
        (SIGNED, {}),
        (SIGNED, TWELVE),
        (SIGNED << 4, {"BitsStored": 12, "HighBit": 15}),
        ((SIGNED & 0xFFF).astype(np.int16), TWELVE),  # without an extended sign
        (-SIGNED, {"PhotometricInterpretation": "MONOCHROME1"}),
    ]:
        scan = scan_of(tmp_path, pixels, **tags)
        np.testing.assert_array_equal(pictures_of(scan)[0], SIGNED)
        assert scan.bits is None
        # a frame alone begins at zero
        np.testing.assert_array_equal(read_frame(tmp_path / "a.dcm"), RAMP)


def test_bright_tissue_stays_bright(tmp_path):
    for signed, slope, display in product(
        (False, True), (1.0, -2.0), ("", "MONOCHROME1", "INVERSE")
    ):
        dark_is_large = (slope < 0.0) != bool(display)
        dark = 4095 - RAMP if dark_is_large else RAMP
        tags = {"RescaleSlope": slope, "RescaleIntercept": 4095.0} | TWELVE

        if display:
            tags[
                (
                    "PhotometricInterpretation"
                    if display == "MONOCHROME1"
                    else "PresentationLUTShape"
                )
            ] = display

        pixels, notes = frame_of(
            tmp_path, dark.astype(np.int16) - 2048 if signed else dark, **tags
        )
        np.testing.assert_array_equal(pixels, RAMP)
        assert ("were exchanged" in notes) is dark_is_large
        assert ("cancel" in notes) is (slope < 0.0 and bool(display))

    shared = item(
        PixelValueTransformationSequence=item(RescaleSlope=-1.0, RescaleIntercept=0.0)
    )
    scan = scan_of(tmp_path, 65535 - FRAMES, SharedFunctionalGroupsSequence=shared)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)


def test_what_is_not_read_is_refused_by_its_field(tmp_path):
    slopes = [
        item(PixelValueTransformationSequence=item(RescaleSlope=slope))
        for slope in (1.0, -1.0)
    ]
    for pixels, tags, found in [
        *(
            (BYTES, {"PhotometricInterpretation": kind}, "one of MONOCHROME1")
            for kind in ("HSV", "CMYK", "")
        ),
        (
            RAMP,
            {
                "PhotometricInterpretation": "MONOCHROME1",
                "PresentationLUTShape": "INVERSE",
            },
            "MONOCHROME1 .*ERSE",
        ),
        (RAMP, {"PresentationLUTShape": "LIN OD"}, "PresentationLUTShape: LIN OD"),
        (RAMP, {"RescaleSlope": 0.0}, "RescaleSlope: 0"),
        *(
            (
                RAMP,
                {f"{kind}LUTSequence": item(LUTExplanation="x")},
                f"{kind}LUTSequence",
            )
            for kind in ("Modality", "VOI", "Presentation")
        ),
        (RAMP, {"FloatPixelData": bytes(4 * 40 * 60)}, "FloatPixelData"),
        *(
            (RAMP, {"TimezoneOffsetFromUTC": zone}, "TimezoneOffsetFromUTC")
            for zone in ("+9900", "1 h")
        ),
        (
            FRAMES[:2],
            {"PerFrameFunctionalGroupsSequence": each_frame(*slopes)},
            "1, 0 of frame 1 and -1, 0 of frame 2",
        ),
        *(
            (RAMP, tags, r"BitsAllocated \d+, BitsStored \d+, HighBit \d+")
            for tags in (
                {**TWELVE, "HighBit": 16},
                {**TWELVE, "HighBit": 8},
                {"BitsAllocated": 12},
            )
        ),
        (RAMP + 2000, TWELVE, "BitsStored is 12, HighBit 11, but a pixel is 0x"),
        (
            RAMP,
            {**TWELVE, "HighBit": 15},
            "BitsStored is 12, HighBit 15, but a pixel is 0x",
        ),
        (
            RAMP.astype(np.int16) + 2500,
            TWELVE,
            "BitsStored is 12, HighBit 11, but a pixel is 0x",
        ),
        *(
            (
                BYTES,
                {
                    **COLOUR,
                    "SamplesPerPixel": samples,
                    "PhotometricInterpretation": kind,
                    "PixelData": bytes(40 * 60 * samples),
                },
                f"SamplesPerPixel {samples}, Photo.* {kind}",
            )
            for kind, samples in (("MONOCHROME2", 3), ("RGB", 1), ("PALETTE COLOR", 3))
        ),
        *(
            (
                FRAMES,
                {"NumberOfFrames": stated},
                rf"NumberOfFrames is {stated}, PixelData has .* 5 frames",
            )
            for stated in (1, 3, 6)
        ),
    ]:
        with pytest.raises(FrameError, match=rf"a\.dcm: .*{found}"):
            pictures_of(scan_of(tmp_path, pixels, **tags))

    dataset = write_dicom(tmp_path / "a.dcm", FRAMES)
    del dataset.Rows, dataset.BitsStored
    dataset.save_as(tmp_path / "a.dcm")

    with pytest.raises(
        FrameError,
        match=r"a\.dcm: a DICOM file without Rows, BitsStored; export it anew",
    ):
        read_dicom(tmp_path / "a.dcm")


def test_padding_is_as_dark_as_the_darkest_pixel(tmp_path):
    for sign, limit in product((1, -1), (None, -2998)):
        padded = sign * (RAMP.astype(np.int16) - 1000)
        padded[:5] = -3000
        tags = {"PixelPaddingValue": -3000} | (
            {} if limit is None else {"PixelPaddingRangeLimit": limit}
        )
        kind = "MONOCHROME2" if sign > 0 else "MONOCHROME1"
        pixels, notes = frame_of(
            tmp_path, padded, PhotometricInterpretation=kind, **tags
        )
        np.testing.assert_array_equal(pixels[5:], RAMP[5:] - RAMP[5, 0])
        assert (pixels[:5] == 0).all()
        assert "PixelPaddingValue -3000" in notes

    padded = RAMP + 100
    padded[:5] = 0
    np.testing.assert_array_equal(
        frame_of(tmp_path, padded, PixelPaddingValue=0)[0], padded
    )


def groups(kind: str, *spacings: list[float]) -> dict[str, Sequence]:
    """Return the functional groups, "Shared" or "PerFrame", of a spacing each."""
    each = [
        item(PixelMeasuresSequence=item(PixelSpacing=spacing)) for spacing in spacings
    ]
    return {f"{kind}FunctionalGroupsSequence": each_frame(*each)}


SIZE = pytest.approx((4e-6, 12.5e-6))


def test_two_scales_in_one_file_are_named_and_give_none_and_one_that_is_stated_twice_is_read(
    tmp_path,
):
    one = {"PixelSpacing": [0.004, 0.0125]}
    for tags, found in [
        (one | groups("Shared", [0.01, 0.02]), "0.01 x 0.02 mm"),
        (one | groups("PerFrame", [0.004, 0.02]), "PixelSpacing of frame 1"),
        (one | {"ImagerPixelSpacing": [0.005, 0.0125]}, "ImagerPixelSpacing"),
        (
            one | {"NominalScannedPixelSpacing": [0.1, 0.1]},
            "NominalScannedPixelSpacing",
        ),
        (
            groups("Shared", [0.004, 0.0125]) | groups("PerFrame", [0.01, 0.02]),
            "0.01 x 0.02 mm",
        ),
        (groups("PerFrame", [0.004, 0.0125], [0.004, 0.02]), "PixelSpacing of frame 2"),
        (one | {"PixelAspectRatio": [1, 2]}, "PixelAspectRatio 1:2"),
        (one | {"PixelAspectRatio": [1, 1]}, "PixelAspectRatio 1:1"),
    ]:
        scan = scan_of(tmp_path, RAMP, **tags)
        assert sizes_of(scan) == (None, None)
        assert {"0.004 x 0.0125 mm" in scan.scale_fault, found in scan.scale_fault} == {
            True
        }

    for tags, size in [
        (
            one
            | groups("Shared", [0.004, 0.0125])
            | groups("PerFrame", [0.004, 0.0125], [0.004, 0.0125]),
            SIZE,
        ),
        (one | {"PixelAspectRatio": [8, 25]}, SIZE),
        ({"PixelAspectRatio": [1, 2]}, (None, None)),
        ({}, (None, None)),
    ]:
        scan = scan_of(tmp_path, RAMP, **tags)
        assert (scan.times, scan.scale_fault, sizes_of(scan)) == (None, None, size)


def test_compressed_images_of_another_type_than_the_header_are_refused_by_field(
    tmp_path,
):
    streams = [BytesIO() for _ in range(4)]
    for held, pixels in zip(streams, (RAMP, RAMP + 2000, BYTES, BYTES), strict=True):
        j2k = {"format": "JPEG2000", "irreversible": False, "no_jp2": True}
        options = j2k if held is not streams[3] else {"format": "JPEG", "quality": 100}
        pytest.importorskip("PIL.Image").fromarray(pixels).save(held, **options)

    large = cv2.imencode(".jpg", np.zeros((400, 600), np.uint8))[1].tobytes()
    stream, bright, dim, small = (held.getvalue() for held in streams)

    for tags in ({}, TWELVE):
        np.testing.assert_array_equal(
            frame_of(tmp_path, RAMP, **packed(uid.JPEG2000Lossless, stream), **tags)[0],
            RAMP,
        )

    extended = {"TransferSyntaxUID": uid.JPEGExtended12Bit}
    pixels, _ = frame_of(tmp_path, BYTES, **packed(uid.JPEGExtended12Bit, small))
    assert np.abs(pixels.astype(int) - BYTES).max() <= 2
    at = small.index(b"\xff\xc0")
    twelve = (
        small[: at + 1]
        + b"\xc1"
        + small[at + 2 : at + 4]
        + bytes([12])
        + small[at + 5 :]
    )

    for sent, pixels, tags, found in [
        (
            [stream],
            RAMP,
            {"PixelRepresentation": 1},
            r"is 1 \(signed\), its JPEG 2000 image has unsigned pixels",
        ),
        ([bright], RAMP, TWELVE, "BitsStored is 12, HighBit 11, but a pixel is 0x"),
        ([dim], RAMP, {}, "BitsStored is 16, its JPEG 2000 image has 8 bits"),
        (
            [stream],
            RAMP,
            {"BitsStored": 12},
            "HighBit is 15, BitsStored 12, .* compressed as JPEG 2000",
        ),
        ([twelve], RAMP, TWELVE | extended, "JPEG Extended' for samples with 12-bit"),
        ([large], BYTES, {"TransferSyntaxUID": uid.JPEGBaseline8Bit}, "damaged"),
        (
            [small] * 3,
            BYTES,
            {"TransferSyntaxUID": uid.JPEGBaseline8Bit},
            "is 1, PixelData has 3 compressed images",
        ),
    ]:
        with pytest.raises(FrameError, match=found):
            frame_of(tmp_path, pixels, **packed(uid.JPEG2000Lossless, *sent) | tags)


def test_lossless_jpegs_of_all_kinds_are_read(tmp_path):
    gdcm = pytest.importorskip("gdcm")
    types = {
        "70": gdcm.TransferSyntax.JPEGLosslessProcess14_1,
        "80": gdcm.TransferSyntax.JPEGLSLossless,
        "90": gdcm.TransferSyntax.JPEG2000Lossless,
    }

    for syntax, stored, least in product(types, (13, 16), (0, -2400)):
        # GDCM writes one signed frame alone
        frames = FRAMES if least == 0 else FRAMES[1:2].astype(np.int16) + least
        tags = {"SOPClassUID": "1.2.840.10008.5.1.4.1.1.7", "SOPInstanceUID": "1.2.3"}
        write_dicom(
            tmp_path / "a.dcm",
            frames.squeeze(),
            BitsStored=stored,
            HighBit=stored - 1,
            **tags,
        )
        reader = gdcm.ImageReader()
        change = gdcm.ImageChangeTransferSyntax()
        writer = gdcm.ImageWriter()
        reader.SetFileName(str(tmp_path / "a.dcm"))
        assert reader.Read()
        change.SetTransferSyntax(gdcm.TransferSyntax(types[syntax]))
        change.SetInput(reader.GetImage())
        assert change.Change()
        writer.SetFileName(str(tmp_path / "b.dcm"))
        writer.SetFile(reader.GetFile())
        writer.SetImage(change.GetOutput())
        assert writer.Write()
        np.testing.assert_array_equal(
            pictures_of(read_dicom(tmp_path / "b.dcm")), frames
        )


def test_ophthalmic_tomography_has_upright_frames_scale_and_the_time_of_each_in_its_zone(
    tmp_path,
):
    moments = [
        "20260102030405.000",
        "20260102030405.250",
        "20260102030405.500",
        "20260102030406",
        "20260102030407.5",
    ]
    frames = [
        item(FrameContentSequence=item(FrameReferenceDateTime=moment))
        for moment in moments
    ]
    scan = scan_of(
        tmp_path,
        FRAMES,
        SOPClassUID="1.2.840.10008.5.1.4.1.1.77.1.5.4",
        BitsStored=13,
        HighBit=12,
        PerFrameFunctionalGroupsSequence=each_frame(*frames),
        **groups("Shared", [0.004, 0.015]),
    )
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert (scan.bits, sizes_of(scan)) == (13, pytest.approx((4e-6, 15e-6)))
    np.testing.assert_allclose(
        scan.times.time_s - scan.times.time_s[0], [0.0, 0.25, 0.5, 1.0, 2.5], atol=1e-6
    )
    assert scan.times.time_s[0] == 1767323045.0  # 2026-01-02 03:04:05 UTC
    maker = {
        "Manufacturer": "Carl Zeiss Meditec",
        "ManufacturerModelName": "1000",
        "PixelSpacing": [0.015, 0.004],
    }
    # it writes A-scans along the rows
    turned = scan_of(tmp_path, FRAMES.swapaxes(1, 2).copy(), **maker)
    np.testing.assert_array_equal(pictures_of(turned), FRAMES)
    assert sizes_of(turned) == sizes_of(scan)

    for stated, zone, shift_s in [
        ("", "", 0),
        ("", "+0100", -3600),
        ("", "-0530", 19800),
        ("+0100", "-0500", -3600),
    ]:
        tags = {"TimezoneOffsetFromUTC": zone} if zone else {}
        scan = scan_of(
            tmp_path, RAMP, AcquisitionDateTime=f"20260102030405.5{stated}", **tags
        )
        assert scan.times.time_s[0] == 1767323045.5 + shift_s


def test_steps_of_time_are_added_up_and_contradictions_named(tmp_path):
    two = {"FrameTime": 40.0, "FrameTimeVector": [0.0, 10.0, 10.0, 10.0, 10.0]}
    for tags, time_s in [
        ({"FrameTime": 40.0}, [0.0, 0.04, 0.08, 0.12, 0.16]),
        (
            {"FrameTimeVector": [0.0, 10.0, 20.0, 10.0, 5.0]},
            [0.0, 0.01, 0.03, 0.04, 0.045],
        ),
        (
            {"FrameTimeVector": [7.0, 10.0, 20.0, 10.0, 5.0]},
            [0.0, 0.01, 0.03, 0.04, 0.045],
        ),
        (two | {"FrameIncrementPointer": 0x00181063}, [0.0, 0.04, 0.08, 0.12, 0.16]),
        (two | {"FrameIncrementPointer": 0x00181065}, [0.0, 0.01, 0.02, 0.03, 0.04]),
    ]:
        np.testing.assert_allclose(
            scan_of(tmp_path, FRAMES, **tags).times.time_s, time_s
        )

    for tags, found in [
        (
            {"FrameTimeVector": [0.0, 10.0, 10.0]},
            "FrameTimeVector has 3 values, NumberOfFrames is 5",
        ),
        (two, "FrameTime is 40 ms"),
        (
            {"FrameTime": 40.0, "FrameIncrementPointer": 0x00181065},
            "FrameTimeVector, which is missing",
        ),
    ]:
        scan = scan_of(tmp_path, FRAMES, **tags)
        assert scan.times is None
        assert found in scan.times_fault


def test_frames_packed_as_rle_are_read_and_longer_ones_are_not(tmp_path):
    dataset = write_dicom(tmp_path / "a.dcm", FRAMES)
    dataset.compress(uid.RLELossless)
    dataset.save_as(tmp_path / "a.dcm")
    np.testing.assert_array_equal(pictures_of(read_dicom(tmp_path / "a.dcm")), FRAMES)
    first, _, *others = generate_frames(dataset.PixelData, number_of_frames=COUNT)
    dataset.PixelData = encapsulate([first, LONG_RLE, *others])
    dataset.save_as(tmp_path / "a.dcm")

    with pytest.raises(FrameError, match="damaged: more is packed in it"):
        read_dicom(tmp_path / "a.dcm")
