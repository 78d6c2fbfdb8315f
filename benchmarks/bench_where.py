"""Places of the needle from one frame, against virtual eyes in three dimensions:
errors, and intervals that hold.

    python benchmarks/bench_where.py [--groups plain harder sealed]
        [--eyes 6] [--frames 10] [--seed 48] [--needles]

Eyes are drawn as for `make figures`, by other seeds: each is bent in 3-D, and pushed
with forces up to 60 mN. Frames are drawn as phantoms, each with a pose of its own, and
read by `default` with E, IOP and thickness of calipers and gauges (`KNOWN_ERRORS`),
with the gap and without. The contact is where the needle's axis meets the dented
surface. With `--needles` a shaft crosses the picture at a lean of up to 35 degrees, and
the gap is within the needle's radius.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import pi, radians

import numpy as np

import scleraforce as sf
from figures.eyes import FigureEye
from figures.groups import draw_eyes
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
KNOWN_ERRORS = {
    "modulus": 0.02,
    "iop": 0.03,
    "thickness_m": 10e-6,
    "gap_m": 20e-6,
}
NAMES = ("contact_m", "contact_depth_m", "dent_m", "gap_m", "lean_rad")


@dataclass(frozen=True)
class Seen:
    """A place that was read, None where it was not, beside the true one."""

    true: float
    place: PlaceValue | None


def main() -> None:
    """Read the frames of each group and print its table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--groups", nargs="+", default=["plain", "harder", "sealed"])
    parser.add_argument("--eyes", type=int, default=6)
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--seed", type=int, default=48)
    parser.add_argument("--needles", action="store_true")
    given = parser.parse_args()
    reader = sf.load_model("default")

    for group in given.groups:
        found = defaultdict[tuple[str, str], list[Seen]](list)
        for eye in draw_eyes(group, given.eyes, Study(), given.seed):
            for name, gap, seen in readings(
                reader, eye, given.frames, given.seed, given.needles
            ):
                found[name, gap].append(seen)

            print(f"{eye.name}: done", flush=True)

        print(f"\n{group}\n{table(found)}\n", flush=True)


def readings(
    reader: Reader, drawn: FigureEye, frames: int, seed: int, needles: bool
) -> Iterator[tuple[str, str, Seen]]:
    """Yield the name of each place, whether the gap was given, and what was read, of
    all usable frames of an eye.
    """
    rng = np.random.default_rng((seed, drawn.seed))
    if needles:
        drawn = with_needle(drawn, rng)

    computed = compute_eye(drawn)
    path = computed.bent[0]
    mesh = computed.bent[0].mesh
    plane = scan_plane(drawn.setup)
    forces_n = (computed.largest_n * np.sqrt(rng.uniform(0.0, 1.0, frames))).tolist()
    plan = plan_phantom(drawn.setup, tuple(forces_n), drawn.study, seed)
    sections, _ = plan_sections(plan, computed.sections_at)
    down, across = (
        tip_at(mesh, plane.contact, axis) for axis in (plane.depth, plane.lateral)
    )
    scale = PixelScale.of(drawn.study.oct)
    known = stated(drawn, rng)

    for frame, section, force_n in zip(
        plan.frames, sections, plan.normal_n, strict=True
    ):
        moved_nc = path.displacement_nc(force_n)
        contact_m = np.array(
            [[float((across * moved_nc).sum()), float((down * moved_nc).sum())]]
        )
        at_m = frame.pose.place_points(contact_m)[0]
        shaft = frame.optics.needle
        true = (
            *at_m.tolist(),
            path.tip_m(force_n),
            wall_of(drawn.setup).gap_m,
            shaft.angle_rad if shaft else np.nan,
        )
        pixels = render_frame(frame, section, drawn.study).frame

        for gap in ("given", "not given"):
            answer = reader.read(
                pixels,
                scale,
                known
                if gap == "given"
                else replace(known, needle=replace(known.needle, gap_m=None)),
            )
            if answer.usable:
                for name, value in zip(NAMES, true, strict=True):
                    yield name, gap, Seen(value, getattr(answer.places, name))


def with_needle(drawn: FigureEye, rng: np.random.Generator) -> FigureEye:
    """Return an eye whose needle is in the picture and leans in it."""
    phantom = replace(
        drawn.study.phantom,
        needle_count=fixed(1),
        needle_angle_rad=Range(min=radians(-35.0), max=radians(35.0)),
        needle_lean_rad=fixed(0.0),
    )
    gap_m = rng.uniform(0.0, 0.8) * drawn.study.needle.outer_diameter_m / 2

    return replace(
        drawn,
        setup=changed(drawn.setup, gap_m=gap_m),
        study=replace(drawn.study, phantom=phantom),
    )


def stated(drawn: FigureEye, rng: np.random.Generator) -> Setup:
    """Return what is known of an eye, with its errors."""
    setup = drawn.setup
    globe = drawn.study.globe
    off = {name: rng.normal(0.0, sd) for name, sd in KNOWN_ERRORS.items()}
    modulus_pa = setup.eye.modulus_pa * (1.0 + off["modulus"])

    return Setup(
        eye=Eye(
            modulus=Modulus(
                mean_pa=modulus_pa,
                sd_pa=KNOWN_ERRORS["modulus"] * modulus_pa,
                source="option",
            ),
            iop_pa=wall_of(setup).iop_pa * (1.0 + off["iop"]),
            thickness_m=wall_of(setup).thickness_m + off["thickness_m"],
            globe=Globe.declared(globe.kind, None),
        ),
        needle=Needle(
            gap_m=max(wall_of(setup).gap_m + off["gap_m"], 0.0),
            polar_rad=wall_of(setup).polar_rad,
        ),
        scan=Scan(
            direction_rad=float(
                np.remainder(scan_plane(setup).direction_rad + pi, 2.0 * pi) - pi
            )
        ),
    )


def table(found: dict[tuple[str, str], list[Seen]]) -> str:
    """Return the errors and the intervals that hold, as Markdown."""
    lines = [
        (
            "| place | gap | answered | error: rms, 90 % | half interval: median |"
            " intervals that hold |"
        ),
        "|---|---|---|---|---|---|",
    ]
    for (name, gap), all_seen in sorted(found.items()):
        known = [
            (seen.true, seen.place)
            for seen in all_seen
            if seen.place is not None and np.isfinite(seen.true)
        ]
        if not known:
            continue

        unit: HumanUnit = "deg" if name.endswith("rad") else "mm"
        off = from_si(1.0, unit) * np.array(
            [place.value - true for true, place in known]
        )
        half = (
            from_si(1.0, unit)
            * np.median([place.high - place.low for _, place in known])
            / 2.0
        )
        held = np.mean([place.low <= true <= place.high for true, place in known])
        share = len(known) / len(all_seen)
        rms = np.sqrt((off**2).mean())
        most = np.quantile(np.abs(off), 0.9)
        lines.append(
            f"| {name} | {gap} | {share:.0%} | {rms:.3f}, {most:.3f} {unit} |"
            f" {half:.3f} {unit} | {held:.0%} |"
        )

    return "\n".join(lines)


if __name__ == "__main__":
    main()
