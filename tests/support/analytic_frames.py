"""Frames of known walls: of the analytic library, and of round eyes at rest drawn with
given optics.
"""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from math import exp, log, pi
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from analytic_library import analytic_library

from ideal_boundaries import ideal_boundaries
from predicted_walls import Walls, formed_wall
from scleraforce.fit import unknowns
from scleraforce.fit.curve_placement import PlacedCurves, PlacesOnFrame
from scleraforce.fit.prior_of_an_eye import SHINE_MEAN_M
from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.scanner.scanner_display import ImagedEye
from scleraforce.lab.tissue_light import BscanOptics, NeedleShaft, Pose, sample_optics
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN, Globe
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import OctStudy, Range, ReaderStudy, Study, fixed
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall_in_metres import Boundaries
from virtual_eyes import changed

SHARED = Path(__file__).parents[3] / "shared"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="../shared is absent")
LIBRARY = analytic_library()
# for models that each test loads anew
SMALL_LIBRARY = analytic_library(thicknesses=6, ratios=7, tips=28)
STUDY = Study()
CLEAN = replace(STUDY.phantom, snr_db=fixed(28.0), shadow_count=fixed(0))
SCALE = PixelScale.of(STUDY.oct)
MODULUS_PA = 0.3e6
IOP_PA = 270.0
THICKNESS_M = 0.65e-3
GAP_M = 0.6e-3
KNOWN = Setup(
    eye=Eye(
        modulus=Modulus(mean_pa=MODULUS_PA, sd_pa=0.01 * MODULUS_PA, source="own"),
        iop_pa=IOP_PA,
        thickness_m=THICKNESS_M,
        globe=OPEN,
    ),
    needle=Needle(gap_m=GAP_M),
)
# the same as keywords of the public functions, and the size of the frames
KNOWN_EYE: dict[str, Any] = {
    "youngs_modulus_pa": MODULUS_PA,
    "iop_pa": IOP_PA,
    "thickness_m": THICKNESS_M,
    "globe": "open",
}
SIZE: dict[str, Any] = {"width_m": 15e-3, "depth_m": 4e-3}


def tip_of(force_n: float) -> float:
    """Dent of the wall under a force."""
    walls = (np.array([THICKNESS_M]), np.array([IOP_PA / MODULUS_PA]))
    return float(LIBRARY.tips(*walls, np.array([force_n / MODULUS_PA]))[0])


def wall_section(
    tip_m: float,
    surface_m: float = 0.5e-3,
    lateral_m: float = 0.3e-3,
    gap_m: float = GAP_M,
) -> WallSection:
    """Section of the wall with a dent, its contact at a depth and a lateral place of
    the frame.
    """
    unknown = middling_eye(
        tip_m,
        lateral_m=lateral_m,
        depth_m=surface_m,
        gap_m=gap_m,
        thickness_m=THICKNESS_M,
        log_modulus=log(MODULUS_PA),
        log_iop=log(IOP_PA),
        shine_m=0.0,
    )
    curves = formed_wall(Walls(LIBRARY), unknown)

    return WallSection(
        *(
            curve[np.concatenate([[True], np.diff(curve[:, 0]) > 1e-9])]
            for curve in curves
        )
    )


def image(
    section: WallSection, seed: int = 1, scanner: OctStudy = STUDY.oct
) -> np.ndarray:
    """A raw frame of a section, without shadows and with little noise."""
    rng = np.random.default_rng(seed)
    return render_bscan(section, scanner, sample_optics(CLEAN, scanner, rng), rng).frame


@cache
def frame_under(force_n: float) -> np.ndarray:
    """The raw frame of the wall under a force; read-only, as tests share it."""
    frame = image(wall_section(tip_of(force_n)))
    frame.flags.writeable = False
    return frame


def recording_toml(
    eye: str,
    gap_m: float = GAP_M,
    needle: str = "",
    more: str = "",
    globe: str = 'globe = "open"',
) -> str:
    """Return the text of `recording.toml`; `needle`: other keys of [needle], `more`: of
    [oct], and sections.
    """
    return f"""
[eye]
id = "{eye}"
thickness_m = {THICKNESS_M}
iop_pa = {IOP_PA}
{globe}
[needle]
gauge = 22
slice_gap_m = {gap_m}
{needle}
[oct]
columns = {STUDY.oct.columns}
rows = {STUDY.oct.rows}
bits = {STUDY.oct.bits}
width_m = {STUDY.oct.width_m}
depth_m = {STUDY.oct.depth_m}
{more}
"""


def write_one_frame(recording: Path, text: str, force_n: float = 0.020) -> Path:
    """Write a recording of one frame, with this recording.toml; return the frame's
    path.
    """
    (recording / "frames").mkdir(parents=True)
    (recording / "recording.toml").write_text(text)
    (recording / "frames.csv").write_text("file,time_s\n1.png,1.0\n")
    cv2.imwrite(
        str(recording / "frames" / "1.png"), image(wall_section(tip_of(force_n)))
    )

    return recording / "frames" / "1.png"


COLUMNS = 256
RANGES = ReaderStudy(
    youngs_modulus_pa=Range(min=0.15e6, max=0.6e6),
    iop_pa=Range(min=100.0, max=600.0),
    thickness_m=Range(min=0.4e-3, max=0.9e-3),
    gap_m=Range(min=0.3e-3, max=1.0e-3),
)
LATERAL_M = (np.arange(COLUMNS) + 0.5 - COLUMNS / 2) * 15e-3 / COLUMNS


