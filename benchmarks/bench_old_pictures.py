"""Old pictures and live ones: which pictures the monitor takes for old, after how many
frames, and at what cost.

    python benchmarks/bench_old_pictures.py RECORDING [--frames 300]

RECORDING is a virtual acquisition of `scleraforce phantom` at 100 frames a second; each
of its frames has its own speckle and noise. Eyes at rest whose speckle stays are made
here: a dome of tissue, seen by a phase-stable scanner with noise.
"""

import argparse
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.units import from_si
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.repeated_pictures import ShownPictures
from scleraforce.recordings.recording_folder import read_recording

Counts = NDArray[np.uint8] | NDArray[np.uint16]
SIZE = 512, 512
LIMITS = MonitorLimits()


def alarm_after(
    pictures: Sequence[Counts], first: int
) -> tuple[int | None, int, float]:
    """Return after how many pictures from the `first` one on they are `FROZEN`, how
    many were old, and s for each.
    """
    shown = ShownPictures(LIMITS.shown_frames)
    repeats = 1
    returns = [False] * LIMITS.shown_frames
    old = 0
    alarm = None
    taken_s = []

    for number, picture in enumerate(pictures):
        begun_s = perf_counter()
        back = shown.back(picture)
        taken_s.append(perf_counter() - begun_s)
        repeats = repeats + 1 if back == 1 else 1
        returns = [*returns[1:], back > 1]
        frozen = repeats >= LIMITS.frozen_frames or (
            back > 1 and sum(returns) >= LIMITS.frozen_frames - 1
        )
        old += back > 0

        if frozen and alarm is None:
            alarm = number - first + 1

    return alarm, old, float(np.median(taken_s))


def still_eye(
    rng: np.random.Generator, snr_db: float, *, bits: int, motion: float = 0.0
) -> Iterator[Counts]:
    """Yield frames of a dome at rest, of fixed speckle: `motion` is how far it moves in
    depth, in pixels a frame.
    """
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    below = rows - 150 - ((columns - 256) / 256) ** 2 * 120
    amplitude = 10 ** (snr_db / 20) * np.where(
        (below > 0) & (below < 160), np.exp(-below / 160), 0.0
    )
    tissue = amplitude * _normal(rng)
    wave = 2j * np.pi * np.fft.fftfreq(SIZE[0])[:, None]
    spectrum = np.fft.fft(tissue, axis=0)

    for number in range(10**6):
        seen = (
            tissue
            if not motion
            else np.fft.ifft(spectrum * np.exp(-wave * motion * number), axis=0)
        )
        level_db = 20 * np.log10(np.abs(seen + _normal(rng)))
        yield np.clip((2**bits - 1) * (level_db + 10) / 50, 0, 2**bits - 1).astype(
            np.uint16
        )


def _normal(rng: np.random.Generator) -> NDArray[np.complex64]:
    real, imaginary = rng.standard_normal((2, *SIZE), np.float32)
    return np.asarray((real + 1j * imaginary) / np.sqrt(2), np.complex64)


def recursive(live: Sequence[Counts], old: float) -> Sequence[Counts]:
    """Return what a filter shows that keeps a share of the last picture."""
    shown = []
    mean = live[0].astype(np.float64)
    for picture in live:
        mean = old * mean + (1 - old) * picture
        shown.append(np.rint(mean).astype(np.uint16))
    return shown


def halves(live: Sequence[Counts], stuck: tuple[slice, slice]) -> Sequence[Counts]:
    """Return live pictures with one part of the first one."""
    shown = [picture.copy() for picture in live]
    for picture in shown:
        picture[stuck] = live[0][stuck]
    return shown


def overlaid(first: Counts, count: int, rng: np.random.Generator) -> Sequence[Counts]:
    """Return one picture with a strip of noise that wanders over it."""
    shown = [first.copy() for _ in range(count)]
    for number, picture in enumerate(shown):
        rows, columns = picture.shape
        left = 7 * number % (columns - 60)
        picture[:, left : left + 60] = rng.integers(0, 4096, (rows, 60))
    return shown


