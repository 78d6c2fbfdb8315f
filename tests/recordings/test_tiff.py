"""TIFF: single frames and stacks, their grey levels, scale and times."""

import io
import json
import lzma
import re
import struct
import zlib
from collections.abc import Iterable
from itertools import product, zip_longest
from pathlib import Path

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
    ROWS,
    STORED,
    pictures_of,
    sizes_of,
)

from scleraforce.base.errors import FrameError
from scleraforce.recordings.formats.image_files import read_frame, read_image
from scleraforce.recordings.formats.picture_streams import (
    PictureSource,
    as_shown,
    find_greys,
)
from scleraforce.recordings.formats.tiff_files import read_tiff
from scleraforce.recordings.recording_folder import open_frame, recorded_file
from scleraforce.records.scan import Scan

RAMP = np.arange(ROWS * COLUMNS, dtype=np.uint16).reshape(ROWS, COLUMNS)
BYTES = RAMP.astype(np.uint8)
SIZE = (4e-6, 15e-6)  # depth and width of a pixel in most files here
# of that size
PER_CM = {
    "resolution": (1e4 / 15, 1e4 / 4),
    "resolutionunit": "CENTIMETER",
}


def scan_of(folder: Path, pixels: np.ndarray, **options: object) -> PictureSource:
    tifffile.imwrite(folder / "a.tif", pixels, **options)
    return read_tiff(folder / "a.tif")


def pages_of(
    folder: Path,
    *pages: np.ndarray,
    each: Iterable[dict[str, object]] = (),
    **options: object,
) -> Path:
    """Write pages one by one, with options for all and for each."""
    with tifffile.TiffWriter(folder / "a.tif") as writer:
        for page, own in zip_longest(pages, each, fillvalue={}):
            writer.write(page, **options, **own)
    return folder / "a.tif"


ORIENTED = [
    {
        "photometric": "minisblack",
        "metadata": None,
        "extratags": [(274, 3, 1, nth, True)],
    }
    for nth in range(10)
]


def test_pages_of_any_type_come_back(tmp_path: Path) -> None:
    packed = {"compression": "zlib", "predictor": True}
    for kind, count, options in [
        *((kind, 5, {}) for kind in ("u1", "f4", "i2", "u4")),
        ("u2", 5, packed),
        ("u2", 1, {}),
    ]:
        frames = (FRAMES[:count] % 100).astype(kind)
        scan = scan_of(tmp_path, frames.squeeze(), photometric="minisblack", **options)
        np.testing.assert_array_equal(pictures_of(scan), frames)
        assert (scan.bits, scan.times, *sizes_of(scan)) == (
            8 if kind == "u1" else None,
            None,
            None,
            None,
        )

    assert scan.names == (str(tmp_path / "a.tif"),)


def test_white_is_zero_of_any_type_is_exchanged(tmp_path: Path) -> None:
    for kind in ["u1", "u2", "u4", "u8", "i1", "i2", "i4", "f4", "f8"]:
        dark = (FRAMES % 100).astype(kind) - (50 if kind[0] in "if" else 0)
        scan = scan_of(tmp_path, dark.astype(kind), photometric="miniswhite")
        greys = find_greys(scan.pictures(), None, "a")
        counts = np.stack([greys.counts(picture) for picture in scan.pictures()])
        assert (counts[dark == dark.min()].min(), counts[dark == dark.max()].max()) == (
            counts.max(),
            counts.min(),
        )
        assert any("WhiteIsZero" in note for note in scan.notes)

    scan = scan_of(tmp_path, 65535 - RAMP, photometric="miniswhite")
    np.testing.assert_array_equal(pictures_of(scan)[0], RAMP)


