"""`scleraforce library`: the finite-strain responses that data sets, calibration and training draw from."""

from pathlib import Path

import click

from scleraforce.cli.output import print_json, resumable_bar, say
from scleraforce.cli.place_of_work import chosen_workers, worker_options
from scleraforce.study import Study, read_study
from scleraforce.study.unused import refuse_unused


@click.command()
@click.option("--study", "study_path", type=click.Path(path_type=Path), help="Study file; the paper's by default.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Where the library goes (Zarr).")
@worker_options("solve the paths")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def library(study_path: Path | None, out: Path, scheduler: str | None, workers: int | None, as_json: bool) -> None:
    """Solve the load paths of the response library.

    Other commands take the paper's study's from the reader that ships, make
    another one on first need and keep it in the user's cache; this one puts it where you say, on a Dask cluster if
    you like. An interrupted run is taken up by the same command. The library
    is the same wherever and by however many it is made.
    """
    from scleraforce.library.build import build_library
    from scleraforce.library.plan import plan_library

    study = Study() if study_path is None else read_study(study_path)
    refuse_unused(study, "library", file=study_path)
    paths, chosen = plan_library(study).units, chosen_workers(scheduler, workers)
    with resumable_bar(out, "load paths", "library", paths) as advance:
        result = build_library(study, out, workers=chosen, progress=advance)
    if as_json:
        print_json({"paths": result.paths, "seconds": result.seconds})
    else:
        say(f"{out}: {result.paths} load paths, {result.seconds:.1f} s")
