"""The kinds of sources, sources together, the axes of arrays, and pixels as counts."""

import json
import os
from dataclasses import replace
from functools import partial
from itertools import permutations
from pathlib import Path
from tempfile import mkdtemp

import cv2
import numpy as np
import pytest
import tifffile
from foreign_files import (
    COLUMNS,
    FRAMES,
    ROWS,
    pictures_of,
    write_dicom,
    write_log,
    write_oct,
)
from pydicom.uid import RLELossless
from ros_bag import write_bag
from small_recordings import write_small_recording

from scleraforce.base.errors import FrameError, InputError, RecordingError
from scleraforce.recordings.formats import picture_streams
from scleraforce.recordings.formats.picture_streams import (
    AXES,
    FrameTimes,
    PictureSource,
    PixelSize,
    UnansweredError,
)
from scleraforce.recordings.import_answers import given_times, read_like
from scleraforce.recordings.import_sources import (
    ImportOptions,
    gather_sources,
    on_one_clock,
    read_scan,
    source_kind,
)
from scleraforce.recordings.source_files import files_of

nibabel = pytest.importorskip("nibabel")
nrrd = pytest.importorskip("nrrd")
metaimageio = pytest.importorskip("metaimageio")


def write_rle(path: Path) -> None:
    dataset = write_dicom(path, FRAMES)
    dataset.compress(RLELossless)
    dataset.save_as(path)


def write_lone_bag(path: Path) -> None:
    kind = {".db3": "sqlite", ".mcap": "mcap"}[path.suffix]
    next(write_bag(path.parent / "bag", kind).glob(f"*{path.suffix}")).rename(path)


WRITERS = {
    "a.png": lambda path: cv2.imwrite(str(path), FRAMES[0]),
    "a.tif": lambda path: tifffile.imwrite(
        path, FRAMES, photometric="minisblack", compression="zlib"
    ),
    "i.tif": lambda path: tifffile.imwrite(
        path, FRAMES, imagej=True, metadata={"axes": "TYX", "finterval": 1}
    ),
    "o.ome.tif": lambda path: tifffile.imwrite(
        path, FRAMES, metadata={"axes": "TYX", "PhysicalSizeX": 1.0}
    ),
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
    "a.oct": write_oct,
    "log.csv": write_log,
}


def test_each_kind_is_recognised(tmp_path):
    known = {
        "png": "picture",
        "tif": "tiff",
        "dcm": "dicom",
        "npy": "numpy",
        "npz": "numpy",
        "nii": "nifti",
        "gz": "nifti",
        "nrrd": "nrrd",
        "mha": "metaimage",
        "oct": "thorlabs",
        "csv": "log",
    }
    for name, write in WRITERS.items():
        place = Path(mkdtemp(dir=tmp_path))
        kind = known.get(name.rpartition(".")[2], "bag")
        write(place / name)
        assert source_kind(place / name) == kind

        if kind in ("picture", "tiff", "dicom", "bag"):  # by its content
            assert source_kind((place / name).rename(place / "a")) == kind

    write_dicom(tmp_path / "d", FRAMES)
    # as a TIFF begins
    (tmp_path / "d").write_bytes(
        b"II*\0".ljust(128, b"\0") + (tmp_path / "d").read_bytes()[128:]
    )
    assert source_kind(tmp_path / "d") == "dicom"
    (tmp_path / "film").write_bytes(b"\0\0\0\x18ftypmp42")
    (tmp_path / "log.lvm").write_text("LabVIEW Measurement\t\n")
    assert [source_kind(tmp_path / name) for name in ("film", "log.lvm")] == [
        "film",
        "log",
    ]
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    assert source_kind(tmp_path) == "bag"


def test_a_file_that_is_not_read_is_named_with_a_remedy_or_the_kinds_that_are(
    tmp_path,
):
    for name, content, what, way in [
        ("a.hdr", (348).to_bytes(4, "little") + bytes(344), "Analyze 7.5", "NIfTI"),
        ("a.hdr", (348).to_bytes(4, "big") + bytes(344), "Analyze 7.5", "NIfTI"),
        ("a.img", bytes(1000), "Zeiss Cirrus", "vendor_frames"),
        ("a.oct", b"\x01\x02" * 100, "Bioptigen, Optopol", "vendor_frames"),
        ("a.E2E", b"CMDb" + bytes(100), "Heidelberg", "vendor_frames"),
        (
            "a.vol",
            b"HSF-OCT-103" + bytes(100),
            "Heidelberg raw export",
            "TIFF or DICOM",
        ),
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
        *(
            (name, content, "", "give PNG, JPEG, TIFF, DICOM")
            for name, content in (("a.bin", b"hello"), ("a.csv", b""), ("a.nii", b""))
        ),
    ]:
        place = Path(mkdtemp(dir=tmp_path))
        (place / name).write_bytes(content)
        with pytest.raises(InputError, match=f"{name}: .*{what}.*; .*{way}") as caught:
            source_kind(place / name)

        assert "\n" not in str(caught.value)

    os.mkfifo(tmp_path / "pipe")
    for name, message in [
        ("pipe", "pipe: a named pipe"),
        ("gone", "gone: No such file"),
    ]:
        with pytest.raises(InputError, match=message):
            source_kind(tmp_path / name)


