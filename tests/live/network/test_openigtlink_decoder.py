"""Every message whole, byte by byte and with trailing data; streams that are wrong;
bytes that are anything.
"""

import struct
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from effects import less_than
from fastcrc.crc64 import ecma_182
from hypothesis import given, settings, strategies as st

import scleraforce.live.network.openigtlink as igtl
from monitor.messages import run
from scleraforce.base.errors import ProtocolError
from scleraforce.live.network.openigtlink import HEADER_BYTES, Decoder

DRAW = np.random.default_rng(5)
PIXELS = {
    dtype: DRAW.integers(0, 120, (2, 3, 5)).astype(dtype)
    for dtype in (np.int8, np.uint8, np.int16, np.uint16)
}
MESSAGES = [
    *[igtl.Image(pixels) for pixels in PIXELS.values()],
    igtl.Image(
        PIXELS[np.uint16] * np.uint16(500), (0.01,) * 12, (20, 10, 4), (15, 7, 2), 2
    ),
    igtl.Image(DRAW.integers(0, 255, (1, 4, 4, 3)).astype(np.uint8)),
    igtl.Status(1, -7, "Ready", "class 0, 1.2 mN"),
    igtl.Status(13),
    igtl.Text('{"force_mn": 12.5}'),
    igtl.Text("µN"),
    igtl.Text(""),
    igtl.Sensor((1.5, -2.0, 1e300), 0x123456789, 1),
    igtl.Sensor(()),
    igtl.Transform((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 2.5, -3.0, 4.0)),
    igtl.Query("STATUS"),
    igtl.Query("TRANSFORM"),
]


def same(found: igtl.Message, sent: igtl.Message) -> bool:
    if isinstance(found, igtl.Image) and isinstance(sent, igtl.Image):
        fields = (
            np.float32(found.matrix).tolist() == np.float32(sent.matrix).tolist()
            and found.offset == sent.offset
        )
        alike = found.pixels.dtype == sent.pixels.dtype and found.pixels.dtype.isnative
        placed = sent.size is None or (
            found.size == sent.size and found.coordinates == sent.coordinates
        )

        return fields and alike and placed and np.array_equal(found.pixels, sent.pixels)

    return found == sent


NEXT = igtl.encode(igtl.Text("next"), "Scanner")


def raw(name: str, body: bytes, version: int = 1) -> bytes:
    """A message of a body with its right checksum."""
    header = struct.pack(
        ">H12s20sQQQ",
        version,
        name.encode(),
        b"peer",
        1 << 32,
        len(body),
        ecma_182(body),
    )
    return header + body


@pytest.mark.parametrize("version", [1, 2, 3])
@pytest.mark.parametrize("message", MESSAGES)
def test_every_message_whole_byte_by_byte_and_with_trailing_data(message, version):
    more = {"message_id": 77, "metadata": {"eye": "left", "µ": ""}}
    more = {} if version == 1 else more
    time_s = 1.7e9 + 0.25
    data = igtl.encode(message, "Scanner", version=version, time_s=time_s, **more)
    bytewise = Decoder()
    trailing = Decoder()
    split = [event for byte in data for event in bytewise.feed(bytes([byte]))]
    two = trailing.feed(data + NEXT[:60])
    assert trailing.feed(NEXT[60:])[0].message == igtl.Text("next")

    for events in (Decoder().feed(data), split, two):
        (event,) = events
        assert isinstance(event, igtl.Received)
        assert same(event.message, message)
        header = event.header
        assert (header.version, header.device) == (version, "Scanner")
        assert header.time_s == time_s
        if not isinstance(message, igtl.Query):
            assert event.message_id == more.get("message_id", 0)
            assert event.metadata == more.get("metadata", {})


def read_through_spaces(
    data: bytes, cuts: list[int], decoder: Decoder
) -> list[igtl.PeerEvent]:
    """As a socket fills what is lent: pieces of the sizes of `cuts` in turn, as far as
    there is room.
    """
    events = []
    place = 0
    turn = 0

    while place < len(data) and not decoder.broken:
        room = decoder.space()
        assert room
        piece = data[place : place + min(len(room), cuts[turn % len(cuts)])]
        room[: len(piece)] = piece
        events += decoder.received(len(piece))
        place = place + len(piece)
        turn = turn + 1

    return events


