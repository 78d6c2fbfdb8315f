"""Raw B-scans: a section of the wall as a spectral-domain scanner would show it, whole
or at a network's reduced size.

The tissue is a field of complex circular Gaussian scatterers (fully developed speckle:
Goodman, Speckle Phenomena in Optics, ch. 3), weighted by the root of the returning
light, seen through a Gaussian point spread function, plus mirror reflections and
complex Gaussian detector noise; the display shows its intensity (`BscanOptics.counts`).

Simplifications: rays run straight down the columns (no bending at the surface), light
is scattered once, the sensitivity does not fall off with depth, and everything below
the first surface of a column is stretched by `refractive_index`, also an air pocket
under a fold.

Reduced frames are drawn many at once, averaged over the cells of a `FrameWindow`: a
cell shows the mean count of the speckle in each layer that it holds, and varies as the
mean of n independent speckles and pixels. Boundaries do not fold over, the speckle of
neighbouring cells is independent, and thin bright lines have none.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, cos, log, pi, sin, sqrt, tan

import numpy as np

from scleraforce.base.arrays import Bytes, Counts, Flags, Floats, Reals, Singles
from scleraforce.lab.tissue_light import (
    NO_LIGHT_DB,
    BscanOptics,
    Conjunctiva,
    Displayed,
    NeedleShaft,
    add_ridge,
    amplitude_sigma,
    circular_gaussian,
    decibel,
    seen_through,
    transmission,
)
from scleraforce.library import INNER, OUTER
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.mechanics.mesh_section import columns_crossed
from scleraforce.records.study import OctStudy
from scleraforce.wall.wall_network import FrameWindow, reduced_frame

SKIN_M = 10e-6  # thickness of the bright edge, and at least SKIN_COLUMNS of a column
SKIN_COLUMNS = 0.5
TRACK_DB = -12.0  # of the light from torn tissue
HOLE_M = 30e-6  # how far above its hole the surface is gone


@dataclass(frozen=True, eq=False)
class DrawnShaft:
    """A shaft in a frame, (rows, columns): its pixels, the light that passes, its
    edge's intensity over the noise.
    """

    inside: Flags
    light: Singles
    skin: Singles

    def over(self, other: "DrawnShaft") -> "DrawnShaft":
        """Return both, one over the other."""
        return DrawnShaft(
            self.inside | other.inside, self.light * other.light, self.skin + other.skin
        )


def draw_shaft(
    shaft: NeedleShaft, tip_m: Floats, tilt_rad: float, oct_study: OctStudy
) -> DrawnShaft:
    """Cut a shaft, its tip lateral from the frame's middle and below its top edge, m,
    in an eye of a pose's tilt.
    """
    depth_m = oct_study.depth_m / oct_study.rows
    lateral_m = oct_study.width_m / oct_study.columns
    above = ceil(shaft.above_m / depth_m)
    down = (np.arange(-above, oct_study.rows) + 0.5)[:, None] * depth_m - tip_m[1]
    across = (
        (np.arange(oct_study.columns) + 0.5) * lateral_m
        - oct_study.width_m / 2
        - tip_m[0]
    )
    side_m, end_m = _signed_distances(shaft, across, down, tilt_rad)
    within_m = np.minimum(side_m, end_m)
    inside = within_m > 0.0
    covered = np.logical_or.accumulate(inside, axis=0)
    light = np.where(covered, 1.0 - shaft.loss_fraction, 1.0)
    # the outward normal points up: to the light
    upward = -np.gradient(within_m, depth_m, axis=0) < 0.0
    level = decibel(shaft.level_db) * np.where(upward, 1.0, decibel(shaft.far_edge_db))
    skin = level * np.exp(-np.square(within_m / max(SKIN_M, SKIN_COLUMNS * lateral_m)))

    return DrawnShaft(
        inside[above:],
        light[above:].astype(np.float32),
        skin[above:].astype(np.float32),
    )


def draw_track(
    hole_m: Floats,
    angle_rad: float,
    half_width_m: float,
    length_m: float,
    oct_study: OctStudy,
) -> DrawnShaft:
    """Draw what a needle leaves behind: a dim slit from its hole, (lateral, depth) as a
    shaft's tip, along its path.
    """
    depth_m = oct_study.depth_m / oct_study.rows
    lateral_m = oct_study.width_m / oct_study.columns
    down = (np.arange(oct_study.rows) + 0.5)[:, None] * depth_m - hole_m[1]
    across = (
        (np.arange(oct_study.columns) + 0.5) * lateral_m
        - oct_study.width_m / 2
        - hole_m[0]
    )
    along_m = down * cos(angle_rad) - across * sin(angle_rad)
    aside_m = across * cos(angle_rad) + down * sin(angle_rad)
    inside = (
        (np.abs(aside_m) <= max(half_width_m, lateral_m))
        & (along_m >= -HOLE_M)
        & (along_m <= length_m)
    )
    light = np.where(inside, decibel(TRACK_DB), 1.0).astype(np.float32)

    return DrawnShaft(np.zeros(light.shape, dtype=bool), light, np.zeros_like(light))


def _signed_distances(
    shaft: NeedleShaft, across: Floats, down: Floats, tilt_rad: float
) -> tuple[Floats, Floats]:
    """Return how far pixels lie within the shaft's side and above its end, m, (rows,
    columns) each; below 0: outside.

    Points are (across, out of the plane, up) from the tip; a bevelled end is longest at
    the shaft's lower side.
    """
    angle = shaft.angle_rad + tilt_rad
    radius_m = shaft.diameter_m / 2
    axis = np.array(
        [
            sin(angle) * cos(shaft.lean_rad),
            -sin(shaft.lean_rad),
            cos(angle) * cos(shaft.lean_rad),
        ]
    )
    # the side that the light falls on: a bevel is held up
    upper = -1.0 if angle > 0.0 else 1.0
    aside = upper * np.array([cos(angle), 0.0, -sin(angle)])
    slope = 1.0 / tan(shaft.bevel_rad) if shaft.bevel_rad < pi / 2 else 0.0
    shift_m = radius_m * aside if slope else np.zeros(3)
    x = across - shift_m[0]
    y = shaft.gap_m
    z = -down - shift_m[2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    off_x = x - along * axis[0]
    off_y = y - along * axis[1]
    off_z = z - along * axis[2]
    in_picture = np.square(off_x) + np.square(off_z)
    # The square of the distance from the axis, over how fast it grows in the picture:
    # exact at the side.
    side_m = (radius_m**2 - in_picture - np.square(off_y)) / (
        2.0 * np.sqrt(in_picture) + 1e-9
    )
    off_m = off_x * aside[0] + off_z * aside[2]
    end_m = (along - slope * (off_m + radius_m)) / np.hypot(1.0, slope)

    return side_m, end_m


def column_places(oct_study: OctStudy) -> Floats:
    """Return the lateral place of each column from the frame's middle, m."""
    return (
        np.arange(oct_study.columns) + 0.5
    ) / oct_study.columns * oct_study.width_m - oct_study.width_m / 2


