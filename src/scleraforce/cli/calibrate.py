"""`scleraforce calibrate`: Young's modulus from recordings."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from scleraforce.cli.output import count_bar, print_json, say
from scleraforce.cli.quantities import Possible
from scleraforce.cli.wall_finder_option import finder_folder, wall_finder_option
from scleraforce.errors import InputError
from scleraforce.plain_text import wrapped
from scleraforce.study import Study, read_study
from scleraforce.study.unused import refuse_unused
from scleraforce.units import to_si

if TYPE_CHECKING:
    from scleraforce.calibration.result import Calibration

CALIBRATED = 3  # frames of each recording, where the others are read


class _Parameters(click.ParamType[tuple[str, ...]]):
    """Names of parameters, separated by commas."""

    name = "NAME,NAME,..."
    known = ("e", "stiffening", "iop", "thickness", "gap")

    def convert(
        self, value: str | tuple[str, ...], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Return the names."""
        names = value if isinstance(value, tuple) else tuple(part.strip().lower() for part in value.split(","))
        if "e" not in names or set(names) - set(self.known) or len(set(names)) < len(names):
            self.fail(
                f"{value!r}: give e, and of stiffening, iop, thickness, gap what is uncertain too, like e,iop",
                param,
                ctx,
            )
        return names


class _Notes:
    """Notes on recordings: printed at once, or with JSON in its object."""

    def __init__(self, as_json: bool) -> None:
        self.said: list[str] = []
        self._as_json = as_json

    def __call__(self, sentence: str) -> None:
        self.said.append(sentence)
        if not self._as_json:
            say(wrapped(sentence, "note: "))


@click.command()
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--study", "study_path", type=click.Path(path_type=Path), help="Study file; the paper's by default.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="File to write; must not exist.")
@click.option(
    "--frames",
    type=click.IntRange(1),
    help="Take so many frames above 5 mN of each recording: the highest force, and even shares of it.",
)
@click.option("--mechanics", type=click.Choice(["finite-strain", "linear"]), default="finite-strain",
              show_default=True, help="How the wall bends; linear is the paper's.")  # fmt: skip
@click.option("--parameters", type=_Parameters(), show_default="e,stiffening; linear: e",
              help="What is uncertain, of e, stiffening, iop, thickness, gap.")  # fmt: skip
@click.option(
    "--thickness-um", type=Possible("thickness_um"), help="Of the eye's wall, in place of what recording.toml states."
)
@wall_finder_option
@click.option("--resume", type=click.Path(path_type=Path), help="Go on from an earlier file of this command.")
@click.option("--intervals", "model", type=click.Path(path_type=Path), metavar="MODEL",
              help="Stretch a reader's intervals (a folder's, or `default`) to hold on these recordings; --out is "
              "its copy.")  # fmt: skip
@click.option("--plot", type=click.Path(path_type=Path), help="Picture to write as well; must not exist.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def calibrate(
    recordings: tuple[Path, ...],
    study_path: Path | None,
    out: Path,
    frames: int | None,
    mechanics: str,
    parameters: tuple[str, ...] | None,
    thickness_um: float | None,
    finder: Path | None,
    resume: Path | None,
    model: Path | None,
    plot: Path | None,
    as_json: bool,
) -> None:
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
    if model is not None:
        unused = (study_path, resume, plot, parameters, thickness_um)
        if mechanics != "finite-strain" or any(option is not None for option in unused):
            raise click.UsageError(
                "--intervals: takes the model's own study; of the options, only --frames, --wall-finder and --json"
            )
        _stretch(model, recordings, out, frames or CALIBRATED, finder, as_json)
        return
    notes = _Notes(as_json)
    from scleraforce.calibration.result import calibration_as_json, parse_calibration
    from scleraforce.known.calibration_file import open_calibration, write_calibration
    from scleraforce.notebook.work import calibrate_eyes
    from scleraforce.report.files import check_figure_path
    from scleraforce.report.shown.calibration import calibration_lines

    for path in (out, plot):
        if path is not None and path.exists():
            raise InputError(f"{path}: exists already; remove it or choose another name")
    if plot is not None:
        check_figure_path(plot)
    study = Study() if study_path is None else read_study(study_path)
    refuse_unused(study, "calibrate", mechanics, study_path)
    earlier = None if resume is None else parse_calibration(open_calibration(resume))
    result = calibrate_eyes(
        recordings,
        study,
        count_bar,
        mechanics=mechanics,
        parameters=parameters,
        frames=frames,
        earlier=earlier,
        wall_finder=finder_folder(finder),
        thickness_m=to_si(thickness_um, "um"),
        note=notes,
    )
    content = calibration_as_json(result)
    write_calibration(content, out)
    if plot is not None:
        _draw(result, plot)
    if as_json:
        print_json({**content, "notes": notes.said})
    else:
        say("\n".join(calibration_lines(result)))
        say(f"wrote {out}")


def _stretch(
    model: Path, recordings: tuple[Path, ...], out: Path, frames: int, finder: Path | None, as_json: bool
) -> None:
    """Write a reader whose intervals hold on recordings, and say by how much they changed."""
    from scleraforce.notebook.work import recalibrate_intervals
    from scleraforce.reader.intervals import FEW_EYES

    folder = finder_folder(finder)
    notes = _Notes(as_json)
    changes = recalibrate_intervals(model, recordings, out, count_bar, frames=frames, wall_finder=folder, note=notes)
    if as_json:
        each = [asdict(change) for change in changes]
        print_json({"model": str(out), "from": str(model), "stretches": each, "notes": notes.said})
        return
    say(f"{'method':<9}{'modulus':<9}{'globe':<28}{'eyes':>5}{'readings':>10}{'held':>7}{'factor':>8}")
    for change in changes:
        counts = f"{change.eyes:>5}{change.readings:>10}{change.held:>7.0%}{change.factor:>8.2f}"
        say(f"{change.method:<9}{change.modulus:<9}{', '.join(change.globes):<28}{counts}")
    if min(change.eyes for change in changes) < FEW_EYES:
        say(f"note: of fewer than {FEW_EYES} eyes the widest reading counts; none becomes narrower")
    say(f"wrote {out}")


def _draw(result: "Calibration", path: Path) -> None:
    from scleraforce.report.calibration_figures import draw_calibration
    from scleraforce.report.files import write_figure

    write_figure(draw_calibration(result), path)
