"""Raw frames of a session: an eye bent in three dimensions at finite strain, imaged
with quick random numbers.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from figures.eyes import FigureEye
from figures.sections import compute_eye
from monitor_sessions.eyes import SessionEye
from monitor_sessions.forces import PATH_N, Trajectory
from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.tissue_light import BscanOptics, Pose, sample_optics
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.study import draw

Floats = NDArray[np.float64]
Frame = NDArray[np.uint16]

STATES = 128
POOL = 1536


class PooledGenerator(np.random.Generator):
    """Random numbers of which the normal ones are windows of a pool, at random
    places.
    """

    def __init__(self, seed: tuple[int, ...]) -> None:
        super().__init__(np.random.PCG64(np.random.SeedSequence(seed)))

    def standard_normal(self, size, dtype=np.float32, out=None):  # type: ignore[no-untyped-def, override] # noqa: ARG002
        """Return a window, (rows, columns, 2) of float32."""
        top = self.integers(0, POOL - size[0])
        left = self.integers(0, POOL - size[1])
        return _pool()[top : top + size[0], left : left + size[1]]


@cache
def _pool() -> NDArray[np.float32]:
    """Return independent normal numbers, (row, column, 2)."""
    return np.random.default_rng(20_26).standard_normal(
        (POOL, POOL, 2), dtype=np.float32
    )


def stream(
    drawn: SessionEye, path: Trajectory, rng: np.random.Generator, seed: int
) -> Iterator[Frame]:
    """Render the frames of a trajectory, one after the other."""
    study = drawn.study
    states = _states(drawn)
    scanner = sample_optics(study.phantom, study.oct, rng)
    surface_m = draw(study.phantom.surface_depth_m, rng)
    pooled = PooledGenerator((seed, int(rng.integers(2**31))))

    for n, force_n in enumerate(path.force_n):
        pose = Pose(lateral_m=path.lateral_m[n], depth_m=surface_m + path.depth_m[n])
        section = pose.place(_section_at(states, float(force_n)))
        yield render_bscan(
            section, study.oct, _optics_at(scanner, path, n), pooled
        ).frame


def still_frame(
    drawn: SessionEye,
    force_n: float,
    rng: np.random.Generator,
    noise: np.random.Generator,
) -> Frame:
    """Render one frame of an eye that is held at a force, with optics and a place of
    its own.
    """
    study = drawn.study
    optics = sample_optics(study.phantom, study.oct, rng)
    pose = Pose(
        lateral_m=rng.uniform(-2e-4, 2e-4),
        depth_m=draw(study.phantom.surface_depth_m, rng),
    )
    section = pose.place(_section_at(_states(drawn), force_n))

    return render_bscan(section, study.oct, optics, noise).frame


def largest_force_n(drawn: SessionEye) -> float:
    """Return the force up to which an eye is played: `PATH_N`, or what a wall bears
    that gives way before.
    """
    return float(_states(drawn)[0][-1])


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
    sections = computed.sections_at([float(force) for force in forces_n])
    return forces_n, np.stack([[section.outer, section.inner] for section in sections])


def _section_at(states: tuple[Floats, Floats], force_n: float) -> WallSection:
    """Interpolate an eye's section between the forces beside."""
    forces_n, curves_sbnc = states
    after = int(np.clip(np.searchsorted(forces_n, force_n), 1, len(forces_n) - 1))
    share = (force_n - forces_n[after - 1]) / (forces_n[after] - forces_n[after - 1])
    return WallSection(
        *((1.0 - share) * curves_sbnc[after - 1] + share * curves_sbnc[after])
    )


def _optics_at(scanner: BscanOptics, path: Trajectory, n: int) -> BscanOptics:
    """Return the optics of a frame: the light swings, and shadows move with the eye."""
    shadows = tuple(
        replace(shadow, centre_m=shadow.centre_m + path.lateral_m[n])
        for shadow in scanner.shadows
    )
    return replace(scanner, snr_db=scanner.snr_db + path.snr_db[n], shadows=shadows)
