"""The order and the times of frames: names, tables, tags of DICOM, axes of TIFF, and
planes of which each lacks another frame.
"""

import unicodedata
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import tifffile
from foreign_files import (
    COUNT,
    FRAMES,
    numbers_of,
    plus_fields,
    write_dicom,
    write_frames,
    write_log,
    write_table,
)
from pydicom.dataset import Dataset
from pydicom.sequence import Sequence as Items

from scleraforce.base.errors import InputError
from scleraforce.recordings.formats.picture_streams import UnansweredError
from scleraforce.recordings.frame_names import numbers_in, times_in
from scleraforce.recordings.import_answers import given_times
from scleraforce.recordings.import_sources import (
    GatheredSources,
    ImportOptions,
    gather_sources,
)
from scleraforce.records.scan import Plane

nrrd = pytest.importorskip("nrrd")

ALONG = Plane("along", 0.0, 0.0)
ACROSS = Plane("across", 0.0, np.pi / 2)
RATE_HZ = 4.0


def gathered(
    *sources: Path, planes: Sequence[Plane] = (), **options
) -> GatheredSources:
    return gather_sources(sources, ImportOptions(**options), planes=planes)


def times_of(found: GatheredSources, **options) -> list[float]:
    """Return the times of frames from the first one on."""
    times = given_times(found.scan, options.get("times"), options.get("rate_hz"))
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
        ("2026-05-03_142201.png", "2026-05-03_142202.png", "2026-05-03_142203.png"),
        ("eye7_20260503_001.png", "eye7_20260503_002.png", "eye7_20260503_003.png"),
        ("20260503_000001.png", "20260503_000002.png", "20260503_000003.png"),
        ("0001_a3f.png", "0002_9bc.png", "0003_77.png"),
        ("9bc-1.png", "77d-2.png", "a3f-3.png"),
        ("1_s.png", "2_s.png", "3_s.png"),
    ],
)
def test_names_that_count_on_or_say_nothing_are_taken_as_before(tmp_path, names):
    rate_hz = 1.0 if names[0].startswith("2026") else RATE_HZ
    found = gathered(write_frames(tmp_path / "f", *names), rate_hz=rate_hz)
    assert numbers_of(found.scan) == [0, 1, 2]
    steps = [0.0, 1.0 / rate_hz, 2.0 / rate_hz]
    assert times_of(found, rate_hz=rate_hz) == steps
    assert found.notes == ()


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("img_0025.png", "img_0029.png"), "img_0029.png follows img_0025.png"),
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
    assert times_of(listed, rate_hz=RATE_HZ)[1] == 1.0 / RATE_HZ


def test_a_missing_number_is_a_missing_frame(tmp_path):
    folder = write_frames(tmp_path / "f", "a9.png", "a12.png", "a10.png")
    found = gathered(folder, rate_hz=RATE_HZ, frames_by="numbers")
    assert numbers_of(found.scan) == [0, 2, 1]
    assert times_of(found, rate_hz=RATE_HZ) == [0.0, 0.25, 0.75]
    later = gathered(folder, rate_hz=RATE_HZ, frames_by="numbers", first_frame=2)
    assert times_of(later, rate_hz=RATE_HZ) == [0.0, 0.5]
    write_frames(folder, "b/a09.png")
    with pytest.raises(InputError, match=r"a0?9\.png.* has its number; remove one"):
        gathered(folder, folder / "b", rate_hz=RATE_HZ, frames_by="numbers")


@pytest.mark.parametrize(
    ("names", "by", "time_s"),
    [
        (("10.png", "10.1.png", "10.25.png"), "times:s", [0.0, 0.1, 0.25]),
        (("0.png", "33.png", "100.png"), "times:ms", [0.0, 0.033, 0.1]),
        (("1700000000.5.png", "1700000002.0.png"), "times", [0.0, 1.5]),
        (("1700000000500.png", "1700000002000.png"), "times", [0.0, 1.5]),
        (("1403636579763555584.png", "1403636579863555584.png"), "times", [0.0, 0.1]),
        (("1700000000_500000000.png", "1700000001_000000000.png"), "times", [0.0, 0.5]),
        (("a_20260503_235959.5.png", "a_20260504_000001.png"), "times", [0.0, 1.5]),
        (("2026-05-03T14-22-01.123.png", "2026-05-03T14-22-02.0.png"), "times", None),
        (("t12.5s_1.png", "t13.0s_2.png"), "times", [0.0, 0.5]),
        (("t_0050ms.png", "t_0100ms.png", "t_1000ms.png"), "times", [0.0, 0.05, 0.95]),
    ],
)
def test_names_may_be_times(tmp_path, names, by, time_s):
    folder = write_frames(tmp_path / "f", *names)
    found = gathered(folder, frames_by=by)
    assert times_of(found) == (time_s or [0.0, 0.877])
    assert found.scan.times.source == "the files' names"
    assert numbers_of(found.scan) == [*range(len(names))]


