"""Real scans of eyes at rest and of tissue, and the bundled reader: no force is read in
them at their possible scales.

At a scale far from theirs some are read (docs/wall_finder.md): a limit, which nothing
here hides.
"""

from pathlib import Path

import pytest

from scleraforce.reading.load_model import load_force_reader
from scleraforce.reading.reading_models import ForceReader
from scleraforce.recordings.recording_folder import open_frame, recorded_file
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import Globe
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale, Scan
from scleraforce.records.setup import Setup

REAL = Path(__file__).parents[3] / "shared" / "real-oct"
EYES = sorted((REAL / "anterior-segment").glob("*.jp*g")) + sorted(
    (REAL / "dicom").glob("*.dcm")
)
TISSUE = [
    path
    for path in sorted((REAL / "tissue-surface").glob("*.tif"))
    if "mask" not in path.name
]
STATED = Setup(
    eye=Eye(
        modulus=Modulus.stated(0.3e6),
        iop_pa=400.0,
        thickness_m=600e-6,
        globe=Globe.declared("sealed"),
    ),
    needle=Needle(gap_m=0.5e-3),
)
WIDTH_M = 15e-3
DEPTH_M = 4e-3
PIXEL_M = 5e-6
pytestmark = [
    pytest.mark.real,
    pytest.mark.skipif(not EYES, reason="../shared is absent"),
]


@pytest.fixture(scope="module")
def shipped() -> ForceReader:
    assert (len(EYES), len(TISSUE)) == (17, 9)
    return load_force_reader("default")


def cases() -> list[object]:
    """A scan of each kind with known values, by default; the others, and scans of
    unknown eyes, are slow.
    """
    return [
        pytest.param(
            path,
            known,
            id=f"{path.stem}-{name}",
            marks=[pytest.mark.slow] * (slow or name == "unknown"),
        )
        for name, known in (("stated", STATED), ("unknown", Setup()))
        for paths in (EYES, TISSUE)
        for path, slow in zip(paths, [False] + [True] * len(paths), strict=False)
    ]


@pytest.mark.parametrize(("path", "setup"), cases())
def test_a_real_scan_without_a_needle_is_never_read_as_a_force(
    shipped, path: Path, setup: Setup
):
    stated = Scan(width_m=WIDTH_M, depth_m=DEPTH_M, refractive_index=1.0)
    pixels = open_frame(recorded_file(path), stated, Scan(), "assumed").pixels
    rows, columns = pixels.shape
    wide_m = WIDTH_M / columns

    for lateral_m, depth_m in (
        (PIXEL_M, PIXEL_M),
        (wide_m, DEPTH_M / rows),
        (wide_m, wide_m),
    ):
        found = shipped.read(
            pixels, PixelScale(lateral_m=lateral_m, depth_m=depth_m), setup
        )
        assert (found.usable, found.predicted, found.force_n) == (
            False,
            2,
            None,
        ), found.reason
