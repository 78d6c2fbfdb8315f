"""A two-way channel between two processes of the monitor: messages, whole or not at all, without waiting."""

import socket
from typing import Self

from scleraforce.service.companions.codec import MESSAGE_BYTES, decode_message, encode_message
from scleraforce.service.companions.messages import CompanionMessage

BUFFER_BYTES = 4 * 1024 * 1024  # asked for; the system may give less


class ChannelClosedError(Exception):
    """The process at the other end has closed the channel, or has ended."""


class Channel:
    """One end. A UNIX socket that keeps messages apart (SOCK_SEQPACKET, Linux), non-blocking at both ends.

    >>> ours, theirs = Channel.pair()
    >>> from scleraforce.service.companions.messages import OpinionAsked
    >>> ours.send(OpinionAsked(number=7, order=71))
    True
    >>> theirs.receive()
    [OpinionAsked(number=7, order=71)]
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

    def send(self, message: CompanionMessage) -> bool:
        """Send a message; False if the other end does not keep up and the message is lost.

        Raises:
            ChannelClosedError: the other end is closed.
            MessageError: the message holds what it may not, or is too large.
        """
        return self.send_encoded(encode_message(message))

    def send_encoded(self, data: bytes) -> bool:
        """Send a message that is encoded already; see `send`."""
        try:
            self._end.send(data)
        except BlockingIOError:
            return False
        except OSError as fault:
            raise ChannelClosedError from fault
        return True

    def receive(self, most: int = 1000) -> list[CompanionMessage]:
        """Return the messages that wait, oldest first, `most` at most.

        Raises:
            ChannelClosedError: the other end is closed, and no message is left.
            MessageError: one of them is no message; those before it are lost, those after it still wait.
        """
        messages: list[CompanionMessage] = []
        while len(messages) < most:
            try:
                data = self._end.recv(MESSAGE_BYTES + 1)  # one that is larger is cut, and refused
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
            messages.append(decode_message(data))
        return messages

    def close(self) -> None:
        """Close this end; the other one notices."""
        self._end.close()
