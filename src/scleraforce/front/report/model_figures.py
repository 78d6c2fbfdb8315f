"""Figures of the models: the deformed mesh, sketches of the eye and of the network, the
curves of a training.
"""

from collections.abc import Mapping, Sequence
from math import cos, degrees, radians, sin

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Polygon
from matplotlib.ticker import LogLocator, MaxNLocator
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]  # matplotlib types all but its toolkits
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]  # as above

from scleraforce.base.arrays import Floats, Integers
from scleraforce.base.units import from_si
from scleraforce.front.report import figure_files
from scleraforce.lab.virtual_eye import SimulatedEye
from scleraforce.records.study import Study

DISPLACEMENT_COLOURS = "viridis"
NEEDLE_LENGTH_M = 6e-3
# The outline of each face of a hexahedron in VTK's order, mid-edge nodes included,
# counter-clockwise seen from outside.
FACE_OUTLINES = (
    *((0, 11, 3, 10, 2, 9, 1, 8), (4, 12, 5, 13, 6, 14, 7, 15)),
    *((0, 8, 1, 17, 5, 12, 4, 16), (1, 9, 2, 18, 6, 13, 5, 17)),
    *((2, 10, 3, 19, 7, 14, 6, 18), (3, 11, 0, 16, 4, 15, 7, 19)),
)


@figure_files.styled
def draw_simulation(eye: SimulatedEye) -> Figure:
    """Draw the deformed mesh and, beside it, the slice."""
    figure = Figure(figsize=figure_files.inches(170, 65))
    # the automatic layout leaves three-dimensional axes small
    figure.set_layout_engine("none")
    _draw_mesh(figure, eye, width=0.5)
    axes = figure.add_axes((0.56, 0.2, 0.42, 0.6))
    rows, columns = eye.slice.shape
    width, depth = (
        from_si(pixels * eye.window.pixel_m, "mm") for pixels in (columns, rows)
    )
    axes.imshow(
        eye.slice,
        cmap=figure_files.SCAN_COLOURS,
        vmin=0,
        vmax=255,
        extent=(-width / 2, width / 2, depth, 0),
    )
    axes.set(xlabel="lateral [mm]", ylabel="depth [mm]")
    axes.set_title(f"slice beside the needle, {columns} x {rows} pixels")
    wall = f"wall of {from_si(eye.mesh.thickness_m, 'um'):.0f} µm"
    polar = f"{np.degrees(eye.contact.polar_rad):.0f}° from the pole"
    force = f"{from_si(eye.force_n, 'mn'):g} mN"
    dent = f"{from_si(eye.tip_m, 'mm'):.2f} mm"
    figure.suptitle(
        f"{wall}, {force} at {polar}: the contact sinks in by {dent}",
        x=0.02,
        ha="left",
        fontsize=8,
    )

    return figure


def _draw_mesh(figure: Figure, eye: SimulatedEye, width: float) -> None:
    axes: Axes3D = figure.add_axes((0.0, 0.1, width, 0.9), projection="3d")
    middles_ec = eye.mesh.points_nc[eye.mesh.cells_en].mean(axis=1)
    # of the plane through its meridian, for the viewer
    behind_needle = middles_ec @ eye.contact.parallel > 0.0
    outlines = skin_outlines(eye.mesh.cells_en[behind_needle])
    moved = from_si(eye.mesh.points_nc + eye.displacement_nc, "mm")
    amount = from_si(
        np.linalg.norm(eye.displacement_nc, axis=1)[outlines].mean(axis=1), "mm"
    )
    scale = Normalize(0.0, max(float(amount.max()), 1e-6))
    colours = ScalarMappable(scale, DISPLACEMENT_COLOURS)
    faces = Poly3DCollection(
        moved[outlines],
        facecolors=colours.to_rgba(amount),
        edgecolors=figure_files.PAPER,
        linewidths=0.15,
    )
    faces.set_rasterized(True)  # thousands of polygons
    axes.add_collection3d(faces)
    normal = eye.contact.normal
    length = eye.mesh.radius_m - eye.tip_m
    ends = from_si(
        np.stack([length * normal, (length + NEEDLE_LENGTH_M) * normal]), "mm"
    )
    axes.plot(*ends.T, color=figure_files.RED, linewidth=2.0, zorder=10)
    radius = from_si(eye.mesh.radius_m, "mm")
    axes.set(xlim=(-radius, radius), ylim=(-radius, radius), zlim=(0, radius))
    axes.set_box_aspect((2, 2, 1), zoom=1.38)
    axes.view_init(elev=22, azim=np.degrees(eye.contact.azimuth_rad) - 78)
    axes.set_axis_off()
    bar = figure.add_axes((0.25 * width, 0.17, 0.5 * width, 0.025))
    figure.colorbar(
        colours, cax=bar, orientation="horizontal", label="displacement [mm]"
    ).outline.set_visible(False)


