"""The shipped network's reading in ONNX Runtime, in PyTorch, and with weights of 8
bits.
"""

from collections.abc import Callable
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
from speed.record import Row, Table, spread
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
    eyes = draw_eyes(reader, run.count(48, 6))
    found = [find_wall(eye.frame, eye.scale) for eye in eyes]
    cuts = [
        boundary_slices(seen, e.scale, reader.study.slice, SHIFTS)[0]
        for seen, e in zip(found, eyes, strict=True)
    ]
    network = (SHIPPED_READER / NETWORK_FILE).read_bytes()
    small = _quantized(
        network, run.folder, list(zip(cuts, eyes, strict=True))[::2], reader.study
    )
    ways: dict[str, Read] = {
        ONNX: _by_onnx(network, reader.study),
        TORCH: _by_torch(network, reader.study),
        INT8: _by_onnx(small, reader.study),
    }
    times: dict[str, list[float]] = {name: [] for name in ways}
    forces_n: dict[str, list[float]] = {name: [] for name in ways}

    for number in range(len(eyes) * run.count(40, 2)):
        cut = cuts[number % len(eyes)]
        known = eyes[number % len(eyes)].setup

        for name, read in ways.items():
            start = perf_counter()
            force_n = read(cut, known)
            times[name].append(1e3 * (perf_counter() - start))
            forces_n[name].append(force_n)

    medians = {name: spread(taken) for name, taken in times.items()}
    off_mn = {
        name: 1e3 * np.abs(np.subtract(forces_n[name], forces_n[ONNX])) for name in ways
    }
    rows = [
        Row(
            what=name,
            unit="ms",
            **medians[name],
            beside=ONNX if name != ONNX else "",
            beside_value=medians[ONNX]["value"] if name != ONNX else None,
            settings=WORDS[name],
            more={
                "difference, mN": float(off_mn[name].max()),
                "in the mean, mN": float(off_mn[name].mean()),
            },
        )
        for name in ways
    ]

    return Table("The network's reading", SETTINGS, tuple(rows))


def _by_onnx(network: bytes, study: Study) -> Read:
    reading = ForceNetwork(network_session(network, "", 1), study, "")
    return lambda cuts, known: reading.read(cuts, known).force_n


def _by_torch(network: bytes, study: Study) -> Read:
    import onnx
    import torch

    from scleraforce.lab.training.force_reader_training import ReaderNetwork, histogram

    torch.set_num_threads(1)
    module = ReaderNetwork(study.reader, study.slice, study.eye.radius_m).eval()
    stored = {
        entry.name: onnx.numpy_helper.to_array(entry)
        for entry in onnx.load_from_string(network).graph.initializer
    }
    names = {
        name: f"network.{name}" if f"network.{name}" in stored else _stored_name(name)
        for name in module.state_dict()
    }
    module.load_state_dict(
        {name: torch.from_numpy(stored[names[name]].copy()) for name in names},
        strict=True,
    )
    edges_m2 = ratio_edges(study.reader.bins, study.reader.max_force_ratio).tolist()

    def read(cuts: Slices, setup: Setup) -> float:
        told = eye_for_network(setup)
        given = np.repeat(given_inputs(told, study.reader), len(cuts), axis=0)

        with torch.inference_mode():
            mixture, _ = module(
                torch.from_numpy((cuts > 0).astype(np.float32)), torch.from_numpy(given)
            )
            mean = histogram(mixture, study.reader.bins).mean(dim=0).tolist()

        modulus_pa, _ = given_modulus(told, study.reader)
        return histogram_reading(
            mean, edges_m2, float(modulus_pa[0]), study.classes.bounds_n
        ).force_n

    return read


def _stored_name(name: str) -> str:
    """Return what a graph that was written node by node, as of readers until 2026,
    calls a tensor of the module.

    >>> _stored_name("convolutions.1.weight"), _stored_name("given_layer.bias")
    ('weight1', 'known_linear_bias')
    >>> _stored_name("circle")
    'circle'
    """
    layer, _, rest = name.partition(".")
    number, _, kind = rest.rpartition(".")
    prefix = {
        "given_layer": "known_linear_",
        "hidden": f"linear{number}_",
        "force": "mixture_",
        "place": "place_mm_",
    }

    if layer == "convolutions":
        return f"{kind}{number}"

    return f"{prefix[layer]}{kind}" if layer in prefix else name


def _quantized(network: bytes, folder: Path, samples: list[Any], study: Study) -> bytes:
    """Return the network with weights and signals of 8 bits, their ranges taken from
    samples.
    """
    from onnxruntime.quantization import (  # type: ignore[import-untyped]  # no types
        CalibrationDataReader,
        QuantFormat,
        quantize_static,
    )

    class Samples(CalibrationDataReader):  # type: ignore[misc]  # as above
        """The inputs that the ranges are taken from."""

        def __init__(self) -> None:
            self._left = iter(samples)

        def get_next(self) -> dict[str, Any] | None:
            """Return the next inputs; None in the end."""
            found = next(self._left, None)
            if found is None:
                return None
            cuts, eye = found
            given = given_inputs(eye_for_network(eye.setup), study.reader)
            return {"slices": cuts, "given": np.repeat(given, len(cuts), axis=0)}

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
