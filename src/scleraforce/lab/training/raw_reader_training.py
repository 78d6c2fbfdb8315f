"""The raw reader: from a raw frame and the known values of the eye to the force,
without a decision on boundaries.

A network like the wall finder's gives distributions of both boundaries' rows. They make
a slice of shares of wall, in the mean over all places of the boundaries, for the slice
network. That learns from drawn slices first; then the wall is learned from raw frames
by the wall finder's loss, and last everything by the force's loss beside it.
"""

from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Floats
from scleraforce.base.onnx_network import network_session
from scleraforce.lab.drawn_bscan import DrawnShaft, draw_reduced, draw_shaft
from scleraforce.lab.tissue_light import (
    BscanOptics,
    sample_conjunctiva,
    sample_needle,
    sample_optics,
)
from scleraforce.lab.training import interval_measurement, reader_samples
from scleraforce.lab.training.force_reader_training import (
    ReaderNetwork,
    fit_reader,
    reader_loss,
    reader_metrics,
    targets,
)
from scleraforce.lab.training.gradient_descent import (
    Losses,
    Progress,
    TrainingResult,
    drawn_ahead,
    tensor,
    torch,
    train_network,
)
from scleraforce.lab.training.interval_measurement import FRAMES, VirtualEye
from scleraforce.lab.training.reader_samples import (
    RawSamples,
    SampleSource,
    concatenated,
)
from scleraforce.lab.training.wall_network_training import (
    WallFinderNetwork,
    finder_loss,
)
from scleraforce.library import OUTER, Library
from scleraforce.library.plane_cut import column_laterals
from scleraforce.reading import force_network
from scleraforce.reading.frame_checks import read_by_fit
from scleraforce.reading.interval_widths import IntervalScore, score_reading
from scleraforce.records.model_folder import NETWORK_FILE
from scleraforce.records.setup import Setup
from scleraforce.records.study import (
    Range,
    RawReaderStudy,
    ReaderStudy,
    SliceStudy,
    Study,
    draw,
    fixed,
)
from scleraforce.wall.wall_network import FrameWindow

Float = NDArray[np.float32]

FRAMES_TOGETHER = 256  # a chunk, from a generator of its own


