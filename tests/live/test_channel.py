"""Processes beside the monitor and their channels: what is sent arrives whole, or is
refused with one kind of error.
"""

import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any, get_args

import msgspec
import numpy as np
import pytest
from hypothesis import given, strategies as st
from small_monitor import INFO, READ_ENTRY, verdict
from waiting import FUSE_S, wait_until

from scleraforce.base.errors import MessageError
from scleraforce.live.companions import process_channel, process_messages
from scleraforce.live.companions.companion_processes import Guard
from scleraforce.live.companions.process_channel import (
    Channel,
    ChannelClosedError,
    Child,
    run_companion,
)
from scleraforce.live.companions.process_messages import CompanionMessage, Note
from scleraforce.live.companions.shared_frames import RingPlace
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import Globe
from scleraforce.records.remark import Remark
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import NOTHING_KNOWN, Setup

RING = RingPlace(descriptor=5, frames=1200, rows=24, columns=32)
SCALE = PixelScale(lateral_m=29e-6, depth_m=8e-6)
MESSAGES = [
    process_messages.Decided(entry=READ_ENTRY),
    process_messages.ForceHeard(
        at_s=1.0, time_s=1.8e9, values=(0.01, -inf), device="Robot"
    ),
    Note(time_s=1.5, text='é "\\ \n\t\0'),
    process_messages.MonitorEnds(),
    process_messages.Outline(frame=4, step=4, outer=(None, 3.5), inner=()),
    process_messages.Rates(
        frames_per_second=99.5,
        lost=0,
        clients=({"address": "[::1]:1", "role": "scanner"},),
    ),
    process_messages.ResetAsked(request=1, token="t"),
    process_messages.ResetAnswered(request=1, granted=False, message="no"),
    process_messages.ListensAt(url="http://127.0.0.1:1/"),
    process_messages.WrongTokens(count=7),
    process_messages.OpinionAsked(
        number=3, order=2**62, at_s=1e5, teaches=True, pierced=False
    ),
    process_messages.EyeLearned(setup=NOTHING_KNOWN, frames=3, fault=""),
    process_messages.OpinionGiven(
        order=3,
        verdict=verdict(10.0, (0.0, 20.0), reason="dark", probabilities=None),
    ),
    process_messages.Alive(faults=("log: full", "disk: full")),
    process_messages.SelfReport(detail="it broke"),
    process_messages.WithdrawalKept(folder="/tmp/x"),
    process_messages.BlackBoxSettings(
        folder=Path("/tmp/box"),
        ring=RING,
        info=INFO,
        record=Path("/tmp/é"),
        keep_s=10.0,
    ),
    process_messages.OpinionSettings(
        model=Path("m"),
        scale=SCALE,
        ring=RING,
        setup=Setup(
            eye=Eye(
                modulus=Modulus(mean_pa=250e3, sd_pa=10e3, source="own"),
                iop_pa=2000.0,
                thickness_m=6e-4,
                globe=Globe.declared("sealed", 1.5e8, "logarithmic"),
            )
        ),
        learns="eye-a",
        record=Path("/tmp/session"),
    ),
    process_messages.ConsoleSettings(
        host="::1",
        listener=7,
        token_digest="d",
        ring=RING,
        scale=SCALE,
        limits=MonitorLimits(size=(32, 24)),
        class_bounds_n=(5e-3, 30e-3),
        model="reader",
        eye="",
        remarks=(Remark("outside-training", "IOP 40 mmHg", ("iop_pa",)),),
    ),
]


@pytest.fixture
def ends() -> Iterator[tuple[Channel, Channel]]:
    ours, theirs = Channel.pair()
    yield ours, theirs
    ours.close()
    theirs.close()


def arrived(ends: tuple[Channel, Channel], message: CompanionMessage) -> Any:
    """Return what a message is at the other end."""
    ours, theirs = ends
    assert ours.send(message)
    (came,) = theirs.receive()
    return came


def bytes_of(ends: tuple[Channel, Channel], message: CompanionMessage) -> bytes:
    """Return a message as it goes over the channel."""
    ours, theirs = ends
    assert ours.send(message)
    return os.read(theirs.fileno(), 1 << 20)


def refusal_of(ends: tuple[Channel, Channel], data: bytes) -> str:
    ours, theirs = ends
    assert ours.send_encoded(data)
    with pytest.raises(MessageError) as refused:
        theirs.receive()
    return str(refused.value)


def note(number: float, text: str = "") -> Note:
    return Note(time_s=float(number), text=text)


def test_each_message_arrives_as_it_was_sent(ends):
    assert {type(message) for message in MESSAGES} == set(get_args(CompanionMessage))
    for message in MESSAGES:
        assert arrived(ends, message) == message


