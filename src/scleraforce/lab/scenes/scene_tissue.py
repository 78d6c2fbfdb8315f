"""The tissue of a scene: the picture that it is drawn into, the rays that look into an
eye, the layers of the eye.
"""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from scleraforce.base.arrays import Flags, Floats, Singles
from scleraforce.lab.drawn_bscan import column_crossings
from scleraforce.lab.scenes.scene_wall import DrawnWall, Limbus, Window
from scleraforce.lab.tissue_light import ratios
from scleraforce.records.study import SceneTissueStudy, draw

ROUNDS = 5  # of the search for a ray's crossing with a curve


@dataclass(frozen=True)
class Rays:
    """The rays of a frame's columns below the tissue's surface, of a depth and a slope;
    (column,), NaN without tissue.

    A ray goes `sideways` and `downwards` (a unit vector); a point l along it is seen
    `stretch` l below the surface.
    """

    window: Window
    surface_m: Floats
    sideways: Floats
    downwards: Floats
    slope_rad: Floats
    stretch: float

    def row(self, height_m: Floats) -> Floats:
        """Return the row, (column,), at which a curve below the surface is seen;
        `height_m`: at `window.grid_m`.
        """
        length_m = (
            np.interp(self.window.lateral_m, self.window.grid_m, height_m)
            - self.surface_m
        )
        for _ in range(ROUNDS):
            at_m = self.window.lateral_m + self.sideways * length_m
            length_m = (
                np.interp(at_m, self.window.grid_m, height_m) - self.surface_m
            ) / self.downwards

        return self.window.row(self.surface_m + self.stretch * length_m)

    def row_of(self, points: Floats) -> Floats:
        """Return the row, (column,), at which a curve (point, 2), m, is seen."""
        return self.row(heights(points, self.window))


def rays_below(height_m: Floats, window: Window, refractive_index: float) -> Rays:
    """Return the rays below a surface (Snell's law); an index of 1 leaves them
    straight: of a corrected picture.
    """
    surface_m = np.interp(window.lateral_m, window.grid_m, height_m)
    slope = np.interp(
        window.lateral_m, window.grid_m, np.arctan(np.gradient(height_m, window.grid_m))
    )
    along = np.sin(slope) / refractive_index
    across = np.sqrt(1.0 - along**2)
    sideways = along * np.cos(slope) - across * np.sin(slope)
    downwards = along * np.sin(slope) + across * np.cos(slope)

    return Rays(window, surface_m, sideways, downwards, slope, refractive_index)


def heights(points: Floats, window: Window) -> Floats:
    """Return the depth of a curve from left to right at `window.grid_m`, NaN beyond its
    ends; folds are bridged.
    """
    lateral_m = np.maximum.accumulate(points[:, 0])
    return np.interp(window.grid_m, lateral_m, points[:, 1], left=np.nan, right=np.nan)


@dataclass(frozen=True)
class Ridge:
    """A thin bright curve (column,): row, intensity over the noise; a `shadowed` one
    loses the light lost above.
    """

    row: Floats
    intensity: Floats
    sigma_rows: float
    shadowed: bool = True


@dataclass(frozen=True)
class Picture:
    """A drawing (rows + above, columns): backscatter over the mean noise, loss of its
    logarithm, ridges, lids.
    """

    window: Window
    scatter: Singles
    loss: Singles
    ridges: list[Ridge]
    covered: Flags  # (column,), by a lid or a drape

    @property
    def rows(self) -> Singles:
        """The middles of the rows, shape (row, 1)."""
        return np.arange(len(self.scatter), dtype=np.float32)[:, None] + np.float32(0.5)

    def inside(self, top: Floats, bottom: Floats) -> Flags:
        """Return the pixels between two curves, given as rows (column,); none where one
        is NaN.
        """
        rows = self.rows
        return (rows >= top.astype(np.float32)) & (rows < bottom.astype(np.float32))

    def fill(
        self,
        top: Floats,
        bottom: Floats,
        intensity: Floats | float,
        attenuation_per_m: float,
        stretch: float,
    ) -> None:
        """Replace the tissue between two curves (rows); `stretch`: optical over
        geometric depth.
        """
        within = self.inside(top, bottom)
        np.copyto(self.scatter, np.asarray(intensity, dtype=np.float32), where=within)
        np.copyto(
            self.loss,
            np.float32(2.0 * attenuation_per_m * self.window.pixel_m / stretch),
            where=within,
        )

    def brighten(self, top: Floats, bottom: Floats, gain: Floats) -> None:
        """Multiply the backscatter between two curves (rows) by a gain, (column,) or
        (row, column).
        """
        np.multiply(
            self.scatter,
            gain,
            out=self.scatter,
            where=self.inside(top, bottom),
            casting="same_kind",
        )

    def fade(self, top: Floats, intensity: Floats, length_rows: float) -> None:
        """Add backscatter that fades below a curve (rows, (column,)), from an intensity
        (column,) on.
        """
        depth = self.rows - top.astype(np.float32)
        light = intensity.astype(np.float32) * np.exp(
            np.maximum(depth, 0.0) * np.float32(-1.0 / length_rows)
        )
        np.maximum(self.scatter, light, out=self.scatter, where=depth > 0.0)

    def shade(self, row: Floats, left: Floats) -> None:
        """Let only a share of the light (column,) pass beyond a row (column,)."""
        at = np.clip(np.nan_to_num(row, nan=0.0), 0, len(self.loss) - 1).astype(np.intp)
        self.loss[at, np.arange(self.loss.shape[1])] -= np.log(
            np.maximum(left, np.float32(1e-6))
        )


