"""The options by which a user tells what is known of an eye, shared by the commands that read its frames."""

from collections.abc import Callable
from math import isfinite
from typing import TYPE_CHECKING, Any, TypeVar

import click

from scleraforce.errors import InputError
from scleraforce.units import HumanUnit, from_si, to_si

if TYPE_CHECKING:
    from scleraforce.known.eye import Known

__all__ = ["known_entry", "known_eye", "known_eye_options", "known_words"]

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
    from scleraforce.known.eye import Known, Modulus

    given = {"youngs-modulus-mpa": youngs_modulus_mpa, "iop-mmhg": iop_mmhg, "thickness-um": thickness_um,
             "gap-mm": gap_mm}  # fmt: skip
    for name, value in given.items():
        if value is not None and not isfinite(value):
            raise InputError(f"--{name}: {value} is not a finite number; leave it out where it is not known")
    return Known(
        modulus=None if youngs_modulus_mpa is None else Modulus.stated(to_si(youngs_modulus_mpa, "mpa")),
        iop_pa=to_si(iop_mmhg, "mmhg"),
        thickness_m=to_si(thickness_um, "um"),
        gap_m=to_si(gap_mm, "mm"),
    )


def known_entry(told: "Known", stated: "Known") -> dict[str, Any]:
    """Return what a frame was read with, each value with who states it, for JSON."""
    return {name: {"value": value, "source": source} for name, _, value, source in _sourced(told, stated)}


def known_words(told: "Known", stated: "Known") -> str:
    """Return the same for people: "modulus 0.3 MPa (option), IOP unknown"."""
    return ", ".join(
        f"{name} unknown" if value is None else f"{name} {value:.4g}{unit} ({source})"
        for _, (name, unit), value, source in _sourced(told, stated)
    )


Words = tuple[str, str]  # name and unit


def _sourced(told: "Known", stated: "Known") -> list[tuple[str, Words, float | None, str]]:
    """Return key, words, value and source of all that may be known: what was told comes first."""
    return [
        (key, words, second, "unknown" if second is None else "recording.toml")
        if first is None
        else (key, words, first, "option")
        for (key, words, first), (_, _, second) in zip(_values(told), _values(stated), strict=True)
    ]


def _values(known: "Known") -> list[tuple[str, Words, float | None]]:
    """Return key, words and value, in the unit of both, of all that may be known of an eye."""
    modulus_pa = known.modulus.mean_pa if known.modulus else None
    return [
        ("youngs_modulus_mpa", ("modulus", " MPa"), _in_unit(modulus_pa, "mpa")),
        ("iop_mmhg", ("IOP", " mmHg"), _in_unit(known.iop_pa, "mmhg")),
        ("thickness_um", ("thickness", " µm"), _in_unit(known.thickness_m, "um")),
        ("gap_mm", ("gap", " mm"), _in_unit(known.gap_m, "mm")),
        ("polar_angle_deg", ("polar angle", "°"), _in_unit(known.polar_rad, "deg")),
    ]


def _in_unit(value: float | None, unit: HumanUnit) -> float | None:
    return None if value is None else float(f"{from_si(value, unit):.12g}")
