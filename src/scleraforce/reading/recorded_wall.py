"""The wall that people drew in a frame of a recording."""

from scleraforce.recordings.drawn_walls import RecordedWalls
from scleraforce.records.scan import PixelScale
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import check_mask_size, given_wall


def recorded_wall(
    walls: RecordedWalls, file: str, shape: tuple[int, ...], scale: PixelScale
) -> Segmentation | None:
    """Return the wall that a recording has for a frame (row, column), None without
    one.
    """
    mask = walls.wall(file)
    if mask is None:
        return None
    check_mask_size(mask, shape, str(walls.path(file)))
    return given_wall(mask, scale, source="corrected")
