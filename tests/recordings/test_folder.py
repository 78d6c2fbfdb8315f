"""Recording folders, and their tables as editors, robots and spreadsheets write
them.
"""

import re
from math import pi

import cv2
import numpy as np
import pytest
import tifffile
from foreign_files import write_table

from scleraforce.base.errors import FrameError, RecordingError
from scleraforce.recordings.frame_and_force_tables import (
    FORCE_COLUMNS,
    FrameEntry,
)
from scleraforce.recordings.recording_folder import (
    open_frame,
    read_recording,
    recorded_file,
)
from scleraforce.records.decoder import format_record, parse_record
from scleraforce.records.recording_info import RecordingInfo
from scleraforce.records.scan import Plane, Scan

INFO = """[eye]
id = "eye"
thickness_m = 7e-4
[oct]
columns = 32
rows = 16
bits = 12
width_m = 15e-3
depth_m = 4e-3
[needle]
gauge = 22
slice_gap_m = 5e-4
[force]
axis = "fz"
contact_sign = -1
"""


@pytest.fixture
def folder(tmp_path):
    """A small recording: two frames, one second of log."""
    (tmp_path / "frames").mkdir()
    for name in ("a.png", "b.png"):
        cv2.imwrite(str(tmp_path / "frames" / name), np.full((16, 32), 7, np.uint16))

    (tmp_path / "recording.toml").write_text(INFO)
    (tmp_path / "frames.csv").write_text("file,time_s\na.png,0.2\nb.png,0.8\n")
    lines = [f"{k / 100:.2f},0,0.001,{-k / 1000},0,0,0.0001" for k in range(100)]
    (tmp_path / "forces.csv").write_text(
        "\n".join([",".join(FORCE_COLUMNS), *lines]) + "\n"
    )

    return tmp_path


def check_refused(folder, file, old, new, message):
    """Check that a changed file is refused."""
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))
    with pytest.raises(RecordingError, match=message):
        read_recording(folder)


def test_a_recording_with_and_without_a_log_is_read_as_written(folder):
    recording = read_recording(folder)
    eye = recording.info.eye
    force = recording.info.force
    assert (eye.thickness_m, eye.iop_pa, force.average_s) == (7e-4, None, 2.0)
    assert recording.forces.sample_rate_hz == pytest.approx(100.0)
    assert recording.forces.force_n("fz") == pytest.approx(-np.arange(100) / 1000)
    assert (recording.frame(recording.frames[0]) == 7).all()
    (folder / "forces.csv").unlink()
    (folder / "recording.toml").write_text(INFO[: INFO.index("[force]")])
    recording = read_recording(folder)
    assert (recording.forces, recording.info.force) == (None, None)


NEEDLE = "[needle]\ngauge = 22\nslice_gap_m = 5e-4\n"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("gauge", "gage", "11: needle.gage: unknown key; known here: gauge"),
        ("gauge = 22\n", "", "10: needle.gauge: missing"),
        (NEEDLE, "", " needle: missing"),
        ("7e-4", "650", "3: eye.thickness_m: 650 is above .*650 µm"),
        ("15e-3", "15", "8: oct.width_m: 15 is above .*15 mm"),
        ('"fz"', '"tz"', "14: force.axis: 'tz' is not one of fx, fy, fz"),
        ("-1", "0", "15: force.contact_sign: 0 is not a sign"),
        ('"eye"', '" "', "2: eye.id: empty"),
        ('"eye"', r'"eye\nE = 1"', r"2: eye.id: 'eye\\nE = 1' has a line break"),
        ('"eye"', r'"eye\u001b[2J"', "2: eye.id: .* unprintable character"),
        ("[oct]", "[oct", " not TOML"),
        (INFO[INFO.index("[force]") :], "", " force: missing; forces.csv needs"),
    ],
    ids=range(12),
)
def test_faults_of_recording_toml_are_named_with_line_and_field(
    folder, old, new, message
):
    check_refused(folder, "recording.toml", old, new, rf"recording\.toml:{message}")


