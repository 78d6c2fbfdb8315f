"""What a small recording with a force log states."""

from scleraforce.recording.folder import EyeInfo, ForceInfo, NeedleInfo, OctInfo, RecordingInfo

__all__ = ["LOGGED_INFO"]

LOGGED_INFO = RecordingInfo(
    EyeInfo("eye"),
    OctInfo(columns=32, rows=16, bits=12, width_m=15e-3, depth_m=4e-3),
    NeedleInfo(gauge=22, slice_gap_m=5e-4),
    ForceInfo("fz", -1),
)
