"""PNG, JPEG and NumPy files."""

import struct
import warnings
import zlib
from pathlib import Path
from tempfile import mkdtemp

import cv2
import numpy as np
import pydicom
import pytest
import tifffile
from foreign_files import FRAMES, pictures_of, sizes_of, write_dicom
from hypothesis import given, settings, strategies as st

from scleraforce.errors import FrameError
from scleraforce.recording.images import check_frame, read_frame, read_image, read_numpy
from scleraforce.recording.scan import AXES, UnansweredError

REAL = Path(__file__).parents[3] / "shared" / "real-oct"
RAMP = np.arange(40 * 60, dtype=np.uint16).reshape(40, 60)


def test_png_of_8_and_16_bits_is_read_as_it_was_written(tmp_path):
    for dtype in (np.uint8, np.uint16):
        cv2.imwrite(str(tmp_path / "a.png"), RAMP.astype(dtype))
        pixels = read_frame(tmp_path / "a.png")
        assert pixels.dtype == dtype
        assert (pixels == RAMP.astype(dtype)).all()


def test_tiff_is_read_as_it_was_written(tmp_path):
    for compression in (None, "zlib"):
        tifffile.imwrite(tmp_path / "a.tif", RAMP, compression=compression)
        assert (read_frame(tmp_path / "a.tif") == RAMP).all()