ROWS = "a.png,0.2\nb.png,0.8\n"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("b.png", "b" * 300, " file: b{300}: File name too long"),
        ("b.png", "c.png", " file: .*c.png does not exist"),
        ("b.png", "a.png", "3: file: a.png is in line 2 already"),
        ("b.png", "../b.png", r"3: file: '\.\./b.png' is not a name below frames/"),
        ("b.png", "/etc/passwd", "3: file: '/etc/passwd' is not a name below"),
        ("a.png", "a\0.png", r"2: file: 'a\\x00.png' is not a name below"),
        ("a.png", "", "2: file: '' is not a name"),
        ("a.png", "a" * 200_000, "2: field larger than field limit"),
        ("b.png", '"b.png', "3: unexpected end of data"),
        ("0.8", "0.2", "3: time_s: 0.2 does not come after 0.2"),
        ("0.8", "nan", "3: time_s: expected a number, found 'nan'"),
        ("0.2", "1_0", "2: time_s: expected a number, found '1_0'"),
        ("0.2", "\u0661", "2: time_s: expected a number, found '\u0661'"),
        ("0.2", "1e308", r"2: time_s: 1e\+308 is above the largest .* 1e\+10"),
        ("time_s", "time", "1: unknown column 'time'; known: file, time_s, pierced"),
        (
            "time_s\na.png,0.2",
            "time_s,travel_m\na.png,0.2,5",
            "2: travel_m: 5 is above .* 1; did you mean 0.005 m",
        ),
        (
            "time_s\na.png,0.2",
            "time_s,iop_pa\na.png,0.2,0",
            "2: iop_pa: 0 is below the smallest allowed value 1",
        ),
        ("file,time_s", "file", "1: column time_s is missing; found: file"),
        (ROWS, "", " no frames"),
        (f"file,time_s\n{ROWS}", "", " empty; the first line names"),
        ("a.png,0.2", "a.png,0,25", "2: 3 fields; .* separated by semicolons"),
        (",0.8", ",", "3: 1 fields; the header has 2"),
    ],
    ids=range(22),
)
def test_faults_of_frames_csv_are_named_with_line_and_field(folder, old, new, message):
    check_refused(folder, "frames.csv", old, new, rf"frames\.csv:{message}")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fz_n", "fz", "1: unknown column 'fz'"),
        ("fy_n", "fz_n", "1: two columns are named fz_n"),
        ("0.02,", "0.01,", "4: time_s: 0.01 does not come after 0.01"),
    ],
)
def test_faults_of_forces_csv_are_named_with_line_and_field(folder, old, new, message):
    check_refused(folder, "forces.csv", old, new, rf"forces\.csv:{message}")


PLANES = """[[oct.plane]]
name = "a"
offset_m = 0.0
direction_rad = 0.0
[[oct.plane]]
name = "b"
offset_m = 0.0
direction_rad = 1.5708
"""
TOGETHER = "file,time_s,plane\na.png,0.2,a\nb.png,0.2,b\n"


@pytest.mark.parametrize(
    ("offset_m", "turn_rad", "same"),
    [
        (3e-4, 0.0, True),
        (-3e-4, pi, True),
        (3e-4, pi, False),
        (3e-4, 2.0 * pi, True),
        (3e-4, 0.5, False),
    ],
)
def test_a_plane_is_the_same_one_if_its_columns_run_the_other_way(
    offset_m, turn_rad, same
):
    assert Plane("a", 3e-4, -1.0).lies_at(Plane("b", offset_m, turn_rad - 1.0)) == same


INFO_OF_PLANES = INFO.replace("slice_gap_m = 5e-4\n", "").replace(
    "[needle]", f"{PLANES}[needle]"
)


@pytest.fixture
def crossed(folder):
    """A small recording of two planes."""
    (folder / "recording.toml").write_text(INFO_OF_PLANES)
    (folder / "frames.csv").write_text(TOGETHER)
    return folder


