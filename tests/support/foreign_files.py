"""Files of other programs: DICOM images, and frames whose pixels cannot be mistaken for
each other.
"""

from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import cv2
import numpy as np
import pytest
import tifffile
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian, SecondaryCaptureImageStorage

from scleraforce.recordings.formats.foreign_force_logs import (
    parse_column,
    read_force_text,
)
from scleraforce.recordings.formats.log_text import read_log_text

ROWS = 24
COLUMNS = 40
COUNT = 5
# below 2**13
FRAMES = np.arange(COUNT * ROWS * COLUMNS, dtype=np.uint16).reshape(
    COUNT, ROWS, COLUMNS
)
# of a pixel
DEPTH_M = 4e-6
LATERAL_M = 15e-6
SIZES_M = (DEPTH_M, LATERAL_M)
NO_SIZES = (None, None)


def pictures_of(scan) -> np.ndarray:
    """All frames of a scan; names and size follow its pixels."""
    found = np.stack([np.asarray(picture) for picture in scan.pictures()])
    assert found.shape == (len(scan.names), scan.rows, scan.columns)
    return found


def sizes_of(scan) -> tuple[float | None, float | None]:
    """Return the depth and the width of a pixel, m."""
    return scan.size.depth_m, scan.size.lateral_m


def check_scan(scan, frames=FRAMES, sizes_m=None, time_s=None) -> None:
    """Check the frames of a scan and, where they are given, the depth and the width of
    a pixel and the times.
    """
    np.testing.assert_array_equal(pictures_of(scan), frames)
    if sizes_m is not None:
        sizes = [size and pytest.approx(size, rel=1e-4) for size in sizes_m]
        assert list(sizes_of(scan)) == sizes
    if time_s is not None:
        np.testing.assert_allclose(scan.times.time_s, time_s, atol=1e-6)


def stack(path: Path, **stated: object) -> Path:
    """A TIFF that states its scale and when its frames were taken."""
    resolution = (1e-6 / LATERAL_M, 1e-6 / DEPTH_M)
    metadata = {"axes": "TYX", "unit": "um", "finterval": 1.0, **stated}
    tifffile.imwrite(
        path, FRAMES, imagej=True, resolution=resolution, metadata=metadata
    )
    return path


def options_of(*options: object) -> list[str]:
    """Options that answer what no file states, and `options`."""
    needle = ["--eye", "eye-1", "--gauge", "22", "--gap-mm", "0.6"]
    return [*needle, "--refractive-index", "1.38", *map(str, options)]


def with_log(recording: Path) -> Path:
    """Give a small recording a log that begins before its frames and ends after
    them.
    """
    time_s = np.arange(0.0, 3.0, 0.005)
    lines = [f"{t:.3f},{-0.02 * np.clip(t - 0.5, 0.0, 0.5):.6f}" for t in time_s]
    (recording / "forces.csv").write_text("\n".join(["time_s,fz_n", *lines]) + "\n")
    return recording


def write_frames(folder: Path, *names: str) -> Path:
    """Write `FRAMES` as PNG with these names, from the first one on; return the
    folder.
    """
    for name, frame in zip(names, FRAMES, strict=False):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name), frame)
    return folder


