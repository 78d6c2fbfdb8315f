"""Recordings that are written frame by frame, and in the formats of other programs."""

import csv
from collections import Counter
from dataclasses import replace
from io import StringIO

import matplotlib.image
import numpy as np
import pytest
from foreign_files import sizes_of, with_log
from small_recordings import COLUMNS, LOGGED_INFO, ROWS, write_small_recording

from scleraforce.base.errors import InputError, RecordingError
from scleraforce.front.cli.main import run
from scleraforce.recordings import exported_files
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.formats.ros_bags import read_bag
from scleraforce.recordings.formats.volume_files import read_nrrd
from scleraforce.recordings.frame_and_force_tables import FORCE_COLUMNS, read_force_log
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


def test_a_recording_is_read_back_after_each_frame(tmp_path):
    writer = RecordingWriter(tmp_path / "a" / "rec", INFO, "A test.")
    for number, pixels in enumerate(FRAMES):
        writer.add(f"{number:07d}.png", number / 3, pixels)
        recording = read_recording(tmp_path / "a" / "rec")
        assert recording.info == INFO
        assert [entry.time_s for entry in recording.frames] == [
            round(n / 3, 6) for n in range(number + 1)
        ]
        assert (recording.frame(recording.frames[-1]) == pixels).all()

    writer.close()
    assert (
        (tmp_path / "a" / "rec" / "recording.toml")
        .read_text()
        .startswith("# A test.\n")
    )

    with pytest.raises(FileExistsError):
        RecordingWriter(tmp_path / "a" / "rec", INFO, "Another one.")


