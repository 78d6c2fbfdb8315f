"""The frame of a scene and the wall in it: a meridian that bends as cornea and sclera
do, its dents, its pose.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import cumulative_trapezoid

from scleraforce.base.arrays import Floats
from scleraforce.lab.tissue_light import Pose, drawn_record
from scleraforce.records.study import SceneEyeStudy, SceneWindowStudy, draw

# share of the frame's rows drawn above the zero delay, and mirrored from there
ABOVE_SHARE = 0.25
BEYOND_SHARE = 0.35  # of the frame's width that curves are known beyond it
GRID_POINTS = 512  # points of their grid


@dataclass(frozen=True, kw_only=True)
class Window:
    """A frame and `above` more rows over it; laterals are from the frame's middle,
    depths from its top edge, m.
    """

    rows: int
    columns: int
    above: int
    width_m: float
    depth_m: float

    @property
    def pixel_m(self) -> float:
        """Size of a pixel along the depth, m."""
        return self.depth_m / self.rows

    @property
    def step_m(self) -> float:
        """Size of a pixel across, m."""
        return self.width_m / self.columns

    @cached_property
    def lateral_m(self) -> Floats:
        """Lateral position of each column, m."""
        column = np.arange(self.columns, dtype=np.float64)
        return (column + 0.5) * self.step_m - self.width_m / 2

    @cached_property
    def grid_m(self) -> Floats:
        """Evenly spaced lateral positions of stored curves, m; they reach beyond the
        frame.
        """
        half_m = self.width_m * (0.5 + BEYOND_SHARE)
        return np.linspace(-half_m, half_m, GRID_POINTS)

    def row(self, depth_m: Floats) -> Floats:
        """Return depths as rows of the drawing, those above the frame included; pixel r
        covers r to r + 1.
        """
        return depth_m / self.pixel_m + self.above


def draw_window(study: SceneWindowStudy, rng: np.random.Generator) -> Window:
    """Draw a frame's size and pixels; the logarithm of its depth's share of its width
    is even.
    """
    width_m = draw(study.width_m, rng)
    least, most = study.depth_share.bounds
    depth_m = width_m * float(np.exp(rng.uniform(np.log(least), np.log(most))))
    finest_m, coarsest_m = study.pixel_m.bounds
    rows = round(
        min(max(draw(study.rows, rng), depth_m / coarsest_m), depth_m / finest_m)
    )
    columns = round(draw(study.columns, rng))
    above = round(ABOVE_SHARE * rows)

    return Window(
        rows=rows, columns=columns, above=above, width_m=width_m, depth_m=depth_m
    )


# distance of the meridian's points, and its reach to each side
STEP_M = 0.05e-3
REACH_M = 18e-3
MAX_SLOPE_RAD = 1.15  # of the surface in the frame: where it is steeper the wall ends
WAVES = 3
SPUR_M = 0.2e-3  # half width of the scleral spur along the surface
# depth of a dent over its width, at most: its side slopes by 50 degrees
STEEPEST_DENT = 2.0
CENTRED_SHARE = 0.1  # of the range of places: a view of the apex


@dataclass(frozen=True, kw_only=True)
class Limbus:
    """The border of cornea and sclera, along the surface from the apex; `[scenes.eye]`
    explains its lengths.
    """

    arc_m: float
    width_m: float
    edge_m: float
    slant_m: float
    wedge_m: float
    spur_m: float
    spur_bump_m: float

    def shape(self, arc_m: Floats) -> Floats:
        """Return the part of the cornea (1; 0: of the sclera) in the wall's shape."""
        return _falling(np.abs(arc_m) - self.arc_m, self.width_m)

    def cornea(self, arc_m: Floats, share: float) -> Floats:
        """Return the part of the cornea (1; 0: of the sclera) in the light at a share
        of the wall's depth.
        """
        reach_m = self.slant_m * (share - 0.5) + self.wedge_m * (
            1.0 - abs(2.0 * share - 1.0)
        )
        return _falling(np.abs(arc_m) - self.arc_m - reach_m, self.edge_m)

    def spur(self, arc_m: Floats) -> Floats:
        """Return the thickness that the scleral spur adds, m."""
        return self.spur_bump_m * np.exp(
            -(((np.abs(arc_m) - self.spur_m) / SPUR_M) ** 2)
        )


