"""The monitor that `sf.monitor` runs in a process of its own: fields in SI units become
the words of the command.
"""

import json
import sys
from collections.abc import Mapping
from typing import Any, Final

from scleraforce.base.units import HumanUnit, from_si
from scleraforce.front.cli import main as command_line
from scleraforce.front.cli.field_flags import flag_of

# Units of the command's numbers.
UNITS: Final[Mapping[str, HumanUnit]] = {
    "youngs_modulus_pa": "mpa",
    "iop_pa": "mmhg",
    "thickness_m": "um",
    "gap_m": "mm",
    "polar_angle_rad": "deg",
    "plane_direction_rad": "deg",
    "lean_rad": "deg",
    "width_m": "mm",
    "depth_m": "mm",
    "rigidity_pa13_per_m3": "mmhg13_per_ul",
}


def main() -> None:
    """Run the command with a model and with fields as JSON, the two arguments of this
    process.
    """
    model, fields = sys.argv[1:]
    sys.argv[1:] = monitor_words(model, json.loads(fields))
    command_line.main()


def monitor_words(model: str, fields: Mapping[str, Any]) -> list[str]:
    """Return the words of the command on a free port; a field of None is not given.

    >>> monitor_words("default", {"gap_m": 0.0005, "eye": None})
    ['monitor', 'default', '--port', '0', '--json', '--gap-mm', '0.5']
    """
    words = ["monitor", model, flag_of("port"), "0", flag_of("json")]
    for field, value in fields.items():
        if value is not None:
            words += _words_of(field, value)
    return words


def _words_of(field: str, value: Any) -> list[str]:
    flag = flag_of(field, "monitor")
    if field in UNITS and value != "unknown":
        return [flag, repr(from_si(float(value), UNITS[field]))]
    if field == "second_opinion":
        return [] if value else ["--no-second-opinion"]
    if field == "planes":
        return [word for plane in value for word in (flag, _plane_words(*plane))]
    return [flag, str(value)]


def _plane_words(name: str, offset_m: float, direction_rad: float) -> str:
    offset_mm = from_si(offset_m, "mm")
    direction_deg = from_si(direction_rad, "deg")
    return f"{name}:{offset_mm!r}:{direction_deg!r}"
