"""Recordings that are written frame by frame, and in the formats of other programs."""

import csv
import re
import shutil
from collections import Counter
from dataclasses import replace
from io import StringIO

import matplotlib.image
import numpy as np
import pytest
from foreign_files import check_scan, write_table
from small_recordings import COLUMNS, LOGGED_INFO, ROWS, write_small_recording

from scleraforce.base.errors import InputError, RecordingError
from scleraforce.recordings.exported_files import (
    csv_text,
    read_answers,
    with_answers,
    write_mcap,
    write_sequence,
)
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.formats.ros_bags import read_bag
from scleraforce.recordings.formats.volume_files import read_nrrd
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.recordings.recording_writer import ForceWriter, RecordingWriter
from scleraforce.records.recording_info import ForceInfo

INFO = replace(
    LOGGED_INFO,
    scan=replace(LOGGED_INFO.scan, columns=20, bits=16, tilt_rad=0.0),
    force=ForceInfo("fz", -1, 0.2),
)
RNG = np.random.default_rng(0)
FRAMES = RNG.integers(0, 2**16, (9, 16, 20)).astype(np.uint16)


def write_one_frame(folder, info=INFO):
    writer = RecordingWriter(folder, info, "A test.")
    writer.add("0000001.png", 1.0, FRAMES[0])
    return writer


def test_a_recording_is_read_back_after_each_frame(tmp_path):
    folder = tmp_path / "a" / "rec"
    writer = RecordingWriter(folder, INFO, "A test.")
    for number, pixels in enumerate(FRAMES):
        writer.add(f"{number:07d}.png", number / 3, pixels)
        recording = read_recording(folder)
        assert recording.info == INFO
        times_s = [round(n / 3, 6) for n in range(number + 1)]
        assert [entry.time_s for entry in recording.frames] == times_s
        assert (recording.frame(recording.frames[-1]) == pixels).all()

    writer.close()
    assert (folder / "recording.toml").read_text().startswith("# A test.\n")
    with pytest.raises(FileExistsError):
        RecordingWriter(folder, INFO, "Another one.")


