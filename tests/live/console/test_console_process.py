"""The console as a process: a monitor at one end of its channel, requests of browsers
and others at the other.
"""

import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from threading import Event, Thread
from time import monotonic
from typing import Any

import numpy as np
import pytest
from console_monitor import TOKEN, ConsoleMonitor, reading
from waiting import FUSE_S, alive, ends, wait_until
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.frames import Close
from websockets.sync.client import ClientConnection, connect

from scleraforce.live.companions.process_messages import (
    Outline,
    ResetAnswered,
    ResetAsked,
    WrongTokens,
)
from scleraforce.live.network.operator_reset import TOO_MANY

MOST = 128  # connections that are kept
MOST_PAGES = 32
ANSWERED = 10  # codes within ten seconds
FRAME = np.tile(np.arange(0, 64 * 60, 60, dtype=np.uint16)[:, None], (1, 96))


@pytest.fixture(scope="module")
def monitor() -> Iterator[ConsoleMonitor]:
    with ConsoleMonitor() as started:
        yield started


def ask(
    monitor: ConsoleMonitor,
    path: str = "/",
    method: str = "GET",
    body: str = "",
    **headers: str,
) -> tuple[http.client.HTTPResponse, str]:
    with closing(
        http.client.HTTPConnection("127.0.0.1", monitor.port, timeout=FUSE_S)
    ) as link:
        link.request(method, path, body or None, headers)
        answer = link.getresponse()
        return answer, answer.read().decode()


@contextmanager
def page(
    monitor: ConsoleMonitor, origin: str | None = ""
) -> Iterator[ClientConnection]:
    """Do as a browser's page does, without the browser; "" is the console's own
    origin.
    """
    own = monitor.address.rstrip("/") if origin == "" else origin
    with connect(
        f"ws://127.0.0.1:{monitor.port}/live",
        origin=own,
        compression=None,
        open_timeout=FUSE_S,
    ) as link:
        yield link


def received(link: ClientConnection) -> Iterator[dict[str, Any] | bytes]:
    """Yield what comes: states and pictures, each acknowledged."""
    end_s = monotonic() + FUSE_S
    while monotonic() < end_s:
        data = link.recv(timeout=FUSE_S)
        if isinstance(data, bytes):
            link.send(json.dumps({"drawn": header(data)["frame"]}))
            yield data
        elif (message := json.loads(data))["kind"] == "state":
            link.send(json.dumps({"seen": message["number"]}))
            yield message


def state_of(
    link: ClientConnection, state: str | None = None, **awaited: Any
) -> dict[str, Any]:
    """Return the next message, or the next in which everything awaited holds."""
    awaited |= {} if state is None else {"state": state}
    messages = (found for found in received(link) if isinstance(found, dict))
    return next(
        found
        for found in messages
        if all(found[name] == value for name, value in awaited.items())
    )


def shown_picture(link: ClientConnection) -> bytes:
    """Return the next picture."""
    return next(found for found in received(link) if isinstance(found, bytes))


def what_waits(link: ClientConnection) -> Iterator[str | bytes]:
    """Yield all that the console sent before it answers a ping; nothing of it is
    acknowledged.
    """
    assert link.ping().wait(FUSE_S)
    with suppress(TimeoutError):
        while True:
            yield link.recv(timeout=0.0)


def close_of(link: ClientConnection) -> Close | None:
    """Return the close frame of the console."""
    try:
        while True:
            link.recv(timeout=FUSE_S)
    except ConnectionClosed as closed:
        return closed.rcvd


def header(picture: bytes) -> dict[str, Any]:
    return dict(json.loads(picture[4 : 4 + int.from_bytes(picture[:4], "little")]))


def test_the_page_and_its_parts_come_with_a_strict_policy_and_nothing_from_elsewhere(
    monitor,
):
    answer, text = ask(monitor)
    parts = re.findall(r'(?:src|href)="([^"]+)"', text)
    scripts = [ask(monitor, f"/{name}")[1] for name in parts if name.endswith(".js")]
    parts += [
        name for script in scripts for name in re.findall(r'from "\./([^"]+)"', script)
    ]
    assert len(parts) == 8
    assert not re.search(r"<style|style=|<script>|\son\w+=|//[a-z]", text)
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'none';")
    assert "unsafe" not in policy
    assert "*" not in policy
    assert {"base-uri 'none'", "form-action 'none'", "frame-ancestors 'none'"} <= set(
        policy.split("; ")
    )

    for name in ["", *parts]:
        part, content = ask(monitor, f"/{name}")
        assert part.status == 200
        assert content
        assert part.headers["content-security-policy"] == policy
        assert part.headers["x-frame-options"] == "DENY"
        assert part.headers["x-content-type-options"] == "nosniff"
        assert part.headers["referrer-policy"] == "no-referrer"
        assert part.headers["cache-control"] == "no-store"
        elsewhere = re.findall(r"(?:https?:)?//[\w.-]+\.\w+[^\s\"'`]*", content)
        assert set(elsewhere) <= {"http://www.w3.org/2000/svg"}


