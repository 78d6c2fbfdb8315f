"""`scleraforce generate`: simulate the slices that a network learns from."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import click

from scleraforce.cli.options import PATH, chosen_workers, options
from scleraforce.cli.output import Command, Report, count_bar, resumable_bar, say
from scleraforce.study import Study


@click.command(cls=Command)
@options("study", required=("study",), study="Study file (TOML).")
@click.option("--out", type=PATH, required=True, help="Where the data set goes (Zarr).")
@options("calibration", "mechanics", "scheduler", "workers",
         calibration="File of `calibrate`; its population's Young's modulus replaces the study's.",
         scheduler="Dask scheduler whose workers make the slices.")  # fmt: skip
def generate(
    study: Study,
    out: Path,
    calibration: Path | None,
    mechanics: str | None,
    scheduler: str | None,
    workers: int | None,
) -> Report:
    """Simulate slices of the deformed sclera with their forces.

    Finite strain draws from the response library: that of another study than
    the paper's is made on first need (a minute). The same command resumes an
    interrupted run. The data set is the same wherever it is made, by any
    number of workers.
    """
    # Imported here: the simulation takes longer to import than the help to print.
    from scleraforce.learning.dataset import read_population_modulus
    from scleraforce.notebook.training import simulate_slices
    from scleraforce.study.unused import refuse_unused

    kind = mechanics or study.mechanics.kind
    refuse_unused(study, "generate", kind)
    modulus = read_population_modulus(calibration) if calibration else None
    if modulus and modulus.mechanics != kind:
        say(f"{calibration}: E was fitted with {modulus.mechanics} mechanics, the slices are {kind}", err=True)

    def bar(title: str, total: int) -> AbstractContextManager[Callable[[int], None]]:
        return resumable_bar(out, "images", title, total) if title == "generate" else count_bar(title, total)

    chosen = chosen_workers(scheduler, workers)
    made = simulate_slices(study, out, bar, mechanics=mechanics, calibration=modulus, workers=chosen)
    return Report(
        {"images": made.images, "seconds": made.seconds, "images_per_second": made.images_per_second},
        [f"{out}: {made.images} images, {made.seconds:.1f} s, {made.images_per_second:.0f} images/s"],
    )
