"""The pixels of ROS image messages, raw and compressed."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import FrameError

# Encodings of sensor_msgs/Image: type and number of samples of a pixel, and how colours become grey.
ENCODINGS: dict[str, tuple[str, int, int | None]] = {
    "mono8": ("u1", 1, None),
    "8UC1": ("u1", 1, None),
    "mono16": ("u2", 1, None),
    "16UC1": ("u2", 1, None),
    "16SC1": ("i2", 1, None),
    "32FC1": ("f4", 1, None),
    "rgb8": ("u1", 3, cv2.COLOR_RGB2GRAY),
    "bgr8": ("u1", 3, cv2.COLOR_BGR2GRAY),
    "rgba8": ("u1", 4, cv2.COLOR_RGBA2GRAY),
    "bgra8": ("u1", 4, cv2.COLOR_BGRA2GRAY),
}


# What decides on the meaning of a message's bytes, and stays the same within a topic.
FIELDS = ("encoding", "is_bigendian", "height", "width", "step", "format")


def image_fields(message: Any) -> dict[str, object]:
    """Return those fields of a sensor_msgs Image or CompressedImage that decide on the meaning of its bytes."""
    return {name: getattr(message, name) for name in FIELDS if hasattr(message, name)}


def image_pixels(message: Any, place: str) -> NDArray[Any]:
    """Return the grey pixels (row, column) of a sensor_msgs Image or CompressedImage; `place` stands in messages.

    Raises:
        FrameError: an encoding that is not read, or less data than the message says.
    """
    return _compressed(message, place) if hasattr(message, "format") else _raw(message, place)


def _raw(message: Any, place: str) -> NDArray[Any]:
    known = ENCODINGS.get(message.encoding)
    if known is None:
        raise FrameError(f"{place}: encoding {message.encoding!r}; one of {', '.join(ENCODINGS)}")
    code, samples, colour = known
    kind = np.dtype((">" if message.is_bigendian else "<") + code)
    rows, columns, step = int(message.height), int(message.width), int(message.step)
    data = np.asarray(message.data, dtype=np.uint8)
    if step < columns * samples * kind.itemsize or data.size < rows * step:
        raise FrameError(f"{place}: damaged: {data.size} bytes for {rows} rows of {step}")
    lines = np.ascontiguousarray(data[: rows * step].reshape(rows, step)[:, : columns * samples * kind.itemsize])
    pixels = lines.view(kind).astype(kind.newbyteorder("=")).reshape(rows, columns, samples)
    return pixels[..., 0] if colour is None else np.asarray(cv2.cvtColor(pixels, colour))


def _compressed(message: Any, place: str) -> NDArray[Any]:
    data = np.asarray(message.data, dtype=np.uint8)
    if data[:2].tobytes() not in (b"\x89P", b"\xff\xd8"):
        raise FrameError(f"{place}: compressed as {message.format!r}; PNG and JPEG are read")
    pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise FrameError(f"{place}: damaged: an image that cannot be decoded")
    return np.asarray(pixels if pixels.ndim == 2 else cv2.cvtColor(pixels[..., :3], cv2.COLOR_BGR2GRAY))
