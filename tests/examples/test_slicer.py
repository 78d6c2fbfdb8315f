"""The bridge to 3D Slicer, heard by an independent client, and the module with fakes of
Slicer's modules.
"""

import sys
import threading
from dataclasses import replace
from types import ModuleType, SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pyigtl
import pytest
from fake_monitor import fake_monitor
from small_monitor import Peer
from small_recordings import drawn_wall
from sources import example_module
from waiting import FUSE_S, wait_until

from scleraforce.live.network.openigtlink import Image, Status

bridge = example_module("slicer/bridge")
WALL = drawn_wall(np.random.default_rng(7), dent_m=0.0)
ROWS, COLUMNS = WALL.shape
MATRIX = (0.05, 0.0, 0.0, 0.0, 4.0 / ROWS, 0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 3.0)


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a reading wait for its frame as long as it takes."""
    monkeypatch.setattr(bridge, "FRAME_WAIT_S", FUSE_S)


def heard(client: pyigtl.OpenIGTLinkClient, device: str):
    message = client.wait_for_message(device, timeout=FUSE_S)
    assert message is not None, f"{device} did not come"
    return message


def test_slicer_gets_frame_wall_bar_and_words_also_when_it_comes_later_and_the_scanner_its_answers():
    with (
        fake_monitor() as monitor,
        bridge.run(0, 0, ("127.0.0.1", monitor.port)) as (scanner_port, slicer_port),
    ):
        clients = [pyigtl.OpenIGTLinkClient("127.0.0.1", slicer_port)]
        try:
            with Peer(scanner_port, version=2) as scanner:
                wait_until(clients[0].is_connected)
                scanner.say(Image(WALL[None], MATRIX), message_id=5)
                scanner.hear(lambda peer: peer.readings() > 0)
                assert scanner.readings() == 1
                shown = [
                    [
                        heard(clients[0], device)
                        for device in ("ForceView", "ForceBar", "ForceText")
                    ]
                ]
                event = next(
                    e
                    for e in monitor.received
                    if e is not None and isinstance(e.message, Image)
                )

            clients.append(pyigtl.OpenIGTLinkClient("127.0.0.1", slicer_port))
            shown.append(
                [
                    heard(clients[1], device)
                    for device in ("ForceView", "ForceBar", "ForceText")
                ]
            )
        finally:
            for client in clients:
                client.stop()

    np.testing.assert_array_equal(event.message.pixels[0], WALL)  # handed on as it came
    assert event.message_id == 5

    for picture, bar, words in shown:
        assert picture.image.shape == (1, ROWS, COLUMNS, 3)
        red, green, blue = np.moveaxis(picture.image[0].astype(int), -1, 0)
        surface = np.argwhere((red > 200) & (abs(green - 159) < 40) & (blue < 80))
        in_the_middle = surface[np.abs(surface[:, 1] - COLUMNS // 2) < 5, 0]
        assert in_the_middle.mean() == pytest.approx(32, abs=3)
        assert np.linalg.norm(picture.ijk_to_world_matrix[:3, 0]) == pytest.approx(0.05)
        assert bar.matrix[2, 2] == pytest.approx(1.5)
        assert words.string.splitlines() == [
            "1.5 mN (90 %: 0.5 to 2.5)",
            "WATCHING: class 0",
        ]


def test_a_reading_waits_for_its_frame_which_is_looked_at_after_it_was_handed_on(
    monkeypatch,
) -> None:
    latest = bridge.Latest()
    image = Image(WALL[None], MATRIX)
    older, newer = (
        replace(image, matrix=(width_mm, *MATRIX[1:])) for width_mm in (1.0, 2.0)
    )

    def picture_of(frame_id: int) -> Image:
        latest.read({"frame_id": frame_id})
        reading, picture = latest.wait()
        assert reading == {"frame_id": frame_id}
        return picture

    latest.saw(older, 4)
    later = threading.Timer(0.02, latest.saw, (image, 5))
    later.start()
    assert picture_of(5) is image
    later.join()
    latest.saw(newer, 6)
    assert picture_of(5) is image  # not the newest
    monkeypatch.setattr(bridge, "FRAME_WAIT_S", 0.0)
    # the monitor's own number, of a sender that gives none
    assert picture_of(77) is newer

    for frame_id in range(7, 7 + bridge.KEPT_FRAMES):
        latest.saw(older, frame_id)

    assert picture_of(6) is older  # let go
    latest.end()
    assert latest.wait() is None


def test_when_the_monitor_goes_the_scanners_connection_ends() -> None:
    with (
        fake_monitor() as monitor,
        bridge.run(0, 0, ("127.0.0.1", monitor.port)) as ports,
        Peer(ports[0]) as scanner,
    ):
        scanner.hear(lambda peer: len(peer.statuses()) > 0)
        assert isinstance(scanner.statuses()[0], Status)
        monitor.drop()
        scanner.hear()
        assert scanner.closed


class Scene:
    """A fake slicer.mrmlScene: mock nodes by name."""

    def __init__(self) -> None:
        self.nodes: dict[str, MagicMock] = {}
        self.kinds: dict[str, str] = {}

    def AddNewNodeByClass(self, kind: str, name: str) -> MagicMock:  # noqa: N802 - Slicer's name
        self.nodes[name] = MagicMock(name=name)
        self.kinds[name] = kind
        return self.nodes[name]

    def GetFirstNodeByName(self, name: str) -> MagicMock | None:  # noqa: N802 - Slicer's name
        return self.nodes.get(name)

    def RemoveNode(self, node: MagicMock) -> None:  # noqa: N802 - Slicer's name
        self.nodes = {
            name: other for name, other in self.nodes.items() if other is not node
        }


@pytest.fixture
def slicer(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Fakes of Slicer's modules, with the scene and the module that is loaded with
    them.
    """
    base = type("Base", (), {"__init__": lambda *_: None})
    scripted = ModuleType("slicer.ScriptedLoadableModule")

    for name in (
        "ScriptedLoadableModule",
        "ScriptedLoadableModuleLogic",
        "ScriptedLoadableModuleWidget",
    ):
        setattr(scripted, name, base)

    package = ModuleType("slicer")
    package.mrmlScene = Scene()
    package.util = MagicMock()
    package.app = MagicMock()

    for name, module in {
        "slicer": package,
        "slicer.ScriptedLoadableModule": scripted,
        "qt": MagicMock(),
        "vtk": MagicMock(),
    }.items():
        monkeypatch.setitem(sys.modules, name, module)

    return SimpleNamespace(
        scene=package.mrmlScene,
        util=package.util,
        app=package.app,
        module=example_module("slicer/ForceMonitor"),
    )


