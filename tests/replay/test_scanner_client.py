"""A scanner's connection: it hears while it sends, never hangs, and says clearly what went wrong."""

import json
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager

import numpy as np
import pytest
import waiting
from fake_monitor import FakeMonitor, fake_monitor

from scleraforce.errors import LinkError
from scleraforce.openigtlink import Decoder, Image, Received, Sensor, Status, Text, encode
from scleraforce.recording.folder import OctInfo
from scleraforce.replay.scanner_client import AnswerLog, ScannerClient, frame_message

OCT = OctInfo(columns=32, rows=24, bits=12, width_m=8e-3, depth_m=3e-3)
PIXELS = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32)


def test_a_frame_has_its_time_and_the_id_that_the_monitor_reads_from_it() -> None:
    for version in (1, 2, 3):
        message = frame_message(PIXELS, OCT, 7, version)
        for time_s in (1234.5, 1_763_722_841.123457, 5.000001):
            (event,) = Decoder().feed(bytes(message.stamped(time_s)))
            assert isinstance(event, Received)
            assert event.header.time_s == pytest.approx(time_s, abs=3e-7)
            assert event.message_id == (0 if version == 1 else 7)
            assert message.frame_id == (event.message_id or int(event.header.time_s * 1e6))


@contextmanager
def connected(hear, **settings) -> Iterator[tuple[FakeMonitor, ScannerClient]]:
    with fake_monitor() as monitor, closing(ScannerClient("127.0.0.1", monitor.port, hear, **settings)) as client:
        yield monitor, client


def wait_until(client: ScannerClient, done) -> None:
    client.listen(time.monotonic() + waiting.FUSE_S, done)
    assert done()


@pytest.mark.parametrize("observed", [False, True])
def test_what_the_monitor_says_is_heard_with_its_time(observed: bool) -> None:
    log = AnswerLog()
    with connected(log.hear, observed=observed) as (_, client):
        wait_until(client, lambda: log.status is not None)
        message = frame_message(PIXELS, OCT, 7, 2)
        before_s = time.monotonic()
        sent_s = client.send(message.stamped(5.0))
        log.sent(7, message.frame_id, sent_s)
        wait_until(client, lambda: log.answered == 7)
        assert before_s <= sent_s <= time.monotonic()
        assert log.ok
        assert 0.0 <= log.answers[0].took_s <= time.monotonic() - sent_s


def test_the_robots_connection_hears_on_when_the_scanners_is_closed() -> None:
    log = AnswerLog()
    with connected(log.hear, observed=True) as (monitor, client):
        wait_until(client, lambda: log.status is not None)
        client.disconnect()
        wait_until(client, lambda: None in monitor.received)
        monitor.say(Status(3, 7, "SILENCE", "no frame"))
        wait_until(client, lambda: log.first_doubt(0.0, (3,)) is not None)
        with pytest.raises(LinkError, match="closed the connection"):
            client.send(b"x")


def test_a_message_that_comes_through_both_connections_is_heard_once() -> None:
    heard = []
    with connected(lambda *said: heard.append(said), observed=True) as (monitor, client):
        monitor.answers = False
        waiting.wait_until(lambda: len(monitor._peers) == 2)
        for _ in range(3):
            monitor.say_bytes(encode(Text("once"), "ForceReading"))
            client.listen(time.monotonic() + 0.05)
        wait_until(client, lambda: sum(isinstance(message, Text) for _, _, message in heard) >= 3)
        assert sum(isinstance(message, Text) for _, _, message in heard) == 3


def test_a_monitor_that_stops_reading_is_an_error_and_no_hang_and_is_heard_meanwhile() -> None:
    heard = []
    with fake_monitor() as monitor:
        client = ScannerClient(
            "127.0.0.1", monitor.port, lambda *said: heard.append(said), clock=lambda: 2.0 * len(heard)
        )
        monitor.reads = False
        with pytest.raises(LinkError, match="has read nothing for 5 s"):
            client.send(encode(Image(np.zeros((1, 2048, 2048), np.uint16)), "Scanner") * 8)
        assert len(heard) >= 3  # heartbeats, of which each is two seconds of the client's clock
        client.close()