@pytest.mark.parametrize(
    "path",
    [
        "/docs",
        "/openapi.json",
        "/../settings.py",
        "/%2e%2e/settings.py",
        "/page/index.html",
        "/a/b",
    ],
)
def test_what_is_not_there_is_not_found_and_still_carries_the_policy(monitor, path):
    answer, _ = ask(monitor, path)
    assert answer.status == 404
    assert "content-security-policy" in answer.headers


def test_another_host_name_or_a_socket_of_another_origin_is_refused(
    monitor,
):
    assert ask(monitor, Host=f"localhost:{monitor.port}")[0].status == 200
    assert ask(monitor, Host=f"evil.example:{monitor.port}")[0].status == 403

    for origin in (
        None,
        "http://evil.example",
        "null",
        f"http://localhost:{monitor.port}",
    ):
        with pytest.raises(InvalidStatus) as refused, page(monitor, origin):
            pass
        assert refused.value.response.status_code == 403


def test_a_reset_from_another_origin_or_none_never_reaches_the_monitor(
    monitor,
):
    own = monitor.address.rstrip("/")
    for origin, body, status in (
        (None, {"token": "t"}, 403),
        ("http://evil.example", {"token": "t"}, 403),
        (f"http://localhost:{monitor.port}", {"token": "t"}, 403),
        (own, {"token": "t" * 5000}, 413),
        (own, {"token": "t" * 300}, 422),
        (own, [], 422),
    ):
        headers = {"Content-Type": "application/json"}
        headers |= {"Origin": origin} if origin else {}
        answer, _ = ask(monitor, "/reset", "POST", json.dumps(body), **headers)
        assert answer.status == status, origin

    assert monitor.child.channel.receive() == []


def test_a_page_gets_the_settings_the_state_and_the_picture_with_its_outline(
    monitor,
):
    with page(monitor) as link:
        hello = json.loads(link.recv(timeout=FUSE_S))
        assert (hello["model"], hello["eye"], hello["bound_mn"]) == (
            "reader",
            "eye-a",
            30.0,
        )
        assert hello["class_bounds_mn"] == [5.0, 30.0]
        assert hello["pixel_mm"] == pytest.approx([15 / 96, 4 / 64])

        # a picture that is sent before its outline goes without one; so does a late
        # reading
        for _ in range(100):
            frame = monitor.frame(
                FRAME, "WATCHING", "class 1; 12.0 mN", **reading(12.0)
            )
            monitor.tell(
                Outline(
                    frame=frame,
                    step=4,
                    outer=(None, 3.5),
                    inner=(7.0, 8.0),
                    plane="across",
                )
            )
            monitor.rates(frames_per_second=99.0, lost=frame)
            picture = shown_picture(link)

            message = state_of(link, "WATCHING", lost=frame)
            if (
                header(picture)["outline"] is not None
                and message["reading"] is not None
            ):
                break

        assert message["reading"]["force_mn"] == 12.0
        assert message["steps"][-1][1:] == [12.0, 10.0, 14.0, "WATCHING", 1]
        assert message["latency_ms"] == [1.1, 1.1]
        assert [client["role"] for client in message["clients"]] == [
            "scanner",
            "listener",
        ]
        outline = {"step": 4, "outer": [None, 3.5], "inner": [7.0, 8.0]}
        assert header(picture) == {
            "frame": frame,
            "plane": "across",
            "rows": 64,
            "columns": 96,
            "outline": outline,
        }
        shown = np.frombuffer(picture[-64 * 96 :], np.uint8).reshape(64, 96)
        np.testing.assert_allclose(
            shown[:, 0], np.minimum(FRAME[:, 0] / FRAME[60, 0] * 255, 255), atol=6
        )
        monitor.entry(
            "WITHDRAW", "up to 31.0 mN, the bound is 30.0 mN; class 1; 29.0 mN", "BOUND"
        )
        message = state_of(link, "WITHDRAW")
        assert message["sentence"] == "The force may have reached the bound."
        assert message["detail"] == "up to 31.0 mN, the bound is 30.0 mN"


