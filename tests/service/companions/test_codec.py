"""The codec of the companions' messages: what goes in comes out, and what is no message is one kind of error."""

import json
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest
from decisions import READ_ENTRY, TICK_ENTRY
from hypothesis import given, strategies as st

from scleraforce.errors import MessageError
from scleraforce.known.eye import Known, Modulus, known_globe
from scleraforce.recording.folder import EyeInfo, ForceInfo, NeedleInfo, OctInfo, RecordingInfo
from scleraforce.recording.pixels import PixelScale
from scleraforce.service.black_box.decision_log import format_line
from scleraforce.service.black_box.settings import BlackBoxSettings
from scleraforce.service.companions.codec import MESSAGE_BYTES, decode_message, encode_message, message_as_json
from scleraforce.service.companions.frame_ring import RingPlace
from scleraforce.service.companions.messages import (
    MESSAGE_KINDS,
    Alive,
    ClientRole,
    CompanionMessage,
    Decided,
    ForceHeard,
    ListensAt,
    MonitorEnds,
    Note,
    OpinionAsked,
    OpinionGiven,
    Outline,
    Rates,
    ResetAnswered,
    ResetAsked,
    SelfReport,
    WithdrawalKept,
    WrongTokens,
)
from scleraforce.service.companions.opinion_settings import OpinionSettings
from scleraforce.service.console.settings import ConsoleSettings

RING = RingPlace(descriptor=5, frames=1200, rows=512, columns=1024)
INFO = RecordingInfo(
    EyeInfo("eye", thickness_m=600e-6, iop_pa=None),
    OctInfo(columns=32, rows=24, bits=16, width_m=15e-3, depth_m=4e-3),
    NeedleInfo(gauge=22, slice_gap_m=0.5e-3),
    ForceInfo("fz", -1, 0.2),
)
MESSAGES: list[CompanionMessage] = [
    Decided(entry=READ_ENTRY),
    Decided(entry=TICK_ENTRY),
    ForceHeard(at_s=1.0, time_s=1.8e9, values=(0.01, -inf), device="Robot"),
    ForceHeard(at_s=1.0, time_s=1.8e9, values=(), device=""),
    Note(time_s=1.5, text='é "\\ \n\t\0'),
    MonitorEnds(),
    Outline(frame=4, step=4, outer=(None, 3.5), inner=()),
    Rates(frames_per_second=99.5, lost=0, clients=(ClientRole(address="[::1]:1", role="scanner"),)),
    Rates(frames_per_second=0.0, lost=0, clients=()),
    ResetAsked(request=1, token="t"),
    ResetAnswered(request=1, granted=False, message="no"),
    ListensAt(url="http://127.0.0.1:1/"),
    WrongTokens(count=7),
    OpinionAsked(number=3, order=2**62),
    OpinionGiven(
        order=3, usable=True, reason=None, predicted=1, probabilities=(0.1, 0.9), force_n=0.01, interval_n=(0.0, 0.02)
    ),
    OpinionGiven(
        order=3, usable=False, reason="dark", predicted=2, probabilities=None, force_n=None, interval_n=None
    ),
    Alive(faults=()),
    Alive(faults=("log: full", "disk: full")),
    SelfReport(detail="it broke"),
    WithdrawalKept(folder="/tmp/x"),
    BlackBoxSettings(folder=Path("/tmp/box"), ring=RING, info=INFO, record=None, keep_s=10.0),
    BlackBoxSettings(
        folder=Path("/tmp/box"), ring=RING, info=replace(INFO, force=None), record=Path("/tmp/é"), keep_s=10.0
    ),
    OpinionSettings(model=Path("m"), known=Known(), scale=PixelScale(lateral_m=29e-6, depth_m=8e-6), ring=RING),
    OpinionSettings(
        model=Path("m"), scale=PixelScale(lateral_m=1e-5, depth_m=1e-5), ring=RING,
        known=Known(modulus=Modulus(mean_pa=250e3, sd_pa=10e3, source="own"), iop_pa=2000.0, thickness_m=6e-4),
    ),
    OpinionSettings(
        model=Path("m"), scale=PixelScale(lateral_m=1e-5, depth_m=1e-5), ring=RING,
        known=Known(globe=known_globe("sealed", 1.5e8, "logarithmic")),
    ),
    ConsoleSettings(
        host="::1", listener=7, token_digest="d", ring=RING, pixel_mm=(0.03, 0.01), class_bounds_mn=(5.0, 30.0),
        bound_mn=30.0, withdraw_class=2, silence_s=0.1, reads_force=True, model="reader", eye="", version="1",
    ),
]  # fmt: skip
# A wrong value for each type of field, as it stands in JSON.
WRONG: list[Any] = [None, True, 1, 1.5, "1", [], [1], [[]], {}, {"a": 1}, 10**400]


