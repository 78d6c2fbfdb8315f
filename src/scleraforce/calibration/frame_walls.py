"""A recording's frames while they are gone through several times: each wall is looked for once, each step counted."""

from collections.abc import Callable
from dataclasses import dataclass, field

from scleraforce.calibration.assimilation import Skipped
from scleraforce.recording.files import Recording, frame_digest
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.observations import Boundaries
from scleraforce.segmentation.observed import segmented_boundaries
from scleraforce.segmentation.sclera import find_sclera
from scleraforce.segmentation.wall_finder import WallFinder

__all__ = ["FrameWalls", "StepCount"]


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


@dataclass(frozen=True, eq=False)
class FrameWalls:
    """The frames of a recording, and the wall's boundaries in them, each looked for once."""

    recording: Recording
    finder: WallFinder | None
    _digests: dict[int, str] = field(default_factory=dict)
    _walls: dict[int, Boundaries | Skipped] = field(default_factory=dict)

    def digest(self, index: int) -> str:
        """Return by what a frame is known again."""
        if index not in self._digests:
            self._digests[index] = frame_digest(self._pixels(index))
        return self._digests[index]

    def wall(self, index: int) -> Boundaries | Skipped:
        """Return the wall's boundaries in a frame, or why they are of no use."""
        if index not in self._walls:
            info = self.recording.info
            scale = PixelScale.of(info.oct)
            found = find_sclera(self._pixels(index), scale, info.eye.thickness_m, self.finder)
            seen = segmented_boundaries(found, scale) if found.usable else Skipped(f"not usable: {found.reason}")
            self._walls[index] = seen
        return self._walls[index]

    def _pixels(self, index: int) -> Pixels:
        return self.recording.frame(self.recording.frames[index])