@dataclass(frozen=True)
class Bscan:
    """A raw frame and the truth: `frame` uint16 (rows, columns), `truth_mask` uint8
    (rows, columns), 255 = wall.
    """

    frame: Counts
    truth_mask: Bytes


@dataclass(frozen=True)
class _PixelTissue:
    """The tissue in each pixel, (rows, columns)."""

    wall: Singles  # filled fractions
    choroid: Singles
    # through wall and conjunctiva, that light has passed, one way, down to the pixel's
    # middle
    tissue_path_m: Singles
    choroid_path_m: Singles
    surface_row: Singles  # (column,), from the top edge, NaN without tissue
    # its filled fractions, the row of the wall's surface below
    over: tuple[Conjunctiva, Singles, Singles] | None


def render_bscan(
    section: WallSection,
    oct_study: OctStudy,
    optics: BscanOptics,
    rng: np.random.Generator,
    shaft: DrawnShaft | None = None,
) -> Bscan:
    """Form one raw frame of a section."""
    pixel_m = oct_study.depth_m / oct_study.rows
    tissue = _fill_columns(section, oct_study, optics)
    scattered = _backscatter(tissue, oct_study, optics)

    if shaft is not None:
        scattered = (
            np.where(shaft.inside, 0.0, scattered * shaft.light).astype(np.float32)
            + shaft.skin
        )

    field = np.sqrt(scattered) * circular_gaussian(tissue.wall.shape, rng)
    sigma_rows = amplitude_sigma(optics.axial_resolution_m) / pixel_m
    sigma_columns = amplitude_sigma(optics.lateral_resolution_m) / (
        oct_study.width_m / oct_study.columns
    )
    field = seen_through(field, sigma_rows, sigma_columns)

    for rows, amplitude, sigma in _bright_curves(tissue, oct_study, optics, shaft):
        add_ridge(field, rows, amplitude, sigma, rng)

    field += circular_gaussian(field.shape, rng)
    counts = optics.counts(
        np.square(field.real) + np.square(field.imag), 2**oct_study.bits - 1
    )
    frame = np.rint(counts).astype(np.uint16)
    mask = np.where(tissue.wall >= 0.5, 255, 0).astype(np.uint8)
    band = round(optics.band_m / oct_study.width_m * oct_study.columns)

    for image in (frame, mask):
        image[:, :band] = 0
        image[:, oct_study.columns - band :] = 0

    return Bscan(frame, mask)


