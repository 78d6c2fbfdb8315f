"""NIfTI, NRRD, MetaImage and the .oct of Thorlabs."""

import gzip
import os
import re
import zlib
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from effects import less_than
from foreign_files import (
    COLUMNS,
    COUNT,
    FRAMES,
    ROWS,
    oct_entry,
    pictures_of,
    plus_fields,
    sizes_of,
    write_oct,
)

from scleraforce.base.errors import FrameError, InputError
from scleraforce.recordings.formats.volume_files import (
    read_metaimage,
    read_nifti,
    read_nrrd,
    read_thorlabs,
)
from scleraforce.recordings.import_sources import read_scan, source_kind

nibabel = pytest.importorskip("nibabel")
nrrd = pytest.importorskip("nrrd")
metaimageio = pytest.importorskip("metaimageio")

IJK = ("lateral", "depth", "frame")  # the fastest first
VOLUME = np.ascontiguousarray(FRAMES.T)  # by these indices
SIZE = pytest.approx((4e-6, 15e-6))  # depth and width of a pixel
PLUS = plus_fields([10.0, 10.25, 0.0, 11.0, 12.0], ["OK", "OK", "INVALID", "OK", "OK"])


def nifti(
    path: Path,
    volume=VOLUME,
    steps=(0.015, 0.004, 0.1),
    unit="mm",
    time="sec",
    sform=None,
) -> Path:
    """Write a NIfTI; `sform` has its diagonal and code."""
    image = nibabel.Nifti1Image(volume, np.eye(4) if sform is None else None)
    image.header.set_xyzt_units(unit, time)
    image.header.set_zooms(steps)
    if sform is not None:
        image.header.set_sform(np.diag([*sform[0], 1.0]), sform[1])

    nibabel.save(image, path)
    return path


def patched(path: Path, at: int, value: bytes) -> Path:
    data = bytearray(path.read_bytes())
    data[at : at + len(value)] = value
    path.write_bytes(data)
    return path


def test_a_nifti_volume_comes_back_with_its_spacing_and_times(tmp_path):
    for name in ["a.nii", "a.nii.gz"]:
        scan = read_nifti(nifti(tmp_path / name), IJK)
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert (sizes_of(scan), scan.times) == (SIZE, None)

    in_time = VOLUME[:, :, np.newaxis]
    for steps, units, sizes in [
        ((15.0, 4.0, 7.0, 250.0), ("micron", "msec"), SIZE),
        (
            (1.0, 1.0, 1.0, 0.25),
            ("mm", "sec"),
            (None, None),
        ),  # a step of time is not a scale
    ]:
        scan = read_nifti(nifti(tmp_path / "a.nii", in_time, steps, *units), IJK)
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert sizes_of(scan) == sizes
        np.testing.assert_allclose(scan.times.time_s, 0.25 * np.arange(COUNT))