def comparable(events: Iterable[igtl.PeerEvent]) -> list[object]:
    """Return events for comparison: an image as its bytes and its place."""
    return [
        (
            (
                type(e),
                {
                    **vars(e),
                    "message": (
                        m.pixels.tobytes(),
                        m.pixels.dtype,
                        *list(vars(m).values())[1:],
                    ),
                },
            )
            if isinstance(e, igtl.Received) and isinstance(m := e.message, igtl.Image)
            else (type(e), vars(e))
        )
        for e in events
    ]


def test_unknown_types_are_passed_over_without_being_kept():
    data = raw("POLYDATA", bytes(8_000_000))
    decoder = Decoder()
    with less_than(100_000):
        events = [
            event
            for n in range(0, len(data), 65536)
            for event in decoder.feed(memoryview(data)[n : n + 65536])
        ]

    sent = raw("POLYDATA", bytes(70_000)) + NEXT
    lent = read_through_spaces(sent, [65536], decoder)
    kinds = [type(event).__name__ for event in (*events, *lent)]
    assert kinds == ["Unknown", "Unknown", "Received"]


IMAGE_BODY = igtl.encode(igtl.Image(PIXELS[np.uint16]), "peer")[HEADER_BYTES:]


def patched(place: int, value: bytes) -> bytes:
    return IMAGE_BODY[:place] + value + IMAGE_BODY[place + len(value) :]


def extended(*fields: int, more: bytes = b"") -> bytes:
    return struct.pack(">HHII", *fields) + more


@pytest.mark.parametrize(
    ("name", "body", "version"),
    [
        ("STATUS", b"\0" * 29, 1),
        ("STATUS", b"\0" * 30 + b"x" * 65_537, 1),
        ("STRING", b"\0", 1),
        ("STRING", struct.pack(">HH", 3, 9) + b"12345678", 1),
        ("SENSOR", b"\2\0" + b"\0" * 16, 1),
        ("SENSOR", b"", 1),
        ("TRANSFORM", b"\0" * 47, 1),
        ("TRANSFORM", struct.pack(">12f", *[float("nan")] * 12), 1),
        ("IMAGE", b"\0" * 71, 1),
        ("IMAGE", IMAGE_BODY[:-1], 1),
        ("IMAGE", IMAGE_BODY + b"\0", 1),
        ("IMAGE", patched(0, b"\0\7"), 1),
        ("IMAGE", patched(2, b"\0"), 1),
        ("IMAGE", patched(3, b"\x0a"), 1),  # float32
        ("IMAGE", patched(4, b"\3"), 1),
        ("IMAGE", patched(12, struct.pack(">f", float("inf"))), 1),
        ("IMAGE", patched(60, b"\0\1"), 1),  # a part that reaches out of the whole
        ("IMAGE", patched(66, b"\0\0"), 1),
        ("IMAGE", patched(66, b"\xff\xff" * 3), 1),
        # an extended header that contradicts itself
        ("STRING", b"\0" * 11, 2),
        ("STRING", extended(12, 0, 99, 0), 2),
        ("STRING", extended(11, 0, 0, 0), 2),
        ("STRING", extended(99, 0, 0, 0), 2),
        ("STRING", extended(12, 2, 0, 0, more=b"\0\1"), 2),
        ("STRING", extended(12, 1, 0, 0, more=b"\0"), 2),
        ("STRING", extended(12, 0, 2, 0, more=b"\0\0"), 2),
        (
            "STRING",
            extended(12, 10, 3, 0, more=struct.pack(">HHHI", 1, 2, 3, 4) + b"abc"),
            2,
        ),
        ("STRING", extended(12, 2, 16_383, 0, more=bytes(4 + 16_385)), 2),
    ],
)
def test_a_body_that_is_not_what_its_type_says_is_an_event(name, body, version):
    first, second = Decoder().feed(raw(name, body, version) + NEXT)
    assert isinstance(first, igtl.Malformed)
    assert isinstance(second, igtl.Received)


GOOD = igtl.encode(igtl.Text("force"), "peer")


@pytest.mark.parametrize(
    "data",
    [
        b"GET / HTTP/1.1\r\n" + b"x" * 60,
        b"\0\0" + GOOD[2:],
        b"\0\4" + GOOD[2:],
        GOOD[:2] + b"\0" * 12 + GOOD[14:],
        GOOD[:2] + b"\xff" * 12 + GOOD[14:],
        GOOD[:2] + b"STRI\xe4G\0\0\0\0\0\0" + GOOD[14:],
        GOOD[:2] + b"STRI G\0\0\0\0\0\0" + GOOD[14:],
        GOOD[:2] + b"STRI\nG\0\0\0\0\0\0" + GOOD[14:],
        GOOD[:42] + struct.pack(">Q", 1_000_001) + GOOD[50:],
        GOOD[:42] + b"\xff" * 8 + GOOD[50:],
    ],
)
def test_a_stream_that_cannot_be_followed_is_refused_from_then_on(data):
    decoder = Decoder(max_body_bytes=1_000_000)
    with less_than(100_000):
        received, broken = decoder.feed(GOOD + data + GOOD)

    assert isinstance(received, igtl.Received)
    assert isinstance(broken, igtl.Broken)
    with pytest.raises(ProtocolError, match="broken"):
        decoder.feed(GOOD)


