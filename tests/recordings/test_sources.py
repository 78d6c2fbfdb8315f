"""The kinds of sources, sources together, and the axes of arrays."""

import json
import os
from dataclasses import replace
from functools import partial
from itertools import permutations

import cv2
import numpy as np
import pytest
import tifffile
from foreign_files import (
    COLUMNS,
    FRAMES,
    ROWS,
    check_scan,
    options_of,
    stack,
    write_dicom,
    write_frames,
    write_log,
    write_oct,
    write_table,
)
from pydicom.uid import RLELossless
from ros_bag import write_bag
from small_recordings import write_small_recording

from scleraforce.base.errors import FrameError, InputError, RecordingError
from scleraforce.front.cli.main import run
from scleraforce.recordings.formats.picture_streams import (
    FrameTimes,
    PictureSource,
    PixelSize,
    UnansweredError,
    joined_files,
    parse_axes,
)
from scleraforce.recordings.import_answers import given_times, read_like
from scleraforce.recordings.import_sources import (
    ImportOptions,
    gather_sources,
    source_kind,
)
from scleraforce.recordings.source_files import files_of

nibabel = pytest.importorskip("nibabel")
nrrd = pytest.importorskip("nrrd")
metaimageio = pytest.importorskip("metaimageio")


def gathered(*sources, **options):
    return gather_sources(sources, ImportOptions(**options))


def write_rle(path):
    dataset = write_dicom(path, FRAMES)
    dataset.compress(RLELossless)
    dataset.save_as(path)


def write_lone_bag(path):
    kind = {".db3": "sqlite", ".mcap": "mcap"}[path.suffix]
    next(write_bag(path.parent / "bag", kind).glob(f"*{path.suffix}")).rename(path)


def write_nifti(path):
    nibabel.save(nibabel.Nifti1Image(FRAMES, np.eye(4)), path)


def write_tiff(path, **options):
    tifffile.imwrite(path, FRAMES, photometric="minisblack", **options)


WRITERS = {
    "a.png": ("picture", lambda path: cv2.imwrite(str(path), FRAMES[0])),
    "a.tif": ("tiff", partial(write_tiff, compression="zlib")),
    "i.tif": ("tiff", partial(write_tiff, imagej=True, metadata={"axes": "TYX"})),
    "o.ome.tif": ("tiff", partial(write_tiff, metadata={"axes": "TYX"})),
    "a.dcm": ("dicom", partial(write_dicom, pixels=FRAMES, FrameTime=4.0)),
    "r.dcm": ("dicom", write_rle),
    "a.npy": ("numpy", lambda path: np.save(path, FRAMES)),
    "a.npz": ("numpy", lambda path: np.savez_compressed(path, FRAMES)),
    "a.nii": ("nifti", write_nifti),
    "a.nii.gz": ("nifti", write_nifti),
    "a.nrrd": ("nrrd", lambda path: nrrd.write(str(path), FRAMES)),
    "a.mha": ("metaimage", lambda path: metaimageio.write(path, FRAMES)),
    "a.bag": ("bag", partial(write_bag, kind="ros1")),
    "a.db3": ("bag", write_lone_bag),
    "a.mcap": ("bag", write_lone_bag),
    "a.oct": ("thorlabs", write_oct),
    "log.csv": ("log", write_log),
}


@pytest.mark.parametrize("name", WRITERS)
def test_each_kind_is_recognised(tmp_path, name):
    kind, write = WRITERS[name]
    write(tmp_path / name)
    assert source_kind(tmp_path / name) == kind
    if kind in ("picture", "tiff", "dicom", "bag"):  # by its content
        assert source_kind((tmp_path / name).rename(tmp_path / "a")) == kind


def test_kinds_are_recognised_by_the_beginnings_of_files(tmp_path):
    write_dicom(tmp_path / "d", FRAMES)
    after = (tmp_path / "d").read_bytes()[128:]
    as_a_tiff_begins = b"II*\0".ljust(128, b"\0")
    (tmp_path / "d").write_bytes(as_a_tiff_begins + after)
    (tmp_path / "film").write_bytes(b"\0\0\0\x18ftypmp42")
    (tmp_path / "log.lvm").write_text("LabVIEW Measurement\t\n")
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    kinds = [source_kind(tmp_path / name) for name in ("d", "film", "log.lvm", ".")]
    assert kinds == ["dicom", "film", "log", "bag"]


