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
from bench_openigtlink import run
from scleraforce.base.errors import ProtocolError
from scleraforce.live.network.openigtlink import Header, pack_header, pack_image

DRAW = np.random.default_rng(5)
PIXELS = {
    dtype: DRAW.integers(0, 120, (2, 3, 5)).astype(dtype)
    for dtype in (np.int8, np.uint8, np.int16, np.uint16)
}
MESSAGES: list[igtl.Message] = [
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
VERSIONS = [1, 2, 3]


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


def raw(name: str, body: bytes, version: int = 1, crc: int | None = None) -> bytes:
    return (
        pack_header(
            Header(
                version,
                name,
                "peer",
                1.0,
                len(body),
                ecma_182(body) if crc is None else crc,
            )
        )
        + body
    )


def test_every_message_whole_byte_by_byte_and_with_trailing_data() -> None:
    for message in MESSAGES:
        for version in VERSIONS:
            more = (
                {}
                if version == 1
                else {"message_id": 77, "metadata": {"eye": "left", "µ": ""}}
            )
            time_s = 1.7e9 + 0.25
            data = igtl.encode(
                message, "Scanner", version=version, time_s=time_s, **more
            )
            next_one = igtl.encode(igtl.Text("next"), "Scanner")
            whole = igtl.Decoder().feed(data)
            bytewise = igtl.Decoder()
            split = [event for byte in data for event in bytewise.feed(bytes([byte]))]
            trailing = igtl.Decoder()
            two = trailing.feed(data + next_one[:60])
            assert trailing.feed(next_one[60:])[0].message == igtl.Text("next")

            for events in (whole, split, two):
                (event,) = events
                assert isinstance(event, igtl.Received)
                assert same(event.message, message)
                assert (
                    event.header.version,
                    event.header.device,
                    event.header.time_s,
                ) == (version, "Scanner", time_s)

                if not isinstance(message, igtl.Query):
                    assert event.message_id == more.get("message_id", 0)
                    assert event.metadata == more.get("metadata", {})


def test_an_image_of_known_bytes() -> None:
    head = bytes([0, 1, 1, 5, 1, 1]) + struct.pack(
        ">3H12f6H", 2, 1, 1, *[1.0] * 12, 0, 0, 0, 2, 1, 1
    )
    (event,) = igtl.Decoder().feed(raw("IMAGE", head + b"\x01\x02\xff\xfe"))
    assert isinstance(event, igtl.Received)
    assert isinstance(event.message, igtl.Image)
    assert event.message.pixels.tolist() == [[[0x0102, 0xFFFE]]]
    assert not event.message.pixels.flags.writeable


def read_through_spaces(
    data: bytes, cuts: list[int], decoder: igtl.Decoder
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


def test_a_wrong_checksum_is_an_event_and_the_stream_continues() -> None:
    data = bytearray(igtl.encode(igtl.Text("force"), "peer"))
    data[-1] ^= 4
    first, second = igtl.Decoder().feed(
        bytes(data) + igtl.encode(igtl.Text("next"), "peer")
    )
    assert isinstance(first, igtl.BadChecksum)
    assert first.reason.startswith("STRING: checksum ")
    assert isinstance(second, igtl.Received)


def test_unknown_types_are_passed_over_without_being_kept() -> None:
    body = bytes(8_000_000)
    data = raw("POLYDATA", body, crc=0)
    decoder = igtl.Decoder()

    with less_than(100_000):
        events = [
            e
            for n in range(0, len(data), 65536)
            for e in decoder.feed(memoryview(data)[n : n + 65536])
        ]

    assert [type(e) for e in events] == [igtl.Unknown]
    sent = raw("POLYDATA", body[:70_000], crc=0) + igtl.encode(
        igtl.Text("next"), "peer"
    )
    lent = read_through_spaces(sent, [65536], decoder)
    assert [type(e) for e in lent] == [igtl.Unknown, igtl.Received]


IMAGE_BODY = pack_image(igtl.Image(PIXELS[np.uint16]))


def patched(place: int, value: bytes) -> bytes:
    return IMAGE_BODY[:place] + value + IMAGE_BODY[place + len(value) :]


def test_a_body_that_is_not_what_its_type_says_is_an_event() -> None:
    for name, body in (
        ("STATUS", b"\0" * 29),
        ("STATUS", b"\0" * 30 + b"x" * 65_537),
        ("STRING", b"\0"),
        ("STRING", struct.pack(">HH", 3, 9) + b"12345678"),
        ("SENSOR", b"\2\0" + b"\0" * 16),
        ("SENSOR", b""),
        ("TRANSFORM", b"\0" * 47),
        ("TRANSFORM", struct.pack(">12f", *[float("nan")] * 12)),
        ("IMAGE", b"\0" * 71),
        ("IMAGE", IMAGE_BODY[:-1]),
        ("IMAGE", IMAGE_BODY + b"\0"),
        ("IMAGE", patched(0, b"\0\7")),
        ("IMAGE", patched(2, b"\0")),
        ("IMAGE", patched(3, b"\x0a")),  # float32
        ("IMAGE", patched(4, b"\3")),
        ("IMAGE", patched(12, struct.pack(">f", float("inf")))),
        ("IMAGE", patched(60, b"\0\1")),  # a part that reaches out of the whole
        ("IMAGE", patched(66, b"\0\0")),
        ("IMAGE", patched(66, b"\xff\xff" * 3)),
    ):
        first, second = igtl.Decoder().feed(
            raw(name, body) + igtl.encode(igtl.Text("next"), "peer")
        )
        assert isinstance(first, igtl.Malformed)
        assert isinstance(second, igtl.Received)


def test_an_extended_header_that_contradicts_itself_is_an_event() -> None:
    for body in (
        b"\0" * 11,
        struct.pack(">HHII", 12, 0, 99, 0),
        struct.pack(">HHII", 11, 0, 0, 0),
        struct.pack(">HHII", 99, 0, 0, 0),
        struct.pack(">HHII", 12, 2, 0, 0) + b"\0\1",
        struct.pack(">HHII", 12, 1, 0, 0) + b"\0",
        struct.pack(">HHII", 12, 0, 2, 0) + b"\0\0",
        struct.pack(">HHII", 12, 10, 3, 0) + struct.pack(">HHHI", 1, 2, 3, 4) + b"abc",
        struct.pack(">HHII", 12, 2, 16_383, 0) + bytes(4 + 16_385),
    ):
        (event,) = igtl.Decoder().feed(raw("STRING", body, version=2))
        assert isinstance(event, igtl.Malformed)


GOOD = igtl.encode(igtl.Text("force"), "peer")


def test_a_stream_that_cannot_be_followed_is_refused_from_then_on() -> None:
    for data in (
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
    ):
        decoder = igtl.Decoder(max_body_bytes=1_000_000)
        with less_than(100_000):
            received, broken = decoder.feed(GOOD + data + GOOD)

        assert isinstance(received, igtl.Received)
        assert isinstance(broken, igtl.Broken)
        assert decoder.state is igtl.DecoderState.ERROR
        with pytest.raises(ProtocolError, match="broken"):
            decoder.feed(GOOD)


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
    changes: list[tuple[int, int]], end: int, cuts: list[int]
) -> None:
    changed = bytearray(STREAM)
    for place, value in changes:
        changed[place] = value

    data = bytes(changed[:end])
    at_once = igtl.Decoder(4096)
    lent = igtl.Decoder(4096)
    pieces = igtl.Decoder(4096)
    events = at_once.feed(data)
    assert comparable(read_through_spaces(data, cuts, lent)) == comparable(events)
    fed = []
    place = 0

    while place < end and not pieces.broken:
        step = cuts[len(fed) % len(cuts)]
        fed.append(pieces.feed(data[place : place + step]))
        place += step

    assert comparable(event for some in fed for event in some) == comparable(events)
    assert lent.state is pieces.state is at_once.state


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(["IMAGE", "STATUS", "STRING", "SENSOR", "TRANSFORM"]),
    st.sampled_from(VERSIONS),
    st.binary(),
)
def test_any_body_with_a_right_checksum_is_a_message_or_malformed(
    name: str, version: int, body: bytes
) -> None:
    (event,) = igtl.Decoder().feed(raw(name, body, version))
    assert isinstance(event, igtl.Received | igtl.Malformed)


def test_what_a_message_or_its_header_cannot_carry_is_refused() -> None:
    for wrong in (
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
        replace(igtl.Image(np.zeros((1, 2, 2), dtype=np.uint8)), offset=(1, 0, 0)),
        replace(igtl.Image(np.zeros((1, 2, 2), dtype=np.uint8)), matrix=(1.0,)),
    ):
        with pytest.raises(ProtocolError):
            igtl.encode(wrong, "peer")

    for options in (
        {"device": "a device's name that is too long"},
        {"version": 4},
        {"version": 0},
        {"message_id": 1},
        {"metadata": {"a": "b"}},
        {"metadata": {"a": "b" * 16_375}, "version": 2},
        {"message_id": 2**32, "version": 2},
        {"time_s": -1.0},
        {"time_s": float("nan")},
    ):
        with pytest.raises(ProtocolError):
            igtl.encode(igtl.Text("force"), **{"device": "peer", **options})


@pytest.mark.slow
def test_mutated_messages_of_the_benchmark_give_events_and_no_exception() -> None:
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
