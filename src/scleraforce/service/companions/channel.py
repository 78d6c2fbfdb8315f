"""A two-way channel between two processes of the monitor: JSON messages, whole or not at all, without waiting."""

import json
import socket
from collections.abc import Mapping
from typing import Any, Self

__all__ = ["Channel", "ChannelClosedError"]

MESSAGE_BYTES = 128 * 1024  # more than any message needs
BUFFER_BYTES = 4 * 1024 * 1024  # asked for; the system may give less


class ChannelClosedError(Exception):
    """The process at the other end has closed the channel, or has ended."""


class Channel:
    """One end. A UNIX socket that keeps messages apart (SOCK_SEQPACKET, Linux), non-blocking at both ends.

    >>> ours, theirs = Channel.pair()
    >>> ours.send({"frame": 7})
    True
    >>> theirs.receive()
    [{'frame': 7}]
    >>> ours.close()
    >>> theirs.close()
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._end = end

    @classmethod
    def pair(cls) -> tuple[Self, Self]:
        """Return both ends of a new channel."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        return cls(ours), cls(theirs)

    @classmethod
    def inherited(cls, descriptor: int) -> Self:
        """Return the end that a process was given when it started."""
        return cls(socket.socket(fileno=descriptor))

    def fileno(self) -> int:
        """Return the file descriptor, for a selector."""
        return self._end.fileno()

    def send(self, message: Mapping[str, Any]) -> bool:
        """Send a message; False if the other end does not keep up and the message is lost.

        Raises:
            ChannelClosedError: the other end is closed.
            ValueError: the message is too large.
        """
        return self.send_text(json.dumps(message))

    def send_text(self, text: str) -> bool:
        """Send a JSON object that is text already; see `send`."""
        data = text.encode()
        if len(data) > MESSAGE_BYTES:
            raise ValueError(f"a message of {len(data)} bytes; the other end takes {MESSAGE_BYTES}")
        try:
            self._end.send(data)
        except BlockingIOError:
            return False
        except OSError as fault:
            raise ChannelClosedError from fault
        return True

    def receive(self, most: int = 1000) -> list[dict[str, Any]]:
        """Return the messages that wait, oldest first, `most` at most.

        Raises:
            ChannelClosedError: the other end is closed, and no message is left.
        """
        messages: list[dict[str, Any]] = []
        while len(messages) < most:
            try:
                data = self._end.recv(MESSAGE_BYTES)
            except BlockingIOError:
                break
            except ConnectionResetError:  # raised once if the other end left messages unread; ours can still be read
                continue
            except OSError:
                data = b""
            if not data:
                if messages:
                    break
                raise ChannelClosedError
            messages.append(json.loads(data))
        return messages

    def close(self) -> None:
        """Close this end; the other one notices."""
        self._end.close()
