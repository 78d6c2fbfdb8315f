"""The eyes of the sessions: their kinds, and their sections under any force."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from math import radians

import numpy as np

from figures.eyes import FigureEye
from figures.sections import compute_eye
from scleraforce.base.arrays import Floats
from scleraforce.base.units import to_si
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import GlobeStudy, Study

RIGIDITIES = (to_si(0.01, "mmhg13_per_ul"), to_si(0.05, "mmhg13_per_ul"))
THICKNESSES_M = (0.45e-3, 0.85e-3)
GAPS_M = (0.4e-3, 0.9e-3)
PATH_N = 45e-3
STATES = 128


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of eyes: the shipped model that was trained for it, the ends of their
    modulus and pressure, and their globe.
    """

    words: str
    model: str = "default"
    modulus_pa: tuple[float, float] = (0.22e6, 0.5e6)
    iop_pa: tuple[float, float] = (150.0, 500.0)
    sealed: bool = True


KINDS: Mapping[str, Kind] = {
    "open": Kind(words="open", sealed=False),
    "sealed": Kind(words="the same walls, sealed"),
    "living": Kind(
        words="living: 1 to 2 MPa, 10 to 25 mmHg, sealed",
        model="living",
        modulus_pa=(1e6, 2e6),
        iop_pa=(to_si(10.0, "mmhg"), to_si(25.0, "mmhg")),
    ),
}


@dataclass(frozen=True)
class SessionEye:
    """An eye, and the study with its globe."""

    setup: Setup
    study: Study


def draw_eye(kind: str, number: int, study: Study, seed: int) -> SessionEye:
    """Draw an eye whose wall reaches 45 mN within the scanner's depth; open and sealed
    ones have the same walls.
    """
    rng = np.random.default_rng((seed, 1, number))
    eyes = KINDS[kind]
    setup = Setup(
        eye=Eye(
            f"{kind}-{number}",
            thickness_m=rng.uniform(*THICKNESSES_M),
            modulus=Modulus.stated(rng.uniform(*eyes.modulus_pa)),
            iop_pa=rng.uniform(*eyes.iop_pa),
        ),
        needle=Needle(
            gap_m=rng.uniform(*GAPS_M), polar_rad=radians(rng.uniform(25.0, 45.0))
        ),
    )
    sealed = GlobeStudy("sealed", rng.uniform(*RIGIDITIES)) if eyes.sealed else None
    return SessionEye(setup, replace(study, globe=sealed or GlobeStudy("open")))


def largest_force_n(drawn: SessionEye) -> float:
    """Return the force up to which an eye is played: `PATH_N`, or what a wall bears
    that gives way before.
    """
    return float(_states(drawn)[0][-1])


def section_at(drawn: SessionEye, force_n: float) -> WallSection:
    """Interpolate an eye's section between the computed forces."""
    forces_n, curves_sbnc = _states(drawn)
    after = int(np.clip(np.searchsorted(forces_n, force_n), 1, len(forces_n) - 1))
    share = (force_n - forces_n[after - 1]) / (forces_n[after] - forces_n[after - 1])
    return WallSection(
        *((1.0 - share) * curves_sbnc[after - 1] + share * curves_sbnc[after])
    )


@lru_cache(maxsize=1)
def _states(drawn: SessionEye) -> tuple[Floats, Floats]:
    """Return forces (state,) and both boundaries there (state, boundary, point, 2), m;
    points are of the material.
    """
    study = replace(drawn.study, needle=replace(drawn.study.needle, max_force_n=PATH_N))
    computed = compute_eye(
        FigureEye(eye_name(drawn.setup), drawn.setup, study, shares=(), seed=0)
    )
    forces_n = computed.largest_n * np.linspace(0.0, 1.0, STATES) ** 1.3
    sections = computed.sections_at(forces_n.tolist())
    return forces_n, np.stack([[section.outer, section.inner] for section in sections])
