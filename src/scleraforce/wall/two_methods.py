"""The wall by two methods that check each other: that of `wall.find_wall` without a
network, and a network's.

The first is finer, the network knows better where a wall ends. Where they agree the
wall is the first method's, with the network's inner boundary in stretches where light
falls more there. Elsewhere it is the network's, moved to an edge of the full frame
within the network's own resolution. A frame in which the network sees another surface,
by more than both are unsure of, is not usable. Where both differ about the inner
boundary alone, and the wall is not as thick as it is known to be, the surface alone is
used. Forces are read from the wall that is returned, and pages and masks show it.

All comparisons are made at the columns that the network answers for, in rows of the
full frame.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from scleraforce.base.arrays import Flags, Floats, Places, Singles
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.wall.frame_light import LEAST_SHAPE
from scleraforce.wall.inner_boundary import CELL_M, CELLS, stretch
from scleraforce.wall.lit_part import LitPart, lit_part
from scleraforce.wall.per_frame_loops import (
    continuation,
    edge_near,
    fine_columns,
    grouped,
    grouping,
    nearest_point,
    thickness_below,
)
from scleraforce.wall.shared_loops import at_every_column, best_path, bridge
from scleraforce.wall.wall import UNSEEN_DEPTH_M, BothWalls, SeenWall, Segmentation
from scleraforce.wall.wall_network import WallFinder

# of two walls, in multiples of the largest usable one, and in words
Difference = tuple[float, str]
START_POINTS = 30  # of the surface that the search for the edge starts from
# rows of the reduced frame from the network's boundary to the wall's edge, at most
NEAR_STEPS = 1.0
# weight of the network's thickness, against a jump's gain of at most 1
PRIOR_WEIGHT = 0.25
PRIOR_CAP = 2.0
PRIOR_SD_M = 25e-6  # at least: of the network's thickness
# the end is seen where jumps lie so near the network's, in so much of the wall
SHOWN_SDS = 3.0
SHOWN_SHARE = 0.5
ENDED_SHARE = 0.2  # of the wall has an end inside of the frame: its thickness is known
# median thickness that fits into the unrolled wall; others are looked at scaled
UNROLLED_M = (
    0.3e-3,
    1.1e-3,
)
# largest distance of one boundary by both methods: the network's standard deviations or
# rows
SAME_SDS = 2.0
LAYER_M = 0.35e-3  # thickness of the choroid, at most
# ... in this share of the columns that both see, and these of the columns that either
# sees
SAME_SHARE = 0.8
SDS = 4.0  # largest difference in standard deviations
OTHER_ROWS = 2.0  # the standard deviation of `find_wall` in rows
OTHER_INNER_SHARE = 0.08  # ... and of its inner boundary, in thicknesses
DIFFERING_SHARE = 0.2  # of the columns that both see
UNSEEN_SHARE = 0.3  # of the columns that either sees are seen by one alone
# An inner boundary is confirmed by the other method's within this share of the
# thickness, or a row of the network; or by the known thickness.
CONFIRMED_THICKNESS = 0.1
UNCONFIRMED_SHARE = 0.5  # of the columns that both see do not, at most
# a network that is unsure of the wall's end by so much of it tells nothing of a layer
UNSURE_THICKNESS = 0.25
# share of the thickness looked at above and below a boundary
SIDE_SHARE = 0.1
LEAST_SIDE_ROWS = 3.0
SAMPLES = 8  # rows that are looked at on a side
# above and below the inner boundary: where its edge is looked for again
SHARP_M = 70e-6
LEAST_SHARP_ROWS = 3
SHARP_WIDTH_M = 0.25e-3  # of averaged columns
STEP_ROWS = 2  # of a step between two halves of such a width, at most
# of a column's rows, of the median: a column without speckle does not decide alone
LEAST_SPREAD = 0.25
# of a normal distribution about the first boundary: a standard deviation of 0.35 of the
# reach
STAYS = 4.0
GRAINS = 1.5  # independent pixels in a row of that width: more are not counted


def checked_by(
    finder: WallFinder,
    frame: Pixels,
    scale: PixelScale,
    first: Segmentation,
    found: Segmentation,
    thickness_m: float | None = None,
) -> Segmentation:
    """Return the wall that both methods give together, usable if nothing speaks against
    it; `thickness_m`: of the wall, if it is known.

    `first` is the wall in a frame of a logarithmic display from the first surface on,
    `found` the one below a conjunctiva, the same object if none is seen. Below a
    conjunctiva `found` is returned: the network does not know how thick the wall is,
    and takes a conjunctiva from 140 um on for a part of it.
    """
    part = lit_part(frame, scale)
    if part is None:
        return found

    seen = finder.find(frame)
    beside_found = differences_of(found, seen)
    beside_first = beside_found if first is found else differences_of(first, seen)
    reason = found.reason or (
        reason_to_doubt(beside_found) and reason_to_doubt(beside_first)
    )
    disagreement = min(_largest(beside_found), _largest(beside_first))
    by_each = found, first, seen

    layer_rows = LAYER_M * scale.refractive_index / scale.depth_m
    if found is first and sees_wall(seen):
        shown = refined_wall(part, seen)
        is_as_thick = _is_as_thick(found, thickness_m)
        if ways_agree(found, seen, layer_rows, inner_known=is_as_thick):
            apart = np.maximum(SDS * _inner_sd(seen), seen.step_rows)
            shown = joined_walls(
                frame,
                found,
                shown,
                np.interp(np.arange(frame.shape[1]), seen.column, apart),
            )

        if not reason:
            _keep_gaps(found, shown)
        found = replace(shown, needle=found.needle)

    inner_excess, inner_doubt = (
        (0.0, "")
        if not found.inner_found or _is_as_thick(found, thickness_m)
        else _inner_difference(found, seen, 0.0 if thickness_m else layer_rows)
    )
    methods = BothWalls(*by_each, max(disagreement, inner_excess))
    found = replace(found, usable=not reason, reason=reason, methods=methods)
    if inner_excess > 1.0:
        return surface_alone(found, inner_doubt, scale)
    if not found.inner_found:
        return found
    return replace(found, inner_row=sharpened_boundary(frame, found.inner_row, scale))


def _is_as_thick(found: Segmentation, thickness_m: float | None) -> bool:
    """Return whether a wall is as thick as it is known to be. Another end that the
    other method sees is that of another layer.
    """
    if thickness_m is None:
        return False
    return abs(found.thickness_m - thickness_m) <= CONFIRMED_THICKNESS * thickness_m


def surface_alone(
    found: Segmentation, inner_doubt: str, scale: PixelScale
) -> Segmentation:
    """Return a wall whose inner boundary is not used; the mask ends 1 mm below the
    surface.
    """
    below_rows = UNSEEN_DEPTH_M * scale.refractive_index / scale.depth_m
    return replace(
        found,
        inner_row=found.outer_row + below_rows,
        inner_found=False,
        inner_doubt=inner_doubt,
        thickness_m=float("nan"),
    )


def _keep_gaps(found: Segmentation, shown: Segmentation) -> None:
    """Clear the columns of a usable wall in gaps of the first method's: there a dent
    may leave the frame.
    """
    gaps = np.isnan(found.outer_row)
    inside = np.flatnonzero(~gaps)
    gaps[: inside[0]] = gaps[inside[-1] :] = False
    for boundary in (shown.outer_row, shown.inner_row):
        boundary[gaps] = np.nan


def ways_agree(
    other: Segmentation,
    seen: SeenWall,
    layer_rows: float,
    *,
    inner_known: bool = False,
) -> bool:
    """Return whether a wall is the one that the network sees, but for a layer below of
    at most `layer_rows`; with `inner_known` its surface alone.
    """
    if not other.inner_found:
        return False

    both, either = _columns(other, seen)
    at = seen.frame_column
    outer = np.abs(seen.outer_row - other.outer_row[at]) <= SAME_SDS * np.maximum(
        seen.outer_sd, seen.step_rows
    )
    inner = np.abs(seen.inner_row - other.inner_row[at]) <= SAME_SDS * np.maximum(
        seen.inner_sd, seen.step_rows
    )
    thicker = seen.inner_row - other.inner_row[at]
    inner |= (
        (thicker > 0.0) & (thicker < layer_rows) & (thicker <= SDS * _inner_sd(seen))
    )
    # of two boundaries below the frame nobody sees which is lower
    last = other.rows - 1.0 - seen.step_rows
    inner |= (seen.inner_row > last) & (other.inner_row[at] > last)
    inner |= inner_known
    seen_by_both = int(np.count_nonzero(both))
    same = int(np.count_nonzero(both & outer & inner))

    return (
        seen_by_both >= SAME_SHARE * int(np.count_nonzero(either))
        and same >= SAME_SHARE * seen_by_both
    )


def reason_to_doubt(differences: list[Difference]) -> str:
    """Return what speaks against a wall once a network has looked, too, '' where
    nothing does.
    """
    return next((words for excess, words in differences if excess > 1.0), "")


def _largest(differences: list[Difference]) -> float:
    return max((excess for excess, _ in differences), default=0.0)


def sees_wall(seen: SeenWall) -> bool:
    """Return whether the network sees a wall at all."""
    return int(np.count_nonzero(seen.there)) >= LEAST_SHAPE // 2


def differences_of(other: Segmentation, seen: SeenWall) -> list[Difference]:
    """Return each difference of a wall from the network's."""
    return list(_differences(other, seen))


