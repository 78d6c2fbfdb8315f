"""TIFF: single frames and stacks, their grey levels, scale and times."""

import io
import json
import lzma
import re
import struct
import zlib
from itertools import zip_longest

import cv2
import numpy as np
import pytest
import tifffile
from effects import less_than
from foreign_files import (
    COLUMNS,
    COUNT,
    DEPTH_M,
    FRAMES,
    LATERAL_M,
    NO_SIZES,
    ROWS,
    SIZES_M,
    STORED,
    check_scan,
    pictures_of,
    sizes_of,
)

from scleraforce.base.errors import FrameError
from scleraforce.recordings.formats.image_files import read_frame, read_image
from scleraforce.recordings.formats.picture_streams import find_greys
from scleraforce.recordings.formats.tiff_files import read_tiff
from scleraforce.recordings.recording_folder import open_frame, recorded_file
from scleraforce.records.scan import Scan

RAMP = np.arange(ROWS * COLUMNS, dtype=np.uint16).reshape(ROWS, COLUMNS)
BYTES = RAMP.astype(np.uint8)
PER_CM = {"resolution": (1e4 / 15, 1e4 / 4), "resolutionunit": "CENTIMETER"}
NARROWER = {"resolution": (1e4 / 10, 1e4 / 4), "resolutionunit": "CENTIMETER"}
GREY = {"photometric": "minisblack"}
PLAIN = {"metadata": None, **GREY}
OF_THE_FILE = ("bigtiff", "byteorder", "imagej", "ome")


def tiff(folder, *pages, each=(), **options):
    """Write pages one by one, with options for the file, for all and for each."""
    whole = {name: options.pop(name) for name in OF_THE_FILE if name in options}
    with tifffile.TiffWriter(folder / "a.tif", **whole) as writer:
        for page, own in zip_longest(pages, each, fillvalue={}):
            writer.write(page, **options, **own)
    return folder / "a.tif"


def scan_of(*written, **options):
    return read_tiff(tiff(*written, **options))


def oriented(orientation):
    return {**PLAIN, "extratags": [(274, 3, 1, orientation, True)]}


def overwritten(path, **tags):
    with tifffile.TiffFile(path, mode="r+") as file:
        for name, value in tags.items():
            file.pages.first.tags[name].overwrite(value)
    return path


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("u1", {}),
        ("u2", {"compression": "zlib", "predictor": True}),
        ("i2", {}),
        ("u4", {}),
        ("f4", {}),
    ],
)
def test_pages_of_any_type_come_back(tmp_path, kind, options):
    frames = (FRAMES % 100).astype(kind)
    for count in (1, COUNT):
        scan = scan_of(tmp_path, frames[:count].squeeze(), **GREY, **options)
        check_scan(scan, frames[:count], NO_SIZES)
        assert (scan.bits, scan.times) == (8 if kind == "u1" else None, None)


@pytest.mark.parametrize("kind", ["u1", "u2", "u4", "u8", "i1", "i2", "i4", "f4", "f8"])
def test_white_is_zero_of_any_type_is_exchanged(tmp_path, kind):
    dark = (FRAMES % 100).astype(kind) - (50 if kind[0] in "if" else 0)
    scan = scan_of(tmp_path, dark.astype(kind), photometric="miniswhite")
    greys = find_greys(scan.pictures(), None, "a")
    counts = np.stack([greys.counts(picture) for picture in scan.pictures()])
    assert counts[dark == dark.min()].min() == counts.max()
    assert counts[dark == dark.max()].max() == counts.min()
    assert any("WhiteIsZero" in note for note in scan.notes)


@pytest.mark.parametrize("factor", [257, 256, 1])
def test_palettes_become_grey(tmp_path, factor):
    frames = (FRAMES % 256).astype(np.uint8)
    colormap = np.tile(np.arange(255, -1, -1, dtype=np.uint16) * factor, (3, 1))
    options = {"photometric": "palette", "colormap": colormap, "metadata": None}
    scan = scan_of(tmp_path, *frames, **options)
    check_scan(scan, 255 - frames)
    assert any("colour became grey" in note for note in scan.notes)