def test_colour_becomes_grey_alike_in_all_formats(tmp_path):
    grey = np.full((40, 60), 90, dtype=np.uint8)
    colour = np.dstack([grey, grey // 2, grey * 2])  # OpenCV's order: blue, green, red
    cv2.imwrite(str(tmp_path / "a.png"), colour)
    cv2.imwrite(str(tmp_path / "a.jpg"), colour, [cv2.IMWRITE_JPEG_QUALITY, 100])
    tifffile.imwrite(tmp_path / "a.tif", np.ascontiguousarray(colour[..., ::-1]), photometric="rgb")
    for name in ("a.png", "a.jpg", "a.tif"):
        pixels = read_frame(tmp_path / name)
        assert pixels.shape == (40, 60)
        assert np.abs(pixels.astype(int) - round(0.114 * 90 + 0.587 * 45 + 0.299 * 180)).max() <= 1


def test_dicom_gives_pixels_and_their_size_where_the_tags_know_it(tmp_path):
    write_dicom(tmp_path / "a.dcm", RAMP, PixelSpacing=[0.004, 0.015])
    pixels, image = read_image(tmp_path / "a.dcm")
    assert (pixels == RAMP).all()
    assert sizes_of(image) == pytest.approx((4e-6, 15e-6))
    write_dicom(tmp_path / "b.dcm", RAMP)
    assert sizes_of(read_image(tmp_path / "b.dcm")[1])[0] is None


def test_signed_dicom_is_shifted_to_start_at_zero(tmp_path):
    write_dicom(tmp_path / "a.dcm", RAMP.astype(np.int16) - 1000)
    assert (read_frame(tmp_path / "a.dcm") == RAMP).all()


def test_visante_dicom_is_turned_so_that_rows_are_depth(tmp_path):
    maker = {"Manufacturer": "Carl Zeiss Meditec", "ManufacturerModelName": "1000"}
    write_dicom(tmp_path / "a.dcm", RAMP, PixelSpacing=[0.02, 0.003], **maker)
    pixels, image = read_image(tmp_path / "a.dcm")
    assert (pixels == RAMP.T).all()
    assert sizes_of(image) == pytest.approx((3e-6, 20e-6))


def test_odd_dicom_tags_are_read_without_a_warning(tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        write_dicom(tmp_path / "a.dcm", RAMP, StudyDescription="x" * 90)
    assert (read_frame(tmp_path / "a.dcm") == RAMP).all()
    assert pydicom.config.settings.reading_validation_mode == pydicom.config.WARN


def test_what_is_not_a_frame_is_named(tmp_path):
    for write, message in [
        (lambda path: path.write_bytes(b""), "an empty file; give a PNG"),
        (lambda path: path.write_bytes(b"file,time_s\n"), "not an image that can be read; give a PNG"),
        (lambda path: path.mkdir(), "a folder; give a regular file"),
        (lambda _: None, "No such file"),
        (
            lambda path: tifffile.imwrite(path, np.stack([RAMP, RAMP])),
            "2 frames in one file; give a file for each frame",
        ),
        (lambda path: tifffile.imwrite(path, np.full((9, 9), np.nan)), "81 pixels that are NaN or infinite"),
        (lambda path: tifffile.imwrite(path, np.ones((9, 9), np.float32)), "float32 pixels; give whole numbers"),
        (lambda path: tifffile.imwrite(path, np.ones((9, 9), np.uint32)), "uint32 pixels; give whole numbers"),
        (lambda path: tifffile.imwrite(path, np.ones((1, 9), np.uint8)), "give one frame, rows x columns"),
        (lambda path: write_dicom(path, np.stack([RAMP] * 6)), "6 frames in one file"),
    ]:
        place = Path(mkdtemp(dir=tmp_path))
        path = place / "a.img"
        write(path)
        with pytest.raises(FrameError, match=message) as caught:
            read_frame(path)
        assert str(caught.value).startswith(f"{path}: ")


def encoded(name, tmp_path):
    path = tmp_path / name
    if name.endswith("dcm"):
        write_dicom(path, RAMP)
    elif name.endswith("tif"):
        tifffile.imwrite(path, RAMP)
    else:
        cv2.imwrite(str(path), RAMP if name.endswith("png") else RAMP.astype(np.uint8))
    return path.read_bytes()


def test_truncated_file_is_an_error(tmp_path):
    for name in ["a.png", "a.jpg", "a.tif", "a.dcm"]:
        for share in [0.3, 0.7, 0.97]:
            data = encoded(name, tmp_path)
            path = tmp_path / "cut"
            path.write_bytes(data[: int(len(data) * share)])
            with pytest.raises(FrameError, match="cut: "):
                read_frame(path)


def test_every_flipped_bit_of_a_png_is_an_error(tmp_path):
    data = bytearray(encoded("a.png", tmp_path))
    path = tmp_path / "flipped.png"
    for at in range(8, len(data), 7):
        data[at] ^= 16
        path.write_bytes(data)
        with pytest.raises(FrameError, match=r"flipped\.png: "):
            read_frame(path)
        data[at] ^= 16


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"\0" * 128 + b"DICM", b""]),
    st.binary(),
)
def test_garbage_of_any_kind_is_a_frame_error(tmp_path_factory, start, rest):
    path = tmp_path_factory.mktemp("garbage") / "a"
    path.write_bytes(start + rest)
    with pytest.raises(FrameError):
        read_frame(path)


def test_frame_that_is_not_what_its_recording_says_is_an_error():
    for pixels, message in [
        (np.zeros((39, 60), np.uint16), "39 x 60 pixels .* says 40 x 60"),
        (np.zeros((40, 60), np.uint8), "8 bits a pixel; recording.toml says 12"),
        (np.full((40, 60), 4096, np.uint16), "a pixel of 4096 is more than 12 bits"),
    ]:
        check_frame(np.full((40, 60), 4095, np.uint16), 40, 60, 12, "a.png")
        with pytest.raises(FrameError, match="^a.png: " + message):
            check_frame(pixels, 40, 60, 12, "a.png")


@pytest.mark.real
@pytest.mark.skipif(not REAL.is_dir(), reason="no ../shared")
def test_every_real_image_can_be_read():
    files = [path for path in REAL.rglob("*") if path.suffix in (".tif", ".png", ".jpg", ".jpeg", ".dcm")]
    assert len(files) == 35
    shapes = {path.suffix: read_frame(path).shape for path in files}
    assert shapes[".dcm"] == (1024, 512)


