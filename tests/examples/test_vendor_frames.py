"""Files of four makers as volumes, with fakes of OCT-Converter's readers: it cannot be
installed beside scleraforce.
"""

import struct
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from sources import example_module

vendor_frames = example_module("vendor_frames")
FRAMES = 3
ROWS = 20
COLUMNS = 28
VOLUME = np.arange(FRAMES * ROWS * COLUMNS, dtype=np.uint16).reshape(
    FRAMES, ROWS, COLUMNS
)


def installed(
    monkeypatch: pytest.MonkeyPatch, name: str, read: Callable[..., object]
) -> None:
    """Have OCT-Converter with one reader."""
    readers = ModuleType("oct_converter.readers")
    setattr(readers, name, lambda _: SimpleNamespace(read_oct_volume=read))
    package = ModuleType("oct_converter")
    package.readers = readers
    monkeypatch.setitem(sys.modules, "oct_converter", package)
    monkeypatch.setitem(sys.modules, "oct_converter.readers", readers)


def volume(frames: object = VOLUME, spacing: object = None) -> SimpleNamespace:
    return SimpleNamespace(volume=frames, pixel_spacing=spacing)


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert vendor_frames.main(list(arguments)) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"error: {arguments[0]}: ")
    assert error.count("\n") == 1
    assert not Path("out").exists()
    return error


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("reader", "spacing", "depth"),
    [
        ("E2E", [0.01, 0.0039, 0.05], "0.0039 mm a row, 0.078 mm"),
        ("FDA", [0.1, 0.2, 0.0026], "0.0026 mm a row"),
        ("FDS", None, ""),
    ],
)
def test_volumes_are_written_upright_and_a_stated_depth_is_printed(
    monkeypatch, capsys, reader: str, spacing: object, depth: str
) -> None:
    volumes = [volume(list(VOLUME), spacing), volume(VOLUME[:1], spacing)]
    installed(monkeypatch, reader, lambda: volumes)
    assert vendor_frames.main([f"a.{reader}", "--out", "out"]) == 0
    np.testing.assert_array_equal(np.load("out/a-1.npy"), VOLUME)
    np.testing.assert_array_equal(np.load("out/a-2.npy"), VOLUME[:1])
    told = capsys.readouterr().out
    assert "wrote out/a-1.npy: 3 frames of 20 x 28 (depth x lateral), uint16" in told
    assert ("said of the depth" in told) == bool(depth)
    assert depth in told


def test_frames_of_bioptigen_are_one_volume_turned_so_that_rows_are_depth(
    monkeypatch, capsys
) -> None:
    installed(
        monkeypatch, "BOCT", lambda: [volume(frame.T[np.newaxis]) for frame in VOLUME]
    )
    assert vendor_frames.main(["a.OCT", "--out", "out"]) == 0
    np.testing.assert_array_equal(np.load("out/a-1.npy"), VOLUME)
    assert "3 frames of 20 x 28" in capsys.readouterr().out
    assert vendor_frames.main(["a.OCT", "--out", "out"]) == 2  # the folder is there


def test_the_size_of_raw_bytes_is_asked_for_and_that_of_others_is_not_taken(
    monkeypatch, capsys
) -> None:
    asked = []

    def read(rows: int, cols: int) -> SimpleNamespace:
        asked.append((rows, cols))
        return volume()

    installed(monkeypatch, "IMG", read)
    assert "has no header; give --rows and --columns" in refused(
        capsys, "a.img", "--out", "out"
    )
    assert (
        vendor_frames.main(["a.img", "--out", "out", "--rows", "20", "--columns", "28"])
        == 0
    )
    assert asked == [(ROWS, COLUMNS)]

    with pytest.raises(SystemExit):
        vendor_frames.main(["a.img", "--out", "other", "--rows", "20"])

    assert "--rows and --columns belong together" in capsys.readouterr().err
    Path("out").rename("first")
    assert "leave --rows out" in refused(
        capsys, "a.e2e", "--out", "out", "--rows", "20", "--columns", "28"
    )


def stopped() -> list[SimpleNamespace]:
    print("cannot read\nStopping load")  # noqa: T201 - as OCT-Converter does
    return [volume()]


def in_two_lines() -> None:
    raise type("StreamError", (Exception,), {})("in data\ntoo short")


def warned() -> list[SimpleNamespace]:
    import warnings

    warnings.warn("Could not reshape image", UserWarning, stacklevel=1)
    return [volume()]


@pytest.mark.parametrize(
    ("file", "reader", "read", "words"),
    [
        ("a.OCT", "BOCT", stopped, "damaged: cannot read Stopping load"),
        ("a.e2e", "E2E", warned, "UserWarning: Could not reshape image"),
        ("a.e2e", "E2E", list, "no B-scans"),
        (
            "a.fda",
            "FDA",
            lambda: volume([VOLUME[0], VOLUME[0, 1:]]),
            "one size is needed",
        ),
        ("a.fda", "FDA", lambda: struct.unpack("<I", b""), "unpack requires a buffer"),
        ("a.OCT", "BOCT", in_two_lines, "StreamError: in data too short"),
        ("a.vol", "VOL", list, "of no kind that is read"),
    ],
)
def test_what_cannot_be_taken_over_whole_is_refused_in_one_line(
    monkeypatch, capsys, file: str, reader: str, read, words: str
) -> None:
    installed(monkeypatch, reader, read)
    assert words in refused(capsys, file, "--out", "out")
