"""Inputs of the benchmarks in tests: a reader that knows one force, a recording and a
coarse study.
"""

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from analytic_frames import (
    GAP_M,
    IOP_PA,
    LIBRARY,
    MODULUS_PA,
    THICKNESS_M,
    image,
    recording_toml,
    tip_of,
    wall_section,
)
from small_models import write_fixed_reader

from scleraforce.recordings.recording_writer import RecordingWriter
from scleraforce.records.decoder import parse_record
from scleraforce.records.recording_info import RecordingInfo
from speed.lock import alone as alone_on_this_machine

BINS = 64
BIN = 20
FRAMES = 150
FORCE_N = 8e-3
COARSE_STUDY = """
[mesh]
divisions = 4
level = 0
core = 2
rings = 6

[library]
thicknesses = 4
tension = { min = 1e-3, max = 0.21 }
tensions = 4
tips = 12
elements = 16
"""


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A reader whose network always says the same small force, and a recording of a
    wall under such a force.
    """
    pytest.importorskip("torch")
    folder = tmp_path_factory.mktemp("benchmark")
    write_fixed_reader(
        folder / "reader", LIBRARY, [float(number == BIN) for number in range(BINS)]
    )
    wall = wall_section(tip_of(FORCE_N))
    # no scanner shows a picture again
    shown = [image(wall, seed) for seed in range(FRAMES)]
    info = parse_record(
        RecordingInfo,
        recording_toml("mine", needle="polar_angle_rad = 0.6", globe=""),
        "a test",
    )
    writer = RecordingWriter(folder / "eye", info, "Of a test.")

    for number in range(FRAMES):
        writer.add(f"{number:04}.png", 0.01 * number, shown[number])

    writer.close()
    eye = {
        "thickness_m": THICKNESS_M,
        "iop_pa": IOP_PA,
        "youngs_modulus_pa": MODULUS_PA,
        "gap_m": GAP_M,
    }
    frames = [
        {"file": f"{number:04}.png", "force_n": FORCE_N} for number in range(FRAMES)
    ]
    truth = {
        "eye": {**eye, "polar_rad": 0.6},
        "globe": {"kind": "open"},
        "frames": frames,
    }
    (folder / "eye" / "truth.json").write_text(json.dumps(truth))

    return folder


@pytest.fixture(scope="session")
def study_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study on coarse meshes, with a coarse library and a few slices."""
    path = tmp_path_factory.mktemp("study") / "study.toml"
    path.write_text(COARSE_STUDY)
    return path


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment whose cache of libraries is a test's own."""
    return {**os.environ, "XDG_CACHE_HOME": str(tmp_path_factory.mktemp("cache"))}


@pytest.fixture
def alone() -> Iterator[None]:
    """Two monitors that run in real time would keep each other from their core."""
    with alone_on_this_machine():
        yield
