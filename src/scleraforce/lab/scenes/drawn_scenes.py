"""Scenes: numbered raw frames of front eyes as a scanner shows them, with their scale
and the true wall.
"""

from dataclasses import dataclass
from functools import partial
from math import cos, sin

import numpy as np
from scipy.ndimage import find_objects, label

from scleraforce.base.arrays import Bytes, Flags, Floats, Singles
from scleraforce.lab import tissue_light
from scleraforce.lab.scenes.scene_tissue import (
    DrawnTissue,
    Picture,
    Ridge,
    draw_tissue,
    outline_depths,
)
from scleraforce.lab.scenes.scene_wall import Window, draw_scene_wall, draw_window
from scleraforce.lab.tissue_light import (
    Complex,
    Shadow,
    amplitude_sigma,
    ratios,
    transmission,
)
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import (
    SceneOverStudy,
    SceneScannerStudy,
    ScenesStudy,
    draw,
)

OPAQUE_PER_M = 40e3  # attenuation of metal
LINE_ROWS = (0.5, 1.4)  # half widths of bright curves
NEEDLE_LENGTH_M = 20e-3
HAZY_SHARE = 0.3  # of the contact lenses
HAZE_DB = 20.0  # below their faces' light
AIR_PASS = 0.02  # share of the light that gets through air between wet surfaces


class _Over:
    """The drawing that things over the tissue are added to."""

    def __init__(self, study: SceneOverStudy, tissue: DrawnTissue) -> None:
        self.study = study
        self.tissue = tissue
        self.picture = tissue.picture
        self.rng = tissue.rng
        self.lateral_m = tissue.rays.window.lateral_m
        self.surface_m = tissue.rays.surface_m

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
        self.picture.ridges.append(
            Ridge(self.row(depth_m), bright, self.rng.uniform(*LINE_ROWS))
        )

    def body(
        self, top_m: Floats, bottom_m: Floats, level_db: float, attenuation_per_m: float
    ) -> None:
        """Replace the picture between two curves."""
        self.picture.fill(
            self.row(top_m),
            self.row(bottom_m),
            ratios(level_db),
            attenuation_per_m,
            1.0,
        )

    def cover(
        self, top_m: Floats, bottom_m: Floats, level_db: float, attenuation_per_m: float
    ) -> None:
        """Draw a body over the eye that may hide the wall."""
        self.body(top_m, bottom_m, level_db, attenuation_per_m)
        self.picture.covered[np.isfinite(top_m)] = True


def draw_over(study: SceneOverStudy, tissue: DrawnTissue) -> None:
    """Draw things over the tissue and vessels in it; a needle is put into the wall's
    dent if it has one.
    """
    rng = tissue.rng
    dent_m = tissue.wall.dent_m
    over = _Over(study, tissue)
    _vessels(over)

    for share, thing in (
        (study.contact_lens_share, _contact_lens),
        (study.coverslip_share, _coverslip),
        (study.drape_share, _drape),
        (study.lid_share, partial(_lid, left=True)),
        (study.lid_share, partial(_lid, left=False)),
    ):
        if rng.random() < share:
            thing(over)

    for _ in range(int(draw(study.bubble_count, rng))):
        _bubble(over)

    if rng.random() < study.needle_share:
        _needle(over, over.place() if dent_m is None else dent_m)


def _vessels(over: _Over) -> None:
    """Take light from columns below vessels, which lie in the upper part of the wall,
    and below air on it.
    """
    study = over.study
    tissue = over.tissue
    rng = over.rng

    for _ in range(int(draw(study.vessel_count, rng))):
        middle_m = over.place()
        width_m = draw(study.vessel_m, rng)
        loss = draw(study.vessel_loss_fraction, rng)
        shadow = Shadow(centre_m=middle_m, width_m=width_m, loss_fraction=loss)
        depth = rng.uniform(0.0, 0.6) * (tissue.inner - tissue.surface)
        passed = transmission([shadow], over.lateral_m).astype(np.float64)
        over.picture.shade(tissue.surface + np.nan_to_num(depth), passed)

    if rng.random() < study.air_share:
        air = Shadow(
            centre_m=over.place(),
            width_m=draw(study.air_m, rng),
            loss_fraction=1.0 - AIR_PASS,
        )
        over.picture.shade(
            tissue.surface, transmission([air], over.lateral_m).astype(np.float64)
        )