def test_the_module_connects_as_a_client_and_shows_what_comes(
    slicer: SimpleNamespace,
) -> None:
    logic = slicer.module.ForceMonitorLogic()
    logic.connect("lab", 18947)
    assert slicer.scene.kinds["Force monitor"] == "vtkMRMLIGTLConnectorNode"
    logic.connector.SetTypeClient.assert_called_once_with("lab", 18947)
    logic.connector.Start.assert_called_once_with()
    logic.update()  # nothing has come yet
    slicer.util.setSliceViewerLayers.assert_not_called()

    for device in (bridge.VIEW, bridge.BAR, bridge.WORDS):
        slicer.scene.AddNewNodeByClass("received", device)

    slicer.scene.nodes[bridge.WORDS].GetText.return_value = "12.0 mN"
    logic.update()
    logic.update()
    slicer.util.setSliceViewerLayers.assert_called_with(
        background=slicer.scene.nodes[bridge.VIEW]
    )
    bar = slicer.scene.nodes["Force"]
    bar.SetAndObserveTransformNodeID.assert_called_with(
        slicer.scene.nodes[bridge.BAR].GetID()
    )
    # one bar, however often it is updated
    assert bar.SetAndObservePolyData.call_count == 1
    corner = (
        slicer.app.layoutManager().sliceWidget("Red").sliceView().cornerAnnotation()
    )
    assert corner.SetText.call_args[0][1] == "12.0 mN"
