"""How wide a raw reader's intervals have to be: its scores on drawn frames of whole virtual eyes, calibrated before.

The eyes, and how they are calibrated, are those of the slice reader (`learning.reader.virtual_eyes`). What differs is
what is read afterwards: raw frames of them, lit as those of the training.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.reduced_bscans import draw_reduced
from scleraforce.learning.raw_reader.light import draw_optics
from scleraforce.learning.reader.intervals import STREAM, calibrated_eye, intervals_of, network_score
from scleraforce.learning.reader.virtual_eyes import FRAMES, VirtualEye, of_population, wall_depths
from scleraforce.library import Library
from scleraforce.models.folder import NETWORK_FILE
from scleraforce.models.session import network_session
from scleraforce.reader.intervals import Score
from scleraforce.reader.networks import OnnxRawNetwork
from scleraforce.segmentation.frame_window import FrameWindow
from scleraforce.segmentation.grid import Float
from scleraforce.study import Study, draw


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
    source = "virtual eyes of the library's walls, drawn as raw frames"
    return intervals_of(prepare, study.raw_reader.interval_eyes, workers, source, progress)


def _measuring(study: Study, library: Library, network: bytes) -> Callable[[int], list[Score]]:
    """Return what scores an eye, in its process."""
    reads_frames = OnnxRawNetwork(network_session(network, NETWORK_FILE, 1), study, NETWORK_FILE)

    def scores_of(number: int) -> list[Score]:
        rng = np.random.default_rng([study.raw_reader.seed, STREAM + number])
        drawn = calibrated_eye(study, library, number, rng)
        if drawn is None:
            return []
        eye, known, _ = drawn
        forces_n = rng.uniform(0.0, eye.largest_n, FRAMES)
        frames = _frames(eye, forces_n, study, rng)
        return [
            network_score(reads_frames.read(frame, told), told, str(number), float(force_n))
            for told in (known, of_population(eye, study, rng))
            for frame, force_n in zip(frames, forces_n, strict=True)
        ]

    return scores_of


def _frames(eye: VirtualEye, forces_n: NDArray[np.float64], study: Study, rng: np.random.Generator) -> Float:
    """Return reduced frames of an eye under forces (frame, row, column), each in a place and light of its own."""
    reader, window = study.reader, FrameWindow.of(study.raw_reader)
    framing = reader.lateral_m, reader.surface_depth_m, reader.rotation_rad
    poses = (np.array([*(draw(values, rng) for values in framing), 0.0, 0.0]) for _ in forces_n)
    depth_sbc = wall_depths(eye, forces_n, poses, window.laterals_m)
    optics = [draw_optics(study, None, rng) for _ in forces_n]
    return draw_reduced(depth_sbc, optics, study.oct, window, rng).frames