ZIP = b"PK\x03\x04"


@pytest.mark.parametrize(
    ("name", "begin", "what", "way"),
    [
        ("a.hdr", (348).to_bytes(4, "little"), "Analyze 7.5", "NIfTI"),
        ("a.img", b"", "Zeiss Cirrus", "vendor_frames"),
        ("a.oct", b"\x01\x02", "Bioptigen, Optopol", "vendor_frames"),
        ("a.E2E", b"CMDb", "Heidelberg", "vendor_frames"),
        ("a.vol", b"HSF-OCT-103", "Heidelberg raw export", "TIFF or DICOM"),
        ("a.fda", b"FOCT", "Topcon", "vendor_frames"),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "HDF5", "h5py"),
        ("a.raw", b"", "raw pixels", "fromfile"),
        ("a.zip", ZIP, "zip archive", "unpack"),
        ("a.xlsx", ZIP, "spreadsheet", ".csv"),
        ("a.csv", ZIP, "zip archive", "unpack"),
        ("a.txt", b"\xd0\xcf\x11\xe0", ".xls", ".csv"),
        ("a.bin", b"hello", "", "give PNG, JPEG, TIFF, DICOM"),
        ("a.csv", None, "", "give PNG, JPEG, TIFF, DICOM"),
        ("a.nii", None, "", "give PNG, JPEG, TIFF, DICOM"),
    ],
)
def test_a_file_that_is_not_read_is_named_with_a_remedy_or_the_kinds_that_are(
    tmp_path, name, begin, what, way
):
    content = b"" if begin is None else begin + bytes(200)
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=f"{name}: .*{what}.*; .*{way}") as caught:
        source_kind(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_what_is_no_regular_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for name, found in (("pipe", "a named pipe"), ("gone", "No such file")):
        with pytest.raises(InputError, match=f"{name}: {found}"):
            source_kind(tmp_path / name)


@pytest.mark.parametrize("of_folder", [True, False])
def test_pixels_beside_their_header_are_read_once(tmp_path, of_folder):
    nibabel.save(nibabel.Nifti1Pair(FRAMES.T, np.eye(4)), tmp_path / "a.hdr")
    for name in ("b.mhd", "b.raw", "c.nhdr", "c.raw.gz", "d.raw"):
        (tmp_path / name).touch()

    given = [tmp_path] if of_folder else sorted(tmp_path.iterdir())
    names = [path.name for path in files_of(given)]
    assert names == ["a.hdr", "b.mhd", "c.nhdr", "d.raw"]
    for name in ("a.hdr", "a.img"):
        assert source_kind(tmp_path / name) == "nifti"
        check_scan(gathered(tmp_path / name, axes="lateral,depth,frame").scan)


def test_pictures_are_turned_where_their_columns_are_depth(tmp_path):
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), FRAMES[0])
    turned = gathered(path, axes="frame,lateral,depth").scan
    check_scan(turned, FRAMES[:1].swapaxes(1, 2))
    check_scan(gathered(path, axes="depth,lateral").scan, FRAMES[:1])
    with pytest.raises(InputError, match="begin with frame"):
        gathered(path, axes="lateral,frame,depth")


def test_pictures_in_another_order_than_their_numbers_are_noted(tmp_path):
    write_frames(tmp_path, "f8.png", "f9.png", "f10.png")
    found = gathered(*sorted(tmp_path.iterdir()), frames_by="order")
    (note,) = found.notes
    assert "in the order given, f10.png to f9.png; their numbers have another" in note


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("a.csv",), r"a\.csv: no frames in the sources"),
        (("a.tif", "a.csv", "b.csv"), r"b\.csv: a second force log beside .*a\.csv"),
        (("empty",), "empty: no files in this folder"),
    ],
)
def test_sources_without_frames_or_with_two_logs_are_refused(tmp_path, names, message):
    write_log(tmp_path / "a.csv")
    write_log(tmp_path / "b.csv")
    write_tiff(tmp_path / "a.tif")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=message):
        gathered(*(tmp_path / name for name in names))


