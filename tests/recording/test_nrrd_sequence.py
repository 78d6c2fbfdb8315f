"""Sequences of 3D Slicer: the header that its developer guide describes, and the way back."""

from pathlib import Path

import numpy as np
import pytest
from small_recording import COLUMNS, ROWS, write_small_recording

from scleraforce.recording.export import write_sequence
from scleraforce.recording.folder import read_recording
from scleraforce.recording.volumes import read_nrrd

nrrd = pytest.importorskip("nrrd")


def test_the_header_is_what_slicer_reads_as_a_sequence(tmp_path: Path) -> None:
    recording = read_recording(write_small_recording(tmp_path / "r", frames=4))
    write_sequence(recording, tmp_path / "a.seq.nrrd")
    array, header = nrrd.read(str(tmp_path / "a.seq.nrrd"), index_order="F")
    assert array.shape == (COLUMNS, ROWS, 1, 4)
    assert list(header["kinds"]) == ["domain", "domain", "domain", "list"]
    assert header["axis 3 index type"] == "numeric"
    assert header["axis 3 index values"] == "1.000000 1.010000 1.020000 1.030000"
    np.testing.assert_allclose(header["space directions"][:3], np.diag([8.0 / COLUMNS, 3.0 / ROWS, 0.1]))
    assert np.isnan(header["space directions"][3]).all()
    text = (tmp_path / "a.seq.nrrd").read_bytes().partition(b"\n\n")[0].decode()
    assert "axis 3 index values:=1.0" in text
    assert "none" in text
    np.testing.assert_array_equal(array[:, :, 0, 2].T, recording.frame(recording.frames[2]))


@pytest.mark.parametrize("frames", [1, 4])
def test_it_can_be_imported_again_with_scale_and_times(tmp_path: Path, frames: int) -> None:
    recording = read_recording(write_small_recording(tmp_path / "r", frames=frames, log=False))
    write_sequence(recording, tmp_path / "a.nrrd")
    scan = read_nrrd(tmp_path / "a.nrrd", None)
    for entry, picture in zip(recording.frames, scan.pictures(), strict=True):
        np.testing.assert_array_equal(picture, recording.frame(entry))
    assert scan.lateral_pixel_m.value == pytest.approx(0.008 / COLUMNS)
    assert scan.depth_pixel_m.value == pytest.approx(0.003 / ROWS)
    np.testing.assert_allclose(scan.times.time_s, [entry.time_s for entry in recording.frames])
