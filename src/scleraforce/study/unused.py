"""Keys of a study that would change the eye of a command if its mechanics knew them: it refuses them."""

from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from scleraforce.errors import StudyError
from scleraforce.study import Study, SupportsStudy
from scleraforce.study.fields import field_key

LEAK = ("globe.leak_time_s",)  # of a globe in time
FINITE_STRAIN_ONLY = (
    "form.semi_axes", "form.wave", "form.region", "form.cornea", "needle.tilt_deg", "needle.tilt_direction_deg",
    "mechanics.follower", "tissue.stiffening", "tissue.softer_through", "tissue.stiffer_around", "globe.kind",
    "globe.rigidity_mmhg13_per_ul", "globe.rigidity_law", *LEAK,
)  # fmt: skip
SUPPORTS = tuple(f"supports.{field_key(item)}" for item in fields(SupportsStudy))  # kind, bed (2), straps (2)
EYE_MOVEMENT = ("phantom.eye_drift_deg", "phantom.eye_saccade_deg")
SHARED_WALL = (*FINITE_STRAIN_ONLY, *SUPPORTS)  # walls that serve many contacts: even, clamped at the base
LIBRARY = (*SHARED_WALL, "eye.density_kg_m3")  # walls of revolution about the needle, without weight

# Command, and mechanics where it has a choice: the keys that it does not use. Relaxation is
# `phantom`'s: elsewhere a force makes its dent at once, or the log shows how it falls; only `reproduce` refuses it.
UNUSED: dict[tuple[str, str | None], tuple[str, ...]] = {
    ("simulate", "linear"): FINITE_STRAIN_ONLY,
    ("simulate", "finite-strain"): LEAK,
    ("phantom", "linear"): FINITE_STRAIN_ONLY,
    ("phantom", "finite-strain"): (),
    ("generate", "linear"): SHARED_WALL,
    ("generate", "finite-strain"): LIBRARY,
    ("calibrate", "linear"): SHARED_WALL,
    ("calibrate", "finite-strain"): tuple(key for key in LIBRARY if key != "tissue.stiffening"),
    ("library", None): LIBRARY,
    ("train --kind reader", None): LIBRARY,
    ("train --kind raw-reader", None): (*LIBRARY, *EYE_MOVEMENT, "phantom.needle_count"),
    ("reproduce", None): (*SHARED_WALL, "tissue.relaxation", *EYE_MOVEMENT),
}

# Why a key is not used, where its name does not tell.
REASONS = {
    "tissue.stiffening": "linear mechanics knows no tissue that stiffens, and a library has a range of it, [library]"
}


def refuse_unused(study: Study, command: str, mechanics: str | None = None) -> None:
    """Refuse a study that sets a key which a command does not use, or which another key switches off."""
    changed = set(_changed(study))
    if found := [key for key in UNUSED[command, mechanics] if key in changed]:
        wall = f" with {mechanics} mechanics" if mechanics else ""
        wall += "".join(f" ({reason})" for key, reason in REASONS.items() if key in found)
        remedy = f"leave {'it' if len(found) == 1 else 'them'} out"
        others = [kind for name, kind in UNUSED if name == command and kind and not {*found} & {*UNUSED[name, kind]}]
        remedy += f", or give --mechanics {others[0]}" if others else ""
        raise StudyError(f"study: {', '.join(found)}: not used by `{command}`{wall}; {remedy}")
    for key, cause, remedy in _switched_off(study):
        if key in changed:
            raise StudyError(f"study: {key}: has no effect with {cause}; leave it out, or give {remedy}")


def _changed(study: Study) -> Iterator[str]:
    defaults = Study()
    for section in fields(study):
        record: Any = getattr(study, section.name)
        default = getattr(defaults, section.name)
        for item in fields(record):
            if getattr(record, item.name) != getattr(default, item.name):
                yield f"{section.name}.{field_key(item)}"


def _switched_off(study: Study) -> Iterator[tuple[str, str, str]]:
    supports = study.supports
    parts = {"bed": (supports.has_bed, SUPPORTS[1:3]), "straps": (supports.has_straps, SUPPORTS[3:])}
    for part, (there, keys) in parts.items():
        for key in () if there else keys:
            yield key, f'supports.kind = "{supports.kind}"', f'"{part}" or "bed-and-straps"'
    if study.needle.tilt_rad == 0.0:
        yield "needle.tilt_direction_deg", "needle.tilt_deg = 0", "a tilt"
    if study.globe.kind == "open":
        yield "globe.rigidity_mmhg13_per_ul", 'globe.kind = "open"', '"sealed"'
        yield "globe.rigidity_law", 'globe.kind = "open"', '"sealed"'
        yield LEAK[0], 'globe.kind = "open"', '"sealed"'
