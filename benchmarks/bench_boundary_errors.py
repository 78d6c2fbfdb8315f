"""Errors of the segmentation's boundaries on rendered frames, beside the errors that
`lab.training.drawn_wall_errors` draws.

    python benchmarks/bench_boundary_errors.py [EYES [SEED]] [--frames 12]
        [--study FILE] [--checked]

Each eye has frames with even forces from 0 to 60 mN, from the user's library of the
study (built if missing).
"""

import argparse
from dataclasses import fields
from pathlib import Path

import numpy as np

from boundary_errors.segmented import random_eyes, segmented_boundaries
from boundary_errors.statistics import BoundaryStatistics, boundary_statistics
from scleraforce.lab.training.drawn_wall_errors import disturb
from scleraforce.library.library_store import cached_library
from scleraforce.reading.load_model import load_wall_finder
from scleraforce.records.model_folder import SHIPPED_WALL_FINDER
from scleraforce.records.study import Study, read_study


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("eyes", type=int, nargs="?", default=16)
    parser.add_argument("seed", type=int, nargs="?", default=1)
    parser.add_argument("--frames", type=int, default=12, help="of each eye")
    parser.add_argument("--study", type=Path, help="the paper's where none is given")
    parser.add_argument(
        "--checked",
        action="store_true",
        help="by the wall finder, as in the commands; not the loop's",
    )
    given = parser.parse_args()
    study = read_study(given.study) if given.study else Study()
    forces_n = np.linspace(0.0, 60e-3, given.frames).tolist()
    library = cached_library(study)
    finder = load_wall_finder(SHIPPED_WALL_FINDER) if given.checked else None
    pairs = [
        segmented_boundaries(library, study, eye, forces_n, given.seed, finder)
        for eye in random_eyes(study, given.eyes, given.seed)
    ]
    true, seen = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    made = disturb(true, study.slice, np.random.default_rng(given.seed))
    print(f"{len(true)} frames of {given.eyes} eyes")
    print(f"{'':<26}{'segmented':>22}{'made':>22}")
    _table(
        boundary_statistics(true, seen, study.slice),
        boundary_statistics(true, made, study.slice),
    )


def _table(*columns: BoundaryStatistics) -> None:
    for item in fields(BoundaryStatistics):
        print(
            f"{item.name:<26}"
            + "".join(
                f"{_text(item.name, getattr(column, item.name)):>22}"
                for column in columns
            )
        )


def _text(name: str, value: float | tuple[float, ...]) -> str:
    if isinstance(value, tuple):
        return ", ".join(f"{part:.2f}" for part in value)
    if name.endswith("_m2"):
        return f"{value * 1e6:.4f} mm2"
    return f"{value * 1e6:.1f} um" if name.endswith("_m") else f"{value:.2%}"


if __name__ == "__main__":
    main()