def test_pixels_beside_their_header_are_read_once(tmp_path):
    for folder in [True, False]:
        nibabel.save(nibabel.Nifti1Pair(FRAMES.T, np.eye(4)), tmp_path / "a.hdr")
        for name in ("b.mhd", "b.raw", "c.nhdr", "c.raw.gz", "d.raw"):
            (tmp_path / name).touch()

        given = [tmp_path] if folder else sorted(tmp_path.iterdir())
        assert [path.name for path in files_of(given)] == [
            "a.hdr",
            "b.mhd",
            "c.nhdr",
            "d.raw",
        ]
        assert (
            source_kind(tmp_path / "a.img")
            == source_kind(tmp_path / "a.hdr")
            == "nifti"
        )

        for name in ("a.hdr", "a.img"):
            scan = read_scan(tmp_path / name, "nifti", ("lateral", "depth", "frame"))
            np.testing.assert_array_equal(pictures_of(scan), FRAMES)


def test_pictures_are_turned_where_their_columns_are_depth(tmp_path):
    cv2.imwrite(str(tmp_path / "a.png"), FRAMES[0])
    for axes, expected in (
        (("frame", "lateral", "depth"), FRAMES[0].T),
        (("depth", "lateral"), FRAMES[0]),
    ):
        scan = read_scan(tmp_path / "a.png", "picture", axes)
        np.testing.assert_array_equal(pictures_of(scan)[0], expected)

    with pytest.raises(InputError, match="begin with frame"):
        read_scan(tmp_path / "a.png", "picture", ("lateral", "frame", "depth"))


def test_pictures_of_a_folder_are_one_scan_in_the_order_of_their_numbers(
    tmp_path,
):
    for nth, frame in enumerate(FRAMES):
        cv2.imwrite(str(tmp_path / f"f{8 + nth}.png"), frame)

    given = sorted(tmp_path.iterdir())
    (tmp_path / ".hidden").touch()
    found = gather_sources([tmp_path], ImportOptions())
    np.testing.assert_array_equal(pictures_of(found.scan), FRAMES)
    assert found.notes == ()
    note = (
        "frames are taken in the order given, f10.png to f9.png; their numbers have"
        " another"
    )
    assert gather_sources(given, ImportOptions(frames_by="order")).notes == (note,)


def test_sources_without_frames_with_two_logs_or_a_stopped_clock_are_refused(
    tmp_path,
):
    write_log(tmp_path / "a.csv")
    write_log(tmp_path / "b.csv")
    tifffile.imwrite(tmp_path / "a.tif", FRAMES)
    (tmp_path / "empty").mkdir()

    for names, message in [
        (("a.csv",), r"a\.csv: no frames in the sources"),
        (("a.tif", "a.csv", "b.csv"), r"b\.csv: a second force log beside .*a\.csv"),
        (("empty",), "empty: no files in this folder"),
    ]:
        with pytest.raises(InputError, match=message):
            gather_sources([tmp_path / name for name in names], ImportOptions())

    with pytest.raises(InputError, match="do not rise"):
        on_one_clock(FrameTimes(np.array([0.0, 0.0]), "tag"), None, 0.0)


def test_answers_on_the_form_of_sources_are_kept_and_answers_of_one_session_are_not(
    tmp_path,
):
    folder = write_small_recording(tmp_path / "r", log=False)
    answers = {
        "axes": "frame,depth,lateral",
        "columns": ["fz=F:N"],
        "rate_hz": 4.0,
        "clock_offset_s": 3.0,
    }
    (folder / "import.json").write_text(json.dumps({"answers": answers}))
    found = read_like(folder).answers
    assert (found["axes"], found["columns"]) == ("frame,depth,lateral", ("fz=F:N",))
    assert not {"rate_hz", "clock_offset_s", "axis"} & set(found)

    for text in ["", "[]", '{"answers": NaN}', '{"answers": 7}']:
        (folder / "import.json").write_text(text)
        with pytest.raises(RecordingError, match=r"import\.json: "):
            read_like(folder)


