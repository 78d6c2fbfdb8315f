"""`scleraforce library`: the finite-strain responses that data sets, calibration and training draw from."""

from pathlib import Path

import click

from scleraforce.cli.options import PATH, chosen_workers, options
from scleraforce.cli.output import Command, Report, resumable_bar
from scleraforce.study import Study


@click.command(cls=Command)
@options("study")
@click.option("--out", type=PATH, required=True, help="Where the library goes (Zarr).")
@options("scheduler", "workers", scheduler="Dask scheduler whose workers solve the paths.")
def library(study: Study, out: Path, scheduler: str | None, workers: int | None) -> Report:
    """Solve the load paths of the response library.

    Other commands take the library of the paper's study from the bundled
    reader; another one they make on first need, and keep it in the user's
    cache. This command writes it where you say, on a Dask cluster if you like.
    The same command resumes an interrupted run. The library is the same
    wherever it is made, by any number of workers.
    """
    from scleraforce.library.build import build_library
    from scleraforce.library.plan import plan_library
    from scleraforce.study.unused import refuse_unused

    refuse_unused(study, "library")
    with resumable_bar(out, "load paths", "library", plan_library(study).units) as advance:
        made = build_library(study, out, workers=chosen_workers(scheduler, workers), progress=advance)
    return Report(
        {"paths": made.paths, "seconds": made.seconds}, [f"{out}: {made.paths} load paths, {made.seconds:.1f} s"]
    )
