"""Raw frame to mask of the corneoscleral wall, and a verdict whether that can be judged.

`docs/segmentation.md` explains the steps. They are taken by NumPy and OpenCV alone (`numpy_steps`), or compiled where a
process has asked for that (`compiling`): this runs in the control loop.
"""

from dataclasses import replace

import numpy as np

from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.compiling import wall_is_compiled
from scleraforce.segmentation.imaged import LEAST_SHAPE
from scleraforce.segmentation.needle import find_shaft, needle_of
from scleraforce.segmentation.numpy_steps import NumpySteps
from scleraforce.segmentation.steps import Part, Segmentation, Steps, part_of, without_wall

LEAST_SIDE = 0.05  # of the imaged width: less beside a needle is not looked at

_NUMPY_STEPS = NumpySteps()
_compiled_steps: list[Steps] = []  # those that no thread uses at the moment; each owns the memory that it works in


def find_wall(frame: Pixels, scale: PixelScale) -> Segmentation:
    """Find the wall in a frame.

    Args:
        frame: counts, uint8 or uint16, shape (row, column); rows go down into the eye.
        scale: size of the frame's pixel, with the refractive index.

    Returns:
        Boundaries, mask and verdict; a frame without a wall has NaN boundaries and an empty mask.

    Raises:
        ValueError: not such an array, or smaller than 16 x 16.
    """
    if not wall_is_compiled():
        return find_wall_by(_NUMPY_STEPS, frame, scale)
    try:
        steps = _compiled_steps.pop()
    except IndexError:
        steps = _new_compiled_steps()
    try:
        return find_wall_by(steps, frame, scale)
    finally:
        _compiled_steps.append(steps)


def _new_compiled_steps() -> Steps:
    # Imported here: Numba takes longer than a frame does.
    from scleraforce.segmentation.compiled_steps import CompiledSteps

    return CompiledSteps()


def find_wall_by(steps: Steps, frame: Pixels, scale: PixelScale) -> Segmentation:
    """Find the wall in a frame by some steps; arguments, result and errors are those of `find_wall`."""
    _check(frame)
    found = steps.at_once(frame, scale)
    if found is not None:
        return found
    lit = steps.lit_columns(frame)
    if lit is None:
        return without_wall(frame.shape, "the frame is empty: all pixels are alike")
    left, missing, brightest = lit
    part = part_of(frame, scale, left, missing)
    fault, suspected = steps.glance(part, brightest)
    if fault:
        return without_wall(frame.shape, fault)
    shaft = find_shaft(part.imaged, part.grid) if suspected else None
    if shaft is None:
        return steps.found(part)
    needle = needle_of(shaft, part.grid, left, frame.shape[1])
    beside = _beside(frame, part, shaft.hidden)
    if beside is None:
        return without_wall(frame.shape, "the needle and its shadow hide the wall", needle)
    found = replace(steps.found(beside), needle=needle)
    for boundary in (found.outer_row, found.inner_row):
        boundary[slice(*needle.hidden)] = np.nan
    return found


def _beside(frame: Pixels, part: Part, hidden: tuple[int, int]) -> Part | None:
    """Return what a frame shows beside a needle that hides a span of its imaged part; None: hardly anything.

    What it hides is filled from both sides, so that the paths that are looked for lead on behind it. A side that is
    narrower than the smoothing of the surface is left out.
    """
    (first, after), missing = hidden, part.missing
    least = max(LEAST_SHAPE, round(LEAST_SIDE * len(missing)))
    start, stop = (after if first < least else 0), (first if len(missing) - after < least else len(missing))
    if stop - start < least:
        return None
    inside = (first - start, after - start) if start < first and after < stop else None
    filled = missing[start:stop].copy()
    if inside is not None:
        filled[slice(*inside)] = True
    lit = np.flatnonzero(~filled)
    if not len(lit):
        return None
    start, filled = start + int(lit[0]), filled[lit[0] : lit[-1] + 1]
    inside = None if inside is None else (inside[0] - int(lit[0]), inside[1] - int(lit[0]))
    return part_of(frame, part.scale, part.left + start, filled, inside)


def _check(frame: Pixels) -> None:
    if frame.ndim != 2 or frame.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"a frame of {frame.ndim} dimensions and type {frame.dtype}: give rows x columns of counts")
    if min(frame.shape) < LEAST_SHAPE or max(frame.shape) > 2**15:
        raise ValueError(f"a frame of {frame.shape[0]} x {frame.shape[1]} pixels: give at least 16 x 16")