def middling_eye(tip_m: float, **changed: float) -> np.ndarray:
    """The unknowns of a middling eye, in an open globe."""
    values = {
        "tip_m": tip_m,
        "lateral_m": 0.4e-3,
        "depth_m": 0.5e-3,
        "gap_m": 0.6e-3,
        "thickness_m": 0.65e-3,
        "log_modulus": log(0.3e6),
        "log_iop": log(270.0),
        "shine_m": SHINE_MEAN_M,
    } | changed
    return np.array([values.get(name, 0.0) for name in unknowns.NAMES])


def drawn_wall(unknown: np.ndarray, rng: np.random.Generator) -> None:
    """Draw gap, thickness, modulus and IOP."""
    unknown[[unknowns.GAP, unknowns.THICKNESS, unknowns.MODULUS, unknowns.IOP]] = (
        rng.uniform(0.4e-3, 0.9e-3),
        rng.uniform(0.45e-3, 0.85e-3),
        log(rng.uniform(0.2e6, 0.5e6)),
        log(rng.uniform(133.0, 533.0)),
    )


def known_eye(
    unknown: np.ndarray, globe: Globe = OPEN, relative_sd: float = 0.02
) -> Setup:
    """The known values of an eye with these unknowns; the modulus is its own."""
    modulus = exp(unknown[unknowns.MODULUS])
    return Setup(
        eye=Eye(
            modulus=Modulus(mean_pa=modulus, sd_pa=relative_sd * modulus, source="own"),
            iop_pa=exp(unknown[unknowns.IOP]),
            thickness_m=unknown[unknowns.THICKNESS],
            globe=globe,
        ),
        needle=Needle(gap_m=unknown[unknowns.GAP]),
    )


def eye_of_population(mean_pa: float, sd_pa: float) -> Setup:
    """The middling eye, whose modulus is a population's."""
    modulus = Modulus(mean_pa=mean_pa, sd_pa=sd_pa, source="population")
    return changed(known_eye(middling_eye(0.0)), modulus=modulus)


BOTH = PlacesOnFrame(np.concatenate([LATERAL_M, LATERAL_M]), np.repeat([0, 1], COLUMNS))


def noisy_boundaries(
    predicted: PlacedCurves, noise_m: float, rng: np.random.Generator | None
) -> np.ndarray:
    """Boundaries at BOTH (2, column); where rng is given, with errors along the normal,
    correlated over 0.35 mm.
    """
    depth = predicted.depth_m.reshape(2, -1)
    if rng is None:
        return depth

    kernel = np.exp(-(np.linspace(-3, 3, 19) ** 2) / 2)
    kernel /= np.sqrt((kernel**2).sum())
    rough = [
        np.convolve(rng.standard_normal(COLUMNS + len(kernel) - 1), kernel, "valid")
        for _ in "oi"
    ]

    return depth + noise_m * np.array(rough) * np.sqrt(
        1 + predicted.slope.reshape(2, -1) ** 2
    )


STEEL = NeedleShaft(
    diameter_m=0.5e-3,
    gap_m=0.0,
    angle_rad=0.0,
    lean_rad=0.0,
    bevel_rad=pi / 2,
    above_m=1e-3,
    loss_fraction=1.0,
    level_db=28.0,
    far_edge_db=-6.0,
)


SCANNER = OctStudy()
OPTICS = BscanOptics(
    snr_db=22.0,
    attenuation_per_m=1000.0,
    axial_resolution_m=8e-6,
    lateral_resolution_m=32e-6,
    reflection_db=6.0,
    reflection_angle_rad=np.deg2rad(6.0),
    choroid_level_db=-8.0,
    choroid_attenuation_per_m=5000.0,
    choroid_thickness_m=180e-6,
    display_floor_db=-7.0,
    display_range_db=42.0,
    band_m=0.5e-3,
)
RADIUS_M = 12e-3


def round_wall(top_m: float, lateral_m: float) -> WallSection:
    """A wall of 0.7 mm."""
    angle = np.linspace(-1.2, 1.2, 1201)
    ray = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    middle = np.array([lateral_m, top_m + RADIUS_M])
    return WallSection(middle + RADIUS_M * ray, middle + (RADIUS_M - 0.7e-3) * ray)


def drawn_counts(
    seed: int, scanner: OctStudy = SCANNER, **optics: object
) -> np.ndarray:
    rng = np.random.default_rng(seed)
    wall = round_wall(rng.uniform(0.4e-3, 0.6e-3), rng.uniform(-0.2e-3, 0.2e-3))
    frame = render_bscan(wall, scanner, replace(OPTICS, **optics), rng).frame
    return frame.astype(np.uint8) if scanner.bits == 8 else frame


def imaged(
    counts: np.ndarray, scanner: OctStudy = SCANNER, name: str = "frame"
) -> ImagedEye:
    scale = PixelScale.of(scanner)
    wall = find_wall(counts, scale)
    assert wall.usable, wall.reason
    return ImagedEye(name, counts, scale, scanner.bits, wall)


def drawn_eyes(
    seeds: range, scanner: OctStudy = SCANNER, **optics: object
) -> list[ImagedEye]:
    return [
        imaged(drawn_counts(seed, scanner, **optics), scanner, f"frame {seed}")
        for seed in seeds
    ]


def moving(
    sections: Iterable[WallSection],
    rng: np.random.Generator,
    noise_m: float = 5e-6,
    study: Study = STUDY,
) -> list[Boundaries]:
    """Boundaries, from an ideal segmentation, of an eye that shifts by up to 0.2 mm
    between frames.
    """
    smoothing_m = study.calibration.surface_smoothing_m
    found = []
    for section in sections:
        lateral_m, depth_m = rng.uniform(-0.2e-3, 0.2e-3, 2)
        pose = Pose(
            lateral_m=0.3e-3 + lateral_m, depth_m=0.5e-3 + depth_m, tilt_rad=0.01
        )
        found.append(
            ideal_boundaries(section, pose, study.oct, noise_m, rng, smoothing_m)
        )

    return found
