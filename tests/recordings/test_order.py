"""The order and the times of frames: names, tables, tags of DICOM, axes of TIFF, and
planes of which each lacks another frame.
"""

import unicodedata
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import tifffile
from foreign_files import (
    COUNT,
    FRAMES,
    item,
    numbers_of,
    plus_fields,
    write_dicom,
    write_frames,
    write_log,
    write_table,
)
from pydicom.sequence import Sequence

from scleraforce.base.errors import InputError
from scleraforce.recordings.formats.picture_streams import UnansweredError
from scleraforce.recordings.import_answers import given_times
from scleraforce.recordings.import_sources import ImportOptions, gather_sources
from scleraforce.records.scan import Plane

nrrd = pytest.importorskip("nrrd")

PLANES = (Plane("along", 0.0, 0.0), Plane("across", 0.0, np.pi / 2))
RATE_HZ = 4.0
BY_NUMBERS = {"rate_hz": RATE_HZ, "frames_by": "numbers"}
IN_ORDER = [*range(COUNT)]


def gathered(*sources, planes=(), **options):
    return gather_sources(sources, ImportOptions(**options), planes=planes)


def steps_of(found, table=None, rate_hz=RATE_HZ):
    """Return the times of frames from the first one on."""
    untimed = found.scan.times is None and table is None
    times = given_times(found.scan, table, rate_hz if untimed else None)
    time_s = (times or found.scan.times).time_s
    return np.round(time_s - time_s[0], 6).tolist()


# ---- names of files


@pytest.mark.parametrize(
    "names",
    [
        ("img_0025.png", "img_0026.png", "img_0027.png"),
        ("9998.png", "9999.png", "10000.png"),
        ("img (1).png", "img (2).png", "img (3).png"),
        ("a.png", "b.png", "c.png"),
        ("1_12mN.png", "2_36mN.png", "3_3mN.png"),
        ("1700000000.00.png", "1700000000.25.png", "1700000000.50.png"),
        ("eye7_20260503_001.png", "eye7_20260503_002.png", "eye7_20260503_003.png"),
        ("20260503_000001.png", "20260503_000002.png", "20260503_000003.png"),
        ("20261399_000000.png", "20261399_000001.png", "20261399_000002.png"),
        ("0001_a3f.png", "0002_9bc.png", "0003_77.png"),
        ("9bc-1.png", "77d-2.png", "a3f-3.png"),
        ("s2_f7_t1.png", "s2_f8_t1.png", "s2_f9_t1.png"),
        ("1_s.png", "2_s.png", "3_s.png"),
    ],
)
def test_names_that_count_on_or_say_nothing_are_taken_as_before(tmp_path, names):
    found = gathered(write_frames(tmp_path / "f", *names), rate_hz=RATE_HZ)
    assert numbers_of(found.scan) == [0, 1, 2]
    assert steps_of(found) == [0.0, 0.25, 0.5]
    assert found.notes == ()


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("img_0025.png", "img_0027.png", "img_0028.png"), "img_0027.png follows"),
        (("0010.png", "0010 - Copy.png", "0011.png"), "0010 - Copy.png and 0010.png"),
        (("10.png", "10.1.png", "10.2.png"), "10.1.png and 10.png"),
        (("12mN.png", "36mN.png", "3mN.png"), "12mN.png follows 3mN.png"),
        (
            ("1700000000.00.png", "1700000000.25.png", "1700000000.75.png"),
            "uneven steps",
        ),
        (
            ("1403636579763555584.png", "1403636579863555584.png"),
            "names state times over",
        ),
        (("20260503_142201.png", "20260503_142209.png"), "over 8 s, where 2 frames"),
        (("f_1_t0.0s.png", "f_2_t0.1s.png", "f_3_t0.7s.png"), "uneven steps"),
        (("c1_t001.png", "c1_t002.png", "c2_t001.png"), "several numbers change"),
        (("d1/1.png", "d1/2.png", "d2/1.png"), "several numbers change"),
    ],
)
def test_names_with_gaps_repeats_or_times_are_asked_about(tmp_path, names, words):
    folder = write_frames(tmp_path / "f", *names)
    folders = sorted({(folder / name).parent for name in names})
    with pytest.raises(UnansweredError, match="`frames_by`") as caught:
        gathered(*folders, rate_hz=RATE_HZ)

    said = str(caught.value)
    assert words in said
    assert str(folder) in said
    assert "\n" not in said

    listed = gathered(*folders, rate_hz=RATE_HZ, frames_by="order")
    assert len(listed.scan.names) == len(names)
    assert steps_of(listed)[1] == 1.0 / RATE_HZ


