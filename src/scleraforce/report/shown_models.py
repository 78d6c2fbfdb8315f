"""Descriptions of computed things: response libraries, data sets of simulated slices, and models."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from scleraforce.learning.dataset import open_dataset
from scleraforce.library.files import load_library
from scleraforce.library.responses import Library
from scleraforce.library.store import open_library
from scleraforce.models import FILES, read_folder
from scleraforce.reader.limits import reading_ranges
from scleraforce.report.files import GREY, inches, styled
from scleraforce.report.frame_figures import draw_montage
from scleraforce.report.model_figures import draw_curves
from scleraforce.report.shown import Thing, span
from scleraforce.units import from_si

PICTURED = 24  # slices
TITLES = {
    "mae_mn": "mean error of the force [mN]",
    "lateral_mae_mm": "mean error of the contact [mm]",
    "coverage": "intervals that hold",
    "dice_mean": "overlap (Dice)",
}
# Data behind the metrics of a training. README and docs/figures.md have a reader's figures on recordings.
MEASURED_ON = {
    "reader": "the network alone, on simulated slices with values that are missing or wrong; not what it does on "
              "recordings of calibrated eyes, where {default} answers (docs/figures.md)",
    "raw-reader": "simulated frames with values that are missing or wrong",
    "classifier": "simulated slices that it was not trained on",
    "wall-finder": "drawn scenes that it was not trained on",
}  # fmt: skip
MADE_WITH = ("scleraforce", "python", "numpy", "torch", "onnx")


def show_library(path: Path) -> Thing:
    """Describe a response library: a store of `scleraforce library`, or the file of a model folder."""
    library = load_library(path) if path.is_file() else open_library(path)
    shape = library.force_ratio_tpd.shape
    rows = (
        ("walls", f"radius {from_si(library.radius_m, 'mm'):g} mm, {span(library.thickness_m, 'um', 'µm')} thick, "
                  f"Poisson's ratio {library.poisson_ratio:g}"),
        ("needle", f"{from_si(2 * library.needle_radius_m, 'mm'):g} mm thick"),
        ("load paths", f"{shape[0]} thicknesses x {shape[1]} tensions p R/(E t) from {library.tension[0]:.3g} to "
                       f"{library.tension[-1]:.3g}"),
        ("dents", f"{shape[2]} states of each, {span(library.tip_m, 'mm', 'mm')}"),
        ("contacts", f"{span(library.polar_rad, 'deg', '°')} from the pole"),
        ("largest F/E", f"{from_si(library.max_force_ratio, 'mm2'):.4g} mm²"),
    )  # fmt: skip
    facts = {
        "radius_mm": from_si(library.radius_m, "mm"),
        "thickness_um": from_si(library.thickness_m, "um").tolist(),
        "tension": library.tension.tolist(),
        "tip_mm": from_si(library.tip_m, "mm").tolist(),
        "largest_force_ratio_mm2": from_si(library.max_force_ratio, "mm2"),
    }
    return Thing(kind="library", facts=facts, rows=rows, draw=lambda: draw_library(library))


@styled
def draw_library(library: Library) -> Figure:
    """Draw F/E over the dent for every thickness, at the lowest, the middle and the highest pressure."""
    figure = Figure(figsize=inches(170, 62))
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    dent_mm = from_si(library.tip_m, "mm")
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, len(library.thickness_m)))
    for axes, pressure in zip(panels, (0, len(library.tension) // 2, -1), strict=True):
        for thickness_m, ratio_d, shade in zip(
            library.thickness_m, library.force_ratio_tpd[:, pressure], shades, strict=True
        ):
            label = f"{from_si(thickness_m, 'um'):.0f} µm"
            axes.plot(dent_mm, from_si(ratio_d, "mm2"), color=shade, label=label)
        axes.axhline(from_si(library.max_force_ratio, "mm2"), color=GREY, linewidth=0.6, linestyle=(0, (4, 3)))
        axes.set_title(f"tension p R/(E t) = {library.tension[pressure]:.3g}")
        axes.set_xlabel("dent [mm]")
    highest = 1.1 * from_si(library.max_force_ratio, "mm2")
    panels[0].set(ylabel="force over Young's modulus [mm²]", ylim=(0.0, highest))
    shown = np.unique(np.linspace(0, len(library.thickness_m) - 1, 6).round().astype(int))
    handles, labels = panels[0].get_legend_handles_labels()
    panels[0].legend([handles[n] for n in shown], [labels[n] for n in shown], loc="upper left")
    return figure


def show_data_set(path: Path) -> Thing:
    """Describe a data set; raises `DatasetError`."""
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

    def draw() -> Figure:
        chosen = np.linspace(0, dataset.images - 1, min(PICTURED, dataset.images)).round().astype(int)
        chosen = chosen[np.argsort(dataset.force_n[chosen])]
        thickness_m = dataset.read("thickness_m")[chosen]
        return draw_montage(dataset.slices[chosen], dataset.force_n[chosen], dataset.target[chosen], thickness_m)

    return Thing(kind="data set", facts=facts, rows=rows, draw=draw)


def show_model(path: Path) -> Thing:
    """Describe a model folder; its files are checked against their hashes; raises `ModelError`."""
    folder = read_folder(path)
    record = folder.record
    metrics, provenance = _table(record, "metrics"), _table(record, "provenance")
    ranges = reading_ranges(path)
    lines = ("what it reads:", *(f"  {name:<36}{words}" for name, words in ranges)) if ranges else ()
    size = sum(map(len, folder.files.values()))
    rows = [
        ("kind", record["kind"] + (f", answers with its {record['default']}" if record.get("default") else "")),
        ("training", ", ".join(f"{count} {name}" for name, count in _amounts(record))),
        ("figures below are of", MEASURED_ON[record["kind"]].format(default=f"its {record.get('default')}")),
        *((TITLES.get(name, name.replace("_", " ")), f"{value:.4g}") for name, value in metrics.items()
          if isinstance(value, int | float)),
        ("intervals", _intervals(record)),
        ("made with", ", ".join(f"{name} {provenance[name]}" for name in MADE_WITH if name in provenance)),
        ("seed", str(provenance.get("seed", "-"))),
        ("files", f"{', '.join(sorted(folder.files))}: {from_si(float(size), 'mb'):.1f} MB, hashes match"),
    ]  # fmt: skip
    curves = {
        name: values for name, values in _table(record, "curves").items()
        if isinstance(values, list) and values and all(isinstance(value, int | float) for value in values)
    }  # fmt: skip
    facts = {
        "model_kind": record["kind"],
        "default": record.get("default"),
        "metrics": metrics,
        "provenance": provenance,
        "reads": dict(ranges),
        "files": {name: len(folder.files[name]) for name in FILES[record["kind"]]},
    }
    steps = "epoch" if "epochs" in record else "reports during the training"
    kept = tuple((name, words) for name, words in rows if words)
    return Thing(kind="model", facts=facts, rows=kept, lines=lines, draw=lambda: draw_curves(curves, steps))


def _table(record: Mapping[str, Any], key: str) -> dict[str, Any]:
    found = record.get(key)
    return found if isinstance(found, dict) else {}


def _amounts(record: Mapping[str, Any]) -> list[tuple[str, int]]:
    samples = record.get("samples")
    found = {"samples": samples.get("training") if isinstance(samples, dict) else samples}
    found |= {name: record.get(name) for name in ("scenes", "epochs", "batches")}
    return [(name, count) for name, count in found.items() if isinstance(count, int)]


def _intervals(record: Mapping[str, Any]) -> str:
    intervals = _table(record, "intervals")
    if not intervals:
        return ""
    eyes, source = intervals.get("eyes"), intervals.get("source")
    return f"90 %, measured on {eyes} {source}" if eyes else f"90 %, of {source}"
