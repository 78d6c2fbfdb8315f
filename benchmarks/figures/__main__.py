"""`make figures`: virtual eyes that no training has seen, calibrated and read as users
do, to one table; and studies of single questions.

python -m figures [OPTIONS]        the tables
python -m figures STUDY [OPTIONS]  a study; `--help` lists all

Nothing is tuned here: the eyes are drawn from fixed seeds, computed in three dimensions
at finite strain, imaged by the virtual laboratory of the paper's study, and read.
Eyes that this code has made in the folder are reused.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import click

from figures import studies
from figures.declared import declare
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.groups import DEFAULT_READER, GROUPS, SEED, draw_eyes
from figures.page import insert_tables
from figures.picture import draw_forces
from figures.printing import PATH, whole_number
from figures.readings import (
    CALIBRATED_FRAMES,
    Method,
    calibrated_eyes,
    make_methods,
    paper_method,
    raw_method,
    read_frames,
)
from figures.recordings import make_recordings
from figures.reuse import take_up
from figures.scores import AnsweredFrame, score
from figures.table import GroupResult, ModulusErrors, as_markdown
from provenance.behaviour import behaviour, keep
from provenance.stamps import new_stamp
from scleraforce.base.errors import ScleraforceError
from scleraforce.base.units import from_si
from scleraforce.base.whole_files import write_whole
from scleraforce.base.worker_processes import available_cores
from scleraforce.front.cli.output import progress_bar
from scleraforce.front.report.figure_files import write_figure
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.records.model_folder import SHIPPED
from scleraforce.records.study import Study

STUDY = Study()


class Studies(click.Group):
    """The tables, and the studies as commands, each imported when it is named."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's
        """Return the names of the studies."""
        modules = iter_modules(studies.__path__)
        return sorted(module.name.replace("_", "-") for module in modules)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return the command of a study."""
        if cmd_name not in self.list_commands(ctx):
            return None
        name = cmd_name.replace("-", "_")
        command: click.Command = import_module(f"figures.studies.{name}").main
        return command


def _group_names(text: str) -> tuple[str, ...]:
    """Return names of groups, separated by commas, each once."""
    names = tuple(dict.fromkeys(text.split(",")))
    for name in names:
        if name not in GROUPS:
            raise click.BadParameter(
                f"{name!r} is not a group; there are {', '.join(GROUPS)}"
            )
    return names


def _counts(text: str) -> dict[str, int]:
    """Return the number of eyes in each group: one for all, then others by name."""
    every, *others = text.split(",")
    named = dict(other.partition("=")[::2] for other in others)
    _group_names(",".join(named or GROUPS))
    texts = dict.fromkeys(GROUPS, every) | named
    for number in texts.values():
        if not number.isdigit() or int(number) < 2:
            raise click.BadParameter(
                f"{number!r}: give numbers of eyes, 2 or more, like 30 or 30,needle=6"
            )
    return {name: int(number) for name, number in texts.items()}


# frames after which the error of E is listed
ERROR_FRAMES = {"plain": (CALIBRATED_FRAMES, 5)}

Drawn = Mapping[str, tuple[FigureEye, ...]]  # by group


@dataclass(frozen=True)
class Group:
    """A group of eyes and the answers to their frames."""

    name: str
    eyes: tuple[FigureEye, ...]
    answers: dict[Method, tuple[AnsweredFrame, ...]]


@click.group(cls=Studies, invoke_without_command=True)
@click.option(
    "--out",
    type=PATH,
    default=Path("out/figures"),
    show_default=True,
    help="Folder of the results; eyes that this code has made there are reused.",
)
@click.option(
    "--eyes",
    "counts",
    type=_counts,
    default="30",
    show_default=True,
    metavar="N,GROUP=N,...",
    help="Number of eyes in each group, and other numbers by name.",
)
@click.option(
    "--groups",
    "names",
    type=_group_names,
    default=",".join(GROUPS),
    metavar="GROUP,GROUP,...",
    help=f"Groups, in their order; all by default: {','.join(GROUPS)}.",
)
@whole_number("--workers", available_cores(), "Processes that compute the eyes.")
@click.option(
    "--reader", type=PATH, default=SHIPPED["default"], help="Another trained reader."
)
@click.option(
    "--living-reader",
    type=PATH,
    default=SHIPPED["living"],
    help="Another reader of the living preset.",
)
@click.option(
    "--raw-reader", type=PATH, help="A trained raw reader, for a row of its own."
)
@click.option(
    "--page",
    type=click.Path(path_type=Path, exists=True),
    help=("Page of the docs to put the tables into; the picture goes beside it."),
)
@whole_number("--seed", SEED, "Of the draw of the eyes.")
@click.option(
    "--still",
    is_flag=True,
    help="Hold the eyes of all groups still, to measure movement.",
)
@click.pass_context
def main(
    ctx: click.Context,
    out: Path,
    counts: dict[str, int],
    names: tuple[str, ...],
    workers: int,
    reader: Path,
    living_reader: Path,
    raw_reader: Path | None,
    page: Path | None,
    seed: int,
    still: bool,
) -> None:
    """Read virtual eyes that no training has seen; write figures.md and figures.png
    to the folder.
    """
    if ctx.invoked_subcommand is not None:
        return

    now = behaviour()
    take_up(out, now)
    folder = FiguresFolder(out)
    eyes_of = {
        group: tuple(
            eye.held_still() if still else eye
            for eye in draw_eyes(group, counts[group], STUDY, seed)
        )
        for group in names
    }
    for group, eyes in eyes_of.items():
        if not eyes:
            click.echo(f"{group}: no scans in ../shared/real-oct; left out", err=True)
    drawn: Drawn = {group: eyes for group, eyes in eyes_of.items() if eyes}
    drawn = _computed(folder, drawn, workers)
    folder = declare(folder, _recordings(drawn))
    readers = {
        DEFAULT_READER: make_methods(DEFAULT_READER, reader),
        "living": make_methods("living", living_reader),
    }
    if raw_reader is not None:
        readers[DEFAULT_READER].append(raw_method(raw_reader))
    papers = [paper_method(folder, drawn["plain"], STUDY)] if "plain" in drawn else []
    groups = []
    for name, eyes in drawn.items():
        methods = [*readers[GROUPS[name].reader], *papers]
        with progress_bar(methods, f"{name} eyes") as bar:
            answers = {method: read_frames(folder, eyes, method) for method in bar}
        groups.append(Group(name, eyes, answers))

    results = [_result(folder, group) for group in groups]
    stamp = new_stamp("make figures")
    tables = as_markdown(results)
    write_whole(f"{stamp}\n\n{tables}", out / "figures.md")
    pictures = [out / "figures.png"]
    if page is not None:
        insert_tables(tables, stamp, page)
        keep(stamp, now)
        pictures.append(page.parent / "images" / "figures.png")

    shown = {group.name: next(iter(group.answers.values())) for group in groups}
    bounds_mn = [from_si(bound_n, "mn") for bound_n in STUDY.classes.bounds_n]
    for picture in pictures:
        write_figure(draw_forces(shown, bounds_mn), picture)

    click.echo(tables)


def _recordings(drawn: Drawn) -> list[FigureEye]:
    """Return all eyes, and those of recordings that only calibrate, each once."""
    return [
        one
        for eyes in drawn.values()
        for eye in eyes
        for one in dict.fromkeys((eye, eye.calibrating))
    ]


def _computed(folder: FiguresFolder, drawn: Drawn, workers: int) -> Drawn:
    """Compute and image eyes; return those that could be computed."""
    eyes = _recordings(drawn)
    with progress_bar(range(len(eyes)), "eyes", total=len(eyes)) as bar:
        failed = make_recordings(folder, eyes, workers, bar.update)

    for name in failed:
        click.echo(f"{name}: could not be computed, and is left out", err=True)

    return {
        group: tuple(eye for eye in eyes if eye_name(eye.setup) not in failed)
        for group, eyes in drawn.items()
    }


def _result(folder: FiguresFolder, group: Group) -> GroupResult:
    frames = next(iter(group.answers.values()))
    counts = ERROR_FRAMES.get(group.name, (CALIBRATED_FRAMES,))
    return GroupResult(
        group.name,
        len(group.eyes),
        len(frames),
        {method: score(answered) for method, answered in group.answers.items()},
        [_modulus_errors(folder, group.eyes, count) for count in counts],
    )


def _modulus_errors(
    folder: FiguresFolder, eyes: Sequence[FigureEye], frames: int
) -> ModulusErrors:
    calibrated = calibrated_eyes(folder, eyes, frames)
    found = [(calibrated[eye_name(drawn.setup)], drawn.setup.eye) for drawn in eyes]
    errors = [
        own.eye.modulus_pa / true.modulus_pa - 1.0 for own, true in found if own.usable
    ]
    return ModulusErrors(frames, tuple(errors), len(eyes) - len(errors))


if __name__ == "__main__":
    try:
        main(standalone_mode=False)
    except click.ClickException as fault:
        fault.show()
        sys.exit(fault.exit_code)
    except ScleraforceError as fault:
        click.echo(f"error: {fault}", err=True)
        sys.exit(1)
    except (KeyboardInterrupt, click.Abort):
        click.echo("interrupted; the same command resumes here", err=True)
        sys.exit(130)