def test_times_and_numbers_in_names_that_are_none_are_refused(tmp_path):
    folder = write_frames(tmp_path / "f", "10.png", "10.1.png")
    for options, words in (
        ({"frames_by": "times"}, "give `frames_by=times:s`"),
        ({"frames_by": "numbers"}, "takes one number in each name"),
        ({"frames_by": "times:h", "rate_hz": 1.0}, "`rate_hz`: `frames_by=times`"),
        ({"frames_by": "names"}, "`frames_by`: 'names'; give numbers, order, times"),
        ({"frames_by": "times:parsec"}, "'times:parsec'"),
        ({"frames_by": "numbers:s"}, "'numbers:s'"),
    ):
        with pytest.raises(InputError, match=words):
            gathered(folder, **options)

    table = write_table(tmp_path / "t.csv", "time_s", "1", "2")
    with pytest.raises(InputError, match="`frames_by`: times, and `times` states"):
        gathered(folder, frames_by="times:s", times=table)

    again = write_frames(tmp_path / "g", "2 s.png", "2.0 s.png")
    with pytest.raises(InputError, match="states the time of"):
        gathered(again, frames_by="times")


def test_several_stacks_count_as_their_files_do(tmp_path):
    for name, place in (("s1", 0), ("s3", 2)):
        tifffile.imwrite(
            tmp_path / f"{name}.tif",
            FRAMES[place : place + 2],
            photometric="minisblack",
        )

    with pytest.raises(UnansweredError, match=r"s3\.tif follows s1\.tif"):
        gathered(tmp_path)

    found = gathered(tmp_path, frames_by="numbers")
    assert times_of(found, rate_hz=1.0) == [0.0, 1.0, 4.0, 5.0]


def test_names_that_imagej_keeps_of_slices_count(tmp_path):
    labels = [f"img_{nth:04d}" for nth in (1, 2, 4, 5, 6)]
    metadata = {"axes": "TYX", "Labels": labels}
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, imagej=True, metadata=metadata)
    with pytest.raises(UnansweredError, match="img_0004 follows img_0002"):
        gathered(tmp_path / "a.tif", rate_hz=1.0)

    table = write_table(
        tmp_path / "t.csv",
        "file,time_s",
        *((f"{name}.png", 9 - n) for n, name in enumerate(labels)),
    )
    found = gathered(tmp_path / "a.tif", times=table)
    assert numbers_of(found.scan) == [4, 3, 2, 1, 0]
    assert times_of(found, times=table) == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_numbers_and_times_are_found_beside_others():
    assert numbers_in(["s2_f7_t1.png", "s2_f8_t1.png"]).tolist() == [7, 8]
    assert numbers_in(["a1b4.png", "a1b2.png", "a2b9.png"]).tolist() == [4, 2, 9]
    assert numbers_in(["1.png", "x.png"]) is None
    assert times_in(["0000000001.png", "0000000002.png"]) is None
    assert times_in(["20261399_000000.png", "20261399_000001.png"]) is None


# ---- tables of times

NAMED = ("12mN.png", "24mN.png", "3mN.png")
TIMES = (5.0, 7.5, 9.25)


def rows(name_of=lambda name: name) -> list[tuple[str, float]]:
    return [(name_of(name), time) for name, time in zip(NAMED, TIMES, strict=True)]


def other_table(tmp_path: Path, header: str, name_of) -> Path:
    return write_table(tmp_path / "t.csv", header, *rows(name_of))


