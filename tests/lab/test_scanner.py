"""Drawn frames with known parameters: the measured scanner is the drawn one, and its
display is recognised.
"""

import tomllib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from analytic_frames import OPTICS, SCANNER, drawn_counts, drawn_eyes, imaged
from scene_studies import only

from scleraforce.base.errors import FrameError
from scleraforce.lab import drawn_bscan
from scleraforce.lab.scanner.measured_scanner import (
    MeasuredScanner,
    drawn_alike,
    histogram_overlap,
    measure_scanner,
    study_text,
)
from scleraforce.lab.scanner.scanner_display import Unmeasured
from scleraforce.lab.scenes.drawn_scenes import draw_scene
from scleraforce.lab.tissue_light import ReflectionLine, Shadow
from scleraforce.records.study import PhantomStudy, parse_study
from scleraforce.wall.wall_network import reduced_frame

SEEDS = range(7000, 7006)
DISPLAY_FEW = range(7110, 7112)
FEW = range(7010, 7013)  # where three frames are enough
# Keys by how far a measured median may lie off the truth, over a few frames.
WITHIN_1_DB = ("snr_db", "display_floor_db", "display_range_db", "choroid_level_db")
WITHIN_10_PERCENT = (
    "axial_resolution_m",
    "lateral_resolution_m",
    "attenuation_per_m",
    "choroid_thickness_m",
)
# of a logarithmic display
AND_1_DB = ("reflection_db",)
AND_10_PERCENT = ("band_m", "choroid_attenuation_per_m", "reflection_angle_rad")
COARSE = {"axial_resolution_m": 14e-6, "lateral_resolution_m": 70e-6}
DEEP = replace(SCANNER, bits=8, rows=640, depth_m=5e-3, refractive_index=1.38)
SHOWN = {"display_range_db": 42.0, "snr_db": 20.0}
slow = pytest.mark.slow


def check_recovered(
    found: MeasuredScanner, optics: dict, levels: Sequence[str], others: Sequence[str]
) -> None:
    """Check levels within 1 dB, lengths and attenuations within 10 %."""
    for key in (*levels, *others):
        close = {"abs": 1.0} if key in levels else {"rel": 0.1}
        assert found.ranges[key].median == pytest.approx(
            optics.get(key, getattr(OPTICS, key)), **close
        ), key


def check_drawn_alike(found: MeasuredScanner, least: float) -> None:
    """Check that a frame drawn like a measured one has its histogram."""
    frame = found.frames[0]
    drawn = drawn_alike(frame, found.phantom(), np.random.default_rng(1))
    most = 2**frame.eye.bits - 1
    assert histogram_overlap(frame.eye.pixels, drawn, most) > least


@pytest.mark.parametrize(
    ("seeds", "scanner", "optics"),
    [
        pytest.param(FEW, SCANNER, {}, id="the common one"),
        pytest.param(
            SEEDS,
            SCANNER,
            {"snr_db": 26.0, "display_range_db": 46.0, "reflection_db": 5.0},
            id="bright",
            marks=slow,
        ),
        pytest.param(
            SEEDS,
            SCANNER,
            {"snr_db": 18.0, "attenuation_per_m": 1400.0, "choroid_level_db": -6.0},
            id="dim, attenuating",
            marks=slow,
        ),
        pytest.param(
            SEEDS,
            SCANNER,
            COARSE | {"display_floor_db": -8.0, "reflection_db": 4.0},
            id="coarse speckle",
            marks=slow,
        ),
        pytest.param(
            FEW,
            DEEP,
            {"attenuation_per_m": 700.0, "choroid_thickness_m": 220e-6},
            id="8 bits, stretched depth",
        ),
    ],
)
def test_levels_lengths_and_attenuations_are_recovered(seeds, scanner, optics):
    found = measure_scanner(drawn_eyes(seeds, scanner, **optics))
    levels = WITHIN_1_DB + AND_1_DB
    check_recovered(found, optics, levels, WITHIN_10_PERCENT + AND_10_PERCENT)
    check_drawn_alike(found, 0.97)


