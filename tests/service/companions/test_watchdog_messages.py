"""What the watchdog is told: what goes in comes out, anything else is one kind of error."""

import subprocess
import sys
from contextlib import suppress

import pytest
from hypothesis import given, strategies as st

from scleraforce.errors import MessageError
from scleraforce.openigtlink import Status, encode
from scleraforce.service.companions.watchdog import (
    MOST_BYTES,
    Beat,
    ClientCame,
    ClientLeft,
    ClientSpeaks,
    Emergency,
    PlannedEnd,
    WatchdogMessage,
    pack_for_watchdog,
    unpack_for_watchdog,
)

MESSAGES: list[WatchdogMessage] = [
    *(Emergency(version=version, status=encode(Status(3), "M", version=version)) for version in (1, 2, 3)),
    Emergency(version=1, status=b"\n" * 58),
    ClientCame(client=1),
    ClientSpeaks(client=10**17, version=3),
    ClientLeft(client=0),
    Beat(),
    PlannedEnd(),
]


@pytest.mark.parametrize("message", MESSAGES, ids=repr)
def test_what_is_sent_is_what_arrives(message: WatchdogMessage) -> None:
    assert unpack_for_watchdog(pack_for_watchdog(message)) == message


@pytest.mark.parametrize(
    "data",
    [
        b"", b"X", b"B ", b"QQ", b"C", b"C-1", b"C1 ", b"C1\n", b"C" + b"1" * 19, b"V1", b"V1 ", b"V1 4", b"V1 2 ",
        b"D", b"Dx", b"M1", b"M1 short", b"M4 " + b"x" * 100, b"M1 " + b"x" * MOST_BYTES, b"C\xd9\xa1",
    ],
    ids=lambda data: repr(data[:20]),
)  # fmt: skip
def test_what_is_no_message_is_refused(data: bytes) -> None:
    with pytest.raises(MessageError, match=f"{len(data)} bytes: no message to the watchdog"):
        unpack_for_watchdog(data)


@given(st.binary(max_size=80))
def test_any_bytes_are_a_message_or_that_error(data: bytes) -> None:
    with suppress(MessageError):
        assert pack_for_watchdog(unpack_for_watchdog(data)) == data or data[:1] in b"CVD"  # numbers with zeros before


@pytest.mark.parametrize(
    "message", [Emergency(version=4, status=b"x" * 58), ClientSpeaks(client=1, version=0), ClientCame(client=-1)]
)
def test_what_would_not_be_understood_is_not_sent(message: WatchdogMessage) -> None:
    with pytest.raises(MessageError):
        pack_for_watchdog(message)


def test_the_watchdog_needs_the_standard_library_alone() -> None:
    program = (
        "import sys; import scleraforce.service.companions.watchdog;"
        "sys.exit(str([name for name in ('numpy', 'cv2', 'json') if name in sys.modules] or ''))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""
