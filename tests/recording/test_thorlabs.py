"""Thorlabs' .oct, as Thorlabs' own MATLAB functions read it: no real file could be had."""

from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from foreign_files import COLUMNS, COUNT, FRAMES, ROWS, pictures_of

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
    for name in ["data\\Intensity.data", "data/Intensity.data"]:
        path = write_oct(
            tmp_path / "a.oct",
            '<DataFile Type="Raw">data\\Spectral0.data</DataFile>' + entry(),
            column_major(INTENSITY),
            name,
        )
        assert source_kind(path) == "thorlabs"
        scan = read_scan(path, "thorlabs")
        np.testing.assert_array_equal(pictures_of(scan), INTENSITY)
        assert scan.depth_pixel_m.value == pytest.approx(4e-6)
        assert scan.lateral_pixel_m.value == pytest.approx(15e-6)


def test_a_single_b_scan_has_no_third_size(tmp_path: Path) -> None:
    header = entry(count=1).replace(' SizeY="1"', "")
    scan = read_thorlabs(write_oct(tmp_path / "a.oct", header, column_major(INTENSITY[:1])))
    np.testing.assert_array_equal(pictures_of(scan), INTENSITY[:1])


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    for header, message in [
        (entry(rows=ROWS + 1), "the header says 25 x 40 x 5 floats"),
        (entry(rows=10**7), "a frame may have"),
        (entry("data\\Spectral0.data"), "no processed intensity"),
        (entry() + entry("data\\VideoImage.data").replace("VideoImage", "Intensity"), "2 files of intensity"),
        (entry().replace(f'SizeZ="{ROWS}"', ""), "has no SizeZ"),
        (entry().replace(f'SizeX="{COLUMNS}"', ""), "has no SizeX"),
        (entry().replace('BytesPerPixel="4"', 'BytesPerPixel="2"'), "BytesPerPixel = 2"),
        (
            entry() + "<Image><SizeReal><SizeZ>0.192</SizeZ></SizeReal></Image>",
            "SizeReal states SizeZ 0.192 mm, and RangeZ is 0.096 mm",
        ),
        ("<DataFile>", "damaged or an unknown kind of Thorlabs"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>' + entry(), "defines entities"),
    ]:
        with pytest.raises(FrameError, match=message):
            read_thorlabs(write_oct(tmp_path / "a.oct", header, column_major(INTENSITY)))


def test_what_a_header_says_of_the_refractive_index_is_noted(tmp_path: Path) -> None:
    header = entry() + "<Image><SizeReal><SizeZ>0.096</SizeZ><SizeX>0.6</SizeX></SizeReal></Image>"
    path = write_oct(tmp_path / "a.oct", f"{header}<RefractiveIndex>1.36</RefractiveIndex>", column_major(INTENSITY))
    assert read_thorlabs(path).notes == (f"{path}: Header.xml states RefractiveIndex = 1.36",)


def test_a_file_of_no_b_scans_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FrameError, match="the header says 24 x 40 x 0 floats"):
        read_thorlabs(write_oct(tmp_path / "a.oct", entry(count=0), b""))


def test_an_archive_without_a_header_or_that_is_none_is_refused(tmp_path: Path) -> None:
    with ZipFile(tmp_path / "a.oct", "w") as archive:
        archive.writestr("a", b"")
    (tmp_path / "b.oct").write_bytes(b"PK\x03\x04" + bytes(100))
    for name in ("a.oct", "b.oct"):
        with pytest.raises(FrameError, match=f"{name}: damaged or an unknown kind of Thorlabs"):
            read_thorlabs(tmp_path / name)
