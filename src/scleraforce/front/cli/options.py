"""The options that commands share, in one table. A quantity arrives in SI, under the
argument's name in `sf.*`.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.units import HumanUnit, to_si
from scleraforce.records.fields import QUANTITIES, allowed_bounds, check_quantity
from scleraforce.records.model_folder import (
    SHIPPED_WALL_FINDER,
    model_folder,
    path_or_bundled,
)
from scleraforce.records.scan import Plane, check_planes, parse_plane
from scleraforce.records.study import Study, read_study
from scleraforce.records.study_of_eye import GLOBES, relaxation_terms

if TYPE_CHECKING:
    from scleraforce.records.setup import Setup

Decorated = TypeVar("Decorated", bound=Callable[..., Any])

PATH: Final[click.Path] = click.Path(path_type=Path)


class _ModelPath(click.Path):
    """MODEL: the name of a bundled model, or a path; the value is a folder."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(
        self,
        value: str | PathLike[str],
        param: click.Parameter | None,  # noqa: ARG002 - click's signature
        ctx: click.Context | None,  # noqa: ARG002 - click's signature
    ) -> Any:
        return model_folder(value)


class _ThingPath(_ModelPath):
    """The name of a bundled model, or the path of anything."""

    def convert(
        self,
        value: str | PathLike[str],
        param: click.Parameter | None,  # noqa: ARG002 - click's signature
        ctx: click.Context | None,  # noqa: ARG002 - click's signature
    ) -> Any:
        return path_or_bundled(value)