def test_answers_on_the_form_of_sources_are_kept_and_answers_of_one_session_are_not(
    tmp_path,
):
    folder = write_small_recording(tmp_path / "r", log=False)
    kept = {"axes": "frame,depth,lateral", "columns": ["fz=F:N"]}
    of_session = {"rate_hz": 4.0, "clock_offset_s": 3.0}
    answers = {"answers": kept | of_session}
    (folder / "import.json").write_text(json.dumps(answers))
    found = read_like(folder).answers
    assert found["axes"] == "frame,depth,lateral"
    assert found["columns"] == ("fz=F:N",)
    assert not {"rate_hz", "clock_offset_s", "axis"} & set(found)


@pytest.mark.parametrize("text", ["", "[]", '{"answers": NaN}', '{"answers": 7}'])
def test_answers_that_cannot_be_read_are_refused(tmp_path, text):
    folder = write_small_recording(tmp_path / "r", log=False)
    (folder / "import.json").write_text(text)
    with pytest.raises(RecordingError, match=r"import\.json: "):
        read_like(folder)


@pytest.mark.parametrize(
    ("lines", "rate_hz", "message"),
    [
        (("time_s", "1", "2", "3"), None, "3 times for 2 frames"),
        (
            ("frame,when", "a.png,1"),
            None,
            "no column of times with its unit.*'frame', 'when'",
        ),
        (("time_s", "1", "x"), None, r"times\.csv:3: time_s: 'x' is not a number"),
        (("time_s", "1", "2"), 4.0, "`rate_hz`"),
    ],
)
def test_a_table_of_times_that_does_not_fit_is_refused(
    tmp_path, lines, rate_hz, message
):
    scan = PictureSource(("x/b.png", "x/a.png"), 2, 2, lambda: iter(()))
    table = write_table(tmp_path / "times.csv", *lines)
    with pytest.raises(InputError, match=message):
        given_times(scan, table, rate_hz)


def test_times_that_do_not_rise_are_refused(tmp_path, capsys):
    table = write_table(tmp_path / "t.csv", "time_s", "0", "2", "1", "3", "4")
    source = stack(tmp_path / "a.tif")
    options = options_of("--bits", 13, "--times", table, "--out", tmp_path / "r")
    assert run(["import", str(source), *options]) == 2
    assert "times do not rise" in capsys.readouterr().err


HEAD_BYTES = 600  # most faults are there


def damaged(data, rng, nth):
    """Cut it off, or change up to seven bytes anywhere, or in its head."""
    if nth % 3 == 0:
        return data[: rng.integers(len(data))]

    changed = bytearray(data)
    size = len(data) if nth % 3 == 1 else min(len(data), HEAD_BYTES)
    for at in rng.integers(0, size, rng.integers(1, 8)):
        changed[at] = rng.integers(256)
    return bytes(changed)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", WRITERS)
def test_damage_is_an_error_that_names_the_file(tmp_path, name):
    kind, write = WRITERS[name]
    write(tmp_path / name)
    data = (tmp_path / name).read_bytes()
    np.save(tmp_path / "frames.npy", FRAMES)
    sources = [tmp_path / name, *([tmp_path / "frames.npy"] * (kind == "log"))]
    without_axes = kind in ("picture", "tiff", "dicom", "bag", "thorlabs")
    rng = np.random.default_rng(len(name))
    said = []

    for nth in range(15):
        (tmp_path / name).write_bytes(damaged(data, rng, nth))
        try:
            axes = None if without_axes else "lateral,depth,frame"
            for picture in gathered(*sources, axes=axes).scan.pictures():
                assert picture.size
        except InputError as fault:
            said.append(str(fault))

    assert said
    assert all(name in line and "\n" not in line for line in said)


