"""What light meets in each pixel of a scene, filled layer by layer; its levels; and the rays that look into an eye."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.bscan import column_crossings
from scleraforce.laboratory.scene_wall import Curve, DrawnWall, Limbus, Points, Window
from scleraforce.segmentation.grid import Float
from scleraforce.study import SceneTissueStudy, draw

ROUNDS = 5  # of the search for where a ray meets a curve


@dataclass(frozen=True)
class Rays:
    """The rays of a frame's columns below the tissue's first surface; all (column,), NaN where there is none.

    `surface_m`: depth of that surface. A ray goes `sideways` and `downwards` (a unit vector), and what lies at a length
    l along it is seen `stretch` l below the surface. `slope_rad`: the surface's angle against the lateral axis.
    """

    window: Window
    surface_m: Curve
    sideways: Curve
    downwards: Curve
    slope_rad: Curve
    stretch: float

    def apparent(self, height_m: Curve) -> Curve:
        """Return where a curve below the surface is seen, m below the frame's top edge, shape (column,).

        Args:
            height_m: the curve's depth at `window.grid_m`, NaN where it is not.
        """
        length_m = np.interp(self.window.lateral_m, self.window.grid_m, height_m) - self.surface_m
        for _ in range(ROUNDS):
            at_m = self.window.lateral_m + self.sideways * length_m
            length_m = (np.interp(at_m, self.window.grid_m, height_m) - self.surface_m) / self.downwards
        seen: Curve = self.surface_m + self.stretch * length_m
        return seen

    def seen_at(self, values: Curve, depth_m: Curve | float) -> Curve:
        """Return what stands at `window.grid_m` where the rays are so deep below the surface, shape (column,)."""
        at: Curve = np.interp(self.window.lateral_m + self.sideways * depth_m, self.window.grid_m, values)
        return at


def rays_below(height_m: Curve, window: Window, refractive_index: float) -> Rays:
    """Return the rays below a surface; an index of 1 leaves them straight: the scanner has corrected its picture.

    Snell's law: the part of a ray's direction along the surface is divided by the refractive index.
    """
    surface_m = np.interp(window.lateral_m, window.grid_m, height_m)
    slope = np.interp(window.lateral_m, window.grid_m, np.arctan(np.gradient(height_m, window.grid_m)))
    along = np.sin(slope) / refractive_index
    across = np.sqrt(1.0 - along**2)
    sideways = along * np.cos(slope) - across * np.sin(slope)
    downwards = along * np.sin(slope) + across * np.cos(slope)
    return Rays(window, surface_m, sideways, downwards, slope, refractive_index)


def heights(points: NDArray[np.float64], window: Window) -> Curve:
    """Return the depth of a curve from left to right at `window.grid_m`, NaN beyond its ends, shape (point,).

    Where it turns back it is bridged.
    """
    lateral_m = np.maximum.accumulate(points[:, 0])
    depth: Curve = np.interp(window.grid_m, lateral_m, points[:, 1], left=np.nan, right=np.nan)
    return depth


@dataclass(frozen=True)
class Ridge:
    """A thin bright curve: its row in the drawing (column,), NaN where it is not, intensity over the noise (column,).

    `sigma_rows` is its half width; one that is `shadowed` loses what the light has lost down to there.
    """

    row: Curve
    intensity: Curve
    sigma_rows: float
    shadowed: bool = True


@dataclass(frozen=True)
class Picture:
    """A drawing of (rows + above, columns) pixels.

    `scatter`: backscatter over the mean noise; `loss`: of the logarithm of the intensity in each pixel, both ways;
    `ridges` come on top.
    """

    window: Window
    scatter: Float
    loss: Float
    ridges: list[Ridge]

    @property
    def rows(self) -> Float:
        """The middles of the rows, shape (row, 1)."""
        rows: Float = np.arange(len(self.scatter), dtype=np.float32)[:, None] + np.float32(0.5)
        return rows

    def inside(self, top: Curve, bottom: Curve) -> NDArray[np.bool_]:
        """Return which pixels lie between two curves, given as rows (column,); none where one is NaN."""
        rows = self.rows
        within: NDArray[np.bool_] = (rows >= top.astype(np.float32)) & (rows < bottom.astype(np.float32))
        return within

    def fill(
        self, top: Curve, bottom: Curve, intensity: Curve | float, attenuation_per_m: float, stretch: float
    ) -> None:
        """Fill what lies between two curves (rows), in place of what was there.

        Args:
            top: upper edge, (column,).
            bottom: lower edge, (column,).
            intensity: backscatter over the mean noise, one or (column,).
            attenuation_per_m: of the light, one way.
            stretch: of optical over geometric depth.
        """
        within = self.inside(top, bottom)
        np.copyto(self.scatter, np.asarray(intensity, dtype=np.float32), where=within)
        loss = 2.0 * attenuation_per_m * self.window.pixel_m / stretch
        np.copyto(self.loss, np.float32(loss), where=within)

    def brighten(self, top: Curve, bottom: Curve, gain: Curve) -> None:
        """Multiply the backscatter between two curves (rows) by a gain, (column,) or (row, column)."""
        np.multiply(self.scatter, gain, out=self.scatter, where=self.inside(top, bottom), casting="same_kind")

    def shade(self, row: Curve, left: Curve) -> None:
        """Let only a share of the light (column,) pass beyond a row (column,)."""
        at = np.clip(np.nan_to_num(row, nan=0.0), 0, len(self.loss) - 1).astype(np.intp)
        self.loss[at, np.arange(self.loss.shape[1])] -= np.log(np.maximum(left, np.float32(1e-6)))


def empty_picture(window: Window) -> Picture:
    """Return a drawing with nothing in it."""
    shape = (window.rows + window.above, window.columns)
    return Picture(window, np.zeros(shape, dtype=np.float32), np.zeros(shape, dtype=np.float32), [])


def level(decibels: Curve | float) -> Curve:
    """Return ratios of intensities from dB."""
    ratio: Curve = np.power(10.0, np.asarray(decibels) / 10.0)
    return ratio


@dataclass(frozen=True, kw_only=True)
class Light:
    """What is drawn into a scene's tissue.

    `snr_db`: of the sclera at the surface over the mean noise; `stretch`: of optical over geometric depth.
    """

    study: SceneTissueStudy
    snr_db: float
    stretch: float
    rng: np.random.Generator

    def of(self, values_db: float | Curve) -> Curve:
        """Return intensities over the mean noise of levels against the sclera."""
        return level(self.snr_db + values_db)


TOLD_APART_DB = -3.0  # of a layer right below the sclera that no gap parts from it
GAP_ROWS = 2.0  # of a gap, at least: it can be seen
LENS_HALF_M = 4.6e-3
ALONG = np.linspace(0.0, 1.0, 12)  # the iris, from its root to the pupil
SIDES = (-1.0, 1.0)


def fill_inside(picture: Picture, wall: DrawnWall, rays: Rays, light: Light, inner: Curve) -> None:
    """Fill the inside of the eye.

    Args:
        picture: drawn into.
        wall: around it.
        rays: that look into it.
        light: levels and ranges.
        inner: the wall's lower boundary, rows (column,).
    """
    study, rng = light.study, light.rng
    if rng.random() < study.haze_share:
        picture.fill(inner, np.full(len(inner), np.inf), light.of(draw(study.haze_db, rng)), 0.0, light.stretch)
    uvea_m = _uvea(wall, light) if rng.random() < study.uvea_share else np.zeros(len(wall.arc_m))
    if wall.limbus is not None:
        _fill_iris_and_lens(picture, wall, wall.limbus, rays, light, inner, uvea_m)
    if uvea_m.any():
        _fill_uvea(picture, wall, rays, light, inner, uvea_m)


def _uvea(wall: DrawnWall, light: Light) -> Curve:
    """Return the thickness of ciliary body and choroid, (point,), m; they begin at the scleral spur."""
    study, rng = light.study, light.rng
    choroid_m, ciliary_m, length_m = (draw(v, rng) for v in (study.choroid_m, study.ciliary_m, study.ciliary_length_m))
    rise_m = draw(study.ciliary_rise_m, rng)
    if wall.limbus is None:
        return np.full(len(wall.arc_m), choroid_m)
    beyond_m = np.abs(wall.arc_m) - wall.limbus.spur_m
    falling = np.exp(-2.5 * np.maximum(beyond_m - rise_m, 0.0) / length_m)
    thickness: Curve = np.clip(beyond_m / rise_m, 0.0, 1.0) * (choroid_m + max(ciliary_m - choroid_m, 0.0) * falling)
    return thickness


def _fill_uvea(picture: Picture, wall: DrawnWall, rays: Rays, light: Light, inner: Curve, thickness_m: Curve) -> None:
    """Fill ciliary body and choroid; one as bright as the sclera is told from it by a dark gap."""
    study, rng = light.study, light.rng
    level_db, gap_m, gap_db = draw(study.uvea_db, rng), draw(study.gap_m, rng), draw(study.gap_db, rng)
    attenuation = draw(study.uvea_attenuation_per_m, rng)
    parted = rng.random() < study.gap_share
    bottom = _seen(wall, rays, wall.thickness_m + thickness_m)
    top = np.where(bottom > inner, inner, np.nan)
    picture.fill(
        top, bottom, light.of(level_db if parted else min(level_db, TOLD_APART_DB)), attenuation, light.stretch
    )
    if parted:
        gap = inner + max(gap_m * light.stretch / picture.window.pixel_m, GAP_ROWS)
        picture.fill(top, np.minimum(gap, bottom), light.of(gap_db), attenuation, light.stretch)


def _seen(wall: DrawnWall, rays: Rays, depth_m: Curve) -> Curve:
    """Return the row, (column,), at which what lies so deep below the surface is seen."""
    return rays.window.row(rays.apparent(heights(wall.offset(depth_m), rays.window)))


def _fill_iris_and_lens(
    picture: Picture, wall: DrawnWall, limbus: Limbus, rays: Rays, light: Light, inner: Curve, uvea_m: Curve
) -> None:
    """Fill the iris, which begins on the face of the ciliary body, and the lens behind it."""
    study, rng = light.study, light.rng
    root_arc_m = limbus.spur_m + draw(study.iris_root, rng) * draw(study.ciliary_rise_m, rng)
    deeper_m = draw(study.iris_depth_m, rng)
    roots = {side: _root(wall, side * root_arc_m, uvea_m) for side in SIDES if _reaches(wall, side * root_arc_m)}
    if not roots:
        return
    zero, below = wall.pose.place_points(np.array([[0.0, 0.0], [0.0, 1.0]]))
    plane_m = float(np.mean([(root - zero) @ (below - zero) for root in roots.values()])) + deeper_m
    if rng.random() < study.lens_share:
        _fill_lens(picture, wall, rays, light, inner, plane_m)
    if rng.random() < study.iris_share:
        _fill_iris(picture, wall, roots, rays, light, inner, plane_m)


def _reaches(wall: DrawnWall, arc_m: float) -> bool:
    return bool(wall.arc_m[0] < arc_m < wall.arc_m[-1])


def _root(wall: DrawnWall, arc_m: float, uvea_m: Curve) -> Points:
    """Return where the iris begins, (2,), m: below the wall, where the ciliary body ends."""
    face = wall.offset(wall.thickness_m + uvea_m)
    return np.array([np.interp(arc_m, wall.arc_m, face[:, axis]) for axis in (0, 1)])


def _fill_iris(
    picture: Picture,
    wall: DrawnWall,
    roots: dict[float, Points],
    rays: Rays,
    light: Light,
    inner: Curve,
    plane_m: float,
) -> None:
    """Fill both halves of the iris, from their roots (side: place in the frame) to the pupil."""
    study, rng = light.study, light.rng
    thick_m, bow_m, pupil_m = (draw(values, rng) for values in (study.iris_m, study.iris_bow_m, study.pupil_m))
    intensity, attenuation = light.of(draw(study.iris_db, rng)), draw(study.iris_attenuation_per_m, rng)
    bump_m = 0.15 * thick_m * np.sin(rng.uniform(4.0, 14.0) * ALONG + rng.uniform(0.0, 6.0))
    zero, below = wall.pose.place_points(np.array([[0.0, 0.0], [0.0, 1.0]]))
    upper_m, lower_m = bow_m * np.sin(np.pi * ALONG) + bump_m, thick_m * (1.0 - 0.5 * (1.0 - ALONG) ** 2)
    for side, root in roots.items():
        pupil = wall.pose.place_points(np.array([[side * pupil_m, plane_m]]))[0]
        upper = root + ALONG[:, None] * (pupil - root) + upper_m[:, None] * (below - zero)
        outline = np.concatenate([upper, (upper + lower_m[:, None] * (below - zero))[::-1]])
        top, bottom = _between(outline, rays, inner)
        picture.fill(top, bottom, intensity, attenuation, light.stretch)


def _fill_lens(picture: Picture, wall: DrawnWall, rays: Rays, light: Light, inner: Curve, plane_m: float) -> None:
    """Fill the lens, with the bright layer of its front capsule."""
    study, rng = light.study, light.rng
    radius_m, front_m = draw(study.lens_radius_m, rng), plane_m + draw(study.lens_depth_m, rng)
    lateral = np.linspace(-LENS_HALF_M, LENS_HALF_M, 40)
    front = front_m + radius_m - np.sqrt(radius_m**2 - lateral**2)
    back = front_m + 2.0 * (front[0] - front_m) + 2e-3 - (front - front_m)
    outline = np.concatenate([np.stack([lateral, front], 1), np.stack([lateral, back], 1)[::-1]])
    top, bottom = _between(wall.pose.place_points(outline), rays, inner)
    picture.fill(top, bottom, light.of(draw(study.lens_db, rng)), 0.1e3, light.stretch)
    capsule_rows = draw(study.capsule_m, rng) * light.stretch / picture.window.pixel_m
    turned = level(-20.0 * np.minimum(np.abs(rays.slope_rad), 1.0))  # its mirror reflection is lost at a slope
    picture.fill(
        top, np.minimum(top + capsule_rows, bottom), light.of(draw(study.capsule_db, rng)) * turned, 0.0, light.stretch
    )


def _between(outline: NDArray[np.float64], rays: Rays, inner: Curve) -> tuple[Curve, Curve]:
    """Return the rows between which a closed outline inside the wall is seen, (column,), NaN where it is not."""
    crossings = column_crossings(np.concatenate([outline, outline[:1]]), rays.window.grid_m).astype(np.float64)
    if len(crossings) < 2:
        nowhere = np.full(rays.window.columns, np.nan)
        return nowhere, nowhere
    edges = np.where(np.isfinite(crossings[:2]), crossings[:2], np.nan)
    top, bottom = (rays.window.row(rays.apparent(edge)) for edge in edges)
    return np.maximum(top, inner), bottom


COVERED_M = 1e-3  # along the surface from the limbus on: the conjunctiva thickens over that length
RIDGE_ROWS = 0.7  # half width of a mirror reflection
WALL_LAYERS = 10  # of even thickness, that the wall is drawn as
PROFILE_WAVES = 1.5  # of its brightness over its depth, at most


@dataclass(frozen=True)
class Tissue:
    """What is seen of a wall: rows of the drawing, (column,), NaN where there is none.

    `surface`: where light enters the tissue, the conjunctiva's surface or the wall's; `outer` and `inner`: of the wall.
    """

    rays: Rays
    surface: Curve
    outer: Curve
    inner: Curve
    refractive_index: float


def draw_tissue(study: SceneTissueStudy, wall: DrawnWall, picture: Picture, rng: np.random.Generator) -> Tissue:
    """Draw the tissue into an empty picture; return where the wall is."""
    window = picture.window
    index = 1.0 if rng.random() < study.corrected_share else draw(study.refractive_index, rng)
    light = Light(study=study, snr_db=draw(study.snr_db, rng), stretch=index, rng=rng)
    over_m = _conjunctiva(study, wall, rng)
    rays = rays_below(heights(wall.offset(-over_m), window), window, index)
    outer = window.row(rays.apparent(heights(wall.outer, window)))
    inner = window.row(rays.apparent(heights(wall.inner, window)))
    surface = window.row(rays.surface_m)
    fill_inside(picture, wall, rays, light, inner)
    _fill_wall(picture, wall, rays, light, outer, inner)
    if over_m.any():
        _fill_conjunctiva(picture, light, surface, outer)
    _roughen(picture, study, surface, rng)
    _reflect(picture, light, rays, surface)
    return Tissue(rays, surface, outer, inner, index)


def _conjunctiva(study: SceneTissueStudy, wall: DrawnWall, rng: np.random.Generator) -> Curve:
    """Return the thickness of the conjunctiva with Tenon's layer, (point,), m; 0 over the cornea, and in some eyes."""
    thickness_m = draw(study.conjunctiva_m, rng)
    if rng.random() >= study.conjunctiva_share:
        return np.zeros(len(wall.arc_m))
    covered = np.ones(len(wall.arc_m))
    if wall.limbus is not None:
        covered = np.clip((np.abs(wall.arc_m) - wall.limbus.arc_m) / COVERED_M, 0.0, 1.0)
    swell = 1.0 + 0.3 * np.sin(2.0 * np.pi * wall.arc_m / rng.uniform(1.5e-3, 6e-3) + rng.uniform(0.0, 6.0))
    layer: Curve = thickness_m * covered * swell
    return layer