def test_palettes_and_colours_become_grey(tmp_path: Path) -> None:
    frames = (FRAMES % 256).astype(np.uint8)
    for factor in [257, 256, 1]:
        colormap = np.tile(np.arange(255, -1, -1, dtype=np.uint16) * factor, (3, 1))
        options = {"photometric": "palette", "colormap": colormap, "metadata": None}
        scan = read_tiff(pages_of(tmp_path, *frames, **options))
        np.testing.assert_array_equal(pictures_of(scan), 255 - frames)
        assert any("colour became grey" in note for note in scan.notes)

    planes = np.stack([BYTES, BYTES // 2, 255 - BYTES])
    expected = cv2.cvtColor(np.moveaxis(planes, 0, -1), cv2.COLOR_RGB2GRAY)

    for config, colour in [
        ("separate", planes),
        ("contig", np.moveaxis(planes, 0, -1)),
    ]:
        scan = scan_of(
            tmp_path,
            np.ascontiguousarray(colour),
            photometric="rgb",
            planarconfig=config,
        )
        np.testing.assert_array_equal(pictures_of(scan)[0], expected)


def test_what_is_not_read_is_refused_by_its_field(tmp_path: Path) -> None:
    for pixels, options, found in [
        (
            np.zeros((24, 40, 4), np.uint8),
            {"photometric": "separated"},
            "of kind SEPARATED; save it as grey",
        ),
        *(
            (
                np.zeros((24, 40, samples), np.uint8),
                {"photometric": "minisblack", "planarconfig": "contig"},
                f"SamplesPerPixel {samples}, PhotometricInterpretation MINISBLACK",
            )
            for samples in (2, 3, 4)
        ),
        (
            np.stack([FRAMES, FRAMES]),
            {"imagej": True, "metadata": {"axes": "TZYX"}},
            "axes T 2, Z 5, Y 24, X 40; give a stack of frames with one axis beside",
        ),
    ]:
        with pytest.raises(FrameError, match=found):
            scan_of(tmp_path, pixels, **options)

    for pages, options, found in [
        *(
            (pages, [{"photometric": "minisblack"}] * 2, "2 series of images")
            for pages in ((FRAMES[0], FRAMES[0, :10]), (FRAMES, FRAMES))
        ),
        *(
            (
                (RAMP, RAMP),
                [ORIENTED[each] for each in several],
                rf"Orientation {several[0]}",
            )
            for several in ((1, 4), (9, 9))
        ),
    ]:
        with pytest.raises(FrameError, match=found):
            read_tiff(pages_of(tmp_path, *pages, each=options))

    cv2.imwrite(str(tmp_path / "a.tif"), BYTES, [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    with pytest.raises(
        FrameError, match=r"a\.tif: .*LZW.* requires the 'imagecodecs' package"
    ):
        read_frame(tmp_path / "a.tif")

    tifffile.imwrite(tmp_path / "a.tif", RAMP, compression="zlib", predictor=True)
    with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
        file.pages.first.tags["Predictor"].overwrite(3)

    with pytest.raises(
        FrameError, match=r"FLOATINGPOINT.* requires the 'imagecodecs' package"
    ):
        read_frame(tmp_path / "a.tif")


def test_a_scale_is_taken_from_the_tags_where_it_is_one(tmp_path: Path) -> None:
    ome = {
        "axes": "YX",
        "PhysicalSizeX": 0.015,
        "PhysicalSizeXUnit": "mm",
        "PhysicalSizeY": 4.0,
    }
    known = [
        PER_CM,
        {"resolution": (25400 / 15, 25400 / 4), "resolutionunit": "INCH"},
        {
            "resolution": (1 / 0.015, 1 / 4),
            "imagej": True,
            "metadata": {"unit": "mm", "yunit": "um", "spacing": 3.0},
        },
        {"ome": True, "metadata": ome},
    ]
    unknown = [  # dots of a printer, numbers without a unit
        {},
        {"resolution": (100.0, 100.0), "resolutionunit": "NONE"},
        {"resolution": (1 / 20, 1 / 7), "imagej": True, "metadata": {"unit": "pixel"}},
        {"resolution": (72, 72), "imagej": True, "metadata": {"unit": "inch"}},
        {"ome": True, "metadata": {"axes": "YX"}},
        *(
            {"resolution": (dots, dots), "resolutionunit": "INCH"}
            for dots in (72, 96, 300, 1200)
        ),
        {"resolution": (28.35, 28.35), "resolutionunit": "CENTIMETER"},
    ]

    for options in known + unknown:
        size = pytest.approx(SIZE, rel=1e-4) if options in known else (None, None)
        assert sizes_of(scan_of(tmp_path, RAMP, **options)) == size


def tiff(
    rows: int, columns: int, strip: bytes, compression: int = 8, **tags: int
) -> bytes:
    """Return a TIFF of 8 bits with one strip, whatever its tags say."""
    values = {
        256: columns,
        257: rows,
        258: 8,
        259: compression,
        262: 1,
        273: 8,
        277: 1,
        278: rows,
        279: len(strip),
    }
    values |= {int(name.removeprefix("tag")): value for name, value in tags.items()}
    entries = b"".join(
        struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(values.items())
    )
    begin = struct.pack("<2sHI", b"II", 42, 8 + len(strip))

    return begin + strip + struct.pack("<H", len(values)) + entries + bytes(4)


# states a dictionary of 3 GiB
HUGE_LZMA = b"\x5d" + struct.pack("<Iq", 3 * 2**30, -1) + bytes(100)


def test_the_size_is_checked_before_memory_is_taken(tmp_path: Path) -> None:
    fitting = tiff(ROWS, COLUMNS, zlib.compress(BYTES.tobytes()))
    np.testing.assert_array_equal(
        next(read_tiff(tmp_path / "a.tif", fitting).pictures()), BYTES
    )

    for content, message in [
        (
            tiff(60_000, 60_000, zlib.compress(bytes(100))),
            "60000 x 60000 pixels; a frame may have 64 million",
        ),
        (
            tiff(64, 64, zlib.compress(bytes(100)), tag277=60_000),
            "with 60000 samples each; a frame may have",
        ),
        (tiff(64, 64, zlib.compress(bytes(50_000_000))), "more is packed in it than"),
        (tiff(64, 64, bytes([129, 0]) * 400_000, 32773), "more is packed in it than"),
        (
            tiff(64, 64, lzma.compress(bytes(50_000_000), preset=0), 34925),
            "more is packed in it than",
        ),
        (
            tiff(
                64,
                64,
                lzma.compress(bytes(4096)) + lzma.compress(bytes(50_000_000), preset=0),
                34925,
            ),
            "data follows",
        ),
        (tiff(64, 64, HUGE_LZMA, 34925), "Memory usage limit"),
    ]:
        tifffile.TiffFile(io.BytesIO(content)).close()  # it is a TIFF
        with less_than(10e6), pytest.raises(FrameError, match=message):
            read_tiff(tmp_path / "a.tif", content)


def test_a_tiff_is_shown_as_its_orientation_says_with_its_scale(tmp_path: Path) -> None:
    for orientation, stored in STORED.items():
        np.testing.assert_array_equal(as_shown(stored(RAMP), orientation), RAMP)
        # of a pixel as stored
        columns_um, rows_um = (15, 4) if orientation < 5 else (4, 15)
        resolution = {
            "resolution": (1e4 / columns_um, 1e4 / rows_um),
            "resolutionunit": "CENTIMETER",
        }
        frames = [np.ascontiguousarray(stored(frame)) for frame in FRAMES]
        scan = read_tiff(
            pages_of(tmp_path, *frames, **ORIENTED[orientation], **resolution)
        )
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert sizes_of(scan) == pytest.approx(SIZE)
        assert any(f"Orientation {orientation}" in note for note in scan.notes) is (
            orientation != 1
        )


def test_a_stack_of_imagej_behind_one_page_is_read(tmp_path: Path) -> None:
    for white_is_zero in (False, True):
        frames = 65535 - FRAMES if white_is_zero else FRAMES
        tifffile.imwrite(
            tmp_path / "a.tif", frames, imagej=True, metadata={"axes": "ZYX"}
        )

        with tifffile.TiffFile(tmp_path / "a.tif", mode="r+") as file:
            file.pages.first.tags["PhotometricInterpretation"].overwrite(
                int(not white_is_zero)
            )
            place = file.pages.first.offset

        data = bytearray((tmp_path / "a.tif").read_bytes())
        count = int.from_bytes(data[place : place + 2], "little")
        # no next page, as in stacks of 4 GB
        data[place + 2 + 12 * count : place + 6 + 12 * count] = bytes(4)
        (tmp_path / "a.tif").write_bytes(data)
        np.testing.assert_array_equal(
            pictures_of(read_tiff(tmp_path / "a.tif")), FRAMES
        )


# ImageJ reads the resolution in its own unit, whatever ResolutionUnit says, but for um
# beside centimetres.
def test_the_unit_of_imagej_takes_precedence_as_in_imagej(tmp_path: Path) -> None:
    units = [
        ("mm", 1.0),
        ("\\u00B5m", 1e-3),
        ("\\u00b5m", 1e-3),
        ("\\u03BCm", 1e-3),
        ("micron", 1e-3),
    ]
    for resolution_unit, (unit, in_mm) in product(
        ["NONE", "INCH", "CENTIMETER"], units
    ):
        options = {
            "resolution": (in_mm / 0.015, in_mm / 0.004),
            "resolutionunit": resolution_unit,
            "imagej": True,
        }
        scan = scan_of(tmp_path, RAMP, metadata={"unit": unit}, **options)
        assert sizes_of(scan) == pytest.approx(SIZE, rel=1e-4)
        assert any("ResolutionUnit" in note for note in scan.notes) is (
            resolution_unit != "NONE"
        )

    scan = scan_of(tmp_path, RAMP, imagej=True, metadata={"unit": "um"}, **PER_CM)
    assert sizes_of(scan) == pytest.approx(SIZE, rel=1e-4)
    assert any("ResolutionUnit counts" in note for note in scan.notes)


def test_a_resolution_without_resolution_unit_is_per_inch_and_that_is_noted(
    tmp_path: Path,
) -> None:
    for resolution, options, note in [
        ((25400 / 15, 25400 / 4), {"metadata": None}, "no ResolutionUnit"),
        (
            (1 / 0.015, 1 / 0.004),
            {"metadata": {"unit": "mm"}, "imagej": True, "byteorder": "<"},
            None,
        ),
    ]:
        tifffile.imwrite(tmp_path / "a.tif", RAMP, resolution=resolution, **options)
        data = (tmp_path / "a.tif").read_bytes()
        tag = np.array([296, 3], "<u2").tobytes()
        assert data.count(tag) == 1
        # of no meaning
        (tmp_path / "a.tif").write_bytes(
            data.replace(tag, np.array([299, 3], "<u2").tobytes())
        )
        scan = read_tiff(tmp_path / "a.tif")
        assert sizes_of(scan) == pytest.approx(SIZE, rel=1e-4)
        assert scan.notes == () if note is None else note in scan.notes[0]


def ome(unit: str, size_t: int = COUNT) -> dict[str, object]:
    text = (
        '<?xml version="1.0" encoding="UTF-8"?><o:OME'
        ' xmlns:o="http://www.openmicroscopy.org/Schemas/OME/2016-06"><o:Image'
        ' ID="Image:0"><o:Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16"'
        f' SizeX="40" SizeY="24" SizeZ="1" SizeC="1" SizeT="{size_t}"'
        f' PhysicalSizeX="15" PhysicalSizeXUnit=\'{unit}\' PhysicalSizeY="4"'
        f' PhysicalSizeYUnit="{unit}"><o:TiffData/></o:Pixels></o:Image></o:OME>'
    )
    return {"description": text.encode(), "metadata": None, "photometric": "minisblack"}


def test_ome_and_imagej_state_units_and_as_many_frames_as_there_are_pages(
    tmp_path: Path,
) -> None:
    for unit in ["&#181;m", "&#xb5;m", "&#956;m", "µm", "\u03bcm", "um", "micrometer"]:
        assert sizes_of(scan_of(tmp_path, FRAMES, **ome(unit))) == pytest.approx(SIZE)

    for description in [
        ome("parsec"),
        {**ome(""), "description": b"ImageJ=1.53t\nunit=parsec\n"},
    ]:
        scan = scan_of(
            tmp_path,
            FRAMES,
            resolution=(1 / 15, 1 / 4),
            resolutionunit="NONE",
            **description,
        )
        assert sizes_of(scan) == (None, None)
        assert any("parsec" in note for note in scan.notes)

    for stated in [3, 6]:
        with pytest.raises(
            FrameError, match=f"OME-XML states {stated} frames, the file has 5 pages"
        ):
            scan_of(tmp_path, FRAMES, **ome("um", stated))

        options = {"metadata": None, "photometric": "minisblack"}
        with pytest.raises(FrameError, match=f"{stated}.* the file has 5"):
            scan_of(
                tmp_path,
                FRAMES,
                description=f"ImageJ=1.53t\nimages={stated}\n",
                **options,
            )


def test_ome_resolution_tags_and_pages_that_differ_are_refused_unless_options_give_the_scale(
    tmp_path: Path,
) -> None:
    tags = {"resolution": (1e4 / 10, 1e4 / 4), "resolutionunit": "CENTIMETER"}
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, RAMP, **ome("um", 1), **tags)

    with pytest.raises(
        FrameError,
        match=(
            r"OME states .*0\.004 x 0\.015 mm.*XResolution.*0\.004 x 0\.01"
            r" mm.*`width_m`"
        ),
    ):
        open_frame(
            recorded_file(path), Scan(width_m=6e-3), Scan(depth_m=4e-3), "assumed"
        )

    frame = open_frame(
        recorded_file(path), Scan(width_m=6e-3, depth_m=2e-3), Scan(), "assumed"
    )
    assert (frame.scan.width_m, frame.scan.depth_m) == (6e-3, 2e-3)
    assert any("OME states" in note for note in frame.notes)
    fault = read_tiff(
        pages_of(tmp_path, RAMP, RAMP, each=(PER_CM, tags), metadata=None)
    ).scale_fault
    assert re.search(r"0\.004 x 0\.015 mm.*0\.004 x 0\.01 mm", fault)


def test_smaller_copies_are_left_out_and_that_is_noted(tmp_path: Path) -> None:
    for inner in [1, None]:
        path = pages_of(
            tmp_path,
            RAMP,
            RAMP[::2, ::2],
            each=[{"subifds": inner}, {"subfiletype": 1}],
        )
        pixels, scan = read_image(path)
        np.testing.assert_array_equal(pixels, RAMP)
        assert any("smaller copies" in note for note in scan.notes)

    # as copies, but as large
    marked = [{"metadata": None, "subfiletype": int(nth > 0)} for nth in range(COUNT)]
    np.testing.assert_array_equal(
        pictures_of(read_tiff(pages_of(tmp_path, *FRAMES, each=marked))), FRAMES
    )


def test_a_stack_has_the_scale_and_times_of_imagej_or_ome(tmp_path: Path) -> None:
    imagej = {"axes": "TYX", "unit": "um", "finterval": 0.25}
    physical = {
        "PhysicalSizeX": LATERAL_M * 1e6,
        "PhysicalSizeXUnit": "µm",
        "PhysicalSizeY": DEPTH_M * 1e3,
        "PhysicalSizeYUnit": "mm",
        "axes": "TYX",
    }
    planes = {
        "Plane": {"DeltaT": [0, 100, 300, 400, 700], "DeltaTUnit": ["ms"] * COUNT}
    }
    differing = {"TimeIncrement": 0.1, "Plane": {"DeltaT": [0.0, 0.2, 0.4, 0.6, 0.8]}}
    per_um = {"resolution": (1e-6 / LATERAL_M, 1e-6 / DEPTH_M), "imagej": True}
    even = {"TimeIncrement": 40.0, "TimeIncrementUnit": "ms"}
    even_s = np.arange(COUNT)

    for options, source, time_s, note in [
        (per_um | {"metadata": imagej}, "ImageJ's unit", 0.25 * even_s, ""),
        (
            {"ome": True, "metadata": physical | planes},
            "OME",
            [0.0, 0.1, 0.3, 0.4, 0.7],
            "",
        ),
        ({"ome": True, "metadata": physical | even}, "OME", 0.04 * even_s, ""),
        (
            {"ome": True, "metadata": physical | differing},
            "OME",
            0.2 * even_s,
            "is 0.1 s, DeltaT has 0.2 s",
        ),
    ]:
        scan = scan_of(tmp_path, FRAMES, **options)
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert sizes_of(scan) == pytest.approx((DEPTH_M, LATERAL_M))
        assert scan.size.source == source
        np.testing.assert_allclose(scan.times.time_s, time_s)
        assert note in " ".join(scan.notes)


def test_json_axes_count_where_they_fit_the_pixels(tmp_path: Path) -> None:
    across = {"values": [nth * 10.0 for nth in range(COLUMNS)], "units": "microns"}
    fitting, curved = ([0.002 * nth**power for nth in range(ROWS)] for power in (1, 2))

    for values, depth_m in [
        (fitting, 2e-6),
        (fitting[1:], None),
        (curved, None),
        ([0.0] * ROWS, None),
    ]:
        axes = {"z": {"values": values, "units": "mm"}, "x": across}
        scan = scan_of(tmp_path, FRAMES[0], software=json.dumps({"metadata": axes}))
        assert sizes_of(scan) == (
            depth_m and pytest.approx(depth_m),
            pytest.approx(1e-5),
        )
        assert scan.size.source == "JSON axes in the Software tag"


def test_a_stack_that_was_cut_off_is_damaged(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    for options in (
        {},
        {"bigtiff": True},
        {"imagej": True},
        {"compression": "zlib"},
        None,
    ):
        if options is None:
            pages_of(tmp_path, *FRAMES, contiguous=False)  # written one by one
        else:
            tifffile.imwrite(path, FRAMES, photometric="minisblack", **options)

        np.testing.assert_array_equal(pictures_of(read_tiff(path)), FRAMES)
        with tifffile.TiffFile(path) as file:
            page = file.pages[2].aspage()
            data = path.read_bytes()

        # two pages
        between = max(page.offset, page.dataoffsets[0] + page.databytecounts[0])
        for end in (
            *(int(share * len(data)) for share in np.linspace(0.05, 0.99, 12)),
            between,
        ):
            path.write_bytes(data[:end])
            with pytest.raises(FrameError, match=r"a\.tif: damaged"):
                pictures_of(read_tiff(path))


@pytest.mark.parametrize("back_to", [0, 1, 2])
@pytest.mark.parametrize("bigtiff", [False, True])
def test_pages_that_go_round_are_refused(
    tmp_path: Path, back_to: int, bigtiff: bool
) -> None:
    """The last page names an earlier one, or itself, as the next."""
    tifffile.imwrite(
        tmp_path / "a.tif",
        np.zeros((3, 16, 16), np.uint16),
        photometric="minisblack",
        bigtiff=bigtiff,
    )
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        places = [page.offset for page in file.pages]
        after = file.pages.next_page_offset
        form = file.tiff.offsetformat

    data = bytearray((tmp_path / "a.tif").read_bytes())
    place = struct.pack(form, places[back_to])
    data[after : after + len(place)] = place
    (tmp_path / "a.tif").write_bytes(data)
    with pytest.raises(FrameError, match="its pages go round"):
        read_tiff(tmp_path / "a.tif")
    with pytest.raises(FrameError, match="its pages go round"):
        read_frame(tmp_path / "a.tif")
