"""`python screenshot.py RECORDING CALIBRATION PICTURE`: a picture of napari with the
panel.
"""

import sys
from pathlib import Path

import napari
from qtpy.QtWidgets import QApplication

from napari_scleraforce.panel import Panel

SIZE = 1400, 620


def main(recording: Path, calibration: Path, picture: Path) -> None:
    """Write the picture."""
    viewer = napari.Viewer()
    viewer.window.resize(*SIZE)
    viewer.open(recording, plugin="napari-scleraforce")
    _, panel = viewer.window.add_plugin_dock_widget(
        "napari-scleraforce", "Walls and forces"
    )
    assert isinstance(panel, Panel)
    panel.calibration.value = calibration
    viewer.dims.set_current_step(0, viewer.dims.nsteps[0] - 1)
    panel.read_all()
    QApplication.processEvents()
    viewer.reset_view()
    viewer.layers.selection.active = viewer.layers[-1]
    viewer.screenshot(str(picture), canvas_only=False)
    viewer.close()


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
