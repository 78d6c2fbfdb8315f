"""What is drawn of a virtual acquisition beside its pushes, each kind from a stream of random numbers of its own.

A stream that is added leaves what the others draw as it is.
"""

from dataclasses import replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from scleraforce.laboratory.optics import (
    BscanOptics,
    Conjunctiva,
    Pose,
    sample_conjunctiva,
    sample_needle,
    sample_optics,
)
from scleraforce.laboratory.virtual_eye import PhantomEye
from scleraforce.study import Study, draw

Times = NDArray[np.float64]

OPTICS, PUSHES, SENSOR, NOISE, FRAME, DRIFT, NEEDLE, CONJUNCTIVA, TURN = range(9)  # the streams of a recording

DRIFT_S = 1.0  # in which a living eye moves from one place to another: between pulse and breath


def sample_scanner(eye: PhantomEye, study: Study, seed: int) -> tuple[BscanOptics, Pose]:
    """Draw what stays the same in a recording: the optics, and the eye's depth and tilt.

    Numbers of the needle and of the conjunctiva are streams of their own: all else is as without them.
    """
    phantom, rng = study.phantom, stream(eye, seed, OPTICS)
    scanner = replace(
        sample_optics(phantom, study.oct, rng),
        needle=sample_needle(phantom, study.needle.outer_diameter_m, eye.gap_m, stream(eye, seed, NEEDLE)),
        conjunctiva=sample_conjunctiva(phantom, stream(eye, seed, CONJUNCTIVA)),
    )
    surface_m, tilt_rad = draw(phantom.surface_depth_m, rng), draw(phantom.eye_tilt_rad, rng)
    return scanner, Pose(lateral_m=0.0, depth_m=surface_m, tilt_rad=tilt_rad)


def slid(layer: Conjunctiva | None, rng: np.random.Generator) -> Conjunctiva | None:
    """Return a conjunctiva that has moved over the wall: its waves lie elsewhere."""
    return None if layer is None else replace(layer, phase_rad=float(rng.uniform(-np.pi, np.pi)))


def draw_changes(eye: PhantomEye, study: Study, seed: int, times_s: Times) -> Times:
    """Return what changes while the needle moves, (time, 4): shift across and in depth, signal over noise, reflection.

    Independent draws every `DRIFT_S`, joined by half waves of a cosine: no value leaves the range of the draws.
    """
    rng, phantom = stream(eye, seed, DRIFT), study.phantom
    ranges = (phantom.eye_shift_m, phantom.eye_shift_m, phantom.snr_db, phantom.reflection_db)
    knots = np.array([[draw(values, rng) for values in ranges] for _ in range(int(times_s[-1] / DRIFT_S) + 2)])
    before = (times_s / DRIFT_S).astype(np.intp)
    share = (1.0 - np.cos(np.pi * (times_s / DRIFT_S - before))) / 2
    changing: Times = knots[before] + share[:, None] * (knots[before + 1] - knots[before])
    return changing


def stream_key(eye: PhantomEye, seed: int, *numbers: int) -> tuple[int, ...]:
    """Return the entropy of a stream: eyes of different names differ, also under one seed."""
    return seed, crc32(eye.id.encode()), *numbers


def stream(eye: PhantomEye, seed: int, *numbers: int) -> np.random.Generator:
    """Return the stream of random numbers of an eye with these numbers: its kind first."""
    return np.random.default_rng(stream_key(eye, seed, *numbers))