def _differences(other: Segmentation, seen: SeenWall) -> Iterator[Difference]:
    """Yield each difference of a wall from the network's."""
    at = seen.frame_column
    if not sees_wall(seen):
        if np.isfinite(other.outer_row).any():
            yield (
                1.0 / UNSEEN_SHARE,
                "the network sees no wall where the other method finds one",
            )

        return

    both, either = _columns(other, seen)
    share = _share(either & ~both, either)
    yield (
        share / UNSEEN_SHARE,
        _sentence("one sees wall where the other does not", share),
    )
    above = np.abs(seen.outer_row - other.outer_row[at])
    yield _distance(
        "surface",
        above,
        above > SDS * np.hypot(seen.outer_sd, OTHER_ROWS),
        both,
        DIFFERING_SHARE,
    )


def _inner_difference(
    wall: Segmentation, seen: SeenWall, layer_rows: float
) -> Difference:
    """Return the difference of a wall's inner boundary from the network's, which may be
    the end of a layer of at most `layer_rows` below the wall.

    Forces are read from the surface alone where they differ, which widens an interval
    by little: two ways to see the wall's end have to find the same one.
    """
    both, _ = _columns(wall, seen)
    inner_row = wall.inner_row[seen.frame_column]
    thickness = seen.inner_row - seen.outer_row
    thicker = seen.inner_row - inner_row
    off = np.abs(thicker)
    # of two boundaries below the frame nobody sees which is lower
    differs = inner_row < wall.rows
    differs &= off > np.maximum(seen.step_rows, CONFIRMED_THICKNESS * thickness)
    is_layer = (thicker > 0.0) & (thicker < layer_rows) & (off <= SDS * _inner_sd(seen))
    is_sure = seen.inner_sd <= UNSURE_THICKNESS * thickness
    differs &= ~(is_layer & is_sure)
    return _distance("inner boundary", off, differs, both, UNCONFIRMED_SHARE)