def _smooth_surface(over: _Over) -> Floats:
    """Return the parabola above the surface, at all columns, m."""
    there = np.isfinite(over.surface_m)
    if np.count_nonzero(there) < 3:
        return np.full(len(over.lateral_m), np.nan)

    smooth = np.polyval(
        np.polyfit(over.lateral_m[there], over.surface_m[there], 2), over.lateral_m
    )
    return np.asarray(
        smooth - max(float((smooth - over.surface_m)[there].max()), 0.0),
        dtype=np.float64,
    )


def _contact_lens(over: _Over) -> None:
    """Draw a lens over the eye, two lines that meet at its edge, the haze in it, and
    what floats below it.
    """
    study = over.study
    rng = over.rng
    middle_m = over.place()
    reach_m = draw(study.lens_reach_m, rng)
    off = (over.lateral_m - middle_m) / reach_m
    tapered = np.sqrt(np.clip(1.0 - off**2, 0.0, None))
    back_m = _smooth_surface(over) - draw(study.lens_gap_m, rng) * tapered
    deepest_m = np.where(np.isfinite(over.surface_m), over.surface_m, np.inf)
    back_m = np.where(np.abs(off) < 1.0, np.minimum(back_m, deepest_m), np.nan)
    front_m = back_m - draw(study.lens_m, rng) * np.minimum(2.0 * tapered, 1.0)
    bright_db = draw(study.lens_db, rng) - 12.0 * np.clip(
        np.abs(over.tissue.rays.slope_rad), 0.0, 1.0
    )

    if rng.random() < HAZY_SHARE:
        over.body(front_m, back_m, draw(study.lens_db, rng) - HAZE_DB, 0.0)

    over.line(front_m, np.nan_to_num(bright_db, nan=0.0))
    over.line(back_m, np.nan_to_num(bright_db - rng.uniform(0.0, 10.0), nan=0.0))
    _specks(over, back_m)


def _specks(over: _Over, top_m: Floats) -> None:
    count = int(draw(over.study.speck_count, over.rng))
    column = over.rng.integers(0, len(top_m), count)
    depth_m = top_m[column] + over.rng.random(count) * (over.surface_m - top_m)[column]
    row = np.nan_to_num(over.row(depth_m), nan=-1.0, posinf=-1.0, neginf=-1.0).astype(
        np.intp
    )
    inside = (row >= 0) & (row < len(over.picture.scatter))
    bright = ratios(draw(over.study.speck_db, over.rng) - 6.0 * over.rng.random(count))
    over.picture.scatter[row[inside], column[inside]] = bright[inside]


def _coverslip(over: _Over) -> None:
    study = over.study
    rng = over.rng
    if not np.isfinite(over.surface_m).any():
        return

    plane = np.tan(draw(study.coverslip_tilt_rad, rng)) * over.lateral_m
    lower = (
        plane
        + float(np.nanmin(over.surface_m - plane))
        - draw(study.coverslip_height_m, rng)
    )
    bright_db = draw(study.coverslip_db, rng)
    over.line(lower, bright_db)
    over.line(lower - draw(study.coverslip_m, rng), bright_db)


def _drape(over: _Over) -> None:
    """Draw a sheet that covers the tissue from one side of the frame on."""
    study = over.study
    rng = over.rng
    window = over.picture.window
    reach_m = draw(study.drape_reach, rng) * window.width_m
    from_side = over.from_side(left=rng.random() < 0.5)
    folds_m = rng.uniform(0.0, 60e-6) * np.sin(
        over.lateral_m / rng.uniform(0.1e-3, 0.5e-3)
    )
    thick_m = draw(study.drape_m, rng)
    top_m = np.where(
        from_side < reach_m,
        over.surface_m - thick_m - np.abs(folds_m) - rng.uniform(0.0, 0.2e-3),
        np.nan,
    )
    over.cover(
        top_m,
        top_m + thick_m,
        draw(study.drape_db, rng),
        draw(study.drape_attenuation_per_m, rng),
    )


