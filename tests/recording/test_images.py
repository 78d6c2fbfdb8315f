"""PNG, JPEG and NumPy files."""

import struct
import zlib
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import mkdtemp

import cv2
import numpy as np
import pytest
import tifffile
from foreign_files import FRAMES, STORED, pictures_of, write_dicom

from scleraforce.errors import FrameError
from scleraforce.recording.images import read_frame, read_image, read_numpy
from scleraforce.recording.pixels import AXES, UnansweredError

REAL = Path(__file__).parents[3] / "shared" / "real-oct"
RAMP = np.arange(40 * 60, dtype=np.uint16).reshape(40, 60)
BYTES = RAMP.astype(np.uint8)


def test_pictures_are_read_unchanged(tmp_path: Path) -> None:
    for pixels in (BYTES, RAMP):
        cv2.imwrite(str(tmp_path / "a.png"), pixels)
        read = read_frame(tmp_path / "a.png")
        assert read.dtype == pixels.dtype
        np.testing.assert_array_equal(read, pixels)
    data, chunks = cv2.imencode(".png", RAMP)[1].tobytes(), b""
    for chunk in (b"sRGB\0", b"gAMA" + (45455).to_bytes(4, "big")):  # profiles do not change counts
        chunks += png_chunk(chunk)
    (tmp_path / "a.png").write_bytes(data[:33] + chunks + data[33:])
    np.testing.assert_array_equal(read_frame(tmp_path / "a.png"), RAMP)


def test_colour_becomes_grey_alike_in_all_formats(tmp_path: Path) -> None:
    grey = np.full((40, 60), 90, dtype=np.uint8)
    colour = np.dstack([grey, grey // 2, grey * 2])  # OpenCV's order: blue, green, red
    cv2.imwrite(str(tmp_path / "a.png"), colour)
    cv2.imwrite(str(tmp_path / "a.jpg"), colour, [cv2.IMWRITE_JPEG_QUALITY, 100])
    tifffile.imwrite(tmp_path / "a.tif", np.ascontiguousarray(colour[..., ::-1]), photometric="rgb")
    for name in ("a.png", "a.jpg", "a.tif"):
        pixels = read_frame(tmp_path / name)
        assert np.abs(pixels.astype(int) - round(0.114 * 90 + 0.587 * 45 + 0.299 * 180)).max() <= 1
    picture = pytest.importorskip("PIL.Image").frombytes("P", (60, 40), BYTES.tobytes())
    picture.putpalette([255 - level for level in range(256) for _ in range(3)])
    picture.save(tmp_path / "a.png")
    np.testing.assert_array_equal(read_frame(tmp_path / "a.png"), 255 - BYTES)
    cv2.imwrite(str(tmp_path / "a.png"), np.dstack([grey, grey, grey, np.full_like(grey, 7)]))
    pixels, scan = read_image(tmp_path / "a.png")
    np.testing.assert_array_equal(pixels, grey)
    assert any("transparency" in note for note in scan.notes)


def png_chunk(chunk: bytes) -> bytes:
    return struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))


