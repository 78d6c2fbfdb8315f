"""Frames of a round eye at rest, drawn with given optics: what a scanner is measured on in tests."""

from dataclasses import replace

import numpy as np

from scleraforce.laboratory.bscan import render_bscan
from scleraforce.laboratory.light import BscanOptics
from scleraforce.recording.pixels import PixelScale
from scleraforce.scanner.imaged_eye import ImagedEye
from scleraforce.section.plane import Section
from scleraforce.segmentation.wall import find_wall
from scleraforce.study import OctStudy

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


def round_wall(top_m: float, lateral_m: float, thickness_m: float = 0.7e-3) -> Section:
    angle = np.linspace(-1.2, 1.2, 1201)
    ray = np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    middle = np.array([lateral_m, top_m + RADIUS_M])
    return Section(middle + RADIUS_M * ray, middle + (RADIUS_M - thickness_m) * ray)


def drawn_counts(seed: int, scanner: OctStudy = SCANNER, **optics: object) -> np.ndarray:
    rng = np.random.default_rng(seed)
    wall = round_wall(rng.uniform(0.4e-3, 0.6e-3), rng.uniform(-0.2e-3, 0.2e-3))
    frame = render_bscan(wall, scanner, replace(OPTICS, **optics), rng).frame
    return frame.astype(np.uint8) if scanner.bits == 8 else frame


def imaged(counts: np.ndarray, scanner: OctStudy = SCANNER, name: str = "frame") -> ImagedEye:
    scale = PixelScale(
        lateral_m=scanner.width_m / scanner.columns,
        depth_m=scanner.depth_m / scanner.rows,
        refractive_index=scanner.refractive_index,
    )
    wall = find_wall(counts, scale)
    assert wall.usable, wall.reason
    return ImagedEye(name, counts, scale, scanner.bits, wall, wall.inner_found)


def drawn_eyes(seeds: range, scanner: OctStudy = SCANNER, **optics: object) -> list[ImagedEye]:
    return [imaged(drawn_counts(seed, scanner, **optics), scanner, f"frame {seed}") for seed in seeds]