def _fill_wall(picture: Picture, wall: DrawnWall, rays: Rays, light: Light, outer: Curve, inner: Curve) -> None:
    """Fill the wall, layer by layer: the cornea reaches below the sclera, or the sclera below the cornea.

    The cornea's backscatter falls with the angle of the light to its normal.
    """
    study, rng = light.study, light.rng
    fall_db = draw(study.angle_fall_db, rng) * (
        1.0 - np.exp(-((rays.slope_rad / draw(study.angle_width_rad, rng)) ** 2) / 2)
    )
    cornea_db = draw(study.cornea_db, rng) - fall_db
    waves, phase = rng.uniform(0.0, PROFILE_WAVES), rng.uniform(0.0, 2.0 * np.pi)
    profile_db, attenuation = draw(study.profile_db, rng), draw(study.attenuation_per_m, rng)
    edges = np.linspace(0.0, 1.0, WALL_LAYERS + 1)
    for above, below in pairwise(edges):
        share = float(above + below) / 2
        level_db = _cornea(wall, rays, share, outer, inner) * cornea_db
        level_db = level_db + profile_db * np.sin(2.0 * np.pi * waves * share + phase)
        top, bottom = outer + above * (inner - outer), outer + below * (inner - outer)
        picture.fill(top, bottom, light.of(level_db), attenuation, light.stretch)
    for _ in range(int(draw(study.scar_count, rng))):
        _scar(picture, light, outer, inner)
    if wall.limbus is not None:
        _fill_faces(picture, wall, rays, light, outer, inner, cornea_db)