def test_a_missing_number_is_a_missing_frame(tmp_path):
    folder = write_frames(tmp_path / "f", "a9.png", "a12.png", "a10.png")
    found = gathered(folder, **BY_NUMBERS)
    assert numbers_of(found.scan) == [0, 2, 1]
    assert steps_of(found) == [0.0, 0.25, 0.75]
    assert steps_of(gathered(folder, first_frame=2, **BY_NUMBERS)) == [0.0, 0.5]
    write_frames(folder, "b/a09.png")
    with pytest.raises(InputError, match=r"a0?9\.png.* has its number; remove one"):
        gathered(folder, folder / "b", **BY_NUMBERS)


def test_of_several_numbers_the_one_that_never_repeats_counts(tmp_path):
    folder = write_frames(tmp_path / "f", "a1b4.png", "a1b2.png", "a2b9.png")
    assert steps_of(gathered(folder, **BY_NUMBERS)) == [0.0, 0.5, 1.75]


@pytest.mark.parametrize(
    ("names", "by", "steps_s"),
    [
        (("10.png", "10.1.png", "10.25.png"), "times:s", [0.0, 0.1, 0.25]),
        (("0.png", "33.png", "100.png"), "times:ms", [0.0, 0.033, 0.1]),
        (("1700000000.5.png", "1700000002.0.png"), "times", [0.0, 1.5]),
        (("1700000000500.png", "1700000002000.png"), "times", [0.0, 1.5]),
        (("1403636579763555584.png", "1403636579863555584.png"), "times", [0.0, 0.1]),
        (("1700000000_500000000.png", "1700000001_000000000.png"), "times", [0.0, 0.5]),
        (("a_20260503_235959.5.png", "a_20260504_000001.png"), "times", [0.0, 1.5]),
        (
            ("2026-05-03T14-22-01.123.png", "2026-05-03T14-22-02.0.png"),
            "times",
            [0.0, 0.877],
        ),
        (("t12.5s_1.png", "t13.0s_2.png"), "times", [0.0, 0.5]),
        (("t_0050ms.png", "t_0100ms.png", "t_1000ms.png"), "times", [0.0, 0.05, 0.95]),
    ],
)
def test_names_may_be_times(tmp_path, names, by, steps_s):
    found = gathered(write_frames(tmp_path / "f", *names), frames_by=by)
    assert steps_of(found) == steps_s
    assert found.scan.times.source == "the files' names"
    assert numbers_of(found.scan) == [*range(len(names))]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"frames_by": "times"}, "give `frames_by=times:s`"),
        ({"frames_by": "numbers"}, "takes one number in each name"),
        ({"frames_by": "times:parsec"}, "`frames_by`: 'times:parsec'"),
        ({"frames_by": "times:s", "rate_hz": 1.0}, "`rate_hz`: `frames_by=times`"),
        ({"frames_by": "names"}, "`frames_by`: 'names'; give numbers, order, times"),
        ({"frames_by": "numbers:s"}, "'numbers:s'"),
        (
            {"frames_by": "times:s", "times": Path("t.csv")},
            "`frames_by`: times, and `times`",
        ),
    ],
)
def test_times_and_numbers_in_names_that_are_none_are_refused(tmp_path, options, words):
    folder = write_frames(tmp_path / "f", "10.png", "10.1.png")
    with pytest.raises(InputError, match=words):
        gathered(folder, **options)


