"""The reader: a lazy stack of frames in mm."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from napari.components import ViewerModel
from napari.layers import Image
from npe2 import PluginManager, PluginManifest

import scleraforce as sf
from napari_scleraforce.recordings import layers, reader_of


def test_the_manifest_is_valid_and_its_commands_can_be_imported() -> None:
    manifest = PluginManifest.from_distribution("napari-scleraforce")
    manifest.validate_imports()
    assert [widget.display_name for widget in manifest.contributions.widgets or ()] == [
        "Walls and forces"
    ]


def test_recordings_are_opened_and_other_folders_are_not(
    eye: Path, tmp_path: Path
) -> None:
    assert reader_of(str(eye)) is layers
    assert reader_of([str(eye), str(eye)]) is layers
    assert reader_of(str(tmp_path)) is None
    assert reader_of(str(eye / "frames.csv")) is None


def test_npe2_opens_a_recording_with_this_reader(eye: Path) -> None:
    manager = PluginManager()
    manager.register(PluginManifest.from_distribution("napari-scleraforce"))
    (reader,) = manager.iter_compatible_readers([str(eye)])
    assert reader.command == "napari-scleraforce.open"


def test_frames_are_read_when_they_are_shown(
    eye: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recording = sf.read_recording(eye)
    read: list[str] = []
    frame = type(recording).frame

    def counted(self: Any, entry: Any) -> Any:
        read.append(entry.file)
        return frame(self, entry)

    monkeypatch.setattr(type(recording), "frame", counted)
    ((stack, _, kind),) = layers(str(eye))
    # for the type of the pixels
    assert (kind, read) == (
        "image",
        [recording.frames[0].file],
    )
    second = np.asarray(stack[1])
    assert read[1:] == [recording.frames[1].file]
    np.testing.assert_array_equal(second, frame(recording, recording.frames[1]))


def test_a_pixel_lies_in_mm_and_the_whole_frame_is_as_large_as_the_scan(
    eye: Path,
) -> None:
    width_m, depth_m = sf.read_recording(eye).info.scan.extent_m
    ((stack, described, _),) = layers([str(eye)])
    layer: Any = ViewerModel().add_layer(Image(stack, **described))
    assert tuple(map(str, layer.units)) == ("pixel", "millimeter", "millimeter")
    size_mm = np.diff(layer.extent.world, axis=0)[0] + layer.scale
    np.testing.assert_allclose(size_mm[1:], [1e3 * depth_m, 1e3 * width_m])
    np.testing.assert_allclose(
        layer.data_to_world((2, 100, 50)), [2, *(layer.scale[1:] * (100, 50))]
    )


def test_a_damaged_recording_is_one_line(eye: Path) -> None:
    (eye / "recording.toml").write_text("[eye]\nid = 1\n")
    with pytest.raises(sf.InputError, match=r"recording\.toml"):
        layers(str(eye))
