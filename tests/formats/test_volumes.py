"""NIfTI, MetaImage and NRRD, written by the libraries of each and by hand as their specifications say."""

import zlib
from pathlib import Path

import numpy as np
import pytest
from format_frames import COLUMNS, COUNT, FRAMES, ROWS, pictures_of
from peak_memory import less_than

from scleraforce.errors import FrameError, InputError
from scleraforce.formats.scan import UnansweredError
from scleraforce.formats.volumes import read_metaimage, read_nifti, read_nrrd

nibabel = pytest.importorskip("nibabel")
nrrd = pytest.importorskip("nrrd")
metaimageio = pytest.importorskip("metaimageio")

IJK = ("lateral", "depth", "frame")  # the fastest first
VOLUME = np.ascontiguousarray(FRAMES.T)  # by these indices


def nifti(
    path: Path, volume: np.ndarray = VOLUME, steps=(0.015, 0.004, 0.1), unit: str = "mm", time: str = "sec"
) -> Path:
    image = nibabel.Nifti1Image(volume, np.eye(4))
    image.header.set_xyzt_units(unit, time)
    image.header.set_zooms(steps)
    nibabel.save(image, path)
    return path


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz"])
def test_a_nifti_volume_comes_back_with_its_spacing(tmp_path: Path, name: str) -> None:
    scan = read_nifti(nifti(tmp_path / name), IJK)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert scan.lateral_pixel_m.value == pytest.approx(15e-6)
    assert scan.depth_pixel_m.value == pytest.approx(4e-6)
    assert scan.times is None


def test_a_nifti_in_micrometres_with_a_time_axis(tmp_path: Path) -> None:
    path = nifti(tmp_path / "a.nii", VOLUME[:, :, np.newaxis], (15.0, 4.0, 7.0, 250.0), "micron", "msec")
    scan = read_nifti(path, IJK)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))
    np.testing.assert_allclose(scan.times.time_s, 0.25 * np.arange(COUNT))


@pytest.mark.parametrize(("steps", "unit"), [((1.0, 1.0, 1.0), "mm"), ((0.015, 0.004, 0.1), "unknown")])
def test_a_spacing_that_nobody_stated_stays_open(tmp_path: Path, steps: tuple[float, ...], unit: str) -> None:
    scan = read_nifti(nifti(tmp_path / "a.nii", steps=steps, unit=unit), IJK)
    assert (scan.lateral_pixel_m, scan.depth_pixel_m) == (None, None)


def test_a_step_of_time_is_no_scale(tmp_path: Path) -> None:
    scan = read_nifti(nifti(tmp_path / "a.nii", VOLUME[:, :, np.newaxis], (1.0, 1.0, 1.0, 0.25)), IJK)
    assert (scan.lateral_pixel_m, scan.depth_pixel_m) == (None, None)
    np.testing.assert_allclose(scan.times.time_s, 0.25 * np.arange(COUNT))


def test_scaled_values_of_a_nifti_are_floats_with_their_slope(tmp_path: Path) -> None:
    image = nibabel.Nifti1Image(VOLUME * 0.5 - 3.0, np.eye(4))
    image.set_data_dtype(np.int16)  # the slope that is written makes the most of its range
    nibabel.save(image, tmp_path / "a.nii")
    np.testing.assert_allclose(pictures_of(read_nifti(tmp_path / "a.nii", IJK)), FRAMES * 0.5 - 3.0, atol=0.02)


@pytest.mark.parametrize("read", [read_nifti, read_metaimage, read_nrrd])
def test_axes_that_no_file_names_are_asked_for(tmp_path: Path, read) -> None:
    nifti(tmp_path / "a.nii")
    metaimageio.write(tmp_path / "a.mha", FRAMES)
    nrrd.write(str(tmp_path / "a.nrrd"), VOLUME)
    ending = {read_nifti: "nii", read_metaimage: "mha", read_nrrd: "nrrd"}[read]
    with pytest.raises(UnansweredError, match=r"an array of 40 x 24 x 5: which axis is .* in the order.*; give --axes"):
        read(tmp_path / f"a.{ending}", None)


@pytest.mark.parametrize("packed", [False, True])
def test_a_metaimage_comes_back_with_its_spacing(tmp_path: Path, packed: bool) -> None:
    metaimageio.write(tmp_path / "a.mha", FRAMES, ElementSpacing=[0.015, 0.004, 0.1], CompressedData=packed)
    scan = read_metaimage(tmp_path / "a.mha", IJK)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))


