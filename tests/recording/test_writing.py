"""Recordings that are written frame by frame."""

import csv
import zlib
from dataclasses import replace

import cv2
import matplotlib.image
import numpy as np
import pytest

from scleraforce.errors import RecordingError
from scleraforce.recording.folder import EyeInfo, ForceInfo, NeedleInfo, OctInfo, RecordingInfo, read_recording
from scleraforce.recording.images import read_frame
from scleraforce.recording.tables import read_force_log
from scleraforce.recording.writing import ForceWriter, PngBuffer, RecordingWriter
from scleraforce.whole_files import folder_when_whole

INFO = RecordingInfo(
    EyeInfo("eye", thickness_m=600e-6),
    OctInfo(columns=20, rows=16, bits=16, width_m=15e-3, depth_m=4e-3),
    NeedleInfo(gauge=22, slice_gap_m=0.5e-3),
    ForceInfo("fz", -1, 0.2),
)
RNG = np.random.default_rng(0)
FRAMES = RNG.integers(0, 2**16, (9, 16, 20)).astype(np.uint16)


def test_a_recording_is_read_back_after_each_frame(tmp_path):
    writer = RecordingWriter(tmp_path / "a" / "rec", INFO, "A test.")
    for number, pixels in enumerate(FRAMES):
        writer.add(f"{number:07d}.png", number / 3, pixels)
        recording = read_recording(tmp_path / "a" / "rec")
        assert recording.info == INFO
        assert [entry.time_s for entry in recording.frames] == [round(n / 3, 6) for n in range(number + 1)]
        assert (recording.frame(recording.frames[-1]) == pixels).all()
    writer.close()
    assert (tmp_path / "a" / "rec" / "recording.toml").read_text().startswith("# A test.\n")
    with pytest.raises(FileExistsError):
        RecordingWriter(tmp_path / "a" / "rec", INFO, "Another one.")


