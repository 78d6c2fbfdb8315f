"""The tissue of a scene: conjunctiva, wall, uvea, iris and lens, as light meets them below the surface."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.bscan import column_crossings
from scleraforce.laboratory.scenes.picture import Picture, Ridge, level
from scleraforce.laboratory.scenes.rays import Rays, heights, rays_below
from scleraforce.laboratory.scenes.wall import DrawnWall
from scleraforce.laboratory.scenes.window import Curve, Window
from scleraforce.study import SceneTissueStudy, draw

__all__ = ["Tissue", "draw_tissue"]

COVERED_M = 1e-3  # along the surface from the limbus on: the conjunctiva thickens over that length
RIDGE_ROWS = 0.7  # half width of a mirror reflection
IRIS_POINTS = np.linspace(0.0, 1.0, 12)
IRIS_END_M = 0.8e-3  # beyond the limbus' inner side: the root
LENS_HALF_M = 4.6e-3


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


@dataclass(frozen=True, kw_only=True)
class _Light:
    """Levels of a scene's tissue."""

    study: SceneTissueStudy
    snr_db: float
    stretch: float
    rng: np.random.Generator

    def of(self, values_db: float | Curve) -> Curve:
        return level(self.snr_db + values_db)


def draw_tissue(study: SceneTissueStudy, wall: DrawnWall, picture: Picture, rng: np.random.Generator) -> Tissue:
    """Draw the tissue into an empty picture; return where the wall is."""
    window = picture.window
    index = 1.0 if rng.random() < study.corrected_share else draw(study.refractive_index, rng)
    light = _Light(study=study, snr_db=draw(study.snr_db, rng), stretch=index, rng=rng)
    over_m = _conjunctiva(study, wall, rng)
    rays = rays_below(heights(wall.offset(-over_m), window), window, index)
    outer = window.row(rays.apparent(heights(wall.outer, window)))
    inner = window.row(rays.apparent(heights(wall.inner, window)))
    surface = window.row(rays.surface_m)
    _below_wall(picture, wall, rays, light, inner)
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
    beyond_m = np.abs(wall.arc_m) - (wall.limbus_m or 0.0)
    covered = np.ones(len(wall.arc_m)) if wall.limbus_m is None else np.clip(beyond_m / COVERED_M, 0.0, 1.0)
    swell = 1.0 + 0.3 * np.sin(2.0 * np.pi * wall.arc_m / rng.uniform(1.5e-3, 6e-3) + rng.uniform(0.0, 6.0))
    layer: Curve = thickness_m * covered * swell
    return layer


def _below_wall(picture: Picture, wall: DrawnWall, rays: Rays, light: _Light, inner: Curve) -> None:
    """Fill the inside of the eye: haze, lens, iris, and the uvea below the sclera."""
    study, rng, everywhere = light.study, light.rng, np.full(len(inner), np.inf)
    if rng.random() < study.haze_share:
        picture.fill(inner, everywhere, light.of(draw(study.haze_db, rng)), 0.0, light.stretch)
    if wall.limbus_m is not None:
        pupil_m = draw(study.pupil_m, rng)
        plane_m = draw(study.iris_depth_m, rng) + float(np.interp(0.0, wall.arc_m, wall.thickness_m))
        if rng.random() < study.lens_share:
            _fill_lens(picture, wall, rays, light, inner, plane_m)
        if rng.random() < study.iris_share:
            _fill_iris(picture, wall, rays, light, inner, plane_m, pupil_m)
    if rng.random() < study.uvea_share:
        bottom = picture.window.row(
            rays.apparent(heights(wall.offset(wall.thickness_m + _uvea(wall, light)), rays.window))
        )
        sclera = rays.seen_at(1.0 - _on_grid(wall.cornea, wall, rays.window), 0.0) > 0.5
        attenuation = draw(study.uvea_attenuation_per_m, rng)
        picture.fill(
            np.where(sclera, inner, np.nan), bottom, light.of(draw(study.uvea_db, rng)), attenuation, light.stretch
        )