@pytest.mark.slow
def test_a_page_gets_less_while_answers_are_slow_and_a_withdrawal_at_once():
    rows = 512
    columns = 400

    with ConsoleMonitor(rows=rows, columns=columns) as monitor, page(monitor) as link:
        slow = {**reading(12.0), "latency_ms": 50.0}
        thrift = 0
        while not thrift:
            frame = monitor.frame(
                np.full((rows, columns), 1000, np.uint16), "WATCHING", **slow
            )
            thrift = state_of(link)["thrift"]

        monitor.tell(Outline(frame=frame, step=4, outer=(), inner=()))
        picture = shown_picture(link)

        while header(picture)["rows"] == rows:  # sent before
            frame = monitor.frame(
                np.full((rows, columns), 1000, np.uint16), "WATCHING", **slow
            )
            monitor.tell(Outline(frame=frame, step=4, outer=(), inner=()))
            picture = shown_picture(link)

        assert (header(picture)["rows"], header(picture)["columns"]) == (320, 320)
        monitor.entry("WITHDRAW", "class 2", "DANGEROUS_CLASS")
        assert state_of(link, "WITHDRAW")["thrift"] > 0


def post(monitor: ConsoleMonitor, token: str) -> http.client.HTTPConnection:
    link = http.client.HTTPConnection("127.0.0.1", monitor.port, timeout=FUSE_S)
    own = {"Origin": monitor.address.rstrip("/"), "Content-Type": "application/json"}
    link.request("POST", "/reset", json.dumps({"token": token}), own)
    return link


def operator_resets(monitor: ConsoleMonitor) -> None:
    """Check that a reset goes to the monitor with its token and comes back with its
    answer.
    """
    for granted, said in ((False, "no frame is fresh"), (True, "WATCHING")):
        with closing(post(monitor, TOKEN)) as operator:
            asked = monitor.hear(ResetAsked)
            assert asked.token == TOKEN
            monitor.tell(
                ResetAnswered(request=asked.request, granted=granted, message=said)
            )
            assert json.loads(operator.getresponse().read()) == {
                "granted": granted,
                "message": said,
            }


def test_a_code_goes_to_the_monitor_which_alone_knows_it_and_a_flood_of_codes_does_not(
    monitor,
):
    with ExitStack() as stack:
        guessers = [
            stack.enter_context(closing(post(monitor, f"{number:06d}")))
            for number in range(ANSWERED + 5)
        ]
        asked = wrong = 0

        while asked < ANSWERED or wrong < 5:
            match monitor.hear(ResetAsked | WrongTokens):
                case WrongTokens(count=count):
                    wrong += count
                case ResetAsked(request=request):
                    asked += 1
                    monitor.tell(
                        ResetAnswered(request=request, granted=False, message="asked")
                    )

        said = [
            json.loads(guesser.getresponse().read())["message"] for guesser in guessers
        ]

    # a right one would be refused, too: it is not called wrong
    assert (said.count("asked"), said.count(TOO_MANY)) == (ANSWERED, 5)
    operator_resets(monitor)


def test_a_page_that_stalls_gets_no_queue_and_disturbs_no_other(
    monitor,
):
    """The stalled one never answers: it has a few messages and one picture, whatever
    happens meanwhile.
    """
    monitor.entry("WATCHING")
    with page(monitor) as stalled, page(monitor) as lively:
        for lost in range(monitor.frames, monitor.frames + 12):
            monitor.frame(FRAME, "WATCHING", **reading(12.0))
            monitor.tell(Outline(frame=monitor.frames, step=4, outer=(), inner=()))
            monitor.rates(lost=lost)
            state_of(lively, lost=lost)  # which gets more than the stalled one

        monitor.entry("WITHDRAW", "class 2", "DANGEROUS_CLASS")
        state_of(lively, "WITHDRAW")
        waiting = list(what_waits(stalled))
        states = [json.loads(data) for data in waiting if isinstance(data, str)]
        assert [message["kind"] for message in states] == ["hello", *["state"] * 4]
        assert sum(isinstance(data, bytes) for data in waiting) <= 1
        stalled.send(json.dumps({"seen": states[-1]["number"]}))
        assert state_of(stalled)["state"] == "WITHDRAW"


