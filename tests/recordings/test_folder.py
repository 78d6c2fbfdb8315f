"""Recording folders, and their tables as editors, robots and spreadsheets write
them.
"""

import re
import shutil
from math import pi

import cv2
import numpy as np
import pytest
import tifffile

from scleraforce.base.errors import FrameError, RecordingError
from scleraforce.recordings.frame_and_force_tables import (
    FORCE_COLUMNS,
    FrameEntry,
    read_force_log,
    read_frame_list,
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


def refuses(folder, file, old, new, message):
    """Check that a changed file is refused, and write it back."""
    text = (folder / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new, 1))
    with pytest.raises(RecordingError, match=message):
        read_recording(folder)
    (folder / file).write_text(text)


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


def test_faults_are_named_with_file_line_and_field(folder):
    for file, old, new, message in [
        (
            "recording.toml",
            "gauge",
            "gage",
            r"recording.toml:11: needle.gage: unknown key; known here: gauge",
        ),
        (
            "recording.toml",
            "gauge = 22\n",
            "",
            r"recording.toml:10: needle.gauge: missing",
        ),
        (
            "recording.toml",
            "[needle]\ngauge = 22\nslice_gap_m = 5e-4\n",
            "",
            r"recording.toml: needle: missing",
        ),
        *(
            (
                "recording.toml",
                old,
                new,
                rf"recording.toml:\d+: {key} is above the largest .*{hint}",
            )
            for old, new, key, hint in (
                ("7e-4", "650", "eye.thickness_m: 650", "650 µm"),
                ("15e-3", "15", "oct.width_m: 15", "15 mm"),
                ("4e-3", "4", "oct.depth_m: 4", "4 mm"),
                ("= 5e-4", "= 0.5", "needle.slice_gap_m: 0.5", "0.5 mm"),
                ("7e-4", "7e-4\niop_pa = 2e5", "eye.iop_pa: 200000", ""),
                (
                    "22",
                    "22\npolar_angle_rad = 35",
                    "needle.polar_angle_rad: 35",
                    "35 °",
                ),
            )
        ),
        (
            "recording.toml",
            '"fz"',
            '"tz"',
            r"recording.toml:14: force.axis: 'tz' is not one of fx, fy, fz",
        ),
        (
            "recording.toml",
            "-1",
            "0",
            r"recording.toml:15: force.contact_sign: 0 is not a sign",
        ),
        ("recording.toml", '"eye"', '" "', r"recording.toml:2: eye.id: empty"),
        (
            "recording.toml",
            '"eye"',
            r'"eye\nE = 1"',
            r"recording.toml:2: eye.id: 'eye\\nE = 1' has a line break",
        ),
        (
            "recording.toml",
            '"eye"',
            r'"eye\u001b[2J"',
            r"recording.toml:2: eye.id: .* unprintable character",
        ),
        (
            "recording.toml",
            '"eye"',
            f'"{"e" * 300}"',
            r"recording.toml:2: eye.id: 300 characters",
        ),
        (
            "frames.csv",
            "b.png",
            "b" * 300,
            r"frames.csv: file: b{300}: File name too long",
        ),
        ("recording.toml", "[oct]", "[oct", r"recording.toml: not TOML"),
        (
            "recording.toml",
            INFO[INFO.index("[force]") :],
            "",
            r"recording.toml: force: missing; forces.csv needs",
        ),
        *(
            (
                "recording.toml",
                "[oct]",
                f"{key}\n{globe}\n[oct]",
                rf"eye\.rigidity_\w+: of a sealed globe, .* {found}",
            )
            for key in ("rigidity_mmhg13_per_ul = 0.03", 'rigidity_law = "cube-root"')
            for globe, found in (('globe = "open"', '"open"'), ("", "missing"))
        ),
        (
            "recording.toml",
            "[oct]",
            'globe = "shut"\n[oct]',
            r"eye\.globe: 'shut' is not one of open, sealed",
        ),
        ("frames.csv", "b.png", "c.png", r"frames.csv: file: .*c.png does not exist"),
        (
            "frames.csv",
            "b.png",
            "a.png",
            r"frames.csv:3: file: a.png is in line 2 already",
        ),
        (
            "frames.csv",
            "b.png",
            "../b.png",
            r"frames.csv:3: file: '../b.png' is not a name below frames/",
        ),
        (
            "frames.csv",
            "b.png",
            "/etc/passwd",
            r"frames.csv:3: file: '/etc/passwd' is not a name below",
        ),
        (
            "frames.csv",
            "0.8",
            "0.2",
            r"frames.csv:3: time_s: 0.2 does not come after 0.2",
        ),
        (
            "frames.csv",
            "0.8",
            "nan",
            r"frames.csv:3: time_s: expected a number, found 'nan'",
        ),
        (
            "frames.csv",
            "time_s",
            "time",
            r"frames.csv:1: unknown column 'time'; known: file, time_s, pierced",
        ),
        (
            "frames.csv",
            "time_s\na.png,0.2",
            "time_s,travel_m\na.png,0.2,5",
            r"frames.csv:2: travel_m: 5 is above the largest allowed value 1; did you mean 0.005 m",
        ),
        (
            "frames.csv",
            "time_s\na.png,0.2",
            "time_s,iop_pa\na.png,0.2,0",
            r"frames.csv:2: iop_pa: 0 is below the smallest allowed value 1",
        ),
        (
            "frames.csv",
            "file,time_s",
            "file",
            r"frames.csv:1: column time_s is missing; found: file",
        ),
        ("frames.csv", "a.png,0.2\nb.png,0.8\n", "", r"frames.csv: no frames"),
        (
            "frames.csv",
            "file,time_s\na.png,0.2\nb.png,0.8\n",
            "",
            r"frames.csv: empty; the first line names",
        ),
        *(
            ("frames.csv", "0.2", time, f"frames.csv:2: time_s: {found}")
            for time, found in (
                ("1_0", "expected a number, found '1_0'"),
                ("\u0661", "expected a number, found '\u0661'"),
                ("1e308", r"1e\+308 is above the largest allowed value 1e\+10"),
            )
        ),
        (
            "frames.csv",
            "a.png,0.2",
            "a.png,0,25",
            "frames.csv:2: 3 fields; .* separated by semicolons",
        ),
        (
            "frames.csv",
            "a.png",
            "a\0.png",
            r"frames.csv:2: file: 'a\\x00.png' is not a name below",
        ),
        (
            "frames.csv",
            "a.png",
            "a" * 200_000,
            "frames.csv:2: field larger than field limit",
        ),
        ("frames.csv", "b.png", '"b.png', "frames.csv:3: unexpected end of data"),
        ("frames.csv", "a.png", "", "frames.csv:2: file: '' is not a name"),
        ("frames.csv", ",0.8", ",", "frames.csv:3: 1 fields; the header has 2"),
        ("forces.csv", "fz_n", "fz", r"forces.csv:1: unknown column 'fz'"),
        ("forces.csv", "fy_n", "fz_n", r"forces.csv:1: two columns are named fz_n"),
        (
            "forces.csv",
            "0.02,",
            "0.01,",
            r"forces.csv:4: time_s: 0.01 does not come after 0.01",
        ),
    ]:
        refuses(folder, file, old, new, message)


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


