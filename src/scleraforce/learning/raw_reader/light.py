"""How the frames of a training are lit, and what lies in them beside the wall: optics, conjunctivas, needles."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.bscan import DrawnShaft, draw_shaft
from scleraforce.laboratory.light import BscanOptics, sample_conjunctiva, sample_needle, sample_optics
from scleraforce.library import OUTER
from scleraforce.segmentation.frame_window import FrameWindow
from scleraforce.study import RawReaderStudy, Study, draw, fixed

Floats = NDArray[np.float64]


def largest_needle_gap(raw: RawReaderStudy) -> float:
    """Return how far from a needle's axis a frame still is drawn with it, m."""
    return raw.needle_gap_fraction * raw.needle_diameter_m.bounds[1]


def draw_optics(study: Study, needle_gap_m: float | None, rng: np.random.Generator) -> BscanOptics:
    """Draw the optics of one frame: of the scanner of `[phantom]`, or another one within `[raw_reader]`.

    Args:
        study: with both.
        needle_gap_m: from the axis of a needle that crosses the frame; None: none does.
        rng: source of all randomness.
    """
    raw, phantom = study.raw_reader, study.phantom
    optics, coarser = sample_optics(phantom, study.oct, rng), draw(raw.speckle_factor, rng)
    if rng.random() < raw.conjunctiva_share:
        phantom = replace(phantom, conjunctiva_thickness_m=fixed(draw(raw.conjunctiva_thickness_m, rng)))
    needle = None
    if needle_gap_m is not None:
        diameter_m = max(draw(raw.needle_diameter_m, rng), needle_gap_m / raw.needle_gap_fraction)
        needle = sample_needle(replace(phantom, needle_count=fixed(1)), diameter_m, needle_gap_m, rng)
    return replace(
        optics,
        snr_db=optics.snr_db - draw(raw.snr_loss_db, rng),
        axial_resolution_m=coarser * optics.axial_resolution_m,
        lateral_resolution_m=coarser * optics.lateral_resolution_m,
        conjunctiva=sample_conjunctiva(phantom, rng),
        needle=needle,
    )


def draw_shafts(
    optics: Sequence[BscanOptics],
    depth_sbc: Floats,
    contact_m: Floats,
    rotation_rad: Floats,
    study: Study,
    window: FrameWindow,
) -> list[DrawnShaft]:
    """Return the needles of frames in a window's cells; none where the optics have none.

    Args:
        optics: of the frames.
        depth_sbc: the walls' boundaries (frame, boundary, column), m; a needle's tip touches the outer one.
        contact_m: lateral place of the contact (frame,), m from the middle.
        rotation_rad: of the sections in their frames (frame,).
        study: with the scanner's `[oct]`.
        window: what is seen.
    """
    cells = replace(
        study.oct,
        width_m=window.columns * window.column_m,
        depth_m=window.rows * window.row_m,
        columns=window.columns,
        rows=window.rows,
    )
    places = zip(optics, depth_sbc[:, OUTER], contact_m.tolist(), rotation_rad.tolist(), strict=True)
    return [
        draw_shaft(each.needle, np.array([at_m, np.interp(at_m, window.laterals_m, outer_m)]), turn_rad, cells)
        for each, outer_m, at_m, turn_rad in places
        if each.needle is not None
    ]
