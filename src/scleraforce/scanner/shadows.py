"""Shadows: columns that get less light than their neighbours, as below a vessel.

A shadow leaves 1 - loss exp(-ln 2 (2 x/width)^4) of the light, x from its middle. Only losses are found that stand out
of the speckle of their own columns: narrow and faint shadows are missed.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import find_objects, label
from scipy.optimize import curve_fit

from scleraforce.fitting.least_squares import robust_spread
from scleraforce.scanner.imaged_eye import ImagedEye, Trace
from scleraforce.scanner.tissue import WallLight, typical

LEAST_DB, LEAST_SDS = 1.0, 4.0  # by which a shadow's columns are darker, in dB and in the others' deviations
MARGIN = 1.5  # widths beside a shadow that are fitted with it
MOST_LOSS_ERROR = 0.15
LEAST_COLUMNS = 2


@dataclass(frozen=True, kw_only=True)
class SeenShadow:
    """A shadow: the column of its middle, its full width at half loss, m, and the share of the light that it takes."""

    column: float
    width_m: float
    loss_fraction: float


def find_shadows(eye: ImagedEye, tissue: WallLight) -> tuple[SeenShadow, ...]:
    """Return the shadows on a frame's wall."""
    light_db = typical(eye, tissue.column_db)
    known = np.isfinite(light_db)
    deviation = robust_spread(np.abs(light_db[known]))
    dark, _ = label(np.nan_to_num(light_db) < -max(LEAST_DB, LEAST_SDS * deviation))
    found = [_fitted(eye, light_db, place[0]) for place in find_objects(dark)]
    return _distinct([shadow for shadow in found if shadow is not None], eye.scale.lateral_m)


def _distinct(shadows: list[SeenShadow], lateral_m: float) -> tuple[SeenShadow, ...]:
    """Return shadows without those that lie in another one: parts of it that speckle has cut off."""
    kept: list[SeenShadow] = []
    for shadow in sorted(shadows, key=lambda each: -each.width_m):
        if all(abs(shadow.column - other.column) * lateral_m > other.width_m / 2 for other in kept):
            kept.append(shadow)
    return tuple(sorted(kept, key=lambda each: each.column))


def _fitted(eye: ImagedEye, light_db: Trace, place: slice) -> SeenShadow | None:
    """Return the shadow that lies about a run of dark columns; None: none fits."""
    columns = place.stop - place.start
    if columns < LEAST_COLUMNS:
        return None
    margin = max(4, round(MARGIN * columns))
    near = np.arange(max(place.start - margin, 0), min(place.stop + margin, len(light_db)))
    near = near[np.isfinite(light_db[near])]
    light = 10.0 ** (light_db[near] / 10.0)
    start = ((place.start + place.stop - 1) / 2, columns, 1.0 - light.min(), 1.0)
    try:
        value, covariance = curve_fit(
            _light, near, light, start, bounds=((near[0], 1.0, 0.0, 0.5), (near[-1], 4.0 * columns, 1.0, 2.0))
        )
    except (RuntimeError, ValueError):
        return None
    if not np.sqrt(covariance[2, 2]) < MOST_LOSS_ERROR:
        return None
    return SeenShadow(
        column=float(value[0]), width_m=float(value[1] * eye.scale.lateral_m), loss_fraction=float(value[2])
    )


def _light(column: Trace, middle: float, width: float, loss: float, base: float) -> Trace:
    light: Trace = base * (1.0 - loss * np.exp(-np.log(2.0) * (2.0 * (column - middle) / width) ** 4))
    return light
