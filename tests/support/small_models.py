"""Model folders and readers that need no training: their networks give fixed answers,
or train in a moment.
"""

import json
from collections.abc import Sequence
from dataclasses import fields, replace
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from analytic_frames import LIBRARY, STUDY

from scleraforce.library import Library, save_library
from scleraforce.reading.answer import Reading
from scleraforce.reading.force_network import (
    CONTACT,
    GIVEN,
    GIVEN_INPUT,
    HISTOGRAM,
    SLICES,
)
from scleraforce.reading.reading_models import INPUT, OUTPUT, ForceReader
from scleraforce.records.fields import Range, fixed
from scleraforce.records.frame import Pixels
from scleraforce.records.model_folder import LIBRARY_FILE, write_folder
from scleraforce.records.setup import Setup
from scleraforce.records.study import (
    RawReaderStudy,
    ReaderStudy,
    ScenesStudy,
    Study,
    WallFinderStudy,
    format_study,
    study_hash,
)
from scleraforce.wall.wall_network import (
    FINDER_FRAMES,
    FINDER_ROWS,
    FINDER_WALL,
    SeenWall,
    WallFinder,
)


def rehash_model(model: Path, *names: str) -> None:
    """Of files of a model folder."""
    record = json.loads((model / "model.json").read_text())
    record["files"] |= {
        name: sha256((model / name).read_bytes()).hexdigest() for name in names
    }
    (model / "model.json").write_text(json.dumps(record))


def rehash_store(store: Path) -> None:
    """Of the chunks of a data set or a library."""
    metadata = json.loads((store / "zarr.json").read_text())
    for name, hashes in metadata["attributes"]["sha256"].items():
        chunks = store / name / "c"
        files = (file for file in chunks.rglob("*") if file.is_file())
        ordered = sorted(
            files,
            key=lambda file: [int(part) for part in file.relative_to(chunks).parts],
        )
        hashes[:] = [sha256(file.read_bytes()).hexdigest() for file in ordered]

    (store / "zarr.json").write_text(json.dumps(metadata))


def fixed_study(bins: int) -> Study:
    """Return the paper's study with `bins` bins in the reader's histogram."""
    return replace(Study(), reader=replace(Study().reader, bins=bins))


def _network(text: str, study: Study, **weights: np.ndarray) -> bytes:
    """Return the network of a graph in ONNX's own words, with its weights."""
    from onnx import numpy_helper, parser
    from onnx.helper import set_model_props

    model = parser.parse_model(f'<ir_version: 8, opset_import: ["" : 17]> {text}')
    for name, value in weights.items():
        value = value.astype(np.float32) if value.dtype == np.float64 else value
        model.graph.initializer.append(numpy_helper.from_array(value, name))

    set_model_props(model, {"study_sha256": study_hash(study)})
    return model.SerializeToString()


def _write_model(
    path: Path,
    study: Study,
    network: bytes,
    record: dict[str, Any],
    files: dict[str, bytes] | None = None,
) -> None:
    content = (network, format_study(study), "# card\n", record | {"metrics": {}})
    write_folder(path, *content, files or {})


SECOND = np.array([1], dtype=np.int64)


def write_fixed_reader(
    path: Path,
    library: Library,
    shares: Sequence[float],
    contact_m: float = 0.0,
) -> None:
    """Write the folder of a reader."""
    study = fixed_study(len(shares))
    given = len(GIVEN)
    bins = len(shares)
    network = _network(
        f"""fixed (uint8[n, {study.slice.rows}, {study.slice.columns}] {SLICES},
                float[n, {given}] {GIVEN_INPUT})
            => (float[n, {bins}] {HISTOGRAM}, float[n] {CONTACT}) {{
            logits = Gemm({GIVEN_INPUT}, none, shares)
            {HISTOGRAM} = Softmax<axis = 1>(logits)
            places = Gemm({GIVEN_INPUT}, no_place, place)
            {CONTACT} = Squeeze(places, second)
        }}""",
        study,
        none=np.zeros((given, bins)),
        shares=np.log(np.maximum(shares, 1e-12)),
        no_place=np.zeros((given, 1)),
        place=np.array([contact_m]),
        second=SECOND,
    )
    folder = path.parent / f"{path.name}.library"
    save_library(library, folder)
    files = {LIBRARY_FILE: folder.read_bytes()}
    folder.unlink()
    _write_model(path, study, network, {"kind": "reader", "default": "fit"}, files)


