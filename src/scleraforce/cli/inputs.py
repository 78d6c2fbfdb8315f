"""What a frame is read with, for JSON and in words: its scale and what is known of its eye, each with its source."""

from typing import TYPE_CHECKING, Any, Final

from scleraforce.units import HumanUnit, from_si

if TYPE_CHECKING:
    from scleraforce.known import Known
    from scleraforce.recording.folder import ScaledFrame

UNKNOWN_GLOBE = "unknown: give --globe; intervals are wider and withdrawals come earlier"
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
Sources = list[tuple[str, Value, str]]


def scale_entry(frame: "ScaledFrame") -> dict[str, Any]:
    """Return the scale of a frame with its sources, for JSON."""
    width, depth, index = frame.width_m, frame.depth_m, frame.refractive_index
    return {
        "width_mm": {"value": from_si(width.value, "mm"), "source": width.source},
        "depth_mm": {"value": from_si(depth.value, "mm"), "source": depth.source},
        "refractive_index": {"value": index.value, "source": index.source},
    }


def size_words(frame: "ScaledFrame") -> str:
    """Return the same for people, equal sources once: "15 x 4 mm (recording.toml), refractive index 1 (option)"."""
    width, depth, index = frame.width_m, frame.depth_m, frame.refractive_index
    mm = [f"{from_si(extent.value, 'mm'):.4g}" for extent in (width, depth)]
    sizes = (
        f"{mm[0]} x {mm[1]} mm ({width.source})"
        if width.source == depth.source
        else f"{mm[0]} mm ({width.source}) x {mm[1]} mm ({depth.source})"
    )
    return f"{sizes}, refractive index {index.value:g} ({index.source})"


def known_sources(given: "Known", stated: "Known", known: "Known") -> Sources:
    """Return key, value and source of all that may be known; stiffening and k only where they are.

    Args:
        given: by options.
        stated: by the recording.
        known: in the end, where a calibration may add to both.
    """
    from scleraforce.known import completed

    first, second, used = _values(given), _values(completed(given, stated)), _values(known)
    return [
        (key, value, "unknown" if value is None else _source(value, first[key], second[key]))
        for key, value in used.items()
        if key not in (RIGIDITY, STIFFENING) or value is not None
    ]


def known_words(sources: Sources) -> str:
    """Return the same for people: "modulus 0.3 MPa (option), IOP unknown"."""
    return ", ".join(
        f"{WORDS[key][0]} unknown" if value is None else f"{WORDS[key][0]} {_printed(key, value)} ({source})"
        for key, value, source in sources
    )


def globe_words(known: "Known", reads_force: bool) -> str:
    """Return with which globe a model reads an eye, and the cost of an unknown one.

    >>> from scleraforce.known import Known
    >>> from scleraforce.known import SEALED
    >>> globe_words(Known(globe=SEALED), reads_force=True)
    'sealed, k between 0.005 and 0.06 mmHg^(1/3)/µl'
    """
    from scleraforce.known import UNKNOWN

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


def _source(value: Value, given: Value, completed: Value) -> str:
    if value == given:
        return "option"
    return "recording.toml" if value == completed else "calibration"


def _printed(key: str, value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}{WORDS[key][1]}"


def _values(known: "Known") -> dict[str, Value]:
    """Return all that may be known of an eye, each value in the unit of its key."""
    globe = known.globe
    return {
        "youngs_modulus_mpa": _in_unit(known.modulus.mean_pa if known.modulus else None, "mpa"),
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
