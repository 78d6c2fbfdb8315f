"""What the page asks for: checked, as a job and as the command line that does the same.

The page shows these command lines, so that every step can be repeated without the app.
"""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from pydantic import BaseModel, Field, FiniteFloat

from scleraforce.base.errors import InputError
from scleraforce.front.app.job_messages import (
    CalibrateJob,
    EvaluateJob,
    ImportJob,
    Job,
)
from scleraforce.front.app.source_views import ANSWERS, Checked
from scleraforce.front.app.work_folder import Folder
from scleraforce.recordings.import_sources import ImportOptions
from scleraforce.records.fields import check_quantity
from scleraforce.records.model_folder import SHIPPED
from scleraforce.records.scan import Plane, parse_plane

Kind = TypeVar("Kind", CalibrateJob, EvaluateJob)

IMPORT = "import"
CALIBRATE = "calibrate"
EVALUATE = "evaluate"
COMMAND_OF = {ImportJob: IMPORT, CalibrateJob: CALIBRATE, EvaluateJob: EVALUATE}


def _options(kind: type[Any], operands: set[str]) -> set[str]:
    return {field.name for field in fields(kind)} - operands


# The options of each command: all that its job has.
OPTIONS = {
    IMPORT: ANSWERS,
    CALIBRATE: _options(CalibrateJob, {"recordings", "out"}),
    EVALUATE: _options(EvaluateJob, {"model", "recordings"}),
}
NEW_FILES = ("html",)
OLD_FILES = ("calibration", "times")
LISTS = ("parameters",)  # of names, with commas between them
# Options whose bounds are checked in their own units; records would name them in SI.
QUANTITIES = (
    "width_mm",
    "depth_mm",
    "thickness_um",
    "iop_mmhg",
    "gap_mm",
    "polar_angle_deg",
)
COUNTS = ("first_frame", "last_frame", "frames")
DIGITS = 15  # of a number: a clock counts from 1970, in ms


@dataclass(frozen=True)
class CommandWords:
    """The command line's spelling of fields, which the command `app` hands down.

    Both functions take the name of a command, or None: a field may have another flag
    there. They go to worker processes, so they are functions of a module.
    """

    flag_of: Callable[[str, str | None], str]  # of a field
    json_worded: Callable[[Any, str | None], Any]  # flags for fields in texts of JSON

    def worded(self, found: Any, command: str | None = None) -> Any:
        """Return JSON with flags in place of the fields in its texts."""
        return self.json_worded(found, command)

    def fault(self, text: str, command: str) -> str:
        """Return a fault of a command with flags in place of fields, also where it
        begins with the name of one.
        """
        name, colon, rest = text.partition(":")
        if colon and name in OPTIONS.get(command, set()) | {"out"}:
            text = f"{self.flag_of(name, command)}:{rest}"
        return str(self.worded(text, command))


def command_of(job: Job) -> str:
    """Return the name of the command that does a job."""
    return COMMAND_OF[type(job)]


def command_line(words: Sequence[str]) -> str:
    """Return the command line that a user would type.

    >>> command_line(["show", "my scan.tif"])
    "scleraforce show 'my scan.tif'"
    """
    return shlex.join(["scleraforce", *words])


def operand(name: str) -> str:
    """Return a file's name as an operand, which is no flag.

    >>> operand("-5.png")
    './-5.png'
    """
    return f"./{name}" if name.startswith("-") else name


class Asked(BaseModel):
    """Operands of a command, planes of some, its options by the names of their fields,
    and a log's columns.
    """

    operands: list[str] = Field(min_length=1, max_length=20000)
    planes: dict[str, str] = {}
    options: dict[str, int | FiniteFloat | str | bool] = {}
    columns: list[str] = Field([], max_length=20)

    @property
    def import_options(self) -> ImportOptions:
        """The options of an import; raises `ValidationError` for a wrong type."""
        given: dict[str, Any] = dict(self.options)
        if "times" in given:
            given["times"] = Path(str(given["times"]))
        checked = Checked(**given, columns=tuple(self.columns))

        # a plain record, which goes to another process
        names = [field.name for field in fields(ImportOptions)]
        return ImportOptions(**{name: getattr(checked, name) for name in names})

    @property
    def placed(self) -> list[tuple[str, Plane | None]]:
        """The operands with their planes; those without one come first, and those of
        one plane together.
        """
        planes = ["", *self.planes.values()]
        return [
            (name, parse_plane(plane) if plane else None)
            for plane in dict.fromkeys(planes)
            for name in self.operands
            if self.planes.get(name, "") == plane
        ]

    def read(
        self, folder: Folder
    ) -> tuple[list[Path], list[Plane | None], ImportOptions]:
        """Return the paths of an import, their planes and its options; raises
        `InputError` or `ValidationError`.
        """
        options = self.import_options
        if options.times is not None:
            options = replace(options, times=folder.inside(str(options.times)))
        planes = [
            parse_plane(self.planes[name]) if name in self.planes else None
            for name in self.operands
        ]

        return [folder.whole(name) for name in self.operands], planes, options


