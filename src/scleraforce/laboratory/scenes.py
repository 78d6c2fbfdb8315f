"""Scenes: numbered raw frames of front eyes as a scanner shows them, with their scale and the true wall."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import find_objects, label

from scleraforce.arrays import Bytes, Flags, Floats, Singles
from scleraforce.laboratory import light as optics
from scleraforce.laboratory.light import Complex, amplitude_sigma, ratios
from scleraforce.laboratory.scene_over import draw_over
from scleraforce.laboratory.scene_tissue import Picture, Ridge, draw_tissue
from scleraforce.laboratory.scene_wall import Window, draw_wall, draw_window
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.study import SceneScannerStudy, ScenesStudy, draw

STREAK_SLOPE = 1.2  # of a slanted streak, at most, in pixels
SAMPLE = 7  # every 7th pixel tells the brightness
LEAST_LIGHT = 1e-3  # over the noise
LEVEL_RAD = 0.03  # a surface that lies so nearly across the light reflects into the scanner


def scanned(
    study: SceneScannerStudy, picture: Picture, apex_column: float | None, rng: np.random.Generator
) -> tuple[Pixels, Flags]:
    """Return the frame that a scanner shows of a picture, and its imaged columns (column,), without margins."""
    looks = draw(study.looks, rng)
    light = _folded(study, _field(study, picture, looks, rng), picture.window, looks, rng)
    if apex_column is not None and rng.random() < study.flare_share:
        _add_flare(study, light, picture.window, apex_column, rng)
    _add_streaks(study, light, picture.window, rng)
    bits = int(draw(study.bits, rng))
    share = _display(study, light, rng)
    imaged = _blacken(study, share, rng)
    frame = np.rint(share * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    return frame, imaged


def _field(study: SceneScannerStudy, picture: Picture, looks: float, rng: np.random.Generator) -> Complex:
    """Return the field of the returning light without noise; looks that move against the tissue average its speckle."""
    window, lines = picture.window, []
    for _ in range(int(draw(study.line_count, rng))):
        row = np.full(window.columns, window.above + rng.uniform(0.0, window.rows))
        bright = np.full(window.columns, ratios(draw(study.line_db, rng)))
        lines.append(Ridge(row, bright, amplitude_sigma(draw(study.line_m, rng)) / window.pixel_m, shadowed=False))
    depth = np.maximum(picture.rows - window.above, 0.0) / window.rows
    rolled_off = ratios(-draw(study.rolloff_db, rng) * depth).astype(np.float32)
    reaching = np.exp(-np.cumsum(picture.loss, axis=0)) * rolled_off
    if rng.random() < study.fall_share:
        reaching *= _fall(study, picture, rng)
    light = picture.scatter * reaching
    rows = min(draw(study.speckle_rows, rng), draw(study.axial_m, rng) / window.pixel_m)
    sigmas = amplitude_sigma(rows), amplitude_sigma(draw(study.speckle_columns, rng))
    field = optics.seen_through(np.sqrt(light) * optics.circular_gaussian(light.shape, rng), *sigmas)
    mean, one_look = optics.spread(light, *sigmas), np.square(np.abs(field))
    averaged = mean + (one_look - mean) / np.float32(np.sqrt(looks ** rng.random()))
    field *= np.sqrt(np.maximum(averaged, 0.0) / np.maximum(one_look, np.float32(1e-12)))
    for ridge in (*picture.ridges, *lines):
        row = np.clip(np.nan_to_num(ridge.row, nan=0.0) - 1.0, 0, len(reaching) - 1).astype(np.intp)
        left = reaching[row, np.arange(window.columns)].astype(np.float64) if ridge.shadowed else 1.0
        optics.add_ridge(field, ridge.row, np.sqrt(ridge.intensity * left), ridge.sigma_rows, rng)
    return field


def _fall(study: SceneScannerStudy, picture: Picture, rng: np.random.Generator) -> Singles:
    """Return the light's fall from a place near the middle on: sideways, in a ring, or between both, (row, column)."""
    window = picture.window
    across = (window.lateral_m / (window.width_m / 2) - rng.uniform(-0.2, 0.2)) ** 2
    down = ((picture.rows - window.above) / window.rows * 2.0 - 1.0) ** 2
    away = across + rng.choice([0.0, rng.random()]) * down
    return ratios(-draw(study.fall_db, rng) * away ** rng.uniform(0.7, 2.0)).astype(np.float32)


def _folded(
    study: SceneScannerStudy, field: Complex, window: Window, looks: float, rng: np.random.Generator
) -> Singles:
    """Return the frame's intensity over the mean noise, with the part above the zero delay mirrored, and noise."""
    below, above = field[window.above :], field[: window.above][::-1]
    if rng.random() < study.mirrored_share:
        below[: len(above)] += above
    tilt_db = draw(study.noise_tilt_db, rng) * np.linspace(-0.5, 0.5, len(below))
    noise_level = ratios(tilt_db)[:, None].astype(np.float32)
    mean = np.square(np.abs(below)) + noise_level
    seen = below + np.sqrt(noise_level) * optics.circular_gaussian(below.shape, rng)
    one_look = np.square(np.abs(seen))
    return np.maximum(mean + (one_look - mean) / np.sqrt(np.float32(looks)), LEAST_LIGHT)


