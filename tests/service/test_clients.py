"""A client that does not read: it misses messages, never gets half of one, and is let go in the end."""

import socket
from collections.abc import Iterator
from time import sleep

import pytest
from peer import FUSE_S, NoGuard

from scleraforce.openigtlink import Decoder, Received, Text, encode
from scleraforce.service.clients import STALLED_S, Clients
from scleraforce.service.connection import WAITING_BYTES, Connection


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


def all_that_arrives(peer: socket.socket, connection: Connection) -> Iterator[bytes]:
    """Read until nothing of what was sent is on its way."""
    peer.setblocking(False)
    while True:
        on_its_way = connection._waiting_bytes() > 0
        try:
            yield peer.recv(1 << 20)
        except BlockingIOError:
            if not on_its_way:
                return
            sleep(0.001)


def test_a_peer_that_reads_late_gets_whole_messages_and_misses_others(listener: socket.socket) -> None:
    with socket.create_connection(listener.getsockname()) as peer:
        connection = Connection(listener.accept()[0], "peer", 1)
        sent = [encode(Text(f"{number:04d}" * 1000), "ForceReading") for number in range(5000)]
        for number, message in enumerate(sent):
            connection.send(message, 100.0 + number)
        assert connection.unread_since_s is not None
        since_s = connection.unread_since_s
        heard, decoder = [], Decoder()
        for number in range(5000, 5003):
            for data in all_that_arrives(peer, connection):
                heard += decoder.feed(data)
            connection.send(encode(Text(f"{number:04d}" * 1000), "ForceReading"), 100.0 + number)
        connection.close()
    texts = [event.message.text for event in heard if isinstance(event, Received)]  # type: ignore[union-attr] # a Text
    assert len(texts) == len(heard)
    assert all(text == text[:4] * 1000 for text in texts)
    numbers = [int(text[:4]) for text in texts]
    assert numbers == sorted(set(numbers))
    assert numbers[0] == 0
    assert numbers[-3] < since_s - 100.0 < 5000  # none since then, until it had read
    assert numbers[-2:] == [5000, 5001]
    assert connection.unread_since_s is None


def test_hardly_more_than_a_tenth_of_a_second_waits_for_a_peer_that_does_not_read(listener: socket.socket) -> None:
    with socket.socket() as peer:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        peer.connect(listener.getsockname())
        connection = Connection(listener.accept()[0], "peer", 1)
        message = encode(Text("x" * 500), "ForceReading")
        for number in range(5000):
            connection.send(message, 100.0 + number)
        newest = encode(Text("newest"), "ForceReading")
        peer.settimeout(FUSE_S)
        heard = b""
        while newest not in heard:
            connection.send(newest, 6000.0)
            heard += peer.recv(100)  # slowly
        own_bytes = peer.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        assert len(heard) < WAITING_BYTES + len(message) + own_bytes
        connection.close()


def test_who_reads_nothing_for_ten_seconds_is_let_go_but_for_the_scanner(listener: socket.socket) -> None:
    notes: list[str] = []
    clients = Clients(listener, 10, 2.0, NoGuard(), notes.append)  # type: ignore[arg-type]  # a stand-in
    with socket.create_connection(listener.getsockname()):
        (client,) = clients.accept()
        client.unread_since_s = 100.0
        clients.sweep(100.0 + STALLED_S - 0.1, None)
        clients.sweep(100.0 + STALLED_S + 0.1, client)
        assert client in clients
        clients.sweep(100.0 + STALLED_S + 0.1, None)
        assert client not in clients
    clients.close()
    assert "read nothing for 10 s" in notes[-1]