def with_exif(picture: np.ndarray, ending: str, orientation: int, order: str) -> bytes:
    """Encode a picture as PNG or JPEG with an EXIF orientation."""
    data = cv2.imencode(ending, np.ascontiguousarray(picture), [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    kind = {"<": b"II*\0\x08\0\0\0", ">": b"MM\0*\0\0\0\x08"}[order]
    held = kind + struct.pack(f"{order}HHHIHHI", 1, 274, 3, 1, orientation, 0, 0)
    if ending == ".jpg":
        body = b"Exif\0\0" + held
        return data[:2] + b"\xff\xe1" + (len(body) + 2).to_bytes(2, "big") + body + data[2:]
    return data[:33] + png_chunk(b"eXIf" + held) + data[33:]


def test_pictures_are_shown_as_their_exif_says(tmp_path: Path) -> None:
    shown, path = np.add.outer(np.arange(48) * 2, np.arange(64)).astype(np.uint8), tmp_path / "a"
    for ending, order, (orientation, stored) in product((".png", ".jpg"), "<>", STORED.items()):
        path.write_bytes(with_exif(stored(shown), ending, orientation, order))
        pixels, scan = read_image(path)
        assert pixels.shape == shown.shape == (scan.rows, scan.columns)
        assert np.abs(pixels.astype(int) - shown).max() <= 2
        assert any("Orientation" in note for note in scan.notes) is (orientation != 1)


def animated(path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    frames = [image.fromarray(np.full((40, 60), level, np.uint8)) for level in (10, 200)]
    frames[0].save(path, "PNG", save_all=True, append_images=frames[1:])


def large(path: Path, ending: str) -> None:
    """Write a picture whose header says 48,000 x 48,000 pixels."""
    data = bytearray(cv2.imencode(ending, BYTES)[1].tobytes())
    at, kind = (16, ">II") if ending == ".png" else (data.index(b"\xff\xc0") + 5, ">HH")
    struct.pack_into(kind, data, at, 48_000, 48_000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29])) if ending == ".png" else data[29:33]
    path.write_bytes(data)


def test_what_is_not_a_frame_is_named(tmp_path: Path) -> None:
    for write, message in [
        (lambda path: path.write_bytes(b""), "an empty file; give a PNG"),
        (lambda path: path.write_bytes(b"file,time_s\n"), "not an image that can be read; give a PNG"),
        (lambda path: path.mkdir(), "a folder; give a regular file"),
        (lambda _: None, "No such file"),
        (lambda path: tifffile.imwrite(path, np.stack([RAMP, RAMP])), "2 frames in one file; give a file for each"),
        (lambda path: tifffile.imwrite(path, np.full((9, 9), np.nan)), "81 pixels that are NaN or infinite"),
        (lambda path: tifffile.imwrite(path, np.ones((9, 9), np.float32)), "float32 pixels; give whole numbers"),
        (lambda path: tifffile.imwrite(path, np.ones((9, 9), np.uint32)), "uint32 pixels; give whole numbers"),
        (lambda path: tifffile.imwrite(path, np.ones((1, 9), np.uint8)), "give one frame, rows x columns"),
        (lambda path: write_dicom(path, np.stack([RAMP] * 6)), "6 frames in one file"),
        (animated, "an animated PNG; give a file for each frame"),
        (lambda path: path.write_bytes(with_exif(BYTES, ".jpg", 9, "<")), "EXIF Orientation 9"),
        *((partial(large, ending=ending), "48000 x 48000 pixels; a frame may have 64") for ending in (".png", ".jpg")),
    ]:
        path = Path(mkdtemp(dir=tmp_path)) / "a.img"
        write(path)
        with pytest.raises(FrameError, match=message) as caught:
            read_frame(path)
        assert str(caught.value).startswith(f"{path}: ")


def encoded(name: str, folder: Path) -> bytes:
    if name.endswith("dcm"):
        write_dicom(folder / name, RAMP)
    elif name.endswith("tif"):
        tifffile.imwrite(folder / name, RAMP)
    else:
        cv2.imwrite(str(folder / name), RAMP if name.endswith("png") else BYTES)
    return (folder / name).read_bytes()


def test_a_truncated_file_is_an_error(tmp_path: Path) -> None:
    for name, share in product(["a.png", "a.jpg", "a.tif", "a.dcm"], [0.3, 0.7, 0.97]):
        data = encoded(name, tmp_path)
        (tmp_path / "cut").write_bytes(data[: int(len(data) * share)])
        with pytest.raises(FrameError, match="cut: "):
            read_frame(tmp_path / "cut")


def test_every_flipped_bit_of_a_png_is_an_error(tmp_path: Path) -> None:
    data = bytearray(encoded("a.png", tmp_path))
    path = tmp_path / "flipped.png"
    for at in range(8, len(data), 7):
        data[at] ^= 16
        path.write_bytes(data)
        with pytest.raises(FrameError, match=r"flipped\.png: "):
            read_frame(path)
        data[at] ^= 16


def test_arrays_of_either_byte_order_and_any_number_come_back(tmp_path: Path) -> None:
    for kind in ["<u2", ">u2", "<i4", ">f8", np.float16]:
        np.save(tmp_path / "a.npy", (FRAMES % 2048).astype(kind, order="F"))
        np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "a.npy", AXES, None)), FRAMES % 2048)


def test_the_only_array_of_frames_is_found_and_others_are_asked_for(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", volume=FRAMES, pos=np.zeros(6))
    np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "a.npz", AXES, None)), FRAMES)
    np.savez_compressed(tmp_path / "b.npz", first=FRAMES, second=FRAMES[::-1])
    with pytest.raises(UnansweredError, match=r"b\.npz: which array has the frames.*first, second; give --array"):
        read_numpy(tmp_path / "b.npz", AXES, None)
    np.testing.assert_array_equal(pictures_of(read_numpy(tmp_path / "b.npz", AXES, "second")), FRAMES[::-1])
    with pytest.raises(FrameError, match="no array 'third'; there are first, second"):
        read_numpy(tmp_path / "b.npz", AXES, "third")


def test_arrays_that_are_not_grey_or_not_whole_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    for kind in [bool, np.complex64, [("re", "f4"), ("im", "f4")], "M8[s]"]:
        np.save(path, np.zeros((5, 24, 40), kind))
        with pytest.raises(FrameError, match=r"a\.npy: pixels of type .*; give whole numbers or floats"):
            read_numpy(path, None, None)  # before the axes are asked for
    np.save(path, FRAMES)
    path.write_bytes(path.read_bytes()[:-10])
    with pytest.raises(FrameError, match=r"a\.npy: damaged or an unknown kind of NumPy file"):
        read_numpy(path, AXES, None)
    np.save(path, np.array([{"a": 1}], dtype=object))  # pickled objects are never opened
    with pytest.raises(FrameError, match=r"a\.npy: damaged or an unknown kind of NumPy file"):
        read_numpy(path, AXES, None)


@pytest.mark.real
@pytest.mark.skipif(not REAL.exists(), reason="no ../shared/real-oct")
def test_a_real_volume_is_frames_along_its_last_axis() -> None:
    scan = read_numpy(sorted((REAL / "needle-volumes").glob("*.npz"))[0], ("depth", "lateral", "frame"), None)
    assert (len(scan.names), scan.rows, scan.columns) == (64, 512, 64)