def test_a_body_of_the_largest_size_is_received():
    (event,) = Decoder(max_body_bytes=len(GOOD) - HEADER_BYTES).feed(GOOD)
    assert isinstance(event, igtl.Received)


STREAM = b"".join(
    igtl.encode(message, "peer", version=1 + n % 3)
    for n, message in enumerate(MESSAGES)
)


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, len(STREAM) - 1), st.integers(0, 255)), max_size=6
    ),
    st.integers(0, len(STREAM)),
    st.lists(st.integers(1, 300), min_size=1, max_size=20),
)
def test_a_mutated_stream_gives_the_same_events_in_any_pieces_and_no_exception(
    changes, end, cuts
):
    changed = bytearray(STREAM)
    for place, value in changes:
        changed[place] = value

    data = bytes(changed[:end])
    at_once = Decoder(4096)
    lent = Decoder(4096)
    pieces = Decoder(4096)
    events = at_once.feed(data)
    assert comparable(read_through_spaces(data, cuts, lent)) == comparable(events)
    fed = []
    place = 0

    while place < end and not pieces.broken:
        step = cuts[len(fed) % len(cuts)]
        fed.append(pieces.feed(data[place : place + step]))
        place += step

    assert comparable(event for some in fed for event in some) == comparable(events)
    assert lent.broken is pieces.broken is at_once.broken


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(["IMAGE", "STATUS", "STRING", "SENSOR", "TRANSFORM"]),
    st.sampled_from([1, 2, 3]),
    st.binary(),
)
def test_any_body_with_a_right_checksum_is_a_message_or_malformed(name, version, body):
    (event,) = Decoder().feed(raw(name, body, version))
    assert isinstance(event, igtl.Received | igtl.Malformed)


SMALL = igtl.Image(np.zeros((1, 2, 2), dtype=np.uint8))


@pytest.mark.parametrize(
    "wrong",
    [
        igtl.Text("x" * 65_536),
        igtl.Sensor((0.0,) * 256),
        igtl.Status(70_000),
        igtl.Status(1, message="x" * 65_536),
        igtl.Status(1, name="x" * 21),
        igtl.Transform((1.0,)),
        igtl.Query("A_VERY_LONG_TYPE"),
        igtl.Text("\ud800"),
        igtl.Image(np.zeros((1, 2, 2), dtype=np.float32)),
        igtl.Image(np.zeros((2, 2), dtype=np.uint8)),
        igtl.Image(np.zeros((0, 2, 2), dtype=np.uint8)),
        replace(SMALL, offset=(1, 0, 0)),
        replace(SMALL, matrix=(1.0,)),
    ],
    ids=lambda wrong: type(wrong).__name__,
)
def test_what_a_message_cannot_carry_is_refused(wrong):
    with pytest.raises(ProtocolError):
        igtl.encode(wrong, "peer")


@pytest.mark.parametrize(
    "options",
    [
        {"device": "a device's name that is too long"},
        {"version": 4},
        {"version": 0},
        {"message_id": 1},
        {"metadata": {"a": "b"}},
        {"metadata": {"a": "b" * 16_375}, "version": 2},
        {"message_id": 2**32, "version": 2},
        {"time_s": -1.0},
        {"time_s": float("nan")},
    ],
    ids=str,
)
def test_what_a_header_cannot_carry_is_refused(options):
    with pytest.raises(ProtocolError):
        igtl.encode(igtl.Text("force"), **{"device": "peer", **options})


@pytest.mark.slow
def test_mutated_messages_of_the_benchmark_give_events_and_no_exception():
    outcome = run(20_000, seed=2)
    kinds = {"Image", "Query", "Sensor", "Status", "Text", "Transform"}
    others = {
        "Unknown",
        "BadChecksum",
        "Malformed",
        "Broken",
        "frame",
        "part kept",
        "image refused",
    }
    assert outcome.unexpected == []
    assert set(outcome.events) == {f"Received {kind}" for kind in kinds} | others
    assert min(outcome.events.values()) >= 100