def test_two_names_of_one_time_are_refused(tmp_path):
    folder = write_frames(tmp_path / "g", "2 s.png", "2.0 s.png")
    with pytest.raises(InputError, match="states the time of"):
        gathered(folder, frames_by="times")


def write_stack(path, frames=FRAMES, **options):
    tifffile.imwrite(path, frames, photometric="minisblack", **options)
    return path


def test_several_stacks_count_as_their_files_do(tmp_path):
    write_stack(tmp_path / "s1.tif", FRAMES[:2])
    write_stack(tmp_path / "s3.tif", FRAMES[2:4])
    with pytest.raises(UnansweredError, match=r"s3\.tif follows s1\.tif"):
        gathered(tmp_path)

    found = gathered(tmp_path, frames_by="numbers")
    assert steps_of(found, rate_hz=1.0) == [0.0, 1.0, 4.0, 5.0]


# ---- tables of times

NAMED = ("12mN.png", "24mN.png", "3mN.png")
TIMES = (5.0, 7.5, 9.25)


def rows(name_of=lambda name: name, times=TIMES):
    return zip(map(name_of, NAMED), times, strict=True)


def by_table(source, header, *lines, **options):
    """Return the numbers and times of frames by a table of times."""
    table = write_table(source.with_name("t.csv"), header, *lines)
    found = gathered(source, times=table, **options)
    return numbers_of(found.scan), steps_of(found, table)


@pytest.fixture
def named(tmp_path):
    """A folder of frames that are named by forces."""
    return write_frames(tmp_path / "f", *NAMED)


@pytest.mark.parametrize(
    ("header", "name_of"),
    [
        ("file,time_s", lambda name: name.removesuffix(".png")),
        ("file,time_s", lambda name: name.replace(".png", ".tif")),
        ("file,time_s", lambda name: f"D:\\scans\\eye1\\{name}"),
        ("file,time_s", lambda name: f"/data/eye1/{name}"),
        ("file,time_s", str.upper),
        ("image_file,time_s", lambda name: name),
        ("Name,Time (s)", lambda name: name.removesuffix(".png")),
        ("Frame File,timestamp [s]", lambda name: name),
        ("what it is,time_s", lambda name: name),
        ("nom,temps (s)", lambda name: f'"{name}"'),
    ],
)
def test_a_table_goes_by_the_names_of_files(named, header, name_of):
    found = by_table(named, header, *rows(name_of))
    assert found == ([0, 1, 2], [0.0, 2.5, 4.25])


def test_a_table_names_a_part_of_the_frames_too(named):
    assert by_table(named, "file,time_s", *rows(), first_frame=2)[0] == [1, 2]


def test_a_table_goes_by_names_in_any_form_of_unicode(tmp_path):
    names = [unicodedata.normalize("NFD", f"prüf_{name}") for name in NAMED]
    folder = write_frames(tmp_path / "f", *names)
    composed = partial(unicodedata.normalize, "NFC")
    lines = rows(lambda name: composed(f"prüf_{name}"))
    assert by_table(folder, "file,time_s", *lines)[0] == [0, 1, 2]


@pytest.mark.parametrize(
    ("header", "time"),
    [
        ("file,time", "2026-05-03T12:00:0{}Z"),
        ("file,timestamp", "2026-05-03 12:00:0{}"),
        ("file,time_s", "12:00:0{}"),
        ("file,Datum", "13.05.2026 12:00:0{}"),
    ],
)
def test_a_table_may_have_dates(named, header, time):
    lines = rows(times=map(time.format, TIMES))
    assert by_table(named, header, *lines)[1] == [0.0, 2.5, 4.25]


