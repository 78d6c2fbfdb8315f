"""The processes that the monitor starts: modules with a channel to it."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from select import select
from typing import TypeVar

from scleraforce.errors import MessageError
from scleraforce.processes import one_thread
from scleraforce.service.companions.channel import Channel
from scleraforce.service.companions.messages import Settings

ChildSettings = TypeVar("ChildSettings", bound=Settings)

UNHEARD = (signal.SIGINT, signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM)


def start_companion(module: str, arguments: Sequence[str], descriptors: Sequence[int]) -> subprocess.Popen[bytes]:
    """Start `python -m MODULE ARGUMENTS` as a process that ends with the monitor, and not before.

    No terminal reaches it: it has a session of its own, the signals with which terminals and users end programs are
    blocked, and output to standard error is lost where it would block. It imports nothing from the current folder,
    which anybody may write to.

    Args:
        module: its full name.
        arguments: of its command line.
        descriptors: of files that it inherits, under the same numbers.
    """
    command = [sys.executable, "-P", "-m", module, *arguments]
    errors = _errors_that_never_wait()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, UNHEARD)
    try:
        with one_thread():
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                pass_fds=descriptors,
                start_new_session=True,
            )
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        os.close(errors)


def _errors_that_never_wait() -> int:
    """Return a new, non-blocking descriptor of standard error; the old one, which other processes share, may block."""
    try:
        return os.open("/proc/self/fd/2", os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_NOCTTY)
    except OSError:  # closed, a socket, another user's terminal
        return os.open(os.devnull, os.O_WRONLY)


class Child:
    """A process that runs a module: `python -m MODULE DESCRIPTOR`, the descriptor of its end of the channel.

    Its settings are the first message. It has to end when the channel closes.

    Args:
        module: its full name.
        settings: the first message; descriptors in it must be among `descriptors`.
        descriptors: of files that it inherits, under the same numbers.
    """

    def __init__(self, module: str, settings: Settings, descriptors: Sequence[int] = ()) -> None:
        self.channel, theirs = Channel.pair()
        self._process = start_companion(module, [str(theirs.fileno())], [theirs.fileno(), *descriptors])
        theirs.close()
        self.channel.send(settings)

    @property
    def pid(self) -> int:
        """Id of the process."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Return its exit code; None while it runs."""
        return self._process.poll()

    def end(self, within_s: float = 5.0) -> int:
        """Close the channel, wait until the process ends, or kill it after `within_s`; return its exit code."""
        self.channel.close()
        try:
            return self._process.wait(within_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


def settings_of_child(
    arguments: Sequence[str], kind: type[ChildSettings], within_s: float = 10.0
) -> tuple[Channel, ChildSettings]:
    """Return the channel and the settings of this child process, from its command line.

    Raises:
        ChannelClosedError: the monitor has ended already.
        MessageError: what came are not settings of this kind.
        RuntimeError: no settings came.
    """
    channel = Channel.inherited(int(arguments[1]))
    try:
        messages = channel.receive(1) if select([channel], [], [], within_s)[0] else []
        if not messages:
            raise RuntimeError("no settings came: this module is started by `scleraforce monitor`")
        settings = messages[0]
        if not isinstance(settings, kind):
            raise MessageError(f"a {type(settings).__name__} came; the first message must be a {kind.__name__}")
    except BaseException:
        channel.close()
        raise
    return channel, settings
