"""The interval factors of a reader measured once more, by today's calibration and fit,
beside those that its model folder has.

The virtual eyes, their number and seeds are the training's. Run it after a change of
calibration or fit that leaves the network as it is; `--write` puts the new factors into
`model.json`, and `python -m provenance.fingerprint FOLDER` then marks the folder.
"""

import json
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import click

from figures.printing import PATH, print_table, whole_number
from scleraforce.base.whole_files import write_whole
from scleraforce.base.worker_processes import available_cores
from scleraforce.front.cli.output import count_bar
from scleraforce.lab.training.interval_measurement import measured_intervals, measuring
from scleraforce.reading.load_model import load_force_reader
from scleraforce.records.model_folder import SHIPPED_READER

METHODS = ("fit", "network")


def rows(
    stored: Mapping[str, Any], now: Mapping[str, Any]
) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield method, modulus, trait, and the factor in the folder and now."""
    for method in METHODS:
        for modulus, factors in now[method].items():
            before = stored.get(method, {}).get(modulus, {})
            for trait, factor in factors.items():
                old = before.get(trait)
                was = "-" if old is None else f"{old:.2f}"
                yield method, modulus, trait, was, f"{factor:.2f}"


@click.command(help=__doc__)
@click.argument("model", type=PATH, default=SHIPPED_READER)
@whole_number("--eyes", 0, "Eyes; 0: as many as in training.")
@whole_number("--workers", available_cores(), "Processes that measure the eyes.")
@click.option("--write", is_flag=True, help="Write the factors into the folder.")
def main(model: Path, eyes: int, workers: int, write: bool) -> None:
    """Measure, print, and write the factors if asked to."""
    model = model.resolve()  # the reader of living eyes lacks a library of its own
    reader = load_force_reader(model)
    path = model / "model.json"
    record = json.loads(path.read_text(encoding="utf-8"))
    stored = record["intervals"]
    network = (model / "model.onnx").read_bytes()
    measure = partial(measuring, reader.study, reader.library, network)
    count = eyes or reader.study.reader.interval_eyes

    with count_bar("eyes", count) as advance:
        found = measured_intervals(measure, count, workers, stored["source"], advance)

    now = found["intervals"]
    print_table(["method", "E", "trait", "in the folder", "now"], rows(stored, now))
    print(f"{now['readings']} readings of {now['eyes']} eyes")
    if write:
        record["intervals"] = now
        write_whole(json.dumps(record, indent=2) + "\n", path)


if __name__ == "__main__":
    main()