def column_crossings(curve: Floats, columns_m: Floats) -> Singles:
    """Return the depths (crossings, columns) at which vertical lines enter and leave
    the region that a curve encloses.

    The region is where the winding number is not 0: a wall that overlaps itself stays
    filled. An open curve (points, 2) bounds the region below it. Columns are evenly
    spaced; depths are sorted, and padded with inf.
    """
    place = (curve[:, 0] - columns_m[0]) / (columns_m[1] - columns_m[0])
    # turn: 1 to the right, -1 to the left
    segment, column, turn = columns_crossed(place, len(columns_m))
    x0, y0 = curve[:-1][segment].T
    x1, y1 = curve[1:][segment].T
    depth_m = y0 + (columns_m[column] - x0) * (y1 - y0) / (x1 - x0)
    order = np.lexsort((depth_m, column))
    column = column[order]
    depth_m = depth_m[order]
    turn = turn[order]
    first = np.searchsorted(column, column)
    total = np.concatenate([[0], np.cumsum(turn)])
    start = total[first]
    boundary = (total[1:] == start) != (total[:-1] == start)
    column = column[boundary]
    depth_m = depth_m[boundary]
    rank = np.arange(len(column)) - np.searchsorted(column, column)
    crossings = np.full(
        (rank.max(initial=-1) + 1, len(columns_m)), np.inf, dtype=np.float32
    )
    crossings[rank, column] = depth_m

    return crossings


def _fill_columns(
    section: WallSection, oct_study: OctStudy, optics: BscanOptics
) -> _PixelTissue:
    """Return the tissue in each pixel, from the exact crossings of every column with
    the contour.
    """
    pixel_m = oct_study.depth_m / oct_study.rows
    columns_m = column_places(oct_study)
    wall_m = column_crossings(
        np.concatenate([section.contour, section.outer[:1]]), columns_m
    )
    inside_m = column_crossings(section.inner, columns_m)
    layer = optics.conjunctiva
    tissue_m = wall_m

    if layer is not None:
        surface = layer.surface(section.outer)
        tissue_m = column_crossings(
            np.concatenate([surface, section.inner[::-1], surface[:1]]), columns_m
        )

    surface_m = (
        tissue_m[0]
        if len(tissue_m)
        else np.full(oct_study.columns, np.inf, dtype=np.float32)
    )
    # Light needs n times the depth below the surface: the row edges of the image, back
    # in geometric depth.
    edges_m = np.arange(oct_study.rows + 1, dtype=np.float32)[:, None] * np.float32(
        pixel_m
    )
    below_m = np.maximum(edges_m - surface_m, 0.0)
    edges_m = (edges_m - below_m * (1.0 - 1.0 / oct_study.refractive_index)).astype(
        np.float32
    )
    tissue_path_m = _length_above(edges_m, tissue_m)
    choroid_path_m = _length_above(
        edges_m, _layer_crossings(inside_m, optics.choroid_thickness_m)
    )
    tissue_part_m = np.diff(tissue_path_m, axis=0)
    choroid_part_m = np.diff(choroid_path_m, axis=0)
    row_m = np.diff(edges_m, axis=0)
    surface_m = np.where(np.isfinite(surface_m), surface_m, np.nan)
    wall_part_m = tissue_part_m
    over = None

    if layer is not None:
        wall_part_m = np.diff(_length_above(edges_m, wall_m), axis=0)
        upper_m = wall_m[0] if len(wall_m) else surface_m
        optical_m = surface_m + (upper_m - surface_m) * oct_study.refractive_index
        wall_row = np.where(np.isfinite(optical_m), optical_m / pixel_m, np.nan)
        over = (
            layer,
            _filled(tissue_part_m - wall_part_m, row_m),
            wall_row.astype(np.float32),
        )

    wall = _filled(wall_part_m, row_m)
    choroid = _filled(choroid_part_m, row_m)
    tissue_path_m[1:] -= tissue_part_m / 2
    choroid_path_m[1:] -= choroid_part_m / 2
    surface_row = (surface_m / pixel_m).astype(np.float32)

    return _PixelTissue(
        wall, choroid, tissue_path_m[1:], choroid_path_m[1:], surface_row, over
    )


