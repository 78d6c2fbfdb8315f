"""Raw B-scans drawn at the reduced size that a network sees, many at once (NumPy only).

The picture is that of `bscan.render_bscan`, averaged over the cells of a `FrameWindow`: a cell shows the mean count of
the speckle in each layer that it holds, and varies as the mean of n independent speckles and pixels. Boundaries do not
fold over, the speckle of neighbouring cells is independent, and thin bright lines have none.
"""

from collections.abc import Iterator, Sequence
from math import log, pi, sqrt

import numpy as np

from scleraforce.arrays import Reals, Singles
from scleraforce.laboratory.bscan import DrawnShaft
from scleraforce.laboratory.light import NO_LIGHT_DB, BscanOptics, Displayed, amplitude_sigma, transmission
from scleraforce.library import INNER, OUTER
from scleraforce.segmentation.wall_finder import FrameWindow, reduced_frame
from scleraforce.study import OctStudy

DB = 10.0 / log(10.0)  # of a factor e
DARKEST = 1e-6  # share of light: below it there is none
# The point spread function carries light beyond a bright edge, as far as it rises above the noise: its standard
# deviation (of the amplitude) times this and the root of the level in dB.
BEYOND_EDGE = 0.23


Layer = tuple[Reals, Reals, Reals, Reals]  # from and to a depth, m; level there, dB; its fall, dB/m; see `_layers`


def draw_reduced(
    depth_sbc: Reals, optics: Sequence[BscanOptics], oct_study: OctStudy, window: FrameWindow,
    rng: np.random.Generator, shafts: Sequence[DrawnShaft] = (),
) -> tuple[Singles, Reals]:  # fmt: skip
    """Draw reduced frames of walls, each with its optics and, if any has one, its needle (in the window's cells).

    Returns frames float32 (frame, row, column) and the rows of their walls' boundaries (frame, boundary, column):
    whole at the rows' middles, NaN in columns without wall or image.
    `depth_sbc` (frame, boundary, column of the window): m below the frame's top edge, NaN without wall.
    """
    displayed = Displayed(optics)
    surface_m = _surface(depth_sbc[:, OUTER], optics, window)
    wall_m = surface_m[:, None] + oct_study.refractive_index * (depth_sbc - surface_m[:, None])
    light_db = np.stack([_decibel(shaft.light * ~shaft.inside) for shaft in shafts]) if shafts else np.float32(0.0)
    layers = _layers(surface_m, wall_m, optics, oct_study, window)
    mean, variance = _speckled(layers, light_db, displayed, *_looks(optics, oct_study, window), window)
    for depth_m, width_m, level_db in _lines(surface_m, wall_m[:, OUTER], optics, window):
        share, _ = _covered(window, depth_m - 0.5 * width_m, depth_m + 0.5 * width_m)
        bright = displayed.mean(_there(level_db) + light_db)
        mean += share * np.maximum(bright - mean, 0.0)
    if shafts:
        mean = np.maximum(mean, displayed.mean(np.stack([_decibel(shaft.skin) for shaft in shafts])))
    mean += np.sqrt(variance) * rng.standard_normal(mean.shape, dtype=np.float32)
    down, along = _imaged(optics, oct_study, window)
    shown = np.clip(mean, 0.0, 1.0) * (down * along[:, None])
    frames = np.stack([reduced_frame(each, window.rows, window.columns) for each in shown])
    rows = wall_m / window.row_m - 0.5
    rows[~np.broadcast_to((along > 0.5)[:, None], rows.shape)] = np.nan
    return frames, rows


def _surface(outer_m: Reals, optics: Sequence[BscanOptics], window: FrameWindow) -> Reals:
    """Return the first surface that light meets (frame, column): the conjunctiva's, or the bare wall's."""
    slope = np.gradient(outer_m, window.column_m, axis=1)
    bare = np.zeros(window.columns)
    layers = [each.conjunctiva for each in optics]
    over_m = np.stack([bare if layer is None else layer.thicknesses(window.laterals_m) for layer in layers])
    return outer_m - over_m * np.hypot(1.0, slope)


