"""The clients of the monitor: their connections, known to the watchdog, and what is
sent to all of them.
"""

import fcntl
import json
import os
import selectors
import socket
import sys
import termios
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass
from errno import EMFILE, ENFILE
from itertools import count
from math import nan
from select import select
from struct import pack
from time import sleep

from scleraforce.base.errors import ProtocolError
from scleraforce.live.companions.companion_processes import Guard
from scleraforce.live.companions.process_messages import (
    DECISION_DEVICE,
    READING_DEVICE,
    STATUS_DEVICE,
    Entry,
    decision_text,
)
from scleraforce.live.decision.decide import Decision
from scleraforce.live.network.openigtlink import (
    Decoder,
    Message,
    PeerEvent,
    Sensor,
    Status,
    Text,
    encode,
)
from scleraforce.live.network.scanner_frame import FrameAssembler
from scleraforce.records.verdict import Verdict

NOT_READ = Verdict(
    predicted=0,
    probabilities=None,
    usable=False,
    reason=None,
    force_n=None,
    interval_n=None,
)
# device and message
Addressed = tuple[str, Message]
MESSAGE_CHARACTERS = 1000  # of a STATUS: a reason may quote what a peer sent
# not yet taken by the peer: a tenth of a second; a message behind them is old when it
# is read
WAITING_BYTES = 8192
# send buffer of the system, which doubles it: what it holds, nobody can take back
SEND_BUFFER_BYTES = 8192
NOTES_PER_S = 1.0
NOTES_AT_ONCE = 10
# a robot sends 1000 a second at most
FORCES_PER_S = 1200.0
FORCES_AT_ONCE = 120
# received before others have their turn: all that a socket holds
TURN_BYTES = 8 * 1024 * 1024
TURN_EVENTS = 16
ACCEPTED_PER_TURN = 16
# places that change hands: twice what a turn accepts, so that a newcomer is heard
# before it is replaced
CHANGING = 32
# now and then: Linux pauses real-time processes for 50 ms in a second of which they
# leave nothing
REST_S = 0.001
WORK_S = 0.01  # without a rest, where frames come faster than they are read


@dataclass(frozen=True)
class ServerSettings:
    """Limits on clients, and the token of the operator's reset.

    At most `clients` are connected. A client is disconnected if its message is not
    complete within `message_s`, or if a message to it waits for `stalled_s`: after that
    time its content is old.
    """

    token: str
    _: KW_ONLY
    clients: int = 256
    message_s: float = 2.0
    stalled_s: float = 0.2


class RateLimiter:
    """Allows `per_s` actions a second in the long run, and a burst of `at_once` after a
    pause.

    >>> limiter = RateLimiter(per_s=2.0, at_once=3)
    >>> [limiter.take(now_s) for now_s in (10.0, 10.0, 10.0, 10.0, 10.5, 10.6)]
    [True, True, True, False, True, False]
    """

    def __init__(self, per_s: float, at_once: int) -> None:
        self._per_s = per_s
        self._at_once = at_once
        self._left = float(at_once)
        self._then_s = -float("inf")

    def take(self, now_s: float) -> bool:
        """Return whether the action is allowed now; if it is, it counts as done."""
        self._left = min(
            self._at_once, self._left + self._per_s * max(0.0, now_s - self._then_s)
        )
        self._then_s = max(now_s, self._then_s)

        if self._left < 1.0:
            return False

        self._left -= 1.0
        return True


def status_message(decision: Decision) -> Addressed:
    """Return the STATUS of a decision; the error name is the cause's, or without a
    cause the state's.
    """
    name = (
        decision.cause.name
        if decision.cause
        else ""
        if decision.code == 1
        else decision.state.name
    )
    text = decision.message[:MESSAGE_CHARACTERS]
    return STATUS_DEVICE, Status(decision.code, decision.sub_code, name[:20], text)


def decision_message(decision: Decision) -> Addressed:
    """Return a decision as a STRING."""
    text = decision_text(
        code=decision.code,
        sub_code=decision.sub_code,
        state=decision.state.name,
        cause=decision.cause.name if decision.cause else None,
        message=decision.message[:MESSAGE_CHARACTERS],
    )
    return DECISION_DEVICE, text


def reading_messages(entry: Entry) -> tuple[Addressed, ...]:
    """Return the STRING and the SENSOR of a decision on a frame.

    The SENSOR holds: frame, class, probabilities of the classes 0, 1 and 2, force,
    lower and upper end of its interval (N), usable (1 or 0), code of the STATUS.
    Missing values are NaN.
    """
    verdict = entry.verdict or NOT_READ
    shares = (verdict.probabilities or (nan, nan, nan))[:3]
    numbers = (
        nan if entry.frame is None else float(entry.frame),
        float(verdict.predicted) if entry.verdict else nan,
        *shares,
        *(nan,) * (3 - len(shares)),
        nan if verdict.force_n is None else verdict.force_n,
        *(verdict.interval_n or (nan, nan)),
        float(verdict.usable),
        float(entry.code),
    )

    return (
        (READING_DEVICE, Text(json.dumps(entry.as_json()))),
        (READING_DEVICE, Sensor(numbers)),
    )