APART_DB = -3.0  # of a layer right below the sclera that no gap parts from it, at most
GAP_ROWS = 2.0  # of a gap, at least: it can be seen
LENS_HALF_M = 4.6e-3
LENS_ATTENUATION_PER_M = 0.1e3
LENS_LAYERS = 1.0, 0.82, 0.6  # cortex to nucleus: their size over the lens'
ALONG = np.linspace(0.0, 1.0, 60)  # the iris, from its root to the pupil
SIDES = (-1.0, 1.0)
GRAIN_M = 0.15e-3  # of an iris
# along the surface from the limbus on: the conjunctiva thickens over that length
COVERED_M = 1e-3
RIDGE_ROWS = 0.45  # half width of a mirror reflection
WALL_LAYERS = 10  # of even thickness, that the wall is drawn as
PROFILE_WAVES = 1.5  # of its brightness over its depth, at most


@dataclass(frozen=True)
class DrawnTissue:
    """A wall drawn into a picture: its rows there, (column,), NaN without wall;
    `surface` may be the conjunctiva's.
    """

    study: SceneTissueStudy
    wall: DrawnWall
    picture: Picture
    rays: Rays
    surface: Floats
    outer: Floats
    inner: Floats
    snr_db: float  # of the sclera's surface
    rng: np.random.Generator

    def light(self, values_db: float | Floats) -> Floats:
        """Return intensities over the mean noise of levels against the sclera."""
        return ratios(self.snr_db + values_db)

    def fill(
        self,
        top: Floats,
        bottom: Floats,
        intensity: Floats | float,
        attenuation_per_m: float,
    ) -> None:
        """Replace the tissue between two curves (rows)."""
        self.picture.fill(top, bottom, intensity, attenuation_per_m, self.rays.stretch)

    def facing(self) -> Floats:
        """Return the share of a mirror reflection that reaches the scanner,
        (column,).
        """
        return np.exp(
            -(
                (self.rays.slope_rad / draw(self.study.reflection_angle_rad, self.rng))
                ** 2
            )
        )

    def cornea(self, share: float) -> Floats:
        """Return the cornea's part (0: all sclera) in the light at a share of the
        wall's depth, (column,).
        """
        if self.wall.limbus is None:
            return np.zeros(len(self.outer))

        window = self.rays.window
        arc_m = np.interp(
            window.grid_m, np.maximum.accumulate(self.wall.outer[:, 0]), self.wall.arc_m
        )
        depth_m = (
            np.nan_to_num(share * (self.inner - self.outer))
            * window.pixel_m
            / self.rays.stretch
        )
        lateral_m = window.lateral_m + self.rays.sideways * depth_m  # of the rays there

        return self.wall.limbus.cornea(
            np.interp(lateral_m, window.grid_m, arc_m), share
        )