def _filled(part_m: Singles, row_m: Singles) -> Singles:
    hair_m = 1e-4 * row_m.max()  # what rounding leaves
    return (np.where(part_m > hair_m, part_m, 0.0) / row_m).astype(np.float32)


def _length_above(edges_m: Singles, crossings_m: Singles) -> Singles:
    """Return the length of a column that is filled above each edge; crossings enter and
    leave by turns.
    """
    length_m = np.zeros(
        np.broadcast_shapes(edges_m.shape, crossings_m.shape[1:]), dtype=np.float32
    )
    for rank, depth_m in enumerate(crossings_m):
        passed_m = np.maximum(edges_m - depth_m, 0.0)
        length_m += passed_m if rank % 2 == 0 else -passed_m

    return length_m


def _layer_crossings(inside_m: Singles, thickness_m: float) -> Singles:
    """Return the crossings of a layer of given depth along the column, below each entry
    into the inside of the eye.
    """
    layer_m = np.full(
        (len(inside_m) + len(inside_m) % 2, inside_m.shape[1]), np.inf, dtype=np.float32
    )
    layer_m[: len(inside_m)] = inside_m
    layer_m[1::2] = np.minimum(layer_m[1::2], layer_m[::2] + np.float32(thickness_m))
    return layer_m


def _backscatter(
    tissue: _PixelTissue, oct_study: OctStudy, optics: BscanOptics
) -> Singles:
    """Return the mean intensity that comes back from each pixel, over the mean noise,
    shape (rows, columns).
    """
    depth = (
        optics.attenuation_per_m * tissue.tissue_path_m
        + optics.choroid_attenuation_per_m * tissue.choroid_path_m
    )
    scatter = tissue.wall + decibel(optics.choroid_level_db) * tissue.choroid

    if tissue.over is not None:
        layer, filled, _ = tissue.over
        scatter = scatter + decibel(layer.level_db) * filled

    columns_m = column_places(oct_study)
    light = decibel(optics.snr_db) * transmission(optics.shadows, columns_m)
    return (scatter * np.exp(-2.0 * depth) * light).astype(np.float32)


