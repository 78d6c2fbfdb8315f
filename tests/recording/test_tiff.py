"""TIFF stacks: pixels, scale and times as tifffile, ImageJ and OME write them, and as real files state them."""

import json
from pathlib import Path

import numpy as np
import pytest
import tifffile
from format_frames import COLUMNS, COUNT, DEPTH_M, FRAMES, LATERAL_M, ROWS, pictures_of

from scleraforce.errors import FrameError
from scleraforce.recording.images import read_frame_image
from scleraforce.recording.tiff import read_tiff

REAL = Path(__file__).parents[3] / "shared" / "real-oct" / "tissue-surface"


@pytest.mark.parametrize("kind", ["u1", "u2", "f4", "i2", "u4"])
def test_pages_of_any_type_come_back(tmp_path: Path, kind: str) -> None:
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
    assert read_frame_image(written(ROWS)).depth_pixel_m == pytest.approx(2e-6)  # as a frame alone
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


@pytest.mark.parametrize("kind", ["plain", "bigtiff", "imagej", "compressed"])
def test_a_stack_that_was_cut_off_is_no_shorter_stack(tmp_path: Path, kind: str) -> None:
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
