"""MetaImage, written by its library and by hand as its specification says."""

import zlib
from pathlib import Path

import numpy as np
import pytest
from format_frames import COLUMNS, COUNT, FRAMES, ROWS, pictures_of
from plus_fields import plus_fields

from scleraforce.errors import FrameError
from scleraforce.recording.volumes import read_metaimage

IJK = ("lateral", "depth", "frame")  # the fastest first
BIG = FRAMES.astype(">u2").tobytes()


@pytest.mark.parametrize("packed", [False, True])
def test_a_metaimage_comes_back_with_its_spacing(tmp_path: Path, packed: bool) -> None:
    metaimageio = pytest.importorskip("metaimageio")
    metaimageio.write(tmp_path / "a.mha", FRAMES, ElementSpacing=[0.015, 0.004, 0.1], CompressedData=packed)
    scan = read_metaimage(tmp_path / "a.mha", IJK)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))


def test_a_metaimage_by_the_letter_of_its_specification(tmp_path: Path) -> None:
    header = (
        f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nDimSize = {COLUMNS} {ROWS} "
        f"{COUNT}\nElementSpacing = 0.015 0.004 1\nElementType = MET_USHORT\nElementDataFile = "
    )
    (tmp_path / "a.mha").write_bytes(f"{header}LOCAL\n".encode() + FRAMES.tobytes())
    (tmp_path / "b.mhd").write_text(f"{header}b.raw\n")
    (tmp_path / "b.raw").write_bytes(FRAMES.tobytes())
    packed = zlib.compress(FRAMES.tobytes())
    sizes = f"CompressedData = True\nCompressedDataSize = {len(packed)}\nElementDataFile"
    (tmp_path / "c.mhd").write_text(f"{header}c.zraw\n".replace("ElementDataFile", sizes))
    (tmp_path / "c.zraw").write_bytes(packed)
    for name in ("a.mha", "b.mhd", "c.mhd"):
        np.testing.assert_array_equal(pictures_of(read_metaimage(tmp_path / name, IJK)), FRAMES)


def mha(path: Path, pixels: bytes | None = None, **fields: object) -> Path:
    """Write a MetaImage of FRAMES; a field of None is left out."""
    known = {
        "ObjectType": "Image", "NDims": 3, "BinaryData": "True", "BinaryDataByteOrderMSB": "False",
        "DimSize": f"{COLUMNS} {ROWS} {COUNT}", "ElementSpacing": "0.015 0.004 0.1", "ElementType": "MET_USHORT",
    }  # fmt: skip
    stated = {name: value for name, value in (known | fields).items() if value is not None}
    stated["ElementDataFile"] = stated.pop("ElementDataFile", "LOCAL")
    header = "".join(f"{name} = {value}\n" for name, value in stated.items()).encode()
    pixels = FRAMES.tobytes() if pixels is None else pixels
    local = stated["ElementDataFile"] == "LOCAL"
    path.write_bytes(header + (pixels if local else b""))
    if not local:
        path.with_name(str(stated["ElementDataFile"])).write_bytes(pixels)
    return path


TEXT = " ".join(map(str, FRAMES.ravel().tolist())).encode()


@pytest.mark.parametrize(
    ("pixels", "fields"),
    [
        (None, {}),
        (None, {"BinaryData": None}),
        (None, {"BinaryData": "T"}),
        (TEXT, {"BinaryData": "False"}),
        (TEXT, {"BinaryData": "False", "ElementDataFile": "a.txt"}),
        (BIG, {"BinaryDataByteOrderMSB": "True"}),
        (BIG, {"BinaryDataByteOrderMSB": None, "ElementByteOrderMSB": "True"}),
        (b"x" * 100 + FRAMES.tobytes(), {"HeaderSize": -1, "ElementDataFile": "a.raw"}),
        (b"x" * 100 + FRAMES.tobytes(), {"HeaderSize": 100, "ElementDataFile": "a.raw"}),
        (FRAMES.astype("<i4").tobytes(), {"ElementType": "MET_LONG"}),
        (FRAMES.astype("<u8").tobytes(), {"ElementType": "MET_ULONG_LONG"}),
        (zlib.compress(BIG), {"CompressedData": "True", "BinaryDataByteOrderMSB": "True"}),
    ],
)
def test_the_storage_that_a_metaimage_states_is_honoured(tmp_path: Path, pixels: bytes | None, fields: dict) -> None:
    scan = read_metaimage(mha(tmp_path / "a.mhd", pixels, **fields), IJK)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))
    assert scan.notes == ()