def _add_flare(study: SceneScannerStudy, light: Singles, window: Window, apex: float, rng: np.random.Generator) -> None:
    """Add the vertical stripe of the apex' mirror reflection, over the whole depth, and its ghosts, short and wide."""
    width_m, level_db = draw(study.flare_m, rng), draw(study.flare_db, rng)
    across = (np.arange(window.columns) - apex) * window.step_m / width_m
    for _ in range(int(draw(study.ghost_count, rng))):
        off = (np.arange(window.rows)[:, None] - rng.uniform(0.0, window.rows)) / rng.uniform(0.7, 3.0)
        ghost = ratios(level_db - rng.uniform(0.0, 10.0)) * np.exp(-((across / rng.uniform(1.0, 20.0)) ** 2) - off**2)
        light += ghost.astype(np.float32)
    stripe = ratios(level_db) * np.exp(-(across**2))
    fades = np.exp(-rng.uniform(0.0, 3.0) * np.linspace(0.0, 1.0, window.rows))
    light += (fades[:, None] * stripe * rng.exponential(1.0, (window.rows, 1))).astype(np.float32)


def _add_streaks(study: SceneScannerStudy, light: Singles, window: Window, rng: np.random.Generator) -> None:
    """Add slanted streaks of haze: reflections from outside of the frame."""
    for _ in range(int(draw(study.streak_count, rng))):
        row = np.arange(window.rows)[:, None] - rng.uniform(-0.2, 0.6) * window.rows
        slanted = np.arange(window.columns) - rng.uniform(0.0, window.columns) - rng.uniform(-1, 1) * STREAK_SLOPE * row
        across = slanted * window.step_m / draw(study.streak_m, rng)
        length = rng.uniform(0.1, 0.4) * window.rows
        streak = ratios(draw(study.streak_db, rng)) * np.exp(-(across**2) - (row / length) ** 2)
        light += (streak * rng.exponential(1.0, (1, window.columns))).astype(np.float32)


def _display(study: SceneScannerStudy, light: Singles, rng: np.random.Generator) -> Singles:
    """Return the counts' share of the largest: of the intensity, its root or its logarithm, then gamma."""
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


def _blacken(study: SceneScannerStudy, share: Singles, rng: np.random.Generator) -> Flags:
    """Lose columns, blacken bands and arcs, put the frame on a page, draw marks; return which columns are imaged."""
    rows, columns = share.shape
    if rng.random() < study.lost_share:
        first, lost = int(rng.integers(0, columns)), int(draw(study.lost_columns, rng))
        share[:, first : first + lost] = 0.0
    imaged = np.ones(columns, dtype=np.bool_)
    if rng.random() < study.band_share:
        band = round(draw(study.band_fraction, rng) * columns)
        imaged[:band] = imaged[columns - band :] = False
        share[:, ~imaged] = 0.0
    if rng.random() < study.arc_share:
        arc = draw(study.arc_fraction, rng) * rows * np.linspace(-1.0, 1.0, columns) ** 2
        row = np.arange(rows)[:, None]
        top, bottom = (arc, arc.max() - arc)[:: 1 if rng.choice([-1.0, 1.0]) > 0 else -1]
        share[(row < top) | (row > rows - 1 - bottom)] = 0.0
    if rng.random() < study.margin_share:
        _put_on_page(study, share, imaged, rng)
    for _ in range(int(draw(study.mark_count, rng))):
        MARKS[rng.integers(len(MARKS))](share, rng)
    return imaged


def _put_on_page(study: SceneScannerStudy, share: Singles, imaged: Flags, rng: np.random.Generator) -> None:
    """Draw the page's margins, of one grey, at some sides of a frame; they show nothing (`imaged`)."""
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
    (rows, height), (columns, width) = ((size, int(size * rng.uniform(0.08, 0.2))) for size in share.shape)
    return (
        int(rng.choice([0.03 * rows, 0.97 * rows - height])), height,
        int(rng.choice([0.03 * columns, 0.97 * columns - width])), width,
    )  # fmt: skip


MARKS = _cursor, _box, _letters  # of a program


BAND_SHARE, BAND_ROWS = 0.05, 4  # of the frame's rows above and below a boundary that are compared, and at least
ACROSS_SHARE = 0.04  # of the columns whose mean is looked at
LEAST_STEP = 0.5  # in standard deviations of a pixel on the boundary's dark side
LEAST_LEVEL = 0.02  # ... and of the level of bright tissue
BRIGHT_SHARE = 0.99  # of the pixels are darker than bright tissue
GAP_SHARE = 0.15  # of the columns: a narrower gap is bridged from both sides
LEAST_RUN = 0.04  # of the columns: fewer side by side are chance
LEAST_SEEN = 0.1  # of the columns: a frame that shows less shows no wall