def _lid(over: _Over, left: bool) -> None:
    """Draw a lid that comes in from one side above the eye, with its rounded edge, and
    lashes below it.
    """
    study = over.study
    rng = over.rng
    window = over.picture.window
    from_side = over.from_side(left)
    reach_m = draw(study.lid_reach, rng) * window.width_m
    thick_m = draw(study.lid_m, rng)
    inwards = np.clip(from_side / reach_m, 0.0, 1.0)
    bottom_m = np.where(
        inwards < 1.0,
        _smooth_surface(over) - draw(study.lid_gap_m, rng) * inwards,
        np.nan,
    )
    top_m = bottom_m - thick_m * np.sqrt(np.clip(1.0 - inwards**2, 0.0, None))
    over.cover(
        top_m, bottom_m, draw(study.lid_db, rng), draw(study.lid_attenuation_per_m, rng)
    )

    for _ in range(int(draw(study.lash_count, rng))):
        _lash(
            over,
            (-1.0 if left else 1.0)
            * (window.width_m / 2 - reach_m * rng.uniform(0.5, 1.6)),
        )


def _lash(over: _Over, lateral_m: float) -> None:
    """Draw a lash across the plane or along it: a bright short line with a shadow."""
    rng = over.rng
    half_m = draw(over.study.lash_m, over.rng) * over.rng.choice([0.5, 6.0])
    off = over.lateral_m - lateral_m
    if not np.isfinite(over.surface_m).any():
        return

    depth_m = (
        float(np.nanmin(over.surface_m))
        - rng.uniform(0.1e-3, 1.5e-3)
        + rng.uniform(-1.0, 1.0) * off
    )
    depth_m = np.where(np.abs(off) < half_m, depth_m, np.nan)
    over.line(depth_m, draw(over.study.lid_db, rng))
    over.picture.shade(
        over.row(depth_m), np.where(np.abs(off) < half_m, rng.uniform(0.05, 0.6), 1.0)
    )


def _bubble(over: _Over) -> None:
    """Draw a bubble over the surface: its bright upper and lower side, and its
    shadow.
    """
    study = over.study
    rng = over.rng
    radius_m = draw(study.bubble_m, rng)
    off = over.lateral_m - over.place()
    half_m = np.sqrt(np.maximum(radius_m**2 - off**2, 0.0))
    inside = np.abs(off) < radius_m
    rests_m = np.interp(
        over.lateral_m[np.abs(off).argmin()], over.lateral_m, over.surface_m
    )
    middle_m = rests_m - radius_m * rng.uniform(0.6, 1.6)
    bright_db = draw(study.bubble_db, rng)

    for side in (-1.0, 1.0):
        over.line(np.where(inside, middle_m + side * half_m, np.nan), bright_db)

    passed = np.where(
        inside,
        np.clip(1.0 - (half_m / radius_m) * rng.uniform(0.3, 0.98), 0.02, 1.0),
        1.0,
    )
    over.picture.shade(
        np.where(np.isfinite(middle_m + half_m), over.row(middle_m + half_m), 0.0),
        passed,
    )


def _needle(over: _Over, tip_m: float) -> None:
    """Draw a needle in the plane: the bright upper edge of its shaft; metal lets no
    light through, glass some.
    """
    study = over.study
    rng = over.rng
    angle = draw(study.needle_angle_rad, rng)
    half_m = draw(study.needle_m, rng) / 2
    tip_depth_m = float(np.interp(tip_m, over.lateral_m, over.surface_m)) - draw(
        study.tip_gap_m, rng
    )
    along = np.array([sin(angle), -cos(angle)])
    across = np.array([cos(angle), sin(angle)])
    bevel = rng.uniform(0.0, 3.0) * half_m * along * rng.integers(0, 2)
    tip = np.array([tip_m, tip_depth_m])
    far = NEEDLE_LENGTH_M * along
    one = tip - half_m * across
    other = tip + half_m * across + bevel

    top_m, bottom_m = outline_depths(
        np.array([one, other, other + far, one + far]), over.lateral_m
    )
    if np.isnan(top_m).all():
        return

    bright_db = draw(study.needle_db, rng)
    over.line(top_m, bright_db)

    if rng.random() < study.glass_share:
        over.line(bottom_m, bright_db - rng.uniform(0.0, 12.0))
        passed = np.where(
            np.isfinite(bottom_m), draw(study.glass_pass_fraction, rng), 1.0
        )
        over.picture.shade(over.row(bottom_m), passed)
    else:
        over.body(top_m, bottom_m, rng.uniform(-30.0, 0.0), OPAQUE_PER_M)


