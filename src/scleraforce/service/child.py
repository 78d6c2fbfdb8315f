"""The processes that the monitor starts beside itself: modules with a channel to it."""

import subprocess
import sys
from collections.abc import Mapping, Sequence
from select import select
from typing import Any

from scleraforce.processes import no_interrupts, one_thread
from scleraforce.service.channel import Channel

__all__ = ["Child", "settings_of_child"]


class Child:
    """A process that runs a module: `python -m MODULE DESCRIPTOR`, the descriptor of its end of the channel.

    The first message that it gets are its settings. It does not see Ctrl-C; it has to end when the channel closes.

    Args:
        module: its full name.
        settings: the first message; descriptors in it are to be among `descriptors`.
        descriptors: of files that it inherits, under the same numbers.
    """

    def __init__(self, module: str, settings: Mapping[str, Any], descriptors: Sequence[int] = ()) -> None:
        self.channel, theirs = Channel.pair()
        with one_thread(), no_interrupts():
            self._process = subprocess.Popen(
                [sys.executable, "-m", module, str(theirs.fileno())], pass_fds=(theirs.fileno(), *descriptors)
            )
        theirs.close()
        self.channel.send(settings)

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Return how it ended; None while it runs."""
        return self._process.poll()

    def end(self, within_s: float = 5.0) -> int:
        """Close the channel, wait until the process ends, kill it where it does not; return its exit code."""
        self.channel.close()
        try:
            return self._process.wait(within_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()


def settings_of_child(arguments: Sequence[str], within_s: float = 10.0) -> tuple[Channel, dict[str, Any]]:
    """Return the channel and the settings of the child that is running, from its command line.

    Raises:
        ChannelClosedError: whoever started it has gone already.
        RuntimeError: nobody sends settings.
    """
    channel = Channel.inherited(int(arguments[1]))
    try:
        settings = channel.receive(1) if select([channel], [], [], within_s)[0] else []
        if not settings:
            raise RuntimeError("no settings came: this module is started by `scleraforce monitor`")
    except BaseException:
        channel.close()
        raise
    return channel, settings[0]
