"""Old pictures and live ones: which pictures the monitor takes for old, after how many
frames, and at what cost.

The live frames are of a virtual acquisition at 100 frames a second, each with its own
speckle and noise. Eyes at rest whose speckle stays are made here: a dome of tissue,
seen by a phase-stable scanner with noise.
"""

from collections.abc import Iterator, Sequence
from itertools import islice, pairwise
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markdown_tables import markdown
from scleraforce.base.units import from_si
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.repeated_pictures import ShownPictures
from scleraforce.recordings.recording_folder import read_recording

Counts = NDArray[np.uint8] | NDArray[np.uint16]
SIZE = 512, 512
LIMITS = MonitorLimits()
SHARES = (0.95, 0.8, 0.6, 0.5, 0.4)
HALF = slice(256)
# dB, bits, pixels a frame
STILL_EYES = [(15, 12, 0.0), (25, 12, 0.0), (25, 8, 0.0), (40, 12, 0.0), (40, 8, 0.0)]
STILL_EYES += [(25, 12, 0.1), (25, 12, 1.0)]
STUCK = {
    "left half stuck": (slice(None), HALF),
    "middle half stuck": (slice(None), slice(128, 384)),
    "lower half stuck": (slice(256, None), slice(None)),
    "a quarter stuck": (HALF, HALF),
}


