"""The figures show the numbers that they were given."""

import numpy as np
import pytest
from frame_answers import frame_answer, refused_frame
from matplotlib.figure import Figure

from scleraforce.report.files import CLASS_COLOURS, data_uri
from scleraforce.report.force_figures import draw_force_log, draw_read_forces, draw_training_curves, draw_trial_forces
from scleraforce.report.slice_figures import SlicePair, dice, draw_montage, draw_segmentation, draw_slice_pairs


def lines(figure: Figure) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.column_stack(line.get_data()) for line in figure.axes[0].lines}


def test_a_force_log_is_drawn_in_millinewtons_with_its_labels_at_the_imaging_times() -> None:
    time_s = np.linspace(0.0, 10.0, 2001)
    figure = draw_force_log(time_s, 0.01 * time_s, 0.02 * time_s, [2.0, 5.0, 9.0], [0.04, None, 0.18], (0.005, 0.03))
    drawn = lines(figure)
    np.testing.assert_allclose(drawn["as logged"][:, 1], 10.0 * drawn["as logged"][:, 0])
    np.testing.assert_allclose(drawn["filtered"][:, 1], 20.0 * drawn["filtered"][:, 0])
    np.testing.assert_allclose(drawn["label (mean over 2 s)"], [[2.0, 40.0], [9.0, 180.0]])
    assert figure.axes[0].get_ylabel() == "contact force [mN]"


def test_a_long_log_is_thinned_and_not_cut() -> None:
    time_s = np.linspace(0.0, 600.0, 120_001)
    drawn = lines(draw_force_log(time_s, time_s, time_s, [], [], (0.005, 0.03)))["filtered"]
    assert len(drawn) < 7000
    assert drawn[-1, 0] == pytest.approx(600.0, abs=0.2)


def test_a_trial_has_the_colour_of_what_was_read_and_a_misread_one_is_ringed() -> None:
    frames = [
        frame_answer(eye="eye 1", file="0.png", measured_force_n=0.010),
        frame_answer(eye="eye 1", file="1.png", predicted=2, probabilities=(0.0, 0.3, 0.7)),
        refused_frame(eye="eye 2", file="2.png", measured_force_n=0.050, target=2),
    ]
    axes = draw_trial_forces(frames, (0.005, 0.03), 0.06).axes[0]
    points = [line for line in axes.lines if line.get_marker() in ("o", "s", "^") and line.get_color() != "none"]
    colours = {(line.get_xdata()[0], line.get_ydata()[0]): line.get_color() for line in points}
    assert colours == {(1, 10.0): CLASS_COLOURS[1], (2, 20.0): CLASS_COLOURS[2], (3, 50.0): "white"}
    texts = [text.get_text() for text in axes.texts]
    ringed = [(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines if line.get_label() == "misread"]
    assert ringed == [(2, 20.0)]
    assert {"eye 1", "eye 2", "class 0", "class 1", "class 2"} <= set(texts)


def test_dice_of_equal_disjoint_and_empty_images() -> None:
    one = np.array([[255, 255], [0, 0]], dtype=np.uint8)
    assert dice(one, one) == 1.0
    assert dice(one, 255 - one) == 0.0
    assert dice(0 * one, 0 * one) == 1.0


def test_the_overlay_colours_what_only_one_slice_has() -> None:
    measured, simulated = np.zeros((2, 4, 14), dtype=np.uint8)
    measured[1, :7] = 255
    simulated[1, 3:] = 255
    frame = np.zeros((32, 32), dtype=np.uint16)
    pairs = [SlicePair("a", k, frame, (0.015, 0.004), measured, simulated, 1e-3) for k in range(3)]
    figure = draw_slice_pairs(pairs)
    overlay = np.asarray(figure.axes[9].images[0].get_array())
    assert len({tuple(overlay[1, column]) for column in (0, 5, 13)}) == 3
    assert tuple(overlay[0, 0]) == (1.0, 1.0, 1.0)
    assert figure.axes[9].get_title(loc="left") == f"Dice {dice(measured, simulated):.3f}"
    assert len(figure.axes) == 12


def test_a_montage_names_force_and_thickness() -> None:
    figure = draw_montage(np.zeros((7, 4, 14), np.uint8), np.full(7, 0.0123), np.ones(7, np.intp), np.full(7, 4e-4))
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert titles.count("12.3 mN · 400 µm") == 7
    assert len(titles) == 12


def test_boundaries_are_drawn_in_millimetres() -> None:
    frame = np.zeros((40, 100), dtype=np.uint16)
    rows = np.full(100, 9.5)
    figure = draw_segmentation(frame, np.zeros((40, 100), np.uint8), rows, rows + 10.0, (0.010, 0.004))
    outer, inner = (np.column_stack(line.get_data()) for line in figure.axes[1].lines)
    np.testing.assert_allclose(outer[:, 1], 1.0)
    np.testing.assert_allclose(inner[:, 1], 2.0)
    np.testing.assert_allclose(outer[[0, -1], 0], [0.05, 9.95])


def test_training_curves_have_one_point_an_epoch() -> None:
    figure = draw_training_curves([1.0, 0.5], [0.9, 0.3], [0.4, 0.6], [0.5, 0.8])
    loss, accuracy = figure.axes
    assert [line.get_ydata().tolist() for line in loss.lines] == [[1.0, 0.5], [0.9, 0.3]]
    assert [line.get_ydata().tolist() for line in accuracy.lines] == [[0.4, 0.6], [0.5, 0.8]]
    assert loss.lines[0].get_xdata().tolist() == [1, 2]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["png", "svg"])
def test_an_embedded_figure_is_the_same_each_time(kind) -> None:
    first, second = (data_uri(draw_training_curves([1.0, 0.5], [0.9, 0.3], [0.4, 0.6], [0.5, 0.8]), kind) for _ in "ab")
    assert first == second
    assert first.startswith("data:image/")


def test_a_read_force_stands_over_the_measured_one_with_its_interval() -> None:
    read = {"predicted_force_n": 0.012, "interval_n": (0.009, 0.016)}
    frames = [
        frame_answer(file="0.png", measured_force_n=0.010, **read),
        frame_answer(file="1.png", measured_force_n=0.040, target=2, probabilities=(0.0, 0.6, 0.4), **read),
        refused_frame(file="2.png", measured_force_n=0.050, target=2),
    ]
    axes = draw_read_forces(frames, (0.005, 0.03), 0.06).axes[0]
    places = {label: [] for label in ("read", "misread", "not usable")}
    for line in axes.lines:
        if line.get_label() in places:
            places[line.get_label()].append((line.get_xdata()[0], line.get_ydata()[0]))
    assert places["read"] == [(10.0, 12.0), (40.0, 12.0)]
    assert places["misread"] == [(40.0, 12.0)]
    assert [x for x, _ in places["not usable"]] == [50.0]
    intervals = [segment for entry in axes.collections for segment in entry.get_segments()]
    np.testing.assert_allclose(intervals, [[[10.0, 9.0], [10.0, 16.0]], [[40.0, 9.0], [40.0, 16.0]]])
