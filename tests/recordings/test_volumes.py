"""NIfTI, NRRD, MetaImage and the .oct of Thorlabs."""

import gzip
import os
import re
import sys
import zlib
from functools import partial

import numpy as np
import pytest
from effects import less_than
from foreign_files import (
    COLUMNS,
    COUNT,
    FRAMES,
    NO_SIZES,
    ROWS,
    SIZES_M,
    check_scan,
    oct_entry,
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
from scleraforce.recordings.import_sources import (
    ImportOptions,
    gather_sources,
    source_kind,
)

nibabel = pytest.importorskip("nibabel")
metaimageio = pytest.importorskip("metaimageio")
pytest.importorskip("nrrd")

IJK = ("lateral", "depth", "frame")  # the fastest first
PIXELS = FRAMES.tobytes()
VOLUME = np.ascontiguousarray(FRAMES.T)  # by these indices
BIG = FRAMES.astype(">u2").tobytes()
SPACING = "0.015 0.004 0.1"


# ---- NIfTI


def nifti(
    path,
    volume=VOLUME,
    steps=(0.015, 0.004, 0.1),
    units=("mm", "sec"),
    sform=None,
    code=1,
    **patches,
):
    """Write a NIfTI; `sform` is a diagonal, `patches` are bytes (b123: at byte 123)."""
    image = nibabel.Nifti1Image(volume, np.eye(4) if sform is None else None)
    image.header.set_xyzt_units(*units)
    image.header.set_zooms(steps)
    if sform is not None:
        image.header.set_sform(np.diag([*sform, 1.0]), code)
    nibabel.save(image, path)

    if patches:
        data = bytearray(path.read_bytes())
        for place, value in patches.items():
            at = int(place.removeprefix("b"))
            data[at : at + len(value)] = value
        path.write_bytes(data)
    return path


ONES = (1.0, 1.0, 1.0)
IN_TIME = VOLUME[:, :, np.newaxis]


@pytest.mark.parametrize(
    ("written", "sizes_m"),
    [
        ({"steps": (15.0, 4.0, 7.0, 250.0), "units": ("micron", "msec")}, SIZES_M),
        # a step of time is not a scale
        ({"steps": (*ONES, 0.25)}, NO_SIZES),
    ],
)
def test_the_fourth_axis_of_a_nifti_is_time(tmp_path, written, sizes_m):
    scan = read_nifti(nifti(tmp_path / "a.nii", IN_TIME, **written), IJK)
    check_scan(scan, FRAMES, sizes_m, 0.25 * np.arange(COUNT))


@pytest.mark.parametrize(
    ("written", "source"),
    [
        ({"steps": ONES}, None),
        ({"units": ("unknown", "sec")}, None),
        ({"sform": (-0.015, -0.004, 0.1)}, "NIfTI's pixdim"),
        ({"steps": ONES, "sform": (0.015, 0.004, 0.1), "code": 2}, "NIfTI's sform"),
        ({"sform": ONES, "code": 2}, "NIfTI's pixdim"),
        ({"sform": (9.0, 9.0, 9.0), "code": 0}, "NIfTI's pixdim"),
    ],
)
def test_the_spacing_of_a_nifti_is_that_of_pixdim_or_sform(tmp_path, written, source):
    scan = read_nifti(nifti(tmp_path / "a.nii.gz", **written), IJK)
    check_scan(scan, FRAMES, SIZES_M if source else NO_SIZES)
    assert source is None or scan.size.source == source
    assert scan.times is None


FEWER = (COUNT - 1).to_bytes(2, "little")
RGB = np.zeros((40, 24, 5), [("R", "u1"), ("G", "u1"), ("B", "u1")])


@pytest.mark.parametrize(
    ("written", "found"),
    [
        ({"b123": b"\5"}, "xyzt_units: 5 "),
        ({"b46": FEWER}, "dim states 40 x 24 x 4 pixels, and more follow"),
        ({"volume": RGB}, "pixels of type .*give whole numbers or floats"),
        ({"volume": VOLUME + 0j}, "pixels of type .*give whole numbers or floats"),
    ],
)
def test_what_a_nifti_contradicts_or_what_is_not_read_is_refused(
    tmp_path, written, found
):
    path = nifti(tmp_path / "a.nii", **written)
    packed = tmp_path / "a.nii.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    for each in (path, packed):
        with pytest.raises(FrameError, match=rf"{each.name}: .*{found}"):
            read_nifti(each, IJK)


@pytest.mark.parametrize(
    ("slope", "intercept", "scaled"),
    [(-0.5, 10.0, True), (2.0, 0.0, True), (0.0, 7.0, False), (np.nan, 0.0, False)],
)
def test_the_slope_of_a_nifti_is_applied(tmp_path, slope, intercept, scaled):
    patch = np.array([slope, intercept], "<f4").tobytes()
    scan = read_nifti(nifti(tmp_path / "a.nii", b112=patch), IJK)
    check_scan(scan, FRAMES * slope + intercept if scaled else FRAMES)
    assert any("scl_slope" in note for note in scan.notes) == scaled


def test_a_missing_package_is_named_with_its_installation(tmp_path, monkeypatch):
    path = nifti(tmp_path / "a.nii")
    monkeypatch.setitem(sys.modules, "nibabel", None)
    wanted = r"NIfTI takes the package nibabel.*pip install 'scleraforce\[formats\]'"
    with pytest.raises(InputError, match=wanted):
        read_nifti(path, IJK)


# ---- NRRD


def nhdr(path, *lines, pixels=PIXELS):
    usual = {
        "type": "uint16",
        "dimension": "3",
        "sizes": f"{COLUMNS} {ROWS} {COUNT}",
        "endian": "little",
        "encoding": "raw",
    }
    for line in lines:
        usual.pop(line.partition(":")[0], None)

    header = [f"{name}: {value}" for name, value in usual.items()]
    text = "\n".join(["NRRD0004", *header, *lines, "", ""])
    path.write_bytes(text.encode() + pixels)
    return path


DIRECTIONS = "space directions: (0.015,0,0) (0,0.004,0) (0,0,1)"


@pytest.mark.parametrize(
    ("lines", "sizes_m"),
    [
        (("spacings: 15 4 1", 'units: "um" "um" ""'), SIZES_M),
        (("spacings: 0.015 4 1", 'units: "mm" "um" ""'), SIZES_M),
        (("spacings: 0.015 4 1", 'units: "mm" "" ""'), (None, 15e-6)),
        (("spacings: 15 4 1",), NO_SIZES),
        (("space: LPS", DIRECTIONS), SIZES_M),
        (("space: left-posterior-superior", DIRECTIONS), SIZES_M),
        (("space: right-anterior-superior", DIRECTIONS), SIZES_M),
        (("space: 3D-right-handed", DIRECTIONS), NO_SIZES),  # not anatomical
        (
            (
                "space dimension: 3",
                'space units: "um" "um" "um"',
                "space directions: (0,15,0) (4,0,0) (0,0,1)",
            ),
            SIZES_M,
        ),
    ],
)
def test_an_nrrd_has_a_spacing_where_its_unit_is_known(tmp_path, lines, sizes_m):
    path = nhdr(tmp_path / "a.nrrd", *lines)
    check_scan(read_nrrd(path, IJK), FRAMES, sizes_m)
    named = nhdr(tmp_path / "b.nrrd", *lines, 'labels: "lateral" "depth" "frame"')
    check_scan(read_nrrd(named, None), FRAMES, sizes_m)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            (
                "space dimension: 3",
                'space units: "um" "mm" "mm"',
                "space directions: (1,0.015,0) (4,0,0) (0,0,1)",
            ),
            "space units: mm and um; give all directions in one",
        ),
        (("kinds: vector domain domain",), "kinds: axis 1 of 40 is 'vector'"),
        (("kinds: domain domain RGB-color",), "kinds: axis 3 of 5 is 'RGB-color'"),
        (("data file: LIST",), "data file: LIST"),
        (("data file: a%03d.raw 1 5 1",), "data file: a%03d.raw"),
        (("data file: gone.raw",), r"gone\.raw: No such file"),
        (("data file: /etc/passwd",), "its pixels are said to be in '/etc/passwd'"),
        (("data file: ../b.raw",), r"its pixels are said to be in '\.\./b.raw'"),
        (("encoding: hex",), "hex"),
        (("sizes: 40 24 4",), "Size of the data"),
        (("UltrasoundImageOrientation:=MN",), "UltrasoundImageOrientation = MN"),
    ],
)
def test_what_an_nrrd_contradicts_or_what_is_not_read_is_refused(
    tmp_path, lines, message
):
    with pytest.raises(FrameError, match=f"a.nrrd: .*{message}|^.*{message}"):
        read_nrrd(nhdr(tmp_path / "a.nrrd", *lines), IJK)


