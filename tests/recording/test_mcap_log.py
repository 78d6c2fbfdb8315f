"""MCAP: read back with MCAP's own library and rosbags, and imported."""

from pathlib import Path

import numpy as np
import pytest
from small_recording import COLUMNS, ROWS, write_small_recording

from scleraforce.recording.bags import read_bag
from scleraforce.recording.export import ANSWER_TOPIC, FORCE_TOPIC, IMAGE_TOPIC, write_mcap
from scleraforce.recording.folder import read_recording

ORIGIN_S = 1_700_000_000.0


@pytest.fixture
def written(tmp_path: Path):
    """A recording, and the messages of its MCAP: topic and log time."""
    pytest.importorskip("rosbags")
    reader = pytest.importorskip("mcap.reader")
    recording = read_recording(write_small_recording(tmp_path / "r", frames=6))
    answer = {"predicted_force_mn": 3.0, "interval_mn": [2.0, 5.0], "predicted": 1, "usable": True}
    rows = [{"file": entry.file, "target": None, **answer} for entry in recording.frames]
    write_mcap(recording, rows, ORIGIN_S, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("rb") as file:
        found = [
            (channel.topic, message.log_time)
            for _, channel, message in reader.make_reader(file).iter_messages(log_time_order=False)
        ]
    return recording, tmp_path / "a.mcap", found


def test_messages_stand_in_the_order_of_their_times(written) -> None:
    recording, _, found = written
    times = [time_ns for _, time_ns in found]
    assert times == sorted(times)
    count = {topic: sum(each == topic for each, _ in found) for topic in (IMAGE_TOPIC, FORCE_TOPIC, ANSWER_TOPIC)}
    assert count == {IMAGE_TOPIC: 6, FORCE_TOPIC: len(recording.forces.time_s), ANSWER_TOPIC: 6}


def test_answers_have_a_definition_that_others_read(written) -> None:
    from rosbags.highlevel import AnyReader

    recording, path, _ = written
    with AnyReader([path]) as bag:
        connections = [each for each in bag.connections if each.topic == ANSWER_TOPIC]
        answers = [bag.deserialize(data, each.msgtype) for each, _, data in bag.messages(connections)]
    for entry, answer in zip(recording.frames, answers, strict=True):
        assert (answer.file, answer.predicted_force_mn, answer.predicted, answer.usable) == (entry.file, 3.0, 1, True)
        assert (answer.interval_low_mn, answer.interval_high_mn, answer.target) == (2.0, 5.0, -1)
        assert np.isnan(answer.measured_force_mn)


def test_it_can_be_imported_again(written) -> None:
    recording, path, _ = written
    scan, log = read_bag(path)
    assert (scan.rows, scan.columns) == (ROWS, COLUMNS)
    for entry, picture, time_s in zip(recording.frames, scan.pictures(), scan.times.time_s, strict=True):
        np.testing.assert_array_equal(picture, recording.frame(entry))
        assert time_s - ORIGIN_S == pytest.approx(entry.time_s, abs=1e-6)
    np.testing.assert_allclose(log.wrench_sc, recording.forces.wrench_sc)
    np.testing.assert_allclose(log.time_s - ORIGIN_S, recording.forces.time_s, atol=1e-6)


def test_an_axis_that_was_not_logged_is_no_zero(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    folder = write_small_recording(tmp_path / "r", frames=3)
    (folder / "forces.csv").write_text("time_s,fz_n\n1.0,0.5\n1.005,0.5\n1.01,0.5\n")
    recording = read_recording(folder)
    rows = [{"file": entry.file} for entry in recording.frames]
    write_mcap(recording, rows, 0.0, tmp_path / "a.mcap")
    log = read_bag(tmp_path / "a.mcap")[1]
    assert log.columns == ("fz_n",)
    np.testing.assert_array_equal(log.wrench_sc, np.full((3, 1), 0.5))
