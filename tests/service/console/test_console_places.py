"""Who floods the console with wrong tokens, sockets or connections: the operator has a place all the same."""

import json
import socket
from contextlib import ExitStack, closing, suppress
from http.client import HTTPConnection
from threading import Thread

import pytest
from console_monitor import TOKEN, ConsoleMonitor
from small_monitor import FUSE_S
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from scleraforce.service.console.hub import MOST_PAGES
from scleraforce.service.messages import ResetAnswered, ResetAsked, WrongTokens

MOST = 128  # connections that are kept


def post(monitor: ConsoleMonitor, token: str) -> HTTPConnection:
    link = HTTPConnection("127.0.0.1", monitor.port, timeout=FUSE_S)
    own = {"Origin": monitor.address.rstrip("/"), "Content-Type": "application/json"}
    link.request("POST", "/reset", json.dumps({"token": token}), own)
    return link


def page(monitor: ConsoleMonitor) -> ClientConnection:
    return connect(f"ws://127.0.0.1:{monitor.port}/live", origin=monitor.address.rstrip("/"), compression=None)  # type: ignore[arg-type]


def close_code(link: ClientConnection) -> int | None:
    """With which a socket is closed; it has to be soon."""
    with suppress(ConnectionClosed):
        while link.recv(timeout=FUSE_S):
            pass
    return link.close_code


def operator_resets(monitor: ConsoleMonitor) -> None:
    with closing(post(monitor, TOKEN)) as operator:
        asked = monitor.hear(ResetAsked)
        assert asked.token == TOKEN
        monitor.tell(ResetAnswered(request=asked.request, granted=True, message="WATCHING"))
        assert json.loads(operator.getresponse().read())["granted"] is True


@pytest.mark.slow
def test_no_number_of_wrong_tokens_keeps_the_operator_waiting_and_the_monitor_hears_their_sum() -> None:
    with ConsoleMonitor() as monitor, ExitStack() as stack:
        guessers = [stack.enter_context(closing(post(monitor, f"wrong {number}"))) for number in range(60)]
        said = [json.loads(guesser.getresponse().read()) for guesser in guessers]
        assert {(answer["granted"], answer["message"].split(";")[0]) for answer in said} == {
            (False, "the token is wrong")
        }
        counted = 0
        while counted < 60:
            counted += monitor.hear(WrongTokens).count
        assert counted == 60
        more = [stack.enter_context(closing(post(monitor, "wrong"))) for _ in range(20)]
        operator_resets(monitor)  # while those wait for their answers: nothing of them came before
        assert more


@pytest.mark.slow
def test_sockets_that_say_nothing_give_way_to_a_page() -> None:
    with ConsoleMonitor() as monitor, ExitStack() as stack:
        silent = [stack.enter_context(page(monitor)) for _ in range(MOST_PAGES)]
        late = stack.enter_context(page(monitor))
        assert json.loads(late.recv(timeout=FUSE_S))["kind"] == "hello"
        assert close_code(silent[0]) == 1013
        assert json.loads(silent[1].recv(timeout=FUSE_S))["kind"] == "hello"


@pytest.mark.slow
def test_a_page_that_answers_keeps_its_place_while_silent_ones_come() -> None:
    with ConsoleMonitor() as monitor, ExitStack() as stack:
        lively = stack.enter_context(page(monitor))
        lost: list[ConnectionClosed] = []

        def answers() -> None:
            try:
                while True:
                    message = json.loads(lively.recv())
                    if message["kind"] == "state":
                        lively.send(json.dumps({"seen": message["number"]}))
            except ConnectionClosed as closed:
                lost.append(closed)

        thread = Thread(target=answers)
        thread.start()
        for number in range(2 * MOST_PAGES):
            silent = stack.enter_context(page(monitor))
            assert json.loads(silent.recv(timeout=FUSE_S))["kind"] == "hello", number
        assert not lost
        lively.close()
        thread.join()


@pytest.mark.slow
def test_connections_that_say_nothing_give_way_to_the_operators() -> None:
    with ConsoleMonitor() as monitor, ExitStack() as stack:
        idle = [
            stack.enter_context(socket.create_connection(("127.0.0.1", monitor.port), timeout=FUSE_S))
            for _ in range(MOST + 10)
        ]
        operator_resets(monitor)
        assert idle[0].recv(1) == b""  # the oldest one was cut off
