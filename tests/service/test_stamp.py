"""The time in an encoded message, against the codec's own header."""

import pytest

from scleraforce.openigtlink import Status, encode
from scleraforce.openigtlink.wire import HEADER_BYTES, VERSIONS, unpack_header
from scleraforce.service.stamp import stamp_time, stamped_s


@pytest.mark.parametrize("version", VERSIONS)
def test_a_stamp_changes_the_time_and_nothing_else(version: int) -> None:
    message = bytearray(encode(Status(1), "ForceMonitor", version=version, time_s=1.25))
    assert stamped_s(message) == 1.25
    stamp_time(message, 1.8e9 + 0.5)
    assert unpack_header(message[:HEADER_BYTES]).time_s == stamped_s(message) == 1.8e9 + 0.5
    assert message == encode(Status(1), "ForceMonitor", version=version, time_s=1.8e9 + 0.5)
