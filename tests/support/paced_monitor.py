"""The command `monitor` on the time of its frames: each moment's come `FRAME_S` after
those before, and the second opinion on a frame before the next one is heard.

Its limits are those of the command, and no busy machine keeps it from them. Processes
that a busy machine may delay are not missed: the watchdog, the black box.
"""

from collections.abc import Iterator
from select import select
from typing import Any

from small_monitor import TurnedClock
from waiting import FUSE_S

from scleraforce.front.cli.main import main
from scleraforce.live import monitor
from scleraforce.live.companions import companion_processes
from scleraforce.live.companions.companion_processes import OPINION, Companions, Guard
from scleraforce.live.companions.process_messages import (
    CompanionMessage,
    OpinionAsked,
    OpinionGiven,
)
from scleraforce.live.monitor_server import MonitorServer
from scleraforce.live.monitor_session import MonitorSession, ReceivedFrame
from scleraforce.live.network.scanner_frame import ScannerFrame

FRAME_S = 0.04
PLANE_S = 0.001  # from one plane of a moment to the next
CLOCK = TurnedClock()


class PacedSession(MonitorSession):
    """Time passes between frames, and at no other time; headers do not count."""

    def __init__(self, *given: Any, **named: Any) -> None:
        super().__init__(*given, clock=CLOCK, wall_clock=CLOCK, **named)

    def frame(
        self,
        image: ScannerFrame,
        sender_id: int,
        sender: int,
        _at_s: float,
        _sent_s: float | None = None,
        plane: str | None = None,
    ) -> ReceivedFrame:
        is_next_moment = plane is None or plane == self.planes[0]
        CLOCK.turn(FRAME_S if is_next_moment else PLANE_S)
        return super().frame(image, sender_id, sender, CLOCK(), None, plane)


class PacedCompanions(Companions):
    """Counts the opinions that are asked for and have not been heard."""

    awaited = 0

    def send(self, name: str, message: CompanionMessage, now_s: float) -> bool:
        taken = super().send(name, message, now_s)
        if taken and isinstance(message, OpinionAsked):
            self.awaited += max(len(message.planes), 1)
        return taken

    def hear(self, name: str, now_s: float) -> Iterator[CompanionMessage]:
        for message in super().hear(name, now_s):
            self.awaited -= isinstance(message, OpinionGiven)
            yield message


class PacedServer(MonitorServer):
    """The opinions on a frame are heard right after its reading was sent."""

    def _take_frame(self, frame: ReceivedFrame) -> None:
        super()._take_frame(frame)
        while self._companions.awaited and not self._companions.dead(OPINION):
            select([self._companions.channel(OPINION)], [], [])
            self._hear_companion(OPINION)


companion_processes.STARTS_S = companion_processes.SILENT_S = (
    companion_processes.KEEPS_UP_S
) = float("inf")
monitor.MonitorSession = PacedSession
monitor.Companions = PacedCompanions
monitor.MonitorServer = PacedServer
monitor.Guard = lambda: Guard(FUSE_S)

if __name__ == "__main__":
    main()
