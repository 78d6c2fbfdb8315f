"""`--wall-finder`: the network that checks the walls which a command segments."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from scleraforce.models.folder import SHIPPED_WALL_FINDER

Command = TypeVar("Command", bound=Callable[..., Any])

NONE = Path("none")


def wall_finder_option(command: Command) -> Command:
    """Add the option to a command: its argument `finder` is for `finder_folder`."""
    option = click.option(
        "--wall-finder",
        "finder",
        metavar="MODEL",
        type=click.Path(path_type=Path),
        help="Model of `train --kind wall-finder` that checks the walls; none: nothing checks them. Default: the one "
        "that ships with scleraforce.",
    )
    return option(command)


def finder_folder(finder: Path | None) -> Path | None:
    """Return the folder of the wall finder that was asked for: the shipped one by default, None for "none"."""
    return None if finder == NONE else finder or SHIPPED_WALL_FINDER
