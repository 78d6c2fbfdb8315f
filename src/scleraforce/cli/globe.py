"""The options by which a user makes virtual eyes open or sealed, shared by `simulate` and `phantom`."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import click

from scleraforce.study import Study
from scleraforce.study.fields import field_unit
from scleraforce.study.globe import GLOBES, GlobeStudy

__all__ = ["globe_options", "with_globe"]

Command = TypeVar("Command", bound=Callable[..., Any])

RIGIDITY = field_unit(GlobeStudy.__dataclass_fields__["rigidity_pa13_per_m3"])
OPTIONS = (
    click.option("--globe", type=click.Choice(GLOBES), help="Whether the pressure stays as it is or rises "
                 "with the dent (finite strain only); the study's by default (open, if it does not say)."),
    click.option("--rigidity", type=float, help="Of a sealed globe, in mmHg^(1/3) per µl; the study's by default "
                 "(0.03, if it does not say)."),
)  # fmt: skip


def globe_options(command: Command) -> Command:
    """Add the options to a command: the last arguments of `with_globe`."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command


def with_globe(study: Study, globe: str | None, rigidity: float | None) -> Study:
    """Put the options into the study, whose records check them as they check a study file."""
    return replace(study, globe=study.globe.told(globe, None if rigidity is None else RIGIDITY.to_si(rigidity)))
