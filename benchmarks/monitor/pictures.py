"""Raw frames of a session: an eye bent in three dimensions at finite strain, imaged
with quick random numbers.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from monitor.eyes import SessionEye, section_at
from monitor.needle_forces import Trajectory
from scleraforce.lab.drawn_bscan import render_bscan
from scleraforce.lab.tissue_light import BscanOptics, Pose, sample_optics
from scleraforce.records.study import draw

Frame = NDArray[np.uint16]

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
    """Render the frames of a trajectory, one after the other: the light swings, and
    shadows move with the eye.
    """
    phantom = drawn.study.phantom
    scanner = sample_optics(phantom, drawn.study.oct, rng)
    surface_m = draw(phantom.surface_depth_m, rng)
    noise = PooledGenerator((seed, int(rng.integers(2**31))))

    for n, force_n in enumerate(path.force_n):
        lateral_m = path.lateral_m[n]
        pose = Pose(lateral_m=lateral_m, depth_m=surface_m + path.depth_m[n])
        shadows = tuple(
            replace(shadow, centre_m=shadow.centre_m + lateral_m)
            for shadow in scanner.shadows
        )
        snr_db = scanner.snr_db + path.snr_db[n]
        optics = replace(scanner, snr_db=snr_db, shadows=shadows)
        yield _picture(drawn, float(force_n), pose, optics, noise)


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
    return _picture(drawn, force_n, pose, optics, noise)


def _picture(
    drawn: SessionEye,
    force_n: float,
    pose: Pose,
    optics: BscanOptics,
    noise: np.random.Generator,
) -> Frame:
    section = pose.place(section_at(drawn, force_n))
    return render_bscan(section, drawn.study.oct, optics, noise).frame
