"""The deformed mesh (the paper's Fig. 1b), cut open at the needle, and beside it the slice that the network sees."""

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D  # type: ignore[import-untyped]  # matplotlib types all but its toolkits
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]  # as above
from numpy.typing import NDArray

from scleraforce.laboratory.simulation import SimulatedEye
from scleraforce.report.style import RED, SCAN_COLOURS, inches, styled
from scleraforce.units import from_si

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

DISPLACEMENT_COLOURS = "viridis"
NEEDLE_LENGTH_M = 6e-3
# The outline of each face of a hexahedron in VTK's order, mid-edge nodes included, counter-clockwise seen from outside.
FACE_OUTLINES = (
    *((0, 11, 3, 10, 2, 9, 1, 8), (4, 12, 5, 13, 6, 14, 7, 15)),
    *((0, 8, 1, 17, 5, 12, 4, 16), (1, 9, 2, 18, 6, 13, 5, 17)),
    *((2, 10, 3, 19, 7, 14, 6, 18), (3, 11, 0, 16, 4, 15, 7, 19)),
)


@styled
def draw_deformed_mesh(eye: SimulatedEye) -> Figure:
    """Draw the hexahedra of the half behind the needle's meridian, coloured by their displacement."""
    figure = _figure(85, 65)
    _draw_mesh(figure, eye, width=1.0)
    return figure


@styled
def draw_simulation(eye: SimulatedEye) -> Figure:
    """Draw the deformed mesh and, beside it, the slice."""
    figure = _figure(170, 65)
    _draw_mesh(figure, eye, width=0.5)
    axes = figure.add_axes((0.56, 0.2, 0.42, 0.6))
    rows, columns = eye.slice.shape
    width, depth = (from_si(pixels * eye.window.pixel_m, "mm") for pixels in (columns, rows))
    axes.imshow(eye.slice, cmap=SCAN_COLOURS, vmin=0, vmax=255, extent=(-width / 2, width / 2, depth, 0))
    axes.set_xlabel("lateral [mm]")
    axes.set_ylabel("depth [mm]")
    axes.set_title(f"slice beside the needle, {columns} x {rows} pixels")
    figure.suptitle(_caption(eye), x=0.02, ha="left", fontsize=8)
    return figure


def _figure(width_mm: float, height_mm: float) -> Figure:
    """Make a figure whose axes are placed by hand: the automatic layout leaves three-dimensional ones small."""
    figure = Figure(figsize=inches(width_mm, height_mm))
    figure.set_layout_engine("none")
    return figure


def _caption(eye: SimulatedEye) -> str:
    wall = f"wall of {from_si(eye.mesh.thickness_m, 'um'):.0f} µm"
    polar = f"{np.degrees(eye.contact.polar_rad):.0f}° from the pole"
    force, dent = f"{from_si(eye.force_n, 'mn'):g} mN", f"{from_si(eye.tip_m, 'mm'):.2f} mm"
    return f"{wall}, {force} at {polar}: the contact sinks in by {dent}"


def _draw_mesh(figure: Figure, eye: SimulatedEye, width: float) -> None:
    """Put the cut wall, the needle and a colour bar into the left part of a figure."""
    axes: Axes3D = figure.add_axes((0.0, 0.1, width, 0.9), projection="3d")
    outlines = skin_outlines(eye.mesh.cells_en[behind_needle(eye)])
    moved = from_si(eye.mesh.points_nc + eye.displacement_nc, "mm")
    amount = from_si(np.linalg.norm(eye.displacement_nc, axis=1)[outlines].mean(axis=1), "mm")
    scale = Normalize(0.0, max(float(amount.max()), 1e-6))
    colours = ScalarMappable(scale, DISPLACEMENT_COLOURS)
    faces = Poly3DCollection(moved[outlines], facecolors=colours.to_rgba(amount), edgecolors="white", linewidths=0.15)
    axes.add_collection3d(faces)
    _draw_needle(axes, eye)
    radius = from_si(eye.mesh.radius_m, "mm")
    axes.set(xlim=(-radius, radius), ylim=(-radius, radius), zlim=(0, radius))
    axes.set_box_aspect((2, 2, 1), zoom=1.38)
    axes.view_init(elev=22, azim=np.degrees(eye.contact.azimuth_rad) - 78)
    axes.set_axis_off()
    bar = figure.add_axes((0.25 * width, 0.17, 0.5 * width, 0.025))
    figure.colorbar(colours, cax=bar, orientation="horizontal", label="displacement [mm]").outline.set_visible(False)


def _draw_needle(axes: Axes3D, eye: SimulatedEye) -> None:
    """Draw the needle's axis down to the sunken contact."""
    normal = eye.contact.normal
    tip = (eye.mesh.radius_m - eye.tip_m) * normal
    ends = from_si(np.stack([tip, tip + NEEDLE_LENGTH_M * normal]), "mm")
    axes.plot(*ends.T, color=RED, linewidth=2.0, zorder=10)


def behind_needle(eye: SimulatedEye) -> NDArray[np.bool_]:
    """Return which elements lie on the far side of the plane through the needle's meridian, seen by the viewer."""
    middles_ec = eye.mesh.points_nc[eye.mesh.cells_en].mean(axis=1)
    far: NDArray[np.bool_] = middles_ec @ eye.contact.parallel > 0.0
    return far


def skin_outlines(cells_en: Integers) -> Integers:
    """Return the outlines of the faces that belong to one element only, shape (face, 4 or 8)."""
    corners = np.array(FACE_OUTLINES)[:, ::2]
    outline = corners if cells_en.shape[1] == 8 else np.array(FACE_OUTLINES)
    names = np.sort(cells_en[:, corners].reshape(-1, 4), axis=1)
    _, first, count = np.unique(names, axis=0, return_index=True, return_counts=True)
    skin: Integers = cells_en[:, outline].reshape(-1, outline.shape[1])[first[count == 1]]
    return skin