@pytest.mark.parametrize("planes", ["separate", "contig"])
def test_colours_become_grey(tmp_path, planes):
    colour = np.stack([BYTES, BYTES // 2, 255 - BYTES], axis=-1)
    stored = np.moveaxis(colour, -1, 0) if planes == "separate" else colour
    scan = scan_of(
        tmp_path,
        np.ascontiguousarray(stored),
        photometric="rgb",
        planarconfig=planes,
    )
    check_scan(scan, cv2.cvtColor(colour, cv2.COLOR_RGB2GRAY)[None])


def of_samples(count):
    return np.zeros((ROWS, COLUMNS, count), np.uint8)


def ome(unit, size_t=COUNT):
    text = (
        '<?xml version="1.0" encoding="UTF-8"?><o:OME'
        ' xmlns:o="http://www.openmicroscopy.org/Schemas/OME/2016-06"><o:Image'
        ' ID="Image:0"><o:Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16"'
        f' SizeX="40" SizeY="24" SizeZ="1" SizeC="1" SizeT="{size_t}"'
        f' PhysicalSizeX="15" PhysicalSizeXUnit=\'{unit}\' PhysicalSizeY="4"'
        f' PhysicalSizeYUnit="{unit}"><o:TiffData/></o:Pixels></o:Image></o:OME>'
    )
    return {"description": text.encode(), **PLAIN}


def imagej(*lines):
    return {"description": "\n".join(["ImageJ=1.53t", *lines, ""]), **PLAIN}


@pytest.mark.parametrize(
    ("pages", "options", "message"),
    [
        ([of_samples(4)], {"photometric": "separated"}, "SEPARATED; save it as grey"),
        (
            [of_samples(3)],
            {**GREY, "planarconfig": "contig"},
            "SamplesPerPixel 3, PhotometricInterpretation MINISBLACK",
        ),
        (
            [np.stack([FRAMES, FRAMES])],
            {"imagej": True, "metadata": {"axes": "TZYX"}},
            "axes T 2, Z 5, Y 24, X 40; give a stack of frames with one axis beside",
        ),
        ([FRAMES[0], FRAMES[0, :10]], GREY, "2 series of images"),
        ([FRAMES, FRAMES], GREY, "2 series of images"),
        ([RAMP, RAMP], {"each": [oriented(1), oriented(4)]}, "Orientation 1"),
        ([RAMP], oriented(9), "Orientation 9"),
        ([FRAMES], ome("um", 3), "OME-XML states 3 frames, the file has 5 pages"),
        ([FRAMES], ome("um", 6), "OME-XML states 6 frames, the file has 5 pages"),
        ([FRAMES], imagej("images=3"), "3.* the file has 5"),
        ([FRAMES], imagej("images=6"), "6.* the file has 5"),
    ],
)
def test_what_is_not_read_is_refused_by_its_field(tmp_path, pages, options, message):
    with pytest.raises(FrameError, match=message):
        scan_of(tmp_path, *pages, **options)


def test_a_compression_without_its_package_is_refused_by_its_name(tmp_path):
    cv2.imwrite(str(tmp_path / "a.tif"), BYTES, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    with pytest.raises(FrameError, match=r"a\.tif: .*LZW.* requires the 'imagecodecs'"):
        read_frame(tmp_path / "a.tif")

    path = tiff(tmp_path, RAMP, compression="zlib", predictor=True)
    with pytest.raises(FrameError, match=r"FLOATINGPOINT.* requires the 'imagecodecs'"):
        read_frame(overwritten(path, Predictor=3))


@pytest.mark.parametrize(
    ("options", "sizes_m"),
    [
        (PER_CM, SIZES_M),
        ({"resolution": (25400 / 15, 25400 / 4), "resolutionunit": "INCH"}, SIZES_M),
        (
            {
                "resolution": (1 / 0.015, 1 / 4),
                "imagej": True,
                "metadata": {"unit": "mm", "yunit": "um", "spacing": 3.0},
            },
            SIZES_M,
        ),
        (
            {
                "ome": True,
                "metadata": {
                    "axes": "YX",
                    "PhysicalSizeX": 0.015,
                    "PhysicalSizeXUnit": "mm",
                    "PhysicalSizeY": 4.0,
                },
            },
            SIZES_M,
        ),
        ({}, NO_SIZES),
        ({"resolution": (100.0, 100.0), "resolutionunit": "NONE"}, NO_SIZES),
        (
            {
                "resolution": (1 / 20, 1 / 7),
                "imagej": True,
                "metadata": {"unit": "pixel"},
            },
            NO_SIZES,
        ),
        (
            {"resolution": (72, 72), "imagej": True, "metadata": {"unit": "inch"}},
            NO_SIZES,
        ),
        ({"ome": True, "metadata": {"axes": "YX"}}, NO_SIZES),
        # dots of a printer or of a screen
        *(
            ({"resolution": (dots, dots), "resolutionunit": "INCH"}, NO_SIZES)
            for dots in (72, 96, 300, 1200)
        ),
        ({"resolution": (28.35, 28.35), "resolutionunit": "CENTIMETER"}, NO_SIZES),
    ],
)
def test_a_scale_is_taken_from_the_tags_where_it_is_one(tmp_path, options, sizes_m):
    check_scan(scan_of(tmp_path, RAMP, **options), RAMP[None], sizes_m)


def with_strip(rows, columns, strip, compression=8, samples=1):
    """Return a TIFF of 8 bits with one strip, whatever its tags say."""
    values = {
        256: columns,
        257: rows,
        258: 8,
        259: compression,
        262: 1,
        273: 8,
        277: samples,
        278: rows,
        279: len(strip),
    }
    entries = b"".join(
        struct.pack("<HHII", tag, 4, 1, value) for tag, value in values.items()
    )
    begin = struct.pack("<2sHI", b"II", 42, 8 + len(strip))
    return begin + strip + struct.pack("<H", len(values)) + entries + bytes(4)


LZMA = 34925
PACK_BITS = 32773
LONG = bytes(50_000_000)
# states a dictionary of 3 GiB
HUGE_LZMA = b"\x5d" + struct.pack("<Iq", 3 * 2**30, -1) + bytes(100)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            with_strip(60_000, 60_000, zlib.compress(bytes(100))),
            "60000 x 60000 pixels; a frame may have 64 million",
        ),
        (
            with_strip(64, 64, zlib.compress(bytes(100)), samples=60_000),
            "with 60000 samples each; a frame may have",
        ),
        (with_strip(64, 64, zlib.compress(LONG)), "more is packed in it than"),
        (
            with_strip(64, 64, bytes([129, 0]) * 400_000, PACK_BITS),
            "more is packed in it than",
        ),
        (
            with_strip(64, 64, lzma.compress(LONG, preset=0), LZMA),
            "more is packed in it than",
        ),
        (
            with_strip(64, 64, lzma.compress(bytes(4096)) + lzma.compress(b""), LZMA),
            "data follows",
        ),
        (with_strip(64, 64, HUGE_LZMA, LZMA), "Memory usage limit"),
    ],
    ids=range(7),
)
def test_the_size_is_checked_before_memory_is_taken(tmp_path, content, message):
    fitting = with_strip(ROWS, COLUMNS, zlib.compress(BYTES.tobytes()))
    check_scan(read_tiff(tmp_path / "a.tif", fitting), BYTES[None])

    tifffile.TiffFile(io.BytesIO(content)).close()  # it is a TIFF
    with less_than(10e6), pytest.raises(FrameError, match=message):
        read_tiff(tmp_path / "a.tif", content)


