"""The walls in the frames of recordings, each found once: a calibration looks at the
same frames before, while and after it is made.
"""

from scleraforce.reading.recorded_wall import recorded_wall
from scleraforce.recordings.frame_and_force_tables import FrameEntry
from scleraforce.recordings.recording_folder import Recording
from scleraforce.records.frame import Pixels
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_network import WallFinder

MOST = 1000  # walls that are kept, of 30 kB each


class FoundWalls:
    """Finds the walls of frames, with a network (`finder`) that checks them, or without
    (None); a wall that a recording states comes first.
    """

    def __init__(self, finder: WallFinder | None = None) -> None:
        self._finder = finder
        self._kept = dict[tuple[object, ...], Segmentation]()

    def of_frame(
        self, recording: Recording, entry: FrameEntry, pixels: Pixels
    ) -> Segmentation:
        """Return the wall in a recording's frame, whose pixels these are."""
        scale = recording.info.scan.scale
        thickness_m = recording.info.eye.thickness_m
        key = recording.path, entry.file, scale, thickness_m
        if key in self._kept:
            return self._kept[key]

        given = recorded_wall(recording.walls, entry.file, pixels.shape, scale)
        found = given or find_wall(pixels, scale, thickness_m, self._finder)
        if len(self._kept) < MOST:
            self._kept[key] = found
        return found
