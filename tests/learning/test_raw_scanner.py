"""A study that `scanner` measured is what the raw reader's frames are drawn by."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_library import analytic_library

from scleraforce.cli.main import run
from scleraforce.learning.raw_reader import RawSource, draw_optics
from scleraforce.study import Study, fixed, read_study


@pytest.mark.slow
def test_frames_of_a_measured_scanner_are_drawn_by_its_ranges(tmp_path: Path) -> None:
    rest, measured = tmp_path / "rest", tmp_path / "measured.toml"
    assert run(["phantom", "--out", str(rest), "--forces-mn", "0,0,0"]) == 0
    frames = sorted(str(path) for path in (rest / "frames").glob("*.png"))
    assert run(["scanner", *frames, "--out", str(measured)]) == 0
    study = read_study(measured)
    assert study.phantom != Study().phantom
    alone = replace(study.raw_reader, snr_loss_db=fixed(0.0), speckle_factor=fixed(1.0))
    study = replace(study, raw_reader=alone)
    drawn = [draw_optics(study, None, np.random.default_rng(seed)) for seed in range(50)]
    for name in (
        "snr_db",
        "axial_resolution_m",
        "lateral_resolution_m",
        "display_floor_db",
        "display_range_db",
        "band_m",
    ):
        low, high = getattr(study.phantom, name).bounds
        assert all(low <= getattr(each, name) <= high for each in drawn), name
    library = analytic_library(thicknesses=5, ratios=5, tips=24)
    assert np.isfinite(RawSource.of(library, study).chunk(1, 8).frames).all()


def test_a_linear_display_is_drawn_where_the_phantom_has_one() -> None:
    linear = replace(Study(), phantom=replace(Study().phantom, display="linear"))
    assert draw_optics(linear, None, np.random.default_rng(1)).display == "linear"
    library = analytic_library(thicknesses=5, ratios=5, tips=24)
    frames = [RawSource.of(library, study).chunk(1, 20).frames for study in (Study(), linear)]
    walls = [each[(each > 0.3) & (each < 0.9)].size / each.size for each in frames]
    assert abs(walls[1] - walls[0]) > 0.02  # dim tissue is dark on a linear display