def draw_tissue(
    study: SceneTissueStudy, wall: DrawnWall, window: Window, rng: np.random.Generator
) -> DrawnTissue:
    """Draw the tissue into an empty picture."""
    scatter, loss = np.zeros(
        (2, window.rows + window.above, window.columns), dtype=np.float32
    )
    picture = Picture(
        window, scatter, loss, [], np.zeros(window.columns, dtype=np.bool_)
    )
    index = (
        1.0
        if rng.random() < study.corrected_share
        else draw(study.refractive_index, rng)
    )
    snr_db = draw(study.snr_db, rng)
    over_m = _conjunctiva(study, wall, rng)
    rays = rays_below(heights(wall.offset(-over_m), window), window, index)
    surface = window.row(rays.surface_m)
    outer = rays.row_of(wall.outer)
    inner = rays.row_of(wall.offset(wall.thickness_m))
    tissue = DrawnTissue(study, wall, picture, rays, surface, outer, inner, snr_db, rng)
    _fill_inside(tissue)
    _fill_wall(tissue)

    if over_m.any():  # with Tenon's layer as its lower part
        middle = outer - draw(study.tenon_share, rng) * (outer - surface)
        attenuation = draw(study.attenuation_per_m, rng)
        tissue.fill(
            surface, middle, tissue.light(draw(study.conjunctiva_db, rng)), attenuation
        )
        tissue.fill(middle, outer, tissue.light(draw(study.tenon_db, rng)), attenuation)

    _roughen(tissue)
    facing = tissue.facing()
    picture.ridges.append(
        Ridge(
            surface, tissue.light(draw(study.reflection_db, rng)) * facing, RIDGE_ROWS
        )
    )

    return tissue


def _conjunctiva(
    study: SceneTissueStudy, wall: DrawnWall, rng: np.random.Generator
) -> Floats:
    """Return the thickness of the conjunctiva with Tenon's layer, (point,), m; 0 over
    the cornea, and in some eyes.
    """
    thickness_m = draw(study.conjunctiva_m, rng)
    if rng.random() >= study.conjunctiva_share:
        return np.zeros(len(wall.arc_m))

    covered = np.ones(len(wall.arc_m))
    if wall.limbus is not None:
        covered = np.clip(
            (np.abs(wall.arc_m) - wall.limbus.arc_m) / COVERED_M, 0.0, 1.0
        )

    swell = 1.0 + 0.3 * np.sin(
        2.0 * np.pi * wall.arc_m / rng.uniform(1.5e-3, 6e-3) + rng.uniform(0.0, 6.0)
    )
    return thickness_m * covered * swell


def _fill_inside(tissue: DrawnTissue) -> None:
    """Fill the inside of the eye: haze, light below the sclera, iris and lens, ciliary
    body and choroid.
    """
    study = tissue.study
    rng = tissue.rng
    wall = tissue.wall
    inner = tissue.inner

    if rng.random() < study.haze_share:
        tissue.fill(
            inner,
            np.full(len(inner), np.inf),
            tissue.light(draw(study.haze_db, rng)),
            0.0,
        )

    _fade_below(tissue, inner, 1.0 - tissue.cornea(1.0))
    uvea_m = (
        _uvea(study, wall, rng)
        if rng.random() < study.uvea_share
        else np.zeros(len(wall.arc_m))
    )

    if wall.limbus is not None:
        _fill_iris_and_lens(tissue, wall.limbus, uvea_m)
    if uvea_m.any():
        _fill_uvea(tissue, uvea_m)


def _fade_below(tissue: DrawnTissue, top: Floats, level: Floats) -> None:
    """Let the light of tissue, of a level (column,) over the sclera's, fade below its
    lower end, in some scenes.
    """
    study = tissue.study
    rng = tissue.rng
    length_m = draw(study.below_m, rng)
    level_db = draw(study.below_db, rng)

    if rng.random() < study.below_share:
        length_rows = length_m * tissue.rays.stretch / tissue.picture.window.pixel_m
        tissue.picture.fade(top, level * tissue.light(level_db), length_rows)


def _uvea(study: SceneTissueStudy, wall: DrawnWall, rng: np.random.Generator) -> Floats:
    """Return the thickness of ciliary body and choroid, (point,), m; they begin at the
    scleral spur.
    """
    choroid_m, ciliary_m, length_m = (
        draw(v, rng) for v in (study.choroid_m, study.ciliary_m, study.ciliary_length_m)
    )
    rise_m = draw(study.ciliary_rise_m, rng)

    if wall.limbus is None:
        return np.full(len(wall.arc_m), choroid_m)

    beyond_m = np.abs(wall.arc_m) - wall.limbus.spur_m
    falling = np.exp(-2.5 * np.maximum(beyond_m - rise_m, 0.0) / length_m)
    return np.clip(beyond_m / rise_m, 0.0, 1.0) * (
        choroid_m + max(ciliary_m - choroid_m, 0.0) * falling
    )