def test_frames_of_several_planes_are_one_moment(folder):
    text = INFO.replace("slice_gap_m = 5e-4\n", "").replace(
        "[needle]", f"{PLANES}[needle]"
    )
    (folder / "recording.toml").write_text(text)
    (folder / "frames.csv").write_text(TOGETHER)
    recording = read_recording(folder)
    assert [[entry.file for entry in moment] for moment in recording.moments] == [
        ["a.png", "b.png"]
    ]
    assert [
        recording.info.scan.named(entry.plane).direction_rad
        for entry in recording.frames
    ] == [0.0, 1.5708]
    assert (
        parse_record(RecordingInfo, format_record(recording.info), "again")
        == recording.info
    )
    (folder / "frames.csv").write_text(
        "file,time_s,plane,pierced\na.png,0.2,a,0\nb.png,0.2,b,1\n"
    )
    assert [entry.pierced for entry in read_recording(folder).frames] == [True, True]
    (folder / "frames.csv").write_text(TOGETHER)

    for file, old, new, message in [
        (
            "recording.toml",
            "gauge = 22\n",
            "gauge = 22\nslice_gap_m = 5e-4\n",
            "needle.slice_gap_m: of a single",
        ),
        (
            "recording.toml",
            PLANES,
            "",
            "recording.toml:.* needle.slice_gap_m: missing; give it, or",
        ),
        (
            "recording.toml",
            PLANES[PLANES.rindex("[[") :],
            "",
            r"recording.toml:10: oct.plane: only one",
        ),
        ("recording.toml", '"b"', '"a"', "oct.plane: name: 'a' is there twice"),
        ("recording.toml", "1.5708", "0.0", "oct.plane: 'a' and 'b' are at one place"),
        (
            "recording.toml",
            "1.5708",
            "3.14159265",
            "oct.plane: 'a' and 'b' are at one place",
        ),
        ("recording.toml", '"b"', '"b;c"', "oct.plane.* 'b;c'; a table cannot hold"),
        (
            "frames.csv",
            TOGETHER,
            "file,time_s,plane,iop_pa\na.png,0.2,a,266\nb.png,0.2,b,800\n",
            "iop_pa: 266 and 800",
        ),
        (
            "recording.toml",
            "offset_m = 0.0",
            "offset_m = 0.5",
            r"recording.toml:12: oct.plane.offset_m: 0.5 is above",
        ),
        (
            "frames.csv",
            "0.2,b",
            "0.2,c",
            "frames.csv: plane: 'c' of b.png is unknown; .* has a, b",
        ),
        (
            "frames.csv",
            "0.2,b",
            "0.2,a",
            r"frames.csv:3: plane: 'a' has a frame at 0.2 s already",
        ),
        (
            "frames.csv",
            "0.2,b",
            "0.2,",
            r"frames.csv:3: time_s: 0.2 does not come after 0.2",
        ),
        (
            "frames.csv",
            "0.2,b",
            "0.8,",
            "frames.csv: plane: missing for b.png; give one of a, b",
        ),
        (
            "frames.csv",
            "0.2,b",
            "0.8,b",
            "frames.csv: plane: no two frames have one time_s",
        ),
        (
            "frames.csv",
            "0.2,b",
            "0.1,b",
            r"frames.csv:3: time_s: 0.1 does not come after 0.2",
        ),
    ]:
        refuses(folder, file, old, new, message)

    (folder / "recording.toml").write_text(INFO)
    with pytest.raises(
        RecordingError, match=r"plane: 'a' of a.png is unknown; recording.toml has no"
    ):
        read_recording(folder)