class Outgoing:
    """Messages for several clients, each with its device, encoded once for each header
    version that is needed.
    """

    def __init__(
        self, messages: tuple[Addressed, ...], wall_clock: Callable[[], float]
    ) -> None:
        self._messages = messages
        self._time_s = wall_clock()
        self._encoded: dict[int, bytes] = {}

    def to(self, version: int) -> bytes:
        """Return the bytes for a client of a header version."""
        if version not in self._encoded:
            parts = [
                encode(message, device, version=version, time_s=self._time_s)
                for device, message in self._messages
            ]
            self._encoded[version] = b"".join(parts)

        return self._encoded[version]


class Connection:
    """A client.

    `version` is the header version that it used last, `heard_s` when it was last read
    from, `message_since_s` since when a message from it has been incomplete; `frames`
    assembles the images of each plane; `notes` and `forces` limit the rate of notes on
    its errors and of its forces.
    """

    def __init__(self, link: socket.socket, address: str, number: int) -> None:
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self.number = number
        self.address = address
        self.version = 1
        self.frames = dict[str | None, FrameAssembler]()
        self.heard_s = 0.0
        self.wrong_tokens = 0
        self.message_since_s: float | None = None
        self.notes = RateLimiter(NOTES_PER_S, NOTES_AT_ONCE)
        self.forces = RateLimiter(FORCES_PER_S, FORCES_AT_ONCE)
        self._link = link
        self._decoder = Decoder()
        self._rest = memoryview(b"")
        self._given_bytes = 0
        # (bytes given in all, when) of each message
        self._untaken: deque[tuple[int, float]] = deque()

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._link.fileno()

    def receive(
        self, max_body_bytes: int, now_s: float
    ) -> tuple[list[PeerEvent], bool]:
        """Read the share of one turn; return the complete events, and whether the peer
        is still there.
        """
        events: list[PeerEvent] = []
        self.heard_s = now_s
        self._decoder.max_body_bytes = max_body_bytes
        left = TURN_BYTES
        alive = True

        try:
            while (
                left > 0
                and len(events) < TURN_EVENTS
                and alive
                and not self._decoder.broken
            ):
                space = self._decoder.space()
                count = self._link.recv_into(space)
                events += self._decoder.received(count) if count else ()
                alive = count > 0
                left = left - count

                if count < len(space) and not self._decoder.between:
                    break
        except BlockingIOError:
            pass
        except (OSError, ProtocolError):
            alive = False

        if self._decoder.between:
            self.message_since_s = None
        elif self.message_since_s is None or events:
            self.message_since_s = now_s

        return events, alive and not self._decoder.broken

    def send(self, data: bytes, now_s: float) -> None:
        """Send a message, or drop it if too many bytes wait, so that a peer never reads
        old ones.
        """
        self._flush()
        if self._forget_taken() > WAITING_BYTES or self._rest:
            return

        self._rest = memoryview(data)
        self._given_bytes += len(data)
        self._untaken.append((self._given_bytes, now_s))
        self._flush()

    @property
    def unread_since_s(self) -> float | None:
        """Time of the oldest message that has not arrived in the peer's own buffer;
        None if all have.
        """
        if self._untaken:
            self._forget_taken()
        return self._untaken[0][1] if self._untaken else None

    def _forget_taken(self) -> int:
        """Forget the messages that have arrived in the peer's own buffer; return the
        bytes sent that have not.
        """
        # SIOCOUTQ
        waiting_bytes = int.from_bytes(
            fcntl.ioctl(self._link, termios.TIOCOUTQ, bytes(4)), sys.byteorder
        )
        taken_bytes = self._given_bytes - len(self._rest) - waiting_bytes

        while self._untaken and self._untaken[0][0] <= taken_bytes:
            self._untaken.popleft()

        return waiting_bytes

    def _flush(self) -> None:
        """Continue a message that was sent in part: a peer must never get half of
        one.
        """
        with suppress(BlockingIOError):
            while self._rest:
                self._rest = self._rest[self._link.send(self._rest) :]

    def close(self, *, discard: bool = False) -> None:
        """End the connection, also where another process holds a duplicate; `discard`
        what has not arrived.
        """
        with suppress(OSError):  # the peer was quicker
            if discard:
                self._link.setsockopt(
                    socket.SOL_SOCKET, socket.SO_LINGER, pack("ii", 1, 0)
                )
            self._link.shutdown(socket.SHUT_RDWR)

        self._link.close()