def faults(
    live: Sequence[Counts], rng: np.random.Generator
) -> Iterator[tuple[str, Sequence[Counts]]]:
    """Yield series of old pictures that are made from live ones, with their names."""
    first = live[0]
    numbers = range(len(live))
    whole = first.astype(np.float64)
    top = float(first.max())
    yield "stuck", [first for _ in numbers]
    yield "offset moves by a count a frame", [_counts(whole + n) for n in numbers]
    yield (
        "gain grows by 0.5 % a frame",
        [_counts(whole * (1 + 0.005 * n)) for n in numbers],
    )
    yield (
        "gamma grows by 1 % a frame",
        [_counts(top * (whole / top) ** (1 + 0.01 * n)) for n in numbers],
    )
    yield (
        "16 and 8 bits in turns",
        [first if n % 2 else (first >> 4).astype(np.uint8) for n in numbers],
    )
    yield "scrolls by a row a frame", [np.roll(first, n, axis=0) for n in numbers]
    yield "scrolls by a column a frame", [np.roll(first, n, axis=1) for n in numbers]
    yield (
        "scrolls by two rows a frame",
        [np.roll(first, 2 * n, axis=0) for n in numbers],
    )
    yield (
        "jitters by a row and a column",
        [np.roll(first, tuple(rng.integers(-1, 2, 2)), (0, 1)) for _ in numbers],
    )
    yield "two in turns", [live[n % 2] for n in numbers]
    yield (
        "three in turns, offset moves",
        [_counts(live[n % 3] + float(n)) for n in numbers],
    )
    yield "a wandering strip of 60 columns", overlaid(first, len(live), rng)
    yield "left half stuck", halves(live, (slice(None), slice(256)))
    yield "middle half stuck", halves(live, (slice(None), slice(128, 384)))
    yield "lower half stuck", halves(live, (slice(256, None), slice(None)))
    yield "a quarter stuck", halves(live, (slice(256), slice(256)))

    for counts in (1, 30, 300, 1000):
        noisy = [_counts(whole + rng.normal(0, counts, first.shape)) for _ in numbers]
        yield f"fresh noise of {counts} counts", noisy

    for old in (0.95, 0.8, 0.6, 0.5, 0.4):
        yield (
            f"{old:.0%} of one picture, the rest live",
            [_counts(old * whole + (1 - old) * seen) for seen in live],
        )

    for old in (0.95, 0.8, 0.6, 0.5, 0.4):
        yield f"a filter that keeps {old:.0%}", recursive(live, old)


def _counts(values: NDArray[np.floating[Any]]) -> Counts:
    counts: NDArray[np.uint16] = np.clip(np.rint(values), 0, 65535).astype(np.uint16)
    return counts


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("recording", type=Path)
    parser.add_argument("--frames", type=int, default=300)
    given = parser.parse_args()
    rng = np.random.default_rng(1)
    recording = read_recording(given.recording)
    live = [
        recording.frame(entry).astype(np.uint16)
        for entry in recording.frames[: given.frames]
    ]
    print(f"{'live frames':44}{'taken for old':>15}{'us a frame':>12}")
    sessions: dict[str, Sequence[Counts]] = {
        "of the recording": live,
        "of the recording, 8 bits": [_counts(picture // 16.0) for picture in live],
        "of the recording, 4 bits": [_counts(picture // 256.0) for picture in live],
        "mean of two of the recording, in turns": [
            a // 2 + b // 2 for a, b in pairwise(live)
        ],
    }

    for name, pictures in sessions.items():
        _, old, taken_s = alarm_after(pictures, 0)
        print(
            f"{name:44}{f'{old} of {len(pictures)}':>15}{from_si(taken_s, 'us'):12.0f}"
        )

    for snr_db, bits, motion in (
        (15, 12, 0),
        (25, 12, 0),
        (25, 8, 0),
        (40, 12, 0),
        (40, 8, 0),
        (25, 12, 0.1),
        (25, 12, 1),
    ):
        eye = still_eye(rng, snr_db, bits=bits, motion=motion)
        pictures = [next(eye) for _ in range(given.frames // 3)]
        _, old, taken_s = alarm_after(pictures, 0)
        name = f"still speckle, {snr_db} dB, {bits} bits, {motion} pixels a frame"
        print(
            f"{name:44}{f'{old} of {len(pictures)}':>15}{from_si(taken_s, 'us'):12.0f}"
        )

    first = min(60, len(live) // 2)
    before = live[:first]
    during = live[first : first + 30]
    print(f"\n{'old pictures':44}{'FROZEN at frame':>16}")

    for name, old_pictures in faults(during, rng):
        alarm, _, _ = alarm_after([*before, *old_pictures], len(before))
        print(f"{name:44}{alarm or 'never':>16}")


if __name__ == "__main__":
    main()
