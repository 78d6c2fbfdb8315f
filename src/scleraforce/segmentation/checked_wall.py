"""The wall by two ways that check each other: a network's, refined on the full frame, and that of `wall.find_wall`.

Where both find the same wall, that of `find_wall` stays, but for stretches in which the network's is the better one: it
is the finer one. Elsewhere the wall is the network's, moved to an edge of the full frame where one lies within the
network's own resolution. A frame in which the other way finds another wall, by more than both are unsure of, or in
which the network is too unsure of the wall's end, is not usable. `segmentation.two_ways` compares,
`docs/wall_finder.md` says what was measured.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.below_surface import grouped, grouping, in_tissue, rows_per_metre, search_below
from scleraforce.segmentation.columns import at_columns, bridged, fine_columns
from scleraforce.segmentation.display import as_logarithmic
from scleraforce.segmentation.grid import Float, make_grid
from scleraforce.segmentation.imaged import imaged_part, lit_columns
from scleraforce.segmentation.inner import CELL_M, CELLS
from scleraforce.segmentation.joined_walls import joined_walls
from scleraforce.segmentation.numpy_steps import UNSEEN_DEPTH_M
from scleraforce.segmentation.sclera import find_walls, walls_doubt
from scleraforce.segmentation.steps import Segmentation
from scleraforce.segmentation.surface import refine_surface
from scleraforce.segmentation.two_ways import sees_wall, ways_agree
from scleraforce.segmentation.wall_finder import SeenWall, WallFinder

START_POINTS = 30  # of the surface that the search for the edge starts from
NEAR_STEPS = 1.0  # an edge within so many rows of the reduced frame is the wall's: the network sees no finer
PRIOR_WEIGHT, PRIOR_CAP = 0.25, 2.0  # of the network's thickness, against a jump's gain of at most 1
PRIOR_SD_M = 25e-6  # at least: of the network's thickness
SHOWN_SDS, SHOWN_SHARE = 3.0, 0.5  # the end is seen where jumps lie so near the network's, in so much of the wall
ENDED_SHARE = 0.2  # of the wall has an end inside of the frame: its thickness is known
UNROLLED_M = (0.3e-3, 1.1e-3)  # median thickness that fits into the unrolled wall; others are looked at scaled


@dataclass(frozen=True)
class _Start:
    """The network's wall at `fine_columns` of the imaged part: rows and standard deviations, and where there is any.

    `ended`: where it sees the wall's end inside of the frame.
    """

    outer: Float
    inner: Float
    outer_sd: Float
    inner_sd: Float
    there: NDArray[np.bool_]
    ended: NDArray[np.bool_]
    step_rows: float


def find_checked_wall(
    frame: Pixels, scale: PixelScale, finder: WallFinder, thickness_m: float | None = None
) -> Segmentation:
    """Find the wall in a frame with a network's help, and check it.

    Args:
        frame: counts, uint8 or uint16, shape (row, column).
        scale: size of the frame's pixel, with the refractive index.
        finder: the network.
        thickness_m: of the wall, as told (see `find_sclera`).

    Returns:
        The wall of `find_wall` where both ways agree, with the network's for stretches (`joined_walls`), and that below
        a conjunctiva where one is seen; else the network's, refined. It is usable where that of `find_wall` is, and
        nothing speaks against it; a needle is what that sees. A frame in which either way sees no wall at all has that
        of the other, and is not usable.

    Raises:
        ValueError: as of `find_wall`.
        ModelError: as of `WallFinder.find`.
    """
    frame = as_logarithmic(frame)
    first, other = find_walls(frame, scale, thickness_m)
    lit = lit_columns(frame)
    if lit is None:
        return other
    seen = finder.find(frame)
    found = other
    if other is first and sees_wall(seen):
        found = _refined(frame, scale, seen, *lit[:2])
        if ways_agree(other, seen):
            found = joined_walls(frame, other, found, seen.step_rows)
    reason = other.reason or walls_doubt(first, other, seen)
    return replace(found, usable=not reason, reason=reason, needle=other.needle)


def _refined(frame: Pixels, scale: PixelScale, seen: SeenWall, left: int, hidden: NDArray[np.bool_]) -> Segmentation:
    """Return the network's wall, moved to the edges of the full frame near it."""
    imaged = imaged_part(frame, left, hidden)
    start = _start(seen, left, len(hidden), len(frame))
    row = _surface(imaged, scale, start)
    floor = make_grid(imaged, scale).floor
    inner, shown, thickness_m = _inner(imaged, floor, scale, row, start)
    outer_row, inner_row = at_columns(frame.shape[1], left, len(hidden), start.there, row, inner)
    return Segmentation(outer_row, inner_row, len(frame), True, "", shown, thickness_m=thickness_m)


