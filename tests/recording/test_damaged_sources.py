"""Truncated and altered sources of every format: frames, or one error line that names the file; nothing else."""

from pathlib import Path
from tempfile import mkdtemp
from zipfile import ZipFile

import cv2
import numpy as np
import pytest
import tifffile
from foreign_files import FRAMES, write_dicom, write_log
from pydicom.uid import RLELossless
from ros_bag import write_bag

from scleraforce.errors import InputError
from scleraforce.recording.sources import ImportOptions, gather

nibabel, nrrd = pytest.importorskip("nibabel"), pytest.importorskip("nrrd")
metaimageio = pytest.importorskip("metaimageio")

VOLUMES = ImportOptions(axes="lateral,depth,frame")
HEAD_BYTES = 600  # most faults are there


def write_rle(path: Path) -> None:
    dataset = write_dicom(path, FRAMES)
    dataset.compress(RLELossless)
    dataset.save_as(path)


def write_thorlabs(path: Path) -> None:
    with ZipFile(path, "w") as archive:
        sizes = 'SizeZ="24" SizeX="40" SizeY="5" RangeZ="1" RangeX="2"'
        archive.writestr("Header.xml", f"<O><DataFile {sizes}>data\\Intensity.data</DataFile></O>")
        archive.writestr("data\\Intensity.data", FRAMES.astype("<f4").tobytes())


def write_lone_bag(path: Path) -> None:
    kind = {".db3": "sqlite", ".mcap": "mcap"}[path.suffix]
    next(write_bag(path.parent / "bag", kind).glob(f"*{path.suffix}")).rename(path)


WRITERS = {
    "a.png": lambda path: cv2.imwrite(str(path), FRAMES[0]),
    "a.tif": lambda path: tifffile.imwrite(path, FRAMES, photometric="minisblack", compression="zlib"),
    "i.tif": lambda path: tifffile.imwrite(path, FRAMES, imagej=True, metadata={"axes": "TYX", "finterval": 1}),
    "o.ome.tif": lambda path: tifffile.imwrite(path, FRAMES, metadata={"axes": "TYX", "PhysicalSizeX": 1.0}),
    "a.dcm": lambda path: write_dicom(path, FRAMES, FrameTime=4.0, PixelSpacing=[1, 1]),
    "r.dcm": write_rle,
    "a.npy": lambda path: np.save(path, FRAMES),
    "a.npz": lambda path: np.savez_compressed(path, FRAMES),
    "a.nii": lambda path: nibabel.save(nibabel.Nifti1Image(FRAMES, np.eye(4)), path),
    "a.nii.gz": lambda path: nibabel.save(nibabel.Nifti1Image(FRAMES, np.eye(4)), path),
    "a.nrrd": lambda path: nrrd.write(str(path), FRAMES),
    "a.mha": lambda path: metaimageio.write(path, FRAMES, CompressedData=True),
    "a.bag": lambda path: write_bag(path, "ros1"),
    "a.db3": write_lone_bag,
    "a.mcap": write_lone_bag,
    "a.oct": write_thorlabs,
    "log.csv": write_log,
}


def damaged(data: bytes, rng: np.random.Generator, nth: int) -> bytes:
    """Cut it off, or change up to seven bytes anywhere, or in its head."""
    if nth % 3 == 0:
        return data[: rng.integers(len(data))]
    changed = bytearray(data)
    for at in rng.integers(0, len(data) if nth % 3 == 1 else min(len(data), HEAD_BYTES), rng.integers(1, 8)):
        changed[at] = rng.integers(256)
    return bytes(changed)


@pytest.mark.filterwarnings("ignore")
def test_damage_is_an_error_that_names_the_file(tmp_path: Path, capfd) -> None:
    for name in WRITERS:
        place = Path(mkdtemp(dir=tmp_path))
        WRITERS[name](place / name)
        data = (place / name).read_bytes()
        np.save(place / "frames.npy", FRAMES)
        sources = [place / name, *([place / "frames.npy"] if name == "log.csv" else [])]
        named = name.endswith((".npy", ".npz", ".nii", ".gz", ".nrrd", ".mha", ".csv"))
        rng, said = np.random.default_rng(len(name)), []
        for nth in range(15):
            (place / name).write_bytes(damaged(data, rng, nth))
            try:
                for picture in gather(sources, VOLUMES if named else ImportOptions()).scan.pictures():
                    assert picture.size
            except InputError as fault:
                said.append(str(fault))
        assert said
        assert all(name in line and "\n" not in line for line in said)
        capfd.readouterr()  # codecs print what they think of it