def _inner_sd(seen: SeenWall) -> Floats:
    """Return the standard deviation of the distance between both inner boundaries,
    rows.
    """
    other = OTHER_INNER_SHARE * (seen.inner_row - seen.outer_row)
    sd: Floats = np.maximum(np.hypot(seen.inner_sd, other), OTHER_ROWS)
    return sd


def _distance(
    name: str, off: Floats, differs: Flags, both: Flags, usable_share: float
) -> Difference:
    differs = differs & both
    share = _share(differs, both)
    rows = off[differs].max(initial=0.0)
    return share / usable_share, _sentence(
        f"its {name} lies up to {rows:.0f} rows apart", share
    )


def _columns(other: Segmentation, seen: SeenWall) -> tuple[Flags, Flags]:
    """Return in which of the network's columns both see wall, and in which either does;
    none behind a needle.
    """
    there = np.isfinite(other.outer_row[seen.frame_column])
    either = seen.there | there
    if other.needle is not None:
        first, after = other.needle.hidden
        either &= (seen.frame_column < first) | (seen.frame_column >= after)
    return seen.there & there, either


def _share(where: Flags, among: Flags) -> float:
    return int(np.count_nonzero(where)) / max(int(np.count_nonzero(among)), 1)


def _sentence(what: str, share: float) -> str:
    return f"two methods to find the wall differ: {what}, in {share:.0%} of its columns"


@dataclass(frozen=True)
class _Start:
    """The network's wall at `fine_columns` of the imaged part, rows."""

    outer: Singles
    inner: Singles
    inner_sd: Singles
    there: Flags
    ended: Flags  # where it sees the wall's end inside of the frame
    step_rows: float