def test_a_metaimage_by_the_letter_of_its_specification(tmp_path: Path) -> None:
    header = (
        f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nDimSize = {COLUMNS} {ROWS} "
        f"{COUNT}\nElementSpacing = 0.015 0.004 1\nElementType = MET_USHORT\nElementDataFile = "
    )
    (tmp_path / "a.mha").write_bytes(f"{header}LOCAL\n".encode() + FRAMES.tobytes())
    (tmp_path / "b.mhd").write_text(f"{header}b.raw\n")
    (tmp_path / "b.raw").write_bytes(FRAMES.tobytes())
    packed = zlib.compress(FRAMES.tobytes())
    sizes = f"CompressedData = True\nCompressedDataSize = {len(packed)}\nElementDataFile"
    (tmp_path / "c.mhd").write_text(f"{header}c.zraw\n".replace("ElementDataFile", sizes))
    (tmp_path / "c.zraw").write_bytes(packed)
    for name in ("a.mha", "b.mhd", "c.mhd"):
        np.testing.assert_array_equal(pictures_of(read_metaimage(tmp_path / name, IJK)), FRAMES)


def test_an_nrrd_whose_pixels_lie_beside_it(tmp_path: Path) -> None:
    nrrd.write(str(tmp_path / "a.nhdr"), VOLUME)
    np.testing.assert_array_equal(pictures_of(read_nrrd(tmp_path / "a.nhdr", IJK)), FRAMES)


@pytest.mark.parametrize("place", ["/etc/passwd", "../b.raw"])
def test_pixels_elsewhere_are_not_looked_for(tmp_path: Path, place: str) -> None:
    mha = f"ObjectType = Image\nNDims = 3\nDimSize = 40 24 5\nElementType = MET_UCHAR\nElementDataFile = {place}\n"
    (tmp_path / "a.mhd").write_text(mha)
    (tmp_path / "a.nhdr").write_text(
        f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 40 24 5\nencoding: raw\ndata file: {place}\n"
    )
    for read, name in ((read_metaimage, "a.mhd"), (read_nrrd, "a.nhdr")):
        with pytest.raises(FrameError, match=f"{name}: its pixels are said to be in '{place}'"):
            read(tmp_path / name, IJK)


def test_an_nrrd_with_labels_needs_no_names(tmp_path: Path) -> None:
    header = {"labels": list(IJK), "spacings": [15.0, 4.0, np.nan], "units": ["um", "um", ""]}
    nrrd.write(str(tmp_path / "a.nrrd"), VOLUME, header)
    scan = read_nrrd(tmp_path / "a.nrrd", None)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES)
    assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))


def test_an_nrrd_in_space_is_in_mm(tmp_path: Path) -> None:
    header = {"space": "left-posterior-superior", "space directions": np.diag([0.015, 0.004, 0.1])}
    nrrd.write(str(tmp_path / "a.nrrd"), VOLUME, header)
    scan = read_nrrd(tmp_path / "a.nrrd", IJK)
    assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))


def test_a_spacing_without_a_unit_stays_open(tmp_path: Path) -> None:
    nrrd.write(str(tmp_path / "a.nrrd"), VOLUME, {"spacings": [15.0, 4.0, 7.0]})
    assert read_nrrd(tmp_path / "a.nrrd", IJK).depth_pixel_m is None


@pytest.mark.parametrize("kind", ["nrrd", "mha"])
def test_more_packed_in_a_file_than_its_header_says_is_not_unpacked(tmp_path: Path, kind: str) -> None:
    packed = zlib.compress(bytes(2**28), 9)
    headers = {
        "nrrd": b"NRRD0004\ntype: uint16\ndimension: 3\nsizes: 40 24 5\nendian: little\nencoding: gzip\n\n",
        "mha": b"ObjectType = Image\nNDims = 3\nDimSize = 40 24 5\nElementType = MET_USHORT\nCompressedData = True\n"
        b"CompressedDataSize = %d\nElementDataFile = LOCAL\n" % len(packed),
    }
    (tmp_path / f"a.{kind}").write_bytes(headers[kind] + packed)
    with less_than(2**27), pytest.raises(FrameError, match="more is packed in it"):
        (read_nrrd if kind == "nrrd" else read_metaimage)(tmp_path / f"a.{kind}", IJK)


@pytest.mark.parametrize(("read", "name"), [(read_nifti, "a.nii"), (read_metaimage, "a.mha"), (read_nrrd, "a.nrrd")])
def test_a_damaged_file_is_named(tmp_path: Path, read, name: str) -> None:
    nifti(tmp_path / "a.nii")
    metaimageio.write(tmp_path / "a.mha", FRAMES)
    nrrd.write(str(tmp_path / "a.nrrd"), VOLUME, {"encoding": "raw"})
    (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:-100])
    with pytest.raises(FrameError, match=f"{name}: damaged"):
        pictures_of(read(tmp_path / name, IJK))


def test_a_package_that_is_missing_is_named_with_the_way_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "nibabel", None)
    with pytest.raises(InputError, match=r"NIfTI takes the package nibabel.*pip install 'scleraforce\[formats\]'"):
        read_nifti(nifti(tmp_path / "a.nii"), IJK)
