"""Speed of the segmentation: one 512 x 512, 16-bit frame on one core, cold (after a pause) and in a row.

    python benchmarks/bench_segmentation.py [--frames 24] [--rounds 40]

Frames are drawn from the study's phantom ranges. Beside it: how long the crudest segmentation takes on this machine at
this moment (crop, resize, median filter, Otsu, contours; 0.25 ms on an idle core), so that times can be compared.
"""

import argparse
from collections.abc import Callable
from time import perf_counter, sleep

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.bscan import render_bscan
from scleraforce.laboratory.light import sample_optics, sample_pose
from scleraforce.mechanics.contact import Section
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.wall import find_first_wall
from scleraforce.study import Study

REPEATS = 8  # in a row
STUDY = Study()
SCALE = PixelScale.of(STUDY.oct)

PAUSE_S = 0.01  # between frames of a scanner that takes 100 a second

Frame = NDArray[np.uint16]
Work = Callable[[Frame], None]
Times = NDArray[np.float64]


def draw_frames(count: int) -> list[Frame]:
    """Frames of spherical walls with dents of 0 to 3 mm."""
    rng = np.random.default_rng(0)
    lateral = np.linspace(-8.5e-3, 8.5e-3, 800)
    frames = []
    for dent_m in np.linspace(0.0, 3e-3, count):
        depth = 12e-3 - np.sqrt(12e-3**2 - lateral**2) + dent_m * np.exp(-(lateral**2) / (2 * 1.6e-3**2))
        outer = np.stack([lateral, depth], axis=1)
        section = Section(outer, outer + np.array([0.0, rng.uniform(0.4e-3, 0.9e-3)]))
        optics = sample_optics(STUDY.phantom, STUDY.oct, rng)
        frames.append(render_bscan(sample_pose(STUDY.phantom, rng).place(section), STUDY.oct, optics, rng).frame)
    return frames


def crudest(frame: Frame) -> None:
    """Crop, resize, median filter, threshold, contours."""
    small = cv2.resize(frame[:, 16:496], (140, 40), interpolation=cv2.INTER_AREA)
    smooth = cv2.medianBlur(np.right_shift(small.astype(np.uint16), 4).astype(np.uint8), 5)
    cv2.findContours(cv2.threshold(smooth, 0, 255, cv2.THRESH_OTSU)[1], cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)


def times_ms(works: list[Work], frames: list[Frame], rounds: int, repeats: int, pause_s: float) -> Times:
    """Return the time of each call, the mean of `repeats` on the same frame after a pause, (work, call)."""
    taken: list[list[float]] = [[] for _ in works]
    for _ in range(rounds // repeats):
        for frame in frames:
            for work, of_work in zip(works, taken, strict=True):
                sleep(pause_s)
                start = perf_counter()
                for _ in range(repeats):
                    work(frame)
                of_work.append((perf_counter() - start) / repeats * 1e3)
    return np.array(taken)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--rounds", type=int, default=40, help=f"each frame is segmented so often, {REPEATS} at least")
    given = parser.parse_args()
    rounds = max(given.rounds, REPEATS)
    cv2.setNumThreads(1)
    frames = draw_frames(given.frames)
    work: dict[str, Work] = {"crudest": crudest, "find_first_wall": _segment}
    for one in work.values():  # the first two frames compile
        for frame in frames[:2]:
            one(frame)
    print(f"{'':24}{'least':>8}{'10 %':>8}{'median':>8}{'99 %':>8}  ms")
    for kind, repeats, pause_s in (("cold", 1, PAUSE_S), ("in a row", REPEATS, 0.0)):
        for name, taken in zip(work, times_ms(list(work.values()), frames, rounds, repeats, pause_s), strict=True):
            shares = "".join(f"{part:8.3f}" for part in np.quantile(taken, [0.0, 0.1, 0.5, 0.99]))
            print(f"{f'{name}, {kind}':24}{shares}")


def _segment(frame: Frame) -> None:
    find_first_wall(frame, SCALE)


if __name__ == "__main__":
    main()
