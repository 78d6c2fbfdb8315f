"""One scene by its number: a raw frame of a front eye as a scanner shows it, its scale, and the true wall."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.light import Complex, add_ridge, amplitude_sigma, circular_gaussian, seen_through
from scleraforce.laboratory.scenes.over import draw_over
from scleraforce.laboratory.scenes.picture import Picture, Ridge, empty_picture, level
from scleraforce.laboratory.scenes.tissue import Tissue, draw_tissue
from scleraforce.laboratory.scenes.wall import Curve, Window, draw_wall, draw_window
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.grid import Float
from scleraforce.study import SceneScannerStudy, ScenesStudy, draw

STREAK_SLOPE = 1.2  # of a slanted streak, at most, in pixels
SAMPLE = 7  # every so many pixels tell what is bright
LEAST_LIGHT = 1e-3  # over the noise


@dataclass(frozen=True)
class Shown:
    """A frame, and which of its columns are imaged (column,): not the black bands at its sides."""

    frame: Pixels
    imaged: NDArray[np.bool_]


def scanned(study: SceneScannerStudy, picture: Picture, apex_column: float | None, rng: np.random.Generator) -> Shown:
    """Return the frame that a scanner shows.

    Args:
        study: ranges and shares.
        picture: what light meets.
        apex_column: where the surface lies across the light; None where it does nowhere.
        rng: source of all that is drawn.
    """
    lines = _lines(study, picture.window, rng)
    field = _field(study, picture, lines, rng)
    light = _folded(study, field, picture.window, rng)
    if apex_column is not None and rng.random() < study.flare_share:
        _add_flare(study, light, picture.window, apex_column, rng)
    _add_streaks(study, light, picture.window, rng)
    bits = int(draw(study.bits, rng))
    share = _display(study, light, rng)
    imaged = _blacken(study, share, rng)
    frame = np.rint(share * (2**bits - 1)).astype(np.uint8 if bits == 8 else np.uint16)
    return Shown(frame, imaged)


def _lines(study: SceneScannerStudy, window: Window, rng: np.random.Generator) -> list[Ridge]:
    """Return horizontal reflection lines, which no tissue shades."""
    lines = []
    for _ in range(int(draw(study.line_count, rng))):
        row = np.full(window.columns, window.above + rng.uniform(0.0, window.rows))
        bright = np.full(window.columns, level(draw(study.line_db, rng)))
        lines.append(Ridge(row, bright, amplitude_sigma(draw(study.line_m, rng)) / window.pixel_m, shadowed=False))
    return lines


def _field(study: SceneScannerStudy, picture: Picture, lines: list[Ridge], rng: np.random.Generator) -> Complex:
    """Return the field of the light that comes back, seen with the scanner's speckle, without its noise."""
    depth = np.maximum(picture.rows - picture.window.above, 0.0) / picture.window.rows
    reaching = np.exp(-np.cumsum(picture.loss, axis=0)) * level(-draw(study.rolloff_db, rng) * depth).astype(np.float32)
    field = np.sqrt(picture.scatter * reaching) * circular_gaussian(picture.scatter.shape, rng)
    sigmas = (amplitude_sigma(draw(width, rng)) for width in (study.speckle_rows, study.speckle_columns))
    field = seen_through(field, *sigmas)
    for ridge in (*picture.ridges, *lines):
        add_ridge(field, ridge.row, np.sqrt(ridge.intensity * _reaching(ridge, reaching)), ridge.sigma_rows, rng)
    return field


def _reaching(ridge: Ridge, reaching: Float) -> Curve | float:
    """Return the share of the light that reaches a bright curve and comes back, (column,)."""
    if not ridge.shadowed:
        return 1.0
    row = np.clip(np.nan_to_num(ridge.row, nan=0.0) - 1.0, 0, len(reaching) - 1).astype(np.intp)
    share: Curve = reaching[row, np.arange(reaching.shape[1])].astype(np.float64)
    return share


def _folded(study: SceneScannerStudy, field: Complex, window: Window, rng: np.random.Generator) -> Float:
    """Return the frame's intensity over the mean noise: what lies above the zero delay is mirrored, noise is added.

    The intensity of several looks lies between that of one and their mean.
    """
    below, above = field[window.above :], field[: window.above][::-1]
    if rng.random() < study.mirrored_share:
        below[: len(above)] += above
    noise_level = level(draw(study.noise_tilt_db, rng) * np.linspace(-0.5, 0.5, len(below)))[:, None].astype(np.float32)
    mean = np.square(np.abs(below)) + noise_level
    seen = below + np.sqrt(noise_level) * circular_gaussian(below.shape, rng)
    one_look = np.square(np.abs(seen))
    light: Float = np.maximum(mean + (one_look - mean) / np.sqrt(np.float32(draw(study.looks, rng))), LEAST_LIGHT)
    return light


