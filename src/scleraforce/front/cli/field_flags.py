"""The flags of the command line, and the names of fields that stand for them in
messages.

Packages below name a field in backquotes, as the Python API calls it: "`width_m`",
"`flip=rows`", or in a command: "`train kind=reader`". The command line prints the flag
in its place. This is the only table of both; a test compares it with all options.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final

# Fields whose flags differ from their names.
IRREGULAR: Final[Mapping[str, str]] = {
    "azimuth_rad": "--azimuth-deg",
    "bound_n": "--bound-mn",
    "columns": "--column",
    "depth_m": "--depth-mm",
    "direction_rad": "--direction-deg",
    "displacement_m": "--displacement-mm",
    "force_n": "--force-mn",
    "forces_n": "--forces-mn",
    "gap_m": "--gap-mm",
    "iop_pa": "--iop-mmhg",
    "lean_rad": "--lean-deg",
    "loss_in_window_s": "--unread-ms",
    "masks": "--mask",
    "open_page": "--open",
    "opens": "--open",
    "plane_direction_rad": "--plane-direction-deg",
    "planes": "--plane",
    "polar_angle_rad": "--polar-angle-deg",
    "puncture_n": "--puncture-mn",
    "ramp_n_per_s": "--ramp-mn-per-s",
    "reaction_s": "--reaction-ms",
    "replace": "--force",
    "retraction_m_s": "--retraction-mm-s",
    "rigidity_pa13_per_m3": "--rigidity",
    "thickness_m": "--thickness-um",
    "tilt_rad": "--tilt-deg",
    "width_m": "--width-mm",
    "youngs_modulus_pa": "--youngs-modulus-mpa",
}
# Fields whose flags are their names with hyphens.
REGULAR: Final = (
    "answers",
    "array",
    "average_s",
    "axes",
    "axis",
    "bits",
    "black_box",
    "by_arrival",
    "calibration",
    "clock_offset_s",
    "contact_sign",
    "device",
    "eye",
    "fault",
    "fault_at_s",
    "first_frame",
    "flip",
    "force",
    "force_topic",
    "frames",
    "frames_by",
    "gauge",
    "globe",
    "grey_range",
    "held_s",
    "hold_s",
    "host",
    "html",
    "image_topic",
    "json",
    "kind",
    "last_frame",
    "learn_eye",
    "like",
    "mask_sd_rows",
    "mechanics",
    "model",
    "on_pierced",
    "out",
    "overlay",
    "parameters",
    "plot",
    "port",
    "preload",
    "preset",
    "quiet",
    "range_n",
    "rate_hz",
    "record",
    "refractive_index",
    "relaxation",
    "resume",
    "rows",
    "scheduler",
    "search",
    "second_opinion",
    "seed",
    "sheet",
    "speed",
    "step",
    "stiffening",
    "strict",
    "study",
    "table",
    "times",
    "token_file",
    "transpose",
    "unusable_frames",
    "unusable_opinions",
    "version",
    "vtu",
    "wall_finder",
    "web_host",
    "web_port",
    "withdraw_class",
    "without_force",
    "workers",
)
FLAGS: Final[Mapping[str, str]] = MappingProxyType(
    {**{name: f"--{name.replace('_', '-')}" for name in REGULAR}, **IRREGULAR}
)
# By command: fields that another command has with another flag, or that are no fields
# of others. They hold while the command runs.
OF_COMMAND: Final[Mapping[str, Mapping[str, str]]] = {
    "calibrate": {
        "estimator": "--method",
        "model": "--intervals",
        "prior": "--calibration",
    },
    "monitor": {"columns": "--columns"},
    "phantom": {"name": "--eye"},
    "reproduce": {"train": "--train"},
}

# A name, with a value or without, that is no part of a file's name or of a quotation.
_FIELD = re.compile(r"""(?<![\w/.'"`-])`(\w+)(?:=([^`]*))?`(?![\w/'"`-]|\.\w)""")
_LINE = re.compile(r"`(?:scleraforce [a-z-]+|train|calibrate|import) [^`]*`")
_GIVEN = re.compile(r" (\w+)=")


def flag_of(field: str, command: str | None = None) -> str:
    """Return the flag that gives a field.

    >>> flag_of("width_m"), flag_of("columns"), flag_of("columns", "monitor")
    ('--width-mm', '--column', '--columns')
    """
    return _known_flag(field, command) or f"--{field.replace('_', '-')}"


def _known_flag(field: str, command: str | None) -> str | None:
    return OF_COMMAND.get(command or "", {}).get(field) or FLAGS.get(field)


def in_flags(text: str, command: str | None = None) -> str:
    """Return a message with flags in place of fields in backquotes, as users of the
    command type them; what is no field stays.

    >>> in_flags("give `width_m`, or turn the frames (`flip=rows`)")
    'give --width-mm, or turn the frames (--flip rows)'
    >>> in_flags("`scleraforce train DATASET out=MODEL` and `calibrate` make files")
    '`scleraforce train DATASET --out MODEL` and `calibrate` make files'
    """
    if "`" not in text:
        return text

    def field(found: re.Match[str]) -> str:
        flag = _known_flag(found[1], command)
        if flag is None:
            return found[0]
        return flag if found[2] is None else f"{flag} {found[2]}"

    def given(found: re.Match[str]) -> str:
        flag = _known_flag(found[1], command)
        return found[0] if flag is None else f" {flag} "

    return _FIELD.sub(field, _LINE.sub(lambda line: _GIVEN.sub(given, line[0]), text))


def json_in_flags(found: Any, command: str | None = None) -> Any:
    """Return plain types with flags in all texts, as by `in_flags`."""
    if isinstance(found, str):
        return in_flags(found, command)
    if isinstance(found, Mapping):
        return {key: json_in_flags(value, command) for key, value in found.items()}
    if isinstance(found, list | tuple):
        return [json_in_flags(value, command) for value in found]
    return found
