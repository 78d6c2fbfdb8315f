"""The monitor's processes and their channels: messages, whole or not at all, without
waiting.
"""

import os
import signal
import socket
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from numbers import Integral, Real
from pathlib import Path
from select import select
from subprocess import DEVNULL, Popen, TimeoutExpired
from typing import Any, Self, TypeVar

import msgspec

from scleraforce.base.errors import MessageError, ScleraforceError
from scleraforce.base.worker_processes import one_thread
from scleraforce.live.companions.process_messages import (
    CompanionMessage,
    SelfReport,
    Settings,
)

BUFFER_BYTES = 4 * 1024 * 1024  # asked for; the system may give less
MESSAGE_BYTES = 128 * 1024  # more than any message needs
SETTINGS_S = 10.0  # within which a companion must get its settings
UNHEARD = (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM)

ChildSettings = TypeVar("ChildSettings", bound=Settings)


class ChannelClosedError(Exception):
    """The process at the other end has closed the channel, or has ended."""


def encode_message(message: CompanionMessage) -> bytes:
    """Return the bytes of a message (MessagePack); a MessageError names a value that no
    message may hold.
    """
    try:
        try:
            data = _ENCODER.encode(message)
        except UnicodeEncodeError:  # half a character, from a file name: it is escaped
            data = _ENCODER.encode(
                _escaped(
                    msgspec.to_builtins(
                        message, builtin_types=(bytes,), enc_hook=_plain
                    )
                )
            )
    except (msgspec.MsgspecError, TypeError, OverflowError) as fault:
        raise MessageError(f"{type(message).__name__}: {fault}") from fault

    _check_size(data)
    return data


def decode_message(data: bytes) -> CompanionMessage:
    """Return the message in bytes; raise MessageError unless they are one whole message
    with its fields.
    """
    _check_size(data)
    try:
        return _DECODER.decode(data)
    except (
        msgspec.MsgspecError,
        ValueError,
        TypeError,
        OverflowError,
        RecursionError,
        ScleraforceError,
    ) as fault:
        raise MessageError(
            f"not a message: {fault}"
        ) from fault  # records check their bounds by themselves


def _check_size(data: bytes) -> None:
    if len(data) > MESSAGE_BYTES:
        raise MessageError(f"a message of {len(data)} bytes; at most {MESSAGE_BYTES}")


def _plain(value: Any) -> bytes | float:
    """Return the bytes of a path; a number of Python for one of NumPy."""
    if isinstance(value, Path):
        return os.fsencode(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    raise TypeError(f"a {type(value).__name__}, which no message holds")


def _path(kind: type, value: Any) -> Path:
    if kind is Path and isinstance(value, bytes):
        return Path(os.fsdecode(value))
    raise TypeError(f"a {type(value).__name__} in place of a {kind.__name__}")


def _escaped(value: Any) -> Any:
    """Return a value with its halves of characters as backslash escapes."""
    if isinstance(value, str):
        return value.encode(errors="backslashreplace").decode()
    if isinstance(value, dict):
        return {key: _escaped(entry) for key, entry in value.items()}

    return (
        [_escaped(entry) for entry in value]
        if isinstance(value, (list, tuple))
        else value
    )


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_plain)
_DECODER: msgspec.msgpack.Decoder[CompanionMessage] = msgspec.msgpack.Decoder(
    CompanionMessage, dec_hook=_path
)


class Channel:
    """One end of a UNIX socket that keeps messages apart (SOCK_SEQPACKET, Linux),
    non-blocking at both ends.
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

    def fileno(self) -> int:
        """Return the file descriptor, for a selector."""
        return self._end.fileno()

    def send(self, message: CompanionMessage) -> bool:
        """Encode a message and send it; see `send_encoded`."""
        return self.send_encoded(encode_message(message))

    def send_encoded(self, data: bytes) -> bool:
        """Send a message; return False if the other end does not keep up and the
        message is lost.
        """
        try:
            self._end.send(data)
        except BlockingIOError:
            return False
        except OSError as fault:
            raise ChannelClosedError from fault

        return True

    def receive(self, most: int = 1000) -> list[CompanionMessage]:
        """Return the messages that wait, oldest first, `most` at most.

        Raise ChannelClosedError if the other end is closed and no message is left,
        MessageError if one of them is not a message; earlier ones are lost, later ones
        still wait.
        """
        messages: list[CompanionMessage] = []
        while len(messages) < most:
            try:
                # one that is larger is cut, and refused
                data = self._end.recv(MESSAGE_BYTES + 1)
            except BlockingIOError:
                break
            except ConnectionResetError:
                # raised once if the other end left messages unread; ours can still be
                # read
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


def start_companion(
    module: str, arguments: Sequence[str], descriptors: Sequence[int]
) -> Popen[bytes]:
    """Start `python -m MODULE ARGUMENTS` as a process that ends with the monitor, and
    not before.

    No terminal reaches it: it has a session of its own, the signals with which
    terminals and users end programs are blocked, and output to standard error is lost
    where it would block. It imports nothing from the current folder, which anybody may
    write to. It inherits the files of `descriptors`, under the same numbers.
    """
    command = [sys.executable, "-P", "-m", module, *arguments]
    errors = _errors_that_never_wait()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, UNHEARD)

    try:
        with one_thread():
            return Popen(
                command,
                stdin=DEVNULL,
                stdout=DEVNULL,
                stderr=errors,
                pass_fds=descriptors,
                start_new_session=True,
            )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        os.close(errors)


def _errors_that_never_wait() -> int:
    """Return a new, non-blocking descriptor of standard error; the old one, which other
    processes share, may block.
    """
    try:
        return os.open(
            "/proc/self/fd/2", os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_NOCTTY
        )
    except OSError:  # closed, a socket, another user's terminal
        return os.open(os.devnull, os.O_WRONLY)


class Child:
    """A process that runs a module: `python -m MODULE DESCRIPTOR`, the descriptor of
    its end of the channel.

    Its settings are the first message. It has to end when the channel closes. It
    inherits the files of `descriptors`, under the same numbers; descriptors in the
    settings must be among them.
    """

    def __init__(
        self, module: str, settings: Settings, descriptors: Sequence[int] = ()
    ) -> None:
        self.channel, theirs = Channel.pair()
        self.process = start_companion(
            module, [str(theirs.fileno())], [theirs.fileno(), *descriptors]
        )
        theirs.close()
        self.channel.send(settings)

    def end(self, within_s: float = 5.0) -> int:
        """Close the channel, wait until the process ends, or kill it after `within_s`;
        return its exit code.
        """
        self.channel.close()
        try:
            return self.process.wait(within_s)
        except TimeoutExpired:
            self.process.kill()
            return self.process.wait()


def run_companion(
    kind: type[ChildSettings], serve: Callable[[Channel, ChildSettings], None]
) -> None:
    """Run this child process: take its settings and serve until the channel closes;
    report a fault to the monitor.
    """
    with closing(Channel(socket.socket(fileno=int(sys.argv[1])))) as channel:
        messages = (
            channel.receive(1) if select([channel], [], [], SETTINGS_S)[0] else []
        )
        if not messages:
            raise RuntimeError(
                "no settings came: this module is started by `scleraforce monitor`"
            )

        settings = messages[0]
        if not isinstance(settings, kind):
            raise MessageError(
                f"a {type(settings).__name__} came; the first message must be a"
                f" {kind.__name__}"
            )

        try:
            serve(channel, settings)
        except ChannelClosedError:
            return
        except Exception as fault:
            channel.send(SelfReport(detail=f"{type(fault).__name__}: {fault}"))
            raise