def test_frames_of_several_planes_are_one_moment(crossed):
    recording = read_recording(crossed)
    moments = [[entry.file for entry in moment] for moment in recording.moments]
    assert moments == [["a.png", "b.png"]]
    planes = [recording.info.scan.named(entry.plane) for entry in recording.frames]
    assert [plane.direction_rad for plane in planes] == [0.0, 1.5708]
    text = format_record(recording.info)
    assert parse_record(RecordingInfo, text, "again") == recording.info


def test_a_moment_is_pierced_in_all_planes(crossed):
    rows = [("a.png", 0.2, "a", 0), ("b.png", 0.2, "b", 1)]
    write_table(crossed / "frames.csv", "file,time_s,plane,pierced", *rows)
    assert [entry.pierced for entry in read_recording(crossed).frames] == [True, True]


SECOND = PLANES[PLANES.rindex("[[") :]
PRESSURES = "file,time_s,plane,iop_pa\na.png,0.2,a,266\nb.png,0.2,b,800\n"


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        (
            "recording.toml",
            "gauge = 22\n",
            "gauge = 22\nslice_gap_m = 5e-4\n",
            "needle.slice_gap_m: of a single",
        ),
        ("recording.toml", PLANES, "", ":.* needle.slice_gap_m: missing; give it, or"),
        ("recording.toml", SECOND, "", ":10: oct.plane: only one"),
        ("recording.toml", '"b"', '"a"', "oct.plane: name: 'a' is there twice"),
        ("recording.toml", "1.5708", "0.0", "oct.plane: 'a' and 'b' are at one place"),
        ("recording.toml", "1.5708", "3.14159265", "'a' and 'b' are at one place"),
        ("recording.toml", '"b"', '"b;c"', "oct.plane.* 'b;c'; a table cannot hold"),
        ("recording.toml", "offset_m = 0.0", "offset_m = 0.5", ":12: .*0.5 is above"),
        ("frames.csv", TOGETHER, PRESSURES, "iop_pa: 266 and 800"),
        ("frames.csv", "0.2,b", "0.2,c", ": plane: 'c' of b.png is unknown; .* a, b"),
        ("frames.csv", "0.2,b", "0.2,a", ":3: plane: 'a' has a frame at 0.2 s already"),
        ("frames.csv", "0.2,b", "0.2,", ":3: time_s: 0.2 does not come after 0.2"),
        ("frames.csv", "0.2,b", "0.8,", ": plane: missing for b.png; give one of a, b"),
        ("frames.csv", "0.2,b", "0.8,b", ": plane: no two frames have one time_s"),
        ("frames.csv", "0.2,b", "0.1,b", ":3: time_s: 0.1 does not come after 0.2"),
    ],
)
def test_faults_of_planes_are_named(crossed, file, old, new, message):
    check_refused(crossed, file, old, new, f"{file}.*{message}")


def test_planes_are_refused_without_their_declaration(crossed):
    (crossed / "recording.toml").write_text(INFO)
    undeclared = r"plane: 'a' of a.png is unknown; recording.toml has no"
    with pytest.raises(RecordingError, match=undeclared):
        read_recording(crossed)


def write_log(folder, *rows):
    write_table(folder / "forces.csv", "time_s,fx_n,fz_n", *rows)
    return read_recording(folder).forces


def test_gaps_of_a_log_are_noted(folder):
    rows = [(k / 100, 0, "nan" if k in (3, 4) else 0.001) for k in range(90)]
    forces = write_log(folder, *rows)
    assert np.flatnonzero(np.isnan(forces.force_n("fz"))).tolist() == [3, 4]
    assert forces.notes == ("forces.csv: 2 of 90 samples have no force (nan)",)


def test_a_low_rate_of_a_log_is_noted(folder):
    forces = write_log(folder, *((k / 30, 0, 0) for k in range(90)))
    (note,) = forces.notes
    assert re.search("30 samples a second, .* 1.8 times as large", note)