@pytest.mark.parametrize("orientation", STORED)
def test_a_tiff_is_shown_as_its_orientation_says_with_its_scale(tmp_path, orientation):
    columns_um, rows_um = (15, 4) if orientation < 5 else (4, 15)  # as stored
    frames = [np.ascontiguousarray(STORED[orientation](frame)) for frame in FRAMES]
    scan = scan_of(
        tmp_path,
        *frames,
        **oriented(orientation),
        resolution=(1e4 / columns_um, 1e4 / rows_um),
        resolutionunit="CENTIMETER",
    )
    check_scan(scan, sizes_m=SIZES_M)
    noted = any(f"Orientation {orientation}" in note for note in scan.notes)
    assert noted is (orientation != 1)


@pytest.mark.parametrize("white_is_zero", [False, True])
def test_a_stack_of_imagej_behind_one_page_is_read(tmp_path, white_is_zero):
    frames = 65535 - FRAMES if white_is_zero else FRAMES
    path = tiff(tmp_path, frames, imagej=True, metadata={"axes": "ZYX"})
    overwritten(path, PhotometricInterpretation=int(not white_is_zero))
    with tifffile.TiffFile(path) as file:
        place = file.pages.first.offset

    data = bytearray(path.read_bytes())
    count = int.from_bytes(data[place : place + 2], "little")
    # no next page, as in stacks of 4 GB
    data[place + 2 + 12 * count : place + 6 + 12 * count] = bytes(4)
    path.write_bytes(data)
    check_scan(read_tiff(path))


