"""Things over the tissue of a scene: contact lens, glass, drape, lids, bubbles, a needle; vessels, air and shadows."""

from functools import partial
from math import cos, sin

import numpy as np

from scleraforce.arrays import Floats
from scleraforce.laboratory.light import Shadow, ratios, transmission
from scleraforce.laboratory.scene_tissue import Ridge, Tissue, outline_depths
from scleraforce.study import SceneOverStudy, draw

OPAQUE_PER_M = 40e3  # attenuation of metal
LINE_ROWS = (0.5, 1.4)  # half widths of bright curves
NEEDLE_LENGTH_M = 20e-3
HAZY_SHARE, HAZE_DB = 0.3, 20.0  # of the contact lenses; below their faces' light
AIR_PASS = 0.02  # share of the light that gets through air between wet surfaces


class _Over:
    """The drawing that things over the tissue are added to."""

    def __init__(self, study: SceneOverStudy, tissue: Tissue) -> None:
        self.study, self.tissue, self.picture, self.rng = study, tissue, tissue.picture, tissue.rng
        self.lateral_m, self.surface_m = tissue.rays.window.lateral_m, tissue.rays.surface_m

    def row(self, depth_m: Floats) -> Floats:
        return self.picture.window.row(depth_m)

    def place(self) -> float:
        """Return a random place across the frame, m."""
        return float(self.rng.uniform(self.lateral_m[0], self.lateral_m[-1]))

    def from_side(self, left: bool) -> Floats:
        """Return the distance of columns from the frame's left or right edge, m."""
        half_m = self.picture.window.width_m / 2
        return self.lateral_m + half_m if left else half_m - self.lateral_m

    def line(self, depth_m: Floats, level_db: float | Floats) -> None:
        """Add a thin bright curve."""
        bright = np.broadcast_to(ratios(level_db), depth_m.shape)
        self.picture.ridges.append(Ridge(self.row(depth_m), bright, self.rng.uniform(*LINE_ROWS)))

    def body(self, top_m: Floats, bottom_m: Floats, level_db: float, attenuation_per_m: float) -> None:
        """Replace the picture between two curves."""
        self.picture.fill(self.row(top_m), self.row(bottom_m), ratios(level_db), attenuation_per_m, 1.0)

    def cover(self, top_m: Floats, bottom_m: Floats, level_db: float, attenuation_per_m: float) -> None:
        """Draw a body over the eye that may hide the wall."""
        self.body(top_m, bottom_m, level_db, attenuation_per_m)
        self.picture.covered[np.isfinite(top_m)] = True


def draw_over(study: SceneOverStudy, tissue: Tissue) -> None:
    """Draw things over the tissue and vessels in it; a needle is put into the wall's dent if it has one."""
    rng, dent_m, over = tissue.rng, tissue.wall.dent_m, _Over(study, tissue)
    _vessels(over)
    for share, thing in (
        (study.contact_lens_share, _contact_lens), (study.coverslip_share, _coverslip), (study.drape_share, _drape),
        (study.lid_share, partial(_lid, left=True)), (study.lid_share, partial(_lid, left=False)),
    ):  # fmt: skip
        if rng.random() < share:
            thing(over)
    for _ in range(int(draw(study.bubble_count, rng))):
        _bubble(over)
    if rng.random() < study.needle_share:
        _needle(over, over.place() if dent_m is None else dent_m)


def _vessels(over: _Over) -> None:
    """Take light from columns below vessels, which lie in the upper part of the wall, and below air on it."""
    study, tissue, rng = over.study, over.tissue, over.rng
    for _ in range(int(draw(study.vessel_count, rng))):
        middle_m, width_m, loss = over.place(), draw(study.vessel_m, rng), draw(study.vessel_loss_fraction, rng)
        shadow = Shadow(centre_m=middle_m, width_m=width_m, loss_fraction=loss)
        depth = rng.uniform(0.0, 0.6) * (tissue.inner - tissue.surface)
        passed = transmission([shadow], over.lateral_m).astype(np.float64)
        over.picture.shade(tissue.surface + np.nan_to_num(depth), passed)
    if rng.random() < study.air_share:
        air = Shadow(centre_m=over.place(), width_m=draw(study.air_m, rng), loss_fraction=1.0 - AIR_PASS)
        over.picture.shade(tissue.surface, transmission([air], over.lateral_m).astype(np.float64))


