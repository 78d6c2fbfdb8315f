"""The wall of a frame drawn into slices: `slice.boundary_slices` as compiled loops."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.compiled import compiled
from scleraforce.segmentation.kernels.across import straight_line

Floats = NDArray[np.float64]


@compiled
def draw_boundary_slices(
    outer_row: Floats, inner_row: Floats, places: tuple[Floats, NDArray[np.intp], NDArray[np.bool_]], depth_m: float,
    refractive_index: float, row_depths_m: Floats,
) -> NDArray[np.uint8]:  # fmt: skip
    """Return the slices, shape (shift, row, column).

    Args:
        outer_row: of the boundary (frame's column,), rows of pixel centres, NaN where there is no wall; and
        inner_row: likewise.
        places: of the slice's columns in the frame, the nearest columns, and which are in the frame; (column,) each.
        depth_m: of a row of the frame, optical.
        refractive_index: of the tissue.
        row_depths_m: depth of the slices' rows, (shift, row, 1).
    """
    at, nearest, inside = places
    there = np.empty(len(outer_row), np.intp)  # the columns with a wall
    number = 0
    for column in range(len(outer_row)):
        if np.isfinite(outer_row[column]) and np.isfinite(inner_row[column]):
            there[number] = column
            number += 1
    outer_m, inner_m = np.full(len(at), np.nan), np.full(len(at), np.nan)
    behind = 0
    for column in range(len(at)):
        here, near = at[column], nearest[column]
        if not (inside[column] and np.isfinite(outer_row[near]) and np.isfinite(inner_row[near])):
            continue
        while behind < number - 1 and there[behind + 1] <= here:
            behind += 1
        left, right = there[behind], there[min(behind + 1, number - 1)]
        outer, inner = outer_row[left], inner_row[left]
        if left < here and right > left:
            outer = straight_line(here, left, right, outer, outer_row[right])
            inner = straight_line(here, left, right, inner, inner_row[right])
        outer_m[column] = (outer + 0.5) * depth_m
        inner_m[column] = outer_m[column] + ((inner + 0.5) * depth_m - outer_m[column]) / refractive_index
    shifts, rows, _ = row_depths_m.shape
    walls = np.empty((shifts, rows, len(at)), np.uint8)
    for shift in range(shifts):
        for row in range(rows):
            middle_m, line = row_depths_m[shift, row, 0], walls[shift, row]
            for column in range(len(at)):
                line[column] = 255 if outer_m[column] <= middle_m < inner_m[column] else 0
    return walls
