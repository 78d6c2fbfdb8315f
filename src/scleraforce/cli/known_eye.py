"""The options by which a user tells what is known of an eye, shared by the commands that read its frames."""

from collections.abc import Callable
from math import isfinite
from typing import TYPE_CHECKING, Any, Final, TypeVar

import click

from scleraforce.cli.globe import known_globe_options, told_globe
from scleraforce.cli.quantities import Possible
from scleraforce.errors import InputError
from scleraforce.units import HumanUnit, from_si, to_si

if TYPE_CHECKING:
    from scleraforce.known.eye import Known

Command = TypeVar("Command", bound=Callable[..., Any])

OPTIONS = (
    click.option(
        "--youngs-modulus-mpa", type=Possible("youngs_modulus_mpa"), help="Of this eye; by default it is not known."
    ),
    click.option("--iop-mmhg", type=Possible("iop_mmhg"), help="Intraocular pressure; likewise."),
    click.option("--thickness-um", type=Possible("thickness_um"), help="Of the wall; likewise."),
    click.option("--gap-mm", type=Possible("gap_mm"), help="Distance of the B-scan from the needle axis; likewise."),
    click.option("--polar-angle-deg", type=Possible("polar_angle_deg"), help="Of the contact from the pole; likewise."),
    click.option(
        "--plane-direction-deg",
        type=click.FloatRange(-360.0, 360.0),
        help="Of the B-scan's lateral axis, from the meridian that leads away from the pole; likewise.",
    ),
    click.option("--stiffening", type=click.FloatRange(0.0), help="b of the tissue; by default it does not stiffen."),
)


def known_eye_options(command: Command) -> Command:
    """Add the options to a command: the arguments of `known_eye`."""
    command = known_globe_options(command)
    for option in reversed(OPTIONS):
        command = option(command)
    return command


def known_eye(
    youngs_modulus_mpa: float | None,
    iop_mmhg: float | None,
    thickness_um: float | None,
    gap_mm: float | None,
    polar_angle_deg: float | None,
    plane_direction_deg: float | None,
    stiffening: float | None,
    globe: str | None,
    rigidity: float | None,
) -> "Known":
    """Return what the options say of an eye.

    Raises:
        InputError: a value that is no number, or a rigidity without a sealed globe.
    """
    from scleraforce.known.eye import Known, Modulus

    given = {"youngs-modulus-mpa": youngs_modulus_mpa, "iop-mmhg": iop_mmhg, "thickness-um": thickness_um,
             "gap-mm": gap_mm, "polar-angle-deg": polar_angle_deg, "plane-direction-deg": plane_direction_deg,
             "stiffening": stiffening, "rigidity": rigidity}  # fmt: skip
    for name, value in given.items():
        if value is not None and not isfinite(value):
            raise InputError(f"--{name}: {value} is not a finite number; leave it out where it is not known")
    return Known(
        modulus=None if youngs_modulus_mpa is None else Modulus.stated(to_si(youngs_modulus_mpa, "mpa")),
        iop_pa=to_si(iop_mmhg, "mmhg"),
        thickness_m=to_si(thickness_um, "um"),
        gap_m=to_si(gap_mm, "mm"),
        polar_rad=to_si(polar_angle_deg, "deg"),
        direction_rad=to_si(plane_direction_deg, "deg"),
        globe=told_globe(globe, rigidity),
        stiffening=stiffening,
    )


def known_entry(told: "Known", stated: "Known") -> dict[str, Any]:
    """Return what a frame was read with, each value with who states it, for JSON."""
    return {key: {"value": value, "source": source} for key, value, source in _sourced(told, stated)}


def known_words(told: "Known", stated: "Known") -> str:
    """Return the same for people: "modulus 0.3 MPa (option), IOP unknown"."""
    return ", ".join(
        f"{WORDS[key][0]} unknown" if value is None else f"{WORDS[key][0]} {_printed(key, value)} ({source})"
        for key, value, source in _sourced(told, stated)
    )


def globe_words(known: "Known", reads_force: bool) -> str:
    """Return with which globe a model reads an eye, and what it costs where that is not known.

    >>> from scleraforce.known.eye import Known
    >>> from scleraforce.known.eye import SEALED
    >>> globe_words(Known(globe=SEALED), reads_force=True)
    'sealed, k between 0.005 and 0.06 mmHg^(1/3)/µl'
    """
    from scleraforce.known.eye import UNKNOWN

    globe = UNKNOWN if known.globe is None else known.globe
    if not reads_force:
        return "taken for open: a classifier knows no other, and in a sealed eye forces are read too low"
    if not globe.can_be_sealed:
        return "open"
    ends = globe.band if globe.calibrated or globe.rigidity_told else (globe.lowest, globe.highest)
    low, high = (f"{from_si(end, RIGIDITY_UNIT):.2g}" for end in ends)
    k = f"k between {low} and {high} mmHg^(1/3)/µl"
    if globe.calibrated:
        return f"{'open or sealed' if globe.kind == 'unknown' else globe.kind}, {k} (calibrated)"
    return f"sealed, {k}" if globe.kind == "sealed" else UNKNOWN_GLOBE


UNKNOWN_GLOBE = "unknown: tell --globe; intervals are wider and withdrawals come earlier"
RIGIDITY_UNIT: Final = "mmhg13_per_ul"
RIGIDITY, STIFFENING = f"rigidity_{RIGIDITY_UNIT}", "stiffening"
WORDS = {  # name and unit of each key, for people
    "youngs_modulus_mpa": ("modulus", " MPa"),
    "iop_mmhg": ("IOP", " mmHg"),
    "thickness_um": ("thickness", " µm"),
    "gap_mm": ("gap", " mm"),
    "polar_angle_deg": ("polar angle", "°"),
    "plane_direction_deg": ("plane's direction", "°"),
    STIFFENING: ("stiffening", ""),
    "globe": ("globe", ""),
    RIGIDITY: ("k", " mmHg^(1/3)/µl"),
}
Value = float | str | None


def _printed(key: str, value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}{WORDS[key][1]}"


def _sourced(told: "Known", stated: "Known") -> list[tuple[str, Value, str]]:
    """Return key, value and source of all that may be known: what was told comes first.

    Stiffening and k stand where they are told.
    """
    from scleraforce.known.eye import completed

    first, used = _values(told), _values(completed(told, stated))
    return [
        (key, value, "unknown" if value is None else "recording.toml" if first[key] is None else "option")
        for key, value in used.items()
        if key not in (RIGIDITY, STIFFENING) or value is not None
    ]


def _values(known: "Known") -> dict[str, Value]:
    """Return all that may be known of an eye, each value in the unit of its key."""
    modulus_pa = known.modulus.mean_pa if known.modulus else None
    globe = known.globe
    return {
        "youngs_modulus_mpa": _in_unit(modulus_pa, "mpa"),
        "iop_mmhg": _in_unit(known.iop_pa, "mmhg"),
        "thickness_um": _in_unit(known.thickness_m, "um"),
        "gap_mm": _in_unit(known.gap_m, "mm"),
        "polar_angle_deg": _in_unit(known.polar_rad, "deg"),
        "plane_direction_deg": _in_unit(known.direction_rad, "deg"),
        STIFFENING: known.stiffening,
        "globe": None if globe is None else globe.kind,
        RIGIDITY: _in_unit(globe.mean, RIGIDITY_UNIT) if globe and globe.rigidity_told else None,
    }


def _in_unit(value: float | None, unit: HumanUnit) -> float | None:
    return None if value is None else float(f"{from_si(value, unit):.12g}")