def test_the_spacing_of_a_nifti_is_that_of_pixdim_or_sform_and_contradictions_are_refused(
    tmp_path,
):
    known = (0.015, 0.004, 0.1)
    ones = (1.0, 1.0, 1.0)

    for steps, unit, sform, source in [
        (ones, "mm", None, None),
        (known, "unknown", None, None),
        (known, "mm", ((-0.015, -0.004, 0.1), 1), "NIfTI's pixdim"),
        (ones, "mm", (known, 2), "NIfTI's sform"),
        (known, "mm", (ones, 2), "NIfTI's pixdim"),
        (known, "mm", ((9.0, 9.0, 9.0), 0), "NIfTI's pixdim"),
    ]:
        scan = read_nifti(
            nifti(tmp_path / "a.nii", steps=steps, unit=unit, sform=sform), IJK
        )
        assert sizes_of(scan) == ((None, None) if source is None else SIZE)
        assert source is None or scan.size.source == source

    scan = read_nifti(nifti(tmp_path / "a.nii", sform=((0.015, 0.008, 0.1), 1)), IJK)
    assert re.search(
        r"pixdim states .* 0\.004 x 0\.015 mm .* sform states .* 0\.008 x 0\.015 mm",
        scan.scale_fault,
    )
    assert sizes_of(scan) == (None, None)

    with pytest.raises(FrameError, match="xyzt_units: 5 "):
        read_nifti(patched(nifti(tmp_path / "a.nii"), 123, b"\5"), IJK)

    # dim[3]
    fewer = patched(nifti(tmp_path / "a.nii"), 46, (COUNT - 1).to_bytes(2, "little"))
    (tmp_path / "a.nii.gz").write_bytes(gzip.compress(fewer.read_bytes()))

    for nth, kind in enumerate(([("R", "u1"), ("G", "u1"), ("B", "u1")], np.complex64)):
        nibabel.save(
            nibabel.Nifti1Image(np.zeros((40, 24, 5), kind), np.eye(4)),
            tmp_path / f"{nth}.nii",
        )

    for name, found in [
        ("a.nii", "dim states 40 x 24 x 4 pixels, and more follow"),
        ("a.nii.gz", "dim states 40 x 24 x 4 pixels, and more follow"),
        ("0.nii", r"0\.nii: pixels of type .*give whole numbers or floats"),
        ("1.nii", r"1\.nii: pixels of type .*give whole numbers or floats"),
    ]:
        with pytest.raises(FrameError, match=found):
            read_nifti(tmp_path / name, IJK if name.startswith("a") else None)


def test_pixels_elsewhere_are_not_looked_for(tmp_path):
    for place in ["/etc/passwd", "../b.raw"]:
        header = mha(tmp_path / "a.mhd").read_bytes().replace(b"LOCAL", place.encode())
        (tmp_path / "a.mhd").write_bytes(header)
        nhdr(tmp_path / "a.nhdr", f"data file: {place}", pixels=b"")

        for read, name in ((read_metaimage, "a.mhd"), (read_nrrd, "a.nhdr")):
            with pytest.raises(
                FrameError, match=f"{name}: its pixels are said to be in '{place}'"
            ):
                read(tmp_path / name, IJK)


def test_the_slope_of_a_nifti_is_applied(tmp_path):
    for slope, intercept in [(-0.5, 10.0), (2.0, 0.0), (0.0, 7.0), (np.nan, 0.0)]:
        path = patched(
            nifti(tmp_path / "a.nii"),
            112,
            np.array([slope, intercept], "<f4").tobytes(),
        )
        scan = read_nifti(path, IJK)
        scaled = np.isfinite(slope) and slope != 0.0
        np.testing.assert_allclose(
            pictures_of(scan), FRAMES * slope + intercept if scaled else FRAMES
        )
        assert any("scl_slope" in note for note in scan.notes) == scaled


BIG = FRAMES.astype(">u2").tobytes()


def nhdr(path: Path, *lines: str, pixels: bytes = FRAMES.tobytes()) -> Path:
    known = [
        "type: uint16",
        "dimension: 3",
        f"sizes: {COLUMNS} {ROWS} {COUNT}",
        "endian: little",
        "encoding: raw",
    ]
    names = [line.partition(":")[0] for line in lines]
    header = [line for line in known if line.partition(":")[0] not in names] + list(
        lines
    )
    path.write_bytes("\n".join(["NRRD0004", *header, "", ""]).encode() + pixels)

    return path