@pytest.mark.parametrize(
    ("skip", "before"),
    [
        ("byte skip: 12", b"x" * 12),
        ("byte skip: -1", b"x" * 12),
        ("line skip: 2", b"two..\nlines\n"),
    ],
)
@pytest.mark.parametrize(
    ("order", "pixels"), [("little", FRAMES.tobytes()), ("big", BIG)]
)
def test_pixels_of_an_nrrd_behind_a_skip_and_of_either_order_are_found(
    tmp_path, skip, before, order, pixels
):
    lines = ("data file: a.raw", skip, f"endian: {order}")
    path = nhdr(tmp_path / "a.nhdr", *lines, pixels=b"")
    (tmp_path / "a.raw").write_bytes(before + pixels)
    check_scan(read_nrrd(path, IJK))


# ---- MetaImage


def mha(path, pixels=PIXELS, **fields):
    """Write a MetaImage of FRAMES; a field of None is left out."""
    usual = {
        "ObjectType": "Image",
        "NDims": 3,
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "DimSize": f"{COLUMNS} {ROWS} {COUNT}",
        "ElementSpacing": SPACING,
        "ElementType": "MET_USHORT",
    }
    beside = fields.pop("ElementDataFile", None)
    stated = {**usual, **fields, "ElementDataFile": beside or "LOCAL"}
    lines = [
        f"{name} = {value}\n" for name, value in stated.items() if value is not None
    ]
    path.write_bytes("".join(lines).encode() + (b"" if beside else pixels))
    if beside and pixels:
        path.with_name(beside).write_bytes(pixels)
    return path