@pytest.mark.parametrize(
    ("header", "name_of"),
    [
        ("file,time_s", lambda name: name),
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
def test_a_table_goes_by_the_names_of_files(tmp_path, header, name_of):
    folder = write_frames(tmp_path / "f", *NAMED)
    table = other_table(tmp_path, header, name_of)
    found = gathered(folder, times=table)
    assert numbers_of(found.scan) == [0, 1, 2]
    assert times_of(found, times=table) == [0.0, 2.5, 4.25]
    assert found.notes == ()
    assert (
        gathered(folder, times=table, first_frame=2).scan.names[0].endswith("24mN.png")
    )


def test_a_table_goes_by_names_in_any_form_of_unicode(tmp_path):
    folder = tmp_path / "f"
    names = [unicodedata.normalize("NFD", f"prüf_{name}") for name in NAMED]
    write_frames(folder, *names)
    table = other_table(
        tmp_path,
        "file,time_s",
        lambda name: unicodedata.normalize("NFC", f"prüf_{name}"),
    )
    assert numbers_of(gathered(folder, times=table).scan) == [0, 1, 2]


@pytest.mark.parametrize(
    ("header", "times"),
    [
        (
            "file,time",
            (
                "2026-05-03T12:00:05Z",
                "2026-05-03T12:00:07.5Z",
                "2026-05-03T12:00:09.25Z",
            ),
        ),
        (
            "file,timestamp",
            ("2026-05-03 12:00:05", "2026-05-03 12:00:07.5", "2026-05-03 12:00:09.25"),
        ),
        ("file,time_s", ("12:00:05", "12:00:07.500", "12:00:09.250")),
        (
            "file,Datum",
            ("13.05.2026 12:00:05", "13.05.2026 12:00:07.5", "13.05.2026 12:00:09.25"),
        ),
    ],
)
def test_a_table_may_have_dates(tmp_path, header, times):
    folder = write_frames(tmp_path / "f", *NAMED)
    table = write_table(tmp_path / "t.csv", header, *zip(NAMED, times, strict=True))
    assert times_of(gathered(folder, times=table), times=table) == [0.0, 2.5, 4.25]


def test_a_table_that_does_not_fit_is_refused_with_the_name(tmp_path):
    folder = write_frames(tmp_path / "f", *NAMED)
    write_frames(tmp_path / "g", "frame_1.png", "frame_2.png", "frame_4.png")
    for place, header, lines, words in (
        (
            folder,
            "file,time_s",
            rows(lambda n: n.replace("24", "42")),
            r"file: no row for .*24mN\.png; there are 12mN\.png, 42mN\.png",
        ),
        (
            folder,
            "file,time_s",
            [*rows(), ("12mN.png", 8.0)],
            r"12mN\.png is in lines 2 and 5, with two times",
        ),
        (
            folder,
            "file,time_s",
            [(NAMED[0], 1), (NAMED[1], 1), (NAMED[2], 2)],
            "are both of 1 s",
        ),
        (
            folder,
            "file,time",
            [(n, "05/06/2026 12:00:01") for n in NAMED],
            "day or the month",
        ),
        (
            tmp_path / "g",
            "frame,time_s",
            [(n, n) for n in (1, 2, 3)],
            r"frame: no row for .*frame_4\.png; there are numbers 1 to 3",
        ),
    ):
        table = write_table(tmp_path / "t.csv", header, *lines)
        with pytest.raises(InputError, match=words) as caught:
            gathered(place, times=table)

        assert str(table) in str(caught.value)


def test_rows_without_names_are_asked_about_where_names_are_forces(
    tmp_path,
):
    folder = write_frames(tmp_path / "f", *NAMED)
    table = write_table(tmp_path / "t.csv", "time_s", "1", "2", "4")
    with pytest.raises(UnansweredError, match=r"has no column of files, and .*3mN"):
        gathered(folder, times=table)

    by_hand = [folder / name for name in (NAMED[1], NAMED[0], NAMED[2])]
    for sources, options in ((by_hand, {}), ([folder], {"frames_by": "order"})):
        found = gathered(*sources, times=table, **options)
        assert times_of(found, times=table) == [0.0, 1.0, 3.0]

    counted = write_frames(tmp_path / "g", "f_025.png", "f_029.png", "f_030.png")
    assert times_of(gathered(counted, times=table), times=table) == [0.0, 1.0, 3.0]


def test_a_table_may_count_frames(tmp_path):
    folder = write_frames(tmp_path / "f", "im_2.png", "im_3.png", "im_5.png")
    for first, counts in ((0, (5, 2, 3)), (1, (5, 4, 3, 2, 1))):
        table = write_table(
            tmp_path / "t.csv", "frame,time_s", *((n, n / 4) for n in counts)
        )
        assert times_of(gathered(folder, times=table), times=table) == [
            0,
            0.25,
            0.75,
        ], first

    onward = write_frames(tmp_path / "g", "im_1.png", "im_2.png", "im_3.png")
    from_zero = write_table(tmp_path / "t.csv", "frame,time_s", (0, 0), (1, 1), (2, 5))
    assert times_of(gathered(onward, times=from_zero), times=from_zero) == [0, 1, 5]


def test_a_table_of_a_stack_goes_by_its_rows_or_counts_its_pages(
    tmp_path,
):
    tifffile.imwrite(tmp_path / "a.tif", FRAMES, photometric="minisblack")
    turned = [(COUNT - 1 - nth, float(nth)) for nth in range(COUNT)]
    for header, lines, expected in (
        ("time_s", [str(nth) for nth in range(COUNT)], [0, 1, 2, 3, 4]),
        ("file,time_s", [("a.tif", nth) for nth in range(COUNT)], [0, 1, 2, 3, 4]),
        ("file,time_s", [(f"other_{n}.png", n) for n in range(COUNT)], [0, 1, 2, 3, 4]),
        ("frame,time_s", turned, [4, 3, 2, 1, 0]),
    ):
        table = write_table(tmp_path / "t.csv", header, *lines)
        found = gathered(tmp_path / "a.tif", times=table)
        assert numbers_of(found.scan) == expected
        assert times_of(found, times=table) == [0, 1, 2, 3, 4]

    table = write_table(tmp_path / "t.csv", "file,time_s", ("a.tif", 1), ("a.tif", 2))
    part = {"times": table, "first_frame": 4}
    assert times_of(gathered(tmp_path / "a.tif", **part), times=table) == [0, 1]
    tifffile.imwrite(tmp_path / "b.tif", FRAMES, photometric="minisblack")
    with pytest.raises(InputError, match=r"2 rows for .*a\.tif, which has 5 frames"):
        gathered(tmp_path / "a.tif", tmp_path / "b.tif", times=table)


# ---- DICOM


def in_order_of(tmp_path: Path, tags: Sequence[dict], **common) -> Path:
    """Write images whose names are in another order than their tags."""
    folder = tmp_path / "dicom"
    folder.mkdir()
    for nth, own in enumerate(tags):
        stated = {"SeriesInstanceUID": "1.2.3", **common, **own}
        write_dicom(folder / f"{(7 * nth) % 5}.dcm", FRAMES[nth], **stated)
    return folder


@pytest.mark.parametrize(
    ("tags", "source"),
    [
        (lambda n: {"AcquisitionTime": f"1200{n * n:02d}.5"}, "AcquisitionTime"),
        (lambda n: {"ContentTime": f"1200{n * n:02d}"}, "ContentTime"),
        (
            lambda n: {
                "ContentDate": f"202605{n * n + 1:02d}",
                "ContentTime": "120000",
            },
            "ContentTime",
        ),
        (
            lambda n: {"AcquisitionDateTime": f"202605031200{n * n:02d}"},
            "AcquisitionDateTime",
        ),
        (
            lambda n: {
                "AcquisitionDateTime": "20260503120000",
                "AcquisitionTime": f"1200{n * n:02d}",
            },
            "AcquisitionTime",
        ),
    ],
)
def test_dicom_images_come_in_the_order_of_their_times(tmp_path, tags, source):
    folder = in_order_of(tmp_path, [tags(nth) for nth in range(COUNT)])
    found = gathered(folder)
    assert numbers_of(found.scan) == [0, 1, 2, 3, 4]
    day_s = 86400.0 if "ContentDate" in tags(0) else 1.0
    assert times_of(found) == [day_s * nth * nth for nth in range(COUNT)]
    assert found.scan.times.source == f"DICOM's {source}"
    assert found.notes == ()


@pytest.mark.parametrize("tag", ["InstanceNumber", "TemporalPositionIdentifier"])
def test_dicom_images_come_in_the_order_of_their_numbers(tmp_path, tag):
    folder = in_order_of(tmp_path, [{tag: nth + 1} for nth in range(COUNT)])
    found = gathered(folder, rate_hz=RATE_HZ)
    assert numbers_of(found.scan) == [0, 1, 2, 3, 4]
    (note,) = found.notes
    assert note.startswith(f"frames are taken in the order of DICOM's {tag}")

    (folder / "4.dcm").unlink()  # the third in time
    with pytest.raises(UnansweredError, match=f"DICOM's {tag} is 4 after 2"):
        gathered(folder, rate_hz=RATE_HZ)
    lacking = gathered(folder, rate_hz=RATE_HZ, frames_by="numbers")
    assert times_of(lacking, rate_hz=RATE_HZ) == [0.0, 0.25, 0.75, 1.0]


def content(**tags) -> Dataset:
    item = Dataset()
    for name, value in tags.items():
        setattr(item, name, value)
    group = Dataset()
    group.FrameContentSequence = Items([item])
    return group


@pytest.mark.parametrize("extra", [{}, {"FrameTime": 250.0}])
@pytest.mark.parametrize("tag", ["TemporalPositionIndex", "InStackPositionNumber"])
def test_frames_of_one_dicom_file_come_in_their_stated_order(tmp_path, tag, extra):
    order = [3, 1, 5, 2, 4]
    groups = Items([content(**{tag: nth}) for nth in order])
    stored = FRAMES[[nth - 1 for nth in order]]
    write_dicom(
        tmp_path / "a.dcm", stored, PerFrameFunctionalGroupsSequence=groups, **extra
    )
    found = gathered(tmp_path / "a.dcm")
    assert numbers_of(found.scan) == [0, 1, 2, 3, 4]
    assert (found.scan.times is not None) == bool(extra)
    assert times_of(found, rate_hz=RATE_HZ) == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_frames_of_one_dicom_file_come_in_the_order_of_their_times(
    tmp_path,
):
    order = [2, 0, 1]
    groups = Items(
        [content(FrameAcquisitionDateTime=f"2026050312000{nth * nth}") for nth in order]
    )
    write_dicom(
        tmp_path / "a.dcm", FRAMES[order], PerFrameFunctionalGroupsSequence=groups
    )
    found = gathered(tmp_path / "a.dcm")
    assert numbers_of(found.scan) == [0, 1, 2]
    assert times_of(found) == [0.0, 1.0, 4.0]


def test_files_of_many_frames_come_in_the_order_of_their_beginnings(
    tmp_path,
):
    for name, second, first in (("a", 4, 2), ("b", 1, 0)):
        tags = {"FrameTime": 500.0, "ContentTime": f"12000{second}"}
        write_dicom(tmp_path / f"{name}.dcm", FRAMES[first : first + 2], **tags)

    found = gathered(tmp_path)
    assert numbers_of(found.scan) == [0, 1, 2, 3]
    assert times_of(found) == [0.0, 0.5, 3.0, 3.5]


def test_volumes_of_several_moments_are_asked_about(tmp_path):
    places = [(moment, place) for moment in (1, 2) for place in (1, 2)]
    groups = Items(
        [content(TemporalPositionIndex=t, InStackPositionNumber=z) for t, z in places]
    )
    tags = {"FrameTime": 500.0, "PerFrameFunctionalGroupsSequence": groups}
    write_dicom(tmp_path / "a.dcm", FRAMES[:4], **tags)
    with pytest.raises(UnansweredError, match="both repeat: slices of several volumes"):
        gathered(tmp_path / "a.dcm")


def test_two_series_are_two_recordings_unless_a_table_names_their_images(
    tmp_path,
):
    tags = [
        {"SeriesInstanceUID": f"1.2.{nth // 3}", "InstanceNumber": nth}
        for nth in range(4)
    ]
    folder = in_order_of(tmp_path, tags)
    with pytest.raises(
        InputError, match=r"SeriesInstanceUID is 1\.2\..*two recordings"
    ):
        gathered(folder, rate_hz=1.0)

    names = sorted(path.name for path in folder.iterdir())
    table = write_table(
        tmp_path / "t.csv", "file,time_s", *((n, i) for i, n in enumerate(names))
    )
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
    folder = in_order_of(tmp_path, [{"InstanceNumber": nth} for nth in range(2)])
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
    fields = plus_fields(range(COUNT), states)
    fields = {name: each for name, each in fields.items() if "Timestamp" not in name}
    nrrd.write(str(tmp_path / "a.nrrd"), FRAMES, fields)
    options = {"axes": "frame,depth,lateral", "rate_hz": RATE_HZ}
    with pytest.raises(UnansweredError, match="Seq_FrameNNNN is 3 after 1"):
        gathered(tmp_path / "a.nrrd", **options)

    found = gathered(tmp_path / "a.nrrd", frames_by="numbers", **options)
    assert times_of(found, rate_hz=RATE_HZ) == [0.0, 0.25, 0.75, 1.0]


# ---- axes of TIFF


def imagej(path: Path, axes: str, count: int = 2, **metadata) -> Path:
    stated = {"axes": axes, **metadata}
    tifffile.imwrite(path, FRAMES[:count], imagej=True, metadata=stated)
    return path


def ome(path: Path, axes: str, **metadata) -> Path:
    stated = {"axes": axes, **metadata}
    tifffile.imwrite(path, FRAMES, ome=True, photometric="minisblack", metadata=stated)
    return path


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (partial(imagej, axes="CYX"), r"2 channels \(c\)"),
        (partial(imagej, axes="CYX", mode="composite"), r"2 channels \(c\)"),
        (
            partial(imagej, axes="ZYX", spacing=0.02, unit="mm"),
            r"2 slices \(z\), 0\.02 mm",
        ),
        (partial(ome, axes="CYX"), r"OME states 5 channels \(c\)"),
        (partial(ome, axes="ZYX", PhysicalSizeZ=20.0), r"5 slices \(z\), 20 µm apart"),
    ],
)
def test_channels_and_slices_of_a_volume_are_no_moments(tmp_path, write, words):
    path = write(tmp_path / "a.tif" if write.func is imagej else tmp_path / "a.ome.tif")
    with pytest.raises(UnansweredError, match=words) as caught:
        gathered(path, rate_hz=1.0)

    assert str(path) in str(caught.value)
    found = gathered(path, rate_hz=1.0, frames_by="order")
    assert numbers_of(found.scan) == [*range(len(found.scan.names))]


