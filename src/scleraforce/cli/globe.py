"""The options by which a user tells whether a globe is open or sealed: of virtual eyes, and of those that are read."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

import click

from scleraforce.cli.quantities import Possible
from scleraforce.errors import InputError, StudyError
from scleraforce.study import Study
from scleraforce.study.eye import GLOBES, GlobeStudy
from scleraforce.study.fields import field_unit

if TYPE_CHECKING:
    from scleraforce.known.eye import KnownGlobe

Command = TypeVar("Command", bound=Callable[..., Any])

RIGIDITY = field_unit(GlobeStudy.__dataclass_fields__["rigidity_pa13_per_m3"])
KIND = "Whether the pressure stays as it is or rises with the dent"
RATE = "Of a sealed globe, in mmHg^(1/3) per µl"


def _options(kind: str, rate: str) -> Callable[[Command], Command]:
    """Return a decorator that adds the options, each with the rest of its help."""

    def decorated(command: Command) -> Command:
        return click.option("--globe", type=click.Choice(GLOBES), help=f"{KIND}{kind}")(
            click.option("--rigidity", type=Possible("rigidity"), help=f"{RATE}{rate}")(command)
        )

    return decorated


globe_options = _options(  # of a command on virtual eyes: the last arguments of `with_globe`
    " (finite strain only); the study's by default (open, if it does not say).",
    "; the study's by default (0.03, if it does not say).",
)
known_globe_options = _options(  # of a command that reads eyes: the arguments of `told_globe`
    "; by default it is not known, and intervals are wider.",
    "; by default it is not known.",
)


def with_globe(study: Study, globe: str | None, rigidity: float | None) -> Study:
    """Put the options into the study, whose records check them as they check a study file.

    Raises:
        InputError: a rigidity, and neither the options nor the study say that the globe is sealed.
    """
    _check_rigidity(globe or study.globe.kind, rigidity)
    return replace(study, globe=study.globe.told(globe, None if rigidity is None else RIGIDITY.to_si(rigidity)))


def told_globe(globe: str | None, rigidity: float | None) -> "KnownGlobe | None":
    """Return what the options say of a globe; None: nothing.

    Raises:
        InputError: a rigidity of a globe that is not said to be sealed, or one that no globe has.
    """
    from scleraforce.known.eye import known_globe

    _check_rigidity(globe, rigidity)
    if globe is None:
        return None
    try:
        return known_globe(globe, None if rigidity is None else RIGIDITY.to_si(rigidity))
    except StudyError as fault:
        raise InputError(f"--rigidity: {fault}") from fault


def _check_rigidity(globe: str | None, rigidity: float | None) -> None:
    if rigidity is not None and globe != "sealed":
        raise InputError(f"--rigidity: of a sealed globe; tell --globe sealed, too, or leave {rigidity:g} out")