# ImageJ reads the resolution in its own unit, whatever ResolutionUnit says, but for um
# beside centimetres.
@pytest.mark.parametrize("resolution_unit", ["NONE", "INCH", "CENTIMETER"])
@pytest.mark.parametrize("unit", ["mm", "\\u00B5m", "\\u00b5m", "\\u03BCm", "micron"])
def test_the_unit_of_imagej_takes_precedence_as_in_imagej(
    tmp_path, resolution_unit, unit
):
    in_mm = 1.0 if unit == "mm" else 1e-3
    scan = scan_of(
        tmp_path,
        RAMP,
        imagej=True,
        metadata={"unit": unit},
        resolution=(in_mm / 0.015, in_mm / 0.004),
        resolutionunit=resolution_unit,
    )
    check_scan(scan, RAMP[None], SIZES_M)
    noted = any("ResolutionUnit" in note for note in scan.notes)
    assert noted is (resolution_unit != "NONE")


def test_centimetres_count_beside_micrometres_of_imagej(tmp_path):
    scan = scan_of(tmp_path, RAMP, imagej=True, metadata={"unit": "um"}, **PER_CM)
    check_scan(scan, RAMP[None], SIZES_M)
    assert any("ResolutionUnit counts" in note for note in scan.notes)


@pytest.mark.parametrize(
    ("options", "notes"),
    [
        ({"resolution": (25400 / 15, 25400 / 4), "metadata": None}, 1),
        (
            {
                "resolution": (1 / 0.015, 1 / 0.004),
                "metadata": {"unit": "mm"},
                "imagej": True,
                "byteorder": "<",
            },
            0,
        ),
    ],
)
def test_a_resolution_without_resolution_unit_is_per_inch_and_that_is_noted(
    tmp_path, options, notes
):
    path = tiff(tmp_path, RAMP, **options)
    unit, of_no_meaning = (struct.pack("<HH", tag, 3) for tag in (296, 299))
    data = path.read_bytes()
    assert data.count(unit) == 1
    path.write_bytes(data.replace(unit, of_no_meaning))
    scan = read_tiff(path)
    check_scan(scan, RAMP[None], SIZES_M)
    assert ["no ResolutionUnit" in note for note in scan.notes] == [True] * notes


@pytest.mark.parametrize(
    ("options", "sizes_m"),
    [
        *(
            (ome(unit), SIZES_M)
            for unit in (
                "&#181;m",
                "&#xb5;m",
                "&#956;m",
                "µm",
                "\u03bcm",
                "um",
                "micrometer",
            )
        ),
        (ome("parsec"), NO_SIZES),
        (imagej("unit=parsec"), NO_SIZES),
    ],
)
def test_a_unit_of_ome_or_imagej_is_known_or_noted(tmp_path, options, sizes_m):
    dots = {"resolution": (1 / 15, 1 / 4), "resolutionunit": "NONE"}
    scan = scan_of(tmp_path, FRAMES, **dots, **options)
    check_scan(scan, FRAMES, sizes_m)
    assert any("parsec" in note for note in scan.notes) is (sizes_m == NO_SIZES)


def test_ome_resolution_tags_and_pages_that_differ_are_refused_unless_options_give_the_scale(
    tmp_path,
):
    path = recorded_file(tiff(tmp_path, RAMP, **ome("um", 1), **NARROWER))
    states = r"OME states .*0\.004 x 0\.015 mm.*XResolution.*0\.004 x 0\.01 mm"
    with pytest.raises(FrameError, match=f"{states}.*`width_m`"):
        open_frame(path, Scan(width_m=6e-3), Scan(depth_m=4e-3), "assumed")

    frame = open_frame(path, Scan(width_m=6e-3, depth_m=2e-3), Scan(), "assumed")
    assert (frame.scan.width_m, frame.scan.depth_m) == (6e-3, 2e-3)
    assert any("OME states" in note for note in frame.notes)

    several = scan_of(tmp_path, RAMP, RAMP, each=(PER_CM, NARROWER), metadata=None)
    assert re.search(r"0\.004 x 0\.015 mm.*0\.004 x 0\.01 mm", several.scale_fault)


@pytest.mark.parametrize("inner", [1, None])
def test_smaller_copies_are_left_out_and_that_is_noted(tmp_path, inner):
    each = [{"subifds": inner}, {"subfiletype": 1}]
    pixels, scan = read_image(tiff(tmp_path, RAMP, RAMP[::2, ::2], each=each))
    np.testing.assert_array_equal(pixels, RAMP)
    assert any("smaller copies" in note for note in scan.notes)

    as_large = [{"metadata": None, "subfiletype": int(n > 0)} for n in range(COUNT)]
    check_scan(scan_of(tmp_path, *FRAMES, each=as_large))


