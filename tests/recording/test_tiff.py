"""TIFF: single frames and stacks, their grey levels, scale and times."""

import io
import json
import struct
import zlib
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from zlib import crc32

import cv2
import numpy as np
import pytest
import tifffile
from effects import less_than
from foreign_files import COLUMNS, COUNT, DEPTH_M, FRAMES, LATERAL_M, ROWS, pictures_of, sizes_of

from scleraforce.errors import FrameError
from scleraforce.recording.folder import Scanner, read_scaled_frame
from scleraforce.recording.images import read_frame, read_image
from scleraforce.recording.pixels import as_shown, find_greys
from scleraforce.recording.scan import joined
from scleraforce.recording.tiff import read_tiff

RAMP = np.arange(40 * 60, dtype=np.uint16).reshape(40, 60)
BYTES = RAMP.astype(np.uint8)


def test_white_is_zero_is_turned_round(tmp_path: Path) -> None:
    for pixels, top in [(BYTES, 255), (RAMP, 65535)]:
        tifffile.imwrite(tmp_path / "a.tif", top - pixels, photometric="miniswhite")
        np.testing.assert_array_equal(read_frame(tmp_path / "a.tif"), pixels)


def test_a_palette_gives_the_colours_that_it_stands_for(tmp_path: Path) -> None:
    for factor in [257, 256, 1]:
        colormap = np.tile(np.arange(255, -1, -1, dtype=np.uint16) * factor, (3, 1))
        tifffile.imwrite(tmp_path / "a.tif", BYTES, photometric="palette", colormap=colormap)
        np.testing.assert_array_equal(read_frame(tmp_path / "a.tif"), 255 - BYTES)


def test_a_palette_of_a_png_gives_the_colours_that_it_stands_for(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    picture = image.frombytes("P", (60, 40), BYTES.tobytes())
    picture.putpalette([255 - level for level in range(256) for _ in range(3)])
    picture.save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_frame(tmp_path / "a.png"), 255 - BYTES)


