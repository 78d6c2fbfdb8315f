"""A measured scanner as a study file: the sections [oct] and [phantom], with what every key came from."""

import json
from collections.abc import Sequence
from dataclasses import fields

from scleraforce.scanner.drawn import oct_of
from scleraforce.scanner.estimate import Unmeasured
from scleraforce.scanner.measure import COUNTS, MEASURED, OF_FRAMES, MeasuredScanner
from scleraforce.study import PhantomStudy, Study, format_study
from scleraforce.study.fields import field_key

MOST_NAMES = 20  # of frames that are listed
OCT_KEYS = ("width_mm", "depth_mm", "columns", "rows", "bits", "refractive_index")


def study_text(scanner: MeasuredScanner, names: Sequence[str], date: str, version: str) -> str:
    """Return the file's text.

    Args:
        scanner: what was measured.
        names: of the frames.
        date: of the measurement.
        version: of scleraforce.
    """
    study = Study(oct=oct_of(scanner.frames[0].eye), phantom=scanner.phantom())
    sections = _sections(format_study(study))
    keys = {item.name: field_key(item) for item in fields(PhantomStudy)}
    listed = [f"#   {json.dumps(name)}" for name in names[:MOST_NAMES]]
    if len(names) > MOST_NAMES:
        listed.append(f"#   and {len(names) - MOST_NAMES} more")
    lines = [
        f"# A scanner, measured by `scleraforce scanner` {version} on {date}, on {len(names)} frame(s):",
        *listed,
        "# All that does not stand here, eye, needle and forces too, is as in the paper's study.",
        "",
        "[oct]",
        *(sections["oct"][key] for key in OCT_KEYS),
        "",
        "[phantom]  # levels in dB are ratios of intensity",
    ]
    slope = scanner.ranges["spread_slope"]
    taken = f"  # taken for granted: {slope.reason}" if isinstance(slope, Unmeasured) else ""
    lines.append(f"{sections['phantom']['display']}{taken}")
    lines += [_line(keys[name], sections["phantom"], scanner.ranges[name]) for name in MEASURED[:OF_FRAMES]]
    for count in COUNTS:
        lines.append(f"{sections['phantom'][keys[count]]}  # of each frame")
        kind = count.removesuffix("count")
        lines += [
            _line(keys[name], sections["phantom"], scanner.ranges[name]) for name in MEASURED if name.startswith(kind)
        ]
    return "\n".join(lines) + "\n"


def _line(key: str, section: dict[str, str], found: object) -> str:
    if isinstance(found, Unmeasured):
        return f"# {key}: not measured, as in the paper's study: {found.reason}"
    at_most = "  # at most: finer than the pixels show" if getattr(found, "at_most", False) else ""
    return section[key] + at_most


def _sections(text: str) -> dict[str, dict[str, str]]:
    """Return the lines of a study's text by section and key."""
    found: dict[str, dict[str, str]] = {}
    for line in text.splitlines():
        if line.startswith("["):
            found[line.strip("[]")] = section = {}
        elif " = " in line:
            section[line.partition(" = ")[0]] = line
    return found
