"""What the black box has heard of the session: its beginning, the last decision, the last seconds, the forces."""

from dataclasses import dataclass
from datetime import UTC, datetime

from scleraforce import __version__
from scleraforce.recording.folder import ForceInfo
from scleraforce.service.black_box.recent import Recent
from scleraforce.service.black_box.robot_force import RobotForce
from scleraforce.service.entry import Entry


@dataclass(frozen=True)
class SessionBeginning:
    """Time 0 of the session's recordings on the monotonic clock, and the first line of each recording.toml."""

    at_s: float
    comment: str


class Heard:
    """Remembers what came from the monitor.

    Args:
        keep_s: duration of the last seconds.
        most_frames: largest number of frames in them.
        force: axis and sign of a robot's force.

    Attributes:
        recent: frames and lines of the log of the last seconds.
        force: samples of the last ten minutes.
        beginning: of the session; None before the first message.
        entry: the last decision.
    """

    def __init__(self, keep_s: float, most_frames: int, force: ForceInfo) -> None:
        self.recent, self.force = Recent(keep_s, most_frames), RobotForce(force)
        self.beginning: SessionBeginning | None = None
        self.entry: Entry | None = None

    def begin(self, at_s: float, time_s: float) -> SessionBeginning:
        """Return the session's beginning, which is the first message; `time_s` is since 1970."""
        if self.beginning is None:
            began = datetime.fromtimestamp(time_s, UTC).isoformat(timespec="milliseconds")
            comment = f"Of a session of scleraforce {__version__}, research use only; time 0 is {began}."
            self.beginning = SessionBeginning(at_s, comment)
        return self.beginning
