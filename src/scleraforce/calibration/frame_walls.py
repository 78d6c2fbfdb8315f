"""A recording's frames while they are gone through several times: each wall is looked for once, each step counted."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from scleraforce.calibration.assimilation import Skipped
from scleraforce.recording.folder import Recording, frame_digest
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.observations import Boundaries
from scleraforce.segmentation.observed import segmented_boundaries
from scleraforce.segmentation.sclera import find_sclera
from scleraforce.segmentation.wall_finder import WallFinder


@dataclass
class StepCount:
    """How many steps of an eye's calibration are still to come, and who is told of each."""

    left: int
    progress: Callable[[int], object] | None

    def __call__(self, steps: int) -> None:
        """Report steps."""
        self.left -= steps
        if self.progress is not None:
            self.progress(steps)

    def finish(self) -> None:
        """Report what was not needed."""
        self(self.left)


class SeenFrame(NamedTuple):
    """By what a frame is known again, and the wall's boundaries in it, or why they are of no use."""

    sha256: str
    wall: Boundaries | Skipped


@dataclass(frozen=True, eq=False)
class FrameWalls:
    """The frames of a recording, each read once; `used` are the digests of those that an earlier calibration used."""

    recording: Recording
    finder: WallFinder | None
    used: frozenset[str]
    _seen: dict[int, SeenFrame | None] = field(default_factory=dict)

    def look(self, index: int) -> SeenFrame | None:
        """Return what is seen in a frame; None if it was used before."""
        if index not in self._seen:
            self._seen[index] = self._look(self.recording.frame(self.recording.frames[index]))
        return self._seen[index]

    def _look(self, pixels: Pixels) -> SeenFrame | None:
        sha256, info = frame_digest(pixels), self.recording.info
        if sha256 in self.used:
            return None
        scale = PixelScale.of(info.oct)
        found = find_sclera(pixels, scale, info.eye.thickness_m, self.finder)
        wall = segmented_boundaries(found, scale) if found.usable else Skipped(f"not usable: {found.reason}")
        return SeenFrame(sha256, wall)
