"""What lies inside of a scene's wall: ciliary body and choroid, the iris from its root on, the lens, and haze."""

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.bscan import column_crossings
from scleraforce.laboratory.scenes.light import Light
from scleraforce.laboratory.scenes.picture import Picture, level
from scleraforce.laboratory.scenes.rays import Rays, heights
from scleraforce.laboratory.scenes.wall import DrawnWall, Limbus, Points
from scleraforce.laboratory.scenes.window import Curve
from scleraforce.study import draw

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