@dataclass(frozen=True)
class DrawnWall:
    """A wall in the frame: its meridian's points (point,), from left to right."""

    outer: Floats
    normal: Floats  # unit vectors into the eye
    thickness_m: Floats
    arc_m: Floats  # along the surface from the apex
    pose: (
        Pose  # from the eye, the apex of the undeformed surface at (0, 0), to the frame
    )
    limbus: Limbus | None
    dent_m: float | None  # lateral place of a dent

    def offset(self, depth_m: Floats) -> Floats:
        """Return the curve at depths below the surface along its normal, (point, 2),
        m.
        """
        return self.outer + depth_m[:, None] * self.normal


def draw_scene_wall(
    eye: SceneEyeStudy,
    looked_at: SceneWindowStudy,
    window: Window,
    rng: np.random.Generator,
) -> DrawnWall:
    """Draw a wall and its pose in a frame."""
    arc_m = np.arange(-REACH_M, REACH_M + STEP_M / 2, STEP_M)
    limbus = _limbus(eye, rng)
    cornea = np.zeros(len(arc_m)) if limbus is None else limbus.shape(arc_m)
    slope = _slope(eye, arc_m, cornea, limbus, rng)
    cornea_m, sclera_m, ratio = (
        draw(values, rng)
        for values in (eye.cornea_thickness_m, eye.sclera_thickness_m, eye.sclera_ratio)
    )
    thickness_m = cornea * cornea_m + (1.0 - cornea) * (
        sclera_m if limbus is None else ratio * cornea_m
    )
    wave_m = draw(eye.wave_m, rng) * _waves(eye, arc_m, rng)
    thickness_m = np.maximum(thickness_m + wave_m / 2, 0.5 * thickness_m)
    thickness_m += 0.0 if limbus is None else limbus.spur(arc_m)
    view_m = draw(looked_at.view_m, rng) * (
        CENTRED_SHARE if rng.random() < looked_at.centred_share else 1.0
    )
    at = int(np.abs(arc_m - view_m).argmin())
    along = np.stack([np.cos(slope), np.sin(slope)], axis=1)
    points = cumulative_trapezoid(along, dx=STEP_M, axis=0, initial=0)
    outer = (
        points
        - points[len(points) // 2]
        - wave_m[:, None] * np.stack([-along[:, 1], along[:, 0]], axis=1)
    )
    dent_arc_m, outer = _dented(eye, outer, slope, arc_m, view_m, rng)
    turn_rad = draw(looked_at.tilt_rad, rng) - draw(looked_at.facing, rng) * slope[at]
    pose = _pose(outer, at, turn_rad, draw(looked_at.surface_share, rng), window)
    placed = pose.place_points(outer)
    kept = _seen_from_above(placed)
    tangent = np.gradient(placed[kept], axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    dent_m = (
        None
        if dent_arc_m is None
        else float(np.interp(dent_arc_m, arc_m[kept], placed[kept, 0]))
    )
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)

    return DrawnWall(
        placed[kept], normal, thickness_m[kept], arc_m[kept], pose, limbus, dent_m
    )


def _limbus(eye: SceneEyeStudy, rng: np.random.Generator) -> Limbus | None:
    """Draw the limbus; None: the eye has no cornea."""
    arc_m = draw(eye.limbus_m, rng)
    spur = {
        "spur_m": lambda: arc_m + draw(eye.spur_m, rng),
        "spur_bump_m": lambda: draw(eye.spur_bump_m, rng),
    }
    limbus = drawn_record(Limbus, eye, rng, "limbus_", arc_m=arc_m, **spur)

    return None if rng.random() < eye.half_sphere_share else limbus


def _falling(beyond_m: Floats, width_m: float) -> Floats:
    """Return a curve that falls from 1 to 0 over a width, about 0."""
    return 1.0 / (1.0 + np.exp(np.clip(beyond_m / (width_m / 4), -50.0, 50.0)))


def _slope(
    eye: SceneEyeStudy,
    arc_m: Floats,
    cornea: Floats,
    limbus: Limbus | None,
    rng: np.random.Generator,
) -> Floats:
    """Return the angle of the meridian against the lateral axis: the integral of its
    curvature, and the sulcus.
    """
    radius_m = draw(eye.cornea_radius_m, rng)
    sclera_m = draw(eye.sclera_radius_m, rng)
    slope = np.cumsum(cornea / radius_m + (1.0 - cornea) / sclera_m) * STEP_M
    slope -= np.interp(0.0, arc_m, slope)
    sulcus_rad = 0.0 if limbus is None else draw(eye.sulcus_rad, rng)
    return slope - sulcus_rad * np.sign(arc_m) * (1.0 - cornea)


def _waves(eye: SceneEyeStudy, arc_m: Floats, rng: np.random.Generator) -> Floats:
    length_m = draw(eye.wave_length_m, rng) * rng.uniform(0.6, 1.6, WAVES)
    phase = rng.uniform(0.0, 2.0 * np.pi, WAVES)
    return np.sin(2.0 * np.pi * arc_m[:, None] / length_m + phase).mean(axis=1)


def _dented(
    eye: SceneEyeStudy,
    outer: Floats,
    slope: Floats,
    arc_m: Floats,
    view_m: float,
    rng: np.random.Generator,
) -> tuple[float | None, Floats]:
    """Push a needle into the meridian, near the middle of the view; return the dent's
    arc and the meridian.
    """
    if rng.random() >= eye.dent_share:
        return None, outer

    width_m = draw(eye.dent_width_m, rng)
    centre_m = view_m + rng.normal(0.0, width_m)
    off = (arc_m - centre_m) / width_m
    rim = draw(eye.dent_rim, rng) * np.exp(-(((np.abs(off) - 2.5) / 0.8) ** 2))
    depth_m = min(draw(eye.dent_depth_m, rng), STEEPEST_DENT * width_m)
    push = depth_m * (np.exp(-(off**2) / 2) - rim)
    direction = np.interp(centre_m, arc_m, slope)

    return centre_m, outer + push[:, None] * np.array(
        [-np.sin(direction), np.cos(direction)]
    )


def _pose(
    outer: Floats, at: int, turn_rad: float, surface_share: float, window: Window
) -> Pose:
    """Return the pose that puts the point of the view in the middle and the surface at
    its depth.
    """
    turned = Pose(lateral_m=0.0, depth_m=0.0, tilt_rad=turn_rad).place_points(outer)
    lateral_m = -float(turned[at, 0])
    inside = np.abs(turned[:, 0] + lateral_m) < window.width_m / 2
    highest_m = float(turned[inside, 1].min())

    return Pose(
        lateral_m=lateral_m,
        depth_m=surface_share * window.depth_m - highest_m,
        tilt_rad=turn_rad,
    )


def _seen_from_above(placed: Floats) -> slice:
    """Return the points around the frame's middle up to where the surface is too
    steep.
    """
    step = np.diff(placed, axis=0)
    steep = np.arctan2(np.abs(step[:, 1]), step[:, 0]) > MAX_SLOPE_RAD
    middle = int(np.abs(placed[:, 0]).argmin())
    left = np.flatnonzero(steep[:middle])
    right = np.flatnonzero(steep[middle:])
    first = int(left[-1]) + 1 if len(left) else 0
    last = middle + int(right[0]) if len(right) else len(placed) - 1

    return slice(first, max(last, first + 2) + 1)