def test_slices_without_a_step_are_taken_at_a_rate_and_not_at_the_files(
    tmp_path,
):
    path = imagej(tmp_path / "a.tif", "ZYX", finterval=8.0)
    found = gathered(path)
    assert found.scan.times is None
    assert "ImageJ's finterval is between moments" in found.scan.times_fault
    bare = gathered(imagej(tmp_path / "b.tif", "ZYX"), rate_hz=1.0)
    assert (bare.scan.times_fault, bare.notes) == (None, ())
    many = np.zeros((8, 24, 40), np.uint16)
    tifffile.imwrite(tmp_path / "c.tif", many, imagej=True)  # named channels
    assert len(gathered(tmp_path / "c.tif", rate_hz=1.0).scan.names) == 8


def test_ome_states_the_order_of_its_pages(tmp_path):
    path = ome(tmp_path / "a.ome.tif", "TYX")
    with tifffile.TiffFile(path) as file:
        text = file.ome_metadata
    blocks = "".join(
        f'<TiffData IFD="{page}" PlaneCount="1" FirstT="{time}"/>'
        for page, time in enumerate((1, 0, 2, 4, 3))
    )
    start = text.index("<TiffData")
    end = text.index("</Pixels>")
    changed = text[:start] + blocks + text[end:]
    tifffile.tiffcomment(path, changed.encode())
    assert numbers_of(gathered(path).scan) == [1, 0, 2, 4, 3]