def old_pictures(recording: Path, *, frames: int = 300) -> None:
    """Which pictures are taken for old, after how many frames, at what cost.

    Args:
        recording: virtual, 100 frames a second.
        frames: of it that are shown.
    """
    rng = np.random.default_rng(1)
    read = read_recording(recording)
    entries = read.frames[:frames]
    live = [read.frame(entry).astype(np.uint16) for entry in entries]
    shown: dict[str, Sequence[Counts]] = {
        "of the recording": live,
        "of the recording, 8 bits": [_counts(picture // 16.0) for picture in live],
        "of the recording, 4 bits": [_counts(picture // 256.0) for picture in live],
        "mean of two of the recording, in turns": [
            a // 2 + b // 2 for a, b in pairwise(live)
        ],
    }
    for snr_db, bits, motion in STILL_EYES:
        name = f"still speckle, {snr_db} dB, {bits} bits, {motion:g} pixels a frame"
        shown[name] = list(islice(_still_eye(rng, snr_db, bits, motion), frames // 3))

    rows = []
    for name, pictures in shown.items():
        _, old, taken_s = _alarm_after(pictures, 0)
        rows.append(
            [name, f"{old} of {len(pictures)}", f"{from_si(taken_s, 'us'):.0f}"]
        )

    print(markdown(["live frames", "taken for old", "us a frame"], rows), end="\n\n")
    first = min(60, len(live) // 2)
    during = live[first : first + 30]
    rows = []
    for name, pictures in _faults(during, rng):
        alarm, _, _ = _alarm_after([*live[:first], *pictures], first)
        rows.append([name, str(alarm or "never")])

    print(markdown(["old pictures", "FROZEN at frame"], rows))


def _alarm_after(
    pictures: Sequence[Counts], first: int
) -> tuple[int | None, int, float]:
    """Return after how many pictures from the `first` one on they are `FROZEN`, how
    many were old, and s for each.
    """
    shown = ShownPictures(LIMITS.shown_frames)
    returns = [0] * LIMITS.shown_frames
    repeats = 1
    alarm = None
    taken_s = []

    for number, picture in enumerate(pictures):
        begun_s = perf_counter()
        returns.append(shown.back(picture))
        taken_s.append(perf_counter() - begun_s)
        back = returns[-1]
        repeats = repeats + 1 if back == 1 else 1
        again = sum(one > 1 for one in returns[-LIMITS.shown_frames :])
        frozen = repeats >= LIMITS.frozen_frames
        frozen |= back > 1 and again >= LIMITS.frozen_frames - 1
        if frozen and alarm is None:
            alarm = number - first + 1

    return alarm, sum(back > 0 for back in returns), float(np.median(taken_s))


def _still_eye(
    rng: np.random.Generator, snr_db: float, bits: int, motion: float
) -> Iterator[Counts]:
    """Yield frames of a dome at rest, of fixed speckle: `motion` is how far it moves in
    depth, in pixels a frame.
    """
    rows, columns = np.mgrid[: SIZE[0], : SIZE[1]]
    below = rows - 150 - ((columns - 256) / 256) ** 2 * 120
    light = np.where((below > 0) & (below < 160), np.exp(-below / 160), 0.0)
    tissue = 10 ** (snr_db / 20) * light * _normal(rng)
    wave = 2j * np.pi * np.fft.fftfreq(SIZE[0])[:, None]
    spectrum = np.fft.fft(tissue, axis=0)
    white = 2**bits - 1

    for number in range(10**6):
        moved = np.fft.ifft(spectrum * np.exp(-wave * motion * number), axis=0)
        seen = (moved if motion else tissue) + _normal(rng)
        level_db = 20 * np.log10(np.abs(seen))
        yield np.clip(white * (level_db + 10) / 50, 0, white).astype(np.uint16)


def _normal(rng: np.random.Generator) -> NDArray[np.complex64]:
    real, imaginary = rng.standard_normal((2, *SIZE), np.float32)
    return np.asarray((real + 1j * imaginary) / np.sqrt(2), np.complex64)


def _faults(
    live: Sequence[Counts], rng: np.random.Generator
) -> Iterator[tuple[str, Sequence[Counts]]]:
    """Yield series of old pictures that are made from live ones, with their names."""
    first = live[0]
    numbers = range(len(live))
    whole = first.astype(np.float64)
    top = float(first.max())
    small = (first >> 4).astype(np.uint8)
    levels: dict[str, list[NDArray[Any]]] = {
        "stuck": [whole for _ in numbers],
        "offset moves by a count a frame": [whole + n for n in numbers],
        "gain grows by 0.5 % a frame": [whole * (1 + 0.005 * n) for n in numbers],
        "gamma grows by 1 % a frame": [
            top * (whole / top) ** (1 + 0.01 * n) for n in numbers
        ],
        "three in turns, offset moves": [live[n % 3] + float(n) for n in numbers],
    }
    for name, series in levels.items():
        yield name, [_counts(values) for values in series]

    yield "16 and 8 bits in turns", [first if n % 2 else small for n in numbers]
    yield "two in turns", [live[n % 2] for n in numbers]
    yield "scrolls by a row a frame", [np.roll(first, n, 0) for n in numbers]
    yield "scrolls by a column a frame", [np.roll(first, n, 1) for n in numbers]
    yield "scrolls by two rows a frame", [np.roll(first, 2 * n, 0) for n in numbers]
    steps = [tuple(rng.integers(-1, 2, 2)) for _ in numbers]
    jittered = [np.roll(first, step, (0, 1)) for step in steps]
    yield "jitters by a row and a column", jittered
    yield "a wandering strip of 60 columns", _overlaid(first, len(live), rng)

    for name, stuck in STUCK.items():
        pictures = [picture.copy() for picture in live]
        for picture in pictures:
            picture[stuck] = first[stuck]
        yield name, pictures

    for counts in (1, 30, 300, 1000):
        noisy = [_counts(whole + rng.normal(0, counts, first.shape)) for _ in numbers]
        yield f"fresh noise of {counts} counts", noisy

    for old in SHARES:
        mixed = [_counts(old * whole + (1 - old) * seen) for seen in live]
        yield f"{old:.0%} of one picture, the rest live", mixed

    for old in SHARES:
        mean = whole
        means = [mean := old * mean + (1 - old) * picture for picture in live]
        yield f"a filter that keeps {old:.0%}", [_counts(mean) for mean in means]


def _overlaid(first: Counts, count: int, rng: np.random.Generator) -> Sequence[Counts]:
    """Return one picture with a strip of noise that wanders over it."""
    shown = [first.copy() for _ in range(count)]
    for number, picture in enumerate(shown):
        rows, columns = picture.shape
        left = 7 * number % (columns - 60)
        picture[:, left : left + 60] = rng.integers(0, 4096, (rows, 60))
    return shown


def _counts(values: NDArray[np.floating[Any]]) -> NDArray[np.uint16]:
    return np.asarray(np.clip(np.rint(values), 0, 65535), np.uint16)