@pytest.mark.parametrize(
    ("pixels", "message"),
    [
        (
            np.full((16, 31), 7, np.uint16),
            r"16 x 31 pixels \(rows x columns\); recording.toml says 16 x 32",
        ),
        (np.full((16, 32), 7, np.uint8), "8 bits a pixel; recording.toml says 12"),
        (np.full((16, 32), 4096, np.uint16), "a pixel of 4096 is more than 12 bits"),
    ],
)
def test_frames_of_another_size_are_named(folder, pixels, message):
    recording = read_recording(folder)
    cv2.imwrite(str(folder / "frames" / "b.png"), pixels)
    with pytest.raises(FrameError, match=rf"b\.png: {message}"):
        recording.frame(recording.frames[1])


@pytest.mark.parametrize(
    ("name", "target", "message"),
    [
        ("frames/b.png", "../b.png", r"b\.png leads out of"),
        # not taken for a recording without a log
        ("forces.csv", "nowhere.csv", r"forces\.csv: No such file"),
        ("frames.csv", "nowhere.csv", r"frames\.csv: No such file"),
    ],
)
def test_files_that_are_missing_or_lead_out_are_named(folder, name, target, message):
    (folder / name).rename(folder / "b.png")
    (folder / name).symlink_to(target)
    with pytest.raises(RecordingError, match=message):
        read_recording(folder)


def test_a_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(RecordingError, match="nowhere: no such folder"):
        read_recording(tmp_path / "nowhere")


def test_options_take_precedence_over_recording_toml_and_that_over_the_file(folder):
    path = folder / "frames" / "c.tif"
    tags = {"resolution": (1000.0, 1000.0), "resolutionunit": "CENTIMETER"}
    tifffile.imwrite(path, np.full((16, 32), 7, np.uint16), metadata=None, **tags)
    frame = open_frame(
        recorded_file(path),
        Scan(depth_m=3e-3),
        Scan(refractive_index=1.3),
        "assumed",
    )
    assert (frame.scan.depth_m, frame.sources["depth_m"]) == (3e-3, "option")
    assert (frame.scan.width_m, frame.sources["width_m"]) == (15e-3, "recording.toml")
    (folder / "recording.toml").unlink()
    frame = open_frame(recorded_file(path), Scan(), Scan(width_m=1e-3), "assumed")
    assert (frame.scan.width_m, frame.sources["width_m"]) == (
        pytest.approx(32 * 1e-5),
        "file",
    )


FORCES = [
    ("time_s", "fz_n"),
    *((f"{k / 100:.2f}", f"{-k / 1000:.3f}") for k in range(60)),
]
FRAMES = [
    ("file", "time_s", "pierced"),
    ("a.png", "0.2", "0"),
    ("b, c.png", "0.5", "1"),
]


def joined(rows, separator, quote=False, end="\n"):
    mark = '"' if quote else ""
    return "".join(
        separator.join(f"{mark}{field}{mark}" for field in row) + end for row in rows
    )


COMMAS = str.maketrans(".", ",")
FORMS = [
    lambda rows: joined(rows, ",", quote=True).encode(),
    lambda rows: joined(rows, ";").encode(),
    lambda rows: joined(rows, ";").translate(COMMAS).replace(",png", ".png").encode(),
    lambda rows: (
        joined(rows, ";", quote=True).translate(COMMAS).replace(",png", ".png").encode()
    ),
    lambda rows: joined(rows, "\t").translate(COMMAS).replace(",png", ".png").encode(),
    lambda rows: joined(rows, "\t", end="\r\n").encode(),
    lambda rows: joined(rows, ";", end="\r").encode(),  # of old Macs
    lambda rows: joined(
        [*rows, ("",) * len(rows[0])], ";", end=";;\n"
    ).encode(),  # empty fields behind the last
    lambda rows: joined(
        [tuple(f"{field:>15}" for field in row) for row in rows], ";", end="  \n"
    ).encode(),
    lambda rows: joined(rows, "\t").encode("utf-16"),
    lambda rows: b"\xef\xbb\xbf" + joined(rows, ";").encode(),
]