def skin_outlines(cells_en: Integers) -> Integers:
    """Return the outlines of the faces that belong to one element only, shape (face, 4
    or 8).
    """
    corners = np.array(FACE_OUTLINES)[:, ::2]
    outline = corners if cells_en.shape[1] == 8 else np.array(FACE_OUTLINES)
    names = np.sort(cells_en[:, corners].reshape(-1, 4), axis=1)
    _, first, count = np.unique(names, axis=0, return_index=True, return_counts=True)
    skin: Integers = cells_en[:, outline].reshape(-1, outline.shape[1])[
        first[count == 1]
    ]

    return skin


Point = tuple[float, float]
THICKNESS_DRAWN_MM = 1.3  # about twice a sclera: a true one is a line at this size
ARROW = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 8}
BOX_MM = 24.0
ROW_MM = 14.0


@figure_files.styled
def draw_model(study: Study) -> Figure:
    """Draw the meridian of the needle: the wall, its clamped base, pressure, weight,
    needle and the B-scan plane.
    """
    radius = from_si(study.eye.radius_m, "mm")
    polar_deg = degrees(sum(study.needle.polar_angle_rad.bounds) / 2)
    figure = Figure(figsize=figure_files.inches(120, 62))
    axes = figure.add_subplot()
    angles = np.linspace(-np.pi / 2, np.pi / 2, 181)
    wall = np.concatenate(
        [_arc(radius, angles), _arc(radius - THICKNESS_DRAWN_MM, angles[::-1])]
    )
    axes.add_patch(
        Polygon(
            wall,
            facecolor=figure_files.TISSUE,
            edgecolor=figure_files.BLACK,
            linewidth=0.8,
        )
    )
    _draw_base(axes, radius)
    _draw_pressure(axes, radius - THICKNESS_DRAWN_MM)
    _sketch_needle(axes, radius, polar_deg)
    _arrow(
        axes,
        (-0.1 * radius, 0.52 * radius),
        (-0.1 * radius, 0.28 * radius),
        figure_files.BLACK,
    )
    axes.text(
        -0.07 * radius,
        0.36 * radius,
        "gravity, $f_g$",
        color=figure_files.BLACK,
        parse_math=True,
    )
    of_eye = f"E, $\\nu$ = {study.eye.poisson_ratio:g}, R = {radius:g} mm"
    axes.text(0.0, 0.08 * radius, of_eye, ha="center", parse_math=True)
    axes.set(
        xlim=(-1.15 * radius, 2.0 * radius),
        ylim=(-0.2 * radius, 1.3 * radius),
        aspect="equal",
    )
    axes.set_axis_off()

    return figure


@figure_files.styled
def draw_network(
    pixels: tuple[int, int],
    hidden: Sequence[int],
    classes: Sequence[str],
    dropout: float,
) -> Figure:
    """Draw the layers from a slice of (columns, rows) over hidden layers with dropout
    to the named classes.
    """
    columns, rows = pixels
    layers = [
        (f"slice\n{columns} x {rows}\npixels", figure_files.BLACK),
        (f"input\n{columns * rows}", figure_files.GREY),
        *((f"{size}\nReLU\ndropout {dropout:g}", figure_files.BLUE) for size in hidden),
        (f"{len(classes)}\nsoftmax", figure_files.RED),
    ]
    step = 1.3 * BOX_MM
    figure = Figure(figsize=figure_files.inches(170, 28))
    axes = figure.add_subplot()

    for place, (text, colour) in enumerate(layers):
        left = place * step
        box = FancyBboxPatch(
            (left, -ROW_MM / 2),
            BOX_MM,
            ROW_MM,
            boxstyle="round,pad=0,rounding_size=1.5",
        )
        box.set(facecolor=figure_files.PAPER, edgecolor=colour, linewidth=1.1)
        axes.add_patch(box)
        axes.text(left + BOX_MM / 2, 0.0, text, ha="center", va="center")

        if place:
            _arrow(axes, (left - step + BOX_MM, 0.0), (left, 0.0), figure_files.GREY)

    end = (len(layers) - 1) * step + BOX_MM
    for place, name in enumerate(classes):
        height = ROW_MM * (0.55 - 0.55 * place)
        _arrow(axes, (end, 0.5 * height), (end + 7.0, height), figure_files.GREY)
        axes.text(end + 8.5, height, name, va="center")

    axes.set(
        xlim=(-2.0, end + 38.0), ylim=(-0.7 * ROW_MM, 0.7 * ROW_MM), aspect="equal"
    )
    axes.set_axis_off()

    return figure


