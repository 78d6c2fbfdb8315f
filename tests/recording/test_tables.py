"""Tables as editors, robots and spreadsheets write them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from scleraforce.errors import RecordingError
from scleraforce.recording.tables import read_force_log, read_frame_list

FORCES = [("time_s", "fz_n"), *((f"{k / 100:.2f}", f"{-k / 1000:.3f}") for k in range(60))]
FRAMES = [("file", "time_s", "pierced"), ("a.png", "0.2", "0"), ("b, c.png", "0.5", "1")]


def joined(rows: list[tuple[str, ...]], separator: str, quote: bool = False, end: str = "\n") -> str:
    mark = '"' if quote else ""
    return "".join(separator.join(f"{mark}{field}{mark}" for field in row) + end for row in rows)


def with_commas(rows: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    return [tuple(field if field.endswith("png") else field.replace(".", ",") for field in row) for row in rows]


FORMS: dict[str, Callable[[list[tuple[str, ...]]], bytes]] = {
    "quoted": lambda rows: joined(rows, ",", quote=True).encode(),
    "semicolons": lambda rows: joined(rows, ";").encode(),
    "decimal commas": lambda rows: joined(with_commas(rows), ";").encode(),
    "quoted decimal commas": lambda rows: joined(with_commas(rows), ";", quote=True).encode(),
    "tabs": lambda rows: joined(rows, "\t", end="\r\n").encode(),
    "tabs and decimal commas": lambda rows: joined(with_commas(rows), "\t").encode(),
    "old Mac": lambda rows: joined(rows, ";", end="\r").encode(),
    "trailing separators": lambda rows: joined([*rows, ("",) * len(rows[0])], ";", end=";;\n").encode(),
    "padded": lambda rows: joined([tuple(f"{field:>15}" for field in row) for row in rows], ";", end="  \n").encode(),
    "UTF-16": lambda rows: joined(rows, "\t").encode("utf-16"),
    "byte order mark": lambda rows: b"\xef\xbb\xbf" + joined(rows, ";").encode(),
}


def test_tables_are_read_however_they_are_written(tmp_path: Path) -> None:
    for form in FORMS:
        (tmp_path / "forces.csv").write_bytes(FORMS[form](FORCES))
        log = read_force_log(tmp_path / "forces.csv", "fz")
        np.testing.assert_allclose(log.time_s, np.arange(60) / 100)
        np.testing.assert_allclose(log.force_n("fz"), -np.arange(60) / 1000)
        (tmp_path / "frames.csv").write_bytes(FORMS[form](FRAMES))
        frames = read_frame_list(tmp_path / "frames.csv")
        assert [(frame.file, frame.time_s, frame.pierced) for frame in frames] == [
            ("a.png", 0.2, False),
            ("b, c.png", 0.5, True),
        ]


def test_what_cannot_be_read_is_refused_with_its_line(tmp_path: Path) -> None:
    for text, message in [
        ("time_s,fz_n\n0,00;0,001\n", "forces.csv:2: 3 fields; the header has 2; with decimal commas, columns are"),
        ("time_s,fz_n\n0,00,0,001\n0,01,0,001\n", "forces.csv:2: 4 fields; .* with decimal commas, columns are separ"),
        (
            "time_s;fz_n\n0,00;0.001\n0,01;0,001\n",
            r"forces.csv:2: time_s: '0,00' is 0.00 with a decimal comma, or .* decimal points",
        ),
        ("time_s;fz_n\n0,00;1.000,5\n", r"forces.csv:2: fz_n: '1.000,5' is not a number"),
        ('time_s,fz_n\n0.00,1\n0.01,"1\n', "forces.csv:3: unexpected end of data; each line is a row of its own"),
        ("time_s,fz_n\n0.00,1\n0.01,1_000\n", "forces.csv:3: fz_n: '1_000' is not a number"),
        ("time_s,fz_n\n0.00,1\n0.01,\u0663\n", "forces.csv:3: fz_n: '\u0663' is not a number"),
        ("time_s,fz_n\n0.00,1\n0.01,0x10\n", "forces.csv:3: fz_n: '0x10' is not a number"),
        ("time_s,fz_n\n0.00,1\n0.01,1e308\n", r"forces.csv:3: fz_n: 1e\+308 is beyond 1e\+06"),
        ("time_s,fz_n\n0.00,1\n1e300,1\n", r"forces.csv:3: time_s: 1e\+300 is beyond 1e\+10"),
        ("time_s,fz_n\n0.00,1\n0.01\n", "forces.csv:3: 1 fields; the header has 2"),
        ("time_s,fz_n,\n0.00,1,\n0.01,1,7\n", "forces.csv:3: 3 fields; the header has 2"),
        ("time_s,fz_n\n0,1\n5,1\n10,1\n", r"0.2 samples a second; .* \(times are in seconds\)"),
    ]:
        (tmp_path / "forces.csv").write_text(text, encoding="utf-8")
        with pytest.raises(RecordingError, match=message) as caught:
            read_force_log(tmp_path / "forces.csv", "fz")
        assert "\n" not in str(caught.value)


def test_lists_of_frames_that_cannot_be_read_are_refused_with_their_line(tmp_path: Path) -> None:
    for text, message in [
        ("file,time_s\na.png,1_0\n", "frames.csv:2: time_s: '1_0' is not a finite number"),
        ("file,time_s\na.png,\u0661\n", "frames.csv:2: time_s: '\u0661' is not a finite number"),
        ("file,time_s\na.png,1e308\n", "frames.csv:2: time_s: '1e308' is not a finite number"),
        ("file,time_s\na.png,0,25\n", "frames.csv:2: 3 fields; .* separated by semicolons"),
        ("file,time_s\na\0.png,1\n", r"frames.csv:2: file: 'a\\x00.png' is not a name below"),
        ("file,time_s\n" + "a" * 200_000 + ",1\n", "frames.csv:2: field larger than field limit"),
        ('file,time_s\n"a.png,1\n', "frames.csv:2: unexpected end of data"),
        ("file,time_s\n,1\n", "frames.csv:2: file: '' is not a name"),
        ("file;time_s\na.png;\n", "frames.csv:2: 1 fields; the header has 2"),
    ]:
        (tmp_path / "frames.csv").write_text(text, encoding="utf-8")
        with pytest.raises(RecordingError, match=message):
            read_frame_list(tmp_path / "frames.csv")


def test_latin_1_is_refused_with_a_remedy(tmp_path: Path) -> None:
    (tmp_path / "frames.csv").write_bytes("file,time_s\nmüde.png,1\n".encode("latin-1"))
    with pytest.raises(RecordingError, match=r"frames.csv:2: not UTF-8 text .*; save the file as UTF-8"):
        read_frame_list(tmp_path / "frames.csv")