def test_no_line_lies_across_two_pages_or_is_padded(tmp_path):
    writer = RecordingWriter(tmp_path / "rec", INFO, "A test.")
    forces = {}
    for columns in (("fz_n",), FORCE_COLUMNS[1:4], FORCE_COLUMNS[1:]):
        (tmp_path / str(len(columns))).mkdir()
        forces[len(columns)] = ForceWriter(tmp_path / str(len(columns)), columns)

    for number in range(300):
        writer.add(f"{number:07d}.png", -1e6 + number / 3, FRAMES[0])
        for count, log in forces.items():
            log.add(99999.995 + number * 0.01, [-1.2345678e-5] * count)

    for path in tmp_path.rglob("*.csv"):
        lines = path.read_bytes().splitlines(keepends=True)
        assert len(lines) == 301
        ends = np.cumsum([len(line) for line in lines])
        assert ((ends - 1) // 4096 == np.r_[0, ends[:-1]] // 4096).all()
        assert all(
            field == field.strip()
            for row in csv.reader(path.read_text().splitlines())
            for field in row
        )


def test_a_frame_that_cannot_be_written_is_not_listed(tmp_path, monkeypatch):
    writer = RecordingWriter(tmp_path / "rec", INFO, "A test.")
    writer.add("0000001.png", 1.0, FRAMES[1])

    with monkeypatch.context() as disk:
        disk.setattr(
            "os.write",
            lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")),
        )

        with pytest.raises(OSError, match="No space"):
            writer.add("0000002.png", 2.0, FRAMES[2])

    writer.add("0000003.png", 3.0, FRAMES[3])
    assert [entry.file for entry in read_recording(tmp_path / "rec").frames] == [
        "0000001.png",
        "0000003.png",
    ]


def times(gaps):
    """Return the middles of steps of 10 ms, with these numbers of steps between
    them.
    """
    return (np.cumsum([0, *gaps]) + 0.5) * 0.01


def test_the_log_has_the_name_under_which_it_is_read_exactly_while_its_reader_takes_it(
    tmp_path,
):
    for start in [0, -4000, 123_456]:
        place = tmp_path / str(start)
        place.mkdir()
        gaps = [1, 5, 6, 6, 6, 3, 1, 5, 1, 9, 9, 9, 9, 9, 1, 1, 5, 5, 1, 1]
        log = ForceWriter(place, ("fz_n",))
        seen = set()

        for time_s in times(gaps) + start * 0.01:
            log.add(time_s, [0.001])
            fast = place / "forces.csv"
            slow = place / "robot_forces.csv"
            seen.add(fast.exists())

            if fast.exists():
                read_force_log(fast, "fz")
                assert not slow.exists()
            else:
                with pytest.raises(RecordingError):
                    read_force_log(slow, "fz")

        log.close()
        assert seen == {True, False}
        assert read_force_log(place / "forces.csv", "fz").time_s == pytest.approx(
            times(gaps) + start * 0.01
        )


def test_forces_keep_eight_digits_and_their_columns(tmp_path):
    writer = RecordingWriter(
        tmp_path / "rec", replace(INFO, force=ForceInfo("fx", 1, 0.2)), "A test."
    )
    writer.add("0000001.png", 0.5, FRAMES[0])
    log = ForceWriter(tmp_path / "rec", ("fx_n", "fy_n", "fz_n"))
    values = RNG.standard_normal((100, 3)) * [1e-6, 1e-2, 1e3]

    for time_s, row in zip(times([1] * 99), values, strict=True):
        log.add(time_s, row.tolist())

    forces = read_recording(tmp_path / "rec").forces
    assert forces.columns == ("fx_n", "fy_n", "fz_n")
    assert np.allclose(forces.wrench_sc, values, rtol=1e-7, atol=0)
    log.set_aside()
    assert (
        read_recording(tmp_path / "rec").forces,
        (tmp_path / "rec" / "robot_forces.csv").exists(),
    ) == (None, True)


def test_opencv_and_pillow_read_back_every_pixel_of_a_frame_that_is_not_compressed(
    tmp_path,
):
    for rows, columns in [(2, 2), (2, 3), (512, 512), (3, 16384), (700, 2)]:
        pixels = RNG.integers(0, 2**16, (rows, columns)).astype(np.uint16)
        place = tmp_path / f"{rows}x{columns}"
        RecordingWriter(place, INFO, "A test.").add("1.png", 0.0, pixels)
        frame = place / "frames" / "1.png"
        assert (
            read_frame(frame) == pixels
        ).all()  # walks the chunks and their checksums
        assert (np.rint(matplotlib.image.imread(frame) * 65535) == pixels).all()
        assert (
            0
            < frame.stat().st_size - rows * (1 + 2 * columns)
            < 100 + 0.01 * pixels.nbytes
        )


def test_answers_join_the_rows_of_their_frames_with_the_classes_of_their_model(
    tmp_path,
):
    rows = [{"file": f"{n}.png", "time_s": float(n), "target": 1} for n in range(3)]
    answers = [
        {"file": "/else/where/1.png", "predicted": 2, "target": 0, "time_s": 9.0},
        {"file": "2.png", "recording": str(tmp_path / "other"), "predicted": 7},
        {"file": "0.png", "recording": "old/place/r", "predicted": 0},
    ]
    joined = exported_files.with_answers(rows, answers, tmp_path / "r")
    assert [row.get("predicted") for row in joined] == [0, 2, None]
    assert [row["target"] for row in joined] == [1, 0, 1]
    assert [row["time_s"] for row in joined] == [0.0, 1.0, 2.0]

    with pytest.raises(InputError, match="none of its frames is among the answers"):
        exported_files.with_answers(rows, [{"file": "9.png"}], tmp_path / "r")

    # of one name in two folders
    rows = [{"file": file, "target": None} for file in ("1.png", "a/1.png", "b/1.png")]
    answers = [{"file": "a/1.png", "predicted": 1}, {"file": "b/1.png", "predicted": 2}]
    assert [
        row.get("predicted")
        for row in exported_files.with_answers(rows, answers, tmp_path)
    ] == [None, 1, 2]


def test_a_table_has_a_column_for_each_number_of_any_row():
    rows = [
        {
            "file": "a, b.png",
            "usable": True,
            "interval_mn": [1.5, None],
            "needle": {"tip": {"x": 1}},
        },
        {
            "file": "c.png",
            "usable": False,
            "interval_mn": None,
            "reason": "dark",
            "needle": None,
        },
    ]
    found = list(csv.DictReader(StringIO(exported_files.csv_text(rows))))
    assert list(found[0]) == [
        "file",
        "usable",
        "interval_low_mn",
        "interval_high_mn",
        "needle_tip_x",
        "reason",
    ]
    assert [list(row.values()) for row in found] == [
        ["a, b.png", "1", "1.5", "", "1", ""],
        ["c.png", "0", "", "", "", "dark"],
    ]


def test_a_file_without_answers_is_refused(tmp_path):
    frames = [
        "3",
        '[{"a": 1}]',
        "[NaN]",
        '[{"file": 1}]',
        '[{"file": "x", "recording": 1}]',
    ]
    for text in ["[]", "{}", "{", *(f'{{"frames": {each}}}' for each in frames)]:
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(InputError, match=r"a\.json: "):
            exported_files.read_answers(tmp_path / "a.json")


def test_no_text_begins_as_a_formula_does_and_numbers_stay_numbers():
    """Nor does a part of it, where another program separates cells."""
    for text, cell in {
        "=1+1": "'=1+1",
        "+1": "'+1",
        "-1": "'-1",
        "@SUM(A1)": "'@SUM(A1)",
        "\t=1": "'\t'=1",
        "\r=1": "'\r'=1",
        "\n=1": "'\n'=1",
        "\tx": "'\tx",
        '=cmd|" /C calc"!A0': """'=cmd|" /C calc"!A0""",
        "x;=1+1": "x;'=1+1",
        "x; \t@A1;b": "x;' \t'@A1;b",
        "a|-1,+2": "a|'-1,'+2",
        "\uff1d1": "'\uff1d1",
        "a\n=1": "a\n'=1",
    }.items():
        table = exported_files.csv_text(
            [{"file": text, "deep": {"note": text}, text: 1}]
        )
        found = list(csv.reader(StringIO(table, newline="")))
        assert found == [["file", "deep_note", cell], [cell, cell, "1"]]

    row = {
        "force_mn": -1.5,
        "count": -2,
        "flag": True,
        "file": "a=b -c; d.png",
        "note": "'quoted",
    }
    assert (
        exported_files.csv_text([row]).splitlines()[1]
        == "-1.5,-2,1,a=b -c; d.png,'quoted"
    )


def test_answers_of_a_command_become_columns(tmp_path, capsys):
    recording = with_log(write_small_recording(tmp_path / "r", frames=3))
    assert run(["evaluate", "default", str(recording), "--json"]) == 0
    (tmp_path / "a.json").write_text(capsys.readouterr().out)
    assert (
        run(
            [
                "export",
                str(recording),
                "--answers",
                str(tmp_path / "a.json"),
                "--out",
                str(tmp_path / "a.csv"),
            ]
        )
        == 0
    )
    columns = (tmp_path / "a.csv").read_text().partition("\n")[0].split(",")
    assert {
        "time_s",
        "measured_force_mn",
        "predicted",
        "predicted_force_mn",
        "interval_low_mn",
    } <= {*columns}, columns


def test_a_sequence_is_what_slicer_reads_and_can_be_imported_again(
    tmp_path,
):
    nrrd = pytest.importorskip("nrrd")
    recording = read_recording(write_small_recording(tmp_path / "r", frames=4))
    exported_files.write_sequence(recording, tmp_path / "a.seq.nrrd")
    array, header = nrrd.read(str(tmp_path / "a.seq.nrrd"), index_order="F")
    assert (array.shape, *header["kinds"]) == (
        (COLUMNS, ROWS, 1, 4),
        "domain",
        "domain",
        "domain",
        "list",
    )
    assert header["axis 3 index type"] == "numeric"
    nowhere = [np.nan] * 3  # of the axis of frames
    directions = [*np.diag([8.0 / COLUMNS, 3.0 / ROWS, 0.1]), nowhere]
    np.testing.assert_allclose(header["space directions"], directions)
    text = (tmp_path / "a.seq.nrrd").read_bytes().partition(b"\n\n")[0].decode()
    assert "axis 3 index values:=1.000000 1.010000 1.020000 1.030000" in text
    assert "none" in text

    for number in [1, 4]:  # frames, which can be imported again
        one = replace(recording, frames=recording.frames[:number])
        exported_files.write_sequence(one, tmp_path / "a.nrrd")
        scan = read_nrrd(tmp_path / "a.nrrd", None)
        np.testing.assert_array_equal(
            list(scan.pictures()), [one.frame(entry) for entry in one.frames]
        )
        assert sizes_of(scan) == pytest.approx((0.003 / ROWS, 0.008 / COLUMNS))
        np.testing.assert_allclose(
            scan.times.time_s, [entry.time_s for entry in one.frames]
        )


def test_an_mcap_is_in_the_order_of_its_times_and_can_be_imported_again(
    tmp_path,
):
    highlevel = pytest.importorskip("rosbags.highlevel")
    reader = pytest.importorskip("mcap.reader")
    recording = read_recording(write_small_recording(tmp_path / "r", frames=6))
    origin_s = 1_700_000_000.0
    answer = {
        "predicted_force_mn": 3.0,
        "interval_mn": [2.0, 5.0],
        "predicted": 1,
        "usable": True,
    }
    rows = [
        {"file": entry.file, "target": None, **answer} for entry in recording.frames
    ]
    exported_files.write_mcap(recording, rows, origin_s, tmp_path / "a.mcap")

    with (tmp_path / "a.mcap").open("rb") as file:
        messages = reader.make_reader(file).iter_messages(log_time_order=False)
        found = [(message.log_time, channel.topic) for _, channel, message in messages]

    assert [time_ns for time_ns, _ in found] == sorted(time_ns for time_ns, _ in found)
    counts = {
        exported_files.IMAGE_TOPIC: 6,
        exported_files.FORCE_TOPIC: len(recording.forces.time_s),
        exported_files.ANSWER_TOPIC: 6,
    }
    assert Counter(topic for _, topic in found) == counts

    with highlevel.AnyReader(
        [tmp_path / "a.mcap"]
    ) as bag:  # the answers have a definition that others read
        connections = [
            each
            for each in bag.connections
            if each.topic == exported_files.ANSWER_TOPIC
        ]
        answers = [
            bag.deserialize(data, each.msgtype)
            for each, _, data in bag.messages(connections)
        ]

    known = {
        "predicted_force_mn": 3.0,
        "predicted": 1,
        "usable": True,
        "interval_low_mn": 2.0,
        "interval_high_mn": 5.0,
    }
    for entry, each in zip(recording.frames, answers, strict=True):
        assert {**vars(each), **known, "file": entry.file, "target": -1} == vars(each)
        assert np.isnan(each.measured_force_mn)

    scan, log = read_bag(tmp_path / "a.mcap")
    assert (scan.rows, scan.columns) == (ROWS, COLUMNS)

    for entry, picture, time_s in zip(
        recording.frames, scan.pictures(), scan.times.time_s, strict=True
    ):
        np.testing.assert_array_equal(picture, recording.frame(entry))
        assert time_s - origin_s == pytest.approx(entry.time_s, abs=1e-6)

    np.testing.assert_allclose(log.wrench_sc, recording.forces.wrench_sc)
    np.testing.assert_allclose(
        log.time_s - origin_s, recording.forces.time_s, atol=1e-6
    )


def test_an_axis_that_was_not_logged_is_nan(tmp_path):
    pytest.importorskip("rosbags")
    folder = write_small_recording(tmp_path / "r", frames=3)
    (folder / "forces.csv").write_text("time_s,fz_n\n1.0,0.5\n1.005,0.5\n1.01,0.5\n")
    recording = read_recording(folder)
    exported_files.write_mcap(
        recording,
        [{"file": entry.file} for entry in recording.frames],
        0.0,
        tmp_path / "a.mcap",
    )
    log = read_bag(tmp_path / "a.mcap")[1]
    assert log.columns == ("fz_n",)
    np.testing.assert_array_equal(log.wrench_sc, np.full((3, 1), 0.5))