@pytest.mark.parametrize(
    ("display", "scanner", "optics"),
    [
        pytest.param(
            "linear", replace(SCANNER, bits=16), SHOWN, id="linear, 16 bits", marks=slow
        ),
        pytest.param(
            "linear", SCANNER, SHOWN | {"display_range_db": 36.0}, id="linear, 12 bits"
        ),
        pytest.param(
            "linear",
            SCANNER,
            {"display_range_db": 33.0, "snr_db": 16.0, "attenuation_per_m": 500.0},
            id="linear, dim wall that attenuates little",
            marks=slow,
        ),
        pytest.param("root", SCANNER, SHOWN, id="root, 12 bits", marks=slow),
        pytest.param(
            "root",
            replace(SCANNER, bits=8),
            SHOWN | {"display_floor_db": -10.0},
            id="root, 8 bits",
        ),
        pytest.param(
            "root", SCANNER, SHOWN | COARSE, id="root, coarse speckle", marks=slow
        ),
    ],
)
def test_root_and_linear_displays_are_recognised_and_their_scanner_is_measured(
    display, scanner, optics
):
    found = measure_scanner(drawn_eyes(DISPLAY_FEW, scanner, display=display, **optics))
    assert found.display.name == found.phantom().display == display
    check_recovered(found, optics, WITHIN_1_DB, WITHIN_10_PERCENT)
    check_drawn_alike(found, 0.95)


def test_a_surface_that_is_bright_at_all_angles_is_no_reflection():
    """The fit runs to the largest angle that it looks for."""
    found = measure_scanner(drawn_eyes(FEW, reflection_angle_rad=50.0)).ranges
    for name in ("reflection_db", "reflection_angle_rad"):
        assert isinstance(found[name], Unmeasured)


def test_shadows_and_lines_are_recovered():
    shadow = Shadow(centre_m=2e-3, width_m=0.6e-3, loss_fraction=0.55)
    line = ReflectionLine(depth_m=0.2e-3, level_db=8.0, thickness_m=16e-6)
    eyes = drawn_eyes(SEEDS, shadows=(shadow,), lines=(line,))
    found = measure_scanner(eyes)
    one_each = (1,) * len(eyes)
    assert found.counts == {"shadow_count": one_each, "line_count": one_each}
    lengths = {
        "shadow_loss_fraction": 0.55,
        "shadow_width_m": 0.6e-3,
        "line_thickness_m": 16e-6,
    }
    assert {key: found.ranges[key].median for key in lengths} == pytest.approx(
        lengths, rel=0.1
    )
    assert found.ranges["line_depth_m"].median == pytest.approx(0.2e-3, rel=0.01)
    assert found.ranges["line_level_db"].median == pytest.approx(8.0, abs=0.5)


def test_resolution_finer_than_the_pixels_is_said_to_be_at_most_so_much():
    found = measure_scanner(
        drawn_eyes(FEW, axial_resolution_m=3e-6, lateral_resolution_m=12e-6)
    ).ranges
    pixels_m = {
        "axial_resolution_m": SCANNER.depth_m / 512,
        "lateral_resolution_m": SCANNER.width_m / 512,
    }

    for key, pixel_m in pixels_m.items():
        assert found[key].at_most
        assert found[key].median < pixel_m


@pytest.mark.slow
def test_roll_off_is_measured_where_the_light_falls_with_depth(
    monkeypatch,
):
    """The wall's columns get 3 dB less for every mm that their surface lies deeper;
    without that, they get the same.
    """
    assert (
        abs(measure_scanner(drawn_eyes(FEW)).ranges["roll_off_db_per_m"].median) < 200.0
    )
    lateral_m = (np.arange(512) + 0.5) / 512 * 15e-3 - 7.5e-3
    depth_m = 12e-3 - np.sqrt(12e-3**2 - lateral_m**2)
    monkeypatch.setattr(
        drawn_bscan,
        "transmission",
        lambda *_: (10 ** (-300.0 * depth_m)).astype(np.float32),
    )
    found = measure_scanner(drawn_eyes(FEW)).ranges["roll_off_db_per_m"]
    assert found.median == pytest.approx(3000.0, rel=0.15)


@pytest.mark.slow
def test_averaged_noise_leaves_the_scale_of_the_display_to_the_speckle():
    """The air of eight frames, averaged in intensity; the wall's speckle is the same in
    all of them.
    """
    rng = np.random.default_rng(7100)
    eyes = []

    for seed in FEW:
        clean = drawn_counts(
            seed,
            replace(SCANNER, bits=16),
            display_floor_db=-40.0,
            display_range_db=100.0,
        )
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
    assert found["attenuation_per_m"].median == pytest.approx(
        OPTICS.attenuation_per_m, rel=0.1
    )


