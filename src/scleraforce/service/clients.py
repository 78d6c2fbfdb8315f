"""The clients of the monitor: their connections, known to the watchdog, and what is sent to all of them."""

import os
import selectors
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from errno import EMFILE, ENFILE
from itertools import count
from select import select
from time import sleep

from scleraforce.service.companions.guard import Guard
from scleraforce.service.connection import Connection, Outgoing

ACCEPTED_PER_TURN = 16
CHANGING = 32  # places that change hands: twice what a turn accepts, so that a newcomer is heard before it is replaced
REST_S = 0.001  # now and then: Linux pauses real-time processes for 50 ms in a second of which they leave nothing
WORK_S = 0.01  # without a rest, where frames come faster than they are read


class Clients:
    """Accepts clients and keeps their connections; no client can delay another or take all places.

    When all places are taken, a new client replaces one of the newest, an eighth of all (`CHANGING` at most): the one
    that has been there longest among these. So an operator and a scanner always find a place, and the clients that
    were there before keep theirs.

    Args:
        listener: a socket that listens already.
        most: largest number of connections.
        message_s: time within which a message has to be complete.
        stalled_s: time for which a message may wait in the queue to a client; after it, what it says is old.
        guard: the watchdog, which speaks to the clients when the monitor cannot.
        note: called with a line when a client connects or leaves.
    """

    def __init__(
        self,
        listener: socket.socket,
        most: int,
        message_s: float,
        stalled_s: float,
        guard: Guard,
        note: Callable[[str], None],
    ) -> None:
        self._most, self._message_s, self._stalled_s, self._guard, self._note = most, message_s, stalled_s, guard, note
        self.listener = listener
        self.listener.setblocking(False)
        self.selector = selectors.DefaultSelector()
        self.selector.register(self.listener, selectors.EVENT_READ, None)
        self._connected: dict[int, Connection] = {}
        self._numbers = count(1)
        self._waited_s = float("-inf")
        self._spare: int | None = None
        self._take_spare()

    def __iter__(self) -> Iterator[Connection]:
        return iter(list(self._connected.values()))

    def __contains__(self, client: Connection) -> bool:
        return client.number in self._connected

    def wait(self, within_s: float, clock: Callable[[], float]) -> list[tuple[selectors.SelectorKey, int]]:
        """Wait for clients with data; rest for a moment first where there was no wait for long.

        Args:
            within_s: for how long at most.
            clock: s, monotonic.
        """
        begun_s = clock()
        if begun_s - self._waited_s > WORK_S:
            sleep(REST_S)
            self._waited_s = begun_s = clock()
        ready = self.selector.select(within_s)
        now_s = clock()
        if now_s - begun_s >= REST_S:
            self._waited_s = now_s
        return ready

    def accept(self, spared: Connection | None = None) -> list[Connection]:
        """Accept the clients that wait; return those that are still connected. `spared` keeps its place."""
        came, freed = [], False
        for _ in range(ACCEPTED_PER_TURN):
            try:
                link, address = self.listener.accept()
            except OSError as fault:
                if fault.errno in (EMFILE, ENFILE) and not freed and self._free_descriptor(spared):
                    freed = True  # once in a turn, so that a newcomer is heard before another replaces it
                    continue
                break  # no client waits any more, or too many files are open
            if len(self._connected) >= self._most:
                self._make_room(spared)
            client = Connection(link, f"{address[0]}:{address[1]}", next(self._numbers))
            self._connected[client.number] = client
            self._guard.watch(client)
            self.selector.register(client, selectors.EVENT_READ, client)
            self._note(f"client {client.address} came")
            came.append(client)
        return [client for client in came if client in self]

    def _take_spare(self) -> None:
        """Keep one descriptor for a client that comes when no other is free: it may be the operator."""
        with suppress(OSError):
            self._spare = os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC) if self._spare is None else self._spare

    def _free_descriptor(self, spared: Connection | None) -> bool:
        """Free a descriptor for a client that waits: the spare one, or that of one of the newest clients."""
        if not select([self.listener], [], [], 0.0)[0]:  # accept says that none is free before it looks
            return False
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None
            return True
        if not any(client is not spared for client in self):
            return False
        self._make_room(spared)
        return True

    def _make_room(self, spared: Connection | None) -> None:
        """Disconnect one of the newest clients."""
        others = [client for client in self if client is not spared]
        changing = others[-max(1, min(CHANGING, len(others) // 8)) :]
        self.leave(changing[0], "was disconnected: no place is free, and another client came")

    def leave(self, client: Connection, why: str, *, discard: bool = False) -> None:
        """Disconnect a client, if it is still there; `discard` what has not arrived yet."""
        if self._connected.pop(client.number, None) is None:
            return
        self.selector.unregister(client)
        self._guard.forget(client)
        client.close(discard=discard)
        self._note(f"client {client.address} {why}")

    def speaks(self, client: Connection, version: int) -> None:
        """Answer a client in the header version that it spoke last."""
        if version != client.version:
            client.version = version
            self._guard.version(client)

    def send(self, client: Connection, telling: Outgoing, now_s: float) -> None:
        """Send messages to one client, if it is still there."""
        if client not in self:
            return
        try:
            client.send(telling.to(client.version), now_s)
        except OSError:
            self.leave(client, "has gone")

    def broadcast(self, telling: Outgoing, now_s: float) -> None:
        """Send messages to all clients."""
        for client in self:
            self.send(client, telling, now_s)

    def sweep(self, now_s: float, spared: Connection | None) -> list[str]:
        """Disconnect clients with an incomplete message or that read too slowly; a scanner (`spared`) need not read.

        Returns:
            The addresses of those that read too slowly: a robot among them may have been told to withdraw in vain.
        """
        self._take_spare()
        slow = []
        for client in self:
            if client.message_since_s is not None and now_s - client.message_since_s > self._message_s:
                self.leave(client, f"was disconnected: its message was not complete within {self._message_s:g} s")
            if client is spared or client not in self:
                continue
            since_s = client.unread_since_s
            if since_s is not None and now_s - since_s > self._stalled_s:
                self.leave(client, f"was disconnected: messages to it waited for {self._stalled_s:g} s", discard=True)
                slow.append(client.address)
        return slow

    def close(self) -> None:
        """Disconnect all clients and stop listening."""
        for client in self:
            self.leave(client, "was disconnected: the monitor ends")
        if self._spare is not None:
            os.close(self._spare)
        self.selector.close()
        self.listener.close()