@pytest.mark.parametrize(
    ("field", "ring", "info"),
    [
        ("info.scan", replace(RING, rows=32, columns=24), INFO),
        ("info.force", RING, replace(INFO, force=None)),
    ],
)
def test_settings_of_the_black_box_that_contradict_each_other_are_refused(
    field, ring, info
):
    with pytest.raises(ValueError, match=field):
        process_messages.BlackBoxSettings(
            folder=Path("box"), ring=ring, info=info, record=None, keep_s=10.0
        )


def test_nan_infinity_and_numpys_floats_arrive_as_such(ends):
    given = verdict(nan, (-inf, nan), probabilities=(nan, np.float64(1.0)))
    opinion = arrived(ends, process_messages.OpinionGiven(order=3, verdict=given))
    expected = verdict(nan, (-inf, nan), probabilities=(nan, 1.0))
    assert repr(opinion.verdict) == repr(expected)


def test_half_a_character_of_a_file_name_is_escaped_in_a_text_and_kept_in_a_path(ends):
    alive = arrived(ends, process_messages.Alive(faults=("log: \udce9",)))
    assert alive.faults == ("log: \\udce9",)
    settings = msgspec.structs.replace(ending_with(0), model=Path("\udce9"))
    assert arrived(ends, settings) == settings


@pytest.mark.parametrize(
    "message", MESSAGES, ids=lambda message: type(message).__name__
)
def test_a_missing_or_an_unknown_field_is_refused_by_its_name(ends, message):
    record = msgspec.msgpack.decode(bytes_of(ends, message))
    for name in set(record) - {"type"}:
        others = {key: value for key, value in record.items() if key != name}
        assert name in refusal_of(ends, msgspec.msgpack.encode(others))

    assert "more" in refusal_of(ends, msgspec.msgpack.encode(record | {"more": 1}))


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("at_s", "1"),
        ("number", 1.5),
        ("state", "OK"),
        ("frame", True),
        ("verdict", []),
    ],
)
def test_a_value_of_another_type_is_refused_by_its_field(ends, name, wrong):
    record = msgspec.msgpack.decode(bytes_of(ends, MESSAGES[0]))
    record["entry"] |= {name: wrong}
    assert name in refusal_of(ends, msgspec.msgpack.encode(record))


@pytest.mark.parametrize(
    "data", [b"\xc0", b"\x90", b"\x80", b"\xff\xfe", b"\x91" * 60_000, b"{}"]
)
def test_bytes_that_are_not_a_message_are_refused_in_one_short_line(ends, data):
    """The next message can be read."""
    words = refusal_of(ends, data)
    assert "\n" not in words
    assert len(words) < 500
    assert arrived(ends, note(1)) == note(1)


@given(st.sampled_from(MESSAGES), st.data())
def test_a_message_with_changed_bytes_is_a_message_or_that_error(message, drawn):
    ours, theirs = ends = Channel.pair()
    with closing(ours), closing(theirs):
        data = bytearray(bytes_of(ends, message))
        for _ in range(drawn.draw(st.integers(1, 3))):
            place = drawn.draw(st.integers(0, len(data) - 1))
            data[place] = drawn.draw(st.integers(0, 255))

        ours.send_encoded(bytes(data))
        with suppress(MessageError):
            assert isinstance(theirs.receive()[0], CompanionMessage)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (object(), None),
        (Note(time_s=1.0, text=object()), None),
        (process_messages.WrongTokens(count=10**30), None),
        (note(1, "x" * 131_072), "131072"),
    ],
    ids=["object", "field", "number", "large"],
)
def test_other_values_and_large_messages_are_not_sent(ends, wrong, words):
    with pytest.raises(MessageError, match=words):
        ends[0].send(wrong)


def test_messages_arrive_whole_and_in_order_at_either_end_and_no_end_waits(ends):
    for sender, receiver in (ends, ends[::-1]):
        sent = [note(number, "é\n" * number) for number in range(50)]
        assert all(sender.send(message) for message in sent)
        assert receiver.receive(3) + receiver.receive() == sent
        assert receiver.receive() == []


def test_an_end_that_does_not_read_loses_messages_but_never_makes_the_other_wait(ends):
    ours, theirs = ends
    sent = 0
    while ours.send(note(sent, "x" * 4000)):
        sent += 1

    assert not ours.send(note(-1, "x" * 4000))
    numbers = []
    while messages := theirs.receive():
        numbers += [message.time_s for message in messages]

    assert numbers == list(range(sent))
    assert ours.send(note(sent))


def test_an_end_that_left_without_reading_has_its_last_messages_read_all_the_same(ends):
    ours, theirs = ends
    theirs.send(note(0))  # the kernel answers such a leaving with an error, once
    for number in range(3):
        ours.send(note(number))

    ours.close()
    assert theirs.receive() == [note(0), note(1), note(2)]
    for _ in range(2):
        with pytest.raises(ChannelClosedError):
            theirs.receive()

    with pytest.raises(ChannelClosedError):
        theirs.send(note(0))


