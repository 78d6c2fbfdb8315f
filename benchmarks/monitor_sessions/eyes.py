"""The eyes of the sessions: their kinds, and which of them a reader may meet."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import radians

import numpy as np

from scleraforce.base.units import to_si
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.needle import Needle
from scleraforce.records.setup import Setup
from scleraforce.records.study import GlobeStudy, ReaderStudy, Study

RIGIDITIES = (to_si(0.01, "mmhg13_per_ul"), to_si(0.05, "mmhg13_per_ul"))
THICKNESSES_M = (0.45e-3, 0.85e-3)
GAPS_M = (0.4e-3, 0.9e-3)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of eyes: the ends of their modulus and pressure, and their globe."""

    words: str
    modulus_pa: tuple[float, float]
    iop_pa: tuple[float, float]
    sealed: bool


KINDS: Mapping[str, Kind] = {
    "open": Kind(
        words="open", modulus_pa=(0.22e6, 0.5e6), iop_pa=(150.0, 500.0), sealed=False
    ),
    "sealed": Kind(
        words="the same walls, sealed",
        modulus_pa=(0.22e6, 0.5e6),
        iop_pa=(150.0, 500.0),
        sealed=True,
    ),
    "living": Kind(
        words="living: 1 to 2 MPa, 10 to 25 mmHg, sealed",
        modulus_pa=(1e6, 2e6),
        iop_pa=(to_si(10.0, "mmhg"), to_si(25.0, "mmhg")),
        sealed=True,
    ),
}


@dataclass(frozen=True)
class SessionEye:
    """An eye, and the study with its globe."""

    setup: Setup
    study: Study


def may_meet(kind: str, trained: ReaderStudy) -> bool:
    """Return whether all eyes of a kind lie within what a reader was trained on."""
    eyes = KINDS[kind]
    ranges = (
        (eyes.modulus_pa, trained.youngs_modulus_pa.bounds),
        (eyes.iop_pa, trained.iop_pa.bounds),
        (THICKNESSES_M, trained.thickness_m.bounds),
        (GAPS_M, trained.gap_m.bounds),
    )

    return all(within[0] <= low and high <= within[1] for (low, high), within in ranges)


def draw_eye(kind: str, number: int, study: Study, seed: int) -> SessionEye:
    """Draw an eye whose wall reaches 45 mN within the scanner's depth; open and sealed
    ones have the same walls.
    """
    rng = np.random.default_rng((seed, 1, number))
    of = KINDS[kind]
    setup = Setup(
        eye=Eye(
            f"{kind}-{number}",
            thickness_m=rng.uniform(*THICKNESSES_M),
            modulus=Modulus.stated(rng.uniform(*of.modulus_pa)),
            iop_pa=rng.uniform(*of.iop_pa),
        ),
        needle=Needle(
            gap_m=rng.uniform(*GAPS_M), polar_rad=radians(rng.uniform(25.0, 45.0))
        ),
    )
    globe = (
        GlobeStudy("sealed", rng.uniform(*RIGIDITIES))
        if of.sealed
        else GlobeStudy("open")
    )

    return SessionEye(setup, replace(study, globe=globe))