def test_a_peer_that_leaves_or_does_not_speak_openigtlink_is_an_error() -> None:
    http = b"HTTP/1.1 400 Bad Request\r\n" + b"\r\n" * 30
    for act, words in (
        (FakeMonitor.drop, "the connection is lost"),
        (lambda monitor: monitor.say_bytes(http), "does not send OpenIGTLink: header version"),
    ):
        with connected(lambda *_: None) as (monitor, client):
            monitor.answers = False
            waiting.wait_until(lambda: bool(monitor._peers))
            act(monitor)
            with pytest.raises(LinkError, match=words):
                client.listen(time.monotonic() + waiting.FUSE_S)


def reading(frame_id: int) -> Text:
    return Text(json.dumps({"event": "frame", "frame_id": frame_id, "class": 1}))


def test_the_status_before_a_reading_is_that_frames_answer() -> None:
    log = AnswerLog()
    log.sent(1, 101, 10.000)
    log.sent(2, 102, 10.010)
    log.hear(10.002, "ForceMonitor", Status(1))
    log.hear(10.003, "ForceReading", reading(101))
    log.hear(10.011, "ForceMonitor", Status(1))  # a heartbeat
    log.sent(3, 103, 10.0125)  # before frame 2 is answered
    log.hear(10.013, "ForceMonitor", Status(3, 102, "BOUND", "too much"))
    log.hear(10.014, "ForceReading", reading(102))
    assert [answer.took_s for answer in log.answers] == pytest.approx([0.002, 0.003])
    assert log.longest_silence_s == pytest.approx(0.009)
    change = log.first_doubt(0.0)
    assert change is not None
    assert (change.code, change.cause, change.frame, change.answers) == (3, "BOUND", 2, True)
    assert change.after_s == pytest.approx(0.003)
    assert [entry.code for entry in log.changes] == [1, 3]
    assert not log.ok


def test_of_answers_that_come_together_the_first_that_changes_has_the_frame() -> None:
    log = AnswerLog()
    for number in (1, 2, 3):
        log.sent(number, 100 + number, 10.0 + 0.01 * number)
    for number, code in ((1, 1), (2, 3), (3, 3)):
        log.hear(10.05, "ForceMonitor", Status(code))
        log.hear(10.05, "ForceReading", reading(100 + number))
    assert [(change.code, change.frame) for change in log.changes] == [(1, 1), (3, 2)]


def test_a_change_without_a_reading_is_of_no_frame_that_is_answered_later() -> None:
    log = AnswerLog()
    log.sent(1, 101, 10.0)
    log.hear(10.1, "ForceMonitor", Status(3, 7, "SILENCE", "no frame"))
    log.sent(2, 102, 10.2)
    log.hear(10.1, "ForceMonitor", Status(3, 7, "SILENCE", "no frame"))
    log.hear(10.1, "ForceReading", reading(102))
    (change,) = log.changes
    assert (change.frame, change.answers) == (1, False)


def test_what_answers_no_frame_is_not_taken_for_an_answer() -> None:
    log = AnswerLog()
    log.hear(9.0, "ForceMonitor", Status(13))
    log.sent(1, 101, 10.0)
    for text in ("no json", "[1]", '{"frame_id": null}', '{"frame_id": 999}'):
        log.hear(10.1, "ForceReading", Text(text))
    log.hear(10.1, "Other", Status(3))
    log.hear(10.1, "ForceMonitor", Sensor((1.0,)))
    assert log.answers == []
    assert log.answered is None
    assert [(change.code, change.frame) for change in log.changes] == [(13, None)]
    assert log.first_doubt(9.5) is None


def test_the_oldest_frames_that_are_never_answered_are_forgotten() -> None:
    log = AnswerLog()
    for number in range(3000):
        log.sent(number, number, 10.0)
    log.hear(10.1, "ForceMonitor", Status(1))
    for number in (0, 1999, 2000, 2999):
        log.hear(10.1, "ForceReading", reading(number))
    assert len(log.answers) == 2
