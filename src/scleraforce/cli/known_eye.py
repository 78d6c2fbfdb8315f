"""The options by which a user tells what is known of an eye, shared by the commands that read its frames."""

from collections.abc import Callable
from math import isfinite
from typing import TYPE_CHECKING, Any, TypeVar

import click

from scleraforce.errors import InputError
from scleraforce.units import mmhg_to_pa

if TYPE_CHECKING:
    from scleraforce.reader.known import Known

__all__ = ["known_eye", "known_eye_options"]

Command = TypeVar("Command", bound=Callable[..., Any])

POSITIVE = click.FloatRange(0.0, min_open=True)
OPTIONS = (
    click.option("--youngs-modulus-mpa", type=POSITIVE, help="Of this eye; by default it is not known."),
    click.option("--iop-mmhg", type=click.FloatRange(0.0), help="Intraocular pressure; likewise."),
    click.option("--thickness-um", type=POSITIVE, help="Of the wall; likewise."),
    click.option("--gap-mm", type=click.FloatRange(0.0), help="Distance of the B-scan from the needle axis; likewise."),
)


def known_eye_options(command: Command) -> Command:
    """Add the options to a command: the arguments of `known_eye`."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command


def known_eye(
    youngs_modulus_mpa: float | None, iop_mmhg: float | None, thickness_um: float | None, gap_mm: float | None
) -> "Known":
    """Return what the options say of an eye.

    Raises:
        InputError: a value that is no number.
    """
    from scleraforce.reader.known import Known, Modulus

    given = {"youngs-modulus-mpa": youngs_modulus_mpa, "iop-mmhg": iop_mmhg, "thickness-um": thickness_um,
             "gap-mm": gap_mm}  # fmt: skip
    for name, value in given.items():
        if value is not None and not isfinite(value):
            raise InputError(f"--{name}: {value} is not a finite number; leave it out where it is not known")
    return Known(
        None if youngs_modulus_mpa is None else Modulus.stated(youngs_modulus_mpa * 1e6),
        None if iop_mmhg is None else mmhg_to_pa(iop_mmhg),
        None if thickness_um is None else thickness_um / 1e6,
        None if gap_mm is None else gap_mm / 1e3,
    )