TEXT = " ".join(map(str, FRAMES.ravel().tolist())).encode()


@pytest.mark.parametrize(
    ("pixels", "fields"),
    [
        (PIXELS, {}),
        (PIXELS, {"BinaryData": None}),
        (PIXELS, {"BinaryData": "T"}),
        (TEXT, {"BinaryData": "False"}),
        (TEXT, {"BinaryData": "False", "ElementDataFile": "a.txt"}),
        (BIG, {"BinaryDataByteOrderMSB": "True"}),
        (BIG, {"BinaryDataByteOrderMSB": None, "ElementByteOrderMSB": "True"}),
        (b"x" * 100 + PIXELS, {"HeaderSize": -1, "ElementDataFile": "a.raw"}),
        (b"x" * 100 + PIXELS, {"HeaderSize": 100, "ElementDataFile": "a.raw"}),
        (FRAMES.astype("<i4").tobytes(), {"ElementType": "MET_LONG"}),
        (FRAMES.astype("<u8").tobytes(), {"ElementType": "MET_ULONG_LONG"}),
        (
            zlib.compress(BIG),
            {"CompressedData": "True", "BinaryDataByteOrderMSB": "True"},
        ),
        (
            zlib.compress(PIXELS),
            {"CompressedData": "True", "ElementDataFile": "a.zraw"},
        ),
    ],
    ids=range(13),
)
def test_the_storage_that_a_metaimage_states_is_read(tmp_path, pixels, fields):
    scan = read_metaimage(mha(tmp_path / "a.mhd", pixels, **fields), IJK)
    check_scan(scan, FRAMES, SIZES_M)
    assert scan.notes == ()


