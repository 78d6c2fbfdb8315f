"""How long a frame takes with a model of kind "reader": segmentation, slice, network, fit, all of it; one core.

    python benchmarks/bench_reader.py MODEL [--frames 24] [--rounds 8]

Frames are drawn from the model's own library and the study's phantom ranges, forces of 0 to 60 mN. Times are those of
this thread's processor, so that other work on the machine counts little; `answer` is what `classify` does per frame.
"""

import argparse
from collections.abc import Callable
from math import exp, log
from pathlib import Path
from time import thread_time

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.known import OPEN, Known, Modulus
from scleraforce.laboratory.bscan import render_bscan
from scleraforce.laboratory.light import sample_optics
from scleraforce.library import Library
from scleraforce.library.fit import fit_boundaries
from scleraforce.library.prediction import Walls, place_walls
from scleraforce.library.prior import prior_of
from scleraforce.library.unknowns import DEPTH, GAP, IOP, MODULUS, NAMES, THICKNESS, TIP
from scleraforce.mechanics.contact import Section
from scleraforce.reader import load_force_reader
from scleraforce.reader.kinds import SHIFTS
from scleraforce.recording.pixels import PixelScale
from scleraforce.segmentation.observations import segmented_boundaries
from scleraforce.segmentation.slice import boundary_slices
from scleraforce.segmentation.wall import find_wall
from scleraforce.study import Study

Frame = NDArray[np.uint16]


def draw_eye(library: Library, study: Study, rng: np.random.Generator) -> tuple[Frame, Known]:
    """Return a raw frame of an eye of the library, and what is known of it."""
    modulus_pa, iop_pa = rng.uniform(0.22e6, 0.5e6), rng.uniform(150.0, 500.0)
    thickness_m, gap_m = rng.uniform(0.45e-3, 0.85e-3), rng.uniform(0.4e-3, 0.9e-3)
    wall = np.array([thickness_m]), np.array([iop_pa / modulus_pa])
    largest = min(float(library.largest_force_ratio(*wall)[0]), study.needle.max_force_n / modulus_pa)
    unknown = np.zeros((1, len(NAMES)))
    unknown[0, [MODULUS, IOP, THICKNESS, GAP, DEPTH]] = log(modulus_pa), log(iop_pa), thickness_m, gap_m, 0.45e-3
    unknown[0, TIP] = library.tips(*wall, np.array([0.999 * largest * rng.random()]))[0]
    curves = place_walls(Walls(library), unknown)[0]
    ahead = [np.concatenate([[True], np.diff(curve[:, 0]) > 1e-9]) for curve in curves]
    section = Section(*(curve[kept] for curve, kept in zip(curves, ahead, strict=True)))
    frame = render_bscan(section, study.oct, sample_optics(study.phantom, study.oct, rng), rng).frame
    return frame, Known(
        globe=OPEN,
        modulus=Modulus(mean_pa=exp(log(modulus_pa)), sd_pa=0.015 * modulus_pa, source="own"),
        iop_pa=iop_pa,
        thickness_m=thickness_m,
        gap_m=gap_m,
    )


def times_ms(work: Callable[[int], object], frames: int, rounds: int) -> NDArray[np.float64]:
    """Return the processor time of each call."""
    taken = []
    for _ in range(rounds):
        for number in range(frames):
            start = thread_time()
            work(number)
            taken.append((thread_time() - start) * 1e3)
    return np.array(taken)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("model", type=Path)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--rounds", type=int, default=8, help="each frame is read so often")
    given = parser.parse_args()
    reader = load_force_reader(given.model)
    cv2.setNumThreads(1)
    study, rng = reader.study, np.random.default_rng(0)
    drawn = [draw_eye(reader.library, study, rng) for _ in range(given.frames)]
    scale = PixelScale.of(study.oct)
    found = [find_wall(frame, scale) for frame, _ in drawn]
    cuts = [boundary_slices(entry, scale, study.slice, SHIFTS) for entry in found]
    seen = [segmented_boundaries(entry, scale) for entry in found]
    priors = [prior_of(known, study.reader) for _, known in drawn]
    smoothing_m = study.calibration.surface_smoothing_m
    work: dict[str, Callable[[int], object]] = {
        "segment": lambda n: find_wall(drawn[n][0], scale),
        "slice": lambda n: boundary_slices(found[n], scale, study.slice, SHIFTS),
        "network": lambda n: reader.read_slices(cuts[n], drawn[n][1]),
        "fit": lambda n: fit_boundaries(reader.library, seen[n].lateral_m, seen[n].depth_m, priors[n], smoothing_m),
        "answer": lambda n: reader.read(drawn[n][0], scale, drawn[n][1]),
    }
    print(f"{'ms':12}{'least':>8}{'median':>8}{'99 %':>8}{'largest':>9}")
    for name, function in work.items():
        taken = times_ms(function, given.frames, given.rounds)
        print(f"{name:12}{taken.min():8.2f}{np.median(taken):8.2f}{np.quantile(taken, 0.99):8.2f}{taken.max():9.2f}")


if __name__ == "__main__":
    main()