@pytest.mark.parametrize(
    ("header", "lines", "words"),
    [
        (
            "file,time_s",
            [*rows(lambda name: name.replace("24", "42"))],
            r"file: no row for .*24mN\.png; there are 12mN\.png, 42mN\.png",
        ),
        (
            "file,time_s",
            [*rows(), ("12mN.png", 8.0)],
            r"12mN\.png is in lines 2 and 5, with two times",
        ),
        ("file,time_s", [*rows(times=(1, 1, 2))], "are both of 1 s"),
        (
            "file,time",
            [*rows(times=["05/06/2026 12:00:01"] * 3)],
            "day or the month",
        ),
    ],
)
def test_a_table_that_does_not_fit_is_refused_with_the_name(
    named, header, lines, words
):
    with pytest.raises(InputError, match=words) as caught:
        by_table(named, header, *lines)
    assert str(named.with_name("t.csv")) in str(caught.value)


def test_rows_without_names_are_asked_about_where_names_are_forces(tmp_path, named):
    lines = ("time_s", "1", "2", "4")
    with pytest.raises(UnansweredError, match=r"has no column of files, and .*3mN"):
        by_table(named, *lines)

    assert by_table(named, *lines, frames_by="order")[1] == [0.0, 1.0, 3.0]
    by_hand = [named / name for name in (NAMED[1], NAMED[0], NAMED[2])]
    table = tmp_path / "t.csv"
    assert steps_of(gathered(*by_hand, times=table), table) == [0.0, 1.0, 3.0]
    counted = write_frames(tmp_path / "g", "f_025.png", "f_029.png", "f_030.png")
    assert by_table(counted, *lines)[1] == [0.0, 1.0, 3.0]


@pytest.mark.parametrize("counts", [(5, 2, 3), (5, 4, 3, 2, 1)])
def test_a_table_may_count_frames(tmp_path, counts):
    folder = write_frames(tmp_path / "f", "im_2.png", "im_3.png", "im_5.png")
    lines = [(n, n / 4) for n in counts]
    assert by_table(folder, "frame,time_s", *lines)[1] == [0, 0.25, 0.75]


def test_a_table_counts_frames_from_zero_or_refuses_the_missing_one(tmp_path):
    onward = write_frames(tmp_path / "g", "im_1.png", "im_2.png", "im_3.png")
    lines = ("frame,time_s", (0, 0), (1, 1), (2, 5))
    assert by_table(onward, *lines)[1] == [0, 1, 5]
    gap = write_frames(tmp_path / "h", "im_1.png", "im_2.png", "im_4.png")
    with pytest.raises(InputError, match=r"no row for .*im_4\.png; .* numbers 0 to 2"):
        by_table(gap, *lines)


@pytest.mark.parametrize(
    ("header", "lines", "numbers"),
    [
        ("time_s", [str(nth) for nth in range(COUNT)], IN_ORDER),
        ("file,time_s", [("a.tif", nth) for nth in range(COUNT)], IN_ORDER),
        ("file,time_s", [(f"other_{n}.png", n) for n in range(COUNT)], IN_ORDER),
        ("frame,time_s", [(4 - nth, nth) for nth in range(COUNT)], IN_ORDER[::-1]),
    ],
)
def test_a_table_of_a_stack_goes_by_its_rows_or_counts_its_pages(
    tmp_path, header, lines, numbers
):
    path = write_stack(tmp_path / "a.tif")
    assert by_table(path, header, *lines) == (numbers, [0, 1, 2, 3, 4])


def test_a_stack_has_as_many_rows_as_frames(tmp_path):
    path = write_stack(tmp_path / "a.tif")
    lines = ("file,time_s", ("a.tif", 1), ("a.tif", 2))
    assert by_table(path, *lines, first_frame=4)[1] == [0, 1]
    write_stack(tmp_path / "b.tif")
    with pytest.raises(InputError, match=r"2 rows for .*a\.tif, which has 5 frames"):
        gathered(path, tmp_path / "b.tif", times=tmp_path / "t.csv")


def test_names_that_imagej_keeps_of_slices_count(tmp_path):
    labels = [f"img_{nth:04d}" for nth in (1, 2, 4, 5, 6)]
    path = tmp_path / "a.tif"
    metadata = {"axes": "TYX", "Labels": labels}
    tifffile.imwrite(path, FRAMES, imagej=True, metadata=metadata)
    with pytest.raises(UnansweredError, match="img_0004 follows img_0002"):
        gathered(path, rate_hz=1.0)

    lines = [(f"{name}.png", 9 - nth) for nth, name in enumerate(labels)]
    assert by_table(path, "file,time_s", *lines) == (IN_ORDER[::-1], [0, 1, 2, 3, 4])


