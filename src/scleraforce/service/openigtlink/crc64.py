"""The CRC-64 of OpenIGTLink's bodies (ECMA-182, first bit first, start 0), fast enough for images, in NumPy.

A CRC that starts at 0 is linear over GF(2), and zeros in front do not change it. So a body is cut into lanes of equal
length, all lanes are run through the table side by side, 16 bits a step, and the lanes' remainders are put together by
their distance from the end: `crc = xor_i s_i x^(8 L i) mod P`, with `x^t mod P` tabled for every bit of every lane.
"""

from functools import cache

import numpy as np
from numpy.typing import NDArray

__all__ = ["POLYNOMIAL", "crc64"]

POLYNOMIAL = 0x42F0E1EBA9EA3693
MASK = (1 << 64) - 1
LANES = 1024  # at most, so that a step stays in the first cache
WORD_BYTES = 8
# Longer lanes put fewer remainders together, but take more steps: (lane bytes, from this many bytes on).
LANE_BYTES = ((512, 128 * 1024), (128, 8 * LANES), (WORD_BYTES, 0))

Words = NDArray[np.uint64]


def _shift_bit(value: int) -> int:
    """Multiply by x modulo P."""
    return ((value << 1) & MASK) ^ (POLYNOMIAL if value >> 63 else 0)


@cache
def _table() -> Words:
    """The remainders of all 16-bit values times x^64: (65536,)."""
    table = np.zeros(1 << 16, dtype=np.uint64)
    power = POLYNOMIAL
    for bit in range(16):
        table[1 << bit : 2 << bit] = table[: 1 << bit] ^ np.uint64(power)
        power = _shift_bit(power)
    return table


def _times(values: Words, factor: int) -> Words:
    """Multiply each value by one factor modulo P."""
    product = np.zeros_like(values)
    for bit in range(64):
        product ^= ((values >> np.uint64(bit)) & np.uint64(1)) * np.uint64(factor)
        factor = _shift_bit(factor)
    return product


@cache
def _weights(lane_bytes: int) -> Words:
    """`x^(8 L i + j) mod P` for lane i from the end and bit j of its remainder, highest first: (LANES + 1, 64)."""
    weights = (np.uint64(1) << np.arange(63, -1, -1, dtype=np.uint64)).reshape(1, 64)
    step = 1
    for _ in range(8 * lane_bytes):
        step = _shift_bit(step)
    while len(weights) <= LANES:
        weights = np.concatenate([weights, _times(weights, step)])
        step = int(_times(np.array([step], dtype=np.uint64), step)[0])
    return weights[: LANES + 1]


def _together(remainders: Words, weights: Words) -> int:
    """Put the remainders of lanes (the first is furthest from the end) together: (lane,), (lane, 64)."""
    bits = np.unpackbits(remainders.astype(">u8").view(np.uint8)).astype(np.bool_).reshape(weights.shape)
    return int(np.bitwise_xor.reduce(weights[bits])) if bits.any() else 0


def _lanes(padded: NDArray[np.uint8], lane_bytes: int) -> Words:
    """The remainder of each lane: (lane * lane_bytes,) to (lane,)."""
    steps_sl = np.ascontiguousarray(padded.view(">u2").reshape(-1, lane_bytes // 2).T).astype(np.uint64)
    table, state = _table(), np.zeros(steps_sl.shape[1], dtype=np.uint64)
    index, found = np.empty_like(state), np.empty_like(state)
    up, down = np.uint64(16), np.uint64(48)
    for step in steps_sl:
        np.right_shift(state, down, out=index)
        np.bitwise_xor(index, step, out=index)
        table.take(index.view(np.int64), out=found, mode="clip")
        np.left_shift(state, up, out=state)
        np.bitwise_xor(state, found, out=state)
    return state


def _block(data: NDArray[np.uint8], crc: int, lane_bytes: int) -> int:
    """The CRC after at most LANES lanes of bytes."""
    if data.size < WORD_BYTES:  # crc x^(8 n) + data x^64: what leaves the 64 bits moves on with the data
        moved = (crc >> (64 - 8 * data.size)) ^ int.from_bytes(data.tobytes(), "big")
        staying = (crc << (8 * data.size)) & MASK
        return staying ^ _together(np.array([moved], dtype=np.uint64), _weights(WORD_BYTES)[1:2])
    lanes = -(-data.size // lane_bytes)
    padded = np.zeros(lanes * lane_bytes, dtype=np.uint8)
    padded[padded.size - data.size :] = data
    start = padded.size - data.size
    padded[start : start + WORD_BYTES] ^= np.frombuffer(crc.to_bytes(WORD_BYTES, "big"), dtype=np.uint8)
    if lane_bytes == WORD_BYTES:  # a word is its own lane, not yet multiplied by x^64
        return _together(padded.view(">u8").astype(np.uint64), _weights(WORD_BYTES)[lanes:0:-1])
    return _together(_lanes(padded, lane_bytes), _weights(lane_bytes)[lanes - 1 :: -1])


def crc64(data: bytes | bytearray | memoryview | NDArray[np.uint8], crc: int = 0) -> int:
    """The CRC-64 of bytes, as OpenIGTLink's `crc64` (igtl_util.c) gives it.

    Args:
        data: contiguous bytes.
        crc: the CRC of what stood before them, so that a body can be checked while it arrives.

    >>> hex(crc64(b"123456789"))
    '0x6c40df5f0b497347'
    >>> hex(crc64(b"6789", crc64(b"12345")))
    '0x6c40df5f0b497347'
    """
    rest = np.frombuffer(data, dtype=np.uint8)
    while rest.size:
        lane_bytes = next(length for length, least in LANE_BYTES if rest.size >= least)
        size = min(rest.size, LANES * lane_bytes)
        crc = _block(rest[:size], crc, lane_bytes)
        rest = rest[size:]
    return crc
