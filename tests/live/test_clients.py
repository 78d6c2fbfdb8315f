"""A client that does not read: it misses messages, never gets half of one, and is let
go in the end.
"""

import os
import resource
import socket
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from select import select

import pytest
from small_monitor import NoGuard
from waiting import FUSE_S, wait_until

from scleraforce.live.connected_clients import (
    WAITING_BYTES,
    Clients,
    Connection,
    ServerSettings,
)
from scleraforce.live.network.openigtlink import Decoder, Received, Text, encode

STALLED_S = ServerSettings("token").stalled_s


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


def all_that_arrives(peer: socket.socket, connection: Connection) -> Iterator[bytes]:
    """Read until nothing is on its way any more."""

    def has_come() -> bool:
        return bool(select([peer], [], [], 0.0)[0])

    while connection._forget_taken() > 0 or has_come():
        wait_until(lambda: has_come() or connection._forget_taken() == 0)
        if has_come():
            yield peer.recv(1 << 20)


def test_a_peer_that_reads_late_gets_whole_messages_and_misses_others(
    listener,
):
    with socket.create_connection(listener.getsockname()) as peer:
        connection = Connection(listener.accept()[0], "peer", 1)
        sent = [
            encode(Text(f"{number:04d}" * 1000), "ForceReading")
            for number in range(5000)
        ]

        for number, message in enumerate(sent):
            connection.send(message, 100.0 + number)

        since_s = connection.unread_since_s
        assert since_s is not None
        heard = []
        decoder = Decoder()

        for number in range(5000, 5003):
            for data in all_that_arrives(peer, connection):
                heard += decoder.feed(data)

            connection.send(
                encode(Text(f"{number:04d}" * 1000), "ForceReading"), 100.0 + number
            )

        wait_until(lambda: connection.unread_since_s is None)
        connection.close()

    texts = [event.message.text for event in heard if isinstance(event, Received)]  # type: ignore[union-attr] # a Text
    assert len(texts) == len(heard)
    assert all(text == text[:4] * 1000 for text in texts)
    numbers = [int(text[:4]) for text in texts]
    assert numbers == sorted(set(numbers))
    assert numbers[0] == 0
    # none since then, until it had read
    assert numbers[0] < since_s - 100.0 <= numbers[-3] < 5000
    assert numbers[-2:] == [5000, 5001]


def test_hardly_more_than_a_tenth_of_a_second_waits_for_a_peer_that_does_not_read(
    listener,
):
    with socket.socket() as peer:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        peer.connect(listener.getsockname())
        connection = Connection(listener.accept()[0], "peer", 1)
        message = encode(Text("x" * 500), "ForceReading")

        for number in range(5000):
            connection.send(message, 100.0 + number)

        assert connection._forget_taken() <= WAITING_BYTES + len(message)
        newest = encode(Text("newest"), "ForceReading")
        peer.settimeout(FUSE_S)
        heard = b""

        while newest not in heard:
            connection.send(newest, 6000.0)
            heard += peer.recv(100)  # slowly

        own_bytes = peer.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        assert len(heard) < WAITING_BYTES + len(message) + own_bytes
        connection.close()


def unread(
    listener: socket.socket, clients: Clients
) -> tuple[socket.socket, Connection]:
    """Return a peer with a small buffer that reads nothing, and its connection, with
    messages from 100 s on.
    """
    peer = socket.socket()
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    peer.connect(listener.getsockname())
    assert select([listener], [], [], FUSE_S)[0]
    (client,) = clients.accept()

    for number in range(200):
        client.send(encode(Text("x" * 500), "ForceReading"), 100.0 + 0.001 * number)

    return peer, client


@pytest.fixture
def clients(listener: socket.socket) -> Iterator[tuple[Clients, list[str]]]:
    notes: list[str] = []
    clients = Clients(
        listener, ServerSettings("token", clients=10), NoGuard(), notes.append
    )
    yield clients, notes
    clients.close()


def test_a_client_for_which_messages_wait_is_let_go_after_a_fifth_of_a_second_but_not_the_scanner(
    listener, clients
):
    served, notes = clients
    peer, client = unread(listener, served)

    with peer:
        since_s = client.unread_since_s
        assert since_s is not None
        assert served.sweep(since_s + STALLED_S - 0.01, None) == []
        assert served.sweep(since_s + STALLED_S + 60.0, client) == []
        assert client in served
        assert served.sweep(since_s + STALLED_S + 0.01, None) == [client.address]
        assert client not in served
        assert "waited for 0.2 s" in notes[-1]
        peer.settimeout(FUSE_S)
        heard = 0

        with suppress(ConnectionResetError):
            while data := peer.recv(1 << 16):
                heard += len(data)

            pytest.fail("what had not arrived was sent all the same")

        assert heard <= peer.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


def test_a_server_that_is_never_idle_rests_now_and_then_and_one_that_waits_does_not(
    clients, monkeypatch
):
    served, _ = clients
    now_s = [10.0]
    rests = []

    def pass_time(for_s):
        now_s[0] += for_s

    monkeypatch.setattr(
        "scleraforce.live.connected_clients.sleep",
        lambda for_s: (rests.append(for_s), pass_time(for_s)),
    )
    monkeypatch.setattr(
        served.selector, "select", lambda within_s: pass_time(within_s) or []
    )
    served._waited_s = 10.0

    for within_s in (0.0, 0.002):
        for _ in range(31):
            served.wait(within_s, lambda: now_s[0])
            pass_time(0.004)

        # after each three turns of 4 ms; none is added by turns that wait
        assert rests == [0.001] * 10


def test_without_a_free_descriptor_the_operator_still_connects(listener, clients):
    served, notes = clients
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)

    with ExitStack() as peers:
        waiting = [
            peers.enter_context(socket.create_connection(listener.getsockname()))
            for _ in range(3)
        ]
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (lowest_free(), hard))
            came = [served.accept() for _ in range(3)]
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))

        names = ["{}:{}".format(*peer.getsockname()) for peer in waiting]
        assert [[client.address for client in turn] for turn in came] == [
            [name] for name in names
        ]
        assert sum("another client came" in note for note in notes) == 2


def lowest_free() -> int:
    """Return the number of the next descriptor, so that a limit of it allows no
    more.
    """
    found = os.open(os.devnull, os.O_RDONLY)
    os.close(found)
    return found
