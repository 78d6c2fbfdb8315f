"""What the monitor tells its watchdog: a frozen record for each message, one datagram each.

Of the standard library only: the watchdog starts before NumPy is loaded, and must not depend on it. It answers `ALIVE`
when it is ready and to each sign of life. A datagram is a letter and what follows it:

    M  version, space, the STATUS to send    C  client, whose socket comes with it    V  client, space, version
    D  client                                B  nothing                               Q  nothing
"""

import re
from dataclasses import dataclass

from scleraforce.errors import MessageError

ALIVE = b"A"
MOST_BYTES = 4096
FORM = re.compile(
    rb"M(?P<emergency>[123]) (?P<status>.{58,})|C(?P<came>\d{1,18})|V(?P<speaks>\d{1,18}) (?P<version>[123])"
    rb"|D(?P<left>\d{1,18})|(?P<beat>B)|(?P<end>Q)",
    re.DOTALL,
)  # 58 bytes: the header of any OpenIGTLink message


@dataclass(frozen=True, kw_only=True)
class Emergency:
    """The whole STATUS message for clients of a header version, 1 to 3."""

    version: int
    status: bytes


@dataclass(frozen=True, kw_only=True)
class ClientCame:
    """A client, whose socket is sent along."""

    client: int


@dataclass(frozen=True, kw_only=True)
class ClientSpeaks:
    """The header version that a client speaks, 1 to 3."""

    client: int
    version: int


@dataclass(frozen=True, kw_only=True)
class ClientLeft:
    """A client whose socket is to be closed."""

    client: int


@dataclass(frozen=True, kw_only=True)
class Beat:
    """A sign of life of the monitor."""


@dataclass(frozen=True, kw_only=True)
class PlannedEnd:
    """The monitor ends as planned."""


WatchdogMessage = Emergency | ClientCame | ClientSpeaks | ClientLeft | Beat | PlannedEnd


def pack_for_watchdog(message: WatchdogMessage) -> bytes:
    """Return the datagram of a message.

    Raises:
        MessageError: it would not be understood.

    >>> pack_for_watchdog(ClientSpeaks(client=7, version=2))
    b'V7 2'
    """
    match message:
        case Emergency(version=version, status=status):
            data = b"M%d " % version + status
        case ClientCame(client=client):
            data = b"C%d" % client
        case ClientSpeaks(client=client, version=version):
            data = b"V%d %d" % (client, version)
        case ClientLeft(client=client):
            data = b"D%d" % client
        case Beat():
            data = b"B"
        case PlannedEnd():
            data = b"Q"
    _parts(data)
    return data


def unpack_for_watchdog(data: bytes) -> WatchdogMessage:
    """Return the message of a datagram.

    Raises:
        MessageError: it is none.
    """
    parts = _parts(data)
    if parts["emergency"]:
        return Emergency(version=int(parts["emergency"]), status=parts["status"])
    if parts["came"]:
        return ClientCame(client=int(parts["came"]))
    if parts["speaks"]:
        return ClientSpeaks(client=int(parts["speaks"]), version=int(parts["version"]))
    if parts["left"]:
        return ClientLeft(client=int(parts["left"]))
    return Beat() if parts["beat"] else PlannedEnd()


def _parts(data: bytes) -> dict[str, bytes]:
    """Return the parts of a datagram by name; those of other messages are None."""
    found = FORM.fullmatch(data) if len(data) <= MOST_BYTES else None
    if found is None:
        raise MessageError(f"{data[:20]!r}, {len(data)} bytes: no message to the watchdog")
    return found.groupdict()
