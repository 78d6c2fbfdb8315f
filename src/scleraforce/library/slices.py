"""Slices of many walls at once: boundaries at the columns of the slice, and the wall between them (NumPy only).

The picture is that of `section.slices.fill_section` for the same curves: a pixel is wall where its centre lies in the
wall. Boundaries come separately, so that errors like those of a segmentation can be added before they are filled.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.library.columns import depths_at_columns
from scleraforce.library.section_motion import SectionMotion
from scleraforce.library.sections import cut_rings, cut_surfaces
from scleraforce.section.plane import Section, SliceWindow
from scleraforce.section.slices import SNAP, WALL, fill_section
from scleraforce.study import SliceStudy

Floats = NDArray[np.float64]

BLOCK = 128  # samples cut together: their arrays stay in the cache


@dataclass(frozen=True)
class Framing:
    """Where sections lie in their slices; each array is (sample,).

    A section is turned about its frame's origin (the undeformed contact, moved by the gap), from lateral to depth,
    scaled about it, and then moved: `lateral_m` is the origin's place from the middle column, `depth_m` its depth below
    the slice's top edge.
    """

    lateral_m: Floats
    depth_m: Floats
    scale: Floats
    turn_rad: Floats

    @classmethod
    def upright(cls, lateral_m: Floats, depth_m: Floats) -> "Framing":
        """Return the framing that only moves."""
        return cls(lateral_m, depth_m, np.ones_like(depth_m), np.zeros_like(depth_m))

    def place(self, sample: int | np.integer[Any], points: Floats) -> Floats:
        """Return points (point, 2) of a sample's plane, lateral and depth in m, in its slice."""
        c, s = np.cos(self.turn_rad[sample]), np.sin(self.turn_rad[sample])
        turned = points @ np.array([[c, s], [-s, c]])
        return np.asarray(self.scale[sample] * turned + [self.lateral_m[sample], self.depth_m[sample]])


@dataclass(frozen=True)
class WallBoundaries:
    """Boundaries of walls in the columns of their slices.

    `depth_sbc` (sample, boundary, column): depth of the outer and the inner boundary below the slice's top edge at the
    centre of the column, m; NaN where there is none. Where a boundary folds over, the part seen from above.
    `folded` (sample,): some boundary folds over, so that the two depths do not say all.
    """

    depth_sbc: Floats
    folded: NDArray[np.bool_]


def column_laterals(study: SliceStudy) -> Floats:
    """Return the centres of a slice's columns (column,), m from its middle."""
    return np.asarray((np.arange(study.columns) + 0.5 - 0.5 * study.columns) * study.pixel_m)


def wall_boundaries(
    curves_sbnc: NDArray[np.floating],
    gap_m: Floats,
    tilt_rad: Floats,
    framing: Framing,
    study: SliceStudy,
    motion: SectionMotion | None = None,
) -> WallBoundaries:
    """Cut walls by their B-scan planes and return the boundaries in the columns of the slices.

    Args:
        curves_sbnc: walls (`Responses.curves_sbnc`), m; material that the slice shows must not be left out.
        gap_m: distance of the plane from the needle axis (sample,), m.
        tilt_rad: tilt of the plane (sample,).
        framing: where the section lies in the slice.
        study: size of the slice and of its pixel.
        motion: how far what the planes meet has moved; None: it stays where the curves have it.
    """
    columns_sc = (column_laterals(study) - framing.lateral_m[:, None]) / framing.scale[:, None]
    depth_sbc = np.empty((*curves_sbnc.shape[:2], study.columns))
    folded = np.empty(len(depth_sbc), dtype=bool)
    for start in range(0, len(depth_sbc), BLOCK):
        block = slice(start, start + BLOCK)
        moved = (gap_m[block], motion.of(block)) if motion else None
        from_m = gap_m[block] - moved[1].across_contact if moved else gap_m[block]
        rings = cut_rings(curves_sbnc[block], from_m[:, None, None], tilt_rad[block, None, None])
        depth_sbc[block], folded[block] = depths_at_columns(*rings, columns_sc[block], framing.turn_rad[block], moved)
    depth_sbc *= framing.scale[:, None, None]
    depth_sbc += framing.depth_m[:, None, None]
    return WallBoundaries(depth_sbc, folded)


def fill_boundaries(depth_sbc: Floats, study: SliceStudy) -> NDArray[np.uint8]:
    """Draw walls: 255 in each pixel whose centre lies between the boundaries, else 0.

    Args:
        depth_sbc: boundaries (sample, boundary, column), m below the top edge; NaN: no wall in this column.
        study: size of the slice and of its pixel.

    Returns:
        The slices, shape (sample, rows, columns); a centre on a boundary belongs to what is below it.
    """
    rows = np.rint(depth_sbc * (SNAP / study.pixel_m)) / SNAP - 0.5
    first = np.ceil(np.clip(rows - 0.5 / SNAP, 0.0, study.rows))
    first[np.isnan(first).any(axis=1, keepdims=True).repeat(2, axis=1)] = study.rows
    ends = np.sort(first, axis=1).astype(np.int16)[:, :, None]
    row = np.arange(study.rows, dtype=np.int16)[:, None]
    inside = (row >= ends[:, 0]) & (row < ends[:, 1])
    return inside.view(np.uint8) * np.uint8(WALL)


def draw_slices(
    curves_sbnc: NDArray[np.floating], gap_m: Floats, tilt_rad: Floats, framing: Framing, study: SliceStudy
) -> NDArray[np.uint8]:
    """Return the slices of walls, shape (sample, rows, columns), 255 = wall; arguments of `wall_boundaries`.

    Raises:
        InputError: the plane misses a wall that folds over.
    """
    boundaries = wall_boundaries(curves_sbnc, gap_m, tilt_rad, framing, study)
    images = fill_boundaries(boundaries.depth_sbc, study)
    window = SliceWindow(
        left_m=-0.5 * study.columns * study.pixel_m,
        top_m=0.0,
        columns=study.columns,
        rows=study.rows,
        pixel_m=study.pixel_m,
    )
    for sample in np.flatnonzero(boundaries.folded):
        section = cut_surfaces(curves_sbnc[sample], float(gap_m[sample]), float(tilt_rad[sample]))
        placed = (framing.place(sample, curve) for curve in (section.outer, section.inner))
        images[sample] = fill_section(Section(*placed), window)
    return images