def test_an_nrrd_has_a_spacing_where_its_unit_is_known(tmp_path):
    in_um = "spacings: 15 4 1"
    directions = "space directions: (0.015,0,0) (0,0.004,0) (0,0,1)"

    for lines, sizes in [
        ((in_um, 'units: "um" "um" ""'), SIZE),
        (("spacings: 0.015 4 1", 'units: "mm" "um" ""'), SIZE),
        (("spacings: 0.015 4 1", 'units: "mm" "" ""'), (None, pytest.approx(15e-6))),
        ((in_um,), (None, None)),
        (("space: LPS", directions), SIZE),
        (("space: left-posterior-superior", directions), SIZE),
        (("space: right-anterior-superior", directions), SIZE),
        (("space: 3D-right-handed", directions), (None, None)),  # not anatomical
        (
            (
                "space dimension: 3",
                'space units: "um" "um" "um"',
                "space directions: (0,15,0) (4,0,0) (0,0,1)",
            ),
            SIZE,
        ),
    ]:
        scan = read_nrrd(nhdr(tmp_path / "a.nrrd", *lines), IJK)
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert sizes_of(scan) == sizes

        if sizes == SIZE:  # axes named by the file
            scan = read_nrrd(
                nhdr(tmp_path / "b.nrrd", *lines, 'labels: "lateral" "depth" "frame"'),
                None,
            )
            np.testing.assert_array_equal(pictures_of(scan), FRAMES)


def test_what_an_nrrd_contradicts_or_what_is_not_read_is_refused(
    tmp_path,
):
    space = ("space: LPS", "space directions: (0.015,0,0) (0,0.004,0) (0,0,1)")
    scan = read_nrrd(nhdr(tmp_path / "a.nrrd", *space, "spacings: 0.015 0.008 1"), IJK)
    assert re.search(
        r"directions states .* 0\.004 x 0\.015 mm .*spacings states .* 0\.008 x 0\.015",
        scan.scale_fault,
    )
    several = (
        "space dimension: 3",
        'space units: "um" "mm" "mm"',
        "space directions: (1,0.015,0) (4,0,0) (0,0,1)",
    )

    for lines, message in [
        (several, "space units: mm and um; give all directions in one"),
        (("kinds: vector domain domain",), "kinds: axis 1 of 40 is 'vector'"),
        (("kinds: domain domain RGB-color",), "kinds: axis 3 of 5 is 'RGB-color'"),
        (("data file: LIST",), "data file: LIST"),
        (("data file: a%03d.raw 1 5 1",), "data file: a%03d.raw"),
        (("encoding: hex",), "hex"),
        (("sizes: 40 24 4",), "Size of the data"),
        (("UltrasoundImageOrientation:=MN",), "UltrasoundImageOrientation = MN"),
    ]:
        with pytest.raises(FrameError, match=message):
            read_nrrd(nhdr(tmp_path / "a.nrrd", *lines), IJK)


def test_pixels_of_an_nrrd_behind_a_skip_and_of_either_order_are_found(
    tmp_path,
):
    for skip, big in product(
        ["byte skip: 12", "byte skip: -1", "line skip: 2"], [False, True]
    ):
        nhdr(
            tmp_path / "a.nhdr",
            "data file: a.raw",
            skip,
            f"endian: {'big' if big else 'little'}",
            pixels=b"",
        )
        before = b"two..\nlines\n" if skip.startswith("line") else b"x" * 12
        (tmp_path / "a.raw").write_bytes(before + (BIG if big else FRAMES.tobytes()))
        np.testing.assert_array_equal(
            pictures_of(read_nrrd(tmp_path / "a.nhdr", IJK)), FRAMES
        )


def test_more_packed_in_a_file_than_its_header_says_is_not_unpacked(
    tmp_path,
):
    packed = zlib.compress(bytes(2**28), 9)
    nhdr(tmp_path / "a.nrrd", "encoding: gzip", pixels=packed)
    mha(
        tmp_path / "a.mha",
        packed,
        CompressedData="True",
        CompressedDataSize=len(packed),
    )

    for read, name in [(read_nrrd, "a.nrrd"), (read_metaimage, "a.mha")]:
        with less_than(2**27), pytest.raises(FrameError, match="more is packed in it"):
            read(tmp_path / name, IJK)


def test_a_missing_package_is_named_with_its_installation(tmp_path, monkeypatch):
    path = nifti(tmp_path / "a.nii")
    monkeypatch.setitem(__import__("sys").modules, "nibabel", None)

    with pytest.raises(
        InputError,
        match=r"NIfTI takes the package nibabel.*pip install 'scleraforce\[formats\]'",
    ):
        read_nifti(path, IJK)


