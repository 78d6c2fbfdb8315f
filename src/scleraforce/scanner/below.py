"""The layer below the wall: its level against the wall's, its attenuation and its thickness.

Below the inner boundary the mean intensity over the noise is B exp(-2 mu y) + 1 down to the layer's end, y the
geometric depth below the boundary along the column; below the end it is the noise alone. B against the wall's light at
the same place is the layer's level. Both ends are blurred by how far the boundary lies off where it was found.
"""

import numpy as np
from scipy.optimize import curve_fit
from scipy.special import ndtr

from scleraforce.scanner.display import Display
from scleraforce.scanner.estimate import Estimate, Unmeasured, fitted, level_db
from scleraforce.scanner.imaged_eye import ImagedEye, Trace
from scleraforce.scanner.tissue import WallLight, depth_profile

LayerBelow = tuple[Estimate | Unmeasured, Estimate | Unmeasured, Estimate | Unmeasured]

BIN_M = 8e-6
ABOVE_M, BELOW_M = 60e-6, 700e-6  # of the inner boundary: what is fitted
LEAST_BINS, LEAST_IN_BIN, LEAST_COLUMNS = 15, 50, 50
STEEPEST_RAD = 0.35  # of the surface: beyond, the light's way through the wall grows
MOST_LEVEL_ERROR_DB, MOST_SHARE = 1.5, 0.3
LEAST_SEEN_DB = 1.0  # over the noise: the layer's end must be brighter than that, to be one
NO_INNER = "the wall's inner boundary is not seen"
BLURRED = "what lies below the wall is no even layer, or too dark"
NO_END = "the layer below the wall fades into the noise before it ends"


def layer_below(eye: ImagedEye, display: Display, tissue: WallLight) -> LayerBelow:
    """Return level against the wall, dB, attenuation, 1/m, and thickness along the depth, m."""
    columns = tissue.clear & np.isfinite(tissue.column_db) & (eye.slope_rad < STEEPEST_RAD)
    if (
        not eye.inner_found
        or np.count_nonzero(columns) < LEAST_COLUMNS
        or isinstance(tissue.attenuation_per_m, Unmeasured)
    ):
        reason = Unmeasured(BLURRED if eye.inner_found else NO_INNER)
        return reason, reason, reason
    depth_m = eye.below_inner_rows * eye.row_m
    chosen = (depth_m > -ABOVE_M) & (depth_m < BELOW_M) & columns & (eye.below_surface_rows > eye.edge_rows)
    at_m, found_db, count = depth_profile(tissue.levels, depth_m, chosen, max(BIN_M, eye.row_m))
    seen = (count >= LEAST_IN_BIN) & (found_db < display.highest_db - LEAST_SEEN_DB)
    if np.count_nonzero(seen) < LEAST_BINS:
        reason = Unmeasured("too little is seen below the wall")
        return reason, reason, reason
    wall_m = np.nanmedian((eye.wall.inner_row - eye.surface_row)[columns]) * eye.row_m
    mu = tissue.attenuation_per_m.value
    at_inner_db = tissue.snr_db.value - 20.0 / np.log(10.0) * mu * wall_m

    def model(below_m: Trace, level: float, per_m: float, thick_m: float, off_m: float, blur_m: float) -> Trace:
        y = below_m - off_m
        wall = 10.0 ** (at_inner_db / 10.0) * np.exp(-2.0 * mu * y) * ndtr(-y / blur_m)
        inside = ndtr(y / blur_m) * ndtr((thick_m - y) / blur_m)
        layer = 10.0 ** ((at_inner_db + level) / 10.0) * np.exp(-2.0 * per_m * np.maximum(y, 0.0)) * inside
        return level_db(wall + layer + 1.0)

    try:
        value, covariance = curve_fit(
            model, at_m[seen], found_db[seen], (-8.0, 4000.0, 150e-6, 0.0, 15e-6), sigma=1.0 / np.sqrt(count[seen]),
            method="trf", loss="soft_l1", x_scale=(3.0, 1000.0, 5e-5, 1e-5, 1e-5),
            bounds=((-40.0, 0.0, 30e-6, -50e-6, 3e-6), (3.0, 30e3, 650e-6, 50e-6, 60e-6)), max_nfev=300,
        )  # fmt: skip
    except RuntimeError:
        reason = Unmeasured(BLURRED)
        return reason, reason, reason
    error = np.sqrt(np.diag(covariance))
    level = fitted(value[0], error[0], MOST_LEVEL_ERROR_DB, BLURRED)
    if isinstance(level, Unmeasured):
        return level, level, level
    end_db = at_inner_db + value[0] - 20.0 / np.log(10.0) * value[1] * value[2]
    thickness = fitted(value[2], error[2], MOST_SHARE * value[2], NO_END)
    if level_db(np.array(10.0 ** (end_db / 10.0) + 1.0)) < LEAST_SEEN_DB or value[2] > 0.9 * (BELOW_M - 50e-6):
        thickness = Unmeasured(NO_END)
    return level, fitted(value[1], error[1], MOST_SHARE * value[1], BLURRED), thickness
