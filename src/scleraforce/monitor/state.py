"""What the monitor remembers between two events."""

from dataclasses import dataclass

from scleraforce.monitor.causes import Cause
from scleraforce.monitor.events import FrameRead, SecondOpinion
from scleraforce.monitor.transitions import State

__all__ = ["MonitorState"]


@dataclass(frozen=True)
class MonitorState:
    """All that the monitor remembers; a few hundred numbers at most, whatever it has met.

    `cause` and `reason` are those of the first cause of a withdrawal, kept until the reset. `history` has (time, force)
    of the last frames whose numbers are sound, `losses` (time, frames) of those lost within the window, `lost` all that
    were lost since the start, `lost_in_row` those since the last frame. `fresh` counts the harmless frames in a row.
    `touched` is True after contact, `clear_s` the time of the first of the last frames in a row that are clear of it.
    `opinion` is the last second opinion since the last cause, `doubted` counts those in a row that could not judge,
    `unanswered` has (frame, time) of frames that got none yet, oldest first, thinned where they are many.
    """

    state: State = State.NOT_READY
    cause: Cause | None = None
    reason: str = "no good frame yet"
    at_s: float | None = None
    frame: FrameRead | None = None
    size: tuple[int, int] | None = None
    scale_m: tuple[float, float] | None = None
    repeats: int = 0
    touched: bool = False
    clear_s: float | None = None
    unusable: int = 0
    history: tuple[tuple[float, float], ...] = ()
    losses: tuple[tuple[float, int], ...] = ()
    lost: int = 0
    lost_in_row: int = 0
    fresh: int = 0
    opinion: SecondOpinion | None = None
    doubted: int = 0
    unanswered: tuple[tuple[int, float], ...] = ()
