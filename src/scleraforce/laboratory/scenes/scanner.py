"""From what light meets to counts: loss, speckle, mirror image, artefacts, and the scale of the display."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.scenes.picture import Picture, Ridge, level
from scleraforce.laboratory.scenes.window import Curve, Window
from scleraforce.laboratory.speckle import Complex, add_ridge, amplitude_sigma, circular_gaussian, seen_through
from scleraforce.recording.pixels import Pixels
from scleraforce.segmentation.grid import Float
from scleraforce.study import SceneScannerStudy, draw

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