# ---- folders


def test_what_a_folder_has_beside_frames_is_counted_in_one_line(tmp_path):
    folder = write_frames(tmp_path / "f", "1.png", "2.png", "left/1.png", "left/2.png")
    (folder / "3.png").symlink_to(tmp_path / "gone.png")
    for name, text in (
        ("Thumbs.db", "x"),
        ("desktop.ini", "[x]"),
        ("info.txt", "width: 15 mm\ndepth: 4 mm\n"),
        ("readme.md", "text"),
        (".hidden", ""),
        ("frames.csv", "file,time_s\n1.png,0\n2.png,5\n"),
    ):
        (folder / name).write_text(text)

    write_log(folder / "log.csv")
    table = write_table(folder / "times.csv", "file,time_s", ("1.png", 0), ("2.png", 5))
    found = gathered(folder, times=table)
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
    with pytest.raises(
        InputError, match=r"no files in this folder; it has 1 folder \(left: 2"
    ):
        gathered(tmp_path / "f")


# ---- planes


def planes_of(found: GatheredSources) -> list[tuple[int, str, int]]:
    """Return the moment, plane and place in `FRAMES` of every frame."""
    places = [(moment, plane.name) for moment, plane in found.places]
    return [
        (*place, n) for place, n in zip(places, numbers_of(found.frames), strict=True)
    ]


