"""The figures show their numbers."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from foreign_files import with_log
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from small_recordings import evaluation_of, frame_answer, looked_at_frames, refused_frame, write_small_recording

from scleraforce.errors import InputError
from scleraforce.mechanics.contact import Section
from scleraforce.models import SHIPPED_WALL_FINDER
from scleraforce.notebook.frames import finder_of, segmented
from scleraforce.reader.metrics import dice
from scleraforce.recording.folder import Recording, Scanner, read_recording
from scleraforce.recording.labels import Trial
from scleraforce.report.files import write_figure
from scleraforce.report.frame_figures import (
    MOST,
    WALLS,
    WORST,
    draw_read_forces,
    draw_sheet,
    laid_on_surface,
    sheet_frame,
    shown_on_sheet,
)
from scleraforce.report.recording_figures import draw_log


def test_a_read_force_is_drawn_over_the_measured_one_with_its_interval() -> None:
    read = {"force_n": 0.012, "interval_n": (0.009, 0.016)}
    frames = [
        frame_answer(file="0.png", measured_force_n=0.010, **read),
        frame_answer(file="1.png", measured_force_n=0.040, target=2, probabilities=(0.0, 0.6, 0.4), **read),
        refused_frame(file="2.png", measured_force_n=0.050, target=2),
    ]
    axes = draw_read_forces(evaluation_of(frames)).axes[0]
    places = {label: [] for label in ("read", "misread", "not usable")}
    for line in axes.lines:
        if line.get_label() in places:
            places[line.get_label()].append((line.get_xdata()[0], line.get_ydata()[0]))
    assert places["read"] == [(10.0, 12.0), (40.0, 12.0)]
    assert places["misread"] == [(40.0, 12.0)]
    assert [x for x, _ in places["not usable"]] == [50.0]
    intervals = [segment for entry in axes.collections for segment in entry.get_segments()]
    np.testing.assert_allclose(intervals, [[[10.0, 9.0], [10.0, 16.0]], [[40.0, 9.0], [40.0, 16.0]]])


def test_the_overlap_of_slices_is_1_if_they_are_the_same_and_0_if_they_have_nothing_in_common() -> None:
    half = np.repeat(np.array([[255, 0]], dtype=np.uint8), 7, axis=1)
    assert [dice(half, other) for other in (half, 255 - half, 0 * half)] == [1.0, 0.0, 0.0]
    assert dice(0 * half, 0 * half) == 1.0


WIDTH_M, COLUMNS = 15e-3, 512
LATERAL_M = (np.arange(COLUMNS) + 0.5) * WIDTH_M / COLUMNS


def dented(lateral_m: np.ndarray) -> np.ndarray:
    """Depth of an eye with a dent at 0, m."""
    return 12e-3 - np.sqrt((12e-3) ** 2 - lateral_m**2) + 1.5e-3 * np.exp(-((lateral_m / 1.5e-3) ** 2))


def wall() -> Section:
    lateral_m = np.linspace(-9e-3, 9e-3, 400)
    outer = np.stack([lateral_m, dented(lateral_m)], axis=1)
    return Section(outer, outer + np.array([0.0, 0.5e-3]))


def test_a_wall_is_laid_on_the_surface_though_a_third_of_it_is_unseen_or_in_the_middle() -> None:
    for shift_m, down_m in ((0.0, 0.4e-3), (0.25e-3, 0.9e-3), (-0.4e-3, 0.1e-3)):
        surface_m = dented(LATERAL_M - WIDTH_M / 2 - shift_m) + down_m
        surface_m[100:270] = np.nan
        surface_m[300:310] += 1e-3  # a wrong stretch
        laid = laid_on_surface(wall(), surface_m, WIDTH_M)
        moved = laid.outer[0] - wall().outer[0] - [WIDTH_M / 2, 0.0]
        assert moved == pytest.approx([shift_m, down_m], abs=13e-6)  # half a step of the shifts
        assert laid.inner - laid.outer == pytest.approx(wall().inner - wall().outer)
    laid = laid_on_surface(wall(), np.full(COLUMNS, np.nan), WIDTH_M)
    assert laid.outer == pytest.approx(wall().outer + np.array([WIDTH_M / 2, 0.0]))


@pytest.fixture
def logged(tmp_path: Path) -> Recording:
    """A recording whose sensor has a zero of 50 mN."""
    recording = read_recording(with_log(write_small_recording(tmp_path / "r", frames=12)))
    assert recording.forces is not None
    return replace(recording, forces=replace(recording.forces, wrench_sc=recording.forces.wrench_sc + 0.05))


def drawn_log(recording: Recording, trials: Sequence[Trial] = ()) -> Axes:
    axes = Figure().subplots()
    draw_log(axes, recording, trials)
    return axes


def test_a_force_log_is_drawn_in_millinewtons_with_the_times_of_all_frames_and_labels_by_class(
    logged: Recording,
) -> None:
    labels = ((1.0, 0.04, 2), (1.05, None, None), (1.1, 0.01, 1))
    trials = [Trial(file="a.png", time_s=at, measured_force_n=force, target=target) for at, force, target in labels]
    axes = drawn_log(logged, trials)
    raw, filtered, first, second = axes.lines
    np.testing.assert_allclose(np.ptp(raw.get_ydata()), 1e3 * np.ptp(logged.forces.force_n("fz")))
    off = raw.get_ydata() + 1e3 * logged.forces.force_n("fz")  # contact_sign is -1
    np.testing.assert_allclose(off, off[0])
    assert np.mean(raw.get_ydata()) == pytest.approx(np.mean(filtered.get_ydata()))
    assert filtered.get_ydata().max() == pytest.approx(10.0, abs=0.5)
    marks = [segment[0][0] for segment in axes.collections[0].get_segments()]
    assert marks == pytest.approx([frame.time_s for frame in logged.frames])
    assert [np.column_stack(line.get_data()).tolist() for line in (first, second)] == [[[1.1, 10.0]], [[1.0, 40.0]]]


def test_a_figure_has_the_format_of_its_name_and_the_same_bytes_each_time(tmp_path: Path) -> None:
    for ending, start in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")):
        for name in ("one", "two"):
            figure = Figure()
            figure.subplots().plot([0, 1], [1, 0], label="line")
            figure.suptitle("検査")  # the font lacks these: without a warning
            write_figure(figure, tmp_path / f"{name}{ending}")
        content = (tmp_path / f"one{ending}").read_bytes()
        assert content.startswith(start)
        assert content == (tmp_path / f"two{ending}").read_bytes()
    with pytest.raises(InputError, match=r"a\.xlsx.*\.png, \.svg, \.pdf"):
        write_figure(Figure(), tmp_path / "a.xlsx")
    assert len(list(tmp_path.iterdir())) == 6


def test_a_sheet_shows_the_worst_frames_and_others_in_even_steps() -> None:
    badness = [(number == 7, float(number)) for number in range(2000)]
    shown = shown_on_sheet(badness)
    assert shown[:WORST] == [7, *range(1999, 2000 - WORST, -1)]
    assert len(shown) == MOST
    assert np.ptp(np.diff(shown[WORST:])) <= 2  # in even steps, but for number 7
    assert shown_on_sheet(badness[:5]) == [4, 3, 2, 1, 0]


def test_a_frame_has_both_walls_where_they_are_seen_its_verdict_and_the_disagreement(tmp_path: Path) -> None:
    looked_at_frames(tmp_path / "eye", 1)
    path = tmp_path / "eye" / "frames" / "0001.png"
    frame, found = segmented(path, Scanner(), Scanner(), finder_of(SHIPPED_WALL_FINDER))
    assert found.methods is not None
    unseen = replace(found.methods, classical=replace(found.methods.classical, inner_found=False))
    refused = replace(found, usable=False, reason="too weak", methods=unseen)
    figure = draw_sheet([sheet_frame("x" * 50 + ".png", frame, one) for one in (refused, found)], "2 frames")
    words = f"usable, 562 µm, disagreement {found.methods.disagreement:.2f}"
    assert [axes.get_xlabel() for axes in figure.axes] == [f"not {words.replace(' 562 µm,', '')}\ntoo weak", words]
    for axes, classical in zip(figure.axes, (1, 2), strict=True):
        assert axes.texts[0].get_text() == "…" + "x" * 20 + ".png"
        assert [line.get_color() for line in axes.lines] == [WALLS[0][0]] * classical + [WALLS[1][0]] * 2
        np.testing.assert_allclose(axes.lines[0].get_ydata() * found.rows - 0.5, found.methods.classical.outer_row)
