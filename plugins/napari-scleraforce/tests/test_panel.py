"""The panel: walls that follow the slider, corrections, forces."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from napari.components import ViewerModel
from napari.layers import Image, Shapes
from napari.utils.notifications import notification_manager
from qtpy.QtWidgets import QApplication
from skimage.io import imread

import scleraforce as sf
from napari_scleraforce.panel import Panel
from napari_scleraforce.recordings import layers
from napari_scleraforce.walls import LOWER, UPPER


def opened(recording: Path) -> tuple[ViewerModel, Panel]:
    """Open a recording in a viewer without a window, with the panel."""
    QApplication.instance() or QApplication([])
    viewer = ViewerModel()
    for data, described, _ in layers(str(recording)):
        viewer.add_layer(Image(data, **described))
    viewer.dims.set_current_step(0, 0)
    return viewer, Panel(viewer)


def calibrated(eye: Path) -> Path:
    """Return the calibration of a recording."""
    command = Path(sys.executable).with_name("scleraforce")
    file = eye.with_suffix(".json")
    subprocess.run(
        [command, "calibrate", eye, "--frames", "3", "--out", file],
        check=True,
        capture_output=True,
    )

    return file


def walls(viewer: ViewerModel) -> Shapes:
    (layer,) = (each for each in viewer.layers if isinstance(each, Shapes))
    return layer


def test_the_wall_has_the_scale_of_the_frames_and_the_rows_that_sf_segments(
    eye: Path,
) -> None:
    viewer, panel = opened(eye)
    layer = walls(viewer)
    found = sf.segment(eye / "frames" / "0001.png")
    np.testing.assert_array_equal(layer.scale, viewer.layers[0].scale)
    assert layer.units == viewer.layers[0].units

    for (name, points), row in zip(
        panel.paths(), (found.outer_row, found.inner_row), strict=True
    ):
        drawn = np.interp(np.arange(len(row)), points[:, 2], points[:, 1])
        assert np.nanmax(np.abs(drawn - row)) < 1.0, name

    assert [name for name, _ in panel.paths()] == [UPPER, LOWER]


def test_text_and_wall_follow_the_slider(eye: Path) -> None:
    viewer, panel = opened(eye)
    texts = []

    for frame, entry in enumerate(panel.recording.frames if panel.recording else ()):
        viewer.dims.set_current_step(0, frame)
        answer = sf.read(sf.load_model("default"), eye / "frames" / entry.file)
        assert answer.force_n is not None
        assert viewer.text_overlay.text.startswith(f"{1e3 * answer.force_n:.1f} mN (")
        assert viewer.text_overlay.text.endswith("wall: found")
        assert len(panel.paths()) == 2
        texts.append(viewer.text_overlay.text)

    assert len(set(texts)) == 4
    viewer.dims.set_current_step(0, 1)
    assert viewer.text_overlay.text == texts[1]
    assert len(walls(viewer).data) == 8


def test_an_edit_that_is_saved_is_read_as_a_corrected_wall(eye: Path) -> None:
    viewer, panel = opened(eye)
    viewer.dims.set_current_step(0, 2)
    before = dict(panel.paths())
    layer = walls(viewer)
    layer.data = [data + np.array([0, 4, 0]) * (data[0, 0] == 2) for data in layer.data]
    panel.save()
    assert "wall: corrected" in viewer.text_overlay.text
    answer = sf.read(sf.load_model("default"), eye / "frames" / "0003.png")
    assert any("wall: corrected" in warning for warning in answer.warnings)
    assert "0003.png," in (eye / "walls.csv").read_text()
    _, again = opened(eye)
    again._viewer.dims.set_current_step(0, 2)

    for name, points in again.paths():
        moved = (
            np.interp(before[name][:, 2], points[:, 2], points[:, 1])
            - before[name][:, 1]
        )
        assert np.abs(moved - 4).max() < 1.5, name

    again._viewer.dims.set_current_step(0, 1)
    assert again._viewer.text_overlay.text.endswith("wall: found")


def test_an_edit_that_is_not_saved_can_be_taken_back(eye: Path) -> None:
    viewer, panel = opened(eye)
    before = panel.paths()
    layer = walls(viewer)
    layer.data = [data + np.array([0, 9, 0]) for data in layer.data]
    panel.restore()

    for (name, points), (other, old) in zip(panel.paths(), before, strict=True):
        assert name == other
        np.testing.assert_array_equal(points, old)

    assert not (eye / "walls").exists()


def test_a_path_of_the_users_is_the_boundary_that_the_panel_names(eye: Path) -> None:
    viewer, panel = opened(eye)
    for name in (LOWER, UPPER):
        panel.drawn_as.value = name
        walls(viewer).add_paths([np.array([[0, 9.0, 5.0], [0, 9.0, 9.0]])])
        assert panel.paths()[-1][0] == name


def test_all_frames_are_plotted_with_their_intervals_and_measured_forces(
    eye: Path,
) -> None:
    _, panel = opened(eye)
    panel.read_all()
    (axes,) = panel.figure.axes
    assert axes.get_legend_handles_labels()[1] == ["measured", "read, 90 % interval"]
    (bars,) = axes.containers
    (measured,) = (line for line in axes.lines if line.get_label() == "measured")
    read = sf.evaluate(sf.load_model("default"), eye).frames

    for line, forces_n in (
        (bars[0], [each.answer.force_n for each in read]),
        (measured, [each.measured_force_n for each in read]),
    ):
        np.testing.assert_allclose(
            np.asarray(line.get_ydata()), 1e3 * np.array(forces_n, float)
        )


def test_a_calibration_narrows_the_interval_and_a_bad_one_is_shown_in_one_line(
    eye: Path,
) -> None:
    def width_mn() -> float:
        low, high = re.findall(r"([\d.]+) to ([\d.]+)", viewer.text_overlay.text)[0]
        return float(high) - float(low)

    viewer, panel = opened(eye)
    before_mn = width_mn()
    panel.calibration.value = file = calibrated(eye)
    assert width_mn() < before_mn / 2
    file.write_text("{}")
    shown: list[str] = []

    with notification_manager:
        notification_manager.notification_ready.connect(
            lambda notification: shown.append(notification.message)
        )
        panel.calibration.value = None
        panel.calibration.value = file

    assert shown[-1].startswith(f"{file}: ")
    assert "\n" not in shown[-1]


@pytest.mark.skipif(
    shutil.which("xvfb-run") is None, reason="needs Xvfb: a window needs OpenGL"
)
def test_the_window_shows_frame_wall_force_and_plot(eye: Path, tmp_path: Path) -> None:
    script = Path(__file__).parents[1] / "screenshot.py"
    picture = tmp_path / "window.png"
    subprocess.run(
        [
            "xvfb-run",
            "-a",
            "-s",
            "-screen 0 1600x1000x24",
            sys.executable,
            script,
            eye,
            calibrated(eye),
            picture,
        ],
        env=os.environ | {"QT_QPA_PLATFORM": "xcb"},
        check=True,
    )
    pixels = imread(picture)[..., :3].astype(int)
    canvas = pixels[100:-100, 400:-450]
    assert canvas.std() > 20
    orange = np.abs(pixels - (0xE6, 0x9F, 0x00)).sum(axis=-1) < 60
    assert orange.sum() > 200
