"""The tissue of a scene: conjunctiva and wall, as light meets them below the surface, and what lies inside."""

from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from scleraforce.laboratory.scenes.inside import fill_inside
from scleraforce.laboratory.scenes.light import Light
from scleraforce.laboratory.scenes.picture import Picture, Ridge
from scleraforce.laboratory.scenes.rays import Rays, heights, rays_below
from scleraforce.laboratory.scenes.wall import DrawnWall
from scleraforce.laboratory.scenes.window import Curve, Window
from scleraforce.study import SceneTissueStudy, draw

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