def _start(seen: SeenWall, left: int, width: int, rows: int) -> _Start:
    """Return the network's wall at `fine_columns` of the imaged part, which starts at a column and is so wide."""
    at = fine_columns(width) + left
    known = seen.there
    curves = (seen.outer_row, seen.inner_row, seen.outer_sd, seen.inner_sd)
    outer, inner, outer_sd, inner_sd = (
        np.interp(at, seen.column[known], curve[known]).astype(np.float32) for curve in curves
    )
    there, inside = seen.there_at(at), (seen.inner_row[known] < rows - 1).astype(np.float64)
    ended = there & (np.interp(at, seen.column[known], inside) == 1.0)
    return _Start(outer, inner, outer_sd, inner_sd, there, ended, seen.step_rows)


def _surface(frame: Pixels, scale: PixelScale, start: _Start) -> Float:
    """Return the surface at `fine_columns`: the edge near the network's, its own where none is near."""
    fine = fine_columns(frame.shape[1])
    column = np.linspace(0.0, frame.shape[1] - 1.0, START_POINTS, dtype=np.float32)
    row = np.interp(column, fine, start.outer).astype(np.float32)
    edge = refine_surface(frame, scale, column, row).row
    near = np.abs(edge - start.outer) <= np.float32(NEAR_STEPS * start.step_rows)
    surface: Float = np.where(near, edge, start.outer)
    return surface


def _inner(frame: Pixels, floor: float, scale: PixelScale, row: Float, start: _Start) -> tuple[Float, bool, float]:
    """Return the inner boundary's rows, whether an edge shows it, and the median thickness along the normal, m.

    Where the network sees no end inside of the frame the wall goes on as thick as it is beside that. Where it sees
    hardly any end, the wall is 1 mm thick, as that of `find_wall` is, and the thickness NaN.
    """
    row, tissue = bridged(row, start.there), in_tissue(scale)
    if np.count_nonzero(start.ended) < ENDED_SHARE * np.count_nonzero(start.there):
        assumed = np.maximum(row, np.float32(0.0)) + np.float32(UNSEEN_DEPTH_M / tissue.depth_m)
        return np.minimum(start.inner, assumed), False, float("nan")
    along_rows = rows_per_metre(frame.shape[1], row, tissue)
    thickness_m, shown = _thickness(frame, floor, row, along_rows, start)
    return row + along_rows * thickness_m, shown, float(np.median(thickness_m[start.ended]))


def _thickness(frame: Pixels, floor: float, row: Float, along_rows: Float, start: _Start) -> tuple[Float, bool]:
    """Return the wall's thickness along the normal at `fine_columns`, m, and whether an edge shows it."""
    expected_m = bridged(np.maximum(start.inner - row, np.float32(1.0)) / along_rows, start.ended)
    step_m = np.float32(NEAR_STEPS * start.step_rows) / along_rows
    sd_m = np.maximum(np.minimum(start.inner_sd / along_rows, step_m), np.float32(PRIOR_SD_M))
    zoom = np.float32(_zoom(float(np.median(expected_m[start.there]))))
    prior = _prior(grouped(expected_m) / zoom, grouped(sd_m) / zoom)
    jumps = search_below(frame, floor, row, start.there, along_rows * zoom, prior)
    found_m = jumps.thickness_m * zoom
    off_m = np.abs(found_m - grouped(expected_m))
    near = jumps.shown & (off_m <= grouped(step_m))
    unsure_m = np.maximum(start.inner_sd / along_rows, step_m)
    shown = jumps.shown & (off_m <= SHOWN_SDS * grouped(unsure_m))
    thickness_m: Float = grouping(len(row))[1] @ np.where(near, found_m, grouped(expected_m))
    return thickness_m, bool(shown.mean() > SHOWN_SHARE)


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