PAIRED = [
    (0, "along", 0),
    (0, "across", 0),
    (1, "along", 1),
    (2, "across", 1),
    (3, "along", 2),
    (3, "across", 2),
]


def both(tmp_path: Path) -> tuple[Path, Path]:
    """Two planes of four moments: one lacks the third, the other the second."""
    along = write_frames(tmp_path / "along", "f1.png", "f2.png", "f4.png")
    return along, write_frames(tmp_path / "across", "f1.png", "f3.png", "f4.png")


LACKING = "2 of 4 moments lack a plane: no 'across' beside"


def test_planes_that_lack_other_frames_are_paired_by_number(tmp_path):
    sources = both(tmp_path)
    with pytest.raises(UnansweredError, match=r"f4\.png follows f2\.png"):
        gathered(*sources, planes=(ALONG, ACROSS), rate_hz=1.0)

    options = {"rate_hz": 1.0, "frames_by": "numbers"}
    found = gathered(*sources, planes=(ALONG, ACROSS), **options)
    assert planes_of(found) == PAIRED
    assert times_of(found, rate_hz=1.0) == [0.0, 1.0, 2.0, 3.0]
    assert numbers_of(found.scan) == [0, 1, 1, 2]
    assert any(note.startswith(LACKING) for note in found.notes)


