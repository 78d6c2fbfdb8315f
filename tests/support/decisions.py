"""Decisions of a monitor, as they are sent, logged and shown."""

from dataclasses import replace
from typing import Any

from scleraforce.monitor.events import Verdict
from scleraforce.service.entry import Entry
from scleraforce.units import to_si

__all__ = ["READ_ENTRY", "TICK_ENTRY", "decision", "verdict"]


def verdict(
    force_mn: float | None = None, interval_mn: tuple[float, float] | None = None, predicted: int = 1, **said: Any
) -> Verdict:
    """A usable verdict with a force in mN; `said` are other attributes."""
    others: dict[str, Any] = {"probabilities": (0.0, 0.75, 0.25), "usable": True, "reason": None, **said}
    force_n = None if force_mn is None else to_si(force_mn, "mn")
    interval_n = interval_mn and (to_si(interval_mn[0], "mn"), to_si(interval_mn[1], "mn"))
    return Verdict(predicted=predicted, force_n=force_n, interval_n=interval_n, **others)


TICK_ENTRY = Entry(
    number=1, time_s=1.8e9, at_s=12.5, event="tick", state="NOT_READY", code=13, sub_code=0, cause=None,
    message="no good frame yet",
)  # fmt: skip
READ_ENTRY = Entry(
    number=3, time_s=1.8e9, at_s=12.5, event="frame", state="WATCHING", code=1, sub_code=0, cause=None,
    message="OK:\n“12 mN”", frame=3, frame_id=77, verdict=verdict(12.5, (11.0, 13.5)), latency_ms=0.75, lost=2,
)  # fmt: skip
OF_VERDICT = ("force_mn", "interval_mn", "predicted", "probabilities", "usable", "reason")


def decision(state: str = "WATCHING", **said: Any) -> Entry:
    """A decision; `said` are attributes of the entry and of its verdict, which exists if one of its own is given."""
    read = {name: said.pop(name) for name in OF_VERDICT if name in said}
    others = {"event": "frame", "state": state, "code": 1, "message": "x", **said}
    return replace(TICK_ENTRY, verdict=verdict(**read) if read else None, **others)