def _smooth_surface(over: _Over) -> Floats:
    """Return the parabola above the surface, at all columns, m."""
    there = np.isfinite(over.surface_m)
    if np.count_nonzero(there) < 3:
        return np.full(len(over.lateral_m), np.nan)
    smooth = np.polyval(np.polyfit(over.lateral_m[there], over.surface_m[there], 2), over.lateral_m)
    return np.asarray(smooth - max(float((smooth - over.surface_m)[there].max()), 0.0), dtype=np.float64)


def _contact_lens(over: _Over) -> None:
    """Draw a lens over the eye, two lines that meet at its edge, the haze in it, and what floats below it."""
    study, rng = over.study, over.rng
    middle_m, reach_m = over.place(), draw(study.lens_reach_m, rng)
    off = (over.lateral_m - middle_m) / reach_m
    tapered = np.sqrt(np.clip(1.0 - off**2, 0.0, None))
    back_m = _smooth_surface(over) - draw(study.lens_gap_m, rng) * tapered
    deepest_m = np.where(np.isfinite(over.surface_m), over.surface_m, np.inf)
    back_m = np.where(np.abs(off) < 1.0, np.minimum(back_m, deepest_m), np.nan)
    front_m = back_m - draw(study.lens_m, rng) * np.minimum(2.0 * tapered, 1.0)
    bright_db = draw(study.lens_db, rng) - 12.0 * np.clip(np.abs(over.tissue.rays.slope_rad), 0.0, 1.0)
    if rng.random() < HAZY_SHARE:
        over.body(front_m, back_m, draw(study.lens_db, rng) - HAZE_DB, 0.0)
    over.line(front_m, np.nan_to_num(bright_db, nan=0.0))
    over.line(back_m, np.nan_to_num(bright_db - rng.uniform(0.0, 10.0), nan=0.0))
    _specks(over, back_m)


def _specks(over: _Over, top_m: Floats) -> None:
    count = int(draw(over.study.speck_count, over.rng))
    column = over.rng.integers(0, len(top_m), count)
    depth_m = top_m[column] + over.rng.random(count) * (over.surface_m - top_m)[column]
    row = np.nan_to_num(over.row(depth_m), nan=-1.0, posinf=-1.0, neginf=-1.0).astype(np.intp)
    inside = (row >= 0) & (row < len(over.picture.scatter))
    bright = ratios(draw(over.study.speck_db, over.rng) - 6.0 * over.rng.random(count))
    over.picture.scatter[row[inside], column[inside]] = bright[inside]


def _coverslip(over: _Over) -> None:
    study, rng = over.study, over.rng
    if not np.isfinite(over.surface_m).any():
        return
    plane = np.tan(draw(study.coverslip_tilt_rad, rng)) * over.lateral_m
    lower = plane + float(np.nanmin(over.surface_m - plane)) - draw(study.coverslip_height_m, rng)
    bright_db = draw(study.coverslip_db, rng)
    over.line(lower, bright_db)
    over.line(lower - draw(study.coverslip_m, rng), bright_db)


def _drape(over: _Over) -> None:
    """Draw a sheet that covers the tissue from one side of the frame on."""
    study, rng, window = over.study, over.rng, over.picture.window
    reach_m = draw(study.drape_reach, rng) * window.width_m
    from_side = over.from_side(left=rng.random() < 0.5)
    folds_m = rng.uniform(0.0, 60e-6) * np.sin(over.lateral_m / rng.uniform(0.1e-3, 0.5e-3))
    thick_m = draw(study.drape_m, rng)
    top_m = np.where(from_side < reach_m, over.surface_m - thick_m - np.abs(folds_m) - rng.uniform(0.0, 0.2e-3), np.nan)
    over.cover(top_m, top_m + thick_m, draw(study.drape_db, rng), draw(study.drape_attenuation_per_m, rng))