STREAK_SLOPE = 1.2  # of a slanted streak, at most, in pixels
SAMPLE = 7  # every 7th pixel tells the brightness
LEAST_LIGHT = 1e-3  # over the noise
# a surface that lies so nearly across the light reflects into the scanner
LEVEL_RAD = 0.03


def scanned(
    study: SceneScannerStudy,
    picture: Picture,
    apex_column: float | None,
    rng: np.random.Generator,
) -> tuple[Pixels, Flags]:
    """Return the frame that a scanner shows of a picture, and its imaged columns
    (column,), without margins.
    """
    looks = draw(study.looks, rng)
    light = _folded(
        study, _field(study, picture, looks, rng), picture.window, looks, rng
    )

    if apex_column is not None and rng.random() < study.flare_share:
        _add_flare(study, light, picture.window, apex_column, rng)

    _add_streaks(study, light, picture.window, rng)
    bits = int(draw(study.bits, rng))
    share = _display(study, light, rng)
    imaged = _blacken(study, share, rng)
    frame = np.rint(share * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)

    return frame, imaged


def _field(
    study: SceneScannerStudy, picture: Picture, looks: float, rng: np.random.Generator
) -> Complex:
    """Return the field of the returning light without noise; looks that move against
    the tissue average its speckle.
    """
    window = picture.window
    lines = []

    for _ in range(int(draw(study.line_count, rng))):
        row = np.full(window.columns, window.above + rng.uniform(0.0, window.rows))
        bright = np.full(window.columns, ratios(draw(study.line_db, rng)))
        lines.append(
            Ridge(
                row,
                bright,
                amplitude_sigma(draw(study.line_m, rng)) / window.pixel_m,
                shadowed=False,
            )
        )

    depth = np.maximum(picture.rows - window.above, 0.0) / window.rows
    rolled_off = ratios(-draw(study.rolloff_db, rng) * depth).astype(np.float32)
    reaching = np.exp(-np.cumsum(picture.loss, axis=0)) * rolled_off
    if rng.random() < study.fall_share:
        reaching *= _fall(study, picture, rng)

    light = picture.scatter * reaching
    rows = min(draw(study.speckle_rows, rng), draw(study.axial_m, rng) / window.pixel_m)
    sigmas = amplitude_sigma(rows), amplitude_sigma(draw(study.speckle_columns, rng))
    field = tissue_light.seen_through(
        np.sqrt(light) * tissue_light.circular_gaussian(light.shape, rng), *sigmas
    )
    mean = tissue_light.seen_intensity(light, *sigmas)
    one_look = np.square(np.abs(field))
    averaged = mean + (one_look - mean) / np.float32(np.sqrt(looks ** rng.random()))
    field *= np.sqrt(
        np.maximum(averaged, 0.0) / np.maximum(one_look, np.float32(1e-12))
    )

    for ridge in (*picture.ridges, *lines):
        row = np.clip(
            np.nan_to_num(ridge.row, nan=0.0) - 1.0, 0, len(reaching) - 1
        ).astype(np.intp)
        left = (
            reaching[row, np.arange(window.columns)].astype(np.float64)
            if ridge.shadowed
            else 1.0
        )
        tissue_light.add_ridge(
            field, ridge.row, np.sqrt(ridge.intensity * left), ridge.sigma_rows, rng
        )

    return field


def _fall(
    study: SceneScannerStudy, picture: Picture, rng: np.random.Generator
) -> Singles:
    """Return the light's fall from a place near the middle on: sideways, in a ring, or
    between both, (row, column).
    """
    window = picture.window
    across = (window.lateral_m / (window.width_m / 2) - rng.uniform(-0.2, 0.2)) ** 2
    down = ((picture.rows - window.above) / window.rows * 2.0 - 1.0) ** 2
    away = across + rng.choice([0.0, rng.random()]) * down

    return ratios(-draw(study.fall_db, rng) * away ** rng.uniform(0.7, 2.0)).astype(
        np.float32
    )


