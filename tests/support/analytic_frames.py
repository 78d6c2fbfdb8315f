"""Raw frames of the analytic library's walls: what a scanner would see of them."""

from dataclasses import replace
from math import log

import numpy as np
from analytic_library import analytic_library

from scleraforce.fitting.prediction import Walls, place_walls
from scleraforce.fitting.unknowns import DEPTH, GAP, IOP, LATERAL, MODULUS, NAMES, THICKNESS, TIP
from scleraforce.known.eye import OPEN, Known, Modulus
from scleraforce.laboratory.bscan import render_bscan
from scleraforce.laboratory.light import sample_optics
from scleraforce.recording.pixels import PixelScale
from scleraforce.section.plane import Section
from scleraforce.study import OctStudy, Study, fixed

LIBRARY = analytic_library()
SMALL_LIBRARY = analytic_library(thicknesses=6, ratios=7, tips=28)  # for models that each test loads anew
STUDY = Study()
CLEAN = replace(STUDY.phantom, snr_db=fixed(28.0), shadow_count=fixed(0))
SCALE = PixelScale(lateral_m=STUDY.oct.width_m / STUDY.oct.columns, depth_m=STUDY.oct.depth_m / STUDY.oct.rows)
MODULUS_PA, IOP_PA, THICKNESS_M, GAP_M = 0.3e6, 270.0, 0.65e-3, 0.6e-3
KNOWN = Known(
    modulus=Modulus(mean_pa=MODULUS_PA, sd_pa=0.01 * MODULUS_PA, source="own"),
    iop_pa=IOP_PA,
    thickness_m=THICKNESS_M,
    gap_m=GAP_M,
    globe=OPEN,
)


def tip_of(force_n: float, thickness_m: float = THICKNESS_M) -> float:
    """Dent of the wall under a force."""
    walls = (np.array([thickness_m]), np.array([IOP_PA / MODULUS_PA]))
    return float(LIBRARY.tips(*walls, np.array([force_n / MODULUS_PA]))[0])


def wall_section(
    tip_m: float, surface_m: float = 0.5e-3, lateral_m: float = 0.3e-3, thickness_m: float = THICKNESS_M
) -> Section:
    """Section of the wall with a dent, its contact at a depth and a lateral place of the frame."""
    unknown = np.zeros(len(NAMES))
    unknown[[TIP, LATERAL, DEPTH, GAP, THICKNESS]] = tip_m, lateral_m, surface_m, GAP_M, thickness_m
    unknown[[MODULUS, IOP]] = log(MODULUS_PA), log(IOP_PA)
    curves = place_walls(Walls(LIBRARY), unknown[None])[0]
    return Section(*(curve[np.concatenate([[True], np.diff(curve[:, 0]) > 1e-9])] for curve in curves))


def image(section: Section, seed: int = 1, scanner: OctStudy = STUDY.oct) -> np.ndarray:
    """A raw frame of a section, without shadows and with little noise."""
    rng = np.random.default_rng(seed)
    return render_bscan(section, scanner, sample_optics(CLEAN, scanner, rng), rng).frame


def recording_toml(
    eye: str, gap_m: float = GAP_M, needle: str = "", more: str = "", globe: str = 'globe = "open"'
) -> str:
    """What `recording.toml` states of such frames; `needle`: other keys of [needle], `more`: of [oct], and sections."""
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