def test_each_kind_has_an_example_here() -> None:
    assert {type(message) for message in MESSAGES} == set(MESSAGE_KINDS.values())
    assert len(set(MESSAGE_KINDS.values())) == len(MESSAGE_KINDS)


@pytest.mark.parametrize("message", MESSAGES, ids=repr)
def test_what_is_sent_is_what_arrives(message: CompanionMessage) -> None:
    assert decode_message(encode_message(message)) == message


def test_what_is_no_number_arrives_as_such() -> None:
    opinion = OpinionGiven(
        order=3, usable=True, reason=None, predicted=1, probabilities=(nan, 1.0), force_n=nan, interval_n=(-inf, nan)
    )
    assert repr(decode_message(encode_message(opinion))) == repr(opinion)
    entry = replace(READ_ENTRY, force_mn=nan, probabilities=(nan, 0.5, inf), interval_mn=(nan, 1.0))
    arrived = decode_message(encode_message(Decided(entry=entry)))
    assert isinstance(arrived, Decided)
    assert arrived.entry.as_json() == entry.as_json()
    assert json.loads(encode_message(arrived), parse_constant=pytest.fail)["entry"]["force_mn"] is None


@pytest.mark.parametrize("message", MESSAGES, ids=repr)
def test_a_message_that_is_cut_anywhere_is_refused(message: CompanionMessage) -> None:
    data = encode_message(message)
    for length in range(len(data)):
        with pytest.raises(MessageError):
            decode_message(data[:length])


@pytest.mark.parametrize("message", MESSAGES, ids=repr)
def test_a_missing_an_unknown_or_another_field_is_refused_by_its_name(message: CompanionMessage) -> None:
    record = json.loads(encode_message(message))
    for name in set(record) - {"kind"}:
        with pytest.raises(MessageError, match=f"{record['kind']}: without {name}"):
            decode_message(json.dumps({key: value for key, value in record.items() if key != name}).encode())
    with pytest.raises(MessageError, match=f"{record['kind']}: unknown: 'more'"):
        decode_message(json.dumps(record | {"more": 1}).encode())


@pytest.mark.parametrize("message", MESSAGES, ids=repr)
def test_whatever_stands_in_a_field_is_read_or_refused_by_its_name(message: CompanionMessage) -> None:
    """A value that is read comes out again; one of another type is refused."""
    record = json.loads(encode_message(message))
    for path in places(record):
        for wrong in WRONG:
            read = read_or_refused(json.dumps(changed(record, path, wrong)).encode())
            if isinstance(read, str):
                assert path[0] == "kind" or f"{path[0]}: " in read
            else:
                assert repr(decode_message(encode_message(read))) == repr(read)


def read_or_refused(data: bytes) -> CompanionMessage | str:
    """The message in some bytes, or why it is none."""
    try:
        return decode_message(data)
    except MessageError as fault:
        return str(fault)


def places(record: Any) -> list[list[Any]]:
    """The path to each value in a JSON object, but to the object."""
    if not isinstance(record, (dict, list)):
        return []
    entries = list(record.items()) if isinstance(record, dict) else list(enumerate(record))
    return [[key, *rest] for key, value in entries for rest in ([], *places(value))]


