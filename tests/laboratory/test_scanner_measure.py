"""Drawn frames with known parameters: what is measured on them is what they were drawn with."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from analytic_frames import OPTICS, SCANNER, drawn_counts, drawn_eyes, imaged

from scleraforce.errors import FrameError
from scleraforce.laboratory import bscan
from scleraforce.laboratory.light import Line, Shadow
from scleraforce.laboratory.scanner import MeasuredScanner, drawn_alike, histogram_overlap, measure_scanner, study_text
from scleraforce.laboratory.scanner_display import Unmeasured
from scleraforce.study import PhantomStudy, parse_study

SEEDS = range(7000, 7006)
FEW = range(7010, 7013)  # where three frames are enough
# Keys by how far a measured median may lie off the truth, over six frames.
WITHIN_1_DB = ("snr_db", "display_floor_db", "display_range_db", "reflection_db", "choroid_level_db")
WITHIN_10_PERCENT = (
    "axial_resolution_m",
    "lateral_resolution_m",
    "attenuation_per_m",
    "band_m",
    "choroid_thickness_m",
    "choroid_attenuation_per_m",
)
SCANNERS = {
    "the common one": (SCANNER, {}),
    "bright": (SCANNER, {"snr_db": 26.0, "display_range_db": 46.0, "reflection_db": 5.0}),
    "dim, attenuating": (SCANNER, {"snr_db": 18.0, "attenuation_per_m": 1400.0, "choroid_level_db": -6.0}),
    "coarse speckle": (
        SCANNER,
        {"axial_resolution_m": 14e-6, "lateral_resolution_m": 70e-6, "display_floor_db": -8.0, "reflection_db": 4.0},
    ),
    "8 bits, stretched depth": (
        replace(SCANNER, bits=8, rows=640, depth_m=5e-3, refractive_index=1.38),
        {"attenuation_per_m": 700.0, "choroid_thickness_m": 220e-6},
    ),
}


def scanners() -> list[object]:
    """Their names; two are measured by default."""
    usual = ("the common one", "8 bits, stretched depth")
    return [pytest.param(name, marks=[] if name in usual else [pytest.mark.slow]) for name in SCANNERS]


@pytest.fixture(scope="module", params=scanners(), ids=str)
def measured(request: pytest.FixtureRequest) -> tuple[MeasuredScanner, dict]:
    scanner, optics = SCANNERS[request.param]
    return measure_scanner(drawn_eyes(SEEDS, scanner, **optics)), optics


@pytest.mark.parametrize("key", WITHIN_1_DB)
def test_levels_are_recovered_within_1_db(measured, key: str) -> None:
    scanner, optics = measured
    assert scanner.ranges[key].median == pytest.approx(optics.get(key, getattr(OPTICS, key)), abs=1.0)


@pytest.mark.parametrize("key", WITHIN_10_PERCENT)
def test_lengths_and_attenuations_are_recovered_within_10_percent(measured, key: str) -> None:
    scanner, optics = measured
    assert scanner.ranges[key].median == pytest.approx(optics.get(key, getattr(OPTICS, key)), rel=0.1)


@pytest.mark.slow
def test_a_strong_reflections_angle_is_recovered_within_20_percent() -> None:
    found = measure_scanner(drawn_eyes(SEEDS, reflection_db=8.0, display_range_db=46.0)).ranges["reflection_angle_rad"]
    assert found.median == pytest.approx(OPTICS.reflection_angle_rad, rel=0.2)


def test_shadows_and_lines_are_recovered() -> None:
    shadow = Shadow(centre_m=2e-3, width_m=0.6e-3, loss_fraction=0.55)
    line = Line(depth_m=0.2e-3, level_db=8.0, thickness_m=16e-6)
    found = measure_scanner(drawn_eyes(SEEDS, shadows=(shadow,), lines=(line,)))
    assert found.counts == {"shadow_count": (1,) * len(SEEDS), "line_count": (1,) * len(SEEDS)}
    assert found.ranges["shadow_loss_fraction"].median == pytest.approx(0.55, rel=0.1)
    assert found.ranges["shadow_width_m"].median == pytest.approx(0.6e-3, rel=0.1)
    assert found.ranges["line_depth_m"].median == pytest.approx(0.2e-3, rel=0.01)
    assert found.ranges["line_level_db"].median == pytest.approx(8.0, abs=0.5)
    assert found.ranges["line_thickness_m"].median == pytest.approx(16e-6, rel=0.1)


@pytest.mark.slow
def test_two_displays_of_the_same_light_give_the_same_physics() -> None:
    one, other = (
        measure_scanner(drawn_eyes(FEW, scanner, display_floor_db=floor_db, display_range_db=range_db))
        for scanner, floor_db, range_db in ((SCANNER, -7.0, 42.0), (replace(SCANNER, bits=8), -12.0, 50.0))
    )
    assert one.ranges["display_range_db"].median == pytest.approx(42.0, abs=0.5)
    assert other.ranges["display_range_db"].median == pytest.approx(50.0, abs=0.5)
    for key, most in {"snr_db": 0.2, "reflection_db": 0.5, "choroid_level_db": 0.5}.items():
        assert other.ranges[key].median == pytest.approx(one.ranges[key].median, abs=most)
    for key in ("attenuation_per_m", "axial_resolution_m", "lateral_resolution_m", "choroid_thickness_m"):
        assert other.ranges[key].median == pytest.approx(one.ranges[key].median, rel=0.04)


def test_resolution_finer_than_the_pixels_is_said_to_be_at_most_so_much() -> None:
    found = measure_scanner(drawn_eyes(FEW, axial_resolution_m=3e-6, lateral_resolution_m=12e-6)).ranges
    pixels_m = {"axial_resolution_m": SCANNER.depth_m / 512, "lateral_resolution_m": SCANNER.width_m / 512}
    for key, pixel_m in pixels_m.items():
        assert found[key].at_most
        assert found[key].median < pixel_m


@pytest.mark.slow
def test_roll_off_is_measured_where_the_light_falls_with_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    """The wall's columns get 3 dB less for every mm that their surface lies deeper; without that, they get the same."""
    assert abs(measure_scanner(drawn_eyes(FEW)).ranges["roll_off_db_per_m"].median) < 200.0
    lateral_m = (np.arange(512) + 0.5) / 512 * 15e-3 - 7.5e-3
    depth_m = 12e-3 - np.sqrt(12e-3**2 - lateral_m**2)
    monkeypatch.setattr(bscan, "transmission", lambda *_: (10 ** (-300.0 * depth_m)).astype(np.float32))
    found = measure_scanner(drawn_eyes(FEW)).ranges["roll_off_db_per_m"]
    assert found.median == pytest.approx(3000.0, rel=0.15)