def write_classifier(path: Path, study: Study) -> tuple[np.ndarray, np.ndarray]:
    """Write a classifier with random weights; returns weights (pixel, class) and
    biases (class,).
    """
    rng = np.random.default_rng(5)
    rows, columns = study.slice.rows, study.slice.columns
    weights = rng.normal(size=(rows * columns, 3)) * np.sqrt(20.0 / (rows * columns))
    biases = rng.normal(0.0, 0.1, 3)
    network = _network(
        f"""classes (uint8[n, {rows}, {columns}] {INPUT}) => (float[n, 3] {OUTPUT}) {{
            counts = Cast<to = 1>({INPUT})
            pixels = Flatten<axis = 1>(counts)
            lit = Div(pixels, white)
            logits = Gemm(lit, weights, biases)
            {OUTPUT} = Softmax<axis = 1>(logits)
        }}""",
        study,
        white=np.array(255.0),
        weights=weights,
        biases=biases,
    )
    _write_model(path, study, network, {"kind": "classifier"})
    return weights, biases


FIVE_MN = Reading(
    probabilities=(0.1, 0.8, 0.1),
    force_n=0.005,
    interval_n=(0.004, 0.006),
    contact_m=0.3e-3,
)


class FixedNetwork:
    """Reads the same whatever it sees, and keeps what it was shown."""

    def __init__(self, reading: Reading) -> None:
        self.reading = reading
        self.shown: list[tuple[np.ndarray, Setup]] = []

    def read(self, cuts: np.ndarray, setup: Setup) -> Reading:
        self.shown.append((cuts, setup))
        return self.reading


def force_reader(reading: Reading = FIVE_MN, default: str = "fit") -> ForceReader:
    return ForceReader(Path("model"), STUDY, FixedNetwork(reading), LIBRARY, default)


RAW_STUDY = replace(
    Study(),
    reader=ReaderStudy(channels=(6, 8), hidden=(24,), bins=32),
    raw_reader=RawReaderStudy(channels=(4, 6, 8)),
)


def write_raw_model(path: Path) -> None:
    """Write the folder of a raw reader with random weights."""
    rng = np.random.default_rng(3)
    window = RAW_STUDY.raw_reader
    bins = RAW_STUDY.reader.bins
    inputs = len(GIVEN) + 1
    network = _network(
        f"""raw (float[n, {window.rows}, {window.columns}] {FINDER_FRAMES},
                float[n, {len(GIVEN)}] {GIVEN_INPUT})
            => (float[n, {bins}] {HISTOGRAM}, float[n] {CONTACT}) {{
            pixels = Flatten<axis = 1>({FINDER_FRAMES})
            level = ReduceMean<axes = [1], keepdims = 1>(pixels)
            inputs = Concat<axis = 1>(level, {GIVEN_INPUT})
            logits = Gemm(inputs, weights)
            {HISTOGRAM} = Softmax<axis = 1>(logits)
            places = Gemm(inputs, place)
            {CONTACT} = Squeeze(places, second)
        }}""",
        RAW_STUDY,
        weights=rng.normal(size=(inputs, bins)),
        place=1e-4 * rng.normal(size=(inputs, 1)),
        second=SECOND,
    )
    _write_model(path, RAW_STUDY, network, {"kind": "raw-reader"})


def _without_disturbance(record: Any) -> Any:
    """Return a record with shares of 0 and empty counts."""
    shares = {
        item.name: 0.0
        for item in fields(record)
        if isinstance(getattr(record, item.name), float)
    }
    counts = {
        item.name: fixed(0) for item in fields(record) if item.name.endswith("_count")
    }

    return replace(record, **shares, **counts)


def _easy(scenes: ScenesStudy) -> ScenesStudy:
    return ScenesStudy(
        window=replace(
            scenes.window,
            rows=fixed(64),
            columns=fixed(64),
            pixel_m=Range(min=1e-6, max=100e-6),
            width_m=fixed(10e-3),
            depth_share=fixed(0.4),
            centred_share=1.0,
            facing=fixed(1.0),
            surface_share=Range(min=0.1, max=0.4),
        ),
        eye=replace(
            _without_disturbance(scenes.eye), half_sphere_share=1.0, wave_m=fixed(0.0)
        ),
        tissue=replace(
            _without_disturbance(scenes.tissue), corrected_share=1.0, snr_db=fixed(30.0)
        ),
        over=_without_disturbance(scenes.over),
        scanner=replace(_without_disturbance(scenes.scanner), rolloff_db=fixed(0.0)),
    )