def mha(path: Path, pixels: bytes | None = None, **fields: object) -> Path:
    """Write a MetaImage of FRAMES; a field of None is left out."""
    known = {
        "ObjectType": "Image",
        "NDims": 3,
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "DimSize": f"{COLUMNS} {ROWS} {COUNT}",
        "ElementSpacing": "0.015 0.004 0.1",
        "ElementType": "MET_USHORT",
    }
    stated = {
        name: value for name, value in (known | fields).items() if value is not None
    }
    stated["ElementDataFile"] = stated.pop("ElementDataFile", "LOCAL")
    header = "".join(f"{name} = {value}\n" for name, value in stated.items()).encode()
    pixels = FRAMES.tobytes() if pixels is None else pixels
    local = stated["ElementDataFile"] == "LOCAL"
    path.write_bytes(header + (pixels if local else b""))

    if not local:
        path.with_name(str(stated["ElementDataFile"])).write_bytes(pixels)

    return path


TEXT = " ".join(map(str, FRAMES.ravel().tolist())).encode()


def test_the_storage_that_a_metaimage_states_is_read(tmp_path):
    for pixels, fields in [
        (None, {}),
        (None, {"BinaryData": None}),
        (None, {"BinaryData": "T"}),
        (TEXT, {"BinaryData": "False"}),
        (TEXT, {"BinaryData": "False", "ElementDataFile": "a.txt"}),
        (BIG, {"BinaryDataByteOrderMSB": "True"}),
        (BIG, {"BinaryDataByteOrderMSB": None, "ElementByteOrderMSB": "True"}),
        (b"x" * 100 + FRAMES.tobytes(), {"HeaderSize": -1, "ElementDataFile": "a.raw"}),
        (
            b"x" * 100 + FRAMES.tobytes(),
            {"HeaderSize": 100, "ElementDataFile": "a.raw"},
        ),
        (FRAMES.astype("<i4").tobytes(), {"ElementType": "MET_LONG"}),
        (FRAMES.astype("<u8").tobytes(), {"ElementType": "MET_ULONG_LONG"}),
        (
            zlib.compress(BIG),
            {"CompressedData": "True", "BinaryDataByteOrderMSB": "True"},
        ),
        (
            zlib.compress(FRAMES.tobytes()),
            {"CompressedData": "True", "ElementDataFile": "a.zraw"},
        ),
    ]:
        scan = read_metaimage(mha(tmp_path / "a.mhd", pixels, **fields), IJK)
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert (sizes_of(scan), scan.notes) == (SIZE, ())

    for packed in [False, True]:  # as another program writes it
        metaimageio.write(
            tmp_path / "a.mha",
            FRAMES,
            ElementSpacing=[0.015, 0.004, 0.1],
            CompressedData=packed,
        )
        scan = read_metaimage(tmp_path / "a.mha", IJK)
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert sizes_of(scan) == SIZE