def _bright_curves(
    tissue: _PixelTissue,
    oct_study: OctStudy,
    optics: BscanOptics,
    shaft: DrawnShaft | None,
) -> Iterator[tuple[Reals, Reals, float]]:
    """Yield rows, amplitudes and half widths, in rows, of reflections, horizontal lines
    and covers above the tissue.

    The first surface of each column reflects like a mirror (Fresnel), and so does a
    wall below a conjunctiva.
    """
    pixel_m = oct_study.depth_m / oct_study.rows
    columns_m = column_places(oct_study)
    pixel_ratio = pixel_m / (oct_study.width_m / oct_study.columns)
    light = transmission(optics.shadows, columns_m)
    surfaces = [(tissue.surface_row, optics.reflection_db)]

    if tissue.over is not None:
        surfaces.append((tissue.over[2], tissue.over[0].interface_db))

    for surface_row, reflection_db in surfaces:
        slope = np.arctan(np.gradient(surface_row) * pixel_ratio)
        share = np.exp(-((slope / optics.reflection_angle_rad) ** 2))
        intensity = decibel(optics.snr_db + reflection_db) * share * light

        if shaft is not None:
            row = np.clip(np.nan_to_num(surface_row), 0, oct_study.rows - 1).astype(
                np.intp
            )
            intensity = intensity * shaft.light[row, np.arange(len(row))]

        yield (
            surface_row,
            np.sqrt(intensity),
            amplitude_sigma(optics.axial_resolution_m) / pixel_m,
        )

    ones = np.ones(oct_study.columns)
    surface_row = tissue.surface_row
    curves = [
        (ones * line.depth_m / pixel_m, line.level_db, line.thickness_m)
        for line in optics.lines
    ]
    top_m = (
        float(np.nanmin(surface_row)) * pixel_m
        if np.isfinite(surface_row).any()
        else oct_study.depth_m
    )

    for cover in optics.covers:
        rows = (top_m - cover.height_m + np.tan(cover.tilt_rad) * columns_m) / pixel_m
        curves.append((rows, cover.level_db, cover.thickness_m))

    for rows, level_db, thickness_m in curves:
        yield (
            rows,
            ones * sqrt(decibel(level_db)),
            amplitude_sigma(thickness_m) / pixel_m,
        )


DB = 10.0 / log(10.0)  # of a factor e
DARKEST = 1e-6  # share of light: below it there is none
# The point spread function carries light beyond a bright edge, as far as it rises above
# the noise: its standard deviation (of the amplitude) times this and the root of the
# level in dB.
BEYOND_EDGE = 0.23


# from and to a depth, m; level there, dB; its fall, dB/m; see `_layers`
Layer = tuple[Reals, Reals, Reals, Reals]


def draw_reduced(
    depth_sbc: Reals,
    optics: Sequence[BscanOptics],
    oct_study: OctStudy,
    window: FrameWindow,
    rng: np.random.Generator,
    shafts: Sequence[DrawnShaft] = (),
) -> tuple[Singles, Reals]:
    """Draw reduced frames of walls, each with its optics and, if any has one, its
    needle (in the window's cells).

    Returns frames float32 (frame, row, column) and the rows of their walls' boundaries
    (frame, boundary, column): whole at the rows' middles, NaN in columns without wall
    or image. `depth_sbc` (frame, boundary, column of the window): m below the frame's
    top edge, NaN without wall.
    """
    displayed = Displayed(optics)
    surface_m = _surface(depth_sbc[:, OUTER], optics, window)
    wall_m = surface_m[:, None] + oct_study.refractive_index * (
        depth_sbc - surface_m[:, None]
    )
    light_db = (
        np.stack([_decibel(shaft.light * ~shaft.inside) for shaft in shafts])
        if shafts
        else np.float32(0.0)
    )
    layers = _layers(surface_m, wall_m, optics, oct_study, window)
    mean, variance = _speckled(
        layers, light_db, displayed, *_looks(optics, oct_study, window), window
    )

    for depth_m, width_m, level_db in _lines(
        surface_m, wall_m[:, OUTER], optics, window
    ):
        share, _ = _covered(window, depth_m - 0.5 * width_m, depth_m + 0.5 * width_m)
        bright = displayed.mean(_there(level_db) + light_db)
        mean += share * np.maximum(bright - mean, 0.0)

    if shafts:
        mean = np.maximum(
            mean, displayed.mean(np.stack([_decibel(shaft.skin) for shaft in shafts]))
        )

    mean += np.sqrt(variance) * rng.standard_normal(mean.shape, dtype=np.float32)
    down, along = _imaged(optics, oct_study, window)
    shown = np.clip(mean, 0.0, 1.0) * (down * along[:, None])
    frames = np.stack(
        [reduced_frame(each, window.rows, window.columns) for each in shown]
    )
    rows = wall_m / window.row_m - 0.5
    rows[~np.broadcast_to((along > 0.5)[:, None], rows.shape)] = np.nan

    return frames, rows


