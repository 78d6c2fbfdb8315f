"""`scleraforce calibrate`: Young's modulus from recordings."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scleraforce.cli.options import PATH, eye_options, options
from scleraforce.cli.output import Command, Report, count_bar, is_json, refuse_existing, say
from scleraforce.plain_text import wrapped
from scleraforce.study import Study

if TYPE_CHECKING:
    from scleraforce.reader.intervals import Stretch

CALIBRATED = 3  # frames of each recording, where the others are read


def _names(_: click.Context, __: click.Parameter, value: str | None) -> tuple[str, ...] | None:
    return None if value is None else tuple(part.strip().lower() for part in value.split(","))


class _Notes(list[str]):
    """Notes on recordings: printed at once, or with JSON in its object."""

    def __call__(self, sentence: str) -> None:
        self.append(sentence)
        if not is_json():
            say(wrapped(sentence, "note: "))


@click.command(cls=Command)
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=PATH)
@options("study")
@click.option("--out", type=PATH, required=True, help="File to write; must not exist.")
@click.option("--frames", type=click.IntRange(1), help="Number of frames above 5 mN to take of each recording: the "
              "highest force, and even shares of it.")  # fmt: skip
@click.option("--mechanics", type=click.Choice(["finite-strain", "linear"]), default="finite-strain",
              show_default=True, help="How the wall bends; linear is the paper's.")  # fmt: skip
@click.option("--parameters", metavar="NAME,NAME,...", callback=_names, show_default="e,stiffening; linear: e",
              help="What is uncertain, of e, stiffening, iop, thickness, gap.")  # fmt: skip
@eye_options("thickness_m", default="by default the recordings'")
@options("finder")
@click.option("--resume", type=PATH, help="Continue from an earlier file of this command.")
@click.option("--intervals", "model", type=PATH, metavar="MODEL", help="Stretch a reader's intervals (a folder's, or "
              "`default`) to hold on these recordings; --out is its copy.")  # fmt: skip
@options("plot", plot="Picture to write as well; must not exist.")
@click.pass_context
def calibrate(
    ctx: click.Context,
    /,
    recordings: tuple[Path, ...],
    study: Study,
    out: Path,
    frames: int | None,
    mechanics: str,
    parameters: tuple[str, ...] | None,
    thickness_m: float | None,
    finder: Path | None,
    resume: Path | None,
    model: Path | None,
    plot: Path | None,
) -> Report:
    """Estimate Young's modulus of each eye from its RECORDINGs.

    A reduced-order unscented Kalman filter compares points on the wall's
    boundaries with those of the simulated section, frame by frame. The
    population's modulus is the mean of the eyes' means. How much the tissue
    stiffens is found by trying it. Finite strain needs the response library:
    that of another study than the paper's is made on first need (a minute).
    What a reader of the study would not read afterwards is noted at the start.

    With --intervals, each eye is calibrated on three of its frames (or on
    --frames); the reader reads the others, and its copy in --out has intervals
    that hold for 90 % of them.
    """
    notes = _Notes()
    if model is not None:
        default = click.core.ParameterSource.DEFAULT
        others = ("study", "resume", "plot", "parameters", "thickness_m", "mechanics")
        if any(ctx.get_parameter_source(name) != default for name in others):
            raise click.UsageError(
                "--intervals: takes the model's own study; of the options, only --frames, --wall-finder and --json"
            )
        from scleraforce.notebook.calibrating import recalibrate_intervals

        changes = recalibrate_intervals(
            model, recordings, out, count_bar, frames=frames or CALIBRATED, wall_finder=finder, note=notes
        )
        each = [asdict(change) for change in changes]
        return Report(
            {"model": str(out), "from": str(model), "stretches": each, "notes": notes},
            [*_table(changes), f"wrote {out}"],
        )
    import scleraforce as sf
    from scleraforce.calibration.result import calibration_as_json
    from scleraforce.report.files import check_figure_path
    from scleraforce.report.shown.calibration import calibration_lines

    refuse_existing(plot)
    if plot is not None:
        check_figure_path(plot)
    found = sf.calibrate(
        recordings,
        study,
        frames=frames,
        parameters=parameters,
        mechanics=mechanics,
        earlier=resume,
        wall_finder=finder,
        thickness_m=thickness_m,
        out=out,
        note=notes,
        counting=count_bar,
    )
    if plot is not None:
        from scleraforce.report.calibration_figures import draw_calibration
        from scleraforce.report.files import write_figure

        write_figure(draw_calibration(found), plot)
    return Report({**calibration_as_json(found), "notes": notes}, [*calibration_lines(found), f"wrote {out}"])


def _table(changes: "Sequence[Stretch]") -> Iterator[str]:
    """Yield by how much the intervals of a reader changed."""
    from scleraforce.reader.intervals import FEW_EYES

    yield f"{'method':<9}{'modulus':<9}{'globe':<28}{'eyes':>5}{'readings':>10}{'held':>7}{'factor':>8}"
    for change in changes:
        counts = f"{change.eyes:>5}{change.readings:>10}{change.held:>7.0%}{change.factor:>8.2f}"
        yield f"{change.method:<9}{change.modulus:<9}{', '.join(change.globes):<28}{counts}"
    if min(change.eyes for change in changes) < FEW_EYES:
        yield f"note: of fewer than {FEW_EYES} eyes the widest reading counts; none becomes narrower"