def test_what_a_metaimage_contradicts_or_what_is_not_read_is_refused_by_name(
    tmp_path,
):
    for pixels, fields, message in [
        (
            b"x" + FRAMES.tobytes(),
            {"ElementDataFile": "a.raw"},
            r"a\.raw has 9601 bytes .* take 9600",
        ),
        (
            None,
            {"DimSize": "40 24 4"},
            "9600 bytes of pixels; DimSize = 40 24 4 .* take 7680",
        ),
        (None, {"DimSize": "40 24"}, "9600 bytes of pixels; DimSize = 40 24 of"),
        (None, {"DimSize": None}, "its header has no DimSize"),
        (None, {"ElementSpacing": "1 2"}, "ElementSpacing has 2 numbers"),
        (None, {"HeaderSize": 100}, r"a\.mhd has 9500 bytes .* \(HeaderSize = 100\)"),
        (
            None,
            {"ElementByteOrderMSB": "True"},
            "BinaryDataByteOrderMSB and ElementByteOrderMSB contradict",
        ),
        (None, {"ElementNumberOfChannels": 3}, "ElementNumberOfChannels = 3"),
        (None, {"ElementType": "MET_USHORT_ARRAY"}, "ElementType = MET_USHORT_ARRAY"),
        (None, {"ElementDataFile": "LIST"}, "ElementDataFile = LIST"),
        (
            None,
            {"ElementDataFile": "a%03d.raw 1 5 1"},
            "ElementDataFile = a%03d.raw 1 5 1",
        ),
        (
            None,
            {"TransformMatrix": "0.5 0 0 0 1 0 0 0 1"},
            "TransformMatrix has directions of length 0.5 x 1 x 1",
        ),
        (
            None,
            {"elementspacing": "1 2 3"},
            "elementspacing is stated twice: '0.015 0.004 0.1' and '1 2 3'",
        ),
        (
            TEXT.replace(b" 77 ", b" 70000 "),
            {"BinaryData": "False"},
            "70000 out of bounds for uint16",
        ),
        (TEXT.replace(b" 77 ", b" 7.5 "), {"BinaryData": "False"}, "invalid .*7.5"),
        (None, {"UltrasoundImageOrientation": "MN"}, "UltrasoundImageOrientation = MN"),
        (
            None,
            {"UltrasoundImageOrientation": "FM"},
            "UltrasoundImageOrientation = FM: depth is axis 1",
        ),
    ]:
        with pytest.raises(FrameError, match=message):
            read_metaimage(mha(tmp_path / "a.mhd", pixels, **fields), IJK)


def test_what_a_metaimage_does_not_state_stays_open_or_is_noted(tmp_path):
    for fields, depth_m, notes in [
        ({"ElementSpacing": None}, None, 0),
        ({"ElementSpacing": "1 1 1"}, None, 0),
        ({"ElementSpacing": None, "ElementSize": "0.015 0.004 0.1"}, 4e-6, 0),
        ({"ElementSize": "0.015 0.004 0.1"}, 4e-6, 0),
        ({"BinaryDataByteOrderMSB": None}, 4e-6, 1),
        ({"UltrasoundImageOrientation": "UNKNOWN"}, 4e-6, 1),
    ]:
        scan = read_metaimage(mha(tmp_path / "a.mha", **fields), IJK)
        assert sizes_of(scan)[0] == (depth_m and pytest.approx(depth_m))
        assert len(scan.notes) == notes

    scan = read_metaimage(mha(tmp_path / "a.mha", ElementSize="0.015 0.008 0.1"), IJK)
    assert re.search(
        r"ElementSpacing states .* 0\.004 x 0\.015 mm .*ElementSize states .* 0\.008",
        scan.scale_fault,
    )


def test_a_sequence_of_plus_has_its_own_times_and_leaves_out_invalid_frames(
    tmp_path,
):
    lines = [f"{name}:={value}" for name, value in PLUS.items()]
    for scan in (
        read_metaimage(mha(tmp_path / "a.mha", **PLUS), IJK),
        read_nrrd(nhdr(tmp_path / "a.nrrd", *lines), IJK),
    ):
        np.testing.assert_array_equal(pictures_of(scan), FRAMES[[0, 1, 3, 4]])
        np.testing.assert_allclose(scan.times.time_s, [10.0, 10.25, 11.0, 12.0])
        assert any("frames 2 (from 0) are left out" in note for note in scan.notes)

    scan = read_metaimage(
        mha(tmp_path / "a.mha", **plus_fields([1, 2, 3, 2.5, 4])), IJK
    )
    assert scan.times is None
    assert "does not rise: 3 (frame 2) and 2.5 (frame 3)" in str(scan.times_fault)
    fields = plus_fields(range(COUNT)) | {"UltrasoundImageOrientation": None}

    with pytest.raises(
        FrameError, match=r"Seq_FrameNNNN_Timestamp of 5 frames, 0 to 4, .* has 40"
    ):
        read_metaimage(mha(tmp_path / "a.mha", **fields), ("frame", "depth", "lateral"))

    with pytest.raises(FrameError, match=r"ImageStatus = INVALID for all 5 frames"):
        read_metaimage(
            mha(tmp_path / "a.mha", **plus_fields(range(COUNT), ["INVALID"] * COUNT)),
            IJK,
        )