@pytest.mark.parametrize("form", FORMS, ids=range(len(FORMS)))
def test_tables_are_read_however_they_are_written(folder, form):
    (folder / "frames" / "b.png").rename(folder / "frames" / "b, c.png")
    (folder / "forces.csv").write_bytes(form(FORCES))
    (folder / "frames.csv").write_bytes(form(FRAMES))
    recording = read_recording(folder)
    np.testing.assert_allclose(recording.forces.time_s, np.arange(60) / 100)
    force_n = recording.forces.force_n("fz")
    np.testing.assert_allclose(force_n, -np.arange(60) / 1000)
    assert recording.frames == (
        FrameEntry("a.png", 0.2, pierced=False),
        FrameEntry("b, c.png", 0.5, pierced=True),
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "time_s,fx_n\n0,1\n0.01,1\n",
            r"forces.csv:1: column fz_n is missing; found: time_s, fx_n",
        ),
        ("time_s,fz_n\n", "no samples below the header"),
        ("time_s,fz_n\n0,1\n", "fewer than two samples"),
        *(
            (
                f"time_s,fx_n,fz_n\n0.00,0,0\n0.01,{field},0\n0.02,0,0\n",
                r"forces\.csv:3: fx_n: ",
            )
            for field in ("", "NA", "--", "inf", "OVL")
        ),
        (
            "time_s,fz_n\n" + "".join(f"{k / 10},0\n" for k in range(9)),
            "10 samples a second; at least 20 are needed",
        ),
        ("time_s,fz_n\n0,nan\n0.01,nan\n", "fz_n: no sample has a force"),
        (
            "time_s,fz_n\n0,00;0,001\n",
            (
                "forces.csv:2: 3 fields; the header has 2; with decimal commas,"
                " columns are"
            ),
        ),
        (
            "time_s,fz_n\n0,00,0,001\n0,01,0,001\n",
            "forces.csv:2: 4 fields; .* with decimal commas, columns are separ",
        ),
        (
            "time_s;fz_n\n0,00;0.001\n0,01;0,001\n",
            (
                r"forces.csv:2: time_s: '0,00' is 0.00 with a decimal comma, or .*"
                r" decimal points"
            ),
        ),
        (
            "time_s;fz_n\n0,00;1.000,5\n",
            r"forces.csv:2: fz_n: '1.000,5' is not a number",
        ),
        (
            'time_s,fz_n\n0.00,1\n0.01,"1\n',
            "forces.csv:3: unexpected end of data; each line is a row of its own",
        ),
        (
            "time_s,fz_n\n0.00,1\n0.01,1_000\n",
            "forces.csv:3: fz_n: '1_000' is not a number",
        ),
        (
            "time_s,fz_n\n0.00,1\n0.01,\u0663\n",
            "forces.csv:3: fz_n: '\u0663' is not a number",
        ),
        (
            "time_s,fz_n\n0.00,1\n0.01,0x10\n",
            "forces.csv:3: fz_n: '0x10' is not a number",
        ),
        (
            "time_s,fz_n\n0.00,1\n0.01,1e308\n",
            r"forces.csv:3: fz_n: 1e\+308 is above the largest allowed value 1e\+06",
        ),
        (
            "time_s,fz_n\n0.00,1\n1e300,1\n",
            r"forces.csv:3: time_s: 1e\+300 is above the largest allowed value 1e\+10",
        ),
        ("time_s,fz_n\n0.00,1\n0.01\n", "forces.csv:3: 1 fields; the header has 2"),
        (
            "time_s,fz_n,\n0.00,1,\n0.01,1,7\n",
            "forces.csv:3: 3 fields; the header has 2",
        ),
        (
            "time_s,fz_n\n0,1\n5,1\n10,1\n",
            r"0.2 samples a second; .* \(times are in seconds\)",
        ),
    ],
)
def test_a_log_that_cannot_be_read_is_refused_with_its_line(folder, text, message):
    (folder / "forces.csv").write_text(text, encoding="utf-8")
    with pytest.raises(RecordingError, match=message) as caught:
        read_recording(folder)
    assert "\n" not in str(caught.value)