def _add_flare(
    study: SceneScannerStudy, light: Float, window: Window, apex_column: float, rng: np.random.Generator
) -> None:
    """Add the vertical stripe of the apex' mirror reflection, over the whole depth."""
    across = (np.arange(window.columns) - apex_column) * window.step_m / draw(study.flare_m, rng)
    stripe = level(draw(study.flare_db, rng)) * np.exp(-(across**2))
    fades = np.exp(-rng.uniform(0.0, 3.0) * np.linspace(0.0, 1.0, window.rows))
    light += (fades[:, None] * stripe * rng.exponential(1.0, (window.rows, 1))).astype(np.float32)


def _add_streaks(study: SceneScannerStudy, light: Float, window: Window, rng: np.random.Generator) -> None:
    """Add slanted streaks of haze: reflections of what lies outside of the frame."""
    for _ in range(int(draw(study.streak_count, rng))):
        row = np.arange(window.rows)[:, None] - rng.uniform(-0.2, 0.6) * window.rows
        slanted = np.arange(window.columns) - rng.uniform(0.0, window.columns) - rng.uniform(-1, 1) * STREAK_SLOPE * row
        across = slanted * window.step_m / draw(study.streak_m, rng)
        length = rng.uniform(0.1, 0.4) * window.rows
        streak = level(draw(study.streak_db, rng)) * np.exp(-(across**2) - (row / length) ** 2)
        light += (streak * rng.exponential(1.0, (1, window.columns))).astype(np.float32)


def _display(study: SceneScannerStudy, light: Float, rng: np.random.Generator) -> Float:
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
        black = float(level(draw(study.display_floor_db, rng)))
        white = max(white, 2.0 * black)
        share = np.log(light / np.float32(black)) / np.float32(np.log(white / black))
    shown: Float = np.power(np.clip(share, 0.0, 1.0), np.float32(draw(study.gamma, rng)))
    return shown


