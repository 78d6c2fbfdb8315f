"""Logarithm, root or intensity: the display is told from frames alone, and what is measured beside it is right."""

from dataclasses import replace

import numpy as np
import pytest
from analytic_frames import OPTICS, SCANNER, drawn_counts, drawn_eyes, imaged

from scleraforce.errors import FrameError
from scleraforce.laboratory.scanner import drawn_alike, histogram_overlap, measure_scanner
from scleraforce.laboratory.scanner_display import (
    DISPLAY_KINDS,
    LOGARITHMIC,
    Estimate,
    Unmeasured,
    display_kind,
    fit_display,
    spread_slope,
)

FEW = range(7110, 7113)
WITHIN_1_DB = ("display_floor_db", "display_range_db", "snr_db", "choroid_level_db")
WITHIN_10_PERCENT = (
    "attenuation_per_m", "axial_resolution_m", "lateral_resolution_m", "choroid_thickness_m",
)  # fmt: skip
SHOWN = {"display_range_db": 42.0, "snr_db": 20.0}
SCANNERS = {
    "linear, 16 bits": ("linear", replace(SCANNER, bits=16), SHOWN),
    "linear, 12 bits": ("linear", SCANNER, SHOWN | {"display_range_db": 36.0}),
    "linear, dim wall that attenuates little": (
        "linear", SCANNER, {"display_range_db": 33.0, "snr_db": 16.0, "attenuation_per_m": 500.0},
    ),
    "root, 12 bits": ("root", SCANNER, SHOWN),
    "root, 8 bits": ("root", replace(SCANNER, bits=8), SHOWN | {"display_floor_db": -10.0}),
    "root, coarse speckle": (
        "root", SCANNER, SHOWN | {"axial_resolution_m": 14e-6, "lateral_resolution_m": 70e-6},
    ),
}  # fmt: skip


QUICK = ("linear, 12 bits", "root, 8 bits")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name in QUICK else [pytest.mark.slow]) for name in SCANNERS]
)
def test_a_display_of_roots_and_a_linear_one_are_told_and_their_scanner_is_measured(name: str) -> None:
    display, scanner, optics = SCANNERS[name]
    found = measure_scanner(drawn_eyes(FEW, scanner, display=display, **optics))
    assert found.display.name == found.phantom().display == display
    for key in WITHIN_1_DB:
        assert found.ranges[key].median == pytest.approx(optics.get(key, getattr(OPTICS, key)), abs=1.0), key
    for key in WITHIN_10_PERCENT:
        assert found.ranges[key].median == pytest.approx(optics.get(key, getattr(OPTICS, key)), rel=0.1), key
    drawn = drawn_alike(found.frames[0], found.phantom(), np.random.default_rng(1))
    assert histogram_overlap(found.frames[0].eye.pixels, drawn, 2**scanner.bits - 1) > 0.95


def test_the_slopes_are_those_of_many_drawn_intensities() -> None:
    rng = np.random.default_rng(7120)
    dim = rng.exponential(size=400_000)
    for kind, expected in (("logarithmic", 0.0), ("root", 0.770), ("linear", np.log(3.0) / np.log(2.0))):
        quartiles = np.array(
            [np.quantile(DISPLAY_KINDS[kind].shown(light), (0.25, 0.5, 0.75)) for light in (dim, 3.0 * dim)]
        )
        spread = quartiles[:, 2] - quartiles[:, 0]
        assert np.diff(spread)[0] / np.diff(quartiles[:, 1])[0] == pytest.approx(expected, abs=0.01)
        assert DISPLAY_KINDS[kind].spread_slope == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("kind", DISPLAY_KINDS.values(), ids=DISPLAY_KINDS)
def test_what_a_display_shows_goes_back_to_the_intensity(kind) -> None:
    light = np.array([1e-3, 0.5, 1.0, 700.0])
    np.testing.assert_allclose(kind.level_db(kind.shown(light)), 10.0 * np.log10(light))


@pytest.mark.parametrize("seed", range(7130, 7133))
def test_gain_and_offset_of_a_display_do_not_change_the_slope(seed: int) -> None:
    counts = drawn_counts(seed, display="root", display_range_db=42.0)
    moved = np.rint(counts * 0.4 + 900.0).astype(np.uint16)
    moved[:, counts.max(axis=0) == 0] = 0
    one, other = (spread_slope(imaged(each)) for each in (counts, moved))
    assert other.value == pytest.approx(one.value, abs=0.04)


def test_a_logarithmic_display_of_averaged_noise_is_still_one() -> None:
    """Noise of many looks spreads less than the wall's speckle, as dark tissue on a linear display would."""
    rng = np.random.default_rng(7140)
    for seed in FEW:
        counts = drawn_counts(seed).astype(np.float64)
        air = imaged(drawn_counts(seed)).below_surface_rows < 0
        counts[air] = 4095 * (7.0 + 10.0 * np.log10(rng.gamma(50.0, 1 / 50.0, air.sum()))) / 42.0
        found = spread_slope(imaged(np.rint(counts.clip(0, 4095)).astype(np.uint16)))
        assert display_kind([found]) is LOGARITHMIC


def test_averaged_noise_on_a_linear_display_is_refused() -> None:
    rng = np.random.default_rng(7150)
    counts = drawn_counts(FEW[0], display="linear", display_floor_db=-20.0, display_range_db=48.0).astype(np.float64)
    air = imaged(counts.astype(np.uint16)).below_surface_rows < 0
    counts[air] = 4095 / 10.0**2.8 * rng.gamma(4.0, 1 / 4.0, air.sum())
    eye = imaged(np.rint(counts).astype(np.uint16), name="averaged.png")
    with pytest.raises(FrameError, match=r"averaged\.png: .* as on a linear display, and its noise lies above count 0"):
        measure_scanner([eye])
    assert fit_display(eye, LOGARITHMIC).kind is LOGARITHMIC


def test_a_wall_of_even_light_tells_no_display_and_a_logarithmic_one_is_taken() -> None:
    eyes = drawn_eyes(FEW[:1], attenuation_per_m=20.0, display="root", display_range_db=42.0)
    slope = spread_slope(eyes[0])
    assert isinstance(slope, Unmeasured)
    assert "too even" in slope.reason
    assert display_kind([slope]) is LOGARITHMIC


def test_the_kind_is_that_of_most_frames() -> None:
    slopes = [Estimate(value=value, error=0.1) for value in (0.1, 1.5, 1.4)]
    assert display_kind([*slopes, Unmeasured("dark")]).name == "linear"
    assert display_kind([Estimate(value=0.38, error=0.1)]).name == "logarithmic"
    assert display_kind([Estimate(value=0.40, error=0.1)]).name == "root"