class RawReaderNetwork(torch.nn.Module):
    """Mixtures of the force's place and places of the contact, as `ReaderNetwork`'s;
    and the logits of the wall.

    `frames`: reduced, float (n, row, column); `given` (n, len(GIVEN)).
    """

    def __init__(self, study: Study, reads_slices: ReaderNetwork) -> None:
        """Build the network with random weights (from PyTorch's generator), before one
        that reads slices.
        """
        super().__init__()
        self.sees_wall = WallFinderNetwork(study.raw_reader.wall)
        self.reads_slices = reads_slices
        window = FrameWindow.of(study.raw_reader)
        self.down: torch.Tensor
        self.along: torch.Tensor

        for name, weights in zip(
            ("down", "along"), _slice_weights(window, study.slice), strict=True
        ):
            self.register_buffer(name, torch.from_numpy(weights))

        # of its input
        self.bins = reads_slices.bins
        self.example = torch.zeros(2, window.rows, window.columns)

    def forward(
        self, frames: torch.Tensor, given: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return mixtures, the contact's places in mm, and logits of the boundaries'
        rows and of there being wall.
        """
        row_logits, wall_logits = self.sees_wall(frames)
        mixtures, places = self.reads_slices(
            self.slices(row_logits, wall_logits), given
        )
        return mixtures, places, row_logits, wall_logits

    def slices(
        self, row_logits: torch.Tensor, wall_logits: torch.Tensor
    ) -> torch.Tensor:
        """Return the share of each pixel of the slices that is wall (n, row,
        column).
        """
        of_row = row_logits.softmax(dim=2)
        outer, inner = (of_row.cumsum(dim=2) - 0.5 * of_row).unbind(1)
        wall = (outer - inner).clamp(min=0.0) * wall_logits.sigmoid()[:, None]
        return self.down @ wall @ self.along


def _slice_weights(window: FrameWindow, study: SliceStudy) -> tuple[Float, Float]:
    """Return the weights of a window in a slice: of means over its rows, and that
    interpolate between its column pairs.

    Shapes (row of the slice, row of the window) and (pair of the window's columns,
    column of the slice).
    """
    edges = np.arange(window.rows + 1) * window.row_m
    pixels = np.arange(study.rows + 1)[:, None] * study.pixel_m
    covered: Floats = (
        np.diff(np.clip(edges, pixels[:-1], pixels[1:]), axis=1) / study.pixel_m
    )
    pairs_m = window.laterals_m.reshape(-1, 2).mean(axis=1)
    between: Floats = np.stack(
        [
            np.interp(column_laterals(study), pairs_m, each)
            for each in np.eye(len(pairs_m))
        ]
    )

    return covered.round(6).astype(np.float32), between.astype(np.float32)


def draw_optics(
    study: Study, needle_gap_m: float | None, rng: np.random.Generator
) -> BscanOptics:
    """Draw a frame's optics within `[phantom]` and `[raw_reader]`; a needle's axis is
    `needle_gap_m` off, if any.
    """
    raw = study.raw_reader
    phantom = study.phantom
    optics = sample_optics(phantom, study.oct, rng)
    coarser = draw(raw.speckle_factor, rng)

    if rng.random() < raw.conjunctiva_share:
        phantom = replace(
            phantom,
            conjunctiva_thickness_m=fixed(draw(raw.conjunctiva_thickness_m, rng)),
        )

    needle = None
    if needle_gap_m is not None:
        diameter_m = max(
            draw(raw.needle_diameter_m, rng), needle_gap_m / raw.needle_gap_fraction
        )
        needle = sample_needle(
            replace(phantom, needle_count=fixed(1)), diameter_m, needle_gap_m, rng
        )

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
) -> list[DrawnShaft]:
    """Return the needles of reduced frames; frames without a needle in their optics
    give none.
    """
    window = FrameWindow.of(study.raw_reader)
    width_m = window.columns * window.column_m
    depth_m = window.rows * window.row_m
    cells = replace(
        study.oct,
        width_m=width_m,
        depth_m=depth_m,
        columns=window.columns,
        rows=window.rows,
    )
    places = zip(
        optics,
        depth_sbc[:, OUTER],
        contact_m.tolist(),
        rotation_rad.tolist(),
        strict=True,
    )

    return [
        draw_shaft(
            each.needle,
            np.array([at_m, np.interp(at_m, window.laterals_m, outer_m)]),
            turn_rad,
            cells,
        )
        for each, outer_m, at_m, turn_rad in places
        if each.needle is not None
    ]


class RawSource:
    """A source of samples: the same chunk for the same seed and number."""

    def __init__(self, library: Library, study: Study) -> None:
        """Keep only the part of a library that frames can show: it is quicker."""
        window = FrameWindow.of(study.raw_reader)
        self.columns = SliceStudy(
            columns=window.columns, rows=window.rows, pixel_m=window.column_m
        )
        self.library = SampleSource(library, study.reader, self.columns).library
        self.study = study

    def chunk(self, number: int, count: int = FRAMES_TOGETHER) -> RawSamples:
        """Draw a chunk of samples, shuffled: a share of them is crossed by a needle."""
        raw = self.study.raw_reader
        rng = np.random.default_rng([raw.seed, number])
        beside = self.study.reader
        crossed = int((rng.random(count) < raw.needle_share).sum())
        across = replace(
            beside,
            gap_m=Range(
                min=0.0, max=raw.needle_gap_fraction * raw.needle_diameter_m.bounds[1]
            ),
        )
        parts = [(beside, count - crossed, False), (across, crossed, True)]
        drawn = concatenated(
            [
                self._drawn(reader, many, needle, rng)
                for reader, many, needle in parts
                if many
            ]
        )

        return drawn.picked(rng.permutation(count))

    def _drawn(
        self, reader: ReaderStudy, count: int, needle: bool, rng: np.random.Generator
    ) -> RawSamples:
        """Draw samples of a reader's study, all with a needle or all without."""
        study = self.study
        window = FrameWindow.of(self.study.raw_reader)
        library = reader_samples.library_of_tissue(self.library, reader, rng)
        eyes, framing, depth_sbc = reader_samples.draw_framed(
            library, reader, self.columns, count, rng
        )
        optics = [
            draw_optics(study, gap_m if needle else None, rng)
            for gap_m in eyes.gap_m.tolist()
        ]
        shafts = draw_shafts(
            optics, depth_sbc, framing.lateral_m, eyes.rotation_rad, study
        )
        frames, boundary_rows = draw_reduced(
            depth_sbc, optics, study.oct, window, rng, shafts
        )
        trained = read_by_fit(study.reader)
        # at every second column
        pairs = boundary_rows.reshape(count, 2, -1, 2).mean(axis=3)
        rows = np.clip(pairs, 0.0, window.rows - 1.0).astype(np.float32)
        given = force_network.given_inputs(eyes.stated, trained)
        modulus_pa = force_network.given_modulus(eyes.stated, trained)[0]

        return RawSamples(
            given, eyes.force_n, modulus_pa, framing.lateral_m, frames, rows
        )


def fit_raw_reader(
    library: Library,
    study: Study,
    workers: int,
    progress: Progress = None,
    learned: Progress = None,
    device: str = "cpu",
) -> TrainingResult[RawReaderNetwork]:
    """Train a raw reader; the same study and library give the same weights on the same
    machine.
    """
    raw = study.raw_reader
    gaps = read_by_fit(study.reader)
    on_slices = replace(
        study, reader=replace(gaps, epochs=raw.slice_epochs, seed=raw.seed)
    )
    slices = SampleSource(library, on_slices.reader, study.slice)
    reads_slices = fit_reader(
        on_slices, slices.chunk, workers, progress, device
    ).network
    build = partial(RawReaderNetwork, study, reads_slices)
    losses_of = partial(_losses, study)
    drawn = _batches(RawSource(library, study), raw, workers)

    return train_network(
        build, losses_of, drawn, raw, raw.batches, learned, device=device
    )


def _batches(
    source: RawSource, raw: RawReaderStudy, workers: int
) -> Generator[RawSamples, None, None]:
    """Yield the training's batches, each of frames of its own."""
    frames = raw.batches * raw.batch_size
    left: RawSamples | None = None

    with closing(
        drawn_ahead(source.chunk, range(-(-frames // FRAMES_TOGETHER)), workers)
    ) as chunks:
        for _ in range(raw.batches):
            while left is None or len(left) < raw.batch_size:
                chunk = next(chunks)
                left = chunk if left is None else concatenated([left, chunk])

            yield left.picked(np.arange(raw.batch_size))
            left = left.picked(np.arange(raw.batch_size, len(left)))


def _losses(
    study: Study, network: RawReaderNetwork, number: int, batch: RawSamples
) -> Losses:
    """Return the mean loss of a draw, which is a batch; of the first ones it is the
    wall's alone.
    """
    raw = study.raw_reader
    frames, given, boundaries = (
        tensor(each) for each in (batch.frames, batch.given, batch.boundary_rows)
    )
    mixtures, places, row_logits, wall_logits = network(frames, given)
    loss = finder_loss(
        row_logits,
        wall_logits,
        boundaries,
        torch.ones_like(wall_logits),
        raw.target_rows,
    )

    if number >= raw.wall_share * raw.batches:
        loss = loss + reader_loss(mixtures, places, *targets(batch, study.reader))

    return ((loss, 1),)


def measure_raw_reader(
    network: RawReaderNetwork, source: RawSource, study: Study
) -> dict[str, Any]:
    """Return `metrics` of `model.json`, of `[raw_reader] validation_frames` new
    frames.
    """
    parts = reader_samples.validation_chunks(
        source.chunk, study.raw_reader.validation_frames, FRAMES_TOGETHER
    )
    with torch.inference_mode():
        read = [
            network(torch.from_numpy(part.frames), torch.from_numpy(part.given))[:2]
            for part in parts
        ]

    return reader_metrics(read, concatenated(parts), study)


def measuring_raw(
    study: Study, library: Library, network: bytes
) -> interval_measurement.EyeScores:
    """Return the function that scores an eye, for a process; `network`: of the frames,
    as ONNX.
    """
    reads_frames = force_network.ForceNetwork(
        network_session(network, NETWORK_FILE, 1), study, NETWORK_FILE, raw=True
    )

    def scores(
        number: int, eye: VirtualEye, setup: Setup, _: object, rng: np.random.Generator
    ) -> list[IntervalScore]:
        forces_n = rng.uniform(0.0, eye.largest_n, FRAMES)
        frames = _frames(eye, forces_n, study, rng)
        return [
            score_reading(
                "network",
                reads_frames.read(frame[None], given),
                given,
                str(number),
                float(force_n),
            )
            for given in (setup, interval_measurement.of_population(eye, study, rng))
            for frame, force_n in zip(frames, forces_n, strict=True)
        ]

    return partial(
        interval_measurement.eye_scores, study, library, study.raw_reader.seed, scores
    )


def _frames(
    eye: VirtualEye, forces_n: Floats, study: Study, rng: np.random.Generator
) -> Float:
    """Return reduced frames of an eye under forces (frame, row, column), each with a
    pose and light of its own.
    """
    reader = study.reader
    window = FrameWindow.of(study.raw_reader)
    framing = reader.lateral_m, reader.surface_depth_m, reader.rotation_rad
    poses = (np.array([draw(values, rng) for values in framing]) for _ in forces_n)
    depth_sbc = interval_measurement.wall_depths(
        eye, forces_n, poses, window.laterals_m
    )
    optics = [draw_optics(study, None, rng) for _ in forces_n]

    return draw_reduced(depth_sbc, optics, study.oct, window, rng)[0]