def changed(record: Any, path: list[Any], value: Any) -> Any:
    """The object with another value in one place."""
    if not path:
        return value
    copied = record.copy()
    copied[path[0]] = changed(record[path[0]], path[1:], value)
    return copied


@pytest.mark.parametrize(
    "data",
    [
        b"", b"null", b"1", b"[]", b"{}", b'"note"', b"\xff\xfe", b"[" * 60_000, b"1" * 5000,
        b'{"kind": null}', b'{"kind": ["note"]}', b'{"kind": {}}', b'{"kind": "Note", "time_s": 1.5, "text": ""}',
        b'{"kind": "note", "time_s": true, "text": ""}', b'{"kind": "note", "time_s": 1.5, "text": null}',
        b'{"kind": "note", "time_s": 1.5, "text": ""} {}', b'{"kind": "end"}' + b" " * MESSAGE_BYTES,
        b'{"kind": "entry", "entry": null}', b'{"kind": "entry", "entry": {"class": 1}}',
    ],
    ids=lambda data: repr(data[:40]),
)  # fmt: skip
def test_what_is_no_message_is_one_kind_of_error_in_one_short_line(data: bytes) -> None:
    with pytest.raises(MessageError) as refused:
        decode_message(data)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) < 500


@given(st.binary(max_size=300))
def test_any_bytes_are_a_message_or_that_error(data: bytes) -> None:
    with suppress(MessageError):
        decode_message(data)


@given(st.sampled_from(MESSAGES), st.data())
def test_a_message_with_changed_bytes_is_a_message_or_that_error(
    message: CompanionMessage, drawn: st.DataObject
) -> None:
    data = bytearray(encode_message(message))
    for _ in range(drawn.draw(st.integers(1, 3))):
        data[drawn.draw(st.integers(0, len(data) - 1))] = drawn.draw(st.integers(0, 255))
    try:
        read = decode_message(bytes(data))
    except MessageError:
        return
    assert type(read) in MESSAGE_KINDS.values()


@pytest.mark.parametrize("message", MESSAGES, ids=repr)
def test_a_field_of_another_type_is_not_sent(message: CompanionMessage) -> None:
    for field in fields(message):
        with pytest.raises(MessageError, match=f": {field.name}: "):
            encode_message(replace(message, **{field.name: object()}))


def test_what_is_no_message_or_too_large_is_not_sent() -> None:
    @dataclass(frozen=True)
    class Stranger:
        pass

    for wrong in (Stranger(), {"kind": "end"}, None):
        with pytest.raises(MessageError, match="is no message"):
            encode_message(wrong)  # type: ignore[arg-type]
    with pytest.raises(MessageError, match="at most 131072"):
        encode_message(Note(time_s=1.0, text="x" * MESSAGE_BYTES))


def test_the_log_keeps_the_lines_that_it_had_before_messages_were_records() -> None:
    """The keys, their order and the values of the log are a contract (docs/black_box.md)."""
    assert format_line(message_as_json(Decided(entry=READ_ENTRY))) == (
        b'{"kind": "entry", "entry": {"number": 3, "time_s": 1800000000.0, "at_s": 12.5, "event": "frame", "state": '
        b'"WATCHING", "code": 1, "sub_code": 0, "cause": null, "message": "OK:\\n\\u201c12 mN\\u201d", "frame": 3, '
        b'"frame_id": 77, "probabilities": [0.0, 0.75, 0.25], "force_mn": 12.5, "interval_mn": [11.0, 13.5], "usable": '
        b'true, "reason": null, "latency_ms": 0.75, "lost": 2, "overtaken": 0, "withdrawn_s": null, '
        b'"present_cause": null, "present": "", "class": 1}, "crc32": "6ef838f1"}\n'
    )
    assert format_line(message_as_json(Note(time_s=1.5, text="robot came"))) == (
        b'{"kind": "note", "time_s": 1.5, "text": "robot came", "crc32": "1130c359"}\n'
    )
