"""A model folder: what it is, what made it, how well it did in its training."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from scleraforce.models import FILES, read_folder
from scleraforce.reader.limits import reading_ranges
from scleraforce.report.files import BLUE, RED, inches, styled
from scleraforce.report.shown.kinds import Thing
from scleraforce.units import from_si

TITLES = {
    "mae_mn": "mean error of the force [mN]",
    "lateral_mae_mm": "mean error of the contact [mm]",
    "coverage": "intervals that hold",
    "dice_mean": "overlap (Dice)",
}
# What the metrics of a training are of: of a reader, other figures than those of recordings, which README and
# docs/figures.md have.
MEASURED_ON = {
    "reader": "the network alone, on simulated slices with values that are missing or wrong; not what it does on "
              "recordings of calibrated eyes, where {default} answers (docs/figures.md)",
    "raw-reader": "simulated frames with values that are missing or wrong",
    "classifier": "simulated slices that it was not trained on",
    "wall-finder": "drawn scenes that it was not trained on",
}  # fmt: skip
MADE_WITH = ("scleraforce", "python", "numpy", "torch", "onnx")


def show_model(path: Path) -> Thing:
    """Look at a model folder; its files are checked against their hashes.

    Raises:
        ModelError: it cannot be read, or a file is not the one that was trained.
    """
    folder = read_folder(path)
    record = folder.record
    metrics, provenance = _table(record, "metrics"), _table(record, "provenance")
    ranges = reading_ranges(path)
    lines = ("what it reads:", *(f"  {name:<36}{words}" for name, words in ranges)) if ranges else ()
    size = sum(map(len, folder.files.values()))
    rows = [
        ("kind", f"{record['kind']}{_default(record)}"),
        ("training", ", ".join(f"{count} {name}" for name, count in _amounts(record))),
        ("figures below are of", MEASURED_ON[record["kind"]].format(default=f"its {record.get('default')}")),
        *((TITLES.get(name, name.replace("_", " ")), f"{value:.4g}") for name, value in metrics.items()
          if isinstance(value, int | float)),
        ("intervals", _intervals(record)),
        ("made with", ", ".join(f"{name} {provenance[name]}" for name in MADE_WITH if name in provenance)),
        ("seed", str(provenance.get("seed", "-"))),
        ("files", f"{', '.join(sorted(folder.files))}: {from_si(float(size), 'mb'):.1f} MB, hashes match"),
    ]  # fmt: skip
    curves = {name: values for name, values in _table(record, "curves").items() if _are_numbers(values)}
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


@styled
def draw_curves(curves: Mapping[str, Sequence[float]], steps: str) -> Figure:
    """Draw what a training was watched by, a panel a quantity: training dashed, validation solid."""
    names = list(dict.fromkeys(name.partition("_")[2] for name in curves))
    figure = Figure(figsize=inches(170 if len(names) > 1 else 110, 60))
    for axes, name in zip(figure.subplots(1, max(len(names), 1), squeeze=False)[0], names, strict=True):
        for part, colour, line in (("training", RED, (0, (4, 2))), ("validation", BLUE, "-")):
            values = curves.get(f"{part}_{name}", ())
            if values:
                axes.plot(range(1, len(values) + 1), values, color=colour, linestyle=line, label=part)
        axes.set_xlabel(steps)
        axes.set_ylabel(name.replace("_", " "))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="best")
    return figure


def _table(record: Mapping[str, Any], key: str) -> dict[str, Any]:
    found = record.get(key)
    return found if isinstance(found, dict) else {}


def _are_numbers(values: Any) -> bool:
    return isinstance(values, list) and bool(values) and all(isinstance(value, int | float) for value in values)


def _default(record: Mapping[str, Any]) -> str:
    return f", answers with its {record['default']}" if record.get("default") else ""


def _amounts(record: Mapping[str, Any]) -> list[tuple[str, int]]:
    """Return what a training used, each with its name: samples, scenes, epochs or batches."""
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
