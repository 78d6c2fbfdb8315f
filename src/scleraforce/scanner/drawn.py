"""A frame drawn as a measured one: the same wall, shadows and lines, other speckle."""

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.bscan import render_bscan
from scleraforce.laboratory.optics import BscanOptics, Line, Shadow, sample_optics
from scleraforce.recording.pixels import Pixels
from scleraforce.scanner.estimate import Estimate
from scleraforce.scanner.imaged_eye import ImagedEye
from scleraforce.scanner.measure import MeasuredFrame
from scleraforce.section.plane import Section
from scleraforce.study import OctStudy, PhantomStudy

BINS = 64
BEYOND_M = 5e-3  # a wall that is seen up to the picture's edge goes on


def oct_of(eye: ImagedEye) -> OctStudy:
    """Return a frame's size, pixels, bits and refractive index as the section of a study."""
    rows, columns = eye.pixels.shape
    return OctStudy(
        width_m=eye.scale.lateral_m * columns,
        depth_m=eye.scale.depth_m * rows,
        columns=columns,
        rows=rows,
        bits=eye.bits,
        refractive_index=eye.scale.refractive_index,
    )


def drawn_alike(frame: MeasuredFrame, phantom: PhantomStudy, rng: np.random.Generator) -> Pixels:
    """Draw a frame with the values that were measured on one, and its wall.

    Args:
        frame: the measured one.
        phantom: what its scanner's other values are drawn from.
        rng: source of the speckle and the noise.

    Returns:
        Counts of the frame's shape and type.
    """
    eye = frame.eye
    scanner = oct_of(eye)
    optics = _optics(frame, sample_optics(phantom, scanner, rng), scanner)
    drawn = render_bscan(_section(eye, scanner), scanner, optics, rng).frame
    return drawn.astype(np.uint8) if eye.pixels.dtype == np.uint8 else drawn


def histogram_overlap(one: NDArray[np.generic], other: NDArray[np.generic], top: int) -> float:
    """Return the share that two frames' histograms have in common: 1 where they are alike.

    >>> histogram_overlap(np.zeros(4), np.array([0, 0, 255, 255]), 255)
    0.5
    """
    first, second = (np.histogram(counts, BINS, (0, top + 1))[0] / counts.size for counts in (one, other))
    return float(np.minimum(first, second).sum())


def _optics(frame: MeasuredFrame, drawn: BscanOptics, scanner: OctStudy) -> BscanOptics:
    known = {item.name for item in fields(BscanOptics)}
    measured = {
        name: found.value for name, found in frame.values.items() if isinstance(found, Estimate) and name in known
    }
    lateral_m = scanner.width_m / scanner.columns
    shadows = tuple(
        Shadow(
            centre_m=(shadow.column + 0.5) * lateral_m - scanner.width_m / 2,
            width_m=shadow.width_m,
            loss_fraction=shadow.loss_fraction,
        )
        for shadow in frame.shadows
    )
    lines = tuple(
        Line(depth_m=line.depth_m, level_db=line.level_db, thickness_m=line.thickness_m) for line in frame.lines
    )
    return replace(drawn, **measured, shadows=shadows, lines=lines, covers=())  # type: ignore[arg-type]  # floats


def _section(eye: ImagedEye, scanner: OctStudy) -> Section:
    """Return a frame's wall as a section: lateral from the middle, geometric depth from the top edge, m."""
    columns = np.flatnonzero(eye.walled)
    lateral_m = (columns + 0.5) * eye.scale.lateral_m - scanner.width_m / 2
    outer_m = (eye.surface_row[columns] + 0.5) * eye.scale.depth_m
    inner_m = outer_m + (eye.wall.inner_row - eye.wall.outer_row)[columns] * eye.row_m
    curves = []
    for depth_m in (outer_m, inner_m):
        curve = np.stack([lateral_m, depth_m], axis=1)
        before, after = ([[end[0] + side * BEYOND_M, end[1]]] for side, end in ((-1, curve[0]), (1, curve[-1])))
        left, right = eye.bands
        parts = [before] * bool(columns[0] <= left + 1) + [curve]
        parts += [after] * bool(columns[-1] >= len(eye.walled) - right - 2)
        curves.append(np.concatenate(parts))
    return Section(*curves)
