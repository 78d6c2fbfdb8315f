"""Thorlabs' .oct, as Thorlabs' own MATLAB functions read it: no real file could be had."""

from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from foreign_files import COLUMNS, COUNT, FRAMES, ROWS, pictures_of, sizes_of

from scleraforce.errors import FrameError
from scleraforce.recording.sources import read_scan, source_kind
from scleraforce.recording.thorlabs import read_thorlabs

INTENSITY = FRAMES.astype(np.float32) / 100.0 - 20.0  # dB


def entry(name: str = "data\\Intensity.data", count: int = COUNT, rows: int = ROWS) -> str:
    return (
        f'<DataFile Type="Real" SizeZ="{rows}" SizeX="{COLUMNS}" SizeY="{count}" RangeZ="0.096" RangeX="0.6" '
        f'RangeY="1" BytesPerPixel="4">{name}</DataFile>'
    )


def write_oct(path: Path, header: str, data: bytes, name: str = "data\\Intensity.data") -> Path:
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        archive.writestr("Header.xml", f'<?xml version="1.0"?><Ocity><DataFiles>{header}</DataFiles></Ocity>')
        archive.writestr("data\\VideoImage.data", bytes(10))
        archive.writestr(name, data)
    return path


def column_major(frames: np.ndarray) -> bytes:
    """Depth fastest, then the A-scan, then the B-scan."""
    return b"".join(np.asarray(frame, dtype="<f4").tobytes(order="F") for frame in frames)


def test_the_intensity_comes_back_with_its_scale(tmp_path: Path) -> None:
    single = entry(count=1).replace(' SizeY="1"', "")  # one B-scan has no third size
    for name, header, frames in [
        ("data\\Intensity.data", '<DataFile Type="Raw">data\\Spectral0.data</DataFile>' + entry(), INTENSITY),
        ("data/Intensity.data", entry(), INTENSITY),
        ("data/Intensity.data", single, INTENSITY[:1]),
    ]:
        path = write_oct(tmp_path / "a.oct", header, column_major(frames), name)
        assert source_kind(path) == "thorlabs"
        scan = read_scan(path, "thorlabs")
        np.testing.assert_array_equal(pictures_of(scan), frames)
        assert sizes_of(scan) == pytest.approx((4e-6, 15e-6))


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    for header, message in [
        (entry(rows=ROWS + 1), "the header says 25 x 40 x 5 floats"),
        (entry(rows=10**7), "a frame may have"),
        (entry(count=0), "the header says 24 x 40 x 0 floats"),
        (entry("data\\Spectral0.data"), "no processed intensity"),
        (entry() + entry("data\\VideoImage.data").replace("VideoImage", "Intensity"), "2 files of intensity"),
        (entry().replace(f'SizeZ="{ROWS}"', ""), "has no SizeZ"),
        (entry().replace(f'SizeX="{COLUMNS}"', ""), "has no SizeX"),
        (entry().replace('BytesPerPixel="4"', 'BytesPerPixel="2"'), "BytesPerPixel = 2"),
        (
            entry() + "<Image><SizeReal><SizeZ>0.192</SizeZ></SizeReal></Image>",
            "SizeZ 0.192 mm, and RangeZ is 0.096 mm",
        ),
        ("<DataFile>", "damaged or an unknown kind of Thorlabs"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>' + entry(), "defines entities"),
    ]:
        with pytest.raises(FrameError, match=message):
            read_thorlabs(write_oct(tmp_path / "a.oct", header, column_major(INTENSITY)))


def test_the_refractive_index_of_a_header_is_noted(tmp_path: Path) -> None:
    header = entry() + "<Image><SizeReal><SizeZ>0.096</SizeZ><SizeX>0.6</SizeX></SizeReal></Image>"
    path = write_oct(tmp_path / "a.oct", f"{header}<RefractiveIndex>1.36</RefractiveIndex>", column_major(INTENSITY))
    assert read_thorlabs(path).notes == (f"{path}: Header.xml states RefractiveIndex = 1.36",)


def test_an_archive_without_a_header_or_that_is_broken_is_refused(tmp_path: Path) -> None:
    with ZipFile(tmp_path / "a.oct", "w") as archive:
        archive.writestr("a", b"")
    (tmp_path / "b.oct").write_bytes(b"PK\x03\x04" + bytes(100))
    for name in ("a.oct", "b.oct"):
        with pytest.raises(FrameError, match=f"{name}: damaged or an unknown kind of Thorlabs"):
            read_thorlabs(tmp_path / name)
