"""What the form of an eye, its pressure and the needle's tilt do to a dent: the table
of docs/physics.md, "Eyes that are not spheres".

Tips of a wall of 0.65 mm, 0.25 MPa and 2 mmHg in 3-D, with one thing changed at a time.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from math import radians
from typing import Any

import click
import numpy as np

from figures.printing import ROWS, print_table
from figures.pushed_walls import CONTACT
from scleraforce.mechanics.finite_strain_wall import bend_eye
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.records.study import (
    EyeStudy,
    FormStudy,
    MechanicsStudy,
    NeedleStudy,
    Study,
)
from scleraforce.records.study_of_eye import RegionStudy, WaveStudy

FORCES_N = (10e-3, 30e-3, 50e-3)


def leaning(direction_deg: float) -> NeedleStudy:
    """Return a needle tilted by 10 degrees towards a direction."""
    return NeedleStudy(
        tilt_rad=radians(10.0), tilt_direction_rad=radians(direction_deg)
    )


def thicker(share: float) -> FormStudy:
    """Return a wall thicker at the contact and thinner on the other side."""
    return FormStudy(
        wave=(
            WaveStudy(amplitude_fraction=share, degree=1, polar_rad=CONTACT.polar_rad),
        )
    )


def cornea(modulus_ratio: float) -> FormStudy:
    """Return a wall with a cornea of another modulus."""
    return FormStudy(region=(RegionStudy(modulus_ratio=modulus_ratio),))


CHANGES: dict[str, dict[str, Any]] = {
    "even half-sphere": {},
    "semi-axes 1.06, 1, 0.94": {"form": FormStudy((1.06, 1.0, 0.94))},
    "wall 12 % thicker at the needle": {"form": thicker(0.12)},
    "wall 12 % thinner at the needle": {"form": thicker(-0.12)},
    "cornea of 0.6 E": {"form": cornea(0.6)},
    "cornea of 1.4 E": {"form": cornea(1.4)},
    "force leans 10° away from the pole": {"needle": leaning(0.0)},
    "force leans 10° to the pole": {"needle": leaning(180.0)},
    "force leans 10° sideways": {"needle": leaning(90.0)},
    "pressure as a dead load": {
        "mechanics": MechanicsStudy("finite-strain", follower=False)
    },
    "no weight": {"eye": EyeStudy(density_kg_m3=0.0)},
}


def form_rows(rows: int | None) -> Iterator[list[str]]:
    """Yield the tips of each change, and how far they are off an even half-sphere's."""
    even_mm = None
    for name, changes in islice(CHANGES.items(), rows):
        path = bend_eye(
            replace(Study(), **changes),
            CONTACT,
            PathEnd(max_force=FORCES_N[-1]),
            thickness_m=0.65e-3,
            youngs_modulus_pa=0.25e6,
            iop_pa=266.0,
        )
        tips_mm = np.array([1e3 * path.tip_m(force_n) for force_n in FORCES_N])
        if even_mm is None:
            even_mm = tips_mm

        off = 100.0 * (tips_mm / even_mm - 1.0)
        cells = zip(tips_mm, off, strict=True)
        yield [name, *(f"{tip:.2f} ({percent:+.1f} %)" for tip, percent in cells)]


@click.command(help=__doc__)
@ROWS
def main(rows: int | None) -> None:
    """Print the table."""
    print_table(["change", "mm at 10 mN", "30 mN", "50 mN"], form_rows(rows))
