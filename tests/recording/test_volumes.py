"""NIfTI, NRRD and MetaImage."""

import gzip
import zlib
from pathlib import Path

import numpy as np
import pytest
from effects import less_than
from foreign_files import COLUMNS, COUNT, FRAMES, ROWS, pictures_of, plus_fields

from scleraforce.errors import FrameError, InputError
from scleraforce.recording.scan import UnansweredError
from scleraforce.recording.volumes import read_metaimage, read_nifti, read_nrrd

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


def test_a_nifti_volume_comes_back_with_its_spacing(tmp_path: Path) -> None:
    for name in ["a.nii", "a.nii.gz"]:
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


def test_a_spacing_that_nobody_stated_stays_open(tmp_path: Path) -> None:
    for steps, unit in [((1.0, 1.0, 1.0), "mm"), ((0.015, 0.004, 0.1), "unknown")]:
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


def test_axes_that_no_file_names_are_asked_for(tmp_path: Path) -> None:
    for read in [read_nifti, read_metaimage, read_nrrd]:
        nifti(tmp_path / "a.nii")
        metaimageio.write(tmp_path / "a.mha", FRAMES)
        nrrd.write(str(tmp_path / "a.nrrd"), VOLUME)
        ending = {read_nifti: "nii", read_metaimage: "mha", read_nrrd: "nrrd"}[read]
        with pytest.raises(
            UnansweredError, match=r"an array of 40 x 24 x 5: which axis is .* in the order.*; give --axes"
        ):
            read(tmp_path / f"a.{ending}", None)


def test_an_nrrd_whose_pixels_lie_beside_it(tmp_path: Path) -> None:
    nrrd.write(str(tmp_path / "a.nhdr"), VOLUME)
    np.testing.assert_array_equal(pictures_of(read_nrrd(tmp_path / "a.nhdr", IJK)), FRAMES)


def test_pixels_elsewhere_are_not_looked_for(tmp_path: Path) -> None:
    for place in ["/etc/passwd", "../b.raw"]:
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


def with_sform(path: Path, sform, pixdim=(0.015, 0.004, 0.1), code: int = 1) -> Path:
    image = nibabel.Nifti1Image(VOLUME, None)
    image.header.set_xyzt_units("mm", "sec")
    image.header.set_zooms(pixdim)
    image.header.set_sform(np.diag([*sform, 1.0]), code)
    nibabel.save(image, path)
    return path


def test_an_sform_that_contradicts_pixdim_is_refused_with_both(tmp_path: Path) -> None:
    path = with_sform(tmp_path / "a.nii", (0.015, 0.008, 0.1))
    with pytest.raises(
        FrameError, match=r"pixdim states .* 0\.015 x 0\.004 x 0\.1 and sform .* 0\.015 x 0\.008 x 0\.1"
    ):
        read_nifti(path, IJK)


def test_an_sform_without_code_or_of_ones_states_no_spacing(tmp_path: Path) -> None:
    for sform, pixdim, code, source, notes in [
        ((-0.015, -0.004, 0.1), (0.015, 0.004, 0.1), 1, "NIfTI's pixdim", 0),
        ((0.015, 0.004, 0.1), (1.0, 1.0, 1.0), 2, "NIfTI's sform", 1),
        ((1.0, 1.0, 1.0), (0.015, 0.004, 0.1), 2, "NIfTI's pixdim", 1),
        ((9.0, 9.0, 9.0), (0.015, 0.004, 0.1), 0, "NIfTI's pixdim", 0),
    ]:
        scan = read_nifti(with_sform(tmp_path / "a.nii", sform, pixdim, code), IJK)
        assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))
        assert scan.depth_pixel_m.source == source
        assert len(scan.notes) == notes


def test_a_unit_that_nifti_does_not_have_is_refused_by_name(tmp_path: Path) -> None:
    data = bytearray(nifti(tmp_path / "a.nii").read_bytes())
    data[123] = 5  # xyzt_units
    (tmp_path / "a.nii").write_bytes(data)
    with pytest.raises(FrameError, match="xyzt_units: 5 "):
        read_nifti(tmp_path / "a.nii", IJK)