def test_frames_whose_noise_is_cut_off_or_whose_wall_saturates_are_refused():
    bright = {"snr_db": 30.0, "attenuation_per_m": 100.0, "display_range_db": 30.0}
    for optics, fault in (
        ({"display_floor_db": 4.0}, "noise above the tissue is black"),
        (bright, "saturates"),
    ):
        with pytest.raises(FrameError, match=fault):
            measure_scanner(drawn_eyes(range(7300, 7301), **optics))


def test_the_text_is_a_study_that_says_where_it_came_from_and_what_is_missing():
    scanner = measure_scanner(drawn_eyes(range(7600, 7601), choroid_level_db=-60.0))
    hostile = 'evil"\n[eye]\nradius_mm = 1'
    text = study_text(scanner, [hostile, *["b.png"] * 30], "2026-11-23", "1.2.3")
    study = parse_study(text)
    assert (study.phantom, study.scenes) == (scanner.phantom(), scanner.scenes())
    assert set(tomllib.loads(text)) == {"oct", "phantom", "scenes"}
    assert study.phantom.choroid_level_db == PhantomStudy().choroid_level_db


def test_scenes_of_a_scanner_far_from_the_default_look_as_its_frames_do():
    """Its display is linear, its light dim, its pixels few: scenes of round eyes are
    measured like its frames.
    """
    far = replace(SCANNER, width_m=11e-3, depth_m=3.4e-3, columns=256, rows=200)
    optics = {
        "snr_db": 16.0,
        "axial_resolution_m": 45e-6,
        "lateral_resolution_m": 130e-6,
        "band_m": 0.0,
    }
    eyes = drawn_eyes(
        range(7900, 7902),
        far,
        display="linear",
        display_floor_db=-30.0,
        display_range_db=53.0,
        **optics,
    )
    scenes = measure_scanner(eyes).scenes()
    round_eyes = replace(
        scenes,
        window=only(scenes.window, view_m=0.0, tilt_rad=0.0, surface_share=0.15),
        eye=only(
            scenes.eye,
            half_sphere_share=1.0,
            wave_m=0.0,
            sclera_radius_m=12e-3,
            sclera_thickness_m=0.8e-3,
        ),
        tissue=only(
            scenes.tissue,
            profile_db=0.0,
            texture_db=0.0,
            reflection_db=6.0,
            attenuation_per_m=1000.0,
        ),
        over=only(scenes.over),
        scanner=only(
            scenes.scanner,
            linear_share=scenes.scanner.linear_share,
            rolloff_db=0.0,
            noise_tilt_db=0.0,
        ),
    )
    drawn = [draw_scene(round_eyes, number).frame for number in range(2)]
    again = measure_scanner(imaged(frame, far) for frame in drawn)
    assert again.display.name == "linear"
    assert again.ranges["snr_db"].median == pytest.approx(16.0, abs=3.0)

    for key in ("axial_resolution_m", "lateral_resolution_m"):
        assert again.ranges[key].median == pytest.approx(optics[key], rel=0.25)

    seen, alike = (
        np.stack([reduced_frame(frame, 128, 176) for frame in frames]) + 1.0
        for frames in ([eye.pixels for eye in eyes], drawn)
    )
    assert histogram_overlap(seen, alike, 2) > 0.8


def test_averaged_noise_on_a_linear_display_is_refused():
    rng = np.random.default_rng(7150)
    shown = drawn_counts(
        DISPLAY_FEW[0], display="linear", display_floor_db=-20.0, display_range_db=48.0
    )
    counts = shown.astype(np.float64)
    air = imaged(shown).below_surface_rows < 0
    counts[air] = 4095 / 10.0**2.8 * rng.gamma(4.0, 1 / 4.0, air.sum())
    eye = imaged(np.rint(counts).astype(np.uint16), name="averaged.png")

    with pytest.raises(
        FrameError,
        match=(
            r"averaged\.png: .* as on a linear display, and its noise lies above"
            r" count 0"
        ),
    ):
        measure_scanner([eye])


@pytest.mark.parametrize("display", ["linear", "root", "logarithmic"])
def test_behind_a_wall_of_even_light_the_noise_shows_the_display(display: str):
    shown = {"display": display, "display_range_db": 42.0, "display_floor_db": -12.0}
    eyes = drawn_eyes(
        DISPLAY_FEW[:1], replace(SCANNER, bits=16), attenuation_per_m=20.0, **shown
    )
    assert measure_scanner(eyes).display.name == display
