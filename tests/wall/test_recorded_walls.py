"""Walls in every kind of frame against `walls.json`, recorded from an implementation by
NumPy and OpenCV.

That one is in the history: `git show e25d375a:tests/oracles/wall_arrays.py`. After a
change that is meant to move walls, run this file.
"""

import json
from collections.abc import Iterator
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from analytic_frames import STEEL
from poses import sample_pose

from dented_walls import dented_wall
from scleraforce.lab.drawn_bscan import draw_shaft, render_bscan
from scleraforce.lab.tissue_light import Pose, sample_optics
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.records.frame import Pixels
from scleraforce.records.scan import PixelScale
from scleraforce.records.study import OctStudy, Study
from scleraforce.wall.find_wall import find_wall
from scleraforce.wall.wall import Segmentation

STUDY = Study()
SCALE = PixelScale.of(STUDY.oct)
RECORD = Path(__file__).with_name("walls.json")
NOISE = "the signal is too weak"
SCANNERS = (512, 512), (300, 700), (1024, 64), (400, 191), (383, 192), (777, 1001)
ROWS = 2e-3  # that boundaries may differ by: sums of products are rounded another way
COLUMNS = 24  # that are recorded


def draw_frames(count: int) -> list[Pixels]:
    """Return frames of spherical walls with dents of 0 to 3 mm."""
    rng = np.random.default_rng(0)
    lateral = np.linspace(-8.5e-3, 8.5e-3, 800)
    frames = []

    for dent_m in np.linspace(0.0, 3e-3, count):
        depth = (
            12e-3
            - np.sqrt(12e-3**2 - lateral**2)
            + dent_m * np.exp(-(lateral**2) / (2 * 1.6e-3**2))
        )
        outer = np.stack([lateral, depth], axis=1)
        section = WallSection(
            outer, outer + np.array([0.0, rng.uniform(0.4e-3, 0.9e-3)])
        )
        optics = sample_optics(STUDY.phantom, STUDY.oct, rng)
        frames.append(
            render_bscan(
                sample_pose(STUDY.phantom, rng).place(section), STUDY.oct, optics, rng
            ).frame
        )

    return frames


def needle_frame(angle_deg: float) -> Pixels:
    shaft = replace(STEEL, diameter_m=0.3e-3, angle_rad=radians(angle_deg))
    rng = np.random.default_rng(0)
    drawn = replace(
        sample_optics(STUDY.phantom, STUDY.oct, rng), snr_db=25.0, shadows=()
    )
    needle = draw_shaft(shaft, np.array([0.2e-3, 1.5e-3]), 0.0, STUDY.oct)
    placed = Pose(lateral_m=0.2e-3, depth_m=0.5e-3).place(
        dented_wall(0.7e-3, 1.0e-3, 1.2e-3)
    )

    return render_bscan(placed, STUDY.oct, drawn, rng, needle).frame


def hostile_frames(frame: Pixels) -> Iterator[Pixels]:
    rng = np.random.default_rng(0)
    yield np.zeros((512, 512), np.uint16)
    yield np.full((512, 512), 65535, np.uint16)
    yield np.minimum(frame.astype(np.uint32) * 40, 65535).astype(np.uint16)
    yield rng.integers(0, 900, (512, 512)).astype(np.uint16)
    yield rng.integers(0, 65536, (16, 16)).astype(np.uint16)
    # one column
    yield np.where(np.arange(512) == 200, 4000, 0).astype(np.uint16) + np.zeros(
        (512, 1), np.uint16
    )
    # missing columns
    yield np.where(np.arange(512) % 9 == 4, 0, frame).astype(np.uint16)
    yield np.where(np.arange(512) < 111, 0, frame).astype(np.uint16)  # a black band
    yield from (np.asfortranarray(frame), frame[::-1], frame[:, ::2])


def layered_frame(seed: int) -> Pixels:
    rng = np.random.default_rng(seed)
    rows, columns, layers = rng.integers((16, 16, 0), (420, 420, 5)).tolist()
    frame = rng.integers(0, 400, (rows, columns))
    for _ in range(layers):
        top = int(rng.integers(0, rows))
        frame[top : top + int(rng.integers(1, rows))] += int(rng.integers(0, 8000))

    return frame.astype(np.uint16)


def frames_of_scanners() -> Iterator[tuple[Pixels, PixelScale]]:
    for rows, columns in SCANNERS:
        scanner = OctStudy(
            width_m=9e-3,
            depth_m=5e-3,
            rows=rows,
            columns=columns,
            refractive_index=1.38,
        )
        rng = np.random.default_rng(1)
        placed = Pose(lateral_m=0.0, depth_m=0.9e-3).place(dented_wall(0.7e-3, 0.8e-3))
        optics = sample_optics(STUDY.phantom, scanner, rng)
        yield render_bscan(placed, scanner, optics, rng).frame, PixelScale.of(scanner)


KINDS = {
    "phantoms": lambda: draw_frames(16),
    "bytes": lambda: ((frame >> 4).astype(np.uint8) for frame in draw_frames(6)),
    "needles": lambda: map(needle_frame, (-35.0, 0.0, 20.0)),
    "scanners": frames_of_scanners,
    "hostile": lambda: hostile_frames(draw_frames(2)[1]),
    "layers": lambda: map(layered_frame, range(60)),
}


def frames(kind: str) -> Iterator[tuple[Pixels, PixelScale]]:
    return (
        each if isinstance(each, tuple) else (each, SCALE) for each in KINDS[kind]()
    )


def shown(found: Segmentation) -> dict[str, Any]:
    """Return the record of a wall; in noise two paths may be equally good, and only the
    verdict is recorded.
    """
    verdict = {"usable": found.usable, "reason": found.reason.split(":")[0]}
    if found.reason.startswith(NOISE):
        return verdict

    columns = np.linspace(0, len(found.outer_row) - 1, COLUMNS).astype(int)
    rows = [
        np.round(np.nan_to_num(boundary[columns], nan=-99.0), 4).tolist()
        for boundary in (found.outer_row, found.inner_row)
    ]
    hidden = None if found.needle is None else list(found.needle.hidden)

    return verdict | {"inner_found": found.inner_found, "hidden": hidden, "rows": rows}


@pytest.mark.parametrize("kind", KINDS)
def test_walls_are_the_recorded_ones(kind: str):
    record = json.loads(RECORD.read_text())[kind]
    for (frame, scale), expected in zip(frames(kind), record, strict=True):
        found = shown(find_wall(frame, scale))
        rows = found.pop("rows", []), expected.pop("rows", [])
        assert found == expected
        np.testing.assert_allclose(*rows, rtol=0.0, atol=ROWS)


if __name__ == "__main__":
    walls = {kind: [shown(find_wall(*each)) for each in frames(kind)] for kind in KINDS}
    RECORD.write_text(json.dumps(walls, indent=0) + "\n")