def _folded(
    study: SceneScannerStudy,
    field: Complex,
    window: Window,
    looks: float,
    rng: np.random.Generator,
) -> Singles:
    """Return the frame's intensity over the mean noise, with the part above the zero
    delay mirrored, and noise.
    """
    below = field[window.above :]
    above = field[: window.above][::-1]
    if rng.random() < study.mirrored_share:
        below[: len(above)] += above

    tilt_db = draw(study.noise_tilt_db, rng) * np.linspace(-0.5, 0.5, len(below))
    noise_level = ratios(tilt_db)[:, None].astype(np.float32)
    mean = np.square(np.abs(below)) + noise_level
    seen = below + np.sqrt(noise_level) * tissue_light.circular_gaussian(
        below.shape, rng
    )
    one_look = np.square(np.abs(seen))

    return np.maximum(
        mean + (one_look - mean) / np.sqrt(np.float32(looks)), LEAST_LIGHT
    )


def _add_flare(
    study: SceneScannerStudy,
    light: Singles,
    window: Window,
    apex: float,
    rng: np.random.Generator,
) -> None:
    """Add the vertical stripe of the apex' mirror reflection, over the whole depth, and
    its ghosts, short and wide.
    """
    width_m = draw(study.flare_m, rng)
    level_db = draw(study.flare_db, rng)
    across = (np.arange(window.columns) - apex) * window.step_m / width_m

    for _ in range(int(draw(study.ghost_count, rng))):
        off = (
            np.arange(window.rows)[:, None] - rng.uniform(0.0, window.rows)
        ) / rng.uniform(0.7, 3.0)
        ghost = ratios(level_db - rng.uniform(0.0, 10.0)) * np.exp(
            -((across / rng.uniform(1.0, 20.0)) ** 2) - off**2
        )
        light += ghost.astype(np.float32)

    stripe = ratios(level_db) * np.exp(-(across**2))
    fades = np.exp(-rng.uniform(0.0, 3.0) * np.linspace(0.0, 1.0, window.rows))
    light += (fades[:, None] * stripe * rng.exponential(1.0, (window.rows, 1))).astype(
        np.float32
    )


def _add_streaks(
    study: SceneScannerStudy, light: Singles, window: Window, rng: np.random.Generator
) -> None:
    """Add slanted streaks of haze: reflections from outside of the frame."""
    for _ in range(int(draw(study.streak_count, rng))):
        row = np.arange(window.rows)[:, None] - rng.uniform(-0.2, 0.6) * window.rows
        slanted = (
            np.arange(window.columns)
            - rng.uniform(0.0, window.columns)
            - rng.uniform(-1, 1) * STREAK_SLOPE * row
        )
        across = slanted * window.step_m / draw(study.streak_m, rng)
        length = rng.uniform(0.1, 0.4) * window.rows
        streak = ratios(draw(study.streak_db, rng)) * np.exp(
            -(across**2) - (row / length) ** 2
        )
        light += (streak * rng.exponential(1.0, (1, window.columns))).astype(np.float32)


def _display(
    study: SceneScannerStudy, light: Singles, rng: np.random.Generator
) -> Singles:
    """Return the counts' share of the largest: of the intensity, its root or its
    logarithm, then gamma.
    """
    sample = light.ravel()[::SAMPLE]
    nth = int((1.0 - draw(study.saturated_fraction, rng)) * (len(sample) - 1))
    white = float(np.partition(sample, nth)[nth])

    kind = rng.random()
    if kind < study.linear_share:
        share = light / np.float32(white)
    elif kind < study.linear_share + study.root_share:
        share = np.sqrt(light / np.float32(white))
    else:
        black = float(ratios(draw(study.display_floor_db, rng)))
        white = max(white, 2.0 * black)
        share = np.log(light / np.float32(black)) / np.float32(np.log(white / black))

    return np.power(np.clip(share, 0.0, 1.0), np.float32(draw(study.gamma, rng)))