# ---- DICOM


def in_order_of(folder, *tags):
    """Write images whose names are in another order than their tags."""
    for nth, own in enumerate(tags):
        stated = {"SeriesInstanceUID": "1.2.3", **own}
        write_dicom(folder / f"{(7 * nth) % 5}.dcm", FRAMES[nth], **stated)
    return folder


def of_frames(*contents):
    """Return the tag of a file that has this content of each frame."""
    each = [item(FrameContentSequence=Sequence([item(**tags)])) for tags in contents]
    return {"PerFrameFunctionalGroupsSequence": Sequence(each)}


DAY_S = 86400.0
NOON = "20260503120000"


@pytest.mark.parametrize(
    ("tags", "source", "unit_s"),
    [
        (lambda n: {"AcquisitionTime": f"1200{n:02d}.5"}, "AcquisitionTime", 1.0),
        (lambda n: {"ContentTime": f"1200{n:02d}"}, "ContentTime", 1.0),
        (
            lambda n: {"ContentDate": f"202605{n + 1:02d}", "ContentTime": "120000"},
            "ContentTime",
            DAY_S,
        ),
        (
            lambda n: {"AcquisitionDateTime": f"202605031200{n:02d}"},
            "AcquisitionDateTime",
            1.0,
        ),
        (
            lambda n: {"AcquisitionDateTime": NOON, "AcquisitionTime": f"1200{n:02d}"},
            "AcquisitionTime",
            1.0,
        ),
    ],
)
def test_dicom_images_come_in_the_order_of_their_times(tmp_path, tags, source, unit_s):
    found = gathered(in_order_of(tmp_path, *(tags(n * n) for n in range(COUNT))))
    assert numbers_of(found.scan) == IN_ORDER
    assert steps_of(found) == [unit_s * nth * nth for nth in range(COUNT)]
    assert found.scan.times.source == f"DICOM's {source}"
    assert found.notes == ()


@pytest.mark.parametrize("tag", ["InstanceNumber", "TemporalPositionIdentifier"])
def test_dicom_images_come_in_the_order_of_their_numbers(tmp_path, tag):
    folder = in_order_of(tmp_path, *({tag: nth + 1} for nth in range(COUNT)))
    found = gathered(folder, rate_hz=RATE_HZ)
    assert numbers_of(found.scan) == IN_ORDER
    (note,) = found.notes
    assert note.startswith(f"frames are taken in the order of DICOM's {tag}")

    (folder / "4.dcm").unlink()  # the third in time
    with pytest.raises(UnansweredError, match=f"DICOM's {tag} is 4 after 2"):
        gathered(folder, rate_hz=RATE_HZ)
    assert steps_of(gathered(folder, **BY_NUMBERS)) == [0.0, 0.25, 0.75, 1.0]


@pytest.mark.parametrize(
    ("content", "more"),
    [
        (lambda n: {"TemporalPositionIndex": n + 1}, {}),
        (lambda n: {"TemporalPositionIndex": n + 1}, {"FrameTime": 250.0}),
        (lambda n: {"InStackPositionNumber": n + 1}, {}),
        (lambda n: {"FrameAcquisitionDateTime": f"2026050312000{n / 4:04.2f}"}, {}),
    ],
)
def test_frames_of_one_dicom_file_come_in_their_stated_order(tmp_path, content, more):
    order = [2, 0, 4, 1, 3]
    tags = of_frames(*map(content, order))
    write_dicom(tmp_path / "a.dcm", FRAMES[order], **tags, **more)
    found = gathered(tmp_path / "a.dcm")
    assert numbers_of(found.scan) == IN_ORDER
    assert steps_of(found) == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_files_of_many_frames_come_in_the_order_of_their_beginnings(tmp_path):
    for name, second, first in (("a", 4, 2), ("b", 1, 0)):
        tags = {"FrameTime": 500.0, "ContentTime": f"12000{second}"}
        write_dicom(tmp_path / f"{name}.dcm", FRAMES[first : first + 2], **tags)

    found = gathered(tmp_path)
    assert numbers_of(found.scan) == [0, 1, 2, 3]
    assert steps_of(found) == [0.0, 0.5, 3.0, 3.5]


