"""Old pictures and live ones: which pictures the monitor takes for old, after how many
frames, and at what cost.

The live frames are of a virtual acquisition at 100 frames a second, each with its own
speckle and noise.
"""

from collections.abc import Iterator, Sequence
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
LIMITS = MonitorLimits()
SHARES = (0.95, 0.8, 0.6, 0.5, 0.4)
HALF = slice(256)
STUCK = {
    "left half stuck": (slice(None), HALF),
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
    }
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


def _faults(
    live: Sequence[Counts], rng: np.random.Generator
) -> Iterator[tuple[str, Sequence[Counts]]]:
    """Yield series of old pictures that are made from live ones, with their names."""
    first = live[0]
    numbers = range(len(live))
    whole = first.astype(np.float64)
    small = (first >> 4).astype(np.uint8)
    yield "stuck", [first for _ in numbers]
    yield "offset moves by a count a frame", [_counts(whole + n) for n in numbers]
    gains = [_counts(whole * (1 + 0.005 * n)) for n in numbers]
    yield "gain grows by 0.5 % a frame", gains
    yield "16 and 8 bits in turns", [first if n % 2 else small for n in numbers]
    yield "two in turns", [live[n % 2] for n in numbers]
    yield (
        "three in turns, offset moves",
        [_counts(live[n % 3] + 1.0 * n) for n in numbers],
    )
    yield "scrolls by a row a frame", [np.roll(first, n, 0) for n in numbers]
    yield "scrolls by two rows a frame", [np.roll(first, 2 * n, 0) for n in numbers]

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


def _counts(values: NDArray[np.floating[Any]]) -> NDArray[np.uint16]:
    return np.asarray(np.clip(np.rint(values), 0, 65535), np.uint16)
