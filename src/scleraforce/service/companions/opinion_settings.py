"""The settings that the monitor sends the second opinion at the start."""

from dataclasses import dataclass
from pathlib import Path

from scleraforce.known.eye import Known
from scleraforce.recording.pixels import PixelScale
from scleraforce.service.companions.frame_ring import RingPlace


@dataclass(frozen=True, kw_only=True)
class OpinionSettings:
    """What the second opinion reads, and with what.

    Attributes:
        model: folder of the model.
        known: of the eye.
        scale: of the frames.
        ring: of the frames.
    """

    model: Path
    known: Known
    scale: PixelScale
    ring: RingPlace