def refined_wall(part: LitPart, seen: SeenWall) -> Segmentation:
    """Return the network's wall, moved to the edges of the full frame near it."""
    width = len(part.missing)
    rows = len(part.frame)
    at = fine_columns(width) + part.left
    known = seen.there
    curves = (
        seen.outer_row,
        seen.inner_row,
        seen.inner_sd,
        (seen.inner_row < rows - 1).astype(np.float64),
    )
    *wall, inside = (
        np.interp(at, seen.column[known], curve[known]) for curve in curves
    )
    outer, inner, inner_sd = np.array(wall, dtype=np.float32)
    there = seen.there_at(at)
    start = _Start(
        outer, inner, inner_sd, there, there & (inside == 1.0), seen.step_rows
    )
    row = _surface(part, start)
    inner, shown, thickness_m = _inner(part, row, start)
    boundaries = np.full((2, part.columns), np.nan)

    for boundary, curve in zip(boundaries, (row, inner), strict=True):
        to = boundary[part.left : part.left + width]
        at_every_column(
            fine_columns(width), curve, start.there, nearest_point(width), to
        )

    return Segmentation(
        boundaries[0], boundaries[1], rows, True, "", shown, thickness_m=thickness_m
    )


def _surface(part: LitPart, start: _Start) -> Singles:
    """Return the surface at `fine_columns`: the edge near the network's, its own where
    none is near.
    """
    width = len(part.missing)
    column = np.linspace(0.0, width - 1.0, START_POINTS, dtype=np.float32)
    row = np.interp(column, fine_columns(width), start.outer).astype(np.float32)
    spread = (
        continuation(
            width, float(column[0]), float(column[1] - column[0]), START_POINTS
        )
        @ row
    )
    edge = edge_near(
        part.frame,
        part.first,
        np.clip(spread, 0.0, len(part.frame) - 1.0),
        part.workplace,
    )
    near = np.abs(edge - start.outer) <= np.float32(NEAR_STEPS * start.step_rows)
    surface: Singles = np.where(near, edge, start.outer)

    return surface


def _inner(part: LitPart, row: Singles, start: _Start) -> tuple[Singles, bool, float]:
    """Return the inner boundary's rows, whether an edge shows it, and the median
    thickness along the normal, m.

    Where the wall does not end inside of the frame it is as thick as beside that; 1 mm,
    and NaN, if it hardly ends.
    """
    row = bridge(row, start.there)
    depth_m = part.scale.depth_m / part.scale.refractive_index

    if np.count_nonzero(start.ended) < ENDED_SHARE * np.count_nonzero(start.there):
        assumed = np.maximum(row, np.float32(0.0)) + np.float32(
            UNSEEN_DEPTH_M / depth_m
        )
        return np.minimum(start.inner, assumed), False, float("nan")

    column = fine_columns(len(part.missing))
    along_rows = stretch(
        row, float(column[1] - column[0]) * part.scale.lateral_m, depth_m
    )
    thickness_m, shown = _thickness(part, row, along_rows, start)

    return (
        row + along_rows * thickness_m,
        shown,
        float(np.median(thickness_m[start.ended])),
    )


def _thickness(
    part: LitPart, row: Singles, along_rows: Singles, start: _Start
) -> tuple[Singles, bool]:
    """Return the wall's thickness along the normal at `fine_columns`, m, and whether an
    edge shows it.
    """
    expected_m = bridge(
        np.maximum(start.inner - row, np.float32(1.0)) / along_rows, start.ended
    )
    step_m = np.float32(NEAR_STEPS * start.step_rows) / along_rows
    sd_m = np.maximum(
        np.minimum(start.inner_sd / along_rows, step_m), np.float32(PRIOR_SD_M)
    )
    typical_m = float(np.median(expected_m[start.there]))
    thinnest_m, thickest_m = UNROLLED_M
    zoom = np.float32(
        max(1.0, typical_m / thickest_m) * min(1.0, typical_m / thinnest_m)
    )
    edge_m = np.arange(CELLS + 1, dtype=np.float32) * np.float32(CELL_M)
    off = (edge_m - (grouped(expected_m) / zoom)[:, None]) / (grouped(sd_m) / zoom)[
        :, None
    ]
    prior = -np.minimum(
        np.float32(PRIOR_WEIGHT) * np.square(off), np.float32(PRIOR_CAP)
    )
    found_m, jumps = thickness_below(
        part.frame,
        part.first,
        part.is_bytes,
        row,
        start.there,
        along_rows * zoom,
        prior,
        part.workplace,
    )
    found_m *= zoom
    off_m = np.abs(found_m - grouped(expected_m))
    near = jumps & (off_m <= grouped(step_m))
    unsure_m = np.maximum(start.inner_sd / along_rows, step_m)
    shown = jumps & (off_m <= SHOWN_SDS * grouped(unsure_m))
    thickness_m: Singles = grouping(len(row))[1] @ np.where(
        near, found_m, grouped(expected_m)
    )

    return thickness_m, bool(shown.mean() > SHOWN_SHARE)


