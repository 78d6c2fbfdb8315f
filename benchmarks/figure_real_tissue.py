"""Stiffness of a pressurised sphere for small loads, ours beside closed forms:
docs/images/real_tissue.png.

python benchmarks/figure_real_tissue.py [--out FILE]
"""

import argparse
from pathlib import Path
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from real_tissue.rigidity import NEEDLE_M, NU, RADIUS_M
from real_tissue.shells import point, pressure_ratio, shallow, sphere
from real_tissue.tables import LARGEST_STRETCHING, pressed
from scleraforce.front.report.figure_files import (
    AMBER,
    BLACK,
    BLUE,
    GREY,
    RED,
    inches,
    styled,
    write_figure,
)

IMAGE = Path(__file__).parent.parent / "docs" / "images" / "real_tissue.png"
LINES_MM = {0.15: (BLUE, "o"), 0.5: (AMBER, "s"), 0.8: (RED, "^")}
TENSIONS = np.linspace(0.0, 4.0, 41)
SHOWN = np.linspace(0.0, 4.0, 9)
THICKNESSES_MM = (0.05, 0.1, 0.15, 0.2, 0.25, 0.35, 0.5, 0.65, 0.8)
# tensions of the right half
DRAWN: dict[float, Literal["-", "--"]] = {
    0.0: "-",
    2.0: "--",
}
FORMS = {
    "shallow shell": (GREY, "v"),
    "whole sphere": (BLUE, "o"),
    "whole sphere, shear": (RED, "s"),
}


@styled
def draw() -> Figure:
    """Draw the stiffness against the tension, and how far ours lies from the closed
    forms.
    """
    figure = Figure(figsize=inches(170, 72))
    left, right = figure.subplots(1, 2, width_ratios=[1.15, 1.0])
    draw_stiffness(left)
    draw_differences(right)
    return figure


def draw_stiffness(axes: Axes) -> None:
    """Draw stiffness over that of Vella's point force without pressure."""
    for thickness_mm, (colour, marker) in LINES_MM.items():
        thickness_m = 1e-3 * thickness_mm
        unit = point(thickness_m, RADIUS_M, 0.0, NU)
        pressures = pressure_ratio(1.0, thickness_m, RADIUS_M, NU) * TENSIONS
        closed = [
            sphere(thickness_m, RADIUS_M, float(pressure), NEEDLE_M, NU) / unit
            for pressure in pressures
        ]
        possible = pressures * RADIUS_M / thickness_m < LARGEST_STRETCHING
        axes.plot(TENSIONS[possible], np.array(closed)[possible], color=colour)
        shown = SHOWN[
            : int(np.searchsorted(SHOWN, TENSIONS[possible][-1], side="right"))
        ]
        ours = [
            pressed(
                thickness_m,
                pressure_ratio(1.0, thickness_m, RADIUS_M, NU) * float(tension),
            ).stiffness_m
            for tension in shown
        ]
        axes.plot(
            shown,
            np.array(ours) / unit,
            marker,
            color=colour,
            markersize=4,
            label=f"{thickness_mm:g} mm",
        )

    # the same curve for every thickness
    pressures = pressure_ratio(1.0, 0.15e-3, RADIUS_M, NU) * TENSIONS
    vella = [point(0.15e-3, RADIUS_M, float(pressure), NU) for pressure in pressures]
    axes.plot(TENSIONS, np.array(vella) / vella[0], color=BLACK, linestyle="--")
    axes.set_xlabel("tension τ = pR²/(4√(E t B))")
    axes.set_ylabel("stiffness over 4 E t² / (R √(3(1 - ν²)))")
    axes.set_xlim(-0.1, 4.1)
    axes.set_ylim(0.0, 3.3)
    axes.set_title("A small load on a pressurised sphere")
    keys = [
        Line2D(
            [],
            [],
            linestyle="",
            marker=marker,
            color=colour,
            markersize=4,
            label=f"ours, {thickness_mm:g} mm",
        )
        for thickness_mm, (colour, marker) in LINES_MM.items()
    ]
    keys += [
        Line2D(
            [],
            [],
            color=BLACK,
            linestyle="--",
            label="Vella et al. 2012, thin shell, point force",
        ),
        Line2D([], [], color=GREY, label="whole sphere with shear, needle's disc"),
    ]
    axes.legend(handles=keys, loc="lower right", fontsize=6.5)


def draw_differences(axes: Axes) -> None:
    """Draw how far our stiffness is from that of closed forms, at two tensions, over
    the thickness.
    """
    for tension, line in DRAWN.items():
        found = []
        for thickness_mm in THICKNESSES_MM:
            thickness_m = 1e-3 * thickness_mm
            pressure = pressure_ratio(tension, thickness_m, RADIUS_M, NU)
            ours = pressed(thickness_m, pressure)
            closed = (
                shallow(thickness_m, RADIUS_M, pressure, NEEDLE_M, NU),
                sphere(thickness_m, RADIUS_M, pressure, NEEDLE_M, NU, shear=False),
                sphere(ours.thickness_m, ours.radius_m, pressure, NEEDLE_M, NU),
            )
            found.append([100.0 * (ours.stiffness_m / value - 1.0) for value in closed])

        for values, (colour, marker) in zip(
            np.array(found).T, FORMS.values(), strict=True
        ):
            axes.plot(
                THICKNESSES_MM,
                values,
                color=colour,
                linestyle=line,
                marker=marker,
                markersize=3,
            )

    axes.axhspan(-2.0, 2.0, color=GREY, alpha=0.18, linewidth=0.0)
    axes.annotate("2 %", (0.79, -1.7), fontsize=6.5, color=BLACK, ha="right")
    axes.set_xlabel("thickness [mm], middle radius 12 mm")
    axes.set_ylabel("ours against the closed form [%]")
    axes.set_xlim(0.0, 0.82)
    axes.set_title("What the closed form leaves out")
    keys = [
        Line2D([], [], color=colour, marker=marker, markersize=3, label=name)
        for name, (colour, marker) in FORMS.items()
    ]
    keys += [
        Line2D([], [], color=BLACK, linestyle=line, label=f"τ = {tension:g}")
        for tension, line in DRAWN.items()
    ]
    axes.legend(handles=keys, loc="lower left", fontsize=6.5)


def main() -> None:
    """Compute and draw; print the stiffness of each thickness without pressure."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("--out", type=Path, default=IMAGE, help="the picture")
    given = parser.parse_args()
    print("t mm; stiffness over E at tension 0, um: point, ours")

    for thickness_mm in THICKNESSES_MM:
        thickness_m = 1e-3 * thickness_mm
        ours = pressed(thickness_m, 0.0).stiffness_m
        print(
            f"  {thickness_mm:g} {1e6 * point(thickness_m, RADIUS_M, 0.0, NU):.3f}"
            f" {1e6 * ours:.3f}"
        )

    write_figure(draw(), given.out)


if __name__ == "__main__":
    main()