@pytest.mark.parametrize("axes", [("fz_n",), FORCE_COLUMNS[1:4], FORCE_COLUMNS[1:]])
def test_no_line_lies_across_two_pages_or_is_padded(tmp_path, axes):
    writer = RecordingWriter(tmp_path / "rec", INFO, "A test.")
    log = ForceWriter(tmp_path, axes)
    for number in range(300):
        writer.add(f"{number:07d}.png", -1e6 + number / 3, FRAMES[0])
        log.add(99999.995 + number * 0.01, [-1.2345678e-5] * len(axes))

    for path in tmp_path.rglob("*.csv"):
        lines = path.read_bytes().splitlines(keepends=True)
        assert len(lines) == 301
        ends = np.cumsum([len(line) for line in lines])
        assert ((ends - 1) // 4096 == np.r_[0, ends[:-1]] // 4096).all()
        assert not re.search(r"(^|,)[ \t]|[ \t](,|$)", path.read_text(), re.MULTILINE)


def test_a_frame_that_cannot_be_written_is_not_listed(tmp_path, monkeypatch):
    writer = write_one_frame(tmp_path / "rec")

    def full(*_):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr("os.write", full)
        with pytest.raises(OSError, match="No space"):
            writer.add("0000002.png", 2.0, FRAMES[2])

    writer.add("0000003.png", 3.0, FRAMES[3])
    names = [entry.file for entry in read_recording(tmp_path / "rec").frames]
    assert names == ["0000001.png", "0000003.png"]


def times(gaps):
    """Return the middles of steps of 10 ms, with these numbers of steps between
    them.
    """
    return (np.cumsum([0, *gaps]) + 0.5) * 0.01


@pytest.mark.parametrize("start_s", [0.0, -40.0, 1234.56])
def test_the_log_has_the_name_under_which_it_is_read_exactly_while_its_reader_takes_it(
    tmp_path, start_s
):
    folder = tmp_path / "rec"
    other = tmp_path / "slow"
    write_one_frame(folder)
    write_one_frame(other)
    gaps = [1, 5, 6, 6, 6, 3, 1, 5, 1, 9, 9, 9, 9, 9, 1, 1, 5, 5, 1, 1]
    times_s = times(gaps) + start_s
    log = ForceWriter(folder, ("fz_n",))
    is_read = []

    for time_s in times_s:
        log.add(time_s, [0.001])
        is_read.append((folder / "forces.csv").exists())
        slow = folder / "robot_forces.csv"
        assert slow.exists() != is_read[-1]
        if is_read[-1]:
            assert read_recording(folder).forces is not None
            continue

        shutil.copyfile(slow, other / "forces.csv")
        with pytest.raises(RecordingError):
            read_recording(other)

    log.close()
    assert {*is_read} == {True, False}
    assert read_recording(folder).forces.time_s == pytest.approx(times_s)


def test_forces_keep_eight_digits_and_their_columns(tmp_path):
    folder = tmp_path / "rec"
    write_one_frame(folder, replace(INFO, force=ForceInfo("fx", 1, 0.2)))
    log = ForceWriter(folder, ("fx_n", "fy_n", "fz_n"))
    values = RNG.standard_normal((100, 3)) * [1e-6, 1e-2, 1e3]
    for time_s, row in zip(times([1] * 99), values, strict=True):
        log.add(time_s, row.tolist())

    forces = read_recording(folder).forces
    assert forces.columns == ("fx_n", "fy_n", "fz_n")
    assert np.allclose(forces.wrench_sc, values, rtol=1e-7, atol=0)
    log.set_aside()
    assert read_recording(folder).forces is None
    assert (folder / "robot_forces.csv").exists()


@pytest.mark.parametrize("shape", [(2, 2), (2, 3), (512, 512), (3, 16384), (700, 2)])
def test_opencv_and_pillow_read_back_every_pixel_of_a_frame_that_is_not_compressed(
    tmp_path, shape
):
    pixels = RNG.integers(0, 2**16, shape, np.uint16)
    RecordingWriter(tmp_path / "r", INFO, "A test.").add("1.png", 0.0, pixels)
    frame = tmp_path / "r" / "frames" / "1.png"
    assert (read_frame(frame) == pixels).all()  # walks the chunks and their checksums
    assert (np.rint(matplotlib.image.imread(frame) * 65535) == pixels).all()
    more_bytes = frame.stat().st_size - shape[0] * (1 + 2 * shape[1])
    assert 0 < more_bytes < 100 + 0.01 * pixels.nbytes


def test_answers_join_the_rows_of_their_frames_with_the_classes_of_their_model(
    tmp_path,
):
    rows = [{"file": f"{n}.png", "time_s": float(n), "target": 1} for n in range(3)]
    answers = [
        {"file": "/else/where/1.png", "predicted": 2, "target": 0, "time_s": 9.0},
        {"file": "2.png", "recording": str(tmp_path / "other"), "predicted": 7},
        {"file": "0.png", "recording": "old/place/r", "predicted": 0},
    ]
    joined = with_answers(rows, answers, tmp_path / "r")
    assert [row.get("predicted") for row in joined] == [0, 2, None]
    assert [row["target"] for row in joined] == [1, 0, 1]
    assert [row["time_s"] for row in joined] == [0.0, 1.0, 2.0]
    with pytest.raises(InputError, match="none of its frames is among the answers"):
        with_answers(rows, [{"file": "9.png"}], tmp_path / "r")


def test_answers_join_frames_of_one_name_in_two_folders(tmp_path):
    rows = [{"file": file, "target": None} for file in ("1.png", "a/1.png", "b/1.png")]
    answers = [{"file": "a/1.png", "predicted": 1}, {"file": "b/1.png", "predicted": 2}]
    joined = with_answers(rows, answers, tmp_path)
    assert [row.get("predicted") for row in joined] == [None, 1, 2]


def table_of(*rows):
    return list(csv.reader(StringIO(csv_text(rows), newline="")))


def test_a_table_has_a_column_for_each_number_of_any_row():
    good = {
        "file": "a, b.png",
        "usable": True,
        "force_mn": -1.5,
        "interval_mn": [1.5, None],
        "needle": {"tip": {"x": 1}},
    }
    dark = {"file": "c.png", "usable": False, "interval_mn": None, "reason": "dark"}
    assert table_of(good, {**dark, "needle": None}) == [
        [
            "file",
            "usable",
            "force_mn",
            "interval_low_mn",
            "interval_high_mn",
            "needle_tip_x",
            "reason",
        ],
        ["a, b.png", "1", "-1.5", "1.5", "", "1", ""],
        ["c.png", "0", "", "", "", "", "dark"],
    ]


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        "{}",
        "{",
        '{"frames": 3}',
        '{"frames": [{"a": 1}]}',
        '{"frames": [NaN]}',
        '{"frames": [{"file": 1}]}',
        '{"frames": [{"file": "x", "recording": 1}]}',
    ],
)
def test_a_file_without_answers_is_refused(tmp_path, text):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(InputError, match=r"a\.json: "):
        read_answers(tmp_path / "a.json")


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("=1+1", "'=1+1"),
        ("+1", "'+1"),
        ("-1", "'-1"),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("\t=1", "'\t'=1"),
        ("\r=1", "'\r'=1"),
        ("\n=1", "'\n'=1"),
        ("\tx", "'\tx"),
        ("x;=1+1", "x;'=1+1"),
        ("x; \t@A1;b", "x;' \t'@A1;b"),
        ("a|-1,+2", "a|'-1,'+2"),
        ("\uff1d1", "'\uff1d1"),
        ("a\n=1", "a\n'=1"),
        ("a=b -c; d.png", "a=b -c; d.png"),
        ("'quoted", "'quoted"),
    ],
)
def test_no_text_begins_as_a_formula_does(text, cell):
    """Nor does a part of it, where another program separates cells."""
    found = table_of({"file": text, "deep": {"note": text}, text: 1})
    assert found == [["file", "deep_note", cell], [cell, cell, "1"]]


