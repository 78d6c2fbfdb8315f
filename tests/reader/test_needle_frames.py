"""Frames that a needle crosses: the fit reads them from both sides, the network says that it cannot."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import CLEAN, GAP_M, KNOWN, SCALE, STEEL, STUDY, image, tip_of, wall_section
from small_models import FIVE_MN, force_reader

from scleraforce.laboratory.bscan import draw_shaft, render_bscan
from scleraforce.laboratory.light import sample_optics
from scleraforce.library.unknowns import GAP
from scleraforce.reader import intervals, load_model
from scleraforce.segmentation.wall import find_wall

FORCE_N = 0.02
SHAFT = replace(STEEL, angle_rad=0.3, above_m=0.5e-3)
NEAR = replace(KNOWN, gap_m=0.1e-3)


@pytest.fixture(scope="module")
def crossed(monkeypatch_module: pytest.MonkeyPatch) -> np.ndarray:
    """A frame 0.1 mm beside the axis of a needle that crosses it, at 20 mN."""
    monkeypatch_module.setattr("analytic_frames.GAP_M", NEAR.gap_m)
    section = wall_section(tip_of(FORCE_N))
    middle = int(np.abs(section.outer[:, 0] - 0.3e-3).argmin())
    shaft = draw_shaft(SHAFT, section.outer[middle], 0.0, STUDY.oct)
    rng = np.random.default_rng(1)
    return render_bscan(section, STUDY.oct, sample_optics(CLEAN, STUDY.oct, rng), rng, shaft).frame


@pytest.fixture(scope="module")
def monkeypatch_module() -> "pytest.MonkeyPatch":
    with pytest.MonkeyPatch.context() as patch:
        yield patch


@pytest.mark.parametrize("default", ["fit", "network"])
def test_the_fit_reads_the_wall_beside_a_needle_alone(crossed: np.ndarray, default: str) -> None:
    reader = force_reader(default=default)
    answer = reader.read(crossed, SCALE, NEAR)
    assert answer.usable, answer.reason
    assert answer.needle is not None
    assert answer.needle.angle_rad == pytest.approx(0.3, abs=0.05)
    assert answer.force_n == pytest.approx(FORCE_N, rel=0.05)
    assert [name for name, _ in answer.readings] == ["fit"]
    assert "the fit alone reads it" in answer.warnings[0]
    assert not reader._network.shown


def test_in_the_loop_a_frame_with_a_needle_is_not_usable_and_says_why(crossed: np.ndarray) -> None:
    known = replace(NEAR, gap_m=0.32e-3)  # the network was trained on such gaps
    live = force_reader(FIVE_MN).read_live(crossed, SCALE, known)
    assert not live.usable
    assert "a needle hides a part of the wall" in live.reason
    assert live.needle is not None
    assert np.isnan(live.segmentation.outer_row[slice(*live.needle.hidden)]).all()
    near = force_reader(FIVE_MN).read_live(crossed, SCALE, NEAR)
    assert near.reason == "gap between B-scan and needle axis 0.1 mm, the model was trained on 0.3 to 1 mm"


def test_a_needle_far_from_where_the_plane_is_said_to_be_is_not_read(crossed: np.ndarray) -> None:
    answer = force_reader().read(crossed, SCALE, replace(NEAR, gap_m=0.8e-3))
    assert not answer.usable
    assert answer.reason.startswith("a needle is seen, although the B-scan is said to pass 0.8 mm from its axis")
    assert answer.needle is not None


def test_a_classifier_withdraws_from_a_needle_in_the_picture(crossed: np.ndarray, write_model, tmp_path: Path) -> None:
    model = load_model(write_model(tmp_path / "model", STUDY).path)
    for answer in (model.read(crossed, SCALE, NEAR), model.read_live(crossed, SCALE, NEAR)):
        assert (answer.usable, answer.predicted) == (False, 2)
        assert "a needle hides a part of the wall" in answer.reason
        assert answer.needle is not None
    assert model.read(image(wall_section(tip_of(FORCE_N))), SCALE, KNOWN).usable


def test_a_gap_that_is_not_told_is_taken_from_the_needle_that_is_seen(crossed: np.ndarray) -> None:
    answer = force_reader().read(crossed, SCALE, replace(NEAR, gap_m=None))
    assert answer.usable, answer.reason
    low_n, high_n = answer.interval_n
    assert low_n < FORCE_N < high_n
    assert answer.fit.unknown[GAP] < 0.35e-3  # the needle's radius; trained was 0.3 to 1 mm


def test_a_frame_without_a_needle_is_read_by_both_methods_as_before() -> None:
    answer = force_reader().read(image(wall_section(tip_of(FORCE_N))), SCALE, replace(KNOWN, gap_m=GAP_M))
    assert answer.needle is None
    assert [name for name, _ in answer.readings] == ["network", "fit"]


def test_the_fits_interval_is_as_much_wider_as_was_measured_beside_a_needle_or_under_a_conjunctiva(
    crossed: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    widths = []
    for stretch in (1.0, 1.5):
        monkeypatch.setattr(intervals, "NEEDLE_STRETCH", stretch)
        widths.append(dict(force_reader().read(crossed, SCALE, NEAR).readings)["fit"].width_n)
    assert widths[1] == pytest.approx(1.5 * widths[0])
    wall = find_wall(crossed, SCALE)
    trained = STUDY.reader
    both = intervals.frame_stretch(replace(wall, conjunctiva_m=1e-4), NEAR, trained)
    assert both == pytest.approx(1.5 * intervals.CONJUNCTIVA_STRETCH)
    unseen = replace(wall, needle=None)
    assert intervals.frame_stretch(unseen, NEAR, trained) == 1.5  # as near, it is there all the same
    for far in (replace(NEAR, gap_m=0.4e-3), replace(NEAR, gap_m=None)):
        assert intervals.frame_stretch(unseen, far, trained) == 1.0