def test_volumes_of_several_moments_are_asked_about(tmp_path):
    tags = of_frames(
        *(
            {"TemporalPositionIndex": moment, "InStackPositionNumber": place}
            for moment in (1, 2)
            for place in (1, 2)
        )
    )
    write_dicom(tmp_path / "a.dcm", FRAMES[:4], FrameTime=500.0, **tags)
    with pytest.raises(UnansweredError, match="both repeat: slices of several volumes"):
        gathered(tmp_path / "a.dcm")


def test_two_series_are_two_recordings_unless_a_table_names_their_images(tmp_path):
    series = ["1.2.0"] * 3 + ["1.2.1"]
    folder = in_order_of(tmp_path, *({"SeriesInstanceUID": uid} for uid in series))
    with pytest.raises(InputError, match=r"UID is 1\.2\..*two recordings"):
        gathered(folder, rate_hz=1.0)

    lines = [(path.name, nth) for nth, path in enumerate(folder.iterdir())]
    table = write_table(tmp_path.with_name("t.csv"), "file,time_s", *lines)
    assert len(gathered(folder, times=table).scan.names) == 4


@pytest.mark.parametrize(
    "tags",
    [
        {"SOPClassUID": "1.2.840.10008.5.1.4.1.1.77.1.5.7"},
        {"SOPClassUID": "1.2.840.10008.5.1.4.1.1.77.1.5.1"},
        {"Modality": "OPTENF"},
        {"ImageType": ["DERIVED", "SECONDARY", "EN FACE"]},
        {"ImageType": ["ORIGINAL", "PRIMARY", "LOCALIZER"]},
    ],
)
def test_a_picture_from_the_front_is_no_frame(tmp_path, tags):
    folder = in_order_of(tmp_path, *({"InstanceNumber": nth} for nth in range(2)))
    front = folder / "front.dcm"
    write_dicom(front, FRAMES[4], **tags)
    found = gathered(folder, rate_hz=1.0)
    assert numbers_of(found.scan) == [0, 1]
    assert "left out: 1 picture from the front, not B-scans (front.dcm)" in found.notes
    for sources in ([front], [folder / "0.dcm", front]):
        with pytest.raises(InputError, match=r"front\.dcm: .*a picture from the front"):
            gathered(*sources, rate_hz=1.0)


def test_frames_that_a_sequence_calls_invalid_are_missing(tmp_path):
    states = ["OK", "OK", "INVALID", "OK", "OK"]
    fields = plus_fields(IN_ORDER, states)
    fields = {name: each for name, each in fields.items() if "Timestamp" not in name}
    nrrd.write(str(tmp_path / "a.nrrd"), FRAMES, fields)
    axes = "frame,depth,lateral"
    with pytest.raises(UnansweredError, match="Seq_FrameNNNN is 3 after 1"):
        gathered(tmp_path / "a.nrrd", axes=axes, rate_hz=RATE_HZ)

    found = gathered(tmp_path / "a.nrrd", axes=axes, **BY_NUMBERS)
    assert steps_of(found) == [0.0, 0.25, 0.75, 1.0]


# ---- axes of TIFF


def write_axes(path, kind, axes, count=COUNT, **metadata):
    options = {kind: True, "metadata": {"axes": axes, **metadata}}
    return write_stack(path, FRAMES[:count], **options)