def test_a_table_of_times_goes_by_the_names_of_frames_or_else_by_their_order(
    tmp_path,
):
    table = tmp_path / "times.csv"
    scan = PictureSource(("x/b.png", "x/a.png"), 2, 2, lambda: iter(()))

    for text, time_s in [
        ("file,time_s\na.png,7\nb.png,5\nother.png,9\n", [5.0, 7.0]),
        ("Time (ms)\n250\n500\n", [0.25, 0.5]),
    ]:
        table.write_text(text)
        assert given_times(scan, table, None).time_s.tolist() == time_s

    for text, rate_hz, message in [
        ("time_s\n1\n2\n3\n", None, "3 times for 2 frames"),
        (
            "file,time_s\nb.png,1\nd.png,2\n",
            None,
            r"times\.csv: file: no row for x/a\.png; there are b\.png, d\.png",
        ),
        (
            "frame,when\na.png,1\n",
            None,
            "no column of times with its unit.*'frame', 'when'",
        ),
        ("time_s\n1\nx\n", None, r"times\.csv:3: time_s: 'x' is not a number"),
        ("time_s\n1\n2\n", 4.0, "`rate_hz`"),
    ]:
        table.write_text(text)
        with pytest.raises(InputError, match=message):
            given_times(scan, table, rate_hz)


VOLUMES = ImportOptions(axes="lateral,depth,frame")
HEAD_BYTES = 600  # most faults are there


def damaged(data: bytes, rng: np.random.Generator, nth: int) -> bytes:
    """Cut it off, or change up to seven bytes anywhere, or in its head."""
    if nth % 3 == 0:
        return data[: rng.integers(len(data))]

    changed = bytearray(data)
    for at in rng.integers(
        0, len(data) if nth % 3 == 1 else min(len(data), HEAD_BYTES), rng.integers(1, 8)
    ):
        changed[at] = rng.integers(256)

    return bytes(changed)


@pytest.mark.filterwarnings("ignore")
def test_damage_is_an_error_that_names_the_file(tmp_path, capfd):
    for name in WRITERS:
        place = Path(mkdtemp(dir=tmp_path))
        WRITERS[name](place / name)
        data = (place / name).read_bytes()
        np.save(place / "frames.npy", FRAMES)
        sources = [place / name, *([place / "frames.npy"] if name == "log.csv" else [])]
        named = name.endswith((".npy", ".npz", ".nii", ".gz", ".nrrd", ".mha", ".csv"))
        rng = np.random.default_rng(len(name))
        said = []

        for nth in range(15):
            (place / name).write_bytes(damaged(data, rng, nth))
            try:
                for picture in gather_sources(
                    sources, VOLUMES if named else ImportOptions()
                ).scan.pictures():
                    assert picture.size
            except InputError as fault:
                said.append(str(fault))

        assert said
        assert all(name in line and "\n" not in line for line in said)
        capfd.readouterr()  # codecs print what they think of it


def single(nth: int, time_s: float | None = None, **stated: object) -> PictureSource:
    times = None if time_s is None else FrameTimes(np.array([time_s]), "its tag")
    pictures = lambda: iter(FRAMES[nth : nth + 1])  # noqa: E731
    return PictureSource(
        names=(f"{nth}.png",),
        rows=ROWS,
        columns=COLUMNS,
        pictures=pictures,
        times=times,
        **stated,
    )


def test_files_come_in_the_order_of_their_times_or_else_as_given():
    scan = picture_streams.joined_files(
        [single(2, 7.0), single(0, 3.0), single(1, 5.0)]
    )
    assert scan.names == ("0.png", "1.png", "2.png")
    np.testing.assert_array_equal(scan.times.time_s, [3.0, 5.0, 7.0])
    for _ in range(2):  # pictures can be read twice
        np.testing.assert_array_equal(pictures_of(scan), FRAMES[:3])

    for times in [(1.0, None), (1.0, 1.0), (None, None)]:
        scan = picture_streams.joined_files([single(4, times[0]), single(0, times[1])])
        assert (scan.names, scan.times) == (("4.png", "0.png"), None)


def test_files_of_another_kind_are_refused_with_both_values():
    for other, found in [
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
    ]:
        with pytest.raises(FrameError, match=rf"1\.png: {found}"):
            picture_streams.joined_files([single(0), replace(single(1), **other)])

    assert (
        picture_streams.joined_files(
            [single(0), replace(single(1), scale_fault="a fault")]
        ).scale_fault
        == "a fault"
    )