def test_the_largest_message_arrives_and_a_larger_one_is_refused_before_and_after_it_is_cut(
    ends,
):
    header = len(bytes_of(ends, note(1, "x" * 70_000))) - 70_000
    largest = note(1, "x" * (131_072 - header))
    assert arrived(ends, largest) == largest
    with pytest.raises(MessageError, match="131073 bytes"):
        ends[0].send(note(1, largest.text + "x"))

    # a whole message, if it were cut
    data = bytes_of(ends, largest) + b" " * 1000
    assert "131073 bytes" in refusal_of(ends, data)


MODULE = """
import json, os, select, signal, sys
from scleraforce.live.companions.process_channel import ChannelClosedError, run_companion
from scleraforce.live.companions.process_messages import Note, OpinionSettings
def serve(channel, settings):
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    said = os.pread(settings.ring.descriptor, 100, 0).decode() if settings.ring.descriptor else None
    channel.send(Note(time_s=0.0, text=json.dumps({
        "settings": repr(settings), "interrupts": signal.SIGINT not in blocked, "read": said,
        "threads": os.environ["OMP_NUM_THREADS"],
    })))
    while settings.ring.frames:
        select.select([channel], [], [])
        try:
            for message in channel.receive():
                channel.send(message)
        except ChannelClosedError:
            sys.exit(settings.ring.frames)
    select.select([], [], [])
run_companion(OpinionSettings, serve)
"""


def ending_with(code, descriptor=0):
    """Settings of some child, which echoes: its exit code in place of a number of
    frames; for 0 it waits for ever.
    """
    ring = RingPlace(descriptor=descriptor, frames=code, rows=1, columns=1)
    return process_messages.OpinionSettings(
        model=Path("é"),
        setup=NOTHING_KNOWN,
        scale=SCALE,
        ring=ring,
        learns=None,
        record=None,
    )


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "some_child.py").write_text(MODULE)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)


def heard(child):
    messages = []
    wait_until(lambda: messages.extend(child.channel.receive()) or messages)
    return messages


def answer(child):
    return json.loads(heard(child)[0].text)


@pytest.mark.usefixtures("module")
def test_a_child_gets_its_settings_and_the_files_and_ends_or_is_killed_when_the_channel_closes():
    file = os.memfd_create("test")
    os.write(file, b"shared")
    settings = ending_with(7, file)
    child = Child("some_child", settings, [file])
    said = answer(child)
    assert said == {
        "settings": repr(settings),
        "interrupts": False,
        "read": "shared",
        "threads": "1",
    }
    assert child.process.poll() is None
    assert os.getsid(child.process.pid) == child.process.pid

    for number in (
        signal.SIGHUP,
        signal.SIGQUIT,
        signal.SIGINT,
        signal.SIGTERM,
    ):
        # as a terminal that is closed
        os.kill(child.process.pid, number)

    child.channel.send(note(1))  # it is there after the signals
    assert heard(child) == [note(1)]
    assert child.end(FUSE_S) == 7
    os.close(file)
    waits = Child("some_child", ending_with(0))
    answer(waits)
    assert waits.end(within_s=0.05) == -signal.SIGKILL


def test_a_child_whose_monitor_has_gone_or_says_nothing_does_not_start(monkeypatch):
    ours, theirs = Channel.pair()

    def run():
        monkeypatch.setattr(sys, "argv", ["x", str(os.dup(theirs.fileno()))])
        run_companion(process_messages.OpinionSettings, pytest.fail)

    monkeypatch.setattr(process_channel, "SETTINGS_S", 0.01)
    with pytest.raises(RuntimeError, match="started by `scleraforce monitor`"):
        run()

    ours.send(process_messages.MonitorEnds())
    with pytest.raises(
        MessageError,
        match="a MonitorEnds came; the first message must be a OpinionSettings",
    ):
        run()

    ours.close()
    with pytest.raises(ChannelClosedError):
        run()

    theirs.close()


@pytest.mark.usefixtures("module")
def test_no_module_of_the_current_folder_runs_in_a_child(tmp_path, monkeypatch):
    """Modules of PYTHONPATH do, as in the process that starts it."""
    here = tmp_path / "here"
    here.mkdir()

    for name in ("numpy", "signal", "json", "socket", "sitecustomize", "some_child"):
        (here / f"{name}.py").write_text(
            f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\nraise SystemExit\n"
        )

    monkeypatch.chdir(here)
    child = Child("some_child", ending_with(3))
    assert answer(child)["threads"] == "1"
    assert child.end(FUSE_S) == 3
    guard = Guard(FUSE_S)  # a less patient one may kill this process
    guard.end()
    assert not (tmp_path / "ran").exists()