def test_a_page_that_says_something_else_is_let_go(monitor):
    for said in ("no JSON", "[1]", "{}", '{"seen": "1"}', b"bytes", "[" * 4000):
        with page(monitor) as link:
            link.send(said)
            close = close_of(link)
            assert close is not None
            assert close.code == 1008, said


@pytest.mark.slow
def test_the_channel_is_read_while_nobody_looks_and_while_a_request_hangs(
    monitor,
):
    """Ten times what the channel holds, none of it lost."""
    with socket.create_connection(("127.0.0.1", monitor.port)) as hanging:
        hanging.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n")
        for number in range(3000):
            monitor.entry("WATCHING", frame=number + 1)

    monitor.entry("WITHDRAW", "class 2", "DANGEROUS_CLASS")
    with page(monitor) as link:
        state_of(link, "WITHDRAW")


@pytest.mark.slow
def test_when_the_monitor_dies_pages_show_it_and_the_console_ends():
    """The monitor here is a process of its own, which is killed."""
    program = (
        "import sys; from console_monitor import ConsoleMonitor; started ="
        " ConsoleMonitor();started.entry('WATCHING'); print(started.port,"
        " started.child.process.pid, flush=True); sys.stdin.read()"
    )
    support = Path(__file__).parents[2] / "support"
    killed = subprocess.Popen(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": str(support)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert killed.stdout is not None

    with ends(killed.stdout, FUSE_S):
        port, pid = map(int, killed.stdout.readline().split())

    with connect(
        f"ws://127.0.0.1:{port}/live",
        origin=f"http://127.0.0.1:{port}",
        open_timeout=FUSE_S,
    ) as link:
        assert state_of(link)["state"] == "WATCHING"
        killed.send_signal(signal.SIGKILL)
        killed.wait(FUSE_S)
        assert state_of(link, monitor="ended")
        close_of(link)

    killed.stdout.close()
    assert killed.stdin is not None
    killed.stdin.close()
    wait_until(lambda: not alive(pid))


@pytest.mark.slow
def test_no_number_of_wrong_tokens_keeps_the_operator_waiting_and_the_monitor_hears_their_sum():
    with ConsoleMonitor() as monitor, ExitStack() as stack:
        guessers = [
            stack.enter_context(closing(post(monitor, f"wrong {number}")))
            for number in range(60)
        ]
        said = [json.loads(guesser.getresponse().read()) for guesser in guessers]
        refusals = {
            (answer["granted"], answer["message"].split(";")[0]) for answer in said
        }
        assert refusals == {(False, "the token or code is wrong")}
        counted = 0

        while counted < 60:
            counted += monitor.hear(WrongTokens).count

        assert counted == 60
        more = [stack.enter_context(closing(post(monitor, "wrong"))) for _ in range(20)]
        operator_resets(monitor)  # while the others wait for their answers
        assert more


@pytest.mark.slow
def test_a_page_that_answers_keeps_its_place_while_silent_ones_come():
    with ConsoleMonitor() as monitor, ExitStack() as stack:
        lively = stack.enter_context(page(monitor))
        lost = []
        # since the last page came: on a quick machine they come faster than it is asked
        answered = Event()

        def answers():
            try:
                while True:
                    message = json.loads(lively.recv())
                    if message["kind"] == "state":
                        lively.send(json.dumps({"seen": message["number"]}))
                        answered.set()
            except ConnectionClosed as closed:
                lost.append(closed)

        thread = Thread(target=answers, daemon=True)
        thread.start()

        for number in range(2 * MOST_PAGES):
            silent = stack.enter_context(page(monitor))
            assert json.loads(silent.recv(timeout=FUSE_S))["kind"] == "hello", number
            answered.clear()
            assert answered.wait(FUSE_S)

        assert not lost
        lively.close()
        thread.join(FUSE_S)


@pytest.mark.slow
def test_connections_that_say_nothing_give_way_to_the_operators():
    with ConsoleMonitor() as monitor, ExitStack() as stack:
        links = (
            socket.create_connection(("127.0.0.1", monitor.port), timeout=FUSE_S)
            for _ in range(MOST + 10)
        )
        idle = [stack.enter_context(link) for link in links]
        operator_resets(monitor)
        assert idle[0].recv(1) == b""  # the oldest one was cut off