def _surface(
    outer_m: Reals, optics: Sequence[BscanOptics], window: FrameWindow
) -> Reals:
    """Return the first surface that light meets (frame, column): the conjunctiva's, or
    the bare wall's.
    """
    slope = np.gradient(outer_m, window.column_m, axis=1)
    bare = np.zeros(window.columns)
    layers = [each.conjunctiva for each in optics]
    over_m = np.stack(
        [
            bare if layer is None else layer.thicknesses(window.laterals_m)
            for layer in layers
        ]
    )

    return outer_m - over_m * np.hypot(1.0, slope)


def _light(optics: Sequence[BscanOptics], window: FrameWindow) -> Reals:
    """Return the level of a wall's surface, dB over the noise (frame, column): in
    shadows it is lower.
    """
    shadows = np.stack(
        [_decibel(transmission(each.shadows, window.laterals_m)) for each in optics]
    )
    return _each(optics, "snr_db") + shadows


def _layers(
    surface_m: Reals,
    wall_m: Reals,
    optics: Sequence[BscanOptics],
    oct_study: OctStudy,
    window: FrameWindow,
) -> tuple[Layer, ...]:
    """Return the layer over the wall (at least the light beyond its edge), the wall and
    the choroid.

    Depths are (frame, column) in the picture, levels (frame, column) over the noise,
    falls (frame, 1).
    """
    outer_m = wall_m[:, OUTER]
    inner_m = wall_m[:, INNER]
    index = oct_study.refractive_index
    light = _light(optics, window)
    falls, choroid_falls = (
        2.0 * DB * _each(optics, name) / index
        for name in ("attenuation_per_m", "choroid_attenuation_per_m")
    )
    layered = np.array(
        [
            [0.0 if each.conjunctiva is None else each.conjunctiva.level_db]
            for each in optics
        ]
    )
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


def _looks(
    optics: Sequence[BscanOptics], oct_study: OctStudy, window: FrameWindow
) -> tuple[Reals, float]:
    """Return the number of independent values that a cell averages: of speckle (frame,
    1, 1), and of noise.
    """
    speckles = np.ones((len(optics), 1, 1))
    pixels = 1.0

    for name, cell_m, pixel_m in (
        ("axial_resolution_m", window.row_m, oct_study.depth_m / oct_study.rows),
        (
            "lateral_resolution_m",
            window.column_m,
            oct_study.width_m / oct_study.columns,
        ),
    ):
        # of the field's coherence
        grain_m = sqrt(2.0 * pi) * amplitude_sigma(1.0) * _each(optics, name)[..., None]
        speckles *= np.maximum(cell_m / np.maximum(grain_m, pixel_m), 1.0)
        pixels *= max(cell_m / pixel_m, 1.0)

    return speckles, pixels


def _speckled(
    layers: Sequence[Layer],
    light_db: Singles | np.float32,
    displayed: Displayed,
    speckles: Reals,
    pixels: float,
    window: FrameWindow,
) -> tuple[Singles, Singles]:
    """Return the mean count of each cell and its variance (frame, row, column)."""
    cells = (len(speckles), window.rows, window.columns)
    empty = np.ones(cells, np.float32)
    mean = np.zeros(cells, np.float32)
    variance = np.zeros(cells, np.float32)

    for top_m, bottom_m, level_db, falls_db_per_m in layers:
        share, below_m = _covered(window, top_m, bottom_m)
        fallen_db = below_m * falls_db_per_m[..., None].astype(np.float32)
        of_layer = displayed.moments(_there(level_db) - fallen_db + light_db)
        empty -= share
        mean += share * of_layer[0]
        variance += share * of_layer[1]

    dark_mean, dark_variance = displayed.moments(
        np.full((len(speckles), 1, 1), NO_LIGHT_DB, dtype=np.float32)
    )
    np.maximum(empty, 0.0, out=empty)
    mean += empty * dark_mean
    variance /= speckles.astype(np.float32)
    variance += empty * (dark_variance / np.float32(pixels))

    return mean, variance