class Clients:
    """Accepts clients and keeps their connections; no client can delay another or take
    all places.

    When all places are taken, a new client replaces the oldest of the newest eighth
    (`CHANGING` at most). So an operator and a scanner always find a place, and the
    clients that were there before keep theirs.
    """

    def __init__(
        self,
        listener: socket.socket,
        settings: ServerSettings,
        guard: Guard,
        note: Callable[[str], None],
    ) -> None:
        self._settings = settings
        self._guard = guard
        self._note = note
        self._listener = listener
        listener.setblocking(False)
        self.selector = selectors.DefaultSelector()
        self.selector.register(listener, selectors.EVENT_READ, None)
        self._connected: dict[int, Connection] = {}
        self._numbers = count(1)
        self._waited_s = float("-inf")
        self._spare: int | None = None
        self._take_spare()

    def __iter__(self) -> Iterator[Connection]:
        return iter(list(self._connected.values()))

    def __contains__(self, client: Connection) -> bool:
        return client.number in self._connected

    def wait(
        self, within_s: float, clock: Callable[[], float]
    ) -> list[Connection | str | None]:
        """Wait for data, `within_s` at most; rest for a moment first if there was no
        wait for long.

        Returns the clients and the companions that have sent something; None for
        clients that want to connect.
        """
        begun_s = clock()
        if begun_s - self._waited_s > WORK_S:
            sleep(REST_S)
            self._waited_s = begun_s = clock()

        ready = [key.data for key, _ in self.selector.select(within_s)]
        now_s = clock()
        if now_s - begun_s >= REST_S:
            self._waited_s = now_s

        return ready

    def accept(self, spared: Connection | None = None) -> list[Connection]:
        """Accept the clients that wait; return the ones that are still connected.
        `spared` keeps its place.
        """
        came = []
        freed = False

        for _ in range(ACCEPTED_PER_TURN):
            try:
                link, address = self._listener.accept()
            except OSError as fault:
                if (
                    fault.errno in (EMFILE, ENFILE)
                    and not freed
                    and self._free_descriptor(spared)
                ):
                    # once in a turn, so that a newcomer is heard before another
                    # replaces it
                    freed = True
                    continue

                break  # no client waits any more, or too many files are open

            if len(self._connected) >= self._settings.clients:
                self._make_room(spared)

            client = Connection(link, f"{address[0]}:{address[1]}", next(self._numbers))
            self._connected[client.number] = client
            self._guard.watch(client.number, client.fileno())
            self.selector.register(client, selectors.EVENT_READ, client)
            self._note(f"client {client.address} came")
            came.append(client)

        return [client for client in came if client in self]

    def _take_spare(self) -> None:
        """Reserve a descriptor for a client that comes when no other is free: it may be
        the operator.
        """
        with suppress(OSError):
            self._spare = (
                os.open(os.devnull, os.O_RDONLY | os.O_CLOEXEC)
                if self._spare is None
                else self._spare
            )

    def _free_descriptor(self, spared: Connection | None) -> bool:
        """Free a descriptor for a client that waits: the spare one, or that of one of
        the newest clients.
        """
        if not select([self._listener], [], [], 0.0)[
            0
        ]:  # accept says that none is free before it looks
            return False

        if self._spare is not None:
            os.close(self._spare)
            self._spare = None
            return True

        return self._make_room(spared)

    def _make_room(self, spared: Connection | None) -> bool:
        """Disconnect one of the newest clients; return whether there was one."""
        others = [client for client in self if client is not spared]
        for client in others[-max(1, min(CHANGING, len(others) // 8)) :][:1]:
            self.leave(
                client, "was disconnected: no place is free, and another client came"
            )
        return bool(others)

    def leave(self, client: Connection, why: str, *, discard: bool = False) -> None:
        """Disconnect a client, if it is still there; `discard` what has not arrived
        yet.
        """
        if self._connected.pop(client.number, None) is None:
            return
        self.selector.unregister(client)
        self._guard.forget(client.number)
        client.close(discard=discard)
        self._note(f"client {client.address} {why}")

    def speaks(self, client: Connection, version: int) -> None:
        """Note the header version of a client, in which it is answered."""
        if version != client.version:
            client.version = version
            self._guard.version(client.number, version)

    def send(self, client: Connection, outgoing: Outgoing, now_s: float) -> None:
        """Send messages to one client, if it is still there."""
        if client not in self:
            return
        try:
            client.send(outgoing.to(client.version), now_s)
        except OSError:
            self.leave(client, "has gone")

    def broadcast(self, outgoing: Outgoing, now_s: float) -> None:
        """Send messages to all clients."""
        for client in self:
            self.send(client, outgoing, now_s)

    def sweep(self, now_s: float, spared: Connection | None) -> list[str]:
        """Disconnect clients (except `spared`) that send or read too slowly; return the
        addresses of slow readers.
        """
        self._take_spare()
        message_s = self._settings.message_s
        stalled_s = self._settings.stalled_s
        slow = []

        for client in self:
            if (
                client.message_since_s is not None
                and now_s - client.message_since_s > message_s
            ):
                self.leave(
                    client,
                    "was disconnected: its message was not complete within"
                    f" {message_s:g} s",
                )

            if client is spared or client not in self:
                continue

            since_s = client.unread_since_s
            if since_s is not None and now_s - since_s > stalled_s:
                self.leave(
                    client,
                    f"was disconnected: messages to it waited for {stalled_s:g} s",
                    discard=True,
                )
                slow.append(client.address)

        return slow

    def close(self) -> None:
        """Disconnect all clients and stop listening."""
        for client in self:
            self.leave(client, "was disconnected: the monitor ends")
        if self._spare is not None:
            os.close(self._spare)
        self.selector.close()
        self._listener.close()