def numbers_of(scan) -> list[int]:
    """Return the places of a scan's frames in `FRAMES`."""
    return [int(picture[0, 0]) // (ROWS * COLUMNS) for picture in pictures_of(scan)]


def write_table(path: Path, header: str, *rows: object) -> Path:
    """Write a table, a row for each tuple or text."""
    lines = [row if isinstance(row, str) else ",".join(map(str, row)) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def read_log(folder: Path, text: str | bytes, *columns: str):
    """Write a force log of another program; return it as it is read, and its
    columns.
    """
    path = folder / "log.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    given = [parse_column(column) for column in columns]
    return read_force_text(read_log_text(path), given)


def write_log(path: Path, seconds: float = 6.0, rate_hz: float = 200.0) -> np.ndarray:
    """Write a log of a push after two seconds in columns of its own, mN against ms;
    return the force in N.
    """
    time_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    force_n = -0.02 * np.clip(time_s - 2.0, 0.0, 1.0)
    lines = [
        f"{t * 1e3:.3f},{n * 1e3:.4f}" for t, n in zip(time_s, force_n, strict=True)
    ]
    path.write_text("\n".join(["Time (ms),Force_Z [mN]", *lines]) + "\n")

    return force_n


def write_dicom(path: Path, pixels: np.ndarray, **tags: Any) -> FileDataset:
    """Write pixels (rows, columns) or (frames, rows, columns), 8 or 16 bits; `tags`
    replace or add.
    """
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = SecondaryCaptureImageStorage
    meta.MediaStorageSOPInstanceUID = "1.2.3"
    meta.TransferSyntaxUID = tags.pop("TransferSyntaxUID", ExplicitVRLittleEndian)
    dataset = FileDataset(path, {}, file_meta=meta, preamble=b"\0" * 128)
    bits = 8 * pixels.dtype.itemsize
    dataset.Rows, dataset.Columns = pixels.shape[-2:]
    dataset.SamplesPerPixel = 1
    dataset.PhotometricInterpretation = "MONOCHROME2"
    dataset.BitsAllocated = dataset.BitsStored = bits
    dataset.HighBit = bits - 1
    dataset.PixelRepresentation = int(pixels.dtype == np.int16)

    if pixels.ndim == 3:
        dataset.NumberOfFrames = len(pixels)

    dataset.PixelData = pixels.tobytes()
    for name, value in tags.items():
        setattr(dataset, name, value)

    dataset.save_as(path)
    return dataset


def item(**tags: Any) -> Dataset:
    """Return an item of a sequence of DICOM."""
    dataset = Dataset()
    for name, value in tags.items():
        setattr(dataset, name, value)
    return dataset


INTENSITY_FILE = "data\\Intensity.data"


def oct_entry(name: str = INTENSITY_FILE, count: int = COUNT, rows: int = ROWS) -> str:
    """Return an entry of the header of Thorlabs' .oct."""
    sizes = (
        f'SizeZ="{rows}" SizeX="{COLUMNS}" SizeY="{count}" RangeZ="0.096" RangeX="0.6"'
        ' RangeY="1"'
    )
    return f'<DataFile Type="Real" {sizes} BytesPerPixel="4">{name}</DataFile>'


def write_oct(
    path: Path,
    header: str | None = None,
    frames: np.ndarray = FRAMES,
    name: str = INTENSITY_FILE,
) -> Path:
    """Write Thorlabs' .oct: depth fastest, then the A-scan, then the B-scan."""
    with ZipFile(path, "w", ZIP_DEFLATED) as archive:
        entries = header or oct_entry()
        archive.writestr(
            "Header.xml",
            f'<?xml version="1.0"?><Ocity><DataFiles>{entries}</DataFiles></Ocity>',
        )
        archive.writestr("data\\VideoImage.data", bytes(10))
        archive.writestr(name, np.asarray(frames, dtype="<f4").swapaxes(1, 2).tobytes())

    return path


def plus_fields(stamps, states=("OK",) * COUNT) -> dict[str, object]:
    """Return the header fields that PLUS writes for each frame."""
    fields: dict[str, object] = {"UltrasoundImageOrientation": "MF"}
    for nth, (stamp, state) in enumerate(zip(stamps, states, strict=True)):
        fields |= {
            f"Seq_Frame{nth:04d}_Timestamp": stamp,
            f"Seq_Frame{nth:04d}_ImageStatus": state,
        }

    return fields


# The stored form of a picture by its Orientation: the place of row 0 and column 0 in it
# (TIFF 6.0, EXIF).
STORED = {
    1: lambda shown: shown,
    2: lambda shown: shown[:, ::-1],
    3: lambda shown: shown[::-1, ::-1],
    4: lambda shown: shown[::-1],
    5: lambda shown: shown.T,
    6: lambda shown: np.rot90(shown),
    7: lambda shown: shown[::-1, ::-1].T,
    8: lambda shown: np.rot90(shown, -1),
}