def test_slices_behind_those_that_dim_states_are_refused(tmp_path: Path) -> None:
    for name in ["a.nii", "a.nii.gz"]:
        image = nibabel.load(nifti(tmp_path / "whole.nii"))
        data = bytearray(Path(image.get_filename()).read_bytes())
        data[46:48] = (COUNT - 1).to_bytes(2, "little")  # dim[3]
        (tmp_path / name).write_bytes(gzip.compress(data) if name.endswith("gz") else data)
        with pytest.raises(FrameError, match=r"dim states 40 x 24 x 4 pixels, and more follow"):
            read_nifti(tmp_path / name, IJK)


def test_the_slope_of_a_nifti_is_honoured(tmp_path: Path) -> None:
    for slope, intercept in [(-0.5, 10.0), (2.0, 0.0), (0.0, 7.0), (np.nan, 0.0)]:
        data = bytearray(nifti(tmp_path / "a.nii").read_bytes())
        data[112:120] = np.array([slope, intercept], "<f4").tobytes()
        (tmp_path / "a.nii").write_bytes(data)
        scan = read_nifti(tmp_path / "a.nii", IJK)
        scaled = np.isfinite(slope) and slope != 0.0
        np.testing.assert_allclose(pictures_of(scan), FRAMES * slope + intercept if scaled else FRAMES)
        assert any("scl_slope" in note for note in scan.notes) == scaled


def test_colour_and_complex_numbers_are_refused(tmp_path: Path) -> None:
    for kind in [[("R", "u1"), ("G", "u1"), ("B", "u1")], np.complex64]:
        nibabel.save(nibabel.Nifti1Image(np.zeros((40, 24, 5), kind), np.eye(4)), tmp_path / "a.nii")
        with pytest.raises(FrameError, match=r"a\.nii: pixels of type .*give whole numbers or floats"):
            read_nifti(tmp_path / "a.nii", None)


def test_a_sequence_of_plus_in_an_nrrd_is_read_alike(tmp_path: Path) -> None:
    fields = plus_fields([10.0, 10.25, 0.0, 11.0, 12.0], ["OK", "OK", "INVALID", "OK", "OK"])
    lines = [f"{name}:={value}" for name, value in fields.items()]
    scan = read_nrrd(nhdr(tmp_path / "a.nrrd", *lines), IJK)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES[[0, 1, 3, 4]])
    np.testing.assert_allclose(scan.times.time_s, [10.0, 10.25, 11.0, 12.0])
    with pytest.raises(FrameError, match="UltrasoundImageOrientation = MN"):
        read_nrrd(nhdr(tmp_path / "b.nrrd", "UltrasoundImageOrientation:=MN"), IJK)


BIG = FRAMES.astype(">u2").tobytes()


def nhdr(path: Path, *lines: str, pixels: bytes | None = None) -> Path:
    known = ["type: uint16", "dimension: 3", f"sizes: {COLUMNS} {ROWS} {COUNT}", "endian: little", "encoding: raw"]
    names = [line.partition(":")[0] for line in lines]
    header = [line for line in known if line.partition(":")[0] not in names] + list(lines)
    path.write_bytes(
        "\n".join(["NRRD0004", *header, "", ""]).encode() + (FRAMES.tobytes() if pixels is None else pixels)
    )
    return path


def test_units_of_an_nrrd_are_those_of_each_axis(tmp_path: Path) -> None:
    scan = read_nrrd(nhdr(tmp_path / "a.nrrd", "spacings: 0.015 4 1", 'units: "mm" "um" ""'), IJK)
    assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))
    scan = read_nrrd(nhdr(tmp_path / "b.nrrd", "spacings: 0.015 4 1", 'units: "mm" "" ""'), IJK)
    assert scan.depth_pixel_m is None


def test_space_units_of_an_nrrd_are_those_of_each_direction(tmp_path: Path) -> None:
    directions = "space directions: (0,0.015,0) (4,0,0) (0,0,1)"
    space = ("space dimension: 3", 'space units: "um" "mm" "mm"')
    scan = read_nrrd(nhdr(tmp_path / "a.nrrd", *space, directions), IJK)
    assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))
    with pytest.raises(FrameError, match="axis 1 runs along directions of several space units"):
        read_nrrd(nhdr(tmp_path / "b.nrrd", *space, directions.replace("(0,0.015,0)", "(1,0.015,0)")), IJK)


