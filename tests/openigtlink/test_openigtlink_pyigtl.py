"""pyigtl, an independent peer, reads and is read (no STATUS, SENSOR or big-endian pixels there)."""

import numpy as np
import pytest

from scleraforce.openigtlink import Decoder, Image, Received, Text, Transform, encode
from scleraforce.service.scanner_image import FrameAssembler

pyigtl = pytest.importorskip("pyigtl")
messages = pytest.importorskip("pyigtl.messages")

VERSIONS = [1, 2]
MATRIX = np.array([[0.0, -2.0, 0.0, 5.0], [1.0, 0.0, 0.0, -3.0], [0.0, 0.0, 4.0, 0.5], [0.0, 0.0, 0.0, 1.0]])


def read_by_pyigtl(data: bytes):
    fields = messages.MessageBase.parse_header(data[:58])
    message = messages.MessageBase.create_message(fields["message_type"])
    assert fields["body_size"] == len(data) - 58
    message.unpack(fields, data[58:])
    return message


def written_by_pyigtl(message, version: int) -> Received:
    message.header_version = version
    if version > 1:
        message.message_id, message.metadata = 9, {"eye": "left", "probe": "b"}
    (event,) = Decoder().feed(message.pack())
    assert isinstance(event, Received)  # its CRC is right
    assert event.header.version == version
    assert event.header.time_s == pytest.approx(1234.5, abs=1e-6)
    assert (event.message_id, event.metadata) == ((9, {"eye": "left", "probe": "b"}) if version > 1 else (0, {}))
    return event


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("dtype", [np.int8, np.uint8, np.int16, np.uint16])
def test_images_are_read_and_written(dtype: np.dtype, version: int) -> None:
    pixels = np.arange(60).reshape(1, 6, 10).astype(dtype)
    event = written_by_pyigtl(pyigtl.ImageMessage(pixels, timestamp=1234.5, device_name="Scanner"), version)
    assert isinstance(event.message, Image)
    assert np.array_equal(event.message.pixels, pixels)
    ours = encode(Image(pixels.astype(pixels.dtype.newbyteorder("="))), "Scanner", version=version)
    theirs = read_by_pyigtl(ours)
    assert theirs.image.dtype.itemsize == pixels.dtype.itemsize
    assert np.array_equal(theirs.image.reshape(pixels.shape), pixels)


def test_its_image_becomes_a_frame_with_the_pixels_of_its_matrix() -> None:
    """Columns 0.003 * 5 mm apart, rows 0.001 * 3 mm, in a plane that lies askew."""
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1] = 0.003 * np.array([3.0, 0.0, 4.0]), 0.001 * np.array([1.0, -2.0, 2.0])
    pixels = np.arange(60, dtype=np.int16).reshape(1, 6, 10)
    message = pyigtl.ImageMessage(pixels, ijk_to_world_matrix=matrix, timestamp=1234.5)
    image = written_by_pyigtl(message, 1).message
    assert isinstance(image, Image)
    frame = FrameAssembler().add(image)
    assert frame is not None
    assert (frame.lateral_m, frame.depth_m) == pytest.approx((15e-6, 3e-6), rel=1e-6)
    assert frame.pixels.dtype == np.uint16
    assert np.array_equal(frame.pixels, pixels[0])


@pytest.mark.parametrize("version", VERSIONS)
def test_strings_and_transforms_are_read_and_written(version: int) -> None:
    assert written_by_pyigtl(pyigtl.StringMessage("force", timestamp=1234.5), version).message == Text("force")
    assert read_by_pyigtl(encode(Text("force"), "M", version=version)).string == "force"
    found = written_by_pyigtl(pyigtl.TransformMessage(MATRIX, timestamp=1234.5), version).message
    assert isinstance(found, Transform)
    assert np.array_equal(np.reshape(found.matrix, (4, 3)).T, MATRIX[:3])
    assert np.array_equal(read_by_pyigtl(encode(found, "M", version=version)).matrix, MATRIX)


def test_our_metadata_is_read() -> None:
    theirs = read_by_pyigtl(encode(Text("a"), "M", version=2, message_id=3, metadata={"eye": "left", "b": ""}))
    assert (theirs.message_id, theirs.metadata) == (3, {"eye": "left", "b": ""})