# Thorlabs' .oct, as Thorlabs' own MATLAB functions read it: no real file could be had.
INTENSITY = FRAMES.astype(np.float32) / 100.0 - 20.0  # dB


def test_the_intensity_comes_back_with_its_scale(tmp_path):
    # one B-scan has no third size
    single = oct_entry(count=1).replace(' SizeY="1"', "")
    for name, header, frames in [
        (
            "data\\Intensity.data",
            '<DataFile Type="Raw">data\\Spectral0.data</DataFile>' + oct_entry(),
            INTENSITY,
        ),
        ("data/Intensity.data", oct_entry(), INTENSITY),
        ("data/Intensity.data", single, INTENSITY[:1]),
    ]:
        path = write_oct(tmp_path / "a.oct", header, frames, name)
        assert source_kind(path) == "thorlabs"
        scan = read_scan(path, "thorlabs")
        np.testing.assert_array_equal(pictures_of(scan), frames)
        assert sizes_of(scan) == pytest.approx((4e-6, 15e-6))


def test_what_does_not_fit_is_refused(tmp_path):
    header = f"{oct_entry()}<Image><SizeReal><SizeZ>0.192</SizeZ></SizeReal></Image>"
    scan = read_thorlabs(write_oct(tmp_path / "a.oct", header, INTENSITY))
    assert re.search(
        r"Range.* states .* 0\.004 x 0\.015 mm .*SizeReal states .* 0\.008 x \?",
        scan.scale_fault,
    )

    for header, message in [
        (oct_entry(rows=ROWS + 1), "the header says 25 x 40 x 5 floats"),
        (oct_entry(rows=10**7), "a frame may have"),
        (oct_entry(count=0), "the header says 24 x 40 x 0 floats"),
        (oct_entry("data\\Spectral0.data"), "no processed intensity"),
        (
            oct_entry()
            + oct_entry("data\\VideoImage.data").replace("VideoImage", "Intensity"),
            "2 files of intensity",
        ),
        (oct_entry().replace(f'SizeZ="{ROWS}"', ""), "has no SizeZ"),
        (oct_entry().replace(f'SizeX="{COLUMNS}"', ""), "has no SizeX"),
        (
            oct_entry().replace('BytesPerPixel="4"', 'BytesPerPixel="2"'),
            "BytesPerPixel = 2",
        ),
        ("<DataFile>", "damaged or an unknown kind of Thorlabs"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>' + oct_entry(), "defines entities"),
    ]:
        with pytest.raises(FrameError, match=message):
            read_thorlabs(write_oct(tmp_path / "a.oct", header, INTENSITY))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
@pytest.mark.parametrize("named", [os.mkfifo, lambda path: path.symlink_to("pipe")])
def test_a_pipe_beside_a_header_is_refused_and_not_waited_for(tmp_path, named):
    """Also behind a link; nothing ever writes to it."""
    os.mkfifo(tmp_path / "pipe")
    for data in ("a.raw", "a.img"):
        named(tmp_path / data)

    header = mha(tmp_path / "a.mhd").read_bytes().partition(b"ElementDataFile")[0]
    (tmp_path / "a.mhd").write_bytes(header + b"ElementDataFile = a.raw\n")
    (tmp_path / "a.nhdr").write_text(
        "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 4 5 6\nencoding: raw\n"
        "endian: little\ndata file: a.raw\n"
    )
    (tmp_path / "a.hdr").write_bytes(b"\x5c\x01" + bytes(342) + b"ni1\0")
    for name in ("a.mhd", "a.nhdr", "a.hdr", "a.raw"):
        with pytest.raises(FrameError, match="a named pipe; give a regular file"):
            read_scan(tmp_path / name, source_kind(tmp_path / name), IJK)
