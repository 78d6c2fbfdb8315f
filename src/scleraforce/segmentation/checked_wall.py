"""The wall by two ways that check each other: a network's, refined on the full frame, and that of `wall.find_wall`.

The network's surface starts the search for the edge on the full frame, and its thickness is what is known of the
inner boundary before the jumps are looked at; where no edge is near, its own answer stays. A frame in which the other
way finds another wall, by more than both are unsure of, is not usable. `docs/segmentation.md` says what was measured.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.below_surface import grouped, grouping, in_tissue, rows_per_metre, search_below
from scleraforce.segmentation.columns import at_columns, bridged, fine_columns
from scleraforce.segmentation.grid import Float, make_grid
from scleraforce.segmentation.imaged import LEAST_SHAPE, imaged_part, lit_columns
from scleraforce.segmentation.inner import CELL_M, CELLS
from scleraforce.segmentation.surface import refine_surface
from scleraforce.segmentation.wall import Segmentation, find_wall
from scleraforce.segmentation.wall_finder import SeenWall, WallFinder

__all__ = ["find_checked_wall"]

START_POINTS = 30  # of the surface that the search for the edge starts from
NEAR_SDS = 3.0  # an edge farther away than so many standard deviations is none of the wall's
PRIOR_WEIGHT, PRIOR_CAP = 0.25, 2.0  # of the network's thickness, against a jump's gain of at most 1
PRIOR_SD_M = 25e-6  # at least: of the network's thickness
SHOWN_SHARE = 0.5  # of the surface has an edge near the network's inner boundary: it is seen
UNROLLED_M = (0.3e-3, 1.1e-3)  # median thickness that fits into the unrolled wall; others are looked at scaled
SDS, OTHER_ROWS = 4.0, 2.0  # both ways may differ by so many standard deviations; that of `find_wall` in rows
OTHER_INNER_SHARE = 0.08  # ... and of its inner boundary, in thicknesses
DIFFERING_SHARE = 0.2  # of the columns that both see
UNSEEN_SHARE = 0.3  # of the columns that either sees are seen by one alone


@dataclass(frozen=True)
class _Start:
    """The network's wall at `fine_columns` of the imaged part: rows and standard deviations, and where there is any."""

    outer: Float
    inner: Float
    outer_sd: Float
    inner_sd: Float
    there: NDArray[np.bool_]


def find_checked_wall(frame: Pixels, scale: PixelScale, finder: WallFinder) -> Segmentation:
    """Find the wall in a frame with a network's help, and check it.

    Args:
        frame: counts, uint8 or uint16, shape (row, column).
        scale: size of the frame's pixel, with the refractive index.
        finder: the network.

    Returns:
        The network's wall, refined. It is usable where that of `find_wall` is, and agrees. A frame in which either
        way sees no wall at all has that of the other, and is not usable.

    Raises:
        ValueError: as of `find_wall`.
        ModelError: as of `WallFinder.find`.
    """
    other = find_wall(frame, scale)
    seen = finder.find(frame)
    lit = lit_columns(frame)
    if lit is None:
        return other
    if np.count_nonzero(seen.there) < LEAST_SHAPE // 2:
        reason = other.reason or "the network sees no wall where the other way finds one"
        return replace(other, usable=False, reason=reason)
    found = _refined(frame, scale, seen, *lit[:2])
    reason = other.reason or _difference(found, other, seen)
    return replace(found, usable=not reason, reason=reason)


def _refined(frame: Pixels, scale: PixelScale, seen: SeenWall, left: int, hidden: NDArray[np.bool_]) -> Segmentation:
    """Return the network's wall, moved to the edges of the full frame near it."""
    imaged = imaged_part(frame, left, hidden)
    start = _start(seen, left, len(hidden))
    row = _surface(imaged, scale, start)
    floor = make_grid(imaged, scale).floor
    inner, shown, thickness_m = _inner(imaged, floor, scale, row, start)
    outer_row, inner_row = at_columns(frame.shape[1], left, len(hidden), start.there, row, inner)
    return Segmentation(outer_row, inner_row, len(frame), True, "", shown, thickness_m)


def _start(seen: SeenWall, left: int, width: int) -> _Start:
    """Return the network's wall at `fine_columns` of the imaged part, which starts at a column and is so wide."""
    at = fine_columns(width) + left
    known = seen.there
    curves = (seen.outer_row, seen.inner_row, seen.outer_sd, seen.inner_sd)
    outer, inner, outer_sd, inner_sd = (
        np.interp(at, seen.column[known], curve[known]).astype(np.float32) for curve in curves
    )
    return _Start(outer, inner, outer_sd, inner_sd, seen.there_at(at))


