"""`scleraforce generate`: simulate the slices that a network learns from."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import click

from scleraforce.cli.output import count_bar, print_json, resumable_bar, say
from scleraforce.cli.place_of_work import chosen_workers, worker_options
from scleraforce.study import read_study
from scleraforce.study.unused import refuse_unused


@click.command()
@click.option("--study", "study_path", type=click.Path(path_type=Path), required=True, help="Study file (TOML).")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Where the data set goes (Zarr).")
@click.option(
    "--calibration",
    type=click.Path(path_type=Path),
    help="File of `calibrate`; its population's Young's modulus replaces the study's.",
)
@click.option("--mechanics", type=click.Choice(["linear", "finite-strain"]),
              help="How the wall bends; the study's by default.")  # fmt: skip
@worker_options("make the slices")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def generate(
    study_path: Path,
    out: Path,
    calibration: Path | None,
    mechanics: str | None,
    scheduler: str | None,
    workers: int | None,
    as_json: bool,
) -> None:
    """Simulate slices of the deformed sclera with their forces.

    Finite strain draws from the response library: that of another study than
    the paper's is made on first need (a minute). An interrupted run is taken up by the same command. The
    data set is the same wherever and by however many it is made.
    """
    # Imported here: the simulation takes longer to import than the help to print.
    from scleraforce.dataset.modulus import read_population_modulus
    from scleraforce.notebook.work import simulate_slices

    study = read_study(study_path)
    refuse_unused(study, "generate", mechanics or study.mechanics.kind, study_path)
    modulus = read_population_modulus(calibration) if calibration else None
    kind = mechanics or study.mechanics.kind
    if modulus and modulus.mechanics != kind:
        say(f"{calibration}: E was fitted with {modulus.mechanics} mechanics, the slices are {kind}", err=True)

    def bar(title: str, total: int) -> AbstractContextManager[Callable[[int], None]]:
        return resumable_bar(out, "images", title, total) if title == "generate" else count_bar(title, total)

    chosen = chosen_workers(scheduler, workers)
    result = simulate_slices(study, out, bar, mechanics=mechanics, calibration=modulus, workers=chosen)
    if as_json:
        print_json({"images": result.images, "seconds": result.seconds, "images_per_second": result.images_per_second})
    else:
        say(f"{out}: {result.images} images, {result.seconds:.1f} s, {result.images_per_second:.0f} images/s")
