"""Drawn raw frames of the library's walls, any number, each of an eye of its own; drawn ahead in other processes."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.reduced_bscans import draw_reduced
from scleraforce.learning.raw_reader.light import draw_optics, draw_shafts, largest_needle_gap
from scleraforce.learning.reader.draws import Source
from scleraforce.learning.reader.samples import concatenated, draw_eyes, draw_walls, library_of_tissue
from scleraforce.library import Library
from scleraforce.library.slices import Framing
from scleraforce.processes import work_in_order
from scleraforce.reader.networks import given_inputs, told_modulus
from scleraforce.reader.verdicts import read_by_fit
from scleraforce.segmentation.frame_window import FrameWindow
from scleraforce.study import Range, ReaderStudy, SliceStudy, Study

Floats = NDArray[np.float64]
Float = NDArray[np.float32]

FRAMES_TOGETHER = 256  # a chunk, from a generator of its own
AHEAD = 4  # chunks for each process that are drawn or wait


@dataclass(frozen=True)
class RawSamples:
    """What the raw reader learns from.

    `frames` float32 (sample, row, column), reduced; `boundary_rows` float32 (sample, boundary, column / 2): of the
    wall, in rows, kept inside the window, NaN where there is none; `given`, `force_n`, `modulus_pa` and `lateral_m` as
    of `ReaderSamples`.
    """

    frames: Float
    boundary_rows: Float
    given: Float
    force_n: Floats
    modulus_pa: Floats
    lateral_m: Floats

    def __len__(self) -> int:
        return len(self.force_n)

    def picked(self, order: NDArray[np.intp]) -> "RawSamples":
        """Return these samples, in this order."""
        return RawSamples(*(getattr(self, item.name)[order] for item in fields(self)))


@dataclass(frozen=True)
class RawSource:
    """What samples are drawn from: the same chunk for the same seed and number."""

    library: Library
    study: Study

    @classmethod
    def of(cls, library: Library, study: Study) -> "RawSource":
        """Keep of a library what frames can show: it is quicker."""
        columns = window_columns(FrameWindow.of(study.raw_reader))
        return cls(Source.of(library, study.reader, columns).library, study)

    def chunk(self, number: int, count: int = FRAMES_TOGETHER) -> RawSamples:
        """Draw a chunk of samples, those that a needle crosses among the others."""
        raw = self.study.raw_reader
        rng = np.random.default_rng([raw.seed, number])
        crossed = int((rng.random(count) < raw.needle_share).sum())
        beside = self.study.reader
        across = replace(beside, gap_m=Range(min=0.0, max=largest_needle_gap(raw)))
        parts = [(beside, count - crossed, False), (across, crossed, True)]
        return concatenated([self._drawn(reader, many, needle, rng) for reader, many, needle in parts if many]).picked(
            rng.permutation(count)
        )

    def _drawn(self, reader: ReaderStudy, count: int, needle: bool, rng: np.random.Generator) -> RawSamples:
        """Draw samples that a needle crosses, or none does, with eyes of a reader's study."""
        study, window = self.study, FrameWindow.of(self.study.raw_reader)
        library = library_of_tissue(self.library, reader, rng)
        eyes = draw_eyes(library, reader, count, rng)
        lateral_m = reader.lateral_m.sample(rng, count)
        framing = Framing(lateral_m, reader.surface_depth_m.sample(rng, count), eyes.size, eyes.rotation_rad)
        depth_sbc = draw_walls(library, reader, eyes, framing, window_columns(window), rng)
        optics = [draw_optics(study, gap_m if needle else None, rng) for gap_m in eyes.gap_m.tolist()]
        shafts = draw_shafts(optics, depth_sbc, lateral_m, eyes.rotation_rad, study, window)
        drawn = draw_reduced(depth_sbc, optics, study.oct, window, rng, shafts)
        trained = read_by_fit(study.reader)
        return RawSamples(
            drawn.frames,
            pair_rows(drawn.boundary_rows, window),
            given_inputs(eyes.told, trained),
            eyes.force_n,
            told_modulus(eyes.told, trained)[0],
            lateral_m,
        )


def window_columns(window: FrameWindow) -> SliceStudy:
    """Return a slice whose columns are those of a window."""
    return SliceStudy(columns=window.columns, rows=window.rows, pixel_m=window.column_m)


def pair_rows(boundary_rows: NDArray[np.floating], window: FrameWindow) -> Float:
    """Return boundaries at every second column, between its neighbours, kept inside the window."""
    pairs = boundary_rows.reshape(*boundary_rows.shape[:2], -1, 2).mean(axis=3)
    kept: Float = np.clip(pairs, 0.0, window.rows - 1.0).astype(np.float32)
    return kept


def raw_chunks_ahead(source: RawSource, numbers: Sequence[int], workers: int) -> Generator[RawSamples, None, None]:
    """Draw chunks in `workers` processes, a few ahead; yield them in the order of `numbers`.

    The processes end when the generator is closed.

    Raises:
        InputError: what drawing raises; SolverError where a worker died.
    """
    return work_in_order(partial(_drawing, source), numbers, workers, ahead=AHEAD * workers)


def _drawing(source: RawSource) -> Callable[[int], RawSamples]:
    """Return what draws a chunk, in its process."""
    return source.chunk
