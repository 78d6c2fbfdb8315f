"""A data set of simulated slices: how many of which class, and some of them."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scleraforce.learning.dataset import Dataset, open_dataset
from scleraforce.report.shown.kinds import Thing, span
from scleraforce.report.slice_figures import draw_montage
from scleraforce.units import from_si

PICTURED = 24


def show_dataset(path: Path) -> Thing:
    """Look at a data set.

    Raises:
        DatasetError: it cannot be read.
    """
    dataset = open_dataset(path)
    _, validation = dataset.split()
    counts = np.bincount(dataset.target, minlength=len(dataset.study.classes.bounds_n) + 1).tolist()
    rows = (
        ("slices", f"{dataset.images}, {len(validation)} of them for validation"),
        ("classes", ", ".join(f"{count} of class {label}" for label, count in enumerate(counts))),
        ("forces", span([float(end(dataset.force_n)) for end in (np.min, np.max)], "mn", "mN")),
        ("walls", f"{span(np.unique(dataset.read('thickness_m')), 'um', 'µm')} thick, "
                  f"{from_si(dataset.youngs_modulus_pa, 'mpa'):.3g} MPa"),
        ("seed", str(dataset.study.dataset.seed)),
    )  # fmt: skip
    facts = {
        "images": dataset.images,
        "validation": len(validation),
        "classes": counts,
        "youngs_modulus_mpa": from_si(dataset.youngs_modulus_pa, "mpa"),
    }
    return Thing(kind="data set", facts=facts, rows=rows, draw=lambda: _draw(dataset))


def _draw(dataset: Dataset) -> Figure:
    chosen = np.linspace(0, dataset.images - 1, min(PICTURED, dataset.images)).round().astype(int)
    chosen = chosen[np.argsort(dataset.force_n[chosen])]
    thickness_m = dataset.read("thickness_m")
    return draw_montage(dataset.slices[chosen], dataset.force_n[chosen], dataset.target[chosen], thickness_m[chosen])
