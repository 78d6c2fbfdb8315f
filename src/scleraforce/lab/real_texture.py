"""Real tissue on walls of known force: the pixels of a scan of an eye at rest, laid on
other walls.

A scan is unrolled along its wall's surface: a row of the unrolled picture lies at one
distance from the surface, along the normal below it and along the column above it; a
column lies at one length along the surface. On another wall each pixel shows the place
of the same distance and length, and the wall is stretched to the other's thickness. So
the layers, shadows and speckle are the scanner's own, what lies above and below keeps
its distance, and the mechanics is ours. A scan that is shorter than a wall is continued
by its mirror image.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from scleraforce.base.arrays import Counts, Flags, Floats, Singles
from scleraforce.base.errors import FrameError
from scleraforce.lab.drawn_bscan import column_crossings, column_places
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import OctStudy
from scleraforce.wall.wall import Segmentation
from scleraforce.wall.wall_in_metres import stretch_of, surface_places

LEAST_LENGTH_M = 1e-3  # of a surface that is unrolled
AIR_M = 0.1e-3  # above a surface, as stored: what lies higher is air
GRAIN_M = 60e-6  # speckle is what varies within such a length, a standard deviation
FARTHEST_SHIFT_M = 1e-3  # of the speckle of another moment


@dataclass(frozen=True, eq=False)
class ScanTexture:
    """A B-scan, unrolled along its wall's surface.

    Attributes:
        light: counts over the largest one that the scanner gives, (row, column).
        air: such counts well above the surface, (pixel,); they stand where the scan
            shows nothing.
        above_m: distance from the first row to the surface, as stored.
        row_m: height of a row, as stored: optical depth below the surface.
        column_m: length of a column along the surface.
        thickness_m: of the wall, along the normal; NaN: its end is not seen.
    """

    light: Singles
    air: Singles
    above_m: float
    row_m: float
    column_m: float
    thickness_m: float

    def grained_anew(self, rng: np.random.Generator) -> "ScanTexture":
        """Return the texture as another moment shows it, with other speckle of the same
        kind: what varies within a few grains is moved to elsewhere.
        """
        mean = cv2.GaussianBlur(
            self.light,
            (0, 0),
            sigmaX=GRAIN_M / self.column_m,
            sigmaY=GRAIN_M / self.row_m,
            borderType=cv2.BORDER_REFLECT_101,
        )
        columns = round(rng.uniform(-1.0, 1.0) * FARTHEST_SHIFT_M / self.column_m)
        speckle = np.roll(self.light - mean, columns, axis=1)
        light = np.clip(mean + speckle, 0.0, 1.0).astype(np.float32)
        return replace(self, light=light)

    def laid_on(
        self, section: WallSection, oct_study: OctStudy, rng: np.random.Generator
    ) -> Counts:
        """Return the frame (row, column) in which a section, placed in it, has this
        texture; columns without a wall are black.

        The section's surface is the highest place of its outer curve in a column.
        """
        place_m = column_places(oct_study)
        outer_m = _highest(section.outer, place_m)
        inner_m = _highest(section.inner, place_m)
        there = np.isfinite(outer_m)
        stretch = _filled(stretch_of(place_m, outer_m), there)
        along_m = _length_along(place_m, outer_m, there)
        thickness_m = (inner_m - outer_m) / stretch
        deeper = _share(self.thickness_m, thickness_m, there)

        depth_m = oct_study.depth_m / oct_study.rows
        row_m = (np.arange(oct_study.rows) + 0.5)[:, None] * depth_m - outer_m
        optical_m = np.where(there, thickness_m, 0.0) * oct_study.refractive_index
        normal_m = row_m / stretch
        inside = np.clip(normal_m, 0.0, optical_m)
        below_m = np.maximum(normal_m - optical_m, 0.0)
        from_surface_m = np.minimum(row_m, 0.0) + inside * deeper + below_m
        row = (from_surface_m + self.above_m) / self.row_m - 0.5
        column = _to_and_fro(along_m / self.column_m, self.light.shape[1] - 1)
        light = _sampled(
            self.light, np.broadcast_to(column, row.shape), row, self.air, rng
        )
        light[:, ~there] = 0.0
        return np.rint(light * (2**oct_study.bits - 1)).astype(np.uint16)


def unrolled(
    frame: Pixels, scale: PixelScale, wall: Segmentation, largest: int
) -> ScanTexture:
    """Return a B-scan unrolled along a wall that was found in it; `largest`: the
    largest count that the scanner gives.

    Raises:
        FrameError: less than 1 mm of the surface is seen.
    """
    place_m, outer_m = surface_places(wall, scale)
    there = np.isfinite(outer_m)
    along_m = _length_along(place_m, outer_m, there)
    length_m = float(np.ptp(along_m[there])) if there.any() else 0.0
    if length_m < LEAST_LENGTH_M:
        raise FrameError(
            f"{length_m * 1e3:.1f} mm of the wall's surface are seen; 1 mm is needed to"
            " take a scan's pixels"
        )

    stretch = _filled(stretch_of(place_m, outer_m), there)
    columns = max(int(length_m / scale.lateral_m), 2)
    wanted_m = along_m[there].min() + np.arange(columns) * scale.lateral_m
    column = np.interp(wanted_m, along_m[there], np.flatnonzero(there))
    surface_row = np.interp(column, np.flatnonzero(there), wall.outer_row[there])
    steep = np.interp(column, np.arange(len(stretch)), stretch)
    above = int(surface_row.max()) + 1
    rows = above + len(frame) - int(surface_row.min())
    from_surface = np.arange(rows)[:, None] - above + 0.5
    row = surface_row + np.where(from_surface > 0.0, from_surface * steep, from_surface)
    counts = np.minimum(frame / np.float32(largest), 1.0).astype(np.float32)
    # columns without a surface may show tissue in any row
    lowest_row = np.where(there, wall.outer_row - AIR_M / scale.depth_m, -np.inf)
    air = counts[np.arange(len(frame))[:, None] < lowest_row]
    air = air if len(air) else np.zeros(1, dtype=np.float32)
    across = np.broadcast_to(column, row.shape)
    return ScanTexture(
        _sampled(counts, across, row, air, np.random.default_rng(0)),
        air,
        above * scale.depth_m,
        scale.depth_m,
        scale.lateral_m,
        wall.thickness_m if wall.inner_found else float("nan"),
    )


def _sampled(
    light: Singles,
    column: Floats,
    row: Floats,
    air: Singles,
    rng: np.random.Generator,
) -> Singles:
    """Return the light at places (row, column), linear between pixels; that of air
    drawn anew where there is none.
    """
    found = cv2.remap(
        light,
        np.nan_to_num(column, nan=-2.0).astype(np.float32),
        np.nan_to_num(row, nan=-2.0).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=float("nan"),
    )
    unseen = np.isnan(found)
    found[unseen] = rng.choice(air, int(unseen.sum()))
    return np.asarray(found, dtype=np.float32)


def _to_and_fro(place: Floats, last: int) -> Floats:
    """Return places within 0 to a last one, mirrored at both ends.

    >>> _to_and_fro(np.array([-1.0, 3.0, 5.0, 7.0]), 3).tolist()
    [1.0, 3.0, 1.0, 1.0]
    """
    return last - np.abs(last - np.mod(place, 2.0 * last))


def _share(own_m: float, other_m: Floats, there: Flags) -> Floats:
    """Return the own thickness over another wall's, (column,); 1 where the own one is
    not known.
    """
    if not np.isfinite(own_m):
        return np.ones_like(other_m)
    return np.where(there & (other_m > 0.0), own_m / other_m, 1.0)


def _highest(curve_m: Floats, place_m: Floats) -> Floats:
    """Return the depth at which a column meets a curve (point, 2) first, NaN where it
    does not.
    """
    depth_m = column_crossings(curve_m, place_m)
    if not len(depth_m):
        return np.full_like(place_m, np.nan)
    first_m = depth_m[0].astype(np.float64)
    return np.where(np.isfinite(first_m), first_m, np.nan)


def _length_along(place_m: Floats, depth_m: Floats, there: Flags) -> Floats:
    """Return the length along a surface from the frame's middle, (column,), NaN where
    it is not seen.
    """
    at = np.flatnonzero(there)
    length_m = np.full_like(place_m, np.nan)
    steps_m = np.hypot(np.diff(place_m[at]), np.diff(depth_m[at]))
    length_m[at] = np.concatenate([[0.0], np.cumsum(steps_m)])
    length_m[at] -= np.interp(0.0, place_m[at], length_m[at])
    return length_m


def _filled(values: Floats, there: Flags) -> Floats:
    """Return values with those that are not finite as beside them."""
    known = there & np.isfinite(values)
    at = np.arange(len(values))
    return np.interp(at, at[known], values[known])
