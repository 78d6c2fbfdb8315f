"""The walls that are found in frames: boundaries in sampled columns, whether they can
be judged, and why not.
"""

from pathlib import Path
from typing import Any

import numpy as np

import scleraforce as sf
from golden.answers import Answers, Record, plain
from golden.inputs import SHARED, frame_files

COLUMNS = 9  # sampled of each boundary, evenly from edge to edge
MOST_FRAMES = 16  # of a recording
REAL = "real-oct"
PIXEL_M = 5e-6  # of the anterior-segment pictures, which state no scale


def answers(name: str, recordings: dict[str, Path], _folder: Path) -> Answers:
    """Return the walls of a recording's frames, or of the real scans."""
    if name == REAL:
        return _real_walls()
    scan = sf.read_recording(recordings[name]).info.scan
    row_um = 1e6 * scan.extent_m[1] / scan.shape[0]
    files = frame_files(recordings[name])[:MOST_FRAMES]
    return {f"{name}/{file.name}": _wall(file, row_um) for file in files}


def _real_walls() -> Answers:
    found = {}
    for file in sorted((SHARED / REAL / "tissue-surface").glob("*.tif")):
        found[f"{REAL}/{file.name}"] = _wall(file)
    for file in sorted((SHARED / REAL / "anterior-segment").glob("*.jp*g")):
        rows, columns = sf.read_frame(file).shape
        size_m = columns * PIXEL_M, rows * PIXEL_M
        found[f"{REAL}/{file.name}"] = _wall(file, 1e6 * PIXEL_M, *size_m)
    for file in sorted((SHARED / REAL / "dicom").glob("*.dcm")):
        found[f"{REAL}/{file.name}"] = _wall(file)
    return found


def _wall(
    file: Path,
    row_um: float | None = None,
    width_m: float | None = None,
    depth_m: float | None = None,
) -> Record:
    """Return the wall of a frame: boundaries below its top, in um where the height of a
    row is known, else in rows.

    None stands for a column that shows no boundary.
    """
    try:
        wall = sf.segment(file, width_m=width_m, depth_m=depth_m)
    except sf.InputError as fault:
        return {"error": str(fault).replace(str(file.parent), "")}
    unit = "rows" if row_um is None else "um"
    record = {
        "usable": wall.usable,
        "reason": wall.reason,
        "source": wall.source,
        "thickness_um": None if wall.thickness_m is None else 1e6 * wall.thickness_m,
        "conjunctiva_um": None
        if wall.conjunctiva_m is None
        else 1e6 * wall.conjunctiva_m,
        "needle": wall.needle is not None,
        "wall_pixels": int(np.count_nonzero(wall.mask == 255)),
        f"outer_{unit}": _sampled(wall.outer_row, row_um),
        f"inner_{unit}": _sampled(wall.inner_row, row_um),
    }
    return {name: plain(value) for name, value in record.items()}


def _sampled(row: Any, row_um: float | None) -> list[float]:
    columns = np.linspace(0, len(row) - 1, COLUMNS).astype(int)
    return [float(value) * (row_um or 1.0) for value in np.asarray(row)[columns]]
