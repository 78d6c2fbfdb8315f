"""The black box: a process that logs every decision and keeps the frames of withdrawals or of the session (Linux).

One thread writes one frame at a time, always the oldest one that is wanted, and listens to the monitor in between.
Other threads only wait for the disk. docs/black_box.md describes what is written, and what happens when it cannot be.
"""

import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from select import select
from typing import Any

from scleraforce import __version__
from scleraforce.recording.info import ForceInfo, RecordingInfo
from scleraforce.service.black_box.decision_log import DecisionLog, format_line
from scleraforce.service.black_box.kept_frames import FrameTaker, TakenFrame
from scleraforce.service.black_box.kept_withdrawal import KeptWithdrawal
from scleraforce.service.black_box.recent import Recent
from scleraforce.service.black_box.robot_force import RobotForce
from scleraforce.service.black_box.session_recording import SessionRecording
from scleraforce.service.companions.channel import Channel, ChannelClosedError
from scleraforce.service.companions.child import settings_of_child
from scleraforce.service.companions.frame_ring import FrameRing
from scleraforce.study.toml import format_record, parse_record

__all__ = ["BlackBox", "black_box_settings", "main"]

NICENESS = 5
ALIVE_S = 0.5
POLL_S = 0.02
CHECK_S = 1.0
LEAST_FREE_BYTES = 10**9
FORCE = ForceInfo("fz", 1, 0.2)  # the needle moves, so labels average over a short time


def black_box_settings(
    folder: Path, ring: FrameRing, info: RecordingInfo, record: Path | None = None, keep_s: float = 10.0
) -> dict[str, Any]:
    """Return the settings of the black box, for `Child("scleraforce.service.black_box.process", settings, ...)`.

    Args:
        folder: of the log and of the withdrawals; created if it is missing.
        ring: of the frames; longer than `keep_s`, or the oldest frames are overwritten before they are kept.
        info: contents of each recording.toml. Without `force`, a robot's force is the axis fz, positive in contact,
            and labels average over 0.2 s.
        record: folder for a recording of the whole session; must not exist. None: only withdrawals are kept.
        keep_s: duration that is kept at a withdrawal.
    """
    if (info.oct.rows, info.oct.columns) != ring.shape:
        raise ValueError(f"info.oct: {info.oct.rows} x {info.oct.columns} pixels; the ring has {ring.shape}")
    return {
        "folder": str(folder.absolute()),
        "ring": ring.settings(),
        "info": format_record(replace(info, force=info.force or FORCE)),
        "record": None if record is None else str(record.absolute()),
        "keep_s": keep_s,
    }