def png_that_says(rows, columns):
    header = b"IHDR" + struct.pack(">IIBBBBB", columns, rows, 16, 2, 0, 0, 0)
    chunks = [header, b"IDAT" + zlib.compress(bytes(1000)), b"IEND"]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk)) for chunk in chunks
    )


def jpeg_that_says(rows, columns):
    data = bytearray(cv2.imencode(".jpg", np.zeros((40, 60), np.uint8))[1].tobytes())
    at = data.index(b"\xff\xc0") + 5
    data[at : at + 4] = struct.pack(">HH", rows, columns)
    return bytes(data)


def test_the_size_is_checked_before_memory_is_taken(tmp_path):
    for content in [png_that_says(48_000, 48_000), jpeg_that_says(48_000, 48_000)]:
        (tmp_path / "a").write_bytes(content)
        with pytest.raises(FrameError, match="48000 x 48000 pixels; a frame may have 64 million"):
            read_frame(tmp_path / "a")


def test_an_animated_png_is_refused(tmp_path):
    image = pytest.importorskip("PIL.Image")
    frames = [image.fromarray(np.full((40, 60), level, np.uint8)) for level in (10, 200)]
    frames[0].save(tmp_path / "a.png", save_all=True, append_images=frames[1:])
    with pytest.raises(FrameError, match="an animated PNG; give a file for each frame"):
        read_frame(tmp_path / "a.png")


def test_an_array_of_a_file_of_its_own_comes_back(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.asfortranarray(FRAMES))
    np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "a.npy", AXES, None)), FRAMES)


def test_the_only_array_of_frames_is_found_and_others_are_asked_for(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", volume=FRAMES, pos=np.zeros(6))
    np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "a.npz", AXES, None)), FRAMES)
    np.savez_compressed(tmp_path / "b.npz", first=FRAMES, second=FRAMES[::-1])
    with pytest.raises(UnansweredError, match=r"which array has the frames.*first, second; give --array"):
        read_numpy(tmp_path / "b.npz", AXES, None)
    np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "b.npz", AXES, "second")), FRAMES[::-1])
    with pytest.raises(FrameError, match="no array 'third'; there are first, second"):
        read_numpy(tmp_path / "b.npz", AXES, "third")


def test_pickled_objects_are_never_opened(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([{"a": 1}], dtype=object))
    with pytest.raises(FrameError, match=r"a\.npy: damaged or an unknown kind of NumPy file"):
        read_numpy(tmp_path / "a.npy", AXES, None)


def test_arrays_of_no_grey_are_refused_before_their_axes_are_asked_for(tmp_path: Path) -> None:
    for kind in [bool, np.complex64, [("re", "f4"), ("im", "f4")], "M8[s]"]:
        np.save(tmp_path / "a.npy", np.zeros((5, 24, 40), kind))
        with pytest.raises(FrameError, match=r"a\.npy: pixels of type .*; give whole numbers or floats"):
            read_numpy(tmp_path / "a.npy", None, None)


def test_either_byte_order_and_any_number_is_read(tmp_path: Path) -> None:
    for kind in [">u2", "<i4", ">f8", np.float16]:
        frames = (FRAMES % 2048).astype(kind, order="F")
        np.save(tmp_path / "a.npy", frames)
        np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "a.npy", AXES, None)), FRAMES % 2048)


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", FRAMES)
    (tmp_path / "a.npy").write_bytes((tmp_path / "a.npy").read_bytes()[:-10])
    with pytest.raises(FrameError, match="unknown kind of NumPy file"):
        read_numpy(tmp_path / "a.npy", AXES, None)


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/real-oct")
def test_a_real_volume_is_frames_along_its_last_axis() -> None:
    scan = read_numpy(sorted((REAL / "needle-volumes").glob("*.npz"))[0], ("depth", "lateral", "frame"), None)
    assert (len(scan.names), scan.rows, scan.columns) == (64, 512, 64)
