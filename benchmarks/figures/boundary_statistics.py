"""Statistics of the errors of found boundaries."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.fit.unknowns import shining
from scleraforce.library import INNER, OUTER
from scleraforce.records.study import SliceStudy

Floats = NDArray[np.float64]

# slopes of the surface: below, above
GENTLE = 0.3
STEEP = 0.4
LAGS = (1, 5)  # columns
SIDE_COLUMNS = 10
CLEAR_M = 0.1e-3  # of the frame's lower edge: nearer to it no error is counted
LAYER_M = 0.08e-3
LAYER_COLUMNS = 1 / 3
GENTLY_BENT_PER_M = 1000.0
# a frame needs as many for its shine
SHINING_COLUMNS = 5
JUDGED_COLUMNS = 40
LARGEST_SHINE_M = 0.02e-3
# larger errors are clipped to this for correlations: a bump does not count as noise
CORRELATED_M = 0.05e-3


@dataclass(frozen=True)
class BoundaryStatistics:
    """Errors of many slices.

    Standard deviations are robust (interquartile range over 1.349).

    Attributes:
        outer_bias_m: median error of the surface's depth where it is gentle.
        outer_sd_m: its standard deviation there.
        outer_per_curvature_m2: by how much the surface is seen deeper for each 1/m of
            its curvature.
        outer_correlation: of errors 1 and 5 columns apart.
        shine_m: by how much a frame's surface is seen too high where it faces the
            light, in the mean over frames, and `shine_sd_m`: from frame to frame; by
            least squares beside an offset and the curvature.
        thickness_sd_m: of the thickness down a column, the frame's own median taken
            out, on gentle slopes.
        thickness_steep_sd_m: on steep ones.
        thickness_correlation: as above.
        thickness_scale_sd: of the frames' median error, relative.
        layer_share: of frames whose thickness is more than 0.08 mm too large in more
            than a third of their columns.
        lost_share: of columns well above the lower edge, and away from the sides, that
            were not found.
    """

    outer_bias_m: float
    outer_sd_m: float
    outer_per_curvature_m2: float
    outer_correlation: tuple[float, ...]
    shine_m: float
    shine_sd_m: float
    thickness_sd_m: float
    thickness_steep_sd_m: float
    thickness_correlation: tuple[float, ...]
    thickness_scale_sd: float
    layer_share: float
    lost_share: float


def boundary_statistics(
    true_sbc: Floats, seen_sbc: Floats, study: SliceStudy
) -> BoundaryStatistics:
    """Compare boundaries, `SIDE_COLUMNS` at each side left out: what the scan does not
    reach is another matter.

    Args:
        true_sbc: depths (sample, boundary, column), m below the frame's upper edge.
        seen_sbc: as found; NaN: no wall was found.
        study: size of the slice and of its pixel.
    """
    inside = slice(SIDE_COLUMNS, study.columns - SIDE_COLUMNS)
    true = true_sbc[:, :, inside]
    seen = seen_sbc[:, :, inside]
    bottom_m = study.rows * study.pixel_m
    outer = true[:, OUTER]
    slope = np.gradient(outer, study.pixel_m, axis=1)
    curvature = np.gradient(slope, study.pixel_m, axis=1)
    found = np.isfinite(seen).all(axis=1) & (outer < bottom_m)
    gentle = found & (np.abs(slope) < GENTLE)
    steep = found & (np.abs(slope) >= STEEP)
    outer_error = np.where(found, seen[:, OUTER] - outer, np.nan)
    thickness_error, scale = _thickness_errors(true, seen, found, gentle, bottom_m)
    bent = found & (np.abs(curvature) < 2e3) & (np.abs(slope) < 1.0)
    shines = _shines(outer_error, slope, curvature)
    flat_error = np.where(np.abs(curvature) < 300.0, outer_error, np.nan)

    return BoundaryStatistics(
        outer_bias_m=float(np.median(outer_error[gentle])),
        outer_sd_m=_spread(flat_error[gentle & np.isfinite(flat_error)]),
        outer_per_curvature_m2=float(
            np.polyfit(curvature[bent], np.clip(outer_error[bent], -2e-4, 2e-4), 1)[0]
        ),
        outer_correlation=_correlations(flat_error),
        shine_m=float(shines.mean()),
        shine_sd_m=float(shines.std()),
        thickness_sd_m=_spread(thickness_error[gentle]),
        thickness_steep_sd_m=_spread(thickness_error[steep]),
        thickness_correlation=_correlations(np.where(gentle, thickness_error, np.nan)),
        thickness_scale_sd=_spread(scale),
        layer_share=_layer_share(true, seen, found, bottom_m),
        lost_share=float((~found)[outer < bottom_m - CLEAR_M].mean()),
    )


def _shines(outer_error: Floats, slope: Floats, curvature: Floats) -> Floats:
    """Return the shine (frame,), m, of frames that show enough columns facing the light
    and enough others.
    """
    judged = (
        np.isfinite(outer_error)
        & (np.abs(slope) < GENTLE)
        & (np.abs(curvature) < GENTLY_BENT_PER_M)
    )
    towards = shining(slope)
    shines = []

    for frame in np.flatnonzero(
        (judged & (towards > 0.5)).sum(axis=1) >= SHINING_COLUMNS
    ):
        at = np.flatnonzero(judged[frame])
        if len(at) < JUDGED_COLUMNS:
            continue

        parts = np.stack(
            [
                np.ones(len(at)),
                -towards[frame, at],
                curvature[frame, at] / GENTLY_BENT_PER_M,
            ],
            axis=1,
        )
        error_m = np.clip(outer_error[frame, at], -LARGEST_SHINE_M, LARGEST_SHINE_M)
        shines.append(np.linalg.lstsq(parts, error_m, rcond=None)[0][1])

    return np.array(shines)


def _thickness_errors(
    true: Floats,
    seen: Floats,
    found: NDArray[np.bool_],
    gentle: NDArray[np.bool_],
    bottom_m: float,
) -> tuple[Floats, Floats]:
    """Return errors of the thickness within the frame (sample, column), and their
    median in a frame, relative.
    """
    thick = np.minimum(true[:, INNER], bottom_m) - true[:, OUTER]
    error = np.where(
        found, np.minimum(seen[:, INNER], bottom_m) - seen[:, OUTER] - thick, np.nan
    )
    judged = [np.flatnonzero(row) for row in gentle & (true[:, INNER] < bottom_m)]
    scale = np.array(
        [
            np.median(row[at] / depth[at]) if len(at) else np.nan
            for row, depth, at in zip(error, thick, judged, strict=True)
        ]
    )

    return error - np.nan_to_num(scale)[:, None] * thick, scale[np.isfinite(scale)]


def _layer_share(
    true: Floats, seen: Floats, found: NDArray[np.bool_], bottom_m: float
) -> float:
    judged = found & (true[:, INNER] < bottom_m - LAYER_M)
    error = (seen[:, INNER] - seen[:, OUTER]) - (true[:, INNER] - true[:, OUTER])
    thicker = (judged & (error > LAYER_M)).sum(axis=1)
    return float((thicker > LAYER_COLUMNS * np.maximum(judged.sum(axis=1), 1)).mean())


def _spread(values: Floats) -> float:
    low, high = np.percentile(values, [25.0, 75.0])
    return float(high - low) / 1.349


def _correlations(errors: Floats) -> tuple[float, ...]:
    """Return correlations of errors (sample, column) some columns apart, NaN left
    out.
    """
    cut = np.clip(errors, -CORRELATED_M, CORRELATED_M)
    power = float(np.nanmean(cut**2))
    return tuple(
        float(np.nanmean(cut[:, lag:] * cut[:, :-lag])) / power for lag in LAGS
    )