class BlackBox:
    """Acts on the monitor's messages; `turn` is one round of its work.

    Args:
        channel: to the monitor.
        settings: of `black_box_settings`.

    Raises:
        OSError: the log cannot be written.
    """

    def __init__(self, channel: Channel, settings: dict[str, Any]) -> None:
        self.ended = False
        self._channel, self._keep_s = channel, float(settings["keep_s"])
        self._folder = Path(settings["folder"])
        self._ring = FrameRing(**settings["ring"])
        self._info = parse_record(RecordingInfo, settings["info"], "settings")
        self._log = DecisionLog(self._folder / "log")
        self._threads = ThreadPoolExecutor(2, thread_name_prefix="disk")
        self._sync: Future[None] | None = None
        self._force = RobotForce(self._info.force or FORCE)
        self._start_s: float | None = None
        self._comment = ""
        self._recent = Recent(self._keep_s, self._ring.frames)
        self._entry: dict[str, Any] | None = None
        self._withdrawal: KeptWithdrawal | None = None
        self._finishing: Future[str | None] | None = None
        self._finish_s = 0.0
        self._wanted: tuple[str, dict[str, Any]] | None = None
        self._lost_told = 0
        self._faults: dict[str, str] = {}
        self._alive_s = self._check_s = 0.0
        self._record = None if settings["record"] is None else Path(settings["record"])
        self._session: SessionRecording | None = None

    def run(self) -> None:
        """Work until the monitor has ended and all is written."""
        while not (self.ended and self._next_taker() is None and self._withdrawal is None):
            self.turn()
        self._end_session()
        self._threads.shutdown()
        self._log.close()

    def turn(self) -> None:
        """Listen to the monitor, write one frame, give a sign of life when due; wait if there is nothing to do."""
        self._hear(0.0 if self._next_taker() else self._pause_s())
        self._write_one()
        self._finish_withdrawal()
        now_s = time.monotonic()
        if now_s >= self._alive_s:
            self._alive_s = now_s + ALIVE_S
            self._tell({"kind": "alive", "faults": list(self._faults.values())})
        if now_s >= self._check_s:
            self._check_s = now_s + CHECK_S
            self._check_disk()

    def _pause_s(self) -> float:
        due_s = min(self._alive_s, self._check_s) - time.monotonic()
        return max(0.0, min(due_s, POLL_S) if self._withdrawal else due_s)

    def _hear(self, pause_s: float) -> None:
        if self.ended:
            time.sleep(min(pause_s, POLL_S))
            return
        select([self._channel], [], [], pause_s)
        try:
            for message in self._channel.receive(100):
                self._take(message)
        except ChannelClosedError:
            if not self.ended:
                self._note("the monitor ended without notice")
                if self._entry is not None:
                    self._keep("monitor_died", self._entry)
            self.ended = True

    def _take(self, message: dict[str, Any]) -> None:
        match message["kind"]:
            case "entry":
                self._take_entry(message["entry"])
            case "force":
                self._take_force(message)
            case "note":
                self._append(message)
            case "end":
                self.ended = True

    def _take_entry(self, entry: dict[str, Any]) -> None:
        before, self._entry = self._entry, entry
        at_s = float(entry["at_s"])
        if before and entry["number"] != before["number"] + 1:
            self._note(f"decisions {before['number'] + 1} to {entry['number'] - 1} never arrived")
        self._recent.add_line(at_s, self._append({"kind": "entry", "entry": entry}))
        start_s = self._begin(at_s, float(entry["time_s"]))
        if entry["frame"] is not None and self._recent.add_frame(at_s, entry["frame"]) and self._session:
            self._session.taker.add(TakenFrame(entry["frame"], at_s - start_s))
        if entry["state"] == "WITHDRAW" and (before is None or before["state"] != "WITHDRAW"):
            self._keep(str(entry["cause"]).lower(), entry)

    def _take_force(self, message: dict[str, Any]) -> None:
        at_s = float(message["at_s"])
        start_s = self._begin(at_s, float(message["time_s"]))
        refused = self._force.refused
        sample = self._force.add(at_s, message["values"], str(message.get("device")))
        if self._force.refused > refused == 0:
            self._note(f"a force of {message.get('device')} is not kept: {message['values']}; so are others like it")
        if sample and self._session:
            self._guarded("session", self._session.add_force, self._force.columns, sample, start_s)

    def _begin(self, at_s: float, time_s: float) -> float:
        """Return time 0 of the session's recordings, on the monotonic clock; the first message starts them."""
        if self._start_s is None:
            self._start_s = at_s
            began = datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds")
            self._comment = f"Of a session of scleraforce {__version__}, research use only; time 0 is {began}."
            if self._record and self._room("session"):
                self._session = self._guarded(
                    "session", SessionRecording, self._record, self._info, self._comment, self._ring
                )
        return self._start_s

    def _keep(self, cause: str, entry: dict[str, Any]) -> None:
        """Keep the seconds up to an entry; while others are being written, only the latest request waits."""
        self._check_s = 0.0  # the log goes to the disk now
        if self._withdrawal is not None:
            if self._wanted:
                self._note(f"the seconds up to {self._wanted[0]} are not kept: more happened while others were written")
            self._wanted = cause, entry
            return
        self._wanted = None
        if not self._room("withdrawal"):
            return
        at_s = float(entry["at_s"])
        frames, lines = self._recent.until(at_s)
        start_s = self._begin(at_s, float(entry["time_s"]))
        stamp = datetime.fromtimestamp(float(entry["time_s"]), UTC).strftime("%Y%m%dT%H%M%S.%f")[:-3]
        self._withdrawal = self._guarded(
            "withdrawal",
            KeptWithdrawal,
            self._folder / "withdrawals" / f"{stamp}Z-{cause}",
            self._info,
            f"{self._comment} Kept: {cause}.",
            self._ring,
            [TakenFrame(number, frame_s - start_s) for frame_s, number in frames],
            b"".join(lines),
        )
        # Labels of the last frames average over what comes after them.
        self._finish_s = time.monotonic() + (self._info.force or FORCE).average_s

    def _next_taker(self) -> FrameTaker | None:
        """Return the taker of the oldest frame that waits, which is overwritten first."""
        takers = [owner.taker for owner in (self._withdrawal, self._session) if owner and owner.taker.next is not None]
        return min(takers, key=lambda taker: taker.next or 0, default=None)

    def _write_one(self) -> None:
        taker = self._next_taker()
        if taker is None:
            return
        of_session = self._session is not None and taker is self._session.taker
        if of_session and not self._room("session"):
            self._end_session()
            return
        self._guarded("session" if of_session else "withdrawal", taker.take)
        if of_session and taker.lost > self._lost_told:
            if not self._lost_told:
                self._note(f"{self._record}: the disk does not keep up: frames are lost")
            self._lost_told = taker.lost

    def _finish_withdrawal(self) -> None:
        """When a withdrawal's frames are written, write the rest in a thread; tell the monitor when it is complete."""
        kept = self._withdrawal
        if kept is None or kept.taker.next is not None:
            return
        if self._finishing is None:
            if time.monotonic() < self._finish_s and not self.ended and self._force.columns:
                return
            forces = self._force.columns, tuple(self._force.samples), self._start_s or 0.0
            self._finishing = self._threads.submit(kept.finish, *forces)
        if not self._finishing.done():
            return
        try:
            reason = self._finishing.result()
            self._note(f"kept {kept.taker.written} frames in {kept.folder}; {kept.taker.lost} were lost")
            if reason:
                self._note(f"{kept.folder}: the robot's force gives no labels: {reason}")
            self._tell({"kind": "kept", "folder": str(kept.folder)})
        except OSError as fault:
            kept.remove()
            self._fault("withdrawal", fault)
        self._withdrawal = self._finishing = None
        if self._wanted:
            self._keep(*self._wanted)

    def _end_session(self) -> None:
        if self._session is None:
            return
        session, self._session = self._session, None
        self._guarded("session", session.close)
        self._note(f"recorded {session.taker.written} frames in {session.folder}; {session.taker.lost} were lost")

    def _check_disk(self) -> None:
        """Sync the log in a thread, and check the result of the last sync."""
        if self._room("disk"):
            self._faults.pop("withdrawal", None)  # the next one can be kept
        if self._sync is not None:
            if not self._sync.done():
                return
            if (fault := self._sync.exception()) is not None:
                self._fault("log on disk", fault)
            else:
                self._faults.pop("log on disk", None)
        self._sync = self._threads.submit(self._log.sync)

    def _room(self, what: str) -> bool:
        """Return whether the disk has enough space; if not, tell the monitor once."""
        place = self._record if what == "session" and self._record else self._folder
        place = next(folder for folder in (place, *place.parents) if folder.exists())
        try:
            free_bytes = shutil.disk_usage(place).free
        except OSError as fault:
            self._fault(what, fault)
            return False
        if free_bytes < LEAST_FREE_BYTES:
            self._fault(what, OSError(f"{place}: {free_bytes / 1e9:.2f} GB free; below 1 GB nothing is kept"))
            return False
        self._faults.pop(what, None)
        return True

    def _append(self, record: dict[str, Any]) -> bytes:
        try:
            line = self._log.append(record)
        except OSError as fault:
            self._fault("log", fault)
            return format_line(record)
        self._faults.pop("log", None)
        return line

    def _note(self, text: str) -> None:
        self._append({"kind": "note", "time_s": time.time(), "text": text})

    def _guarded(self, what: str, do: Callable[..., Any], *arguments: Any) -> Any:
        """Call `do`; if the disk fails, tell the monitor, end a session's recording, and return None."""
        try:
            return do(*arguments)
        except OSError as fault:
            self._fault(what, fault)
            if what == "session":
                self._end_session()
            return None

    def _fault(self, what: str, fault: BaseException) -> None:
        """Tell the monitor what is not kept; once, until it is kept again."""
        if what in self._faults:
            return
        self._faults[what] = detail = f"{what}: {fault}"
        if not what.startswith("log"):
            self._note(detail)
        self._tell({"kind": "fault", "detail": detail})

    def _tell(self, message: dict[str, Any]) -> None:
        with suppress(ChannelClosedError):  # `_hear` notices it
            self._channel.send(message)


def main(arguments: Sequence[str]) -> None:
    """Run the black box of the monitor that started this process, until the monitor ends."""
    os.nice(NICENESS)
    os.umask(0o077)  # recordings are of a patient: readable by the owner only
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # it ends with the monitor, and not before
    channel, settings = settings_of_child(arguments)
    try:
        BlackBox(channel, settings).run()
    except Exception as fault:
        channel.send({"kind": "fault", "detail": f"{type(fault).__name__}: {fault}"})
        raise


if __name__ == "__main__":
    main(sys.argv)
