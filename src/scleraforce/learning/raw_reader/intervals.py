"""How wide a raw reader's intervals have to be: its scores on drawn frames of whole virtual eyes, calibrated before.

The eyes, and how they are calibrated, are those of the slice reader (`learning.reader.virtual_eyes`). What differs is
what is read afterwards: raw frames of them, lit as those of the training.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.calibration.placement import place_section
from scleraforce.errors import CalibrationError
from scleraforce.fitting.placement import Places, curve_depths
from scleraforce.laboratory.reduced_bscans import draw_reduced
from scleraforce.learning.raw_reader.light import draw_optics
from scleraforce.learning.reader.uneven import added_depths
from scleraforce.learning.reader.virtual_eyes import (
    FRAMES,
    VirtualEye,
    calibrated,
    draw_eye,
    draw_frames,
    of_population,
)
from scleraforce.library import Library
from scleraforce.models.folder import NETWORK_FILE
from scleraforce.models.session import network_session
from scleraforce.processes import work_in_order
from scleraforce.reader.interval_factors import group_of
from scleraforce.reader.interval_scores import Score, intervals_record, score
from scleraforce.reader.raw_network import OnnxRawNetwork
from scleraforce.segmentation.frame_window import FrameWindow
from scleraforce.segmentation.grid import Float
from scleraforce.study import Study, draw

__all__ = ["measured_raw_intervals"]

STREAM = 2**30  # of random numbers: the samples' streams are below, those of the validation above
AHEAD = 2  # eyes for each process that are drawn or wait
METHOD = "network"


def measured_raw_intervals(
    study: Study, library: Library, network: bytes, workers: int, progress: Callable[[int], object] | None = None
) -> dict[str, Any]:
    """Return `intervals` of `model.json`: factors, and on how many eyes of which kind they rest.

    Args:
        study: with `[raw_reader]`.
        library: of responses, whole.
        network: of the frames, as ONNX.
        workers: processes.
        progress: called with 1 after each eye.

    Raises:
        SolverError: a worker died.
    """
    prepare = partial(_measuring, study, library, network)
    scores: list[Score] = []
    for of_eye in work_in_order(prepare, range(study.raw_reader.interval_eyes), workers, ahead=AHEAD * workers):
        scores += of_eye
        if progress:
            progress(1)
    return intervals_record(scores, "virtual eyes of the library's walls, drawn as raw frames")


def _measuring(study: Study, library: Library, network: bytes) -> Callable[[int], list[Score]]:
    """Return what scores an eye, in its process."""
    reads_frames = OnnxRawNetwork(network_session(network, NETWORK_FILE, 1), study, NETWORK_FILE)

    def scores_of(number: int) -> list[Score]:
        rng = np.random.default_rng([study.raw_reader.seed, STREAM + number])
        try:
            eye = draw_eye(study, library, number, rng)
            known, _ = calibrated(eye, draw_frames(eye, study, FRAMES, rng), study, library, rng)
        except CalibrationError:  # a corner of the ranges that the library does not have
            return []
        forces_n = rng.uniform(0.0, eye.largest_n, FRAMES)
        frames = _frames(eye, forces_n, study, rng)
        return [
            Score(METHOD, group_of(told), str(number), score(reads_frames.read(frame, told), float(force_n)))
            for told in (known, of_population(eye, study, rng))
            for frame, force_n in zip(frames, forces_n, strict=True)
        ]

    return scores_of


def _frames(eye: VirtualEye, forces_n: NDArray[np.float64], study: Study, rng: np.random.Generator) -> Float:
    """Return reduced frames of an eye under forces (frame, row, column), each in a place and light of its own."""
    reader, window = study.reader, FrameWindow.of(study.raw_reader)
    felt_n = forces_n / (1.0 + eye.drift * (forces_n / eye.largest_n - 0.5))
    states = [replace(eye.wall, force_n=float(force_n)) for force_n in felt_n]
    columns_m = window.laterals_m
    both = Places(np.concatenate([columns_m, columns_m]), np.repeat([0, 1], window.columns))
    radius_m = np.array([eye.model.library.radius_m])
    depth_sbc = np.empty((len(states), 2, window.columns))
    for depths, curves in zip(depth_sbc, eye.model.curves(states), strict=True):
        lateral_m, surface_m = draw(reader.lateral_m, rng), draw(reader.surface_depth_m, rng)
        turn_rad = draw(reader.rotation_rad, rng)
        depth, _, reached = curve_depths(
            place_section(curves, np.array([lateral_m, surface_m, turn_rad, 0.0, 0.0])), both
        )
        form = added_depths(eye.forms, radius_m, (columns_m - lateral_m)[None])[0]
        depths[:] = np.where(reached, depth, np.nan).reshape(2, -1) + form
    optics = [draw_optics(study, None, rng) for _ in states]
    return draw_reduced(depth_sbc, optics, study.oct, window, rng).frames
