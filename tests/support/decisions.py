"""Decisions of a monitor, as they are sent, logged and shown."""

from dataclasses import replace
from typing import Any

from scleraforce.service.entry import Entry

__all__ = ["READ_ENTRY", "TICK_ENTRY", "decision"]

TICK_ENTRY = Entry(
    number=1, time_s=1.8e9, at_s=12.5, event="tick", state="NOT_READY", code=13, sub_code=0, cause=None,
    message="no good frame yet",
)  # fmt: skip
READ_ENTRY = Entry(
    number=3, time_s=1.8e9, at_s=12.5, event="frame", state="WATCHING", code=1, sub_code=0, cause=None,
    message="OK:\n“12 mN”", frame=3, frame_id=77, predicted=1, probabilities=(0.0, 0.75, 0.25), force_mn=12.5,
    interval_mn=(11.0, 13.5), usable=True, reason=None, latency_ms=0.75, lost=2,
)  # fmt: skip


def decision(state: str = "WATCHING", **said: Any) -> Entry:
    """A decision that says nothing of a frame but what is told; `said` are the entry's attributes."""
    return replace(TICK_ENTRY, **{"event": "frame", "state": state, "code": 1, "message": "x", **said})