def test_gaps_and_a_low_rate_of_a_log_are_noted(folder):
    for rows, gaps, notes in [
        (
            [f"{k / 30},0,0" for k in range(90)],
            [],
            ["30 samples a second, .* 1.8 times as large"],
        ),
        (
            [f"{k / 100},0,{'nan' if k in (3, 4) else 0.001}" for k in range(90)],
            [3, 4],
            [r"^forces.csv: 2 of 90 samples have no force \(nan\)$"],
        ),
    ]:
        (folder / "forces.csv").write_text("\n".join(["time_s,fx_n,fz_n", *rows, ""]))
        forces = read_recording(folder).forces
        assert np.flatnonzero(np.isnan(forces.force_n("fz"))).tolist() == gaps
        assert [
            bool(re.search(*pair)) for pair in zip(notes, forces.notes, strict=True)
        ] == [True]


def test_files_that_are_missing_lead_out_or_are_of_another_size_are_named(folder):
    with pytest.raises(RecordingError, match="nowhere: no such folder"):
        read_recording(folder / "nowhere")

    recording = read_recording(folder)
    for pixels, message in [
        (
            np.full((16, 31), 7, np.uint16),
            r"16 x 31 pixels \(rows x columns\); recording.toml says 16 x 32",
        ),
        (np.full((16, 32), 7, np.uint8), "8 bits a pixel; recording.toml says 12"),
        (np.full((16, 32), 4096, np.uint16), "a pixel of 4096 is more than 12 bits"),
    ]:
        cv2.imwrite(str(folder / "frames" / "b.png"), pixels)
        with pytest.raises(FrameError, match=rf"b\.png: {message}"):
            recording.frame(recording.frames[1])

    shutil.move(folder / "frames" / "b.png", folder / "b.png")
    (folder / "frames" / "b.png").symlink_to(folder / "b.png")
    with pytest.raises(RecordingError, match=r"b.png leads out of"):
        read_recording(folder)

    (folder / "frames" / "b.png").unlink()
    shutil.move(folder / "b.png", folder / "frames" / "b.png")
    (folder / "forces.csv").unlink()
    # not taken for a recording without a log
    (folder / "forces.csv").symlink_to(folder / "nowhere.csv")

    with pytest.raises(RecordingError, match=r"forces.csv: No such file"):
        read_recording(folder)

    (folder / "frames.csv").unlink()
    with pytest.raises(RecordingError, match=r"frames.csv: No such file"):
        read_recording(folder)


def test_a_sealed_globe_may_have_a_rigidity(folder):
    text = (folder / "recording.toml").read_text()
    sealed = (
        'globe = "sealed"\nrigidity_mmhg13_per_ul = 0.03\nrigidity_law ='
        ' "logarithmic"\n[oct]'
    )
    (folder / "recording.toml").write_text(text.replace("[oct]", sealed))
    globe = read_recording(folder).info.eye.globe
    assert (globe.kind, globe.law, globe.rigidity_told) == (
        "sealed",
        "logarithmic",
        True,
    )
    assert globe.mean == pytest.approx(0.03 * 133.322387415 ** (1 / 3) * 1e9)


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


def joined(
    rows: list[tuple[str, ...]], separator: str, quote: bool = False, end: str = "\n"
) -> str:
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


def test_tables_are_read_however_they_are_written(tmp_path):
    for form in FORMS:
        (tmp_path / "forces.csv").write_bytes(form(FORCES))
        log = read_force_log(tmp_path / "forces.csv", "fz")
        np.testing.assert_allclose(log.time_s, np.arange(60) / 100)
        np.testing.assert_allclose(log.force_n("fz"), -np.arange(60) / 1000)
        (tmp_path / "frames.csv").write_bytes(form(FRAMES))
        frames = read_frame_list(tmp_path / "frames.csv")
        assert frames == (
            FrameEntry("a.png", 0.2, pierced=False),
            FrameEntry("b, c.png", 0.5, pierced=True),
        )


def test_a_log_that_cannot_be_read_is_refused_with_its_line(tmp_path):
    for text, message in [
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
    ]:
        (tmp_path / "forces.csv").write_text(text, encoding="utf-8")
        with pytest.raises(RecordingError, match=message) as caught:
            read_force_log(tmp_path / "forces.csv", "fz")

        assert "\n" not in str(caught.value)