def _cornea(wall: DrawnWall, rays: Rays, share: float, outer: Curve, inner: Curve) -> Curve:
    """Return how far the light at a share of the wall's depth is the cornea's (1) or the sclera's (0), (column,)."""
    if wall.limbus is None:
        return np.zeros(len(outer))
    depth_m = np.nan_to_num(share * (inner - outer)) * rays.window.pixel_m / rays.stretch
    return wall.limbus.cornea(rays.seen_at(_on_grid(wall.arc_m, wall, rays.window), depth_m), share)


def _fill_faces(
    picture: Picture, wall: DrawnWall, rays: Rays, light: Light, outer: Curve, inner: Curve, cornea_db: Curve
) -> None:
    """Draw the cornea's two faces: its epithelium, and the mirror reflection of its inner boundary."""
    study, rng = light.study, light.rng
    cornea = _cornea(wall, rays, 0.0, outer, inner)
    rows = draw(study.epithelium_m, rng) * rays.stretch / picture.window.pixel_m
    epithelium = np.where(cornea > 0.5, outer, np.nan)
    gain = 10.0 ** (draw(study.epithelium_db, rng) * cornea / 10.0)
    picture.brighten(epithelium, np.minimum(outer + rows, inner), gain)
    facing = np.exp(-((rays.slope_rad / draw(study.reflection_angle_rad, rng)) ** 2))
    cornea = _cornea(wall, rays, 1.0, outer, inner)
    intensity = light.of(cornea * cornea_db + draw(study.boundary_db, rng)) * facing * cornea
    picture.ridges.append(Ridge(inner, intensity, RIDGE_ROWS))