@pytest.mark.parametrize("packed", [False, True])
def test_a_metaimage_of_another_program_is_read(tmp_path, packed):
    spacing = [0.015, 0.004, 0.1]
    path = tmp_path / "a.mha"
    metaimageio.write(path, FRAMES, ElementSpacing=spacing, CompressedData=packed)
    check_scan(read_metaimage(path, IJK), FRAMES, SIZES_M)


@pytest.mark.parametrize(
    ("pixels", "fields", "message"),
    [
        (
            b"x" + PIXELS,
            {"ElementDataFile": "a.raw"},
            r"a\.raw has 9601 bytes .* take 9600",
        ),
        (
            PIXELS,
            {"DimSize": "40 24 4"},
            "9600 bytes of pixels; DimSize = 40 24 4 .* take 7680",
        ),
        (PIXELS, {"DimSize": "40 24"}, "9600 bytes of pixels; DimSize = 40 24 of"),
        (PIXELS, {"DimSize": None}, "its header has no DimSize"),
        (PIXELS, {"ElementSpacing": "1 2"}, "ElementSpacing has 2 numbers"),
        (PIXELS, {"HeaderSize": 100}, r"a\.mhd has 9500 bytes .* \(HeaderSize = 100\)"),
        (
            PIXELS,
            {"ElementByteOrderMSB": "True"},
            "BinaryDataByteOrderMSB and ElementByteOrderMSB contradict",
        ),
        (PIXELS, {"ElementNumberOfChannels": 3}, "ElementNumberOfChannels = 3"),
        (PIXELS, {"ElementType": "MET_USHORT_ARRAY"}, "ElementType = MET_USHORT_ARRAY"),
        (b"", {"ElementDataFile": "LIST"}, "ElementDataFile = LIST"),
        (
            b"",
            {"ElementDataFile": "a%03d.raw 1 5 1"},
            "ElementDataFile = a%03d.raw 1 5 1",
        ),
        (b"", {"ElementDataFile": "gone.raw"}, r"gone\.raw: No such file"),
        (
            b"",
            {"ElementDataFile": "/etc/passwd"},
            "its pixels are said to be in '/etc/passwd'",
        ),
        (
            PIXELS,
            {"TransformMatrix": "0.5 0 0 0 1 0 0 0 1"},
            "TransformMatrix has directions of length 0.5 x 1 x 1",
        ),
        (
            PIXELS,
            {"elementspacing": "1 2 3"},
            f"elementspacing is stated twice: '{SPACING}' and '1 2 3'",
        ),
        (
            TEXT.replace(b" 77 ", b" 70000 "),
            {"BinaryData": "False"},
            "70000 out of bounds for uint16",
        ),
        (TEXT.replace(b" 77 ", b" 7.5 "), {"BinaryData": "False"}, "invalid .*7.5"),
        (
            PIXELS,
            {"UltrasoundImageOrientation": "MN"},
            "UltrasoundImageOrientation = MN",
        ),
        (
            PIXELS,
            {"UltrasoundImageOrientation": "FM"},
            "UltrasoundImageOrientation = FM: depth is axis 1",
        ),
    ],
    ids=range(19),
)
def test_what_a_metaimage_contradicts_or_what_is_not_read_is_refused_by_name(
    tmp_path, pixels, fields, message
):
    with pytest.raises(FrameError, match=message):
        read_metaimage(mha(tmp_path / "a.mhd", pixels, **fields), IJK)