def test_ends_of_axes_go_with_spacings_between_samples_or_edges(tmp_path: Path) -> None:
    for maxs in ["0.6 0.096 5", "0.585 0.092 4", "0.6 nan nan"]:
        lines = ["spacings: 0.015 0.004 1", 'units: "mm" "mm" "mm"', "axis mins: 0 0 0", f"axis maxs: {maxs}"]
        assert read_nrrd(nhdr(tmp_path / "a.nrrd", *lines), IJK).depth_pixel_m.value == pytest.approx(4e-6)


def test_directions_without_a_unit_are_in_mm_in_an_anatomical_space_alone(tmp_path: Path) -> None:
    directions = "space directions: (0.015,0,0) (0,0.004,0) (0,0,1)"
    for nth, (space, depth_m) in enumerate(
        [("space: LPS", 4e-6), ("space: right-anterior-superior", 4e-6), ("space: 3D-right-handed", None)]
    ):
        scan = read_nrrd(nhdr(tmp_path / f"{nth}.nrrd", space, directions), IJK)
        assert (scan.depth_pixel_m and scan.depth_pixel_m.value) == (depth_m and pytest.approx(depth_m))


def test_what_an_nrrd_contradicts_or_what_is_not_read_is_refused(tmp_path: Path) -> None:
    for lines, message in [
        (
            ("space: LPS", "space directions: (0.015,0,0) (0,0.004,0) (0,0,1)", "spacings: 0.015 0.008 1"),
            "axis 2: spacings states 0.008, and space directions 0.004",
        ),
        (
            ("space: LPS", "space directions: (0.015,0,0) (0,0.004,0) (0,0,1)", 'units: "um" "um" ""'),
            "axis 1: units states 'um', and space units",
        ),
        (
            ("spacings: 0.015 0.004 1", "axis mins: 0 0 0", "axis maxs: 0.6 0.2 5"),
            "axis 2: spacings states 0.004, and 24 samples from axis mins 0 to maxs 0.2",
        ),
        (("kinds: vector domain domain",), "kinds: axis 1 of 40 is 'vector'"),
        (("kinds: domain domain RGB-color",), "kinds: axis 3 of 5 is 'RGB-color'"),
        (("data file: LIST",), "data file: LIST"),
        (("data file: a%03d.raw 1 5 1",), "data file: a%03d.raw"),
        (("encoding: gzip", "byte skip: 8"), "byte skip: 8 beside encoding: gzip"),
        (("encoding: hex",), "hex"),
        (("sizes: 40 24 4",), "Size of the data"),
        (("type: block", "block size: 2"), "type: block"),
    ]:
        with pytest.raises(FrameError, match=message):
            read_nrrd(nhdr(tmp_path / "a.nrrd", *lines), IJK)


def test_pixels_of_an_nrrd_behind_a_skip_and_of_either_order_are_found(tmp_path: Path) -> None:
    for skip in ["byte skip: 12", "byte skip: -1", "line skip: 2"]:
        for big in [False, True]:
            pixels = BIG if big else FRAMES.tobytes()
            endian = f"endian: {'big' if big else 'little'}"
            nhdr(tmp_path / "a.nhdr", "data file: a.raw", skip, endian, pixels=b"")
            (tmp_path / "a.raw").write_bytes(b"two..\nlines\n" + pixels if skip.startswith("l") else b"x" * 12 + pixels)
            np.testing.assert_array_equal(pictures_of(read_nrrd(tmp_path / "a.nhdr", IJK)), FRAMES)


def test_more_packed_in_a_file_than_its_header_says_is_not_unpacked(tmp_path: Path) -> None:
    for kind in ["nrrd", "mha"]:
        packed = zlib.compress(bytes(2**28), 9)
        headers = {
            "nrrd": b"NRRD0004\ntype: uint16\ndimension: 3\nsizes: 40 24 5\nendian: little\nencoding: gzip\n\n",
            "mha": b"ObjectType = Image\nNDims = 3\nDimSize = 40 24 5\nElementType = MET_USHORT\n"
            b"CompressedData = True\n"
            b"CompressedDataSize = %d\nElementDataFile = LOCAL\n" % len(packed),
        }
        (tmp_path / f"a.{kind}").write_bytes(headers[kind] + packed)
        with less_than(2**27), pytest.raises(FrameError, match="more is packed in it"):
            (read_nrrd if kind == "nrrd" else read_metaimage)(tmp_path / f"a.{kind}", IJK)