class CommandRequest(Asked):
    """A command, with the name of the file or folder that it writes."""

    command: str
    out: str = ""


def job_of(run: CommandRequest, folder: Folder) -> Job:
    """Return a job, checked: known options of the right type, paths inside the folder,
    and nothing that exists is written.

    Raises:
        InputError: something of it cannot be done.
        ValidationError: an option of an import has the wrong type.
    """
    if run.command not in OPTIONS:
        raise InputError(f"{run.command}: not a command of the app")
    for name in run.options:
        if name not in OPTIONS[run.command]:
            raise InputError(f"{name}: not an option of {run.command} in the app")

    of_bundled = run.command == EVALUATE and run.operands[0] in SHIPPED
    read = run.operands[1:] if of_bundled else list(run.operands)
    for name in [
        *read,
        *(str(run.options[key]) for key in OLD_FILES & run.options.keys()),
    ]:
        if not folder.whole(name).exists():
            raise InputError(f"{name}: does not exist")

    _check_values(run.options)
    written = [str(run.options[key]) for key in NEW_FILES if key in run.options]
    for name in [*written, *([] if run.command == EVALUATE else [run.out])]:
        folder.new(name)

    if run.command == IMPORT:
        return ImportJob(
            sources=tuple(name for name, _ in run.placed),
            planes=tuple(plane for _, plane in run.placed) if run.planes else (),
            out=run.out,
            options=run.import_options,
        )
    if run.columns or run.planes:
        raise InputError(f"columns: not an option of {run.command} in the app")
    if run.command == CALIBRATE:
        operands = {"recordings": run.operands, "out": run.out}
        return _converted(CalibrateJob, operands, run)

    if len(run.operands) < 2:
        raise InputError("recordings: none; give at least one")
    operands = {"model": run.operands[0], "recordings": run.operands[1:]}
    return _converted(EvaluateJob, operands, run)


def _check_values(options: Mapping[str, int | float | str | bool]) -> None:
    """Check numbers of options as the command line does."""
    for name, value in options.items():
        if name in QUANTITIES and isinstance(value, int | float):
            check_quantity(name, value)
        if name in COUNTS and isinstance(value, int) and value < 1:
            raise InputError(f"{name}: {value}; give at least 1")


def _converted(kind: type[Kind], operands: dict[str, Any], run: CommandRequest) -> Kind:
    options: dict[str, Any] = dict(run.options)
    for name in LISTS:
        if isinstance(options.get(name), str):
            parts = options[name].split(",")
            options[name] = [part.strip().lower() for part in parts]

    try:
        return msgspec.convert(operands | options, kind)
    except msgspec.ValidationError as fault:
        words, _, place = str(fault).partition(" - at ")
        name = place.strip("`$.") or run.command
        raise InputError(f"{name}: {words}") from fault


def words_of(run: CommandRequest, spelled: CommandWords) -> list[str]:
    """Return the words of the command that does the job of a request."""
    command = run.command
    words = [command]
    plane = ""
    for name, _ in run.placed:
        if (own := run.planes.get(name, "")) != plane:
            words.append(f"{spelled.flag_of('planes', command)}={own}")
            plane = own
        words.append(operand(name))

    for name, value in run.options.items():
        text = f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)
        flag = spelled.flag_of(name, command)
        if value is True:
            words.append(flag)
        elif value is not False:
            words.append(f"{flag}={text}")

    columns = spelled.flag_of("columns", command)
    words += [f"{columns}={column}" for column in run.columns]
    if command != EVALUATE:
        words.append(f"{spelled.flag_of('out', command)}={run.out}")

    return words