@pytest.mark.parametrize(
    ("kind", "axes", "metadata", "words"),
    [
        ("imagej", "CYX", {}, r"2 channels \(c\)"),
        ("imagej", "CYX", {"mode": "composite"}, r"2 channels \(c\)"),
        (
            "imagej",
            "ZYX",
            {"spacing": 0.02, "unit": "mm"},
            r"2 slices \(z\), 0\.02 mm",
        ),
        ("ome", "CYX", {}, r"OME states 2 channels \(c\)"),
        ("ome", "ZYX", {"PhysicalSizeZ": 20.0}, r"2 slices \(z\), 20 µm apart"),
    ],
)
def test_channels_and_slices_of_a_volume_are_no_moments(
    tmp_path, kind, axes, metadata, words
):
    path = write_axes(tmp_path / "a.tif", kind, axes, 2, **metadata)
    with pytest.raises(UnansweredError, match=words) as caught:
        gathered(path, rate_hz=1.0)

    assert str(path) in str(caught.value)
    assert numbers_of(gathered(path, rate_hz=1.0, frames_by="order").scan) == [0, 1]


def test_slices_without_a_step_are_taken_at_a_rate_and_not_at_the_files(tmp_path):
    path = write_axes(tmp_path / "a.tif", "imagej", "ZYX", finterval=8.0)
    found = gathered(path)
    assert found.scan.times is None
    assert "ImageJ's finterval is between moments" in found.scan.times_fault
    bare = gathered(write_axes(tmp_path / "b.tif", "imagej", "ZYX"), rate_hz=1.0)
    assert (bare.scan.times_fault, bare.notes) == (None, ())
    many = np.zeros((8, 24, 40), np.uint16)
    tifffile.imwrite(tmp_path / "c.tif", many, imagej=True)  # named channels
    assert len(gathered(tmp_path / "c.tif", rate_hz=1.0).scan.names) == 8


def test_ome_states_the_order_of_its_pages(tmp_path):
    path = write_axes(tmp_path / "a.ome.tif", "ome", "TYX")
    blocks = "".join(
        f'<TiffData IFD="{page}" PlaneCount="1" FirstT="{time}"/>'
        for page, time in enumerate((1, 0, 2, 4, 3))
    )
    with tifffile.TiffFile(path) as file:
        before, _, after = file.ome_metadata.partition("<TiffData")
    changed = f"{before}{blocks}{after[after.index('</Pixels>') :]}"
    tifffile.tiffcomment(path, changed.encode())
    assert numbers_of(gathered(path).scan) == [1, 0, 2, 4, 3]


# ---- folders


def test_what_a_folder_has_beside_frames_is_counted_in_one_line(tmp_path):
    folder = write_frames(tmp_path / "f", "1.png", "2.png", "left/1.png", "left/2.png")
    (folder / "3.png").symlink_to(tmp_path / "gone.png")
    for name in ("Thumbs.db", "desktop.ini", "info.txt", "readme.md", ".hidden"):
        (folder / name).write_text("width: 15 mm\ndepth: 4 mm\n")

    write_log(folder / "log.csv")
    lines = ("file,time_s", ("1.png", 0), ("2.png", 5))
    write_table(folder / "frames.csv", *lines)
    found = gathered(folder, times=write_table(folder / "times.csv", *lines))
    assert found.log is not None
    (note,) = found.notes
    assert note == (
        f"{folder}: left out: 1 link that leads nowhere (3.png), 4 files that are neither"
        " frames nor forces (Thumbs.db, desktop.ini, info.txt, readme.md), 1 file that"
        " names frames, such as a table for `times` (frames.csv), 1 folder (left: 2"
        " frames)"
    )


@pytest.mark.parametrize(
    "text",
    [
        "2026-05-03T12:00:00.0,-0.01\n2026-05-03T12:00:00.1,-0.02\n" * 2,
        "0;1,5\n1;2,5\n2;3,5\n",
        "0\t1\n1\t2\n2\t3\n",
    ],
)
def test_logs_beside_frames_are_still_read(tmp_path, text):
    folder = write_frames(tmp_path / "f", "1.png", "2.png")
    (folder / "log.txt").write_text("when;pull\n" + text)
    with pytest.raises(InputError, match=r"log\.txt"):  # its columns are not known
        gathered(folder, rate_hz=1.0)