def test_a_damaged_file_is_named(tmp_path: Path) -> None:
    for read, name in [(read_nifti, "a.nii"), (read_metaimage, "a.mha"), (read_nrrd, "a.nrrd")]:
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


def test_a_metaimage_comes_back_with_its_spacing(tmp_path: Path) -> None:
    for packed in [False, True]:
        metaimageio = pytest.importorskip("metaimageio")
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


def mha(path: Path, pixels: bytes | None = None, **fields: object) -> Path:
    """Write a MetaImage of FRAMES; a field of None is left out."""
    known = {
        "ObjectType": "Image", "NDims": 3, "BinaryData": "True", "BinaryDataByteOrderMSB": "False",
        "DimSize": f"{COLUMNS} {ROWS} {COUNT}", "ElementSpacing": "0.015 0.004 0.1", "ElementType": "MET_USHORT",
    }  # fmt: skip
    stated = {name: value for name, value in (known | fields).items() if value is not None}
    stated["ElementDataFile"] = stated.pop("ElementDataFile", "LOCAL")
    header = "".join(f"{name} = {value}\n" for name, value in stated.items()).encode()
    pixels = FRAMES.tobytes() if pixels is None else pixels
    local = stated["ElementDataFile"] == "LOCAL"
    path.write_bytes(header + (pixels if local else b""))
    if not local:
        path.with_name(str(stated["ElementDataFile"])).write_bytes(pixels)
    return path


TEXT = " ".join(map(str, FRAMES.ravel().tolist())).encode()


def test_the_storage_that_a_metaimage_states_is_honoured(tmp_path: Path) -> None:
    for pixels, fields in [
        (None, {}),
        (None, {"BinaryData": None}),
        (None, {"BinaryData": "T"}),
        (TEXT, {"BinaryData": "False"}),
        (TEXT, {"BinaryData": "False", "ElementDataFile": "a.txt"}),
        (BIG, {"BinaryDataByteOrderMSB": "True"}),
        (BIG, {"BinaryDataByteOrderMSB": None, "ElementByteOrderMSB": "True"}),
        (b"x" * 100 + FRAMES.tobytes(), {"HeaderSize": -1, "ElementDataFile": "a.raw"}),
        (b"x" * 100 + FRAMES.tobytes(), {"HeaderSize": 100, "ElementDataFile": "a.raw"}),
        (FRAMES.astype("<i4").tobytes(), {"ElementType": "MET_LONG"}),
        (FRAMES.astype("<u8").tobytes(), {"ElementType": "MET_ULONG_LONG"}),
        (zlib.compress(BIG), {"CompressedData": "True", "BinaryDataByteOrderMSB": "True"}),
    ]:
        scan = read_metaimage(mha(tmp_path / "a.mhd", pixels, **fields), IJK)
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert (scan.lateral_pixel_m.value, scan.depth_pixel_m.value) == pytest.approx((15e-6, 4e-6))
        assert scan.notes == ()