PHYSICAL = {
    "PhysicalSizeX": LATERAL_M * 1e6,
    "PhysicalSizeXUnit": "µm",
    "PhysicalSizeY": DEPTH_M * 1e3,
    "PhysicalSizeYUnit": "mm",
    "axes": "TYX",
}
IMAGEJ = {"axes": "TYX", "unit": "um", "finterval": 0.25}
EVEN_S = np.arange(COUNT)


@pytest.mark.parametrize(
    ("options", "source", "time_s"),
    [
        (
            {
                "imagej": True,
                "resolution": (1e-6 / LATERAL_M, 1e-6 / DEPTH_M),
                "metadata": IMAGEJ,
            },
            "ImageJ's unit",
            0.25 * EVEN_S,
        ),
        (
            {"Plane": {"DeltaT": [0, 100, 300, 400, 700], "DeltaTUnit": ["ms"] * 5}},
            "OME",
            [0.0, 0.1, 0.3, 0.4, 0.7],
        ),
        ({"TimeIncrement": 40.0, "TimeIncrementUnit": "ms"}, "OME", 0.04 * EVEN_S),
        (
            {"TimeIncrement": 0.1, "Plane": {"DeltaT": [0.0, 0.2, 0.4, 0.6, 0.8]}},
            "OME",
            0.2 * EVEN_S,
        ),
    ],
)
def test_a_stack_has_the_scale_and_times_of_imagej_or_ome(
    tmp_path, options, source, time_s
):
    if source == "OME":
        options = {"ome": True, "metadata": PHYSICAL | options}
    scan = scan_of(tmp_path, FRAMES, **options)
    check_scan(scan, FRAMES, SIZES_M, time_s)
    assert scan.size.source == source
    contradicted = "is 0.1 s, DeltaT has 0.2 s" in " ".join(scan.notes)
    assert contradicted == (time_s[1] == 0.2)


@pytest.mark.parametrize(
    ("depths_mm", "depth_m"),
    [
        ([0.002 * row for row in range(ROWS)], 2e-6),
        ([0.002 * row for row in range(1, ROWS)], None),
        ([0.002 * row**2 for row in range(ROWS)], None),
        ([0.0] * ROWS, None),
    ],
)
def test_json_axes_count_where_they_fit_the_pixels(tmp_path, depths_mm, depth_m):
    across = {
        "values": [10.0 * column for column in range(COLUMNS)],
        "units": "microns",
    }
    axes = {"z": {"values": depths_mm, "units": "mm"}, "x": across}
    scan = scan_of(tmp_path, FRAMES[0], software=json.dumps({"metadata": axes}))
    assert sizes_of(scan) == pytest.approx((depth_m, 1e-5))
    assert scan.size.source == "JSON axes in the Software tag"


@pytest.mark.parametrize(
    "options",
    [
        GREY,
        {"bigtiff": True, **GREY},
        {"imagej": True, **GREY},
        {"compression": "zlib", **GREY},
        None,
    ],
)
def test_a_stack_that_was_cut_off_is_damaged(tmp_path, options):
    path = (
        tiff(tmp_path, *FRAMES, contiguous=False)
        if options is None
        else tiff(tmp_path, FRAMES, **options)
    )
    check_scan(read_tiff(path))
    with tifffile.TiffFile(path) as file:
        page = file.pages[2].aspage()

    data = path.read_bytes()
    between_pages = max(page.offset, page.dataoffsets[0] + page.databytecounts[0])
    shares = np.linspace(0.05, 0.99, 12)
    for end in (*(int(share * len(data)) for share in shares), between_pages):
        path.write_bytes(data[:end])
        with pytest.raises(FrameError, match=r"a\.tif: damaged"):
            pictures_of(read_tiff(path))


@pytest.mark.parametrize("back_to", [0, 1, 2])
@pytest.mark.parametrize("bigtiff", [False, True])
def test_pages_that_go_round_are_refused(tmp_path, back_to, bigtiff):
    """The last page names an earlier one, or itself, as the next."""
    path = tiff(tmp_path, FRAMES[:3], bigtiff=bigtiff, **GREY)
    with tifffile.TiffFile(path) as file:
        place = struct.pack(file.tiff.offsetformat, file.pages[back_to].offset)
        after = file.pages.next_page_offset

    data = bytearray(path.read_bytes())
    data[after : after + len(place)] = place
    path.write_bytes(data)
    for read in (read_tiff, read_frame):
        with pytest.raises(FrameError, match="its pages go round"):
            read(path)