def _scar(picture: Picture, light: Light, outer: Curve, inner: Curve) -> None:
    """Draw a spot in the wall, dark or bright, and the shadow that it casts."""
    study, rng, window = light.study, light.rng, picture.window
    half_m, half_rows = draw(study.scar_m, rng), draw(study.scar_height_m, rng) * light.stretch / window.pixel_m
    share, across = rng.random(), (window.lateral_m - rng.uniform(*window.lateral_m[[0, -1]])) / half_m
    middle = outer + share * (inner - outer)
    near = np.exp(-(across**2) - ((picture.rows - middle) / half_rows) ** 2)
    gain = np.exp(draw(study.scar_db, rng) * np.log(10.0) / 10.0 * near)
    picture.brighten(outer, inner, gain)
    loss = draw(study.scar_loss_fraction, rng) * np.exp(-(across**2))
    picture.shade(middle, np.where(np.isfinite(middle), 1.0 - loss, 1.0))


def _fill_conjunctiva(picture: Picture, light: Light, surface: Curve, outer: Curve) -> None:
    """Fill what lies over the wall: the conjunctiva, and Tenon's layer as its lower part."""
    study, rng = light.study, light.rng
    middle = outer - draw(study.tenon_share, rng) * (outer - surface)
    attenuation = draw(study.attenuation_per_m, rng)
    picture.fill(surface, middle, light.of(draw(study.conjunctiva_db, rng)), attenuation, light.stretch)
    picture.fill(middle, outer, light.of(draw(study.tenon_db, rng)), attenuation, light.stretch)


