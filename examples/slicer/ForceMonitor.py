"""A scripted module of 3D Slicer: frames with their walls, the force as a bar and in
words, as `bridge.py` sends them.

Needs Slicer's own Python and the extension SlicerOpenIGTLink, nothing else. Settings >
Modules > Additional module paths: add this folder. Research use only.
"""

import qt
import slicer
import vtk
from slicer.ScriptedLoadableModule import (
    ScriptedLoadableModule,
    ScriptedLoadableModuleLogic,
    ScriptedLoadableModuleWidget,
)

# the devices of the bridge
VIEW = "ForceView"
BAR = "ForceBar"
WORDS = "ForceText"
PERIOD_MS = 200
WIDTH_MM = 2.0
ORANGE = (0.835, 0.369, 0.0)


class ForceMonitor(ScriptedLoadableModule):
    """The entry in Slicer's list of modules."""

    def __init__(self, parent):
        super().__init__(parent)
        parent.title = "Force monitor"
        parent.categories = ["IGT"]
        parent.contributors = ["the scleraforce authors"]
        parent.helpText = (
            "Shows a scleraforce monitor. Research use only: not a medical device."
        )


class ForceMonitorWidget(ScriptedLoadableModuleWidget):
    """Host, port, one button."""

    def setup(self):
        """Build the panel."""
        super().setup()
        self.logic = ForceMonitorLogic()
        form = qt.QFormLayout()
        self.host = qt.QLineEdit("127.0.0.1")
        self.port = qt.QSpinBox()
        self.port.setRange(1, 65535)
        self.port.setValue(18947)
        self.button = qt.QPushButton("Connect")
        form.addRow("host of the bridge", self.host)
        form.addRow("port", self.port)
        form.addRow(self.button)
        self.layout.addLayout(form)
        self.button.clicked.connect(self.toggle)
        self.timer = qt.QTimer()
        self.timer.setInterval(PERIOD_MS)
        self.timer.timeout.connect(self.logic.update)

    def toggle(self):
        """Connect, or disconnect."""
        if self.logic.connector is None:
            self.logic.connect(self.host.text, self.port.value)
            self.timer.start()
        else:
            self.timer.stop()
            self.logic.disconnect()

        self.button.text = "Connect" if self.logic.connector is None else "Disconnect"

    def cleanup(self):
        """Leave nothing running."""
        self.timer.stop()
        self.logic.disconnect()


class ForceMonitorLogic(ScriptedLoadableModuleLogic):
    """A connection by OpenIGTLinkIF, and what shows the nodes that it makes."""

    def __init__(self):
        super().__init__()
        self.connector = None
        self.model = None

    def connect(self, host, port):
        """Connect to the bridge as a client."""
        self.connector = slicer.mrmlScene.AddNewNodeByClass(
            "vtkMRMLIGTLConnectorNode", "Force monitor"
        )
        self.connector.SetTypeClient(host, port)
        self.connector.Start()

    def disconnect(self):
        """End the connection; the nodes stay."""
        if self.connector is not None:
            self.connector.Stop()
            slicer.mrmlScene.RemoveNode(self.connector)
            self.connector = None

    def update(self):
        """Show what has come: the picture in the red slice, the bar beside it, the
        words in the corner.
        """
        picture = slicer.mrmlScene.GetFirstNodeByName(VIEW)
        if picture is not None:
            slicer.util.setSliceViewerLayers(background=picture)

        transform = slicer.mrmlScene.GetFirstNodeByName(BAR)
        if transform is not None:
            self._bar().SetAndObserveTransformNodeID(transform.GetID())

        text = slicer.mrmlScene.GetFirstNodeByName(WORDS)
        if text is not None:
            corner = (
                slicer.app.layoutManager()
                .sliceWidget("Red")
                .sliceView()
                .cornerAnnotation()
            )
            corner.SetText(vtk.vtkCornerAnnotation.UpperRight, text.GetText())

    def _bar(self):
        """Return the model of the bar, 1 mm high from the origin up; the transform
        makes 1 mm of each mN.
        """
        if self.model is None:
            cube = vtk.vtkCubeSource()
            cube.SetBounds(
                -WIDTH_MM / 2, WIDTH_MM / 2, -WIDTH_MM / 2, WIDTH_MM / 2, 0.0, 1.0
            )
            cube.Update()
            self.model = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLModelNode", "Force")
            self.model.SetAndObservePolyData(cube.GetOutput())
            self.model.CreateDefaultDisplayNodes()
            self.model.GetDisplayNode().SetColor(*ORANGE)

        return self.model