def _arc(distance: float, polar_rad: Floats) -> Floats:
    """Points of a meridian at a distance from the centre, (point, 2); the pole is up,
    the needle to the right.
    """
    return distance * np.stack([np.sin(polar_rad), np.cos(polar_rad)], axis=-1)


def _point(distance: float, polar_deg: float, along: float = 0.0) -> Point:
    """One point, moved `along` the tangent, away from the pole."""
    polar_rad = radians(polar_deg)
    across = sin(polar_rad)
    up = cos(polar_rad)
    return distance * across + along * up, distance * up - along * across


def _arrow(axes: Axes, start: Point, end: Point, colour: str) -> None:
    axes.annotate(
        "", xy=end, xytext=start, arrowprops={**ARROW, "color": colour, "lw": 1.0}
    )


def _draw_base(axes: Axes, radius: float) -> None:
    for side in (-1.0, 1.0):
        ends = np.sort(
            side
            * np.array(
                [radius - 1.4 * THICKNESS_DRAWN_MM, radius + 0.4 * THICKNESS_DRAWN_MM]
            )
        )
        axes.plot(ends, [0.0, 0.0], color=figure_files.BLACK, linewidth=1.4)

        for start in np.linspace(ends[0], ends[1], 6):
            axes.plot(
                [start, start - 0.5],
                [0.0, -0.8],
                color=figure_files.BLACK,
                linewidth=0.6,
            )

    axes.text(0.0, -0.14 * radius, "the base is clamped", ha="center")


def _draw_pressure(axes: Axes, inner: float) -> None:
    for polar_deg in (-75, -55, -35, -15, 5, 60, 78):
        _arrow(
            axes,
            _point(0.84 * inner, polar_deg),
            _point(inner, polar_deg),
            figure_files.BLUE,
        )

    across, up = _point(0.74 * inner, -45)
    axes.text(
        across,
        up,
        "IOP, $f_p$",
        color=figure_files.BLUE,
        ha="center",
        va="center",
        parse_math=True,
    )


def _sketch_needle(axes: Axes, radius: float, polar_deg: float) -> None:
    ends = np.array([_point(radius, polar_deg), _point(1.42 * radius, polar_deg)])
    axes.plot(*ends.T, color=figure_files.RED, linewidth=2.6, solid_capstyle="butt")
    _arrow(
        axes,
        _point(0.98 * radius, polar_deg),
        _point(0.72 * radius, polar_deg),
        figure_files.RED,
    )
    across, up = _point(0.64 * radius, polar_deg)
    axes.text(
        across,
        up,
        "needle, $f_n$",
        color=figure_files.RED,
        ha="center",
        va="center",
        parse_math=True,
    )
    half = 0.38 * radius
    corners = [(1.22, -half), (1.22, half), (0.86, half), (0.86, -half)]
    outline = np.array(
        [_point(share * radius, polar_deg, along) for share, along in corners]
    )
    axes.add_patch(
        Polygon(
            outline,
            fill=False,
            edgecolor=figure_files.AMBER,
            linewidth=1.1,
            linestyle=(0, (4, 2)),
        )
    )
    across, up = _point(1.2 * radius, polar_deg, 0.44 * radius)
    axes.text(
        across,
        up,
        "B-scan, parallel to this\nplane, beside the needle",
        color=figure_files.CLASS_INKS[1],
        va="bottom",
    )


@figure_files.styled
def draw_curves(curves: Mapping[str, Sequence[float]], steps: str) -> Figure:
    """Draw the curves of a training (`training_loss`, `validation_loss` and so on), a
    panel for each quantity.
    """
    names = list(dict.fromkeys(name.partition("_")[2] for name in curves))
    figure = Figure(figsize=figure_files.inches(170 if len(names) > 1 else 110, 60))

    for axes, name in zip(
        figure.subplots(1, max(len(names), 1), squeeze=False)[0], names, strict=False
    ):
        for part, colour, line in (
            ("training", figure_files.RED, (0, (4, 2))),
            ("validation", figure_files.BLUE, "-"),
        ):
            values = curves.get(f"{part}_{name}", ())
            if values:
                axes.plot(
                    range(1, len(values) + 1),
                    values,
                    color=colour,
                    linestyle=line,
                    label=part,
                )

        axes.set(xlabel=steps, ylabel=name.replace("_", " "))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="best")

        if (
            name == "loss"
            and min(min(curves[key]) for key in curves if key.endswith("_loss")) > 0
        ):
            figure_files.log_scale(axes, LogLocator(subs=(1.0, 2.0, 5.0)))

    return figure
