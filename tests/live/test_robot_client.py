"""The reference client for robots: every doubt is a withdrawal, and OK is not."""

import random
import subprocess
import sys
from collections.abc import Callable
from types import SimpleNamespace

import pytest
from fake_monitor import OK, fake_monitor
from fastcrc.crc64 import ecma_182
from sources import EXAMPLES, example_module
from waiting import FUSE_S, ends

from scleraforce.live.network.openigtlink import Sensor, Status, Text, encode

SCRIPT = EXAMPLES / "robot_client.py"
EMERGENCY = Status(3, 102, "BOUND", "WITHDRAW: up to 31 mN")


robot_client = example_module("robot_client")


class ClockedLink:
    """A connection on which each message comes after a pause of the test's clock; an
    empty one is its end.
    """

    def __init__(self, messages: list[tuple[float, bytes]]) -> None:
        self.now_s = 1000.0
        self.messages = messages
        self.timeout_s = 0.0
        self.data = b""

    def __enter__(self) -> "ClockedLink":
        return self

    def __exit__(self, *_: object) -> None: ...

    def setsockopt(self, *_: int) -> None: ...

    def settimeout(self, timeout_s: float) -> None:
        self.timeout_s = timeout_s

    def recv(self, count: int) -> bytes:
        if not self.data:
            pause_s, self.data = (
                self.messages.pop(0) if self.messages else (float("inf"), b"")
            )
            self.now_s += min(pause_s, self.timeout_s)

            if pause_s > self.timeout_s:
                raise TimeoutError

        piece = self.data[:count]
        self.data = self.data[count:]
        return piece


Watched = Callable[[list[tuple[float, bytes]]], list[tuple[bool, str]]]
START_S = 1000.0


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Watched:
    """Let a robot hear messages, each after a pause; return its orders."""
    client = example_module("robot_client")

    def run(messages: list[tuple[float, bytes]]) -> list[tuple[bool, str]]:
        link = ClockedLink(messages)
        orders = list[tuple[bool, str]]()
        clock = SimpleNamespace(monotonic=lambda: link.now_s, time=lambda: link.now_s)
        monkeypatch.setattr(client, "time", clock)
        monkeypatch.setattr(client.socket, "create_connection", lambda *_, **__: link)
        client.watch("monitor", 18944, lambda go_on, why: orders.append((go_on, why)))

        return orders

    return run


def said(status: Status, at_s: float = START_S) -> bytes:
    return encode(status, "ForceMonitor", time_s=at_s)


SILENT = (False, "no STATUS for 150 ms")
GO_ON = (True, "code 1, sub-code 0: WATCHING: class 0")


def order(status: Status) -> tuple[bool, str]:
    return (
        status.code == 1,
        f"code {status.code}, sub-code {status.subcode}: {status.message}",
    )


def test_ok_stays_through_heartbeats_and_other_messages(watched):
    others = [
        encode(message, "ForceReading")
        for message in (Text('{"frame": 1}'), Sensor((float("nan"),) * 10))
    ]
    messages = [
        said(OK),
        *others,
        encode(Status(3), "AnotherDevice"),
        *[said(OK)] * 3,
        said(EMERGENCY),
    ]
    assert watched([(0.01, data) for data in messages]) == [
        GO_ON,
        order(EMERGENCY),
        SILENT,
    ]


@pytest.mark.parametrize(
    "status",
    [EMERGENCY, Status(13, 0, "NOT_READY"), Status(0), Status(2), Status(65535)],
    ids=lambda status: str(status.code),
)
def test_any_code_but_1_withdraws_and_a_reset_leads_back(watched, status):
    orders = watched([(0.01, said(one)) for one in (OK, status, OK)])
    assert orders == [GO_ON, order(status), GO_ON, SILENT]


def test_nobody_there_withdraws():
    with fake_monitor() as monitor:
        port = monitor.port
    orders = []
    robot_client.watch("127.0.0.1", port, lambda *order: orders.append(order))
    assert (orders[-1][0], "refused" in orders[-1][1]) == (False, True)


def flipped(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :]


OK_BYTES = encode(OK, "ForceMonitor")