def test_no_line_lies_across_two_pages(tmp_path):
    writer = RecordingWriter(tmp_path / "rec", INFO, "A test.")
    forces = [ForceWriter(tmp_path / "rec", ("fz_n",))]
    for columns in (("fx_n", "fy_n", "fz_n"), ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")):
        (tmp_path / str(len(columns))).mkdir()
        forces.append(ForceWriter(tmp_path / str(len(columns)), columns))
    for number in range(300):
        writer.add(f"{number:07d}.png", -1e6 + number / 3, FRAMES[0])
        for log, count in zip(forces, (1, 3, 6), strict=True):
            log.add(99999.995 + number * 0.01, [-1.2345678e-5] * count)
    for path in tmp_path.rglob("*.csv"):
        lines = path.read_bytes().splitlines(keepends=True)
        assert len(lines) == 301
        ends = np.cumsum([len(line) for line in lines])
        assert ((ends - 1) // 4096 == np.r_[0, ends[:-1]] // 4096).all()


def test_the_tables_have_no_padding_for_any_csv_reader(tmp_path):
    writer = RecordingWriter(tmp_path / "rec", INFO, "A test.")
    log = ForceWriter(tmp_path / "rec", ("fx_n", "fz_n"))
    for number in range(200):
        writer.add(f"{number}.png", number / 3, FRAMES[0])
        log.add(number * 0.01, [1e-5 * number, -0.25])
    frames, forces = (
        list(csv.DictReader((tmp_path / "rec" / name).read_text().splitlines()))
        for name in ("frames.csv", "forces.csv")
    )
    assert [row["file"] for row in frames] == [f"{number}.png" for number in range(200)]
    assert [float(row["time_s"]) for row in frames] == [round(number / 3, 6) for number in range(200)]
    assert list(forces[0]) == ["time_s", "fx_n", "fz_n"]
    assert all(field == field.strip() for row in forces for field in row.values())
    assert [float(row["fx_n"]) for row in forces] == pytest.approx([1e-5 * number for number in range(200)])


def test_a_frame_that_cannot_be_written_is_not_listed(tmp_path, monkeypatch):
    writer = RecordingWriter(tmp_path / "rec", INFO, "A test.")
    writer.add("0000001.png", 1.0, FRAMES[1])
    with monkeypatch.context() as disk:
        disk.setattr("os.write", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device")))
        with pytest.raises(OSError, match="No space"):
            writer.add("0000002.png", 2.0, FRAMES[2])
    writer.add("0000003.png", 3.0, FRAMES[3])
    assert [entry.file for entry in read_recording(tmp_path / "rec").frames] == ["0000001.png", "0000003.png"]


def times(gaps):
    """Return the middles of steps of 10 ms, with these numbers of steps between them."""
    return (np.cumsum([0, *gaps]) + 0.5) * 0.01


def test_the_log_has_the_name_under_which_it_is_read_exactly_while_its_reader_takes_it(tmp_path):
    for start in [0, -4000, 123_456]:
        place = tmp_path / str(start)
        place.mkdir()
        gaps = [1, 5, 6, 6, 6, 3, 1, 5, 1, 9, 9, 9, 9, 9, 1, 1, 5, 5, 1, 1]
        log = ForceWriter(place, ("fz_n",))
        seen = set()
        for time_s in times(gaps) + start * 0.01:
            log.add(time_s, [0.001])
            fast, slow = place / "forces.csv", place / "robot_forces.csv"
            seen.add(fast.exists())
            if fast.exists():
                read_force_log(fast, "fz")
                assert not slow.exists()
            else:
                with pytest.raises(RecordingError):
                    read_force_log(slow, "fz")
        log.close()
        assert seen == {True, False}
        assert read_force_log(place / "forces.csv", "fz").time_s == pytest.approx(times(gaps) + start * 0.01)


def test_forces_keep_eight_digits_and_their_columns(tmp_path):
    writer = RecordingWriter(tmp_path / "rec", replace(INFO, force=ForceInfo("fx", 1, 0.2)), "A test.")
    writer.add("0000001.png", 0.5, FRAMES[0])
    log = ForceWriter(tmp_path / "rec", ("fx_n", "fy_n", "fz_n"))
    values = RNG.standard_normal((100, 3)) * [1e-6, 1e-2, 1e3]
    for time_s, row in zip(times([1] * 99), values, strict=True):
        log.add(time_s, row.tolist())
    forces = read_recording(tmp_path / "rec").forces
    assert forces.columns == ("fx_n", "fy_n", "fz_n")
    assert np.allclose(forces.wrench_sc, values, rtol=1e-7, atol=0)
    log.set_aside()
    assert read_recording(tmp_path / "rec").forces is None
    assert (tmp_path / "rec" / "robot_forces.csv").exists()


def test_opencv_and_pillow_read_back_every_pixel_of_frame_after_frame(tmp_path):
    for shape in [(2, 2), (2, 3), (512, 512), (3, 16384), (700, 2)]:
        buffer, rng = PngBuffer(*shape), np.random.default_rng(0)
        for _ in range(3):
            pixels = rng.integers(0, 2**16, shape).astype(np.uint16)
            data = bytes(buffer.encode(pixels))
            assert (cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) == pixels).all()
            (tmp_path / "frame.png").write_bytes(data)
            assert (read_frame(tmp_path / "frame.png") == pixels).all()  # walks the chunks and their checksums
            assert (np.rint(matplotlib.image.imread(tmp_path / "frame.png") * 65535) == pixels).all()


def test_the_stream_is_zlib_without_filters_and_a_frame_of_another_size_is_refused():
    pixels = np.arange(60, dtype=np.uint16).reshape(6, 10) * 999
    data = bytes(PngBuffer(6, 10).encode(pixels))
    begin = data.index(b"IDAT") + 4
    lines = zlib.decompress(data[begin : begin + int.from_bytes(data[begin - 8 : begin - 4], "big")])
    assert lines == b"".join(b"\0" + row.astype(">u2").tobytes() for row in pixels)
    for shape in ((1, 10), (10,), (6, 1), (6, 11)):
        with pytest.raises(ValueError, match="a frame of"):
            PngBuffer(6, 10).encode(np.zeros(shape, dtype=np.uint16))


def test_a_fault_leaves_nothing(tmp_path):
    def half():
        with folder_when_whole(tmp_path / "out") as part:
            (part / "half").mkdir(parents=True)
            raise RuntimeError

    with pytest.raises(RuntimeError):
        half()
    assert list(tmp_path.iterdir()) == []