def _fill_uvea(tissue: DrawnTissue, thickness_m: Floats) -> None:
    """Fill ciliary body and choroid; a dark gap parts a layer that is as bright as the
    sclera from it.
    """
    study = tissue.study
    rng = tissue.rng
    wall = tissue.wall
    inner = tissue.inner
    level_db = draw(study.uvea_db, rng)
    gap_m = draw(study.gap_m, rng)
    gap_db = draw(study.gap_db, rng)
    attenuation = draw(study.uvea_attenuation_per_m, rng)
    parted = rng.random() < study.gap_share
    bottom = tissue.rays.row_of(wall.offset(wall.thickness_m + thickness_m))
    top = np.where(bottom > inner, inner, np.nan)
    tissue.fill(
        top,
        bottom,
        tissue.light(level_db if parted else min(level_db, APART_DB)),
        attenuation,
    )

    if parted:
        gap = inner + max(
            gap_m * tissue.rays.stretch / tissue.picture.window.pixel_m, GAP_ROWS
        )
        tissue.fill(top, np.minimum(gap, bottom), tissue.light(gap_db), attenuation)


def _fill_iris_and_lens(tissue: DrawnTissue, limbus: Limbus, uvea_m: Floats) -> None:
    """Fill the iris, which begins on the face of the ciliary body, and the lens behind
    it.
    """
    study = tissue.study
    rng = tissue.rng
    wall = tissue.wall
    root_arc_m = limbus.spur_m + draw(study.iris_root, rng) * draw(
        study.ciliary_rise_m, rng
    )
    deeper_m = draw(study.iris_depth_m, rng)
    face = wall.offset(wall.thickness_m + uvea_m)  # of the ciliary body, below the wall

    roots = {
        side: np.array(
            [np.interp(side * root_arc_m, wall.arc_m, along) for along in face.T]
        )
        for side in SIDES
        if wall.arc_m[0] < side * root_arc_m < wall.arc_m[-1]
    }
    if not roots:
        return

    zero, below = wall.pose.place_points(np.array([[0.0, 0.0], [0.0, 1.0]]))
    plane_m = (
        float(np.mean([(root - zero) @ (below - zero) for root in roots.values()]))
        + deeper_m
    )

    if rng.random() < study.lens_share:
        _fill_lens(tissue, plane_m)
    if rng.random() < study.iris_share:
        _fill_iris(tissue, roots, below - zero, plane_m)


def _fill_iris(
    tissue: DrawnTissue, roots: dict[float, Floats], down: Floats, plane_m: float
) -> None:
    """Fill both halves of the iris, from their roots (side: place in the frame) to the
    pupil, and their pigment.
    """
    study = tissue.study
    rng = tissue.rng
    wall = tissue.wall
    picture = tissue.picture
    thick_m, bow_m, pupil_m = (
        draw(values, rng) for values in (study.iris_m, study.iris_bow_m, study.pupil_m)
    )
    level_db = draw(study.iris_db, rng)
    attenuation = draw(study.iris_attenuation_per_m, rng)
    pigment_db = level_db + draw(study.pigment_db, rng)
    grain_db = draw(study.iris_grain_db, rng)
    pigment_rows = (
        draw(study.pigment_m, rng) * tissue.rays.stretch / picture.window.pixel_m
    )
    grain = np.exp(_grains(picture, rng) * np.float32(grain_db * np.log(10.0) / 10.0))
    bump_m = (
        0.15 * thick_m * np.sin(rng.uniform(4.0, 14.0) * ALONG + rng.uniform(0.0, 6.0))
    )
    upper_m = bow_m * np.sin(np.pi * ALONG) + bump_m
    lower_m = thick_m * (1.0 - 0.5 * (1.0 - ALONG) ** 2)

    for side, root in roots.items():
        pupil = wall.pose.place_points(np.array([[side * pupil_m, plane_m]]))[0]
        middle = root + ALONG[:, None] * (pupil - root)
        crypts_m = _crypts(study, thick_m, float(np.linalg.norm(pupil - root)), rng)
        upper, lower = (
            middle + edge_m[:, None] * down
            for edge_m in (upper_m + crypts_m, upper_m + lower_m)
        )
        top, bottom = _between(tissue, np.concatenate([upper, lower[::-1]]))
        _fade_below(tissue, bottom, np.full(len(bottom), ratios(level_db)))
        tissue.fill(top, bottom, tissue.light(level_db), attenuation)
        tissue.fill(
            np.maximum(bottom - pigment_rows, top),
            bottom,
            tissue.light(pigment_db),
            attenuation,
        )
        picture.brighten(top, bottom, grain)