def test_colours_in_planes_are_read_as_colours(tmp_path: Path) -> None:
    colour = np.stack([BYTES, BYTES // 2, 255 - BYTES])
    tifffile.imwrite(tmp_path / "a.tif", colour, photometric="rgb", planarconfig="separate")
    expected = cv2.cvtColor(np.moveaxis(colour, 0, -1), cv2.COLOR_RGB2GRAY)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.tif"), expected)


def test_a_kind_that_is_no_grey_is_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((40, 60, 4), np.uint8), photometric="separated")
    with pytest.raises(FrameError, match="of kind SEPARATED; save it as grey"):
        read_frame(tmp_path / "a.tif")


def test_a_compression_that_needs_a_package_is_no_damage(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.tif"), BYTES, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    with pytest.raises(FrameError, match=r"a\.tif: compressed as LZW; save it without compression, .* imagecodecs"):
        read_frame(tmp_path / "a.tif")


OME = {"axes": "YX", "PhysicalSizeX": 0.02, "PhysicalSizeXUnit": "mm", "PhysicalSizeY": 7.0}


def test_a_scale_is_taken_from_the_tags(tmp_path: Path) -> None:
    for options in [
        {"resolution": (1e4 / 20, 1e4 / 7), "resolutionunit": "CENTIMETER"},
        {"resolution": (25400 / 20, 25400 / 7), "resolutionunit": "INCH"},
        {"resolution": (1 / 20, 1 / 7), "imagej": True, "metadata": {"unit": "um"}},
        {"resolution": (1 / 20, 1 / 7), "imagej": True, "metadata": {"unit": "\\u00B5m", "spacing": 3.0}},
        {"resolution": (50.0, 1e3 / 7), "imagej": True, "metadata": {"unit": "mm"}},
        {"ome": True, "metadata": OME},
    ]:
        tifffile.imwrite(tmp_path / "a.tif", RAMP, **options)
        _, image = read_image(tmp_path / "a.tif")
        assert sizes_of(image) == pytest.approx((7e-6, 20e-6), rel=1e-4)


def test_dots_of_a_screen_or_printer_and_a_number_without_unit_are_no_scale(tmp_path: Path) -> None:
    for options in [
        {},
        {"resolution": (100.0, 100.0), "resolutionunit": "NONE"},
        {"resolution": (1 / 20, 1 / 7), "imagej": True, "metadata": {"unit": "pixel"}},
        {"resolution": (72, 72), "imagej": True, "metadata": {"unit": "inch"}},
        {"ome": True, "metadata": {"axes": "YX"}},
        *({"resolution": (dots, dots), "resolutionunit": "INCH"} for dots in (72, 96, 300, 1200)),
        {"resolution": (28.35, 28.35), "resolutionunit": "CENTIMETER"},
    ]:
        tifffile.imwrite(tmp_path / "a.tif", RAMP, **options)
        _, image = read_image(tmp_path / "a.tif")
        assert sizes_of(image) == (None, None)


def tiff(rows: int, columns: int, strip: bytes, compression: int = 8, **tags: int) -> bytes:
    """Return a TIFF of 8 bits with one strip, whatever its tags say."""
    values = {256: columns, 257: rows, 258: 8, 259: compression, 262: 1, 273: 8, 277: 1, 278: rows, 279: len(strip)}
    values |= {int(name.removeprefix("tag")): value for name, value in tags.items()}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(values.items()))
    begin = struct.pack("<2sHI", b"II", 42, 8 + len(strip))
    return begin + strip + struct.pack("<H", len(values)) + entries + bytes(4)


def test_the_size_is_checked_before_memory_is_taken(tmp_path: Path) -> None:
    for content, message in [
        (tiff(60_000, 60_000, zlib.compress(bytes(100))), "60000 x 60000 pixels; a frame may have 64 million"),
        (tiff(64, 64, zlib.compress(bytes(100)), tag277=60_000), "with 60000 samples each; a frame may have"),
        (tiff(64, 64, zlib.compress(bytes(50_000_000))), "more is packed in it than"),
        (tiff(64, 64, bytes([129, 0]) * 400_000, compression=32773), "more is packed in it than"),
    ]:
        tifffile.TiffFile(io.BytesIO(content)).close()  # what is wrong is not that it is no TIFF
        with less_than(10e6), pytest.raises(FrameError, match=message):
            read_tiff(tmp_path / "a.tif", content)


def test_what_a_test_packs_by_hand_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.tif").write_bytes(tiff(40, 60, zlib.compress(BYTES.tobytes())))
    np.testing.assert_array_equal(read_frame(tmp_path / "a.tif"), BYTES)


SMALL_RAMP = np.arange(24 * 40, dtype=np.uint16).reshape(24, 40)

# Where the stored row 0 and column 0 lie in the picture as it is shown (TIFF 6.0, Orientation).
STORED: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    1: lambda shown: shown,
    2: lambda shown: shown[:, ::-1],
    3: lambda shown: shown[::-1, ::-1],
    4: lambda shown: shown[::-1],
    5: lambda shown: shown.T,
    6: lambda shown: np.rot90(shown),
    7: lambda shown: shown[::-1, ::-1].T,
    8: lambda shown: np.rot90(shown, -1),
}


def turned(path: Path, orientation: int, shown: np.ndarray, **options: object) -> None:
    stored = np.ascontiguousarray(STORED[orientation](shown))
    tag = [(274, 3, 1, orientation, True)]
    tifffile.imwrite(path, stored, photometric="minisblack", extratags=tag, metadata=None, **options)


def test_a_tiff_is_shown_as_its_orientation_says_with_its_scale(tmp_path: Path) -> None:
    for orientation in STORED:
        columns_um, rows_um = (15, 4) if orientation < 5 else (4, 15)  # of a pixel as stored
        resolution = {"resolution": (1e4 / columns_um, 1e4 / rows_um), "resolutionunit": "CENTIMETER"}
        turned(tmp_path / "a.tif", orientation, SMALL_RAMP, **resolution)
        pixels, image = read_image(tmp_path / "a.tif")
        np.testing.assert_array_equal(pixels, SMALL_RAMP)
        assert sizes_of(image) == pytest.approx((4e-6, 15e-6))
        assert any(f"Orientation {orientation}" in note for note in image.notes) is (orientation != 1)
        scan = read_tiff(tmp_path / "a.tif")
        np.testing.assert_array_equal(pictures_of(scan)[0], SMALL_RAMP)


