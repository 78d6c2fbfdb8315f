"""Places of the needle from one frame, against virtual eyes in three dimensions: the
figures of docs/reader.md, "Where the needle is".

Eyes are drawn as for `make figures`, by another seed: each is bent in 3-D, and pushed
with forces up to 60 mN. Frames are drawn as phantoms, each with a pose of its own, and
read by `default` with E, IOP and thickness of calipers and gauges (`KNOWN_ERRORS`),
with the gap and without. The contact is where the needle's axis meets the dented
surface. With `--needles` a shaft crosses the picture at a lean of up to 35 degrees, and
the gap is within the needle's radius.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import pi, radians

import click
import numpy as np

import scleraforce as sf
from figures.accuracy import percent, rms
from figures.eyes import FigureEye
from figures.groups import draw_eyes
from figures.printing import print_table, whole_number
from figures.sections import compute_eye
from scleraforce.base.units import HumanUnit, from_si
from scleraforce.lab.virtual_eye import scan_plane
from scleraforce.lab.virtual_recording import plan_phantom, plan_sections, render_frame
from scleraforce.mechanics.loads_and_supports import tip_at
from scleraforce.reading.needle_place import PlaceValue
from scleraforce.reading.reading_models import Reader
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import Globe
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale, Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range, Study, fixed
from virtual_eyes import changed, wall_of

# E and IOP: relative
KNOWN_ERRORS = {"modulus": 0.02, "iop": 0.03, "thickness_m": 10e-6, "gap_m": 20e-6}
GAPS = ("given", "not given")


@dataclass(frozen=True)
class ReadPlace:
    """A place that was read, None where it was not, beside the true one."""

    name: str
    gap: str
    true: float
    place: PlaceValue | None


def read_places(
    reader: Reader, drawn: FigureEye, frames: int, seed: int, *, needles: bool
) -> Iterator[ReadPlace]:
    """Yield what was read of all usable frames of an eye."""
    rng = np.random.default_rng((seed, drawn.seed))
    if needles:
        drawn = with_needle(drawn, rng)

    computed = compute_eye(drawn)
    path = computed.bent[0]
    plane = scan_plane(drawn.setup)
    forces_n = computed.largest_n * np.sqrt(rng.uniform(0.0, 1.0, frames))
    plan = plan_phantom(drawn.setup, tuple(forces_n.tolist()), drawn.study, seed)
    sections, _ = plan_sections(plan, computed.sections_at)
    axes = [
        tip_at(path.mesh, plane.contact, axis) for axis in (plane.lateral, plane.depth)
    ]
    scale = PixelScale.of(drawn.study.oct)
    known = stated(drawn, rng)
    without_gap = replace(known, needle=replace(known.needle, gap_m=None))

    for frame, section, force_n in zip(
        plan.frames, sections, plan.normal_n, strict=True
    ):
        moved_nc = path.displacement_nc(force_n)
        contact_m = np.array([[float((axis * moved_nc).sum()) for axis in axes]])
        lateral_m, depth_m = frame.pose.place_points(contact_m)[0].tolist()
        shaft = frame.optics.needle
        true = {
            "contact_m": lateral_m,
            "contact_depth_m": depth_m,
            "dent_m": path.tip_m(force_n),
            "gap_m": wall_of(drawn.setup).gap_m,
            "lean_rad": shaft.angle_rad if shaft else np.nan,
        }
        pixels = render_frame(frame, section, drawn.study).frame

        for gap, given in zip(GAPS, (known, without_gap), strict=True):
            answer = reader.read(pixels, scale, given)
            if answer.usable:
                for name, value in true.items():
                    yield ReadPlace(name, gap, value, getattr(answer.places, name))


def with_needle(drawn: FigureEye, rng: np.random.Generator) -> FigureEye:
    """Return an eye whose needle is in the picture and leans in it."""
    phantom = replace(
        drawn.study.phantom,
        needle_count=fixed(1),
        needle_angle_rad=Range(min=radians(-35.0), max=radians(35.0)),
        needle_lean_rad=fixed(0.0),
    )
    gap_m = rng.uniform(0.0, 0.8) * drawn.study.needle.outer_diameter_m / 2
    setup = changed(drawn.setup, gap_m=gap_m)
    return replace(drawn, setup=setup, study=replace(drawn.study, phantom=phantom))


def stated(drawn: FigureEye, rng: np.random.Generator) -> Setup:
    """Return what is known of an eye, with its errors."""
    wall = wall_of(drawn.setup)
    off = {name: rng.normal(0.0, sd) for name, sd in KNOWN_ERRORS.items()}
    modulus_pa = wall.youngs_modulus_pa * (1.0 + off["modulus"])
    sd_pa = KNOWN_ERRORS["modulus"] * modulus_pa
    direction_rad = scan_plane(drawn.setup).direction_rad
    return Setup(
        eye=Eye(
            modulus=Modulus(mean_pa=modulus_pa, sd_pa=sd_pa, source="stated"),
            iop_pa=wall.iop_pa * (1.0 + off["iop"]),
            thickness_m=wall.thickness_m + off["thickness_m"],
            globe=Globe.declared(drawn.study.globe.kind, None),
        ),
        needle=Needle(
            gap_m=max(wall.gap_m + off["gap_m"], 0.0), polar_rad=wall.polar_rad
        ),
        scan=Scan(direction_rad=float(np.remainder(direction_rad + pi, 2 * pi) - pi)),
    )


def place_row(name: str, gap: str, seen: list[ReadPlace]) -> list[str] | None:
    """Return errors and intervals of a place; None where none is known."""
    known = [
        (one.true, one.place)
        for one in seen
        if one.place is not None and np.isfinite(one.true)
    ]
    if not known:
        return None

    unit: HumanUnit = "deg" if name.endswith("rad") else "mm"
    off = from_si(1.0, unit) * np.array([place.value - true for true, place in known])
    widths = [from_si(place.high - place.low, unit) for _, place in known]
    held = [place.low <= true <= place.high for true, place in known]
    most = np.quantile(np.abs(off), 0.9)
    return [
        name,
        gap,
        percent(len(known) / len(seen)),
        f"{rms(off):.3f}, {most:.3f} {unit}",
        f"{np.median(widths) / 2.0:.3f} {unit}",
        percent(float(np.mean(held))),
    ]


@click.command(help=__doc__)
@click.option("--groups", default="plain,harder,sealed", help="Groups of eyes.")
@whole_number("--eyes", 6)
@whole_number("--frames", 10, "Frames of each eye.")
@whole_number("--seed", 48)
@click.option("--needles", is_flag=True, help="Draw a needle in each frame.")
def main(groups: str, eyes: int, frames: int, seed: int, needles: bool) -> None:
    """Print a table for each group."""
    reader = sf.load_model("default")
    head = ["place", "gap", "answered, %", "error: rms, 90 %"]
    more = ["half interval: median", "intervals that hold, %"]

    for group in groups.split(","):
        found = defaultdict[tuple[str, str], list[ReadPlace]](list)
        for drawn in draw_eyes(group, eyes, Study(), seed):
            for one in read_places(reader, drawn, frames, seed, needles=needles):
                found[one.name, one.gap].append(one)

        print(f"\n{group}\n")
        rows = (place_row(*key, seen) for key, seen in sorted(found.items()))
        print_table([*head, *more], filter(None, rows))
