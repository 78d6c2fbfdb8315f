"""A scanner's connection whose time passes only while it waits: no socket, no thread, no machine that is busy."""

from collections.abc import Callable

from fake_monitor import HEARTBEAT_S, STATUS, MonitorRule

from scleraforce.errors import LinkError
from scleraforce.openigtlink import Decoder, Message

__all__ = ["ClockedClient"]


class ClockedClient:
    """In place of a `ScannerClient`, beside a monitor that answers at once; a second is one that a test waits for.

    Attributes:
        now_s: the time; a test may move it on.
        dropped: True: the monitor closes the connection.
    """

    address = "clocked"

    def __init__(self, monitor: MonitorRule, hear: Callable[[float, str, Message], object]) -> None:
        self.monitor, self._hear, self._decoder = monitor, hear, Decoder()
        self.now_s, self.dropped = 1000.0, False
        self._beat_s, self._scans = self.now_s, True
        self._said: list[tuple[str, Message]] = []

    def clock(self) -> float:
        return self.now_s

    def send(self, data: bytes | bytearray) -> float:
        if not self._scans:
            raise LinkError(f"{self.address}: the monitor has closed the connection")
        for event in self._decoder.feed(bytes(data)):
            self._say(event)
        if self._decoder.broken:
            self.disconnect()
        return self.now_s

    def listen(self, until_s: float, done: Callable[[], bool] = lambda: False) -> None:
        self._beat()
        while not done() and self.now_s < until_s:
            self.now_s = min(until_s, self._beat_s)
            self._beat()

    def disconnect(self) -> None:
        if self._scans:
            self._scans = False
            self._say(None)

    def close(self) -> None:
        self._scans = False

    def _say(self, event: object) -> None:
        said = self.monitor.take(event)
        self._said += said if self.monitor.answers else []

    def _beat(self) -> None:
        """Say the heartbeats that are due, and hear what was said."""
        while self._beat_s <= self.now_s:
            self._said += [(STATUS, self.monitor.status)] if self.monitor.answers else []
            self._beat_s += HEARTBEAT_S
        if self.dropped:
            raise LinkError(f"{self.address}: the connection is lost: it was closed")
        said, self._said = self._said, []
        for device, message in said:
            self._hear(self.now_s, device, message)