def test_what_a_metaimage_contradicts_or_what_is_not_read_is_refused_by_name(tmp_path: Path) -> None:
    for pixels, fields, message in [
        (b"x" + FRAMES.tobytes(), {"ElementDataFile": "a.raw"}, r"a\.raw has 9601 bytes .* take 9600"),
        (None, {"DimSize": "40 24 4"}, "9600 bytes of pixels; DimSize = 40 24 4 .* take 7680"),
        (None, {"DimSize": "40 24"}, "NDims = 3, and DimSize has 2 numbers"),
        (None, {"DimSize": None}, "its header has no DimSize"),
        (None, {"ElementSpacing": "1 2"}, "ElementSpacing has 2 numbers"),
        (None, {"HeaderSize": 100}, "HeaderSize = 100 beside pixels in the same file"),
        (None, {"CompressedData": "True", "BinaryData": "False"}, "BinaryData = False and CompressedData = True"),
        (None, {"BinaryData": "Maybe"}, "BinaryData = Maybe"),
        (None, {"ElementByteOrderMSB": "True"}, "BinaryDataByteOrderMSB = False and ElementByteOrderMSB = True"),
        (None, {"ElementNumberOfChannels": 3}, "ElementNumberOfChannels = 3"),
        (None, {"ElementType": "MET_USHORT_ARRAY"}, "ElementType = MET_USHORT_ARRAY"),
        (None, {"ElementDataFile": "LIST"}, "ElementDataFile = LIST"),
        (None, {"ElementDataFile": "a%03d.raw 1 5 1"}, "ElementDataFile = a%03d.raw 1 5 1"),
        (None, {"HeaderSizePerSlice": 8}, "HeaderSizePerSlice = 8"),
        (None, {"ObjectType": "Tube"}, "ObjectType = Tube"),
        (None, {"TransformMatrix": "0.5 0 0 0 1 0 0 0 1"}, "TransformMatrix has directions of length 0.5 x 1 x 1"),
        (None, {"elementspacing": "1 2 3"}, "elementspacing is stated twice: '0.015 0.004 0.1' and '1 2 3'"),
        (TEXT.replace(b" 77 ", b" 70000 "), {"BinaryData": "False"}, "pixel 77 is 70000"),
        (TEXT.replace(b" 77 ", b" 7.5 "), {"BinaryData": "False"}, "pixel 77 is 7.5"),
        (None, {"UltrasoundImageOrientation": "MN"}, "UltrasoundImageOrientation = MN"),
        (None, {"UltrasoundImageOrientation": "FM"}, "UltrasoundImageOrientation = FM: depth is axis 1"),
    ]:
        with pytest.raises(FrameError, match=message):
            read_metaimage(mha(tmp_path / "a.mhd", pixels, **fields), IJK)


def test_what_a_metaimage_does_not_state_stays_open_or_is_noted(tmp_path: Path) -> None:
    for fields, depth_m, notes in [
        ({"ElementSpacing": None}, None, 0),
        ({"ElementSpacing": "1 1 1"}, None, 0),
        ({"ElementSpacing": None, "ElementSize": "0.015 0.004 0.1"}, 4e-6, 0),
        ({"ElementSize": "0.015 0.008 0.1"}, 4e-6, 1),
        ({"BinaryDataByteOrderMSB": None}, 4e-6, 1),
        ({"UltrasoundImageOrientation": "UNKNOWN"}, 4e-6, 1),
    ]:
        scan = read_metaimage(mha(tmp_path / "a.mha", **fields), IJK)
        assert (scan.depth_pixel_m and scan.depth_pixel_m.value) == (depth_m and pytest.approx(depth_m))
        assert len(scan.notes) == notes


def test_a_sequence_of_plus_has_its_own_times_and_leaves_out_invalid_frames(tmp_path: Path) -> None:
    stamps = [10.0, 10.25, 0.0, 11.0, 12.0]
    scan = read_metaimage(mha(tmp_path / "a.mha", **plus_fields(stamps, ["OK", "OK", "INVALID", "OK", "OK"])), IJK)
    np.testing.assert_array_equal(pictures_of(scan), FRAMES[[0, 1, 3, 4]])
    np.testing.assert_allclose(scan.times.time_s, [10.0, 10.25, 11.0, 12.0])
    assert any("frames 2 (from 0) are left out" in note for note in scan.notes)


def test_times_of_plus_that_do_not_rise_are_a_contradiction(tmp_path: Path) -> None:
    scan = read_metaimage(mha(tmp_path / "a.mha", **plus_fields([1, 2, 3, 2.5, 4])), IJK)
    assert scan.times is None
    assert "does not rise: 3 (frame 2) and 2.5 (frame 3)" in str(scan.times_fault)


def test_a_sequence_of_plus_with_other_frames_or_none_that_is_valid_is_refused(tmp_path: Path) -> None:
    fields = plus_fields(range(COUNT)) | {"UltrasoundImageOrientation": None}
    with pytest.raises(FrameError, match=r"Seq_FrameNNNN_Timestamp of 5 frames, 0 to 4, and 40"):
        read_metaimage(mha(tmp_path / "a.mha", **fields), ("frame", "depth", "lateral"))
    with pytest.raises(FrameError, match=r"ImageStatus = INVALID for all 5 frames"):
        read_metaimage(mha(tmp_path / "a.mha", **plus_fields(range(COUNT), ["INVALID"] * COUNT)), IJK)
