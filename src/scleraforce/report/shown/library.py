"""A response library: the walls that it has, and how they give."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scleraforce.library.files import load_library
from scleraforce.library.responses import Library
from scleraforce.library.store import open_library
from scleraforce.report.files import GREY, inches, styled
from scleraforce.report.shown.kinds import Thing, span
from scleraforce.units import from_si

COLOURS = "viridis"


def show_library(path: Path) -> Thing:
    """Look at a response library: a store of `scleraforce library`, or the file of a model folder.

    Raises:
        InputError: it cannot be read.
    """
    library = load_library(path) if path.is_file() else open_library(path)
    shape = library.force_ratio_tpd.shape
    rows = (
        ("walls", f"radius {from_si(library.radius_m, 'mm'):g} mm, {span(library.thickness_m, 'um', 'µm')} thick, "
                  f"Poisson's ratio {library.poisson_ratio:g}"),
        ("needle", f"{from_si(2 * library.needle_radius_m, 'mm'):g} mm thick"),
        ("load paths", f"{shape[0]} thicknesses x {shape[1]} tensions p R/(E t) from {library.tension[0]:.3g} to "
                       f"{library.tension[-1]:.3g}"),
        ("dents", f"{shape[2]} states of each, {span(library.tip_m, 'mm', 'mm')}"),
        ("contacts", f"{span(library.polar_rad, 'deg', '°')} from the pole"),
        ("largest F/E", f"{from_si(library.max_force_ratio, 'mm2'):.4g} mm²"),
    )  # fmt: skip
    facts = {
        "radius_mm": from_si(library.radius_m, "mm"),
        "thickness_um": from_si(library.thickness_m, "um").tolist(),
        "tension": library.tension.tolist(),
        "tip_mm": from_si(library.tip_m, "mm").tolist(),
        "largest_force_ratio_mm2": from_si(library.max_force_ratio, "mm2"),
    }
    return Thing(kind="library", facts=facts, rows=rows, draw=lambda: draw_library(library))


@styled
def draw_library(library: Library) -> Figure:
    """Draw F/E over the dent for every thickness, at the lowest, the middle and the highest pressure."""
    from matplotlib import colormaps

    figure = Figure(figsize=inches(170, 62))
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    dent_mm = from_si(library.tip_m, "mm")
    shades = colormaps[COLOURS](np.linspace(0.0, 0.85, len(library.thickness_m)))
    for axes, pressure in zip(panels, (0, len(library.tension) // 2, -1), strict=True):
        for thickness_m, ratio_d, shade in zip(
            library.thickness_m, library.force_ratio_tpd[:, pressure], shades, strict=True
        ):
            label = f"{from_si(thickness_m, 'um'):.0f} µm"
            axes.plot(dent_mm, from_si(ratio_d, "mm2"), color=shade, label=label)
        axes.axhline(from_si(library.max_force_ratio, "mm2"), color=GREY, linewidth=0.6, linestyle=(0, (4, 3)))
        axes.set_title(f"tension p R/(E t) = {library.tension[pressure]:.3g}")
        axes.set_xlabel("dent [mm]")
    panels[0].set_ylabel("force over Young's modulus [mm²]")
    panels[0].set_ylim(0.0, 1.1 * from_si(library.max_force_ratio, "mm2"))
    shown = np.unique(np.linspace(0, len(library.thickness_m) - 1, 6).round().astype(int))
    handles, labels = panels[0].get_legend_handles_labels()
    panels[0].legend([handles[n] for n in shown], [labels[n] for n in shown], loc="upper left")
    return figure