def test_planes_that_lack_other_frames_are_paired_by_time(tmp_path):
    sources = both(tmp_path)
    table = write_table(
        tmp_path / "t.csv",
        "file,time_s",
        *(("along/f1.png", 1.0), ("along/f2.png", 2.0), ("along/f4.png", 4.0)),
        *(("across/f1.png", 1.1), ("across/f3.png", 3.1), ("across/f4.png", 4.1)),
    )
    found = gathered(*sources, planes=(ALONG, ACROSS), times=table)
    assert planes_of(found) == PAIRED
    np.testing.assert_allclose(found.scan.times.time_s, [1.0, 2.0, 3.1, 4.0])
    assert any(note.startswith(LACKING) for note in found.notes)


def test_planes_whose_numbers_begin_apart_are_asked_about(tmp_path):
    along = write_frames(tmp_path / "along", "f1.png", "f2.png", "f3.png")
    across = write_frames(tmp_path / "across", "f2.png", "f3.png", "f4.png")
    with pytest.raises(UnansweredError, match="'across' has no frame 1"):
        gathered(along, across, planes=(ALONG, ACROSS), rate_hz=1.0)

    far = write_frames(tmp_path / "far", "g101.png", "g102.png", "g103.png")
    found = gathered(along, far, planes=(ALONG, ACROSS), rate_hz=1.0)
    assert [moment for moment, _, _ in planes_of(found)] == [0, 0, 1, 1, 2, 2]
    options = {"rate_hz": 1.0, "frames_by": "numbers"}
    with pytest.raises(InputError, match="no frame of 'along' is of the moment"):
        gathered(along, far, planes=(ALONG, ACROSS), **options)


@pytest.mark.parametrize("late_s", [0.0, 0.4, 0.5])
def test_planes_taken_in_turns_are_paired(tmp_path, late_s):
    """The frames of one plane are late by the same time, and one is lost."""
    names = ("1.png", "2.png", "3.png", "4.png")
    folders = [write_frames(tmp_path / name, *names) for name in ("along", "across")]
    (folders[1] / "3.png").unlink()
    lines = [(f"along/{nth}.png", nth) for nth in range(1, 5)]
    lines += [(f"across/{nth}.png", nth + late_s) for nth in (1, 2, 4)]
    table = write_table(tmp_path / "t.csv", "file,time_s", *lines)
    found = gathered(*folders, planes=(ALONG, ACROSS), times=table)
    assert [moment for moment, _, _ in planes_of(found)] == [0, 0, 1, 1, 2, 3, 3]
    assert found.scan.times.time_s.tolist() == [1.0, 2.0, 3.0, 4.0]