def judged_columns(frame: Pixels, surface: Floats, outer: Floats, inner: Floats) -> tuple[Flags, Flags]:
    """Return the columns that show wall, and the certain columns, in which no wall is invisible, (column,) each."""
    there, kept = np.isfinite(outer), seen_columns(frame, surface, inner)
    for (run,) in find_objects(label(kept)[0]):
        kept[run] = run.stop - run.start >= LEAST_RUN * len(kept)
    for (gap,) in find_objects(label(~kept)[0]):
        if gap.start > 0 and gap.stop < len(kept) and gap.stop - gap.start <= GAP_SHARE * len(kept):
            kept[gap] = True
    seen = there & kept
    if np.count_nonzero(seen) < LEAST_SEEN * len(seen):
        return np.zeros(len(seen), dtype=np.bool_), np.ones(len(seen), dtype=np.bool_)
    return seen, seen | ~there


def seen_columns(frame: Pixels, surface: Floats, inner: Floats) -> Flags:
    """Return the columns with a step of brightness at the tissue's surface or at the wall's end, (column,)."""
    rows = max(BAND_ROWS, round(BAND_SHARE * len(frame)))
    least = LEAST_LEVEL * float(np.quantile(frame, BRIGHT_SHARE))
    return _steps(frame, surface, rows, 1, least) | _steps(frame, inner, rows, -1, least)


def _steps(frame: Pixels, boundary: Floats, rows: int, bright_side: int, least: float) -> Flags:
    """Return the columns in which the frame is brighter on one side of a boundary (1: below it) than on the other."""
    start = np.nan_to_num(np.ceil(boundary), nan=-1e6, posinf=-1e6, neginf=-1e6)
    off = np.arange(1, rows + 1)[:, None]
    below, above = start + off, start - 1 - off  # a row on each side of the boundary is left out
    inside = (above[-1] >= 0) & (below[-1] < len(frame))
    column = np.arange(frame.shape[1])
    bright, dark = (
        frame[np.clip(band, 0, len(frame) - 1).astype(np.intp), column].astype(np.float64)
        for band in (below, above)[::bright_side]
    )
    step, spread = _across(bright.mean(axis=0)) - _across(dark.mean(axis=0)), np.sqrt(_across(dark.var(axis=0)))
    return inside & (step > np.maximum(LEAST_STEP * spread, least))


def _across(values: Floats) -> Floats:
    width = 2 * round(ACROSS_SHARE * len(values) / 2) + 1
    return np.convolve(np.pad(values, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="valid")


@dataclass(frozen=True)
class Scene:
    """A drawn frame and its truth; behind a narrow shadow, or in a lost column, the wall continues."""

    frame: Pixels  # (row, column), uint8 or uint16
    scale: PixelScale
    outer_row: Floats  # (column,), of pixel centres, also outside of the frame; NaN in columns without wall
    inner_row: Floats
    judged: Flags  # (column,): False for an invisible wall
    covered: Flags  # (column,): a lid or a drape is what hides it

    @property
    def mask(self) -> Bytes:
        """255 in the rows whose centre lies in the wall, else 0, shape (row, column)."""
        row = np.arange(len(self.frame))[:, None]
        inside = (row >= self.outer_row) & (row < self.inner_row)
        return np.where(inside, 255, 0).astype(np.uint8)


def draw_scene(study: ScenesStudy, number: int) -> Scene:
    """Draw a scene: the same for the same study and number."""
    rng = np.random.default_rng([study.seed, number])
    study = study.of_one(rng)
    window = draw_window(study.window, rng)
    wall = draw_wall(study.eye, study.window, window, rng)
    tissue = draw_tissue(study.tissue, wall, window, rng)
    draw_over(study.over, tissue)
    slope = np.nan_to_num(np.abs(tissue.rays.slope_rad), nan=np.inf)
    apex = float(slope.argmin()) if slope.min() <= LEVEL_RAD else None  # the column of a surface across the light
    frame, imaged = scanned(study.scanner, tissue.picture, apex, rng)
    surface_row, outer, inner = (row - window.above - 0.5 for row in (tissue.surface, tissue.outer, tissue.inner))
    shown = imaged & (outer < window.rows - 1) & (inner > 0.0) & (inner > outer)
    outer, inner = np.where(shown, outer, np.nan), np.where(shown, inner, np.nan)
    seen, judged = judged_columns(frame, surface_row, outer, inner)
    outer, inner = np.where(seen, outer, np.nan), np.where(seen, inner, np.nan)
    scale = PixelScale(lateral_m=window.step_m, depth_m=window.pixel_m, refractive_index=tissue.rays.stretch)
    return Scene(frame, scale, outer, inner, judged, tissue.picture.covered & ~judged)