def with_body(size: int, body: bytes) -> bytes:
    """A header that states a size, and a body with its checksum."""
    check = ecma_182(body).to_bytes(8, "big")
    return OK_BYTES[:42] + size.to_bytes(8, "big") + check + body


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "closed the connection"),
        (b"HTTP/1.1 400 Bad Request\r\n" + bytes(64), "a header of version"),
        (encode(OK, "ForceMonitor", version=2), "a header of version 2"),
        (flipped(OK_BYTES, 70), "a checksum is wrong"),
        (flipped(encode(Text("a reading"), "ForceReading"), 65), "a checksum is wrong"),
        (with_body(1 << 40, b""), "a body of 1099511627776 bytes"),
        (with_body(2, b"ab"), "a STATUS of 2 bytes"),
    ],
)
def test_a_message_that_cannot_be_believed_and_the_end_of_the_connection_withdraw(
    watched, data, words
):
    go_on, why = watched([(0.01, said(OK)), (0.01, data)])[-1]
    assert not go_on
    assert words in why


@pytest.mark.parametrize("size", [0, 1, 7, 8, 9, 100, 1000])
def test_its_checksum_is_that_of_openigtlink(size):
    data = random.Random(size).randbytes(size)
    assert robot_client.crc64(data) == ecma_182(data)


def test_as_a_program_it_prints_changes_and_ends_with_exit_code_1(tmp_path):
    patient = tmp_path / "robot_client.py"
    patient.write_text(
        SCRIPT.read_text().replace("SILENCE_S = 0.150", "SILENCE_S = 300.0")
    )

    with fake_monitor() as monitor:
        monitor.status = OK
        command = [sys.executable, str(patient), "127.0.0.1", str(monitor.port)]
        child = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

        with ends(child.stdout, FUSE_S):
            assert " continue: code 1" in child.stdout.readline()
            monitor.say(EMERGENCY)
            assert (
                " WITHDRAW: code 3, sub-code 102: WITHDRAW: up to 31 mN"
                in child.stdout.readline()
            )

        monitor.drop()
        out, err = child.communicate(timeout=FUSE_S)

    assert " WITHDRAW: " in out
    assert err == ""
    assert child.returncode == 1


@pytest.mark.parametrize(("pause_s", "oks"), [(0.149, 3), (0.151, 1)])
def test_the_robot_bears_silence_up_to_150_ms_and_no_longer(watched, pause_s, oks):
    messages = [
        (pause_s if number else 0.01, Status(1, number, "OK")) for number in range(3)
    ]
    times_s = [START_S + 0.01 + pause_s * number for number in range(3)]
    orders = watched(
        [
            (after_s, said(status, at_s))
            for (after_s, status), at_s in zip(messages, times_s, strict=True)
        ]
    )
    assert [go_on for go_on, _ in orders] == [True] * oks + [False]
    assert orders[-1] == SILENT


def test_other_messages_and_half_a_status_do_not_break_the_silence(
    watched,
):
    other = encode(Text("alive"), "ForceMonitor") + encode(Status(1), "Other")
    assert watched([(0.01, said(OK))] + [(0.02, other)] * 100) == [GO_ON, SILENT]
    assert watched([(0.01, said(OK)), (0.14, said(OK)[:70])]) == [GO_ON, SILENT]


def test_an_ok_that_has_waited_does_not_count_and_a_withdrawal_does(
    watched,
):
    messages = [
        (0.01, said(OK, START_S + 0.01)),
        (0.01, said(EMERGENCY, START_S - 10.0)),
    ]
    messages += [(0.01, said(OK, START_S - 0.02))]  # 50 ms old
    messages += [
        (0.02, said(OK, START_S + 0.03 + 0.02 * number - 0.3))
        for number in range(1, 100)
    ]
    assert [go_on for go_on, _ in watched(messages)] == [True, False, True, False]
    assert len(messages) > 80  # it did not wait for them


def test_a_monitor_with_another_clock_is_believed(watched):
    oks = [(0.02, said(OK, START_S + 3600.0 + 0.02 * number)) for number in range(50)]
    assert watched([*oks, (0.02, said(EMERGENCY, START_S + 3601.0))])[:2] == [
        GO_ON,
        order(EMERGENCY),
    ]