def _crypts(
    study: SceneTissueStudy, thick_m: float, length_m: float, rng: np.random.Generator
) -> Floats:
    """Return the depth of pits in the front of an iris of a length, along it, m."""
    depth_m = np.zeros(len(ALONG))
    for _ in range(int(draw(study.crypt_count, rng))):
        off_m = (ALONG - rng.random()) * length_m
        depth_m += (
            rng.uniform(0.2, 0.6)
            * thick_m
            * np.exp(-((off_m / draw(study.crypt_m, rng)) ** 2))
        )

    return np.minimum(depth_m, 0.4 * thick_m)


def _fill_lens(tissue: DrawnTissue, plane_m: float) -> None:
    """Fill the lens, its layers within each other, with the bright layers of its
    capsule.
    """
    study = tissue.study
    rng = tissue.rng
    rays = tissue.rays
    radius_m = draw(study.lens_radius_m, rng)
    front_m = plane_m + draw(study.lens_depth_m, rng)
    lateral = np.linspace(-LENS_HALF_M, LENS_HALF_M, 40)
    sag = radius_m - np.sqrt(radius_m**2 - lateral**2)
    half_m = sag[0] + draw(study.lens_rim_m, rng) / 2
    # a round equator
    depth_m = (half_m - sag) * np.sqrt(1.0 - (lateral / LENS_HALF_M) ** 8)
    outline = np.concatenate(
        [np.stack([lateral, -depth_m], 1), np.stack([lateral, depth_m], 1)[::-1]]
    )
    level_db = draw(study.lens_db, rng)
    layer_db = draw(study.lens_layer_db, rng)
    centre = np.array([0.0, front_m + half_m])
    edges = []

    for size in LENS_LAYERS:
        edges.append(
            _between(tissue, tissue.wall.pose.place_points(size * outline + centre))
        )
        tissue.fill(
            *edges[-1],
            tissue.light(level_db + layer_db * rng.uniform(-1.0, 1.0)),
            LENS_ATTENUATION_PER_M,
        )

    top, bottom = edges[0]
    capsule_rows = (
        draw(study.capsule_m, rng) * rays.stretch / tissue.picture.window.pixel_m
    )
    # its mirror reflection is lost at a slope
    turned = ratios(-20.0 * np.minimum(np.abs(rays.slope_rad), 1.0))
    capsule = tissue.light(draw(study.capsule_db, rng)) * turned
    tissue.fill(top, np.minimum(top + capsule_rows, bottom), capsule, 0.0)
    tissue.fill(
        np.maximum(bottom - capsule_rows, top),
        bottom,
        capsule * ratios(-rng.uniform(0.0, 12.0)),
        0.0,
    )


def outline_depths(outline: Floats, lateral_m: Floats) -> Floats:
    """Return the depths (2, place) between which a closed outline is seen, NaN outside
    of it.
    """
    crossings = column_crossings(
        np.concatenate([outline, outline[:1]]), lateral_m
    ).astype(np.float64)
    seen = crossings[:2] if len(crossings) else np.full((2, len(lateral_m)), np.nan)
    return np.where(np.isfinite(seen), seen, np.nan)


def _between(tissue: DrawnTissue, outline: Floats) -> tuple[Floats, Floats]:
    """Return the rows between which a closed outline inside the wall is seen,
    (column,), NaN outside of it.
    """
    top, bottom = map(
        tissue.rays.row, outline_depths(outline, tissue.rays.window.grid_m)
    )
    return np.maximum(top, tissue.inner), bottom


