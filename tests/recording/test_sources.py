"""What a source is, by its content."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from dicom_file import write_dicom
from format_frames import FRAMES, pictures_of, write_log

from scleraforce.errors import InputError
from scleraforce.recording.sources import files_of, read_scan, source_kind


def one_of_each(folder: Path) -> dict[str, str]:
    """A file of each kind: its kind by its path, under a name that tells nothing where the content does."""
    nibabel, nrrd = pytest.importorskip("nibabel"), pytest.importorskip("nrrd")
    pictures = folder / "scan"
    cv2.imwrite(f"{pictures}.png", FRAMES[0])
    cv2.imwrite(f"{pictures}.jpg", (FRAMES[0] % 256).astype(np.uint8))
    tifffile.imwrite(folder / "t", FRAMES)
    write_dicom(folder / "d", FRAMES)
    np.save(folder / "n.npy", FRAMES)
    np.savez(folder / "n.npz", FRAMES)
    nibabel.save(nibabel.Nifti1Image(FRAMES, np.eye(4)), folder / "v.nii")
    nibabel.save(nibabel.Nifti1Image(FRAMES, np.eye(4)), folder / "v.nii.gz")
    nrrd.write(str(folder / "v.nrrd"), FRAMES)
    (folder / "m").write_text("ObjectType = Image\nNDims = 3\n")
    write_log(folder / "log.csv")
    (folder / "bag").mkdir()
    (folder / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    (folder / "b1").write_bytes(b"#ROSBAG V2.0\n")
    (folder / "b2").write_bytes(b"SQLite format 3\0")
    (folder / "b3").write_bytes(b"\x89MCAP0\r\n")
    (folder / "film").write_bytes(b"\0\0\0\x18ftypmp42")
    (folder / "x.oct").write_bytes(b"PK\x03\x04")
    named = {
        "scan.png": "picture", "scan.jpg": "picture", "t": "tiff", "d": "dicom", "n.npy": "numpy", "n.npz": "numpy",
        "v.nii": "nifti", "v.nii.gz": "nifti", "v.nrrd": "nrrd", "m": "metaimage", "log.csv": "log", "bag": "bag",
        "b1": "bag", "b2": "bag", "b3": "bag", "film": "film", "x.oct": "thorlabs",
    }  # fmt: skip
    return {str(folder / name): kind for name, kind in named.items()}


def test_each_kind_is_told(tmp_path: Path) -> None:
    kinds = one_of_each(tmp_path)
    assert {path: source_kind(Path(path)) for path in kinds} == kinds


@pytest.mark.parametrize(("name", "content"), [("a.bin", b"hello"), ("a.csv", b""), ("a.nii", b"")])
def test_a_file_of_no_kind_that_is_read_is_refused(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: .*; give PNG, JPEG, TIFF, DICOM"):
        source_kind(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "content", "what", "way"),
    [
        ("a.hdr", (348).to_bytes(4, "little") + bytes(344), "Analyze 7.5", "NIfTI"),
        ("a.hdr", (348).to_bytes(4, "big") + bytes(344), "Analyze 7.5", "NIfTI"),
        ("a.img", bytes(1000), "Zeiss Cirrus", "vendor_frames"),
        ("a.oct", b"\x01\x02" * 100, "Bioptigen, Optopol", "vendor_frames"),
        ("a.E2E", b"CMDb" + bytes(100), "Heidelberg", "vendor_frames"),
        ("a.vol", b"HSF-OCT-103" + bytes(100), "Heidelberg raw export", "TIFF or DICOM"),
        ("a.fda", b"FOCT" + bytes(100), "Topcon", "vendor_frames"),
        ("a.fds", bytes(100), "Topcon", "vendor_frames"),
        ("a.czi", b"ZISRAWFILE" + bytes(100), "Zeiss ZEN", "OME-TIFF"),
        ("a.h5", b"\x89HDF\r\n\x1a\n" + bytes(100), "HDF5", "h5py"),
        ("a.mat", b"MATLAB 5.0 MAT-file" + bytes(200), "MATLAB", "loadmat"),
        ("a.tdms", b"TDSm" + bytes(100), "TDMS", ".lvm or .csv"),
        ("a.raw", bytes(100), "raw pixels", "fromfile"),
        ("a.zip", b"PK\x03\x04" + bytes(100), "zip archive", "unpack"),
        ("a.xlsx", b"PK\x03\x04" + bytes(100), "spreadsheet", ".csv"),
        ("a.csv", b"PK\x03\x04" + bytes(100), "zip archive", "unpack"),
        ("a.txt", b"\xd0\xcf\x11\xe0" + bytes(100), ".xls", ".csv"),
        ("a.gif", b"GIF89a" + bytes(100), "GIF", "PNG or TIFF"),
    ],
)
def test_a_file_that_is_known_and_not_read_is_named_with_what_to_do(
    tmp_path: Path, name: str, content: bytes, what: str, way: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: .*{what}.*; .*{way}") as caught:
        source_kind(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_labview_log_is_a_log(tmp_path: Path) -> None:
    (tmp_path / "a.lvm").write_text("LabVIEW Measurement\t\n")
    assert source_kind(tmp_path / "a.lvm") == "log"


@pytest.mark.parametrize("folder", [True, False])
def test_pixels_beside_their_header_are_read_once(tmp_path: Path, folder: bool) -> None:
    nibabel = pytest.importorskip("nibabel")
    nibabel.save(nibabel.Nifti1Pair(FRAMES.T, np.eye(4)), tmp_path / "a.hdr")
    for name in ("b.mhd", "b.raw", "c.nhdr", "c.raw.gz", "d.raw"):
        (tmp_path / name).touch()
    given = [tmp_path] if folder else sorted(tmp_path.iterdir())
    assert [path.name for path in files_of(given)] == ["a.hdr", "b.mhd", "c.nhdr", "d.raw"]
    assert source_kind(tmp_path / "a.img") == source_kind(tmp_path / "a.hdr") == "nifti"
    for name in ("a.hdr", "a.img"):
        scan = read_scan(tmp_path / name, "nifti", ("lateral", "depth", "frame"))
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)


def test_a_pipe_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe: a named pipe"):
        source_kind(tmp_path / "pipe")
    with pytest.raises(InputError, match="gone: No such file"):
        source_kind(tmp_path / "gone")


def test_a_folder_is_its_files_by_their_numbers(tmp_path: Path) -> None:
    for name in ("f10.png", "f9.png", ".hidden"):
        (tmp_path / name).touch()
    assert [path.name for path in files_of([tmp_path])] == ["f9.png", "f10.png"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="empty: no files"):
        files_of([tmp_path / "empty"])


def test_pictures_are_turned_where_their_columns_are_depth(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), FRAMES[0])
    scan = read_scan(tmp_path / "a.png", "picture", ("frame", "lateral", "depth"))
    np.testing.assert_array_equal(pictures_of(scan)[0], FRAMES[0].T)
    upright = read_scan(tmp_path / "a.png", "picture", ("depth", "lateral"))
    np.testing.assert_array_equal(pictures_of(upright)[0], FRAMES[0])
    with pytest.raises(InputError, match="begin with frame"):
        read_scan(tmp_path / "a.png", "picture", ("lateral", "frame", "depth"))