SMALL_STUDY = Study(
    scenes=_easy(ScenesStudy()),
    wall_finder=WallFinderStudy(
        rows=32,
        columns=32,
        channels=(8, 12),
        batch_size=8,
        batches=80,
        validation_scenes=12,
        learning_rate=0.01,
    ),
)


def write_blind_finder(folder: Path) -> None:
    """Write the model folder of a network that sees no wall."""
    finder = SMALL_STUDY.wall_finder
    rows, columns = finder.rows, finder.columns // 2
    network = _network(
        f"""blind (float[n, {finder.rows}, {finder.columns}] {FINDER_FRAMES})
            => (float[n, 2, {rows}, {columns}] {FINDER_ROWS},
                float[n, {columns}] {FINDER_WALL}) {{
            pixels = Flatten<axis = 1>({FINDER_FRAMES})
            level = ReduceMean<axes = [1], keepdims = 1>(pixels)
            dark = Mul(level, nothing)
            {FINDER_WALL} = Mul(dark, columns)
            image = Unsqueeze(dark, last)
            flat = Mul(image, shape)
            {FINDER_ROWS} = Add(flat, even)
        }}""",
        SMALL_STUDY,
        nothing=np.zeros(1),
        columns=np.ones(columns),
        last=np.array([2, 3], dtype=np.int64),
        shape=np.ones((2, rows, columns)),
        even=np.full((2, rows, columns), 1.0 / rows),
    )
    provenance = {"study_sha256": study_hash(SMALL_STUDY)}
    record = {"kind": "wall-finder", "provenance": provenance}
    write_folder(folder, network, format_study(SMALL_STUDY), "Blind.", record)


FINDER_STUDY = WallFinderStudy(rows=128, columns=176, channels=(12, 20, 32, 48))


class FixedSession:
    """The part of an ONNX Runtime session that `WallFinder` uses."""

    def __init__(self, rows: np.ndarray, wall: np.ndarray) -> None:
        self._answers = [rows[None].astype(np.float32), wall[None].astype(np.float32)]

    def get_inputs(self) -> list[Any]:
        return [
            SimpleNamespace(
                name=FINDER_FRAMES,
                type="tensor(float)",
                shape=["n", FINDER_STUDY.rows, FINDER_STUDY.columns],
            )
        ]

    def get_outputs(self) -> list[Any]:
        half = FINDER_STUDY.columns // 2
        return [
            SimpleNamespace(
                name=FINDER_ROWS,
                type="tensor(float)",
                shape=["n", 2, FINDER_STUDY.rows, half],
            ),
            SimpleNamespace(name=FINDER_WALL, type="tensor(float)", shape=["n", half]),
        ]

    def run(
        self, _outputs: list[str], _inputs: dict[str, np.ndarray]
    ) -> list[np.ndarray]:
        return self._answers


class FixedFinder(WallFinder):
    """It sees the same, however closely it looks."""

    def _look(self, frame: Pixels, _top: int, _bottom: int) -> SeenWall:
        return super()._look(frame, 0, len(frame))


def distributions(boundary: np.ndarray, sd: float = 0.6) -> np.ndarray:
    """Distributions over rows (row, column) about a boundary (column,); NaN: even."""
    row = np.arange(FINDER_STUDY.rows)[:, None]
    mean = np.nan_to_num(boundary, nan=-1e6)
    log = -np.minimum((row - mean) ** 2 / (2 * sd**2), 80.0)
    weight = np.exp(log - log.max(axis=0))
    return weight / weight.sum(axis=0)


def fixed_finder(outer: np.ndarray, inner: np.ndarray, sd: float = 0.6) -> WallFinder:
    """A wall finder that answers with boundaries, (column / 2,), in rows of the reduced
    frame; NaN: no wall.
    """
    rows = np.stack([distributions(outer, sd), distributions(inner, sd)])
    return FixedFinder(
        FixedSession(rows, np.isfinite(outer).astype(float)), FINDER_STUDY, "drawn"
    )