def _roughen(picture: Picture, study: SceneTissueStudy, surface: Curve, rng: np.random.Generator) -> None:
    """Give the tissue a texture of long grains along its surface."""
    window, shape = picture.window, picture.scatter.shape
    across = max(3, round(window.width_m / draw(study.texture_length_m, rng)))
    down = max(3, round(shape[0] * window.pixel_m / draw(study.texture_height_m, rng)))
    grains = rng.standard_normal((min(down, shape[0]), min(across, shape[1])), dtype=np.float32)
    smooth = cv2.resize(grains, shape[::-1], interpolation=cv2.INTER_LINEAR)
    shift = np.nan_to_num(surface - np.nanmean(surface) if np.isfinite(surface).any() else surface, nan=0.0)
    map_row = (picture.rows - shift.astype(np.float32)).astype(np.float32)
    map_column = np.broadcast_to(np.arange(shape[1], dtype=np.float32), shape)
    along = cv2.remap(smooth, map_column, map_row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    strength = np.float32(draw(study.texture_db, rng) * np.log(10.0) / 10.0)
    picture.scatter[...] *= np.exp(strength * along)


def _reflect(picture: Picture, light: Light, rays: Rays, surface: Curve) -> None:
    """Add the mirror reflection of the tissue's first surface."""
    study, rng = light.study, light.rng
    facing = np.exp(-((rays.slope_rad / draw(study.reflection_angle_rad, rng)) ** 2))
    picture.ridges.append(Ridge(surface, light.of(draw(study.reflection_db, rng)) * facing, RIDGE_ROWS))


def _on_grid(values: Curve, wall: DrawnWall, window: Window) -> Curve:
    """Return what is told of the meridian's points at `window.grid_m`."""
    at: Curve = np.interp(window.grid_m, np.maximum.accumulate(wall.outer[:, 0]), values)
    return at
