"""The settings that the monitor sends its black box at the start."""

from dataclasses import dataclass, replace
from pathlib import Path

from scleraforce.recording.folder import ForceInfo, RecordingInfo
from scleraforce.service.companions.frame_ring import FrameRing, RingPlace

FORCE = ForceInfo("fz", 1, 0.2)  # the needle moves, so labels average over a short time


@dataclass(frozen=True, kw_only=True)
class BlackBoxSettings:
    """Where to write, and what.

    Attributes:
        folder: of the log and of the withdrawals.
        ring: of the frames.
        info: contents of each recording.toml.
        record: folder for a recording of the whole session; None: only withdrawals are kept.
        keep_s: duration that is kept at a withdrawal.
    """

    folder: Path
    ring: RingPlace
    info: RecordingInfo
    record: Path | None
    keep_s: float

    @property
    def force(self) -> ForceInfo:
        """Axis and sign of a robot's force, and how long a label averages."""
        return self.info.force or FORCE


def black_box_settings(
    folder: Path, ring: FrameRing, info: RecordingInfo, record: Path | None = None, keep_s: float = 10.0
) -> BlackBoxSettings:
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
    return BlackBoxSettings(
        folder=folder.absolute(),
        ring=ring.place,
        info=replace(info, force=info.force or FORCE),
        record=None if record is None else record.absolute(),
        keep_s=keep_s,
    )