def test_a_sequence_is_what_slicer_reads(tmp_path):
    nrrd = pytest.importorskip("nrrd")
    recording = read_recording(write_small_recording(tmp_path / "r", frames=4))
    path = tmp_path / "a.seq.nrrd"
    write_sequence(recording, path)
    array, header = nrrd.read(str(path), index_order="F")
    assert array.shape == (COLUMNS, ROWS, 1, 4)
    assert [*header["kinds"]] == ["domain", "domain", "domain", "list"]
    assert header["axis 3 index type"] == "numeric"
    nowhere = [np.nan] * 3  # of the axis of frames
    directions = [*np.diag([8.0 / COLUMNS, 3.0 / ROWS, 0.1]), nowhere]
    np.testing.assert_allclose(header["space directions"], directions)
    text = path.read_bytes().partition(b"\n\n")[0].decode()
    assert "axis 3 index values:=1.000000 1.010000 1.020000 1.030000" in text
    assert "none" in text


@pytest.mark.parametrize("count", [1, 4])
def test_a_sequence_can_be_imported_again(tmp_path, count):
    recording = read_recording(write_small_recording(tmp_path / "r", frames=count))
    write_sequence(recording, tmp_path / "a.nrrd")
    frames = [recording.frame(entry) for entry in recording.frames]
    sizes_m = (0.003 / ROWS, 0.008 / COLUMNS)
    times_s = [entry.time_s for entry in recording.frames]
    check_scan(read_nrrd(tmp_path / "a.nrrd", None), frames, sizes_m, times_s)


ORIGIN_S = 1_700_000_000.0
ANSWER = {"predicted_force_mn": 3.0, "predicted": 1, "usable": True}


@pytest.fixture
def exported(tmp_path):
    """A recording, and the MCAP of it with an answer for each frame."""
    recording = read_recording(write_small_recording(tmp_path / "r", frames=6))
    answer = {"target": None, "interval_mn": [2.0, 5.0], **ANSWER}
    rows = [{"file": entry.file, **answer} for entry in recording.frames]
    write_mcap(recording, rows, ORIGIN_S, tmp_path / "a.mcap")
    return recording, tmp_path / "a.mcap"


def test_an_mcap_is_in_the_order_of_its_times(exported):
    recording, path = exported
    reader = pytest.importorskip("mcap.reader")
    with path.open("rb") as file:
        messages = reader.make_reader(file).iter_messages(log_time_order=False)
        found = [(message.log_time, channel.topic) for _, channel, message in messages]

    assert found == sorted(found, key=lambda each: each[0])
    counts = Counter(topic for _, topic in found)
    assert sorted(counts.values()) == [6, 6, len(recording.forces.time_s)]


def test_the_answers_in_an_mcap_have_a_definition_that_others_read(exported):
    recording, path = exported
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([path]) as bag:
        connections = [each for each in bag.connections if "answer" in each.topic]
        answers = [
            bag.deserialize(data, each.msgtype)
            for each, _, data in bag.messages(connections)
        ]

    known = {**ANSWER, "interval_low_mn": 2.0, "interval_high_mn": 5.0, "target": -1}
    for entry, each in zip(recording.frames, answers, strict=True):
        assert {**vars(each), **known, "file": entry.file} == vars(each)
        assert np.isnan(each.measured_force_mn)


def test_an_mcap_can_be_imported_again(exported):
    recording, path = exported
    scan, log = read_bag(path)
    frames = [recording.frame(entry) for entry in recording.frames]
    times_s = [ORIGIN_S + entry.time_s for entry in recording.frames]
    check_scan(scan, frames, time_s=times_s)
    np.testing.assert_allclose(log.wrench_sc, recording.forces.wrench_sc)
    since_s = log.time_s - ORIGIN_S
    np.testing.assert_allclose(since_s, recording.forces.time_s, atol=1e-6)


def test_an_axis_that_was_not_logged_is_nan(tmp_path):
    pytest.importorskip("rosbags")
    folder = write_small_recording(tmp_path / "r", frames=3)
    rows = [(time_s, 0.5) for time_s in (1.0, 1.005, 1.01)]
    write_table(folder / "forces.csv", "time_s,fz_n", *rows)
    recording = read_recording(folder)
    files = [{"file": entry.file} for entry in recording.frames]
    write_mcap(recording, files, 0.0, tmp_path / "a.mcap")
    log = read_bag(tmp_path / "a.mcap")[1]
    assert log.columns == ("fz_n",)
    np.testing.assert_array_equal(log.wrench_sc, np.full((3, 1), 0.5))
