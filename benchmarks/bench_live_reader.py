"""The reading in the control loop: segmentation, slice, network, all of it, and the fit that gives a second opinion.

    python benchmarks/bench_live_reader.py MODEL [RECORDING...] [--drawn 48] [--readings 6000] [--fits 200]

One core. Without a recording, frames are drawn from the model's own library and the study's phantom ranges (forces of 0
to 60 mN), and beside them such as a bad moment brings: noise, saturation, missing columns, lines, no wall. Each frame
is copied just before it is read, as a decoder does. `cpu` is the time of this thread's processor, which other work on
the machine hardly touches; `wall` is what a clock on the wall shows, pauses by other processes included.
"""

import argparse
import gc
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, thread_time

import cv2
import numpy as np
from numpy.typing import NDArray

from bench_reader import draw_eye
from scleraforce.known import Known, known_of_recording
from scleraforce.library.fit import fit_boundaries
from scleraforce.library.prior import prior_of
from scleraforce.reader import ForceReader, load_force_reader
from scleraforce.reader.kinds import SHIFTS
from scleraforce.reader.model import LiveReader
from scleraforce.recording.folder import read_recording
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.observations import segmented_boundaries
from scleraforce.segmentation.slice import boundary_slices
from scleraforce.segmentation.wall import find_wall

Frame = NDArray[np.uint16]


def disturbed(frame: Frame, rng: np.random.Generator) -> dict[str, Frame]:
    """Return a frame as it looks when something goes wrong."""
    missing, lines = frame.copy(), frame.copy()
    missing[:, 150:180] = 0
    missing[:, rng.choice(512, 8)] = 0
    lines[rng.choice(512, 4)] = 4095
    return {
        "noise": rng.integers(0, 1500, frame.shape).astype(np.uint16),
        "nothing": np.zeros_like(frame),
        "saturated": np.minimum(frame.astype(np.uint32) * 2, 4095).astype(np.uint16),
        "missing": missing,
        "lines": lines,
    }


def drawn(reader: ForceReader, count: int) -> tuple[list[Frame], Known, PixelScale]:
    """Return frames of many eyes, read with what is known of the first."""
    rng, oct_study = np.random.default_rng(0), reader.study.oct
    pairs = [draw_eye(reader.library, reader.study, rng) for _ in range(count)]
    frames = [frame for frame, _ in pairs]
    frames += [bad for frame in frames[:4] for bad in disturbed(frame, rng).values()]
    return frames, pairs[0][1], PixelScale.of(oct_study)


def recorded(path: Path) -> tuple[list[Frame], Known, PixelScale]:
    """Return the frames of a recording."""
    recording = read_recording(path)
    frames = [np.asarray(recording.frame(entry), dtype=np.uint16) for entry in recording.frames]
    return frames, known_of_recording(recording.info), PixelScale.of(recording.info.oct)


def times_ms(work: Callable[[int, Frame], object], frames: list[Frame], count: int) -> NDArray[np.float64]:
    """Return processor and wall time of each call, (2, call)."""
    taken = np.empty((2, count))
    for call in range(count):
        number = call % len(frames)
        frame = frames[number].copy()
        wall, cpu = perf_counter(), thread_time()
        work(number, frame)
        taken[:, call] = thread_time() - cpu, perf_counter() - wall
    return 1e3 * taken


def table(
    reader: ForceReader,
    frames: list[Frame],
    known: Known,
    scale: PixelScale,
    *,
    readings: int,
    fits: int,
) -> None:
    """Print the times of the stages, and of all of them."""
    study, live = reader.study, LiveReader(reader, known, scale.refractive_index)
    found = [find_wall(frame, scale) for frame in frames]
    cuts = [boundary_slices(entry, scale, study.slice, SHIFTS) for entry in found]
    usable = [number for number, entry in enumerate(found) if entry.usable]
    seen = [segmented_boundaries(found[number], scale) for number in usable]
    library, prior = reader.library_for(known), prior_of(known, study.reader)
    smoothing_m = study.calibration.surface_smoothing_m
    gc.collect()
    gc.freeze()
    every = range(len(frames))
    work: dict[str, tuple[Callable[[int, Frame], object], range | list[int], int]] = {
        "segmentation": (lambda _, frame: find_wall(frame, scale), every, readings),
        "slice": (lambda n, _: boundary_slices(found[n], scale, study.slice, SHIFTS), every, readings),
        "network": (lambda n, _: reader.read_slices(cuts[n], known), every, readings),
        "all of the reading": (lambda _, frame: live.read(frame, scale), every, readings),
        "fit": (
            lambda n, _: fit_boundaries(library, seen[n].lateral_m, seen[n].depth_m, prior, smoothing_m),
            usable,
            fits,
        ),
    }
    print(f"{len(frames)} frames, {len(usable)} usable")
    print(f"{'ms':20}{'cpu median':>12}{'99 %':>8}{'largest':>9}{'wall median':>13}{'99 %':>8}{'largest':>9}")
    medians = {}
    for name, (function, numbers, count) in work.items():
        cpu, wall = times_ms(function, [frames[number] for number in numbers], count)
        medians[name] = float(np.median(cpu))
        cells = (np.median(cpu), np.quantile(cpu, 0.99), cpu.max(), np.median(wall), np.quantile(wall, 0.99))
        print(
            f"{name:20}{cells[0]:12.3f}{cells[1]:8.3f}{cells[2]:9.3f}{cells[3]:13.3f}{cells[4]:8.3f}{wall.max():9.3f}"
        )
    print(f"the fit takes {medians['fit'] / medians['all of the reading']:.1f} times as long as the reading")


def main() -> None:
    """Print a table of drawn frames, or one of each recording."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("model", type=Path)
    parser.add_argument("recording", type=Path, nargs="*")
    parser.add_argument("--drawn", type=int, default=48, help="frames of so many eyes, where no recording is given")
    parser.add_argument("--readings", type=int, default=6000)
    parser.add_argument("--fits", type=int, default=200)
    given = parser.parse_args()
    reader = load_force_reader(given.model)
    cv2.setNumThreads(1)
    counts = {"readings": given.readings, "fits": given.fits}
    if not given.recording:
        print("drawn frames")
        table(reader, *drawn(reader, given.drawn), **counts)
    for path in given.recording:
        print(path)
        table(reader, *recorded(path), **counts)


if __name__ == "__main__":
    main()
