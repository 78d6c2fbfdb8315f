"""The shipped network's reading in ONNX Runtime, in PyTorch, and with weights of 8
bits.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.onnx_network import network_session
from scleraforce.reading.force_network import (
    ForceNetwork,
    eye_for_network,
    given_inputs,
    given_modulus,
    histogram_reading,
    ratio_edges,
)
from scleraforce.reading.reading_models import SHIFTS
from scleraforce.records.model_folder import NETWORK_FILE, SHIPPED_READER
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import boundary_slices
from speed.eyes import draw_eyes, shipped_reader
from speed.record import Table, rows_beside
from speed.run import Run

ONNX = "ONNX Runtime (shipped)"
TORCH = "PyTorch"
INT8 = "ONNX Runtime, int8"
SETTINGS = """Two slices of a frame and the known inputs, to force and interval; one
thread, in turns, calls after each other. "difference" is the largest difference of the
force over the frames, from the bundled network."""
WORDS = {
    ONNX: "`model.onnx` as it ships, 32 bits",
    TORCH: "the same weights in the module that was trained, `inference_mode`",
    INT8: (
        "`onnxruntime.quantization.quantize_static` of convolutions and layers, its"
        " ranges from half of the frames"
    ),
}
Slices = NDArray[np.uint8]
Read = Callable[[Slices, Setup], float]


def measure(run: Run) -> Table:
    """Read the same slices in three ways, in turns."""
    reader = shipped_reader()
    study = reader.study
    inputs: list[tuple[Slices, Setup]] = []
    for eye in draw_eyes(reader, run.count(48, 6)):
        wall = find_wall(eye.frame, eye.scale)
        cuts, *_ = boundary_slices(wall, eye.scale, study.slice, SHIFTS)
        inputs.append((cuts, eye.setup))

    network = (SHIPPED_READER / NETWORK_FILE).read_bytes()
    small = _quantized(network, run.folder, inputs[::2], study)
    ways: dict[str, Read] = {
        ONNX: _by_onnx(network, study),
        TORCH: _by_torch(network, study),
        INT8: _by_onnx(small, study),
    }
    taken_ms: dict[str, list[float]] = {name: [] for name in ways}
    forces_mn: dict[str, list[float]] = {name: [] for name in ways}
    for cuts, known in inputs * run.count(40, 2):
        for name, read in ways.items():
            start_s = perf_counter()
            force_n = read(cuts, known)
            taken_ms[name].append(1e3 * (perf_counter() - start_s))
            forces_mn[name].append(1e3 * force_n)

    off_mn = {
        name: np.abs(np.subtract(found, forces_mn[ONNX]))
        for name, found in forces_mn.items()
    }
    more = {
        name: {
            "difference, mN": float(found.max()),
            "in the mean, mN": float(found.mean()),
        }
        for name, found in off_mn.items()
    }
    rows = rows_beside(taken_ms, ONNX, "ms", settings=WORDS, more=more)
    return Table("The network's reading", SETTINGS, rows)


def _by_onnx(network: bytes, study: Study) -> Read:
    reading = ForceNetwork(network_session(network, "", 1), study, "")
    return lambda cuts, known: reading.read(cuts, known).force_n


def _by_torch(network: bytes, study: Study) -> Read:
    import onnx
    import torch

    from scleraforce.lab.training.force_reader_training import ReaderNetwork, histogram

    torch.set_num_threads(1)
    module = ReaderNetwork(study.reader, study.slice, study.eye.radius_m).eval()
    weights = {
        entry.name.removeprefix("network."): onnx.numpy_helper.to_array(entry)
        for entry in onnx.load_from_string(network).graph.initializer
    }
    module.load_state_dict(
        {name: torch.from_numpy(weights[name].copy()) for name in module.state_dict()}
    )
    edges_m2 = ratio_edges(study.reader.bins, study.reader.max_force_ratio).tolist()

    def read(cuts: Slices, setup: Setup) -> float:
        slices = torch.from_numpy((cuts > 0).astype(np.float32))
        with torch.inference_mode():
            mixture, _ = module(slices, torch.from_numpy(_given(cuts, setup, study)))
            mean = histogram(mixture, study.reader.bins).mean(dim=0).tolist()

        modulus_pa, _ = given_modulus(eye_for_network(setup), study.reader)
        return histogram_reading(
            mean, edges_m2, float(modulus_pa[0]), study.classes.bounds_n
        ).force_n

    return read


def _given(cuts: Slices, setup: Setup, study: Study) -> NDArray[np.float32]:
    """Return the known inputs of each slice."""
    given = given_inputs(eye_for_network(setup), study.reader)
    return np.repeat(given, len(cuts), axis=0)


def _quantized(
    network: bytes, folder: Path, inputs: list[tuple[Slices, Setup]], study: Study
) -> bytes:
    """Return the network with weights and signals of 8 bits, their ranges taken from
    some inputs.
    """
    from onnxruntime.quantization import (  # type: ignore[import-untyped]  # no types
        CalibrationDataReader,
        QuantFormat,
        quantize_static,
    )

    class Samples(CalibrationDataReader):  # type: ignore[misc]  # as above
        """The inputs that the ranges are taken from."""

        def __init__(self) -> None:
            self._left: Iterator[tuple[Slices, Setup]] = iter(inputs)

        def get_next(self) -> dict[str, Any] | None:
            """Return the next inputs; None in the end."""
            for cuts, setup in self._left:
                return {"slices": cuts, "given": _given(cuts, setup, study)}
            return None

    before = folder / "fp32.onnx"
    after = folder / "int8.onnx"
    before.write_bytes(network)
    quantize_static(
        before,
        after,
        Samples(),
        QuantFormat.QDQ,
        per_channel=True,
        op_types_to_quantize=["Conv", "Gemm"],
    )

    return after.read_bytes()