def _light(optics: Sequence[BscanOptics], window: FrameWindow) -> Reals:
    """Return the level of a wall's surface, dB over the noise (frame, column): in shadows it is lower."""
    shadows = np.stack([_decibel(transmission(each.shadows, window.laterals_m)) for each in optics])
    return _each(optics, "snr_db") + shadows


def _layers(
    surface_m: Reals, wall_m: Reals, optics: Sequence[BscanOptics], oct_study: OctStudy, window: FrameWindow
) -> tuple[Layer, ...]:
    """Return the layer over the wall (at least the light beyond its edge), the wall and the choroid.

    Depths are (frame, column) in the picture, levels (frame, column) over the noise, falls (frame, 1).
    """
    outer_m, inner_m = wall_m[:, OUTER], wall_m[:, INNER]
    index, light = oct_study.refractive_index, _light(optics, window)
    falls, choroid_falls = (
        2.0 * DB * _each(optics, name) / index for name in ("attenuation_per_m", "choroid_attenuation_per_m")
    )
    layered = np.array([[0.0 if each.conjunctiva is None else each.conjunctiva.level_db] for each in optics])
    over = light + layered
    sigma_m = amplitude_sigma(1.0) * _each(optics, "axial_resolution_m")
    beyond_m = BEYOND_EDGE * sigma_m * np.sqrt(np.maximum(over, 0.0))
    behind = light + _each(optics, "choroid_level_db") - falls * (inner_m - surface_m)
    choroid_m = index * _each(optics, "choroid_thickness_m")
    return (
        (surface_m - beyond_m, outer_m, over + falls * beyond_m, falls),
        (outer_m, inner_m, light - falls * (outer_m - surface_m), falls),
        (inner_m, inner_m + choroid_m, behind, choroid_falls),
    )


def _looks(optics: Sequence[BscanOptics], oct_study: OctStudy, window: FrameWindow) -> tuple[Reals, float]:
    """Return the number of independent values that a cell averages: of speckle (frame, 1, 1), and of noise."""
    speckles, pixels = np.ones((len(optics), 1, 1)), 1.0
    for name, cell_m, pixel_m in (
        ("axial_resolution_m", window.row_m, oct_study.depth_m / oct_study.rows),
        ("lateral_resolution_m", window.column_m, oct_study.width_m / oct_study.columns),
    ):
        grain_m = sqrt(2.0 * pi) * amplitude_sigma(1.0) * _each(optics, name)[..., None]  # of the field's coherence
        speckles *= np.maximum(cell_m / np.maximum(grain_m, pixel_m), 1.0)
        pixels *= max(cell_m / pixel_m, 1.0)
    return speckles, pixels


def _speckled(
    layers: Sequence[Layer], light_db: Singles | np.float32, displayed: Displayed, speckles: Reals, pixels: float,
    window: FrameWindow,
) -> tuple[Singles, Singles]:  # fmt: skip
    """Return the mean count of each cell and its variance (frame, row, column)."""
    cells = (len(speckles), window.rows, window.columns)
    empty, mean, variance = np.ones(cells, np.float32), np.zeros(cells, np.float32), np.zeros(cells, np.float32)
    for top_m, bottom_m, level_db, falls_db_per_m in layers:
        share, below_m = _covered(window, top_m, bottom_m)
        fallen_db = below_m * falls_db_per_m[..., None].astype(np.float32)
        of_layer = displayed.moments(_there(level_db) - fallen_db + light_db)
        empty -= share
        mean += share * of_layer[0]
        variance += share * of_layer[1]
    dark_mean, dark_variance = displayed.moments(np.full((len(speckles), 1, 1), NO_LIGHT_DB, dtype=np.float32))
    np.maximum(empty, 0.0, out=empty)
    mean += empty * dark_mean
    variance /= speckles.astype(np.float32)
    variance += empty * (dark_variance / np.float32(pixels))
    return mean, variance


