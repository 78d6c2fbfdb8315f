"""The figures show their numbers."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from analytic_frames import IOP_PA, LIBRARY, STUDY, THICKNESS_M
from foreign_files import with_log
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from small_recordings import (
    calibration_of_a_sealed_eye,
    evaluation_of,
    frame_answer,
    looked_at_frames,
    refused_frame,
    write_small_recording,
)

from ideal_boundaries import ideal_boundaries
from scleraforce.calibration.assimilation import FrameStep, begin, moments, step
from scleraforce.calibration.eye_model import EyeConstants, stated_wall
from scleraforce.errors import InputError
from scleraforce.known import SEALED
from scleraforce.laboratory.light import Pose
from scleraforce.mechanics.contact import Section
from scleraforce.recording.folder import Recording, read_recording
from scleraforce.recording.labels import Trial
from scleraforce.report.calibration_figures import draw_observed_points
from scleraforce.report.files import CLASS_COLOURS, write_figure
from scleraforce.report.frame_figures import (
    SlicePair,
    dice,
    draw_computed_walls,
    draw_montage,
    draw_read_forces,
    draw_segmentation,
    draw_slice_pairs,
    draw_trial_forces,
    laid_on_surface,
)
from scleraforce.report.model_figures import draw_curves
from scleraforce.report.recording_figures import draw_log, draw_preview


def test_a_trial_has_the_colour_of_its_answer_and_a_misread_one_is_ringed() -> None:
    frames = [
        frame_answer(eye="eye 1", file="0.png", measured_force_n=0.010),
        frame_answer(eye="eye 1", file="1.png", predicted=2, probabilities=(0.0, 0.3, 0.7)),
        refused_frame(eye="eye 2", file="2.png", measured_force_n=0.050, target=2),
    ]
    axes = draw_trial_forces(evaluation_of(frames)).axes[0]
    points = [line for line in axes.lines if line.get_marker() in ("o", "s", "^") and line.get_color() != "none"]
    colours = {(line.get_xdata()[0], line.get_ydata()[0]): line.get_color() for line in points}
    assert colours == {(1, 10.0): CLASS_COLOURS[1], (2, 20.0): CLASS_COLOURS[2], (3, 50.0): "white"}
    texts = [text.get_text() for text in axes.texts]
    ringed = [(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines if line.get_label() == "misread"]
    assert ringed == [(2, 20.0)]
    assert {"eye 1", "eye 2", "class 0", "class 1", "class 2"} <= set(texts)


def test_the_overlay_colours_pixels_of_one_slice_alone(tmp_path: Path) -> None:
    measured, simulated = np.zeros((2, 4, 14), dtype=np.uint8)
    measured[1, :7] = 255
    simulated[1, 3:] = 255
    assert [dice(measured, other) for other in (measured, 255 - measured)] == [1.0, 0.0]
    assert dice(0 * measured, 0 * measured) == 1.0
    figure = draw_slice_pairs([SlicePair(look, measured, simulated, 1e-3) for look in looked_at_frames(tmp_path, 3)])
    overlay = np.asarray(figure.axes[9].images[0].get_array())
    assert len({tuple(overlay[1, column]) for column in (0, 5, 13)}) == 3
    assert tuple(overlay[0, 0]) == (1.0, 1.0, 1.0)
    assert figure.axes[9].get_title(loc="left") == f"Dice {dice(measured, simulated):.3f}"
    assert figure.axes[4].images[0].get_extent() == [0.0, 14.0, 4.0, 0.0]
    assert len(figure.axes) == 12


def test_a_montage_names_force_and_thickness() -> None:
    figure = draw_montage(np.zeros((7, 4, 14), np.uint8), np.full(7, 0.0123), np.ones(7, np.intp), np.full(7, 4e-4))
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles.count("12.3 mN · 400 µm") == 7
    assert len(titles) == 12


def test_boundaries_are_drawn_in_millimetres(tmp_path: Path) -> None:
    (look,) = looked_at_frames(tmp_path, 1)  # 256 rows, 4 mm deep, and 300 columns, 15 mm wide
    figure = draw_segmentation(look)
    for line, row in zip(figure.axes[1].lines, (look.found.outer_row, look.found.inner_row), strict=True):
        np.testing.assert_allclose(line.get_ydata(), (row + 0.5) * 4.0 / 256)
        np.testing.assert_allclose(np.array(line.get_xdata())[[0, -1]], [0.025, 14.975])


def test_training_curves_have_one_point_an_epoch_and_a_panel_a_quantity() -> None:
    curves = {"training_loss": [1.0, 0.5], "validation_loss": [0.9, 0.3], "validation_accuracy": [0.5, 0.8]}
    figure = draw_curves(curves, "epoch")
    loss, accuracy = figure.axes
    assert [line.get_ydata().tolist() for line in loss.lines] == [[1.0, 0.5], [0.9, 0.3]]
    assert [line.get_ydata().tolist() for line in accuracy.lines] == [[0.5, 0.8]]
    assert loss.lines[0].get_xdata().tolist() == [1, 2]
    assert (loss.get_yscale(), accuracy.get_yscale()) == ("log", "linear")


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


def test_each_frame_is_drawn_bare_and_with_all_its_walls(tmp_path: Path) -> None:
    looks = looked_at_frames(tmp_path, 3)
    figure = draw_computed_walls(looks, {name: [wall()] * 3 for name in ("finite strain", "linear")})
    assert len(figure.axes) == 6
    assert [len(axes.get_lines()) for axes in figure.axes] == [0, 0, 0, 4, 4, 4]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["finite strain", "linear"]


@pytest.mark.slow
def test_the_wall_of_a_sealed_eye_is_drawn_through_its_predicted_points() -> None:
    """With the rigidity from the frames, which is not the mean of the prior."""
    truth = EyeConstants(
        iop_pa=IOP_PA, thickness_m=THICKNESS_M, gap_m=0.6e-3, polar_rad=0.0, polar_sd_rad=0.0,
        globe=replace(SEALED, mean=0.4 * SEALED.mean),
    )  # fmt: skip
    found, random = begin(STUDY, replace(truth, globe=SEALED), LIBRARY), np.random.default_rng(0)
    for force_n in (0.012, 0.03):
        outer, inner = found.filter.model.curves([stated_wall(truth, 0.3e6, force_n, 0.0)])[0]
        pose = Pose(lateral_m=0.0, depth_m=0.5e-3)
        found = step(found, ideal_boundaries(Section(outer, inner), pose, STUDY.oct, 2e-6, random), force_n)
    assert isinstance(found.last, FrameStep)
    means, sds = moments(found.filter, found.state)
    eye = replace(
        calibration_of_a_sealed_eye().eyes["mine"],
        names=found.filter.space.names,
        means=tuple(means.tolist()),
        sds=tuple(sds.tolist()),
        state=found.state,
        filter=found.filter,
        steps=(found.last,),
    )
    width_m, depth_m = STUDY.oct.width_m, STUDY.oct.depth_m
    final = draw_observed_points(eye, np.zeros((4, 4), np.uint16), 0, width_m, depth_m).axes[1]
    *curves, _, predicted = (np.column_stack(line.get_data()) for line in final.lines)
    lateral_mm, depth_mm = predicted.T
    off_mm = [np.abs(np.interp(lateral_mm, *curve.T) - depth_mm) for curve in curves]
    assert np.minimum(*off_mm).max() < 1e-3


def test_frames_and_bars_are_drawn_to_scale(tmp_path: Path) -> None:
    recording = read_recording(write_small_recording(tmp_path / "r", frames=3, log=False))  # 8 mm x 3 mm
    figure = draw_preview(recording, 3)
    figure.draw_without_rendering()
    assert len(figure.axes) == 3
    for axes, entry in zip(figure.axes, recording.frames, strict=True):
        image = axes.images[0]
        assert image.get_extent() == [0.0, 8.0, 3.0, 0.0]
        np.testing.assert_array_equal(image.get_array(), recording.frame(entry))
        across, down = axes.lines
        assert np.ptp(across.get_xdata()) == pytest.approx(2.0)
        assert np.ptp(down.get_ydata()) == pytest.approx(1.0)
        assert [text.get_text() for text in axes.texts] == ["2 mm", "1 mm deep"]
        inches = axes.get_window_extent().size / figure.dpi
        assert inches[0] / inches[1] == pytest.approx(8.0 / 3.0, rel=0.02)
        assert entry.file in axes.get_title(loc="left")


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


def test_a_long_log_is_thinned_and_not_cut(logged: Recording) -> None:
    assert logged.forces is not None
    time_s = np.linspace(0.0, 600.0, 60_001)
    log = replace(logged.forces, time_s=time_s, wrench_sc=np.zeros((60_001, 6)))
    filtered = drawn_log(replace(logged, forces=log)).lines[1]
    assert len(filtered.get_xdata()) < 7000
    assert filtered.get_xdata()[-1] == pytest.approx(600.0, abs=0.2)


def test_a_figure_has_the_format_of_its_name_and_the_same_bytes_each_time(tmp_path: Path) -> None:
    for ending, start in ((".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")):
        for name in ("one", "two"):
            figure = Figure()
            figure.subplots().plot([0, 1], [1, 0], label="line")
            write_figure(figure, tmp_path / f"{name}{ending}")
        content = (tmp_path / f"one{ending}").read_bytes()
        assert content.startswith(start)
        assert content == (tmp_path / f"two{ending}").read_bytes()
    with pytest.raises(InputError, match=r"a\.xlsx.*\.png, \.svg, \.pdf"):
        write_figure(Figure(), tmp_path / "a.xlsx")
    assert len(list(tmp_path.iterdir())) == 6
