"""Real scans of eyes at rest and the bundled reader: no force is ever read in them at the scales that they may have.

At a scale that is far from theirs some are read (docs/wall_finder.md): a limit, which nothing here hides.
"""

from pathlib import Path

import pytest

from scleraforce.known import Known, Modulus, known_globe
from scleraforce.reader.kinds import ForceReader
from scleraforce.reader.model import load_model
from scleraforce.recording.folder import Scanner, read_scaled_frame
from scleraforce.recording.pixels import PixelScale

REAL = Path(__file__).parents[3] / "shared" / "real-oct"
SCANS = sorted((REAL / "anterior-segment").glob("*.jp*g")) + sorted((REAL / "dicom").glob("*.dcm"))
STATED = Known(
    modulus=Modulus.stated(0.3e6), iop_pa=400.0, thickness_m=600e-6, gap_m=0.5e-3, globe=known_globe("sealed")
)
WIDTH_M, DEPTH_M, PIXEL_M = 15e-3, 4e-3, 5e-6
pytestmark = [pytest.mark.real, pytest.mark.skipif(not SCANS, reason="../shared is absent")]


@pytest.fixture(scope="module")
def shipped() -> ForceReader:
    assert len(SCANS) == 17
    reader = load_model("default")
    assert isinstance(reader, ForceReader)
    return reader


@pytest.mark.slow
@pytest.mark.parametrize("known", [Known(), STATED], ids=["unknown", "stated"])
@pytest.mark.parametrize("path", SCANS, ids=lambda path: path.stem)
def test_a_real_eye_at_rest_is_never_read_as_a_force(shipped: ForceReader, path: Path, known: Known) -> None:
    assumed = Scanner(width_m=WIDTH_M, depth_m=DEPTH_M, refractive_index=1.0)
    pixels = read_scaled_frame(path, assumed, (Scanner(), "")).pixels
    rows, columns = pixels.shape
    wide_m = WIDTH_M / columns
    for lateral_m, depth_m in ((PIXEL_M, PIXEL_M), (wide_m, DEPTH_M / rows), (wide_m, wide_m)):
        found = shipped.read(pixels, PixelScale(lateral_m=lateral_m, depth_m=depth_m), known)
        assert (found.usable, found.predicted, found.force_n) == (False, 2, None), found.reason
