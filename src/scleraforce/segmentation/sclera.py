"""The wall that forces are read from: that of `find_wall`, below a conjunctiva, and checked by a network.

`checked_wall` writes masks and takes the network's wall where both ways differ. A force is read from the finer wall of
`find_wall` alone, and not at all where the network sees another one.
"""

from dataclasses import replace

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.conjunctiva import below_conjunctiva
from scleraforce.segmentation.display import as_logarithmic
from scleraforce.segmentation.steps import Segmentation
from scleraforce.segmentation.two_ways import two_ways_doubt
from scleraforce.segmentation.wall import find_wall
from scleraforce.segmentation.wall_finder import SeenWall, WallFinder


def find_sclera(
    frame: Pixels, scale: PixelScale, thickness_m: float | None = None, finder: WallFinder | None = None
) -> Segmentation:
    """Find the wall in a frame, as forces are read from it.

    Args:
        frame: counts, uint8 or uint16, shape (row, column).
        scale: size of the frame's pixel, with the refractive index.
        thickness_m: of the wall, as told: its surface is then looked for below a conjunctiva too. None: not told.
        finder: a network that checks the wall. None: nothing does, as in the control loop, where its 7 ms are too long.

    Returns:
        The wall of `find_wall`, or the one below a conjunctiva; not usable where the network sees another wall or none.

    Raises:
        ValueError: as of `find_wall`.
        ModelError: as of `WallFinder.find`.
    """
    frame = as_logarithmic(frame)
    first, found = find_walls(frame, scale, thickness_m)
    if finder is None or not found.usable:
        return found
    reason = walls_doubt(first, found, finder.find(frame))
    return replace(found, usable=not reason, reason=reason)


def find_walls(frame: Pixels, scale: PixelScale, thickness_m: float | None) -> tuple[Segmentation, Segmentation]:
    """Return the wall from the first surface on, and that below a conjunctiva: the same one where none is seen."""
    first = find_wall(frame, scale)
    return first, below_conjunctiva(frame, scale, first, thickness_m)


def walls_doubt(first: Segmentation, found: Segmentation, seen: SeenWall) -> str:
    """Return what a network's look says against the walls of `find_walls`, '' where nothing does.

    The network is not told how thick the wall is: one that takes the conjunctiva for a part of the wall, as it does
    from 140 um on, is no witness against the surface below it.
    """
    return two_ways_doubt(found, seen) and two_ways_doubt(first, seen)
