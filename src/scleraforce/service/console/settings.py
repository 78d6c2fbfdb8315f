"""The settings that the monitor sends its console at the start."""

import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from scleraforce import __version__
from scleraforce.monitor import MonitorLimits
from scleraforce.service.companions.frame_ring import FrameRing, RingPlace
from scleraforce.service.reset_token import token_digest
from scleraforce.units import from_si


@dataclass(frozen=True, kw_only=True)
class ConsoleSettings:
    """Where to serve, where the frames are, and what a page needs from the start.

    Attributes:
        host: address that is listened on.
        listener: descriptor of the socket that listens there.
        token_digest: of the token of the operator's reset.
        ring: of the frames.
        pixel_mm: lateral and in depth.
        class_bounds_mn: between the classes of force.
        bound_mn: of the interval's upper end, where the robot withdraws.
        withdraw_class: from which on it does.
        silence_s: without a frame, after which it does.
        reads_force: False with a classifier.
        model: its name.
        eye: whose eye; "" where that is not said.
        version: of this package.
    """

    host: str
    listener: int
    token_digest: str
    ring: RingPlace
    pixel_mm: tuple[float, float]
    class_bounds_mn: tuple[float, ...]
    bound_mn: float
    withdraw_class: int
    silence_s: float
    reads_force: bool
    model: str
    eye: str
    version: str

    def for_page(self) -> dict[str, Any]:
        """Return the settings for the page, as a JSON object."""
        known = ("pixel_mm", "class_bounds_mn", "bound_mn", "withdraw_class", "silence_s", "reads_force")
        named = {name: getattr(self, name) for name in (*known, "model", "eye", "version")}
        return {**named, "rows": self.ring.rows, "columns": self.ring.columns}


def console_settings(
    *,
    host: str,
    listener: socket.socket,
    token: str,
    ring: FrameRing,
    lateral_m: float,
    depth_m: float,
    limits: MonitorLimits,
    class_bounds_n: Sequence[float],
    model: str,
    eye: str = "",
) -> ConsoleSettings:
    """Return the settings of the console's process, its first message.

    Args:
        host: address that is listened on.
        listener: the socket that listens there; its descriptor has to be inherited.
        token: of the operator's reset; the console is told its digest.
        ring: the frames; its descriptor has to be inherited.
        lateral_m: width of a pixel.
        depth_m: height of a pixel.
        limits: of the decision.
        class_bounds_n: between the classes of force.
        model: its name.
        eye: whose eye; "" where that is not said.
    """
    return ConsoleSettings(
        host=host,
        listener=listener.fileno(),
        token_digest=token_digest(token),
        ring=ring.place,
        pixel_mm=(from_si(lateral_m, "mm"), from_si(depth_m, "mm")),
        class_bounds_mn=tuple(from_si(bound_n, "mn") for bound_n in class_bounds_n),
        bound_mn=from_si(limits.bound_n, "mn"),
        withdraw_class=limits.withdraw_class,
        silence_s=limits.silence_s,
        reads_force=limits.reads_force,
        model=model,
        eye=eye,
        version=__version__,
    )