def _blacken(
    study: SceneScannerStudy, share: Singles, rng: np.random.Generator
) -> Flags:
    """Lose columns, blacken bands and arcs, put the frame on a page, draw marks; return
    which columns are imaged.
    """
    rows, columns = share.shape
    if rng.random() < study.lost_share:
        first = int(rng.integers(0, columns))
        lost = int(draw(study.lost_columns, rng))
        share[:, first : first + lost] = 0.0

    imaged = np.ones(columns, dtype=np.bool_)
    if rng.random() < study.band_share:
        band = round(draw(study.band_fraction, rng) * columns)
        imaged[:band] = imaged[columns - band :] = False
        share[:, ~imaged] = 0.0

    if rng.random() < study.arc_share:
        arc = (
            draw(study.arc_fraction, rng) * rows * np.linspace(-1.0, 1.0, columns) ** 2
        )
        row = np.arange(rows)[:, None]
        top, bottom = (arc, arc.max() - arc)[
            :: 1 if rng.choice([-1.0, 1.0]) > 0 else -1
        ]
        share[(row < top) | (row > rows - 1 - bottom)] = 0.0

    if rng.random() < study.margin_share:
        _put_on_page(study, share, imaged, rng)

    for _ in range(int(draw(study.mark_count, rng))):
        MARKS[rng.integers(len(MARKS))](share, rng)

    return imaged


def _put_on_page(
    study: SceneScannerStudy, share: Singles, imaged: Flags, rng: np.random.Generator
) -> None:
    """Draw the page's margins, of one grey, at some sides of a frame; they show nothing
    (`imaged`).
    """
    level = draw(study.margin_level, rng)
    for side in np.flatnonzero(rng.random(4) < 0.6):
        turned = share.T if side % 2 else share
        width = round(draw(study.margin_fraction, rng) * len(turned))
        margin = slice(0, width) if side < 2 else slice(len(turned) - width, None)
        turned[margin] = level

        if side % 2:
            imaged[margin] = False


def _cursor(share: Singles, rng: np.random.Generator) -> None:
    """Draw the line of a program's cursor, upright or across."""
    turned = share.T if rng.random() < 0.6 else share
    turned[rng.integers(len(turned))] = rng.uniform(0.3, 1.0)


def _box(share: Singles, rng: np.random.Generator) -> None:
    top, height, left, width = _corner(share, rng)
    bright = np.float32(rng.uniform(0.3, 1.0))
    share[top : top + height, [left, left + width]] = bright
    share[[top, top + height], left : left + width] = bright


