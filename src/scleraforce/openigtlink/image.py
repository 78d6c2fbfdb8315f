"""IMAGE, version 1: pixels of 8 or 16 bits in either byte order, whole images and sub-volumes."""

import math
import struct
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scleraforce.errors import ProtocolError

HEAD = struct.Struct(">HBBBB3H12f3H3H")
SCALARS: dict[int, np.dtype[Any]] = {
    2: np.dtype(np.int8),
    3: np.dtype(np.uint8),
    4: np.dtype(np.int16),
    5: np.dtype(np.uint16),
}
CODES = {dtype: code for code, dtype in SCALARS.items()}
ORDERS: dict[int, Literal["<", ">"]] = {1: ">", 2: "<"}
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Image:
    """One image, or a part of one.

    Attributes:
        pixels: (slice, row, column) or, of several components, (slice, row, column, component); int8, uint8, int16 or
            uint16 of this machine's byte order; read-only when it was received.
        matrix: as sent: the steps to the next column, row and slice (mm), then the centre's position (mm).
        size: columns, rows and slices of the whole image; None: `pixels` is all of it.
        offset: column, row and slice of the whole image where `pixels` begins.
        coordinates: 1: RAS, 2: LPS.
    """

    pixels: NDArray[Any]
    matrix: tuple[float, ...] = IDENTITY
    size: tuple[int, int, int] | None = None
    offset: tuple[int, int, int] = (0, 0, 0)
    coordinates: int = 1


def pack_image(image: Image, *, little_endian: bool = True) -> bytes:
    """Return the body of an image.

    Raises:
        ProtocolError: pixels of another type, or of a shape or place that the message cannot state.
    """
    pixels = image.pixels
    if pixels.ndim not in (3, 4) or pixels.dtype not in CODES or not pixels.size:
        raise ProtocolError(
            f"pixels {pixels.dtype} {pixels.shape}: must be 8 or 16 bit, (slice, row, column[, component])"
        )
    part = pixels.shape[2], pixels.shape[1], pixels.shape[0]
    components = pixels.shape[3] if pixels.ndim == 4 else 1
    size = image.size or part
    _check_place(size, image.offset, part)
    if max(size) > 0xFFFF or components > 0xFF or len(image.matrix) != 12:
        raise ProtocolError(
            f"image of {size}, {components} components, {len(image.matrix)} matrix elements: out of range"
        )
    order = 2 if little_endian else 1
    code = CODES[pixels.dtype]
    head = HEAD.pack(1, components, code, order, image.coordinates, *size, *image.matrix, *image.offset, *part)
    return head + np.ascontiguousarray(pixels, dtype=pixels.dtype.newbyteorder(ORDERS[order])).tobytes()


def unpack_image(body: memoryview) -> Image:
    """Read the body of an image; pixels in this machine's byte order, at an even place, are a view into the body.

    Raises:
        ProtocolError: the body is cut short, of an unsupported type, or its sizes contradict each other.
    """
    if len(body) < HEAD.size:
        raise ProtocolError(f"IMAGE: {len(body)} bytes, must be at least {HEAD.size}")
    version, components, code, order, coordinates, *rest = HEAD.unpack_from(body)
    size, matrix, offset, part = tuple(rest[:3]), tuple(rest[3:15]), tuple(rest[15:18]), tuple(rest[18:])
    if version not in (1, 2) or code not in SCALARS or order not in ORDERS or not components:
        raise ProtocolError(
            f"IMAGE: version {version}, scalar type {code}, byte order {order}, {components} components"
        )
    if not all(map(math.isfinite, matrix)):
        raise ProtocolError("IMAGE: the matrix is not finite")
    _check_place(size, offset, part)
    dtype = SCALARS[code].newbyteorder(ORDERS[order])
    stated = math.prod(part) * components * dtype.itemsize
    if len(body) - HEAD.size != stated:
        raise ProtocolError(f"IMAGE: {len(body) - HEAD.size} bytes of pixels, must be {stated}")
    shape = part[::-1] if components == 1 else (*part[::-1], components)
    received = np.frombuffer(body, dtype=dtype, offset=HEAD.size)
    pixels = np.require(received, SCALARS[code], "A").reshape(shape)
    pixels.flags.writeable = False
    return Image(pixels, matrix, size, offset, coordinates)


def _check_place(size: tuple[int, ...], offset: tuple[int, ...], part: tuple[int, ...]) -> None:
    inside = all(o >= 0 and p > 0 and o + p <= s for s, o, p in zip(size, offset, part, strict=True))
    if not inside:
        raise ProtocolError(f"IMAGE: a part of {part} at {offset} does not lie in {size}")
