"""What a script draws of a simulated eye: triangles of the wall's skin, in few bytes.

Positions and displacements are whole numbers of a step (16 bits over the largest: half a micrometre), so that an eye of
1,200 elements takes 300 KB in a page.
"""

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import colormaps
from numpy.typing import NDArray

from scleraforce.laboratory.simulation import SimulatedEye
from scleraforce.report.mesh_figure import DISPLACEMENT_COLOURS, behind_needle, skin_outlines
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
    """Return the skin of some elements; each face is a fan about its middle, through its mid-edge nodes if it has them.

    Args:
        points_nc: nodes of the mesh (node, 3), m.
        displacement_nc: of the nodes, likewise.
        cells_en: hexahedra (element, node) in VTK's order.
    """
    outlines = skin_outlines(cells_en)
    middles = len(points_nc) + np.arange(len(outlines))
    fans = np.stack(
        [np.broadcast_to(middles[:, None], outlines.shape), outlines, np.roll(outlines, -1, axis=1)], axis=2
    )
    weights = _middle_weights(outlines.shape[1])
    moved, still = (
        np.concatenate([values, np.einsum("k,fkc->fc", weights, values[outlines])])
        for values in (displacement_nc, points_nc)
    )
    return Skin(still, moved, fans.reshape(-1, 3).astype(np.int64))


def eye_scene(eye: SimulatedEye) -> dict[str, Any]:
    """Return what the script draws: both halves of the wall, the needle, the colours of the displacement."""
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


def _middle_weights(corners_and_edges: int) -> Floats:
    """Return the weights of an outline's nodes in the middle of its face: of quadratic serendipity shape functions."""
    if corners_and_edges == 4:
        return np.full(4, 0.25)
    return np.tile([-0.25, 0.5], 4)


def _packed(skin: Skin) -> dict[str, Any]:
    """Return a skin as text; only vertices that its triangles use."""
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