def _surface(frame: Pixels, scale: PixelScale, start: _Start) -> Float:
    """Return the surface at `fine_columns`: the edge near the network's, its own where none is near."""
    fine = fine_columns(frame.shape[1])
    column = np.linspace(0.0, frame.shape[1] - 1.0, START_POINTS, dtype=np.float32)
    row = np.interp(column, fine, start.outer).astype(np.float32)
    edge = refine_surface(frame, scale, column, row).row
    near = np.abs(edge - start.outer) <= NEAR_SDS * start.outer_sd
    surface: Float = np.where(near, edge, start.outer)
    return surface


def _inner(frame: Pixels, floor: float, scale: PixelScale, row: Float, start: _Start) -> tuple[Float, bool, float]:
    """Return the inner boundary's rows, whether an edge shows it, and the median thickness along the normal, m."""
    there = start.there
    row = bridged(row, there)
    along_rows = rows_per_metre(frame.shape[1], row, in_tissue(scale))
    expected_m = np.maximum(start.inner - row, np.float32(1.0)) / along_rows
    sd_m = np.maximum(start.inner_sd / along_rows, np.float32(PRIOR_SD_M))
    zoom = np.float32(_zoom(float(np.median(expected_m[there]))))
    prior = _prior(grouped(expected_m) / zoom, grouped(sd_m) / zoom)
    jumps = search_below(frame, floor, row, there, along_rows * zoom, prior)
    found_m = jumps.thickness_m * zoom
    near = jumps.shown & (np.abs(found_m - grouped(expected_m)) <= NEAR_SDS * grouped(sd_m))
    thickness_m = grouping(len(row))[1] @ np.where(near, found_m, grouped(expected_m))
    return row + along_rows * thickness_m, bool(near.mean() > SHOWN_SHARE), float(np.median(thickness_m[there]))


def _zoom(thickness_m: float) -> float:
    """Return by how much a wall is thicker (above 1) or thinner than what the unrolled wall is made for."""
    thinnest, thickest = UNROLLED_M
    return max(1.0, thickness_m / thickest) * min(1.0, thickness_m / thinnest)


def _prior(thickness_m: Float, sd_m: Float) -> Float:
    """Return what each edge between cells of the unrolled wall gains by the network's thickness, (group, CELLS + 1).

    Args:
        thickness_m: that the network sees, (group,).
        sd_m: its standard deviation.
    """
    edge_m = np.arange(CELLS + 1, dtype=np.float32) * np.float32(CELL_M)
    off = (edge_m - thickness_m[:, None]) / sd_m[:, None]
    gain: Float = -np.minimum(np.float32(PRIOR_WEIGHT) * np.square(off), np.float32(PRIOR_CAP))
    return gain


def _difference(found: Segmentation, other: Segmentation, seen: SeenWall) -> str:
    """Return by how much two ways to find the wall differ, '' where they may be that unsure."""
    at = np.rint(seen.column).astype(np.intp)
    here, there = np.isfinite(found.outer_row[at]), np.isfinite(other.outer_row[at])
    both = here & there
    if np.count_nonzero(here ^ there) > UNSEEN_SHARE * np.count_nonzero(here | there):
        return _sentence("one sees wall where the other does not", here ^ there, here | there)
    off = np.abs(seen.outer_row - other.outer_row[at])
    differs = both & (off > SDS * np.hypot(seen.outer_sd, OTHER_ROWS))
    if np.count_nonzero(differs) > DIFFERING_SHARE * np.count_nonzero(both):
        return _sentence(f"its surface lies up to {off[differs].max():.0f} rows apart", differs, both)
    if not other.inner_found:
        return ""
    off = np.abs(seen.inner_row - other.inner_row[at])
    unsure = np.hypot(seen.inner_sd, OTHER_INNER_SHARE * (seen.inner_row - seen.outer_row))
    differs = both & (off > SDS * np.maximum(unsure, OTHER_ROWS)) & (other.inner_row[at] < other.rows)
    if np.count_nonzero(differs) > DIFFERING_SHARE * np.count_nonzero(both):
        return _sentence(f"its inner boundary lies up to {off[differs].max():.0f} rows apart", differs, both)
    return ""


def _sentence(what: str, where: NDArray[np.bool_], among: NDArray[np.bool_]) -> str:
    share = np.count_nonzero(where) / np.count_nonzero(among)
    return f"two ways to find the wall differ: {what}, in {share:.0%} of its columns"