def _covered(
    window: FrameWindow, top_m: Reals, bottom_m: Reals
) -> tuple[Singles, Singles]:
    """Return each cell's share between two depths, and distance below the first, m; 0
    in columns without them.
    """
    edges = (np.arange(window.rows + 1, dtype=np.float32) * np.float32(window.row_m))[
        :, None
    ]
    top, bottom = (
        np.nan_to_num(depth, nan=np.inf)[:, None].astype(np.float32)
        for depth in (top_m, bottom_m)
    )
    begin = np.maximum(edges[:-1], top)
    end = np.minimum(edges[1:], bottom)
    share: Singles = np.maximum(end - begin, 0.0) / np.float32(window.row_m)
    below: Singles = np.where(
        share > 0.0, 0.5 * (begin + end) - np.minimum(top, edges[-1]), np.float32(0.0)
    )

    return share, below


def _there(level_db: Reals) -> Singles:
    """Return levels (frame, column) for each row (frame, 1, column); NaN becomes no
    light.
    """
    return np.nan_to_num(level_db, nan=NO_LIGHT_DB)[:, None].astype(np.float32)


def _lines(
    surface_m: Reals, outer_m: Reals, optics: Sequence[BscanOptics], window: FrameWindow
) -> Iterator[tuple[Reals, Reals, Reals]]:
    """Yield depths of the middles (frame, column), full widths (frame, 1) and levels
    over the noise, dB, of thin lines.

    First come mirror reflections, then lines and covers, one per frame for each of the
    largest number.
    """
    light = _light(optics, window)
    two_sigmas_m = 2.0 * amplitude_sigma(1.0) * _each(optics, "axial_resolution_m")
    interface = [
        -np.inf if each.conjunctiva is None else each.conjunctiva.interface_db
        for each in optics
    ]
    mirrors = (
        (surface_m, _each(optics, "reflection_db")),
        (outer_m, np.array(interface)[:, None]),
    )

    for depth_m, reflection_db in mirrors:
        slope = np.arctan(np.gradient(depth_m, window.column_m, axis=1))
        falls = DB * (slope / _each(optics, "reflection_angle_rad")) ** 2
        yield (
            depth_m,
            two_sigmas_m,
            light + np.maximum(reflection_db - falls, -DB * 30.0),
        )

    highest_m = np.nanmin(np.minimum(surface_m, window.rows * window.row_m), axis=1)
    curves = [
        [
            (np.full(window.columns, line.depth_m), line.thickness_m, line.level_db)
            for line in each.lines
        ]
        + [
            (
                top_m - cover.height_m + np.tan(cover.tilt_rad) * window.laterals_m,
                cover.thickness_m,
                cover.level_db,
            )
            for cover in each.covers
        ]
        for each, top_m in zip(optics, highest_m, strict=True)
    ]
    nothing = (np.full(window.columns, np.inf), 0.0, NO_LIGHT_DB)

    for number in range(max(map(len, curves))):
        depths, widths, levels = zip(
            *(own[number] if number < len(own) else nothing for own in curves),
            strict=True,
        )
        width_m = 2.0 * amplitude_sigma(1.0) * np.array(widths)[:, None]
        yield np.stack(depths), width_m, np.array(levels)[:, None]


def _imaged(
    optics: Sequence[BscanOptics], oct_study: OctStudy, window: FrameWindow
) -> tuple[Singles, Singles]:
    """Return the visible share of each row (row, 1) and of each column (frame, column)
    between the bands.
    """
    down = oct_study.depth_m / window.row_m - np.arange(window.rows)
    half_m = 0.5 * oct_study.width_m - _each(optics, "band_m")
    along = (half_m - np.abs(window.laterals_m)) / window.column_m + 0.5
    return np.clip(down, 0.0, 1.0).astype(np.float32)[:, None], np.clip(
        along, 0.0, 1.0
    ).astype(np.float32)


def _each(optics: Sequence[BscanOptics], name: str) -> Reals:
    """Return a value of each frame's optics (frame, 1)."""
    return np.array([[getattr(each, name)] for each in optics])


def _decibel(share: Reals) -> Singles:
    """Return a ratio of intensities in dB, at least that of `DARKEST`."""
    return (10.0 * np.log10(np.maximum(share, DARKEST))).astype(np.float32)