def test_frames_that_a_file_does_not_state_are_damage():
    for pictures, message in [
        ([], "damaged: 0 of 1 frames can be read"),
        ([FRAMES[0], FRAMES[1]], r"damaged: a frame of \(24, 40\) uint16, number 2"),
        ([FRAMES[0].T], r"damaged: a frame of \(40, 24\) uint16, number 1"),
    ]:
        scan = picture_streams.joined_files(
            [replace(single(0), pictures=partial(iter, pictures))]
        )
        with pytest.raises(FrameError, match=rf"0\.png: {message}"):
            list(scan.pictures())


def test_any_order_of_the_axes_gives_the_same_frames_and_scale():
    for order in list(permutations(AXES)):
        # an axis of one: no axis
        array = np.transpose(FRAMES, [AXES.index(name) for name in order])[
            :, np.newaxis
        ]
        steps_m = {"frame": 9.0, "depth": 1e-6, "lateral": 2e-6}
        first, *others = (steps_m[name] for name in order)
        scan = picture_streams.array_scan(
            Path("a.npy"), array, order, [((first, None, *others), "a field")]
        )
        np.testing.assert_array_equal(pictures_of(scan), FRAMES)
        assert scan.size == PixelSize("a field", depth_m=1e-6, lateral_m=2e-6)


def test_axes_that_are_open_or_do_not_fit_are_refused_with_the_sizes():
    for array, axes, kind, message in [
        (
            FRAMES,
            None,
            UnansweredError,
            r"^an array of 5 x 24 x 40: which axis.*; give `axes`",
        ),
        *(
            (np.zeros(shape), AXES, FrameError, "give frames x rows x columns")
            for shape in ((5,), (2, 3, 4, 5), ())
        ),
        (
            FRAMES,
            AXES[1:],
            FrameError,
            r"`axes` names 2 axes \(depth,lateral\); the array is of 5 x 24 x 40",
        ),
    ]:
        with pytest.raises(kind, match=message):
            picture_streams.array_scan(Path("a.npy"), array, axes)

    for text in ["x,y,z", "frame", "frame,depth", "depth,depth,lateral", ""]:
        with pytest.raises(InputError, match="`axes`"):
            picture_streams.parse_axes(text)


RAMP = np.arange(12).reshape(3, 4)


def test_pixels_of_any_type_become_counts_by_one_map_of_all_frames():
    small = np.array([[0, 10, 20, 30]], dtype=np.uint8)
    for pictures, given, counts, scaled, lost in [
        *(
            ([(RAMP * 20).astype(kind)], None, [RAMP * 20], False, 0)
            for kind in ("u1", "u2", ">u2", "i2", "i4", "u8")
        ),
        ([(RAMP * 20).T], None, [RAMP.T * 20], False, 0),
        (
            [(RAMP - 7).astype(np.int16), (RAMP + 100).astype(np.int16)],
            None,
            [RAMP, RAMP + 107],
            False,
            0,
        ),
        (
            [np.array([[-20.0, 0.0]]), np.array([[30.0, 5.0]])],
            None,
            [[[0, 26214]], [[65535, 32768]]],
            True,
            0,
        ),
        ([small], (10.0, 20.0), [[[0, 0, 65535, 65535]]], True, 0),
        ([np.array([[0, 2**20]], dtype=np.int32)], None, [[[0, 65535]]], True, 0),
        (
            [np.array([[np.nan, 1.0, 3.0, -np.inf]])],
            None,
            [[[0, 0, 65535, 0]]],
            True,
            2,
        ),
    ]:
        greys = picture_streams.find_greys(pictures, given, "a")
        assert (greys.scaled, greys.lost) == (scaled, lost)

        for picture, expected in zip(pictures, counts, strict=True):
            found = greys.counts(picture)
            np.testing.assert_array_equal(found, expected)
            assert found.dtype == np.uint16
            assert found.flags.c_contiguous


def test_a_range_or_pixels_without_a_difference_are_refused():
    for picture, given, message in [
        *(
            (RAMP, given, "`grey_range`")
            for given in ((5.0, 5.0), (6.0, 5.0), (np.nan, 5.0))
        ),
        *(
            (np.full((2, 2), value), None, r"scan\.tif: ")
            for value in (0.5, np.nan, 1j)
        ),
    ]:
        with pytest.raises(InputError, match=message):
            picture_streams.find_greys([picture], given, "scan.tif")