class _FinderPath(_ModelPath):
    def convert(
        self,
        value: str | PathLike[str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Any:
        return None if value == "none" else super().convert(value, param, ctx)


MODEL: Final = _ModelPath()
THING: Final = _ThingPath()
STUDY_FILE = "study file"  # in the meta of click's context


class Quantity(click.FloatRange):
    """A number within the bounds of a quantity, in the unit of its key; the error
    suggests another unit.

    >>> Quantity("thickness_um").convert("650", None, None)
    0.00065
    >>> Quantity("thickness_um", in_si=False).convert("650", None, None)
    650.0
    """

    def __init__(self, key: str, *, in_si: bool = True) -> None:
        bounds = allowed_bounds(key)
        super().__init__(bounds.low, bounds.high)
        self._key = key
        self._in_si = in_si

    def convert(
        self,
        value: str | float,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> float:
        """Return the number, in SI unless it stays in the unit of its key."""
        try:
            number = float(value)
            check_quantity(self._key, number)
        except ValueError:
            self.fail(f"{value!r} is not a valid float.", param, ctx)
        except StudyError as fault:
            self.fail(str(fault).partition(": ")[2], param, ctx)

        name = next(name for name in QUANTITIES if self._key.startswith(name))
        return QUANTITIES[name].to_si(number) if self._in_si else number


class _GlobeChoice(click.Choice[str]):
    def convert(
        self, value: str, param: click.Parameter | None, ctx: click.Context | None
    ) -> str:
        return super().convert("sealed" if value == "closed" else value, param, ctx)


GLOBE = _GlobeChoice(GLOBES)


class RelaxationOption(click.ParamType[str]):
    """Terms of a share and a time constant, or `none`; `auto`, if it is allowed, leaves
    them to the log.
    """

    name = "relaxation"

    def __init__(self, *, auto: bool = False) -> None:
        self._auto = auto

    def convert(
        self,
        value: str,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> str:
        """Return the text, checked."""
        if not (self._auto and value == "auto"):
            try:
                relaxation_terms(value)
            except StudyError as fault:
                self.fail(str(fault).partition(": ")[2], param, ctx)

        return value


class _LeanQuantity(Quantity):
    def convert(
        self,
        value: str | float,
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> Any:
        return value if value == "unknown" else super().convert(value, param, ctx)


def in_si(
    unit: HumanUnit,
) -> Callable[[click.Context, click.Parameter, float | None], float | None]:
    """Return the callback of an option in a human unit."""
    return lambda _, __, value: to_si(value, unit)


def declared_eye(given: Mapping[str, Any]) -> "Setup":
    """Return what the options of `EYE` declare of an experiment, by their arguments."""
    # 25 ms: NumPy, not for --help
    from scleraforce.front.api.shorthand import setup_of_options

    return setup_of_options(given)


def new_file(_: click.Context, __: click.Parameter, path: Path | None) -> Path | None:
    """Check, before the work begins, that a file to write does not exist, but its
    folder: the callback of an option.
    """
    if path is not None and path.exists():
        raise InputError(f"{path}: exists already; remove it or choose another name")
    if path is not None and not path.absolute().parent.is_dir():
        raise InputError(f"{path}: its folder does not exist")
    return path


def _new_figure(
    ctx: click.Context, option: click.Parameter, path: Path | None
) -> Path | None:
    if path is not None:
        # 250 ms: Matplotlib, not without a figure
        from scleraforce.front.report.figure_files import check_figure_path

        check_figure_path(path)
    return new_file(ctx, option, path)


def _study(ctx: click.Context, _: click.Parameter, path: Path | None) -> Study:
    if path is None:
        return Study()
    ctx.meta[STUDY_FILE] = path
    return read_study(path)


# Of each argument: the option, its type or other settings, and its help.
TABLE: Mapping[str, tuple[str, Any, str]] = {
    "study": (
        "--study",
        {"type": PATH, "callback": _study},
        "Study file; default: the paper's study.",
    ),
    "calibration": (
        "--calibration",
        PATH,
        "File of `calibrate`: gives the eye's modulus.",
    ),
    "wall_finder": (
        "--wall-finder",
        {
            "type": _FinderPath(),
            "default": SHIPPED_WALL_FINDER,
            "metavar": "MODEL",
        },
        (
            "Model of `train --kind wall-finder` that checks the walls; `none`: no"
            " check. Default: the bundled one."
        ),
    ),
    "html": (
        "--html",
        {"type": PATH, "callback": new_file},
        "Page to write as well; must not exist.",
    ),
    "plot": (
        "--plot",
        {"type": PATH, "callback": _new_figure},
        "Picture to write as well (PNG, SVG, PDF); must not exist.",
    ),
    "sheet": (
        "--sheet",
        {"type": PATH, "callback": _new_figure},
        (
            "Picture of the frames with the walls of both methods, the worst first"
            " (PNG, SVG, PDF); must not exist. Needs no --out."
        ),
    ),
    "force": ("--force", {"is_flag": True}, "Replace files that exist."),
    "scheduler": (
        "--scheduler",
        {"metavar": "ADDRESS"},
        "Dask scheduler whose workers do the work.",
    ),
    "workers": (
        "--workers",
        click.IntRange(min=1),
        "Number of processes; default: one for each core.",
    ),
    "mechanics": (
        "--mechanics",
        click.Choice(["linear", "finite-strain"]),
        (
            "Mechanics of the wall: small displacements (linear) or large ones;"
            " default: the study's."
        ),
    ),
    "host": (
        "--host",
        {"default": "127.0.0.1", "show_default": True},
        "Address of the monitor.",
    ),
    "port": (
        "--port",
        {"type": click.IntRange(1, 65535), "default": 18944, "show_default": True},
        "Port of the monitor.",
    ),
    "width_m": (
        "--width-mm",
        Quantity("width_mm"),
        (
            "Width of the frames; default: their recording's, else their "
            "file's (DICOM, TIFF)."
        ),
    ),
    "depth_m": (
        "--depth-mm",
        Quantity("depth_mm"),
        (
            "Depth of the frames as stored; default: their recording's, else "
            "their file's (DICOM, TIFF)."
        ),
    ),
    "refractive_index": (
        "--refractive-index",
        click.FloatRange(1.0, 2.0),
        (
            "Refractive index of the depth axis (1: already corrected); default: the"
            " recording's, else the model's study's (read), else 1."
        ),
    ),
    "transpose": (
        "--transpose",
        {"is_flag": True},
        "The frames' depth runs along their rows, from left to right.",
    ),
}
_ANGLE = {"type": click.FloatRange(-360.0, 360.0), "callback": in_si("deg")}
FRAME_SIZE = ("width_m", "depth_m", "refractive_index", "transpose")
LEAN_DEFAULT = "the recording's, else the calibration's, else along the normal"
# An eye's quantities; each command adds their default to the help.
EYE: Mapping[str, tuple[str, Any, str]] = {
    "youngs_modulus_pa": (
        "--youngs-modulus-mpa",
        Quantity("youngs_modulus_mpa"),
        "Young's modulus of the wall",
    ),
    "iop_pa": ("--iop-mmhg", Quantity("iop_mmhg"), "Intraocular pressure"),
    "thickness_m": (
        "--thickness-um",
        Quantity("thickness_um"),
        "Thickness of the wall",
    ),
    "gap_m": (
        "--gap-mm",
        Quantity("gap_mm"),
        "Distance of the B-scan plane from the needle axis",
    ),
    "polar_angle_rad": (
        "--polar-angle-deg",
        Quantity("polar_angle_deg"),
        "Polar angle of the contact",
    ),
    "plane_direction_rad": (
        "--plane-direction-deg",
        _ANGLE,
        (
            "Direction of the B-scan's lateral axis, from the "
            "meridian that leads away from the pole"
        ),
    ),
    "lean_rad": (
        "--lean-deg",
        {"type": _LeanQuantity("lean_deg"), "metavar": "A|unknown"},
        (
            "Angle between the needle and the wall's normal; unknown: the interval"
            " spans 0 to 45 degrees"
        ),
    ),
    "stiffening": (
        "--stiffening",
        click.FloatRange(0.0),
        "Stiffening parameter b of the tissue (docs/physics.md)",
    ),
    "globe": (
        "--globe",
        GLOBE,
        "Open: the pressure is constant; sealed (or closed): it rises with the dent",
    ),
    "rigidity_pa13_per_m3": (
        "--rigidity",
        Quantity("rigidity"),
        "Rigidity k of a sealed globe, mmHg^(1/3) per µl",
    ),
}


def options(
    *names: str, default: str = "", required: tuple[str, ...] = (), **words: str
) -> Callable[[Decorated], Decorated]:
    """Return a decorator that adds options of `TABLE` and `EYE`; `words` have another
    default or help.
    """
    made = []
    for name in names:
        flag, settings, help_text = TABLE.get(name) or EYE[name]
        if name in TABLE:
            help_text = words.get(name, help_text)
        else:
            help_text += (
                "." if name in required else f"; default: {words.get(name, default)}."
            )

        settings = settings if isinstance(settings, dict) else {"type": settings}
        made.append(
            click.option(
                flag, name, help=help_text, required=name in required, **settings
            )
        )

    return added(made)


def added(made: Sequence[Callable[[Any], Any]]) -> Callable[[Decorated], Decorated]:
    """Return a decorator that adds options in this order."""
    return lambda command: reduce(
        lambda done, option: option(done), reversed(made), command
    )


def chosen_workers(scheduler: str | None, workers: int | None) -> int | None:
    """Return the processes, or the workers of the scheduler; None by default."""
    if scheduler is None:
        return workers
    if workers is not None:
        raise click.UsageError(
            f"--workers {workers}: --scheduler has workers of its own; give one of"
            " the two"
        )

    # 12 ms: not without --scheduler
    from scleraforce.base.worker_processes import cluster_workers

    return cluster_workers(scheduler)


PLANE: Final = "NAME:OFFSET_MM:DIRECTION_DEG"


class PlacedPlane(click.Option):
    """The option --plane, whose values carry the number of arguments to their left on
    the command line.
    """

    def add_to_parser(self, parser: Any, ctx: click.Context) -> None:
        """Add the option."""
        super().add_to_parser(parser, ctx)
        for name in self.opts:
            option = parser._long_opt[name]
            option.process = lambda value, state, take=option.process: take(
                f"{len(state.largs)}:{value}", state
            )

    def type_cast_value(
        self, ctx: click.Context, value: Any
    ) -> tuple[tuple[int, str], ...]:
        """Return the number of arguments before each value, and the value."""
        given = (one.split(":", 1) for one in super().type_cast_value(ctx, value))
        return tuple((int(count), words) for count, words in given)


def planes_of(
    paths: Sequence[Path], given: Sequence[tuple[int, str]]
) -> list[Plane | None]:
    """Return the plane of each path, None before the first --plane; `given`: the number
    of paths before each.
    """
    planes = [parse_plane(words) for _, words in given]
    check_planes(tuple(dict.fromkeys(planes)), "--plane")
    found: list[Plane | None] = [None] * len(paths)

    for (before, _), plane in zip(given, planes, strict=True):
        found[before:] = [plane] * (len(paths) - before)

    if unused := [plane for plane in planes if plane not in found]:
        raise InputError(
            f"--plane: {unused[0].name!r}: no frames follow it; give it before the"
            " frames of its plane"
        )

    return found
