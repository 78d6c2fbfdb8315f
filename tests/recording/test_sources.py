"""The kinds of sources, and sources together."""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import mkdtemp

import cv2
import numpy as np
import pytest
import tifffile
from foreign_files import COUNT, FRAMES, pictures_of, write_dicom, write_log

from scleraforce.errors import InputError
from scleraforce.recording.scan import Times
from scleraforce.recording.sources import ImportOptions, files_of, gather, on_one_clock, read_scan, source_kind
from scleraforce.recording.tables import ForceLog


def one_of_each(folder: Path) -> dict[str, str]:
    """Write a file of each kind, under a name without an ending where its content decides; return the kinds by path."""
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
    (folder / "log.lvm").write_text("LabVIEW Measurement\t\n")
    (folder / "bag").mkdir()
    (folder / "bag" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    (folder / "b1").write_bytes(b"#ROSBAG V2.0\n")
    (folder / "b2").write_bytes(b"SQLite format 3\0")
    (folder / "b3").write_bytes(b"\x89MCAP0\r\n")
    (folder / "film").write_bytes(b"\0\0\0\x18ftypmp42")
    (folder / "x.oct").write_bytes(b"PK\x03\x04")
    named = {
        "scan.png": "picture", "scan.jpg": "picture", "t": "tiff", "d": "dicom", "n.npy": "numpy", "n.npz": "numpy",
        "v.nii": "nifti", "v.nii.gz": "nifti", "v.nrrd": "nrrd", "m": "metaimage", "log.csv": "log", "log.lvm": "log",
        "bag": "bag",
        "b1": "bag", "b2": "bag", "b3": "bag", "film": "film", "x.oct": "thorlabs",
    }  # fmt: skip
    return {str(folder / name): kind for name, kind in named.items()}


def test_each_kind_is_recognised(tmp_path: Path) -> None:
    kinds = one_of_each(tmp_path)
    assert {path: source_kind(Path(path)) for path in kinds} == kinds


def test_a_file_of_no_kind_that_is_read_is_refused(tmp_path: Path) -> None:
    for name, content in [("a.bin", b"hello"), ("a.csv", b""), ("a.nii", b"")]:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=f"{name}: .*; give PNG, JPEG, TIFF, DICOM"):
            source_kind(tmp_path / name)
    os.mkfifo(tmp_path / "pipe")
    for name, message in [("pipe", "pipe: a named pipe"), ("gone", "gone: No such file")]:
        with pytest.raises(InputError, match=message):
            source_kind(tmp_path / name)


def test_a_file_that_is_known_and_not_read_is_named_with_a_remedy(tmp_path: Path) -> None:
    for name, content, what, way in [
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
    ]:
        place = Path(mkdtemp(dir=tmp_path))
        (place / name).write_bytes(content)
        with pytest.raises(InputError, match=f"{name}: .*{what}.*; .*{way}") as caught:
            source_kind(place / name)
        assert "\n" not in str(caught.value)


def test_pixels_beside_their_header_are_read_once(tmp_path: Path) -> None:
    for folder in [True, False]:
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


def log_at(first_s: float) -> ForceLog:
    return ForceLog(first_s + np.arange(1000) / 200.0, np.zeros((1000, 1)), ("fz_n",))


def test_a_stack_and_a_log_go_together_whatever_their_order(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", FRAMES)
    force_n = write_log(tmp_path / "log.csv")
    for sources in (["a.tif", "log.csv"], ["log.csv", "a.tif"]):
        seen: list[int] = []
        found = gather([tmp_path / name for name in sources], ImportOptions(), seen.append)
        np.testing.assert_array_equal(pictures_of(found.scan), FRAMES)
        np.testing.assert_allclose(found.log.force_n("fz"), force_n, atol=1e-7)
        assert seen == [1, 1]


def test_pictures_of_a_folder_are_one_scan_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for nth, frame in enumerate(FRAMES):
        cv2.imwrite(str(tmp_path / f"f{8 + nth}.png"), frame)
    found = gather([tmp_path], ImportOptions())
    np.testing.assert_array_equal(pictures_of(found.scan), FRAMES)
    assert found.notes == ()
    note = "frames are taken in the order given, f10.png to f9.png; their numbers have another"
    assert gather(sorted(tmp_path.iterdir()), ImportOptions()).notes == (note,)


def test_sources_without_frames_or_with_two_logs_are_refused(tmp_path: Path) -> None:
    write_log(tmp_path / "a.csv")
    write_log(tmp_path / "b.csv")
    tifffile.imwrite(tmp_path / "a.tif", FRAMES)
    with pytest.raises(InputError, match=r"a\.csv: no frames in the sources"):
        gather([tmp_path / "a.csv"], ImportOptions())
    with pytest.raises(InputError, match=r"b\.csv: a second force log beside .*a\.csv"):
        gather([tmp_path / name for name in ("a.tif", "a.csv", "b.csv")], ImportOptions())


def test_frames_and_forces_count_from_a_whole_second_of_the_clock_of_the_log() -> None:
    for first_s, log_s, offset_s, origin_s in [
        (1.7e9 + 3.5, 1.7e9 + 2.25, 0.0, 1.7e9 + 2.0),  # a clock that counts from 1970
        (1e9 + 0.5, 1e9 + 2.0, 0.0, 1e9),  # frames before the log
        (0.0, 40.0, 40.5, 0.0),
    ]:
        times, log = Times(first_s + np.arange(COUNT), "tag"), log_at(log_s)
        moved, moved_log, found_s = on_one_clock(times, log, offset_s)
        assert found_s == origin_s
        np.testing.assert_allclose(moved.time_s, times.time_s + offset_s - origin_s, atol=1e-6)
        np.testing.assert_allclose(moved_log.time_s, log.time_s - origin_s, atol=1e-6)


def test_times_that_do_not_rise_are_refused() -> None:
    with pytest.raises(InputError, match="do not rise"):
        on_one_clock(Times(np.array([0.0, 0.0]), "tag"), None, 0.0)


PACKAGES = {"pydicom", "tifffile", "nibabel", "nrrd", "metaimageio", "rosbags", "mcap", "gdcm", "matplotlib"}


def loaded_by(path: Path) -> set[str]:
    """Return those packages that an interpreter has imported to read a source."""
    program = (
        "import sys\nfrom pathlib import Path\n"
        "from scleraforce.recording.sources import ImportOptions, gather\n"
        f"scan = gather([Path({str(path)!r})], ImportOptions()).scan\n"
        "assert len(list(scan.pictures())) == len(scan.names)\n"
        f"print(*({PACKAGES!r} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_a_picture_needs_none_of_them_and_a_stack_its_own(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), FRAMES[0])
    tifffile.imwrite(tmp_path / "a.tif", FRAMES)
    assert loaded_by(tmp_path / "a.png") == set()
    assert loaded_by(tmp_path / "a.tif") == {"tifffile"}