def test_all_pages_of_a_stack_are_turned(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for frame in FRAMES:
            writer.write(frame[::-1].copy(), metadata=None, extratags=[(274, 3, 1, 4, True)])
    np.testing.assert_array_equal(pictures_of(read_tiff(tmp_path / "a.tif")), FRAMES)


def test_orientations_that_cannot_be_are_refused(tmp_path: Path) -> None:
    for several in [(1, 4), (9, 9)]:
        with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
            for orientation in several:
                writer.write(SMALL_RAMP, metadata=None, extratags=[(274, 3, 1, orientation, True)])
        with pytest.raises(FrameError, match=rf"Orientation {several[0]}"):
            read_tiff(tmp_path / "a.tif")


def test_white_is_zero_of_any_type_is_turned_round(tmp_path: Path) -> None:
    for kind in ["u1", "u2", "u4", "u8", "i1", "i2", "i4", "f4", "f8"]:
        dark = (FRAMES % 100).astype(kind) - (50 if kind[0] in "if" else 0)
        tifffile.imwrite(tmp_path / "a.tif", dark.astype(kind), photometric="miniswhite")
        scan = read_tiff(tmp_path / "a.tif")
        greys = find_greys(scan.pictures(), None, "a")
        counts = np.stack([greys.counts(picture) for picture in scan.pictures()])
        assert counts[dark == dark.min()].min() == counts.max()
        assert counts[dark == dark.max()].max() == counts.min()
        assert any("WhiteIsZero" in note for note in scan.notes)


def test_imagej_stacks_behind_one_page_are_turned_round_too(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", 65535 - FRAMES, imagej=True, metadata={"axes": "ZYX"})
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
        file.pages.first.tags["PhotometricInterpretation"].overwrite(0)
        place = file.pages.first.offset
    data = bytearray((tmp_path / "a.tif").read_bytes())
    count = int.from_bytes(data[place : place + 2], "little")
    data[place + 2 + 12 * count : place + 6 + 12 * count] = bytes(4)  # no next page
    (tmp_path / "a.tif").write_bytes(data)
    np.testing.assert_array_equal(pictures_of(read_tiff(tmp_path / "a.tif")), FRAMES)


# ImageJ reads the resolution in its own unit, whatever ResolutionUnit says, but for um beside centimetres.
def test_imagejs_unit_takes_precedence_as_in_imagej(tmp_path: Path) -> None:
    for resolution_unit in ["NONE", "INCH", "CENTIMETER"]:
        for unit, in_mm in [("mm", 1.0), ("\\u00B5m", 1e-3), ("\\u00b5m", 1e-3), ("\\u03BCm", 1e-3), ("micron", 1e-3)]:
            resolution = (in_mm / 0.015, in_mm / 0.004)
            metadata = {"unit": unit}
            tifffile.imwrite(
                tmp_path / "a.tif",
                SMALL_RAMP,
                imagej=True,
                resolution=resolution,
                resolutionunit=resolution_unit,
                metadata=metadata,
            )
            _, image = read_image(tmp_path / "a.tif")
            assert sizes_of(image) == pytest.approx((4e-6, 15e-6), rel=1e-4)
            assert any("ResolutionUnit" in note for note in image.notes) is (resolution_unit != "NONE")


def without_resolution_unit(path: Path) -> None:
    """Give the tag ResolutionUnit of a TIFF a number of no meaning."""
    data, tag = path.read_bytes(), np.array([296, 3], "<u2").tobytes()
    assert data.count(tag) == 1
    path.write_bytes(data.replace(tag, np.array([299, 3], "<u2").tobytes()))


def test_imagejs_unit_alone_is_no_contradiction(tmp_path: Path) -> None:
    options = {"resolution": (1 / 0.015, 1 / 0.004), "metadata": {"unit": "mm"}}
    tifffile.imwrite(tmp_path / "a.tif", SMALL_RAMP, imagej=True, byteorder="<", **options)
    without_resolution_unit(tmp_path / "a.tif")
    _, image = read_image(tmp_path / "a.tif")
    assert sizes_of(image) == pytest.approx((4e-6, 15e-6), rel=1e-4)
    assert image.notes == ()


def test_um_beside_centimetres_is_per_centimetre_as_in_imagej(tmp_path: Path) -> None:
    options = {"resolution": (1e4 / 15, 1e4 / 4), "resolutionunit": "CENTIMETER", "metadata": {"unit": "um"}}
    tifffile.imwrite(tmp_path / "a.tif", SMALL_RAMP, imagej=True, **options)
    _, image = read_image(tmp_path / "a.tif")
    assert sizes_of(image) == pytest.approx((4e-6, 15e-6), rel=1e-4)
    assert any("ResolutionUnit counts" in note for note in image.notes)


def test_imagejs_second_unit_is_that_of_rows(tmp_path: Path) -> None:
    metadata = {"unit": "mm", "yunit": "um"}
    tifffile.imwrite(tmp_path / "a.tif", SMALL_RAMP, imagej=True, resolution=(1 / 0.015, 1 / 4), metadata=metadata)
    _, image = read_image(tmp_path / "a.tif")
    assert sizes_of(image) == pytest.approx((4e-6, 15e-6), rel=1e-4)


def ome(unit: str, size_t: int = 5) -> bytes:
    return (
        '<?xml version="1.0" encoding="UTF-8"?><o:OME xmlns:o="http://www.openmicroscopy.org/Schemas/OME/2016-06">'
        '<o:Image ID="Image:0"><o:Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="40" SizeY="24" '
        f'SizeZ="1" SizeC="1" SizeT="{size_t}" PhysicalSizeX="15" PhysicalSizeXUnit=\'{unit}\' PhysicalSizeY="4" '
        f'PhysicalSizeYUnit="{unit}"><o:TiffData/></o:Pixels></o:Image></o:OME>'
    ).encode()


def test_omes_unit_is_read_however_xml_writes_it(tmp_path: Path) -> None:
    for unit in ["&#181;m", "&#xb5;m", "&#956;m", "µm", "\u03bcm", "um", "micrometer"]:
        tifffile.imwrite(tmp_path / "a.tif", FRAMES, description=ome(unit), metadata=None, photometric="minisblack")
        scan = read_tiff(tmp_path / "a.tif")
        assert (scan.depth_pixel_m.value, scan.lateral_pixel_m.value) == pytest.approx((4e-6, 15e-6))


def test_frames_that_ome_or_imagej_state_and_pages_must_agree(tmp_path: Path) -> None:
    for stated in [3, 6]:
        options = {"metadata": None, "photometric": "minisblack"}
        tifffile.imwrite(tmp_path / "a.tif", FRAMES, description=ome("um", stated), **options)
        with pytest.raises(FrameError, match=f"OME-XML states {stated} frames, the file has 5 pages"):
            read_tiff(tmp_path / "a.tif")
        tifffile.imwrite(tmp_path / "b.tif", FRAMES, description=f"ImageJ=1.53t\nimages={stated}\n", **options)
        with pytest.raises(FrameError, match=f"{stated}.* the file has 5"):
            read_tiff(tmp_path / "b.tif")


def test_a_unit_that_is_not_known_is_named_and_gives_no_scale(tmp_path: Path) -> None:
    for description in [ome("parsec"), b"ImageJ=1.53t\nunit=parsec\n"]:
        options = {"metadata": None, "photometric": "minisblack", "resolution": (1 / 15, 1 / 4)}
        tifffile.imwrite(tmp_path / "a.tif", FRAMES, description=description, resolutionunit="NONE", **options)
        scan = read_tiff(tmp_path / "a.tif")
        assert (scan.depth_pixel_m, scan.lateral_pixel_m) == (None, None)
        assert any("parsec" in note for note in scan.notes)


def test_ome_and_resolution_tags_that_differ_are_refused_unless_options_give_the_scale(tmp_path: Path) -> None:
    tags = {"resolution": (1e4 / 10, 1e4 / 4), "resolutionunit": "CENTIMETER"}
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, SMALL_RAMP, description=ome("um", 1), metadata=None, **tags)
    with pytest.raises(
        FrameError, match=r"OME states .*0\.004 x 0\.015 mm.*XResolution.*0\.004 x 0\.01 mm.*--width-mm"
    ):
        read_scaled_frame(path, Scanner(width_m=6e-3), (Scanner(depth_m=4e-3), "assumed"))
    frame = read_scaled_frame(path, Scanner(width_m=6e-3, depth_m=2e-3), (Scanner(), ""))
    assert (frame.width_m.value, frame.depth_m.value) == (6e-3, 2e-3)
    assert any("OME states" in note for note in frame.notes)


def test_pages_of_several_scales_are_refused(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for size_um in (15, 10):
            writer.write(SMALL_RAMP, metadata=None, resolution=(1e4 / size_um, 1e4 / 4), resolutionunit="CENTIMETER")
    fault = read_tiff(tmp_path / "a.tif").scale_fault
    assert "0.004 x 0.015 mm" in fault
    assert "0.004 x 0.01 mm" in fault


def test_a_resolution_without_a_unit_is_per_inch_and_that_is_said(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", SMALL_RAMP, metadata=None, resolution=(25400 / 15, 25400 / 4))
    without_resolution_unit(tmp_path / "a.tif")
    _, image = read_image(tmp_path / "a.tif")
    assert sizes_of(image) == pytest.approx((4e-6, 15e-6), rel=1e-4)
    assert any("no ResolutionUnit" in note for note in image.notes)


def test_smaller_copies_are_left_out_and_that_is_said(tmp_path: Path) -> None:
    for inner in [True, False]:
        with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
            writer.write(SMALL_RAMP, subifds=1 if inner else None)
            writer.write(SMALL_RAMP[::2, ::2], subfiletype=1)
        pixels, image = read_image(tmp_path / "a.tif")
        np.testing.assert_array_equal(pixels, SMALL_RAMP)
        assert any("smaller copies" in note for note in image.notes)


def test_pages_that_are_marked_as_copies_but_no_smaller_are_frames(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        for nth, frame in enumerate(FRAMES):
            writer.write(frame, metadata=None, subfiletype=int(nth > 0))
    np.testing.assert_array_equal(pictures_of(read_tiff(tmp_path / "a.tif")), FRAMES)


def test_several_channels_that_are_no_colour_are_refused(tmp_path: Path) -> None:
    for samples in [2, 3, 4]:
        pixels = np.zeros((24, 40, samples), np.uint8)
        tifffile.imwrite(tmp_path / "a.tif", pixels, photometric="minisblack", planarconfig="contig")
        with pytest.raises(FrameError, match=f"SamplesPerPixel {samples}, PhotometricInterpretation MINISBLACK"):
            read_frame(tmp_path / "a.tif")


def test_differences_between_pixels_are_undone_and_those_of_floats_refused_by_name(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", SMALL_RAMP, compression="zlib", predictor=True)
    np.testing.assert_array_equal(read_frame(tmp_path / "a.tif"), SMALL_RAMP)
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
        file.pages.first.tags["Predictor"].overwrite(3)
    with pytest.raises(FrameError, match=r"Predictor is FLOATINGPOINT.*imagecodecs"):
        read_frame(tmp_path / "a.tif")


def test_signed_tiff_is_shifted_to_start_at_zero_and_that_is_said(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", SMALL_RAMP.astype(np.int16) - 500)
    pixels, image = read_image(tmp_path / "a.tif")
    np.testing.assert_array_equal(pixels, SMALL_RAMP)
    assert any("500 was added" in note for note in image.notes)


def exif(orientation: int, order: str) -> bytes:
    kind = {"<": b"II*\0\x08\0\0\0", ">": b"MM\0*\0\0\0\x08"}[order]
    entry = np.array([274, 3], f"{order}u2").tobytes() + np.array([1], f"{order}u4").tobytes()
    value = np.array([orientation, 0], f"{order}u2").tobytes()
    return kind + np.array([1], f"{order}u2").tobytes() + entry + value + bytes(4)


def with_exif(picture: np.ndarray, ending: str, orientation: int, order: str) -> bytes:
    """Encode a picture as PNG or JPEG with an EXIF orientation."""
    data = cv2.imencode(ending, np.ascontiguousarray(picture), [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    held = exif(orientation, order)
    if ending == ".jpg":
        body = b"Exif\0\0" + held
        return data[:2] + b"\xff\xe1" + (len(body) + 2).to_bytes(2, "big") + body + data[2:]
    chunk = b"eXIf" + held
    return data[:33] + len(held).to_bytes(4, "big") + chunk + crc32(chunk).to_bytes(4, "big") + data[33:]


def test_pictures_are_shown_as_their_exif_says(tmp_path: Path) -> None:
    for ending in [".png", ".jpg"]:
        for order in ["<", ">"]:
            for orientation in STORED:
                shown = np.add.outer(np.arange(48) * 2, np.arange(64)).astype(np.uint8)
                path = tmp_path / f"a{ending}"
                path.write_bytes(with_exif(STORED[orientation](shown), ending, orientation, order))
                pixels, image = read_image(path)
                assert pixels.shape == shown.shape
                assert np.abs(pixels.astype(int) - shown).max() <= 2
                assert any("Orientation" in note for note in image.notes) is (orientation != 1)


def test_an_orientation_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(with_exif(np.zeros((40, 40), np.uint8), ".jpg", 9, "<"))
    with pytest.raises(FrameError, match="EXIF Orientation 9"):
        read_frame(tmp_path / "a.jpg")


def test_transparency_is_left_out_and_that_is_said(tmp_path: Path) -> None:
    colour = np.dstack([np.full((40, 60), 90, np.uint8)] * 3 + [np.full((40, 60), 7, np.uint8)])
    cv2.imwrite(str(tmp_path / "a.png"), colour)
    pixels, image = read_image(tmp_path / "a.png")
    assert (pixels == 90).all()
    assert any("transparency" in note for note in image.notes)


def test_gamma_and_profiles_of_a_png_do_not_change_its_counts(tmp_path: Path) -> None:
    data = cv2.imencode(".png", SMALL_RAMP)[1].tobytes()
    chunks = b""
    for chunk in (b"sRGB\0", b"gAMA" + (45455).to_bytes(4, "big")):
        chunks += (len(chunk) - 4).to_bytes(4, "big") + chunk + crc32(chunk).to_bytes(4, "big")
    (tmp_path / "a.png").write_bytes(data[:33] + chunks + data[33:])
    np.testing.assert_array_equal(read_frame(tmp_path / "a.png"), SMALL_RAMP)


def test_pictures_of_8_and_16_bits_are_not_joined(tmp_path: Path) -> None:
    for name, kind in (("a.png", np.uint8), ("b.png", np.uint16)):
        cv2.imwrite(str(tmp_path / name), SMALL_RAMP.astype(kind))
    with pytest.raises(FrameError, match=r"b\.png: bits not stated, where .*a\.png has 8"):
        joined([read_image(tmp_path / "a.png")[1], read_image(tmp_path / "b.png")[1]])


def test_a_contradiction_of_one_file_is_that_of_all(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), SMALL_RAMP)
    scan = read_image(tmp_path / "a.png")[1]
    assert joined([scan, replace(scan, scale_fault="a fault")]).scale_fault == "a fault"


def test_each_orientation_undoes_what_was_stored() -> None:
    for orientation, stored in STORED.items():
        np.testing.assert_array_equal(as_shown(stored(SMALL_RAMP), orientation), SMALL_RAMP)


def test_palettes_of_a_stack_give_their_colours(tmp_path: Path) -> None:
    colormap = np.tile(np.arange(255, -1, -1, dtype=np.uint16) * 257, (3, 1))
    held, frames = BytesIO(), (FRAMES % 256).astype(np.uint8)
    with tifffile.TiffWriter(held) as writer:
        for frame in frames:
            writer.write(frame, photometric="palette", colormap=colormap, metadata=None)
    (tmp_path / "a.tif").write_bytes(held.getvalue())
    scan = read_tiff(tmp_path / "a.tif")
    np.testing.assert_array_equal(pictures_of(scan), 255 - frames)
    assert any("colour became grey" in note for note in scan.notes)


REAL = Path(__file__).parents[3] / "shared" / "real-oct" / "tissue-surface"


def test_pages_of_any_type_come_back(tmp_path: Path) -> None:
    for kind in ["u1", "u2", "f4", "i2", "u4"]:
        frames = (FRAMES % 100).astype(kind)
        tifffile.imwrite(tmp_path / "a.tif", frames, photometric="minisblack")
        scan = read_tiff(tmp_path / "a.tif")
        np.testing.assert_array_equal(pictures_of(scan), frames)
        assert scan.bits == (8 if kind == "u1" else None)
        assert (scan.times, scan.depth_pixel_m, scan.lateral_pixel_m) == (None, None, None)


def test_one_page_is_one_frame(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", FRAMES[0])
    scan = read_tiff(tmp_path / "a.tif")
    np.testing.assert_array_equal(pictures_of(scan)[0], FRAMES[0])
    assert scan.names == (str(tmp_path / "a.tif"),)


def test_a_stack_of_imagej_has_scale_and_times(tmp_path: Path) -> None:
    resolution = (1e-6 / LATERAL_M, 1e-6 / DEPTH_M)  # pixels per um
    metadata = {"axes": "TYX", "unit": "um", "finterval": 0.25}
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, imagej=True, resolution=resolution, metadata=metadata)
    scan = read_tiff(tmp_path / "a.tif")
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert scan.lateral_pixel_m.value == pytest.approx(LATERAL_M)
    assert scan.depth_pixel_m.value == pytest.approx(DEPTH_M)
    assert scan.depth_pixel_m.source == "ImageJ's unit"
    np.testing.assert_allclose(scan.times.time_s, 0.25 * np.arange(COUNT))


def test_a_stack_of_imagej_that_stands_behind_one_page_is_read(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, imagej=True, metadata={"axes": "ZYX"})
    with tifffile.TiffFile(tmp_path / "a.tif") as file:  # as ImageJ writes stacks of 4 GB: the other pages are missing
        first = file.pages.first
        place = tifffile.TIFF.TAG_READERS and first.offset
        count = int.from_bytes((tmp_path / "a.tif").read_bytes()[place : place + 2], "little")
    data = bytearray((tmp_path / "a.tif").read_bytes())
    data[place + 2 + 12 * count : place + 6 + 12 * count] = bytes(4)  # no next page
    (tmp_path / "a.tif").write_bytes(data)
    np.testing.assert_array_equal(pictures_of(read_tiff(tmp_path / "a.tif")), FRAMES)


def test_ome_states_scale_and_the_time_of_each_plane(tmp_path: Path) -> None:
    metadata = {
        "axes": "TYX", "PhysicalSizeX": LATERAL_M * 1e6, "PhysicalSizeXUnit": "µm", "PhysicalSizeY": DEPTH_M * 1e3,
        "PhysicalSizeYUnit": "mm", "Plane": {"DeltaT": [0, 100, 300, 400, 700], "DeltaTUnit": ["ms"] * COUNT},
    }  # fmt: skip
    tifffile.imwrite(tmp_path / "a.ome.tif", FRAMES, metadata=metadata)
    scan = read_tiff(tmp_path / "a.ome.tif")
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert scan.lateral_pixel_m.value == pytest.approx(LATERAL_M)
    assert scan.depth_pixel_m.value == pytest.approx(DEPTH_M)
    np.testing.assert_allclose(scan.times.time_s, [0.0, 0.1, 0.3, 0.4, 0.7])


def test_a_step_of_time_that_the_times_of_planes_contradict_is_said(tmp_path: Path) -> None:
    metadata = {"axes": "TYX", "TimeIncrement": 0.1, "Plane": {"DeltaT": [0.0, 0.2, 0.4, 0.6, 0.8]}}
    tifffile.imwrite(tmp_path / "a.ome.tif", FRAMES, metadata=metadata)
    scan = read_tiff(tmp_path / "a.ome.tif")
    np.testing.assert_allclose(scan.times.time_s, [0.0, 0.2, 0.4, 0.6, 0.8])
    assert any("TimeIncrement is 0.1 s, DeltaT has 0.2 s" in note for note in scan.notes)


def test_ome_states_the_step_of_time(tmp_path: Path) -> None:
    metadata = {"axes": "TYX", "TimeIncrement": 40.0, "TimeIncrementUnit": "ms"}
    tifffile.imwrite(tmp_path / "a.ome.tif", FRAMES, metadata=metadata)
    np.testing.assert_allclose(read_tiff(tmp_path / "a.ome.tif").times.time_s, 0.04 * np.arange(COUNT))


def test_json_axes_count_where_they_go_with_the_pixels(tmp_path: Path) -> None:
    def written(rows: int, step: float = 0.002) -> Path:
        axes = {
            "z": {"values": [n * step for n in range(rows)], "units": "mm"},
            "x": {"values": [n * 10.0 for n in range(COLUMNS)], "units": "microns"},
        }
        tifffile.imwrite(tmp_path / "a.tif", FRAMES[0], software=json.dumps({"metadata": axes}))
        return tmp_path / "a.tif"

    scan = read_tiff(written(ROWS))
    assert scan.depth_pixel_m.value == pytest.approx(2e-6)
    assert scan.lateral_pixel_m.value == pytest.approx(1e-5)
    assert scan.depth_pixel_m.source == "JSON axes in the Software tag"
    assert sizes_of(read_image(written(ROWS))[1])[0] == pytest.approx(2e-6)  # as a frame alone
    assert read_tiff(written(ROWS + 1)).depth_pixel_m is None
    assert read_tiff(written(ROWS, 0.0)).depth_pixel_m is None
    uneven = {"z": {"values": [n**2 for n in range(ROWS)], "units": "mm"}}
    tifffile.imwrite(tmp_path / "b.tif", FRAMES[0], software=json.dumps({"metadata": uneven}))
    assert read_tiff(tmp_path / "b.tif").depth_pixel_m is None


def test_white_as_zero_and_colour_become_brighter_is_larger(tmp_path: Path) -> None:
    grey = (FRAMES % 200).astype(np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", 255 - grey, photometric="miniswhite")
    np.testing.assert_array_equal(pictures_of(read_tiff(tmp_path / "a.tif")), grey)
    tifffile.imwrite(tmp_path / "b.tif", np.stack([grey] * 3, axis=-1), photometric="rgb")
    np.testing.assert_array_equal(pictures_of(read_tiff(tmp_path / "b.tif")), grey)


def test_series_of_several_kinds_are_refused(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as writer:
        writer.write(FRAMES[0])
        writer.write(FRAMES[0, :10])
    with pytest.raises(FrameError, match="2 series of images"):
        read_tiff(tmp_path / "a.tif")
    with tifffile.TiffWriter(tmp_path / "b.tif") as writer:
        writer.write(FRAMES, photometric="minisblack")
        writer.write(FRAMES, photometric="minisblack")
    with pytest.raises(FrameError, match="2 series of images"):
        read_tiff(tmp_path / "b.tif")


def test_stacks_of_two_axes_beside_the_picture_are_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", np.stack([FRAMES, FRAMES]), imagej=True, metadata={"axes": "TZYX"})
    with pytest.raises(FrameError, match="axes T 2, Z 5, Y 24, X 40; give a stack of frames with one axis beside"):
        read_tiff(tmp_path / "a.tif")


def test_a_stack_that_was_cut_off_is_no_shorter_stack(tmp_path: Path) -> None:
    for kind in ["plain", "bigtiff", "imagej", "compressed"]:
        options = {"bigtiff": {"bigtiff": True}, "imagej": {"imagej": True}, "compressed": {"compression": "zlib"}}
        written = tmp_path / "whole.tif"
        tifffile.imwrite(written, FRAMES, photometric="minisblack", **options.get(kind, {}))
        data = written.read_bytes()
        np.testing.assert_array_equal(pictures_of(read_tiff(written)), FRAMES)
        for share in np.linspace(0.05, 0.99, 12):
            (tmp_path / "a.tif").write_bytes(data[: int(share * len(data))])
            with pytest.raises(FrameError, match=r"a\.tif: damaged"):
                pictures_of(read_tiff(tmp_path / "a.tif"))


def test_pages_that_were_written_one_by_one_are_a_stack_and_cut_off_between_two_they_are_damaged(
    tmp_path: Path,
) -> None:
    with tifffile.TiffWriter(tmp_path / "whole.tif") as writer:
        for frame in FRAMES:
            writer.write(frame, contiguous=False)
    np.testing.assert_array_equal(pictures_of(read_tiff(tmp_path / "whole.tif")), FRAMES)
    with tifffile.TiffFile(tmp_path / "whole.tif") as file:
        end = max(file.pages[2].offset, file.pages[2].dataoffsets[0] + file.pages[2].databytecounts[0])
    (tmp_path / "a.tif").write_bytes((tmp_path / "whole.tif").read_bytes()[:end])
    with pytest.raises(FrameError, match=r"a\.tif: damaged"):
        read_tiff(tmp_path / "a.tif")


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", FRAMES)
    (tmp_path / "a.tif").write_bytes((tmp_path / "a.tif").read_bytes()[:200])
    with pytest.raises(FrameError, match=r"a\.tif: damaged"):
        pictures_of(read_tiff(tmp_path / "a.tif"))


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/real-oct")
def test_real_tissue_has_the_scale_of_its_json_axes() -> None:
    for path in sorted(REAL.glob("*.tif")):
        scan = read_tiff(path)
        assert scan.lateral_pixel_m.value == pytest.approx(1e-6, rel=0.01), path
        assert 0.9e-6 < scan.depth_pixel_m.value < 2.1e-6, path