def _covered(window: FrameWindow, top_m: Reals, bottom_m: Reals) -> tuple[Singles, Singles]:
    """Return each cell's share between two depths, and distance below the first, m; 0 in columns without them."""
    edges = (np.arange(window.rows + 1, dtype=np.float32) * np.float32(window.row_m))[:, None]
    top, bottom = (np.nan_to_num(depth, nan=np.inf)[:, None].astype(np.float32) for depth in (top_m, bottom_m))
    begin, end = np.maximum(edges[:-1], top), np.minimum(edges[1:], bottom)
    share: Singles = np.maximum(end - begin, 0.0) / np.float32(window.row_m)
    below: Singles = np.where(share > 0.0, 0.5 * (begin + end) - np.minimum(top, edges[-1]), np.float32(0.0))
    return share, below


def _there(level_db: Reals) -> Singles:
    """Return levels (frame, column) for each row (frame, 1, column); NaN becomes no light."""
    return np.nan_to_num(level_db, nan=NO_LIGHT_DB)[:, None].astype(np.float32)


def _lines(
    surface_m: Reals, outer_m: Reals, optics: Sequence[BscanOptics], window: FrameWindow
) -> Iterator[tuple[Reals, Reals, Reals]]:
    """Yield depths of the middles (frame, column), full widths (frame, 1) and levels over the noise, dB, of thin lines.

    First come mirror reflections, then lines and covers, one per frame for each of the largest number.
    """
    light, two_sigmas_m = _light(optics, window), 2.0 * amplitude_sigma(1.0) * _each(optics, "axial_resolution_m")
    interface = [-np.inf if each.conjunctiva is None else each.conjunctiva.interface_db for each in optics]
    mirrors = (surface_m, _each(optics, "reflection_db")), (outer_m, np.array(interface)[:, None])
    for depth_m, reflection_db in mirrors:
        slope = np.arctan(np.gradient(depth_m, window.column_m, axis=1))
        falls = DB * (slope / _each(optics, "reflection_angle_rad")) ** 2
        yield depth_m, two_sigmas_m, light + np.maximum(reflection_db - falls, -DB * 30.0)
    highest_m = np.nanmin(np.minimum(surface_m, window.rows * window.row_m), axis=1)
    curves = [
        [(np.full(window.columns, line.depth_m), line.thickness_m, line.level_db) for line in each.lines]
        + [(top_m - cover.height_m + np.tan(cover.tilt_rad) * window.laterals_m, cover.thickness_m, cover.level_db)
           for cover in each.covers]
        for each, top_m in zip(optics, highest_m, strict=True)
    ]  # fmt: skip
    nothing = (np.full(window.columns, np.inf), 0.0, NO_LIGHT_DB)
    for number in range(max(map(len, curves))):
        depths, widths, levels = zip(*(own[number] if number < len(own) else nothing for own in curves), strict=True)
        width_m = 2.0 * amplitude_sigma(1.0) * np.array(widths)[:, None]
        yield np.stack(depths), width_m, np.array(levels)[:, None]


def _imaged(optics: Sequence[BscanOptics], oct_study: OctStudy, window: FrameWindow) -> tuple[Singles, Singles]:
    """Return the visible share of each row (row, 1) and of each column (frame, column) between the bands."""
    down = oct_study.depth_m / window.row_m - np.arange(window.rows)
    half_m = 0.5 * oct_study.width_m - _each(optics, "band_m")
    along = (half_m - np.abs(window.laterals_m)) / window.column_m + 0.5
    return np.clip(down, 0.0, 1.0).astype(np.float32)[:, None], np.clip(along, 0.0, 1.0).astype(np.float32)


def _each(optics: Sequence[BscanOptics], name: str) -> Reals:
    """Return a value of each frame's optics (frame, 1)."""
    return np.array([[getattr(each, name)] for each in optics])


def _decibel(share: Reals) -> Singles:
    """Return a ratio of intensities in dB, at least that of `DARKEST`."""
    return (10.0 * np.log10(np.maximum(share, DARKEST))).astype(np.float32)