def _blacken(study: SceneScannerStudy, share: Float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Draw marks, lose columns, blacken bands and arcs; return which columns are imaged."""
    rows, columns = share.shape
    for _ in range(int(draw(study.mark_count, rng))):
        _mark(share, rng)
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
        side = rng.choice([-1.0, 1.0])
        share[
            (row < (arc if side > 0 else arc.max() - arc)) | (row > rows - 1 - (arc.max() - arc if side > 0 else arc))
        ] = 0.0
    return imaged


def _mark(share: Float, rng: np.random.Generator) -> None:
    """Draw what a program writes on a frame: a cursor's line, or a small frame in a corner."""
    rows, columns = share.shape
    bright = np.float32(rng.uniform(0.3, 1.0))
    if rng.random() < 0.4:
        share[:, int(rng.integers(0, columns))] = bright
        return
    height, width = (int(size * rng.uniform(0.08, 0.2)) for size in (rows, columns))
    top = int(rng.choice([0.03 * rows, 0.97 * rows - height]))
    left = int(rng.choice([0.03 * columns, 0.97 * columns - width]))
    share[top : top + height, [left, left + width]] = bright
    share[[top, top + height], left : left + width] = bright


BAND_SHARE, BAND_ROWS = 0.05, 4  # of the frame's rows above and below a boundary that are compared, and at least
ACROSS_SHARE = 0.04  # of the columns whose mean is looked at
LEAST_STEP = 0.5  # in standard deviations of a pixel on the boundary's dark side
LEAST_LEVEL = 0.02  # ... and of the level of bright tissue
BRIGHT_SHARE = 0.99  # of the pixels are darker than bright tissue
GAP_SHARE = 0.15  # of the columns: a narrower gap is bridged by what is seen on both sides
LEAST_RUN = 0.04  # of the columns: fewer side by side are chance
LEAST_SEEN = 0.1  # of the columns: a frame that shows less shows no wall


def judged_columns(
    frame: Pixels, surface: Curve, outer: Curve, inner: Curve
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which columns show wall, and for which it is certain whether they do, both (column,).

    Not certain: the wall is there, but nobody can tell where, or whether it is.

    Args:
        frame: counts, shape (row, column).
        surface: row at which light enters the tissue, (column,), NaN without.
        outer: upper boundary of the wall, NaN without.
        inner: lower boundary.
    """
    there = np.isfinite(outer)
    seen = there & _bridged(seen_columns(frame, surface, inner))
    if np.count_nonzero(seen) < LEAST_SEEN * len(seen):
        return np.zeros(len(seen), dtype=np.bool_), np.ones(len(seen), dtype=np.bool_)
    return seen, seen | ~there


def seen_columns(frame: Pixels, surface: Curve, inner: Curve) -> NDArray[np.bool_]:
    """Return in which columns it is brighter below the tissue's surface than above, or above the wall's end than below.

    Args:
        frame: counts, shape (row, column).
        surface: row at which light enters the tissue, (column,), NaN without.
        inner: lower boundary of the wall.
    """
    rows = max(BAND_ROWS, round(BAND_SHARE * len(frame)))
    least = LEAST_LEVEL * float(np.quantile(frame, BRIGHT_SHARE))
    return _steps(frame, surface, rows, 1, least) | _steps(frame, inner, rows, -1, least)


def _steps(frame: Pixels, boundary: Curve, rows: int, bright_side: int, least: float) -> NDArray[np.bool_]:
    """Return where the frame is brighter on one side of a boundary (1: below it) than on the other, (column,)."""
    start = np.nan_to_num(np.ceil(boundary), nan=-1e6, posinf=-1e6, neginf=-1e6)
    off = np.arange(1, rows + 1)[:, None]
    below, above = start + off, start - 1 - off  # a row on each side of the boundary is left out
    inside = (above[-1] >= 0) & (below[-1] < len(frame))
    column = np.arange(frame.shape[1])
    levels, spreads = [], []
    for band in (below, above)[::bright_side]:
        counts = frame[np.clip(band, 0, len(frame) - 1).astype(np.intp), column].astype(np.float64)
        levels.append(_across(counts.mean(axis=0)))
        spreads.append(np.sqrt(_across(counts.var(axis=0))))
    bright, dark = levels
    seen: NDArray[np.bool_] = inside & (bright - dark > np.maximum(LEAST_STEP * spreads[1], least))
    return seen


def _across(values: Curve) -> Curve:
    """Return the means over neighbouring columns."""
    width = 2 * round(ACROSS_SHARE * len(values) / 2) + 1
    mean: Curve = np.convolve(np.pad(values, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="valid")
    return mean


def _bridged(seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return `seen` without short runs, and with the narrower gaps between the others closed."""
    kept = seen.copy()
    for start, end in _runs(seen):
        kept[start:end] = end - start >= LEAST_RUN * len(seen)
    for start, end in _runs(~kept):
        if start > 0 and end < len(kept) and end - start <= GAP_SHARE * len(kept):
            kept[start:end] = True
    return kept


def _runs(values: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last + 1 of each run of True.

    >>> _runs(np.array([True, False, True, True]))
    [(0, 1), (2, 4)]
    """
    change = np.diff(np.concatenate([[0], values.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(change == 1).tolist(), np.flatnonzero(change == -1).tolist(), strict=True))


LEVEL_RAD = 0.03  # a surface that lies so nearly across the light reflects into the scanner


@dataclass(frozen=True)
class Scene:
    """A drawn frame and its truth.

    `frame`: counts (row, column), uint8 or uint16. `outer_row`, `inner_row` (column,): the wall's boundaries in rows of
    pixel centres, as `segmentation` counts them; they may lie outside of the frame, and are NaN where a column shows
    no wall. Behind a narrow shadow, or in a lost column, the wall goes on. `judged` (column,) is False where there is
    wall that nobody can see: such columns are neither right nor wrong.
    """

    frame: Pixels
    scale: PixelScale
    outer_row: NDArray[np.float64]
    inner_row: NDArray[np.float64]
    judged: NDArray[np.bool_]

    @property
    def mask(self) -> NDArray[np.uint8]:
        """255 in the rows whose centre lies in the wall, else 0, shape (row, column)."""
        row = np.arange(len(self.frame))[:, None]
        inside = (row >= self.outer_row) & (row < self.inner_row)
        return np.where(inside, 255, 0).astype(np.uint8)


def draw_scene(study: ScenesStudy, number: int) -> Scene:
    """Draw a scene: the same for the same study and number.

    Args:
        study: ranges of all that is drawn, and the seed.
        number: of the scene, not negative.

    >>> scene = draw_scene(ScenesStudy(), 3)
    >>> scene.outer_row.shape == scene.frame.shape[1:]
    True
    """
    rng = np.random.default_rng([study.seed, number])
    window = draw_window(study.window, rng)
    wall = draw_wall(study.eye, study.window, window, rng)
    picture = empty_picture(window)
    tissue = draw_tissue(study.tissue, wall, picture, rng)
    draw_over(study.over, tissue, wall.dent_m, picture, rng)
    shown = scanned(study.scanner, picture, _apex(tissue), rng)
    outer_row, inner_row = _truth(tissue, window, shown.imaged)
    surface_row = tissue.surface - window.above - 0.5
    seen, judged = judged_columns(shown.frame, surface_row, outer_row, inner_row)
    outer_row, inner_row = np.where(seen, outer_row, np.nan), np.where(seen, inner_row, np.nan)
    scale = PixelScale(lateral_m=window.step_m, depth_m=window.pixel_m, refractive_index=tissue.refractive_index)
    return Scene(shown.frame, scale, outer_row, inner_row, judged)


def _apex(tissue: Tissue) -> float | None:
    """Return the column where the surface lies across the light, None where it does nowhere."""
    slope = np.abs(tissue.rays.slope_rad)
    if not np.isfinite(slope).any() or np.nanmin(slope) > LEVEL_RAD:
        return None
    return float(np.nanargmin(slope))


def _truth(
    tissue: Tissue, window: Window, imaged: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the wall's boundaries in rows of pixel centres, NaN where a column shows none."""
    outer, inner = tissue.outer - window.above - 0.5, tissue.inner - window.above - 0.5
    shown = imaged & (outer < window.rows - 1) & (inner > 0.0) & (inner > outer)
    return np.where(shown, outer, np.nan), np.where(shown, inner, np.nan)
