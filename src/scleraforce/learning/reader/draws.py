"""Training samples, drawn ahead in other processes: the same whatever their number."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from scleraforce.compiled import use_compiled_loops
from scleraforce.learning.reader.samples import ReaderSamples, concatenated, draw_samples, library_of_tissue
from scleraforce.library import Library
from scleraforce.processes import work_in_order
from scleraforce.study import ReaderStudy, SliceStudy

TISSUE = 400  # samples of one tissue
CHUNK = 2000  # samples that are drawn together, from a generator of their own
AHEAD = 4  # chunks for each process that are drawn or wait
BEYOND_SLICE_M = 0.5e-3  # of the wall that is kept: a tilted or turned section reaches a little farther


@dataclass(frozen=True)
class Source:
    """What samples are drawn from: the same chunk for the same seed and number."""

    library: Library
    reader: ReaderStudy
    slice_study: SliceStudy

    @classmethod
    def of(cls, library: Library, reader: ReaderStudy, slice_study: SliceStudy) -> "Source":
        """Keep of a library what slices can show: it is quicker."""
        low, high = reader.lateral_m.bounds
        half_width_m = 0.5 * slice_study.columns * slice_study.pixel_m
        reach_m = (half_width_m + max(abs(low), abs(high))) / reader.size.bounds[0] + reader.gap_m.bounds[1]
        return cls(library.within(reach_m + BEYOND_SLICE_M), reader, slice_study)

    def chunk(self, number: int, count: int = CHUNK) -> ReaderSamples:
        """Draw a chunk of samples."""
        rng = np.random.default_rng([self.reader.seed, number])
        parts = [min(TISSUE, count - first) for first in range(0, count, TISSUE)]
        libraries = [library_of_tissue(self.library, self.reader, rng) for _ in parts]
        drawn = [
            draw_samples(library, self.reader, self.slice_study, part, rng)
            for library, part in zip(libraries, parts, strict=True)
        ]
        return concatenated(drawn)


def chunks_ahead(source: Source, numbers: Sequence[int], workers: int) -> Generator[ReaderSamples, None, None]:
    """Draw chunks in `workers` processes, a few ahead; yield them in the order of `numbers`.

    The processes end when the generator is closed.

    Raises:
        InputError: what drawing raises; SolverError where a worker died.
    """
    return work_in_order(partial(_drawing, source), numbers, workers, ahead=AHEAD * workers)


def _drawing(source: Source) -> Callable[[int], ReaderSamples]:
    """Return what draws a chunk, in its process."""
    use_compiled_loops()
    return source.chunk