@pytest.mark.slow
def test_averaged_noise_leaves_the_scale_of_the_display_to_the_speckle() -> None:
    """The air of eight frames, averaged in intensity; the wall's speckle is the same in all of them."""
    rng = np.random.default_rng(7100)
    eyes = []
    for seed in FEW:
        clean = drawn_counts(seed, replace(SCANNER, bits=16), display_floor_db=-40.0, display_range_db=100.0)
        intensity = 10 ** ((clean / 65535 * 100.0 - 40.0) / 10)
        wall = imaged(clean, replace(SCANNER, bits=16))
        air = ~(wall.below_surface_rows >= 0)
        looks = np.where(air, rng.gamma(8.0, 1 / 8.0, clean.shape), intensity)
        level_db = 10 * np.log10(looks) + 7.0
        counts = np.rint(np.clip(level_db / 42.0, 0.0, 1.0) * 4095).astype(np.uint16)
        counts[:, :17] = counts[:, -17:] = 0
        eyes.append(imaged(counts))
    found = measure_scanner(eyes).ranges
    assert found["noise_looks"].median == pytest.approx(8.0, rel=0.15)
    assert found["display_range_db"].median == pytest.approx(42.0, abs=1.5)
    assert found["snr_db"].median == pytest.approx(OPTICS.snr_db, abs=1.0)
    assert found["attenuation_per_m"].median == pytest.approx(OPTICS.attenuation_per_m, rel=0.1)


def test_speckle_of_one_look_has_the_skew_of_its_logarithm() -> None:
    assert measure_scanner(drawn_eyes(FEW)).ranges["speckle_skew"].median == pytest.approx(-0.2, abs=0.02)


def test_a_frame_drawn_like_a_measured_one_has_its_histogram() -> None:
    found = measure_scanner(drawn_eyes(FEW))
    for frame in found.frames:
        drawn = drawn_alike(frame, found.phantom(), np.random.default_rng(1))
        assert drawn.shape == frame.eye.pixels.shape
        assert histogram_overlap(frame.eye.pixels, drawn, 4095) > 0.97


@pytest.mark.slow
def test_without_a_choroid_its_keys_keep_their_defaults_and_say_why() -> None:
    found = measure_scanner(drawn_eyes(FEW, choroid_level_db=-60.0))
    assert isinstance(found.ranges["choroid_level_db"], Unmeasured)
    assert found.phantom().choroid_level_db == PhantomStudy().choroid_level_db


def test_one_frame_gives_ranges_of_its_uncertainty() -> None:
    found = measure_scanner(drawn_eyes(range(7200, 7201))).ranges
    for key in ("snr_db", "attenuation_per_m", "display_range_db", "lateral_resolution_m"):
        assert found[key].low < found[key].median < found[key].high


def test_noise_that_the_display_cuts_off_is_refused() -> None:
    with pytest.raises(FrameError, match="noise above the tissue is black"):
        measure_scanner(drawn_eyes(range(7300, 7301), display_floor_db=4.0))


def test_a_wall_that_saturates_is_refused() -> None:
    with pytest.raises(FrameError, match="saturates"):
        measure_scanner(drawn_eyes(range(7400, 7401), snr_db=30.0, attenuation_per_m=100.0, display_range_db=30.0))


@pytest.fixture(scope="module")
def scanner() -> MeasuredScanner:
    return measure_scanner(drawn_eyes(range(7600, 7602), choroid_level_db=-60.0))


def test_the_text_is_a_study_with_the_scanners_size_and_ranges(scanner: MeasuredScanner) -> None:
    text = study_text(scanner, ["a.png", "b.png"], "2026-11-23", "1.2.3")
    study = parse_study(text)
    assert (study.oct.columns, study.oct.rows) == (512, 512)
    assert study.phantom == scanner.phantom()
    assert set(tomllib.loads(text)) == {"oct", "phantom"}


def test_the_text_says_where_it_came_from_and_what_is_missing(scanner: MeasuredScanner) -> None:
    text = study_text(scanner, ['evil"\n[eye]\nradius_mm = 1', *["b.png"] * 30], "2026-11-23", "1.2.3")
    assert "1.2.3 on 2026-11-23, on 31 frame(s)" in text
    assert "and 11 more" in text
    assert parse_study(text).eye == parse_study("").eye
    assert "# choroid_level_db: not measured, as in the paper's study: " in text
    assert parse_study(text).phantom.choroid_level_db == PhantomStudy().choroid_level_db
