"""Real scans of eyes at rest, whose pixels are laid on virtual walls: those in
../shared/real-oct.
"""

from functools import cache
from pathlib import Path

import numpy as np

from scleraforce.base.arrays import Counts
from scleraforce.base.errors import InputError
from scleraforce.lab.real_texture import ScanTexture, unrolled
from scleraforce.lab.virtual_recording import FrameRenderer, PhantomFrame
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.reading.load_model import load_wall_finder
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import OctStudy
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation

REAL = Path(__file__).resolve().parents[3] / "shared" / "real-oct"
# Their scale is not recorded. Square pixels of such a size make the walls whose end is
# seen 0.65 mm thick, in the median; each is then scaled to the thickness of its eye.
PIXEL_M = 2.3e-6


def real_scans() -> tuple[Path, ...]:
    """Return the files of the scans of front eyes; none where the folder is absent."""
    return tuple(sorted((REAL / "anterior-segment").glob("*.jp*g")))


@cache
def texture_of(scan: Path, thickness_m: float, refractive_index: float) -> ScanTexture:
    """Return a scan unrolled along the wall that is found in it.

    Raises:
        InputError: no wall is found.
    """
    pixels = read_frame(scan)
    finder = load_wall_finder(SHIPPED_WALL_FINDER)

    def found_at(pixel_m: float) -> tuple[PixelScale, Segmentation]:
        scale = PixelScale(
            lateral_m=pixel_m, depth_m=pixel_m, refractive_index=refractive_index
        )
        wall = find_wall(pixels, scale, finder=finder)
        if not wall.usable:
            raise InputError(f"{scan}: {wall.reason}")
        return scale, wall

    scale, wall = found_at(PIXEL_M)
    if wall.inner_found:
        scale, wall = found_at(PIXEL_M * thickness_m / wall.thickness_m)
    return unrolled(pixels, scale, wall, np.iinfo(pixels.dtype).max)


def renderer_of(scan: Path, thickness_m: float, oct_study: OctStudy) -> FrameRenderer:
    """Return the function that lays a scan's pixels on a section, with speckle of its
    own in each frame.
    """
    texture = texture_of(scan, thickness_m, oct_study.refractive_index)

    def render(frame: PhantomFrame, section: WallSection) -> Counts:
        rng = np.random.default_rng(frame.seed)
        placed = frame.pose.place(section)
        return texture.grained_anew(rng).laid_on(placed, oct_study, rng)

    return render