def _uvea(wall: DrawnWall, light: _Light) -> Curve:
    """Return the thickness of ciliary body and choroid, (point,), m."""
    study, rng = light.study, light.rng
    choroid_m, ciliary_m, length_m = (draw(v, rng) for v in (study.choroid_m, study.ciliary_m, study.ciliary_length_m))
    if wall.limbus_m is None:
        return np.full(len(wall.arc_m), choroid_m)
    beyond = (np.abs(wall.arc_m) - wall.limbus_m) / length_m
    thickness: Curve = choroid_m + max(ciliary_m - choroid_m, 0.0) * np.exp(-np.maximum(beyond, 0.0) * 2.5)
    return thickness


def _fill_iris(
    picture: Picture, wall: DrawnWall, rays: Rays, light: _Light, inner: Curve, plane_m: float, pupil_m: float
) -> None:
    """Fill both halves of the iris, from its root at the wall to the pupil."""
    study, rng = light.study, light.rng
    thick_m, bow_m = draw(study.iris_m, rng), draw(study.iris_bow_m, rng)
    intensity, attenuation = light.of(draw(study.iris_db, rng)), draw(study.iris_attenuation_per_m, rng)
    root_m = (wall.limbus_m or 0.0) + IRIS_END_M
    bump_m = 0.15 * thick_m * np.sin(rng.uniform(4.0, 14.0) * IRIS_POINTS + rng.uniform(0.0, 6.0))
    for side in (-1.0, 1.0):
        lateral = side * (root_m + (pupil_m - root_m) * IRIS_POINTS)
        upper = plane_m + bow_m * np.sin(np.pi * IRIS_POINTS / 2) + bump_m
        lower = upper + thick_m * (1.0 - 0.5 * (1.0 - IRIS_POINTS) ** 2)
        outline = np.concatenate([np.stack([lateral, upper], 1), np.stack([lateral, lower], 1)[::-1]])
        top, bottom = _between(wall.pose.place_points(outline), rays, inner)
        picture.fill(top, bottom, intensity, attenuation, light.stretch)


def _fill_lens(picture: Picture, wall: DrawnWall, rays: Rays, light: _Light, inner: Curve, plane_m: float) -> None:
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


def _fill_wall(picture: Picture, wall: DrawnWall, rays: Rays, light: _Light, outer: Curve, inner: Curve) -> None:
    """Fill the wall; the cornea's backscatter falls with the angle of the light to its normal."""
    study, rng = light.study, light.rng
    cornea = rays.seen_at(_on_grid(wall.cornea, wall, rays.window), 0.0)
    fall_db = draw(study.angle_fall_db, rng) * (
        1.0 - np.exp(-((rays.slope_rad / draw(study.angle_width_rad, rng)) ** 2) / 2)
    )
    relative_db = cornea * (draw(study.cornea_db, rng) - fall_db)
    picture.fill(outer, inner, light.of(relative_db), draw(study.attenuation_per_m, rng), light.stretch)
    if wall.limbus_m is not None:
        facing = np.exp(-((rays.slope_rad / draw(study.reflection_angle_rad, rng)) ** 2))
        intensity = light.of(relative_db + draw(study.boundary_db, rng)) * facing * cornea
        picture.ridges.append(Ridge(inner, intensity, RIDGE_ROWS))


def _fill_conjunctiva(picture: Picture, light: _Light, surface: Curve, outer: Curve) -> None:
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


def _reflect(picture: Picture, light: _Light, rays: Rays, surface: Curve) -> None:
    """Add the mirror reflection of the tissue's first surface."""
    study, rng = light.study, light.rng
    facing = np.exp(-((rays.slope_rad / draw(study.reflection_angle_rad, rng)) ** 2))
    picture.ridges.append(Ridge(surface, light.of(draw(study.reflection_db, rng)) * facing, RIDGE_ROWS))


def _on_grid(values: Curve, wall: DrawnWall, window: Window) -> Curve:
    """Return what is told of the meridian's points at `window.grid_m`."""
    at: Curve = np.interp(window.grid_m, np.maximum.accumulate(wall.outer[:, 0]), values)
    return at