def single(nth, time_s=None, pictures=None, **stated):
    """A file of one frame."""
    shown = FRAMES[nth : nth + 1] if pictures is None else pictures
    times = None if time_s is None else FrameTimes(np.array([time_s]), "its tag")
    whole = PictureSource((f"{nth}.png",), ROWS, COLUMNS, partial(iter, shown))
    return replace(whole, times=times, **stated)


@pytest.mark.parametrize("times", [(1.0, None), (1.0, 1.0), (None, None)])
def test_files_without_times_of_their_own_come_as_given(times):
    scan = joined_files([single(4, times[0]), single(0, times[1])])
    assert (scan.names, scan.times) == (("4.png", "0.png"), None)


@pytest.mark.parametrize(
    ("stated", "found"),
    [
        ({"bits": 8}, "bits 8, where 0.png has not stated"),
        ({"rows": ROWS + 1}, "rows 25, where 0.png has 24"),
        (
            {"size": PixelSize("tag", depth_m=1e-6, lateral_m=None)},
            "depth of a pixel .* 1, where 0.png has not stated",
        ),
        (
            {"size": PixelSize("", depth_m=None, lateral_m=2e-6)},
            "width of a pixel .* 2, where 0.png has not stated",
        ),
    ],
)
def test_files_of_another_kind_are_refused_with_both_values(stated, found):
    with pytest.raises(FrameError, match=rf"1\.png: {found}"):
        joined_files([single(0), single(1, **stated)])


def test_a_fault_of_the_scale_of_one_file_is_that_of_all():
    scan = joined_files([single(0), single(1, scale_fault="a fault")])
    assert scan.scale_fault == "a fault"


@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        ([], "damaged: 0 of 1 frames can be read"),
        (FRAMES[:2], r"damaged: a frame of \(24, 40\) uint16, number 2"),
        ([FRAMES[0].T], r"damaged: a frame of \(40, 24\) uint16, number 1"),
    ],
)
def test_frames_that_a_file_does_not_state_are_damage(pictures, message):
    scan = joined_files([single(0, pictures=pictures)])
    with pytest.raises(FrameError, match=rf"0\.png: {message}"):
        list(scan.pictures())


AXES = ("frame", "depth", "lateral")


@pytest.mark.parametrize("order", [*permutations(AXES)])
def test_any_order_of_the_axes_gives_the_same_frames_and_scale(tmp_path, order):
    places = [AXES.index(name) for name in order]
    steps = np.array([9.0, 4.0, 15.0])[places]
    header = {"spacings": steps, "units": ["um"] * 3}
    nrrd.write(str(tmp_path / "a.nrrd"), FRAMES.transpose(places), header)
    axes = ",".join(order)
    check_scan(gathered(tmp_path / "a.nrrd", axes=axes).scan, FRAMES, (4e-6, 15e-6))
    np.save(tmp_path / "a.npy", FRAMES.transpose(places)[:, np.newaxis])
    check_scan(gathered(tmp_path / "a.npy", axes=axes).scan)  # an axis of one: no axis


@pytest.mark.parametrize(
    ("shape", "axes", "kind", "message"),
    [
        (
            (5, 24, 40),
            None,
            UnansweredError,
            r": an array of 5 x 24 x 40: which axis.*; give `axes`",
        ),
        ((5,), AXES, FrameError, "give frames x rows x columns"),
        ((2, 3, 4, 5), AXES, FrameError, "give frames x rows x columns"),
        ((), AXES, FrameError, "give frames x rows x columns"),
        (
            (5, 24, 40),
            AXES[1:],
            FrameError,
            r"`axes` names 2 axes \(depth,lateral\); the array is of 5 x 24 x 40",
        ),
    ],
)
def test_axes_that_are_open_or_do_not_fit_are_refused_with_the_sizes(
    tmp_path, shape, axes, kind, message
):
    np.save(tmp_path / "a.npy", np.zeros(shape))
    with pytest.raises(kind, match=message):
        gathered(tmp_path / "a.npy", axes=axes and ",".join(axes))


@pytest.mark.parametrize("text", ["x,y,z", "frame,depth", "depth,depth,lateral", ""])
def test_axes_without_a_meaning_are_refused(text):
    with pytest.raises(InputError, match="`axes`"):
        parse_axes(text)
