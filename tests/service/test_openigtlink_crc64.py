"""The CRC against a bitwise second implementation and the known check value."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scleraforce.service.openigtlink.crc64 import POLYNOMIAL, crc64


def bitwise(data: bytes, crc: int = 0) -> int:
    for byte in data:
        crc ^= byte << 56
        for _ in range(8):
            crc = ((crc << 1) & (2**64 - 1)) ^ (POLYNOMIAL if crc >> 63 else 0)
    return crc


def test_the_check_value_of_ecma_182() -> None:
    assert crc64(b"123456789") == 0x6C40DF5F0B497347
    assert crc64(b"") == 0


# Both sides of every change of the lane's length and of a full block.
@pytest.mark.parametrize("size", [*range(26), 511, 513, 8191, 8192, 8193, 65535, 65537, 131071, 131072, 132001])
def test_every_length_agrees_with_the_bitwise_crc(size: int) -> None:
    draw = np.random.default_rng(size)
    data, before = draw.bytes(size), int(draw.integers(2**63)) * 2 + 1
    assert crc64(data, before) == bitwise(data, before)


def test_a_crc_that_runs_along_equals_that_of_the_whole() -> None:
    data = np.random.default_rng(1).bytes(524_360)
    whole = crc64(data)
    for cut in (1, 7, 8, 65536, 524_359):
        assert crc64(data[cut:], crc64(data[:cut])) == whole
    changed = bytearray(data)
    changed[300_000] ^= 1
    assert crc64(changed) != whole


@given(st.binary(max_size=300), st.integers(0, 2**64 - 1))
def test_any_bytes_after_any_crc(data: bytes, before: int) -> None:
    assert crc64(data, before) == bitwise(data, before)
