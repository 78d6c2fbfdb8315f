"""A monitor as its console sees it: the other end of the channel, and a ring of
frames.
"""

import select
from time import monotonic, time
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from small_monitor import decision
from waiting import FUSE_S, wait_until

from scleraforce.live.companions.process_channel import Child
from scleraforce.live.companions.process_messages import (
    CompanionMessage,
    ConsoleSettings,
    Decided,
    ListensAt,
    Rates,
)
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.console.server import OwnPagesOnly
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.monitor import listen
from scleraforce.live.network.operator_reset import token_digest
from scleraforce.records.remark import Remark
from scleraforce.records.scan import PixelScale

TOKEN = "seven of nine"

CODES = {"NOT_READY": 13, "WATCHING": 1, "WITHDRAW": 3}
CLIENTS = (
    {"address": "127.0.0.1:50112", "role": "scanner"},
    {"address": "127.0.0.1:50114", "role": "listener"},
)
Kind = TypeVar("Kind")


def reading(force_mn: float, width_mn: float = 2.0) -> dict[str, Any]:
    """Return the entry's verdict on a frame."""
    predicted = int(force_mn > 5) + int(force_mn > 30)
    shares = [0.02, 0.02, 0.02]
    shares[predicted] = 0.96
    interval = (force_mn - width_mn, force_mn + width_mn)

    return {
        "predicted": predicted,
        "probabilities": tuple(shares),
        "force_mn": force_mn,
        "interval_mn": interval,
        "usable": True,
        "latency_ms": 1.1,
    }


class ConsoleMonitor:
    """Starts a console and talks to it; `with` ends it."""

    def __init__(
        self,
        port: int = 0,
        rows: int = 64,
        columns: int = 96,
        remarks: tuple[Remark, ...] = (),
        **limits: Any,
    ) -> None:
        self.ring = FrameRing.create(64, rows, columns)
        listener = listen("127.0.0.1", port)
        self.port = int(listener.getsockname()[1])
        settings = ConsoleSettings(
            host="127.0.0.1",
            listener=listener.fileno(),
            token_digest=token_digest(TOKEN),
            ring=self.ring.place,
            scale=PixelScale(lateral_m=15e-3 / columns, depth_m=4e-3 / rows),
            limits=MonitorLimits(**limits),
            class_bounds_n=(5e-3, 30e-3),
            model="reader",
            eye="eye-a",
            remarks=remarks,
        )
        descriptors = [self.ring.place.descriptor, listener.fileno()]
        self.child = Child(OwnPagesOnly.__module__, settings, descriptors)
        listener.close()
        self.entries = self.frames = 0

        try:
            assert self.hear(ListensAt).url == self.address
        except AssertionError:
            self.child.end()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.child.end()

    @property
    def address(self) -> str:
        """The page's address."""
        return f"http://127.0.0.1:{self.port}/"

    def hear(self, kind: type[Kind], within_s: float = FUSE_S) -> Kind:
        """Wait for a message of the console."""
        if not select.select([self.child.channel], [], [], within_s)[0]:
            raise AssertionError(
                f"the console said nothing, {kind.__name__} was awaited; exit code "
                f"{self.child.process.poll()}"
            )

        (message,) = self.child.channel.receive(1)
        assert isinstance(message, kind), message
        return message

    def tell(self, message: CompanionMessage) -> None:
        """Send a message; wait where a console that got no processor has not read those
        before it.
        """
        wait_until(lambda: self.child.channel.send(message))

    def entry(
        self, state: str, message: str = "", cause: str | None = None, **said: Any
    ) -> None:
        """Tell a decision."""
        self.entries += 1
        if cause is not None:
            said = {
                "present_cause": cause,
                "present": message.partition("; ")[0],
                "withdrawn_s": time(),
                **said,
            }

        entry = decision(
            state,
            number=self.entries,
            time_s=time(),
            at_s=monotonic(),
            event="frame" if "frame" in said else "tick",
            code=CODES[state],
            cause=cause,
            message=f"{state}: {message}" if message else state,
            **said,
        )
        self.tell(Decided(entry=entry))

    def frame(
        self,
        pixels: NDArray[np.uint16],
        state: str = "WATCHING",
        message: str = "",
        **said: Any,
    ) -> int:
        """Put a frame into the ring and tell the decision on it; return its number."""
        self.frames += 1
        self.ring.put(self.frames, pixels)
        self.entry(state, message, frame=self.frames, frame_id=self.frames, **said)
        return self.frames

    def rates(self, **changed: Any) -> None:
        """Tell the rates."""
        self.tell(
            Rates(
                **{"frames_per_second": 100.0, "lost": 0, "clients": CLIENTS, **changed}
            )
        )