def test_a_folder_of_folders_names_them(tmp_path):
    write_frames(tmp_path / "f", "left/1.png", "left/2.png")
    with pytest.raises(InputError, match=r"no files .*; it has 1 folder \(left: 2"):
        gathered(tmp_path / "f")


# ---- planes


def moments_of(found):
    return [moment for moment, _ in found.places]


@pytest.fixture
def lacking(tmp_path):
    """Two planes of four moments: one lacks the third, the other the second."""
    along = write_frames(tmp_path / "along", "f1.png", "f2.png", "f4.png")
    return along, write_frames(tmp_path / "across", "f1.png", "f3.png", "f4.png")


def check_lacking(found):
    names = [plane.name for _, plane in found.places]
    assert moments_of(found) == [0, 0, 1, 2, 3, 3]
    assert names == ["along", "across", "along", "across", "along", "across"]
    assert numbers_of(found.frames) == [0, 0, 1, 1, 2, 2]
    (note,) = (note for note in found.notes if "lack a plane" in note)
    assert note.startswith("2 of 4 moments lack a plane: no 'across' beside")


def test_planes_that_lack_other_frames_are_paired_by_number(lacking):
    with pytest.raises(UnansweredError, match=r"f4\.png follows f2\.png"):
        gathered(*lacking, planes=PLANES, rate_hz=1.0)

    found = gathered(*lacking, planes=PLANES, **BY_NUMBERS)
    check_lacking(found)
    assert steps_of(found, rate_hz=1.0) == [0.0, 1.0, 2.0, 3.0]
    assert numbers_of(found.scan) == [0, 1, 1, 2]


def test_planes_that_lack_other_frames_are_paired_by_time(tmp_path, lacking):
    lines = [(f"along/f{nth}.png", nth) for nth in (1, 2, 4)]
    lines += [(f"across/f{nth}.png", nth + 0.1) for nth in (1, 3, 4)]
    table = write_table(tmp_path / "t.csv", "file,time_s", *lines)
    found = gathered(*lacking, planes=PLANES, times=table)
    check_lacking(found)
    np.testing.assert_allclose(found.scan.times.time_s, [1.0, 2.0, 3.1, 4.0])


def test_planes_whose_numbers_begin_apart_are_asked_about(tmp_path):
    along = write_frames(tmp_path / "along", "f1.png", "f2.png", "f3.png")
    across = write_frames(tmp_path / "across", "f2.png", "f3.png", "f4.png")
    with pytest.raises(UnansweredError, match="'across' has no frame 1"):
        gathered(along, across, planes=PLANES, rate_hz=1.0)

    far = write_frames(tmp_path / "far", "g101.png", "g102.png", "g103.png")
    found = gathered(along, far, planes=PLANES, rate_hz=1.0)
    assert moments_of(found) == [0, 0, 1, 1, 2, 2]
    with pytest.raises(InputError, match="no frame of 'along' is of the moment"):
        gathered(along, far, planes=PLANES, **BY_NUMBERS)


@pytest.mark.parametrize("late_s", [0.0, 0.4, 0.5])
def test_planes_taken_in_turns_are_paired(tmp_path, late_s):
    """The frames of one plane are late by the same time, and one is lost."""
    along = write_frames(tmp_path / "along", "1.png", "2.png", "3.png", "4.png")
    across = write_frames(tmp_path / "across", "1.png", "2.png", "4.png")
    lines = [(f"along/{nth}.png", nth) for nth in range(1, 5)]
    lines += [(f"across/{nth}.png", nth + late_s) for nth in (1, 2, 4)]
    table = write_table(tmp_path / "t.csv", "file,time_s", *lines)
    found = gathered(along, across, planes=PLANES, times=table)
    assert moments_of(found) == [0, 0, 1, 1, 2, 3, 3]
    assert found.scan.times.time_s.tolist() == [1.0, 2.0, 3.0, 4.0]