def sharpened_boundary(frame: Pixels, inner_row: Floats, scale: PixelScale) -> Floats:
    """Return an inner boundary at the edge in the full frame near it, (column,).

    The edge parts the rows about the boundary so that both parts spread least. Beside a
    needle thickness changes too fast for the wide means of the first search.
    """
    seen = np.flatnonzero(np.isfinite(inner_row))
    reach = max(
        LEAST_SHARP_ROWS, round(SHARP_M * scale.refractive_index / scale.depth_m)
    )
    width = max(2, round(SHARP_WIDTH_M / scale.lateral_m))
    points = seen[:: width // 2]
    row = (inner_row[seen] + np.arange(-reach, reach + 1)[:, None]).astype(np.float32)
    column = np.broadcast_to(seen.astype(np.float32), row.shape).copy()
    sampled = cv2.remap(
        frame, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    ).astype(np.float32)
    light = cv2.blur(sampled, (width, 1))[:, :: width // 2]
    number = len(light)
    above = np.cumsum(light, axis=0)
    rows = np.arange(1, len(light))[:, None]
    fall = np.maximum(
        above[:-1] / rows - (above[-1] - above[:-1]) / (number - rows), 0.0
    )
    parted = np.square(fall) * rows * (number - rows) / number
    spread = (
        np.square(light).sum(axis=0)
        - np.square(above[-1]) / number
        - parted.max(axis=0)
    ) / number
    edge = np.arange(-reach, reach) + 0.5
    score = parted * (
        GRAINS / width / np.maximum(spread, LEAST_SPREAD * np.median(spread) + 1e-6)
    )
    score -= np.square(edge / reach)[:, None] * STAYS
    path = best_path(np.ascontiguousarray(score.T, dtype=np.float32), STEP_ROWS)
    sharp = inner_row.copy()
    moved = cv2.blur(edge[path][None], (3, 1), borderType=cv2.BORDER_REPLICATE)[0]
    sharp[seen] += np.interp(seen, points, moved)

    return sharp


def joined_walls(
    frame: Pixels, finer: Segmentation, other: Segmentation, apart_rows: Floats
) -> Segmentation:
    """Return the finer wall, with the other's inner boundary in stretches where it is
    `apart_rows` off and light falls.

    Columns that only the other wall has are taken from it, except where a needle hides
    them.
    """
    seen = np.isfinite(finer.outer_row)
    added = np.isfinite(other.outer_row)
    both = seen & added
    only = added & ~seen

    if finer.needle is not None:
        only[slice(*finer.needle.hidden)] = False

    outer = np.where(only, other.outer_row, finer.outer_row)
    inner = np.where(only, other.inner_row, finer.inner_row)
    parted = both.copy()
    parted[both] = (
        np.abs(finer.inner_row[both] - other.inner_row[both]) > apart_rows[both]
    )

    at = np.flatnonzero(parted)
    if len(at):
        stretch = np.cumsum(np.diff(at, prepend=at[0]) > 1)
        gain = np.bincount(
            stretch, _falls(frame, other, finer, at) - _falls(frame, finer, other, at)
        )
        better = at[gain[stretch] > 0.0]
        inner[better] = other.inner_row[better]

    return replace(finer, outer_row=outer, inner_row=inner)


def _falls(
    frame: Pixels, wall: Segmentation, against: Segmentation, at: Places
) -> Floats:
    """Return by how many counts the light falls at a wall's inner boundary, in as many
    rows as at the other one's.
    """
    inner = wall.inner_row[at]
    thickness = np.maximum(
        inner - wall.outer_row[at], against.inner_row[at] - against.outer_row[at]
    )
    side = np.maximum(SIDE_SHARE * thickness, LEAST_SIDE_ROWS)
    off = (np.arange(SAMPLES)[:, None] + 0.5) / SAMPLES * side
    inside = (inner - side > -0.5) & (inner + side < len(frame) - 0.5)
    rows = (
        np.clip(np.rint(inner + sign * off).astype(np.intp), 0, len(frame) - 1)
        for sign in (-1.0, 1.0)
    )
    above, below = (frame[row, at].mean(axis=0) for row in rows)
    falls: Floats = np.where(inside, above - below, 0.0)  # 0 beyond the frame

    return falls