def _lid(over: _Over, left: bool) -> None:
    """Draw a lid that comes in from one side above the eye, with its rounded edge, and lashes below it."""
    study, rng, window = over.study, over.rng, over.picture.window
    from_side = over.from_side(left)
    reach_m, thick_m = draw(study.lid_reach, rng) * window.width_m, draw(study.lid_m, rng)
    inwards = np.clip(from_side / reach_m, 0.0, 1.0)
    bottom_m = np.where(inwards < 1.0, _smooth_surface(over) - draw(study.lid_gap_m, rng) * inwards, np.nan)
    top_m = bottom_m - thick_m * np.sqrt(np.clip(1.0 - inwards**2, 0.0, None))
    over.cover(top_m, bottom_m, draw(study.lid_db, rng), draw(study.lid_attenuation_per_m, rng))
    for _ in range(int(draw(study.lash_count, rng))):
        _lash(over, (-1.0 if left else 1.0) * (window.width_m / 2 - reach_m * rng.uniform(0.5, 1.6)))


def _lash(over: _Over, lateral_m: float) -> None:
    """Draw a lash across the plane or along it: a bright short line with a shadow."""
    rng, half_m = over.rng, draw(over.study.lash_m, over.rng) * over.rng.choice([0.5, 6.0])
    off = over.lateral_m - lateral_m
    if not np.isfinite(over.surface_m).any():
        return
    depth_m = float(np.nanmin(over.surface_m)) - rng.uniform(0.1e-3, 1.5e-3) + rng.uniform(-1.0, 1.0) * off
    depth_m = np.where(np.abs(off) < half_m, depth_m, np.nan)
    over.line(depth_m, draw(over.study.lid_db, rng))
    over.picture.shade(over.row(depth_m), np.where(np.abs(off) < half_m, rng.uniform(0.05, 0.6), 1.0))


def _bubble(over: _Over) -> None:
    """Draw a bubble over the surface: its bright upper and lower side, and its shadow."""
    study, rng = over.study, over.rng
    radius_m, off = draw(study.bubble_m, rng), over.lateral_m - over.place()
    half_m = np.sqrt(np.maximum(radius_m**2 - off**2, 0.0))
    inside = np.abs(off) < radius_m
    rests_m = np.interp(over.lateral_m[np.abs(off).argmin()], over.lateral_m, over.surface_m)
    middle_m = rests_m - radius_m * rng.uniform(0.6, 1.6)
    bright_db = draw(study.bubble_db, rng)
    for side in (-1.0, 1.0):
        over.line(np.where(inside, middle_m + side * half_m, np.nan), bright_db)
    passed = np.where(inside, np.clip(1.0 - (half_m / radius_m) * rng.uniform(0.3, 0.98), 0.02, 1.0), 1.0)
    over.picture.shade(np.where(np.isfinite(middle_m + half_m), over.row(middle_m + half_m), 0.0), passed)


def _needle(over: _Over, tip_m: float) -> None:
    """Draw a needle in the plane: the bright upper edge of its shaft; metal lets no light through, glass some."""
    study, rng = over.study, over.rng
    angle, half_m = draw(study.needle_angle_rad, rng), draw(study.needle_m, rng) / 2
    tip_depth_m = float(np.interp(tip_m, over.lateral_m, over.surface_m)) - draw(study.tip_gap_m, rng)
    along, across = np.array([sin(angle), -cos(angle)]), np.array([cos(angle), sin(angle)])
    bevel = rng.uniform(0.0, 3.0) * half_m * along * rng.integers(0, 2)
    tip, far = np.array([tip_m, tip_depth_m]), NEEDLE_LENGTH_M * along
    one, other = tip - half_m * across, tip + half_m * across + bevel
    top_m, bottom_m = outline_depths(np.array([one, other, other + far, one + far]), over.lateral_m)
    if np.isnan(top_m).all():
        return
    bright_db = draw(study.needle_db, rng)
    over.line(top_m, bright_db)
    if rng.random() < study.glass_share:
        over.line(bottom_m, bright_db - rng.uniform(0.0, 12.0))
        passed = np.where(np.isfinite(bottom_m), draw(study.glass_pass_fraction, rng), 1.0)
        over.picture.shade(over.row(bottom_m), passed)
    else:
        over.body(top_m, bottom_m, rng.uniform(-30.0, 0.0), OPAQUE_PER_M)