@pytest.mark.parametrize(
    ("fields", "depth_m", "notes"),
    [
        ({"ElementSpacing": None}, None, 0),
        ({"ElementSpacing": "1 1 1"}, None, 0),
        ({"ElementSpacing": None, "ElementSize": SPACING}, 4e-6, 0),
        ({"ElementSize": SPACING}, 4e-6, 0),
        ({"BinaryDataByteOrderMSB": None}, 4e-6, 1),
        ({"UltrasoundImageOrientation": "UNKNOWN"}, 4e-6, 1),
    ],
)
def test_what_a_metaimage_does_not_state_stays_open_or_is_noted(
    tmp_path, fields, depth_m, notes
):
    scan = read_metaimage(mha(tmp_path / "a.mha", **fields), IJK)
    assert sizes_of(scan)[0] == (depth_m and pytest.approx(depth_m))
    assert len(scan.notes) == notes


PLUS = plus_fields([10.0, 10.25, 0.0, 11.0, 12.0], ["OK", "OK", "INVALID", "OK", "OK"])


def test_a_sequence_of_plus_has_its_own_times_and_leaves_out_invalid_frames(tmp_path):
    lines = [f"{name}:={value}" for name, value in PLUS.items()]
    for scan in (
        read_metaimage(mha(tmp_path / "a.mha", **PLUS), IJK),
        read_nrrd(nhdr(tmp_path / "a.nrrd", *lines), IJK),
    ):
        check_scan(scan, FRAMES[[0, 1, 3, 4]], time_s=[10.0, 10.25, 11.0, 12.0])
        assert any("frames 2 (from 0) are left out" in note for note in scan.notes)


def test_times_of_plus_that_do_not_rise_are_named(tmp_path):
    falling = plus_fields([1, 2, 3, 2.5, 4])
    scan = read_metaimage(mha(tmp_path / "a.mha", **falling), IJK)
    assert scan.times is None
    assert "does not rise: 3 (frame 2) and 2.5 (frame 3)" in scan.times_fault


@pytest.mark.parametrize(
    ("axes", "states", "message"),
    [
        (
            ("frame", "depth", "lateral"),
            ["OK"] * COUNT,
            "Seq_FrameNNNN_Timestamp of 5 frames, 0 to 4, .* has 40",
        ),
        (IJK, ["INVALID"] * COUNT, "ImageStatus = INVALID for all 5 frames"),
    ],
)
def test_a_sequence_of_plus_that_does_not_fit_is_refused(
    tmp_path, axes, states, message
):
    fields = plus_fields(range(COUNT), states) | {"UltrasoundImageOrientation": None}
    with pytest.raises(FrameError, match=message):
        read_metaimage(mha(tmp_path / "a.mha", **fields), axes)


# ---- all of them


def test_more_packed_in_a_file_than_its_header_says_is_not_unpacked(tmp_path):
    packed = zlib.compress(bytes(2**26))
    fields = {"CompressedData": "True", "CompressedDataSize": len(packed)}
    nhdr(tmp_path / "a.nrrd", "encoding: gzip", pixels=packed)
    mha(tmp_path / "a.mha", packed, **fields)
    for read, name in [(read_nrrd, "a.nrrd"), (read_metaimage, "a.mha")]:
        with less_than(2**25), pytest.raises(FrameError, match="more is packed in it"):
            read(tmp_path / name, IJK)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes")
@pytest.mark.parametrize("named", [os.mkfifo, lambda path: path.symlink_to("pipe")])
def test_a_pipe_beside_a_header_is_refused_and_not_waited_for(tmp_path, named):
    """Also behind a link; nothing ever writes to it."""
    os.mkfifo(tmp_path / "pipe")
    for data in ("a.raw", "a.img"):
        named(tmp_path / data)

    mha(tmp_path / "a.mhd", b"", ElementDataFile="a.raw")
    nhdr(tmp_path / "a.nhdr", "data file: a.raw", pixels=b"")
    (tmp_path / "a.hdr").write_bytes(b"\x5c\x01" + bytes(342) + b"ni1\0")
    axes = ImportOptions(axes=",".join(IJK))
    for name in ("a.mhd", "a.nhdr", "a.hdr", "a.raw"):
        with pytest.raises(InputError, match="a named pipe; give a regular file"):
            gather_sources([tmp_path / name], axes)


