"""A virtual eye to be turned and cut in a page: its scene, and the view that shows it."""

import base64
from dataclasses import dataclass
from datetime import datetime
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from scleraforce.laboratory.virtual_eye import SimulatedEye
from scleraforce.report.html import Html, cards, embedded, figure, made_line, page, paragraph, section, write_page
from scleraforce.report.model_figures import DISPLACEMENT_COLOURS, behind_needle, draw_simulation, skin_outlines
from scleraforce.units import from_si

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LARGEST = 32767
SHADES = 16


@dataclass(frozen=True)
class Skin:
    """Triangles of the faces that belong to one element only.

    `points_nc` and `displacement_nc` (vertex, 3), m: the mesh's nodes, and after them a middle for each face.
    `triangles_tn` (triangle, 3) are numbers of vertices, counter-clockwise seen from outside.
    """

    points_nc: Floats
    displacement_nc: Floats
    triangles_tn: Integers


def skin_of(points_nc: Floats, displacement_nc: Floats, cells_en: Integers) -> Skin:
    """Return the skin of hexahedra (element, node) in VTK's order; each face is a fan about its middle."""
    outlines = skin_outlines(cells_en)
    middles = len(points_nc) + np.arange(len(outlines))
    fans = np.stack(
        [np.broadcast_to(middles[:, None], outlines.shape), outlines, np.roll(outlines, -1, axis=1)], axis=2
    )
    # Of an outline's nodes in the middle of its face: quadratic serendipity shape functions, if it has mid-edge nodes.
    weights = np.full(4, 0.25) if outlines.shape[1] == 4 else np.tile([-0.25, 0.5], 4)
    moved, still = (
        np.concatenate([values, np.einsum("k,fkc->fc", weights, values[outlines])])
        for values in (displacement_nc, points_nc)
    )
    return Skin(still, moved, fans.reshape(-1, 3).astype(np.int64))


def eye_scene(eye: SimulatedEye) -> dict[str, Any]:
    """Return the data of the script: both halves of the wall, the needle, the colours of the displacement."""
    behind = behind_needle(eye)
    halves = [skin_of(eye.mesh.points_nc, eye.displacement_nc, eye.mesh.cells_en[half]) for half in (behind, ~behind)]
    highest_m = float(np.linalg.norm(eye.displacement_nc, axis=1).max())
    stops = (colormaps[DISPLACEMENT_COLOURS](np.linspace(0.0, 1.0, SHADES))[:, :3] * 255).round().astype(int)
    contact = np.argmin(np.linalg.norm(eye.mesh.points_nc - eye.mesh.radius_m * eye.contact.normal, axis=1))
    return {
        "radius_mm": from_si(eye.mesh.radius_m, "mm"),
        "highest_mm": from_si(highest_m, "mm"),
        "colours": stops.tolist(),
        "halves": [_packed(skin) for skin in halves],
        "needle": {
            "normal": eye.contact.normal.tolist(),
            "azimuth_deg": from_si(eye.contact.azimuth_rad, "deg"),
            "contact_mm": from_si(eye.mesh.points_nc[contact], "mm").tolist(),
            "moved_mm": from_si(eye.displacement_nc[contact], "mm").tolist(),
        },
    }


def _packed(skin: Skin) -> dict[str, Any]:
    used, triangles = np.unique(skin.triangles_tn, return_inverse=True)
    values_mm = [from_si(values[used], "mm") for values in (skin.points_nc, skin.displacement_nc)]
    steps_mm = [max(float(np.abs(values).max()), 1e-9) / LARGEST for values in values_mm]
    points, moved = (np.rint(values / step).astype("<i2") for values, step in zip(values_mm, steps_mm, strict=True))
    return {
        "steps_mm": steps_mm,
        "points": _text(points),
        "moved": _text(moved),
        "triangles": _text(triangles.astype("<u4")),
    }


def _text(values: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode("ascii")


HERE = files("scleraforce.report.eye_view")
VIEW_STYLE, VIEW_SCRIPT = (HERE.joinpath(name).read_text(encoding="utf-8") for name in ("view.css", "view.js"))
WORDS = (
    "Drag, or use the arrow keys, to turn it; turn the wheel, or press + and -, to come nearer. The slider exaggerates "
    "the displacement, or takes it away. Half of the wall is left out so that the needle's meridian is seen. Colours: "
    "how far each point has moved from the unloaded wall, under pressure and gravity as well."
)


def eye_view(eye: SimulatedEye) -> Html:
    """Return the view; a page that holds it needs `VIEW_STYLE` and `VIEW_SCRIPT`, and may hold one."""
    markup = HERE.joinpath("view.html").read_text(encoding="utf-8")
    return Html(markup + embedded("eye-scene", eye_scene(eye)) + paragraph(WORDS))


def write_simulation_html(eye: SimulatedEye, path: Path, made_at: datetime) -> None:
    """Write one simulated eye as a page: its numbers, the wall to be turned, mesh and slice as a picture."""
    numbers = cards(
        [
            (f"{from_si(eye.force_n, 'mn'):g} mN", "force of the needle", "along the inward normal"),
            (f"{from_si(eye.tip_m, 'mm'):.3f} mm", "the contact sinks in", "from the wall under IOP alone"),
            (f"{from_si(eye.pressure_pa, 'mmhg'):.3g} mmHg", "pressure under the needle", ""),
            (f"{from_si(eye.mesh.thickness_m, 'um'):.0f} µm", "wall", f"{len(eye.mesh.cells_en)} elements"),
        ]
    )
    drawn = figure(draw_simulation(eye), "deformed mesh and slice", "The mesh, cut open, and the slice.", "png")
    content = page(
        "One eye under one force",
        "The deformed wall of a simulated eye.",
        made_line(made_at),
        section("Result", numbers),
        section("The deformed wall", eye_view(eye)),
        section("Mesh and slice", drawn),
        style=VIEW_STYLE,
        script=VIEW_SCRIPT,
    )
    write_page(content, path)