@pytest.mark.parametrize(
    ("pixels", "fields", "message"),
    [
        (b"x" + FRAMES.tobytes(), {"ElementDataFile": "a.raw"}, r"a\.raw: damaged: 9601 bytes .* take 9600"),
        (None, {"DimSize": "40 24 4"}, "9600 bytes of pixels; DimSize = 40 24 4 .* take 7680"),
        (None, {"DimSize": "40 24"}, "NDims = 3, and DimSize has 2 numbers"),
        (None, {"DimSize": None}, "its header has no DimSize"),
        (None, {"ElementSpacing": "1 2"}, "ElementSpacing has 2 numbers"),
        (None, {"HeaderSize": 100}, "HeaderSize = 100 beside pixels in the same file"),
        (None, {"CompressedData": "True", "BinaryData": "False"}, "BinaryData = False and CompressedData = True"),
        (None, {"BinaryData": "Maybe"}, "BinaryData = Maybe"),
        (None, {"ElementByteOrderMSB": "True"}, "BinaryDataByteOrderMSB = False and ElementByteOrderMSB = True"),
        (None, {"ElementNumberOfChannels": 3}, "ElementNumberOfChannels = 3"),
        (None, {"ElementType": "MET_USHORT_ARRAY"}, "ElementType = MET_USHORT_ARRAY"),
        (None, {"ElementDataFile": "LIST"}, "ElementDataFile = LIST"),
        (None, {"ElementDataFile": "a%03d.raw 1 5 1"}, "ElementDataFile = a%03d.raw 1 5 1"),
        (None, {"HeaderSizePerSlice": 8}, "HeaderSizePerSlice = 8"),
        (None, {"ObjectType": "Tube"}, "ObjectType = Tube"),
        (None, {"TransformMatrix": "0.5 0 0 0 1 0 0 0 1"}, "TransformMatrix has directions of length 0.5 x 1 x 1"),
        (None, {"elementspacing": "1 2 3"}, "elementspacing is stated twice: '0.015 0.004 0.1' and '1 2 3'"),
        (TEXT.replace(b" 77 ", b" 70000 "), {"BinaryData": "False"}, "pixel 77 is 70000"),
        (TEXT.replace(b" 77 ", b" 7.5 "), {"BinaryData": "False"}, "pixel 77 is 7.5"),
        (None, {"UltrasoundImageOrientation": "MN"}, "UltrasoundImageOrientation = MN"),
        (None, {"UltrasoundImageOrientation": "FM"}, "UltrasoundImageOrientation = FM: depth is axis 1"),
    ],
)
def test_what_a_metaimage_contradicts_or_what_is_not_read_is_refused_by_name(
    tmp_path: Path, pixels: bytes | None, fields: dict, message: str
) -> None:
    with pytest.raises(FrameError, match=message):
        read_metaimage(mha(tmp_path / "a.mhd", pixels, **fields), IJK)


@pytest.mark.parametrize(
    ("fields", "depth_m", "notes"),
    [
        ({"ElementSpacing": None}, None, 0),
        ({"ElementSpacing": "1 1 1"}, None, 0),
        ({"ElementSpacing": None, "ElementSize": "0.015 0.004 0.1"}, 4e-6, 0),
        ({"ElementSize": "0.015 0.008 0.1"}, 4e-6, 1),
        ({"BinaryDataByteOrderMSB": None}, 4e-6, 1),
        ({"UltrasoundImageOrientation": "UNKNOWN"}, 4e-6, 1),
    ],
)
def test_what_a_metaimage_does_not_state_stays_open_or_is_noted(
    tmp_path: Path, fields: dict, depth_m: float | None, notes: int
) -> None:
    scan = read_metaimage(mha(tmp_path / "a.mha", **fields), IJK)
    assert (scan.depth_pixel_m and scan.depth_pixel_m.value) == (depth_m and pytest.approx(depth_m))
    assert len(scan.notes) == notes


def test_a_sequence_of_plus_has_its_own_times_and_leaves_out_invalid_frames(tmp_path: Path) -> None:
    stamps = [10.0, 10.25, 0.0, 11.0, 12.0]
    scan = read_metaimage(mha(tmp_path / "a.mha", **plus_fields(stamps, ["OK", "OK", "INVALID", "OK", "OK"])), IJK)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES[[0, 1, 3, 4]])
    np.testing.assert_allclose(scan.times.time_s, [10.0, 10.25, 11.0, 12.0])
    assert any("frames 2 (from 0) are left out" in note for note in scan.notes)


def test_times_of_plus_that_do_not_rise_are_noted_and_left_open(tmp_path: Path) -> None:
    scan = read_metaimage(mha(tmp_path / "a.mha", **plus_fields([1, 2, 3, 2.5, 4])), IJK)
    assert scan.times is None
    assert any("does not rise: 3 (frame 2) and 2.5 (frame 3)" in note for note in scan.notes)


def test_a_sequence_of_plus_with_other_frames_or_none_that_is_valid_is_refused(tmp_path: Path) -> None:
    fields = plus_fields(range(COUNT)) | {"UltrasoundImageOrientation": None}
    with pytest.raises(FrameError, match=r"Seq_FrameNNNN_Timestamp of 5 frames, 0 to 4, and 40"):
        read_metaimage(mha(tmp_path / "a.mha", **fields), ("frame", "depth", "lateral"))
    with pytest.raises(FrameError, match=r"ImageStatus = INVALID for all 5 frames"):
        read_metaimage(mha(tmp_path / "a.mha", **plus_fields(range(COUNT), ["INVALID"] * COUNT)), IJK)