# ---- Thorlabs' .oct, as Thorlabs' own MATLAB functions read it: no real file could be
# had.

INTENSITY = FRAMES.astype(np.float32) / 100.0 - 20.0  # dB
RAW = '<DataFile Type="Raw">data\\Spectral0.data</DataFile>'


@pytest.mark.parametrize(
    ("name", "header", "frames"),
    [
        ("data\\Intensity.data", RAW + oct_entry(), INTENSITY),
        ("data/Intensity.data", oct_entry(), INTENSITY),
        # one B-scan has no third size
        (
            "data/Intensity.data",
            oct_entry(count=1).replace(' SizeY="1"', ""),
            INTENSITY[:1],
        ),
    ],
)
def test_the_intensity_comes_back_with_its_scale(tmp_path, name, header, frames):
    path = write_oct(tmp_path / "a.oct", header, frames, name)
    assert source_kind(path) == "thorlabs"
    check_scan(read_thorlabs(path), frames, SIZES_M)


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (oct_entry(rows=ROWS + 1), "the header says 25 x 40 x 5 floats"),
        (oct_entry(rows=10**7), "a frame may have"),
        (oct_entry(count=0), "the header says 24 x 40 x 0 floats"),
        (oct_entry("data\\Spectral0.data"), "no processed intensity"),
        (2 * oct_entry(), "2 files of intensity"),
        (oct_entry().replace(f'SizeZ="{ROWS}"', ""), "has no SizeZ"),
        (oct_entry().replace(f'SizeX="{COLUMNS}"', ""), "has no SizeX"),
        (oct_entry().replace('Pixel="4"', 'Pixel="2"'), "BytesPerPixel = 2"),
        ("<DataFile>", "damaged or an unknown kind of Thorlabs"),
        ('<!DOCTYPE a [<!ENTITY b "c">]>' + oct_entry(), "defines entities"),
    ],
    ids=range(10),
)
def test_an_oct_that_does_not_fit_is_refused(tmp_path, header, message):
    with pytest.raises(FrameError, match=message):
        read_thorlabs(write_oct(tmp_path / "a.oct", header, INTENSITY))


TWO_ZS = f"{oct_entry()}<Image><SizeReal><SizeZ>0.192</SizeZ></SizeReal></Image>"


@pytest.mark.parametrize(
    ("read", "write", "first", "second"),
    [
        (
            partial(read_nifti, axes=IJK),
            partial(nifti, sform=(0.015, 0.008, 0.1)),
            "pixdim",
            "sform",
        ),
        (
            partial(read_nrrd, axes=IJK),
            lambda path: nhdr(
                path, "space: LPS", DIRECTIONS, "spacings: 0.015 0.008 1"
            ),
            "directions",
            "spacings",
        ),
        (
            partial(read_metaimage, axes=IJK),
            partial(mha, ElementSize="0.015 0.008 0.1"),
            "ElementSpacing",
            "ElementSize",
        ),
        (read_thorlabs, partial(write_oct, header=TWO_ZS), "Range.*", "SizeReal"),
    ],
)
def test_two_scales_are_named_and_give_none(tmp_path, read, write, first, second):
    suffix = ".nii" if first == "pixdim" else ".a"
    scan = read(write(tmp_path / f"a{suffix}"))
    states = rf"{first} states .* 0\.004 x 0\.015 mm .*{second} states .* 0\.008 x "
    assert re.search(states, scan.scale_fault)
    assert sizes_of(scan) == NO_SIZES