def _letters(share: Singles, rng: np.random.Generator) -> None:
    """Draw what looks like a line of text in a corner."""
    top, _, left, width = _corner(share, rng)
    lines = rng.random((max(3, len(share) // 40), width)) < 0.4
    text = share[top : top + len(lines), left : left + width]
    text[lines[: len(text)]] = rng.uniform(0.5, 1.0)


def _corner(share: Singles, rng: np.random.Generator) -> tuple[int, int, int, int]:
    """Return first row, rows, first column and columns of a box in a corner."""
    (rows, height), (columns, width) = (
        (size, int(size * rng.uniform(0.08, 0.2))) for size in share.shape
    )
    return (
        int(rng.choice([0.03 * rows, 0.97 * rows - height])),
        height,
        int(rng.choice([0.03 * columns, 0.97 * columns - width])),
        width,
    )


MARKS = _cursor, _box, _letters  # of a program


# of the frame's rows above and below a boundary that are compared, and at least
BAND_SHARE = 0.05
BAND_ROWS = 4
ACROSS_SHARE = 0.04  # of the columns whose mean is looked at
LEAST_STEP = 0.5  # in standard deviations of a pixel on the boundary's dark side
LEAST_LEVEL = 0.02  # ... and of the level of bright tissue
BRIGHT_SHARE = 0.99  # of the pixels are darker than bright tissue
GAP_SHARE = 0.15  # of the columns: a narrower gap is bridged from both sides
LEAST_RUN = 0.04  # of the columns: fewer side by side are chance
LEAST_SEEN = 0.1  # of the columns: a frame that shows less shows no wall


def judged_columns(
    frame: Pixels, surface: Floats, outer: Floats, inner: Floats
) -> tuple[Flags, Flags]:
    """Return the columns that show wall, and the certain columns, in which no wall is
    invisible, (column,) each.
    """
    there = np.isfinite(outer)
    kept = seen_columns(frame, surface, inner)
    for (run,) in find_objects(label(kept)[0]):
        kept[run] = run.stop - run.start >= LEAST_RUN * len(kept)

    for (gap,) in find_objects(label(~kept)[0]):
        if (
            gap.start > 0
            and gap.stop < len(kept)
            and gap.stop - gap.start <= GAP_SHARE * len(kept)
        ):
            kept[gap] = True

    seen = there & kept
    if np.count_nonzero(seen) < LEAST_SEEN * len(seen):
        return np.zeros(len(seen), dtype=np.bool_), np.ones(len(seen), dtype=np.bool_)

    return seen, seen | ~there


def seen_columns(frame: Pixels, surface: Floats, inner: Floats) -> Flags:
    """Return the columns with a step of brightness at the tissue's surface or at the
    wall's end, (column,).
    """
    rows = max(BAND_ROWS, round(BAND_SHARE * len(frame)))
    least = LEAST_LEVEL * float(np.quantile(frame, BRIGHT_SHARE))
    return _steps(frame, surface, rows, 1, least) | _steps(
        frame, inner, rows, -1, least
    )


def _steps(
    frame: Pixels, boundary: Floats, rows: int, bright_side: int, least: float
) -> Flags:
    """Return the columns in which the frame is brighter on one side of a boundary (1:
    below it) than on the other.
    """
    start = np.nan_to_num(np.ceil(boundary), nan=-1e6, posinf=-1e6, neginf=-1e6)
    off = np.arange(1, rows + 1)[:, None]
    # a row on each side of the boundary is left out
    below = start + off
    above = start - 1 - off
    inside = (above[-1] >= 0) & (below[-1] < len(frame))
    column = np.arange(frame.shape[1])
    bright, dark = (
        frame[np.clip(band, 0, len(frame) - 1).astype(np.intp), column].astype(
            np.float64
        )
        for band in (below, above)[::bright_side]
    )
    step = _across(bright.mean(axis=0)) - _across(dark.mean(axis=0))
    spread = np.sqrt(_across(dark.var(axis=0)))

    return inside & (step > np.maximum(LEAST_STEP * spread, least))


def _across(values: Floats) -> Floats:
    width = 2 * round(ACROSS_SHARE * len(values) / 2) + 1
    return np.convolve(
        np.pad(values, width // 2, mode="edge"),
        np.full(width, 1.0 / width),
        mode="valid",
    )


@dataclass(frozen=True)
class Scene:
    """A drawn frame and its truth; behind a narrow shadow, or in a lost column, the
    wall continues.
    """

    frame: Pixels  # (row, column), uint8 or uint16
    scale: PixelScale
    # (column,), of pixel centres, also outside of the frame; NaN in columns without
    # wall
    outer_row: Floats
    inner_row: Floats
    judged: Flags  # (column,): False for an invisible wall
    covered: Flags  # (column,): a lid or a drape is what hides it

    @property
    def mask(self) -> Bytes:
        """255 in the rows whose centre lies in the wall, else 0, shape (row,
        column).
        """
        row = np.arange(len(self.frame))[:, None]
        inside = (row >= self.outer_row) & (row < self.inner_row)
        return np.where(inside, 255, 0).astype(np.uint8)


def draw_scene(study: ScenesStudy, number: int) -> Scene:
    """Draw a scene: the same for the same study and number."""
    rng = np.random.default_rng([study.seed, number])
    study = study.of_one(rng)
    window = draw_window(study.window, rng)
    wall = draw_scene_wall(study.eye, study.window, window, rng)
    tissue = draw_tissue(study.tissue, wall, window, rng)
    draw_over(study.over, tissue)
    slope = np.nan_to_num(np.abs(tissue.rays.slope_rad), nan=np.inf)
    # the column of a surface across the light
    apex = float(slope.argmin()) if slope.min() <= LEVEL_RAD else None
    frame, imaged = scanned(study.scanner, tissue.picture, apex, rng)
    surface_row, outer, inner = (
        row - window.above - 0.5 for row in (tissue.surface, tissue.outer, tissue.inner)
    )
    shown = imaged & (outer < window.rows - 1) & (inner > 0.0) & (inner > outer)
    outer = np.where(shown, outer, np.nan)
    inner = np.where(shown, inner, np.nan)
    seen, judged = judged_columns(frame, surface_row, outer, inner)
    outer = np.where(seen, outer, np.nan)
    inner = np.where(seen, inner, np.nan)
    scale = PixelScale(
        lateral_m=window.step_m,
        depth_m=window.pixel_m,
        refractive_index=tissue.rays.stretch,
    )

    return Scene(frame, scale, outer, inner, judged, tissue.picture.covered & ~judged)