def _fill_wall(tissue: DrawnTissue) -> None:
    """Fill the wall, layer by layer; the cornea's backscatter falls with the angle of
    the light to its normal.
    """
    study = tissue.study
    rng = tissue.rng
    outer = tissue.outer
    inner = tissue.inner
    most_db = draw(study.angle_fall_db, rng)
    width_rad = draw(study.angle_width_rad, rng)
    fall_db = most_db * (1.0 - np.exp(-((tissue.rays.slope_rad / width_rad) ** 2) / 2))
    cornea_db = draw(study.cornea_db, rng) - fall_db
    waves = rng.uniform(0.0, PROFILE_WAVES)
    phase = rng.uniform(0.0, 2.0 * np.pi)
    profile_db = draw(study.profile_db, rng)
    attenuation = draw(study.attenuation_per_m, rng)

    for above, below in pairwise(np.linspace(0.0, 1.0, WALL_LAYERS + 1)):
        share = float(above + below) / 2
        level_db = tissue.cornea(share) * cornea_db
        level_db = level_db + profile_db * np.sin(2.0 * np.pi * waves * share + phase)
        top = outer + above * (inner - outer)
        bottom = outer + below * (inner - outer)
        tissue.fill(top, bottom, tissue.light(level_db), attenuation)

    for _ in range(int(draw(study.scar_count, rng))):
        _scar(tissue)

    if tissue.wall.limbus is not None:
        _fill_faces(tissue, cornea_db)


def _fill_faces(tissue: DrawnTissue, cornea_db: Floats) -> None:
    """Draw the cornea's two faces: its epithelium, and the mirror reflection of its
    inner boundary.
    """
    study = tissue.study
    rng = tissue.rng
    outer = tissue.outer
    inner = tissue.inner
    cornea = tissue.cornea(0.0)
    rows = (
        draw(study.epithelium_m, rng)
        * tissue.rays.stretch
        / tissue.picture.window.pixel_m
    )
    epithelium = np.where(cornea > 0.5, outer, np.nan)
    gain = 10.0 ** (draw(study.epithelium_db, rng) * cornea / 10.0)
    tissue.picture.brighten(epithelium, np.minimum(outer + rows, inner), gain)
    facing = tissue.facing()
    cornea = tissue.cornea(1.0)
    intensity = (
        tissue.light(cornea * cornea_db + draw(study.boundary_db, rng))
        * facing
        * cornea
    )
    tissue.picture.ridges.append(Ridge(inner, intensity, RIDGE_ROWS))


def _scar(tissue: DrawnTissue) -> None:
    """Draw a spot in the wall, dark or bright, and its shadow."""
    study = tissue.study
    rng = tissue.rng
    picture = tissue.picture
    outer = tissue.outer
    inner = tissue.inner
    window = picture.window
    half_m = draw(study.scar_m, rng)
    half_rows = draw(study.scar_height_m, rng) * tissue.rays.stretch / window.pixel_m
    share = rng.random()
    across = (window.lateral_m - rng.uniform(*window.lateral_m[[0, -1]])) / half_m
    middle = outer + share * (inner - outer)
    near = np.exp(-(across**2) - ((picture.rows - middle) / half_rows) ** 2)
    gain = np.exp(draw(study.scar_db, rng) * np.log(10.0) / 10.0 * near)
    picture.brighten(outer, inner, gain)
    loss = draw(study.scar_loss_fraction, rng) * np.exp(-(across**2))
    picture.shade(middle, np.where(np.isfinite(middle), 1.0 - loss, 1.0))


def _grains(
    picture: Picture,
    rng: np.random.Generator,
    length_m: float = GRAIN_M,
    height_m: float = GRAIN_M,
) -> Singles:
    """Return smooth grains of unit variance at their middles, of a size, (row,
    column).
    """
    window = picture.window
    shape = picture.scatter.shape
    across = round(window.width_m / length_m)
    down = round(shape[0] * window.pixel_m / height_m)
    size = min(max(3, down), shape[0]), min(max(3, across), shape[1])
    drawn = rng.standard_normal(size, dtype=np.float32)

    return cv2.resize(drawn, shape[::-1], interpolation=cv2.INTER_LINEAR).astype(
        np.float32, copy=False
    )


def _roughen(tissue: DrawnTissue) -> None:
    """Give the tissue a texture of long grains along its surface."""
    study = tissue.study
    rng = tissue.rng
    picture = tissue.picture
    surface = tissue.surface
    shape = picture.scatter.shape
    smooth = _grains(
        picture,
        rng,
        draw(study.texture_length_m, rng),
        draw(study.texture_height_m, rng),
    )
    shift = np.nan_to_num(
        surface - np.nanmean(surface) if np.isfinite(surface).any() else surface,
        nan=0.0,
    )
    map_row = picture.rows - shift.astype(np.float32)
    map_column = np.broadcast_to(np.arange(shape[1], dtype=np.float32), shape)
    along = cv2.remap(
        smooth, map_column, map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
    )
    strength = np.float32(draw(study.texture_db, rng) * np.log(10.0) / 10.0)
    picture.scatter[...] *= np.exp(strength * along)
