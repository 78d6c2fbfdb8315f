"""What a preview shows is to scale, and the curve is that of the contact force."""

from pathlib import Path

import numpy as np
import pytest
from format_frames import with_log
from small_recording import write_small_recording

from scleraforce.recording.folder import Recording, read_recording
from scleraforce.report.frames import FirstFrame, draw_preview


def drawn(recording: Recording, count: int):
    entries = recording.frames[:count]
    frames = [FirstFrame(entry.file, entry.time_s, recording.frame(entry)) for entry in entries]
    figure = draw_preview(recording, frames)
    figure.draw_without_rendering()
    return figure


def test_frames_and_bars_are_as_wide_and_deep_as_they_say(tmp_path: Path) -> None:
    recording = read_recording(write_small_recording(tmp_path / "r", frames=3, log=False))  # 8 mm x 3 mm
    figure = drawn(recording, 3)
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


def test_the_curve_is_the_contact_force_with_the_times_of_all_frames(tmp_path: Path) -> None:
    recording = read_recording(with_log(write_small_recording(tmp_path / "r", frames=12)))
    axes = drawn(recording, 2).axes[-1]
    raw, filtered = axes.lines
    np.testing.assert_allclose(raw.get_ydata(), -1e3 * recording.forces.force_n("fz"))  # contact_sign is -1
    assert filtered.get_ydata().max() == pytest.approx(10.0, abs=0.5)
    marks = [segment[0][0] for segment in axes.collections[0].get_segments()]
    assert marks == pytest.approx([frame.time_s for frame in recording.frames])
