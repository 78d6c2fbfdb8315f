"""Errors of the segmentation's boundaries on rendered frames, beside those that `learning.boundary_errors` makes.

    python benchmarks/bench_boundary_errors.py [EYES [SEED]]

Each eye has 12 frames with even forces from 0 to 60 mN, from the user's library (built where there is none).
"""

import sys
from dataclasses import fields

import numpy as np

from scleraforce.learning.boundary_errors import disturb
from scleraforce.learning.boundary_statistics import BoundaryStatistics, boundary_statistics
from scleraforce.learning.segmented import random_eyes, segmented_boundaries
from scleraforce.library.cache import cached_library
from scleraforce.study import Study

FRAMES = 12


def main() -> None:
    """Print the table."""
    eyes, seed = (int(text) for text in [*sys.argv[1:], "16", "1"][:2])
    study = Study()
    library = cached_library(study)
    pairs = [
        segmented_boundaries(library, study, eye, np.linspace(0.0, 60e-3, FRAMES).tolist(), seed)
        for eye in random_eyes(study, eyes, seed)
    ]
    true, seen = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    made = disturb(true, study.slice, np.random.default_rng(seed))
    print(f"{len(true)} frames of {eyes} eyes")
    print(f"{'':<26}{'segmented':>22}{'made':>22}")
    _table(boundary_statistics(true, seen, study.slice), boundary_statistics(true, made, study.slice))


def _table(*columns: BoundaryStatistics) -> None:
    for item in fields(BoundaryStatistics):
        print(f"{item.name:<26}" + "".join(f"{_text(item.name, getattr(column, item.name)):>22}" for column in columns))


def _text(name: str, value: float | tuple[float, ...]) -> str:
    if isinstance(value, tuple):
        return ", ".join(f"{part:.2f}" for part in value)
    if name.endswith("_m2"):
        return f"{value * 1e6:.4f} mm2"
    return f"{value * 1e6:.1f} um" if name.endswith("_m") else f"{value:.2%}"


if __name__ == "__main__":
    main()
