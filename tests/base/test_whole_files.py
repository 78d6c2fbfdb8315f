"""Files that are read and written whole, and conversions between human units and SI."""

import codecs
import os
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.units import SI_PER_UNIT, from_si, to_si
from scleraforce.base.whole_files import (
    KINDS,
    folder_when_whole,
    read_bytes,
    read_text,
    renamed_when_whole,
    write_whole,
)

STUDY = KINDS["study"]


def test_a_pipe_a_folder_and_a_device_are_refused_without_waiting(
    tmp_path,
):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "endless").symlink_to("/dev/zero")

    for name, noun in (
        ("pipe", "a named pipe"),
        ("endless", "a device"),
        (".", "a folder"),
    ):
        with pytest.raises(StudyError, match=f"{noun}; give a regular file"):
            read_bytes(tmp_path / name, STUDY)


def test_a_file_that_is_larger_than_its_kind_is_refused_before_it_is_read(
    tmp_path,
):
    path = tmp_path / "study.toml"
    with path.open("wb") as file:
        file.truncate(2**40)  # a sparse file: 1 TiB that nobody could hold

    with pytest.raises(
        StudyError,
        match=r"study\.toml: more than 1 MiB, which is more than a study file may have",
    ):
        read_bytes(path, STUDY)

    assert read_bytes(_file(path, b"x" * 8), replace(STUDY, max_bytes=8)) == b"x" * 8


def test_a_missing_file_says_what_makes_one(tmp_path):
    with pytest.raises(
        StudyError,
        match=r"study\.toml: No such file or directory; `scleraforce init DIR` writes",
    ):
        read_text(tmp_path / "study.toml", STUDY)


def test_text_of_any_editor_is_read(tmp_path):
    path = _file(tmp_path / "a.toml", codecs.BOM_UTF16_BE + "a = 1".encode("utf-16-be"))
    assert read_text(path, STUDY) == "a = 1"
    for encoding in ["utf-8", "utf-8-sig", "utf-16", "utf-32"]:
        path = _file(tmp_path / "a.toml", "id = 'Süd µ'\r\nb = 1\r\n".encode(encoding))
        assert read_text(path, STUDY) == "id = 'Süd µ'\nb = 1\n"


def test_text_of_an_unknown_encoding_is_refused_with_its_line_and_what_to_do(
    tmp_path,
):
    path = _file(tmp_path / "a.toml", "a = 1\nid = 'Süd'".encode("latin-1"))
    with pytest.raises(
        StudyError,
        match=r"a\.toml:2: not UTF-8 text \(byte 0xfc\); save the file as UTF-8",
    ):
        read_text(path, STUDY)


def test_what_is_interrupted_leaves_nothing_and_the_old_file_stays(
    tmp_path,
):
    path = tmp_path / "a.txt"
    write_whole("old", path)

    def interrupted(whole):
        with whole(path) as part:
            (
                part.write_text("half")
                if part.exists()
                else (part / "half").mkdir(parents=True)
            )
            raise KeyboardInterrupt

    for whole in (renamed_when_whole, folder_when_whole):
        with pytest.raises(KeyboardInterrupt):
            interrupted(whole)

    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_links_beside_a_file_are_not_followed_when_it_is_written(
    tmp_path,
):
    victim = _file(tmp_path / "victim", b"mine")
    for name in (
        ".a.txt.part",
        f".a.txt.{os.getpid()}.part",
    ):
        # names that could be foreseen
        (tmp_path / name).symlink_to(victim)

    write_whole("new", tmp_path / "a.txt")
    assert (victim.read_bytes(), (tmp_path / "a.txt").read_text()) == (b"mine", "new")
    assert not (tmp_path / "a.txt").is_symlink()


def test_a_name_as_long_as_the_system_allows_can_be_written_and_a_longer_one_is_refused(
    tmp_path,
):
    write_whole("whole", tmp_path / ("a" * 255))
    with pytest.raises(InputError, match="File name too long"):
        write_whole("whole", tmp_path / ("a" * 256))
    assert len(list(tmp_path.iterdir())) == 1


def test_new_files_have_the_permissions_that_the_user_wants(tmp_path):
    before = os.umask(0o027)
    try:
        write_whole("", tmp_path / "a")
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640


def _file(path, content):
    path.write_bytes(content)
    return path


UNITS = sorted(SI_PER_UNIT)
POWERS_OF_TEN = {"mm": -3, "um": -6, "mpa": 6, "percent": -2, "mm2": -6, "gb": 9}


@given(st.sampled_from(sorted(POWERS_OF_TEN)), st.integers(-(2**53), 2**53))
def test_a_whole_number_comes_to_si_as_if_it_were_written_there(unit, number):
    """So 400 um are 4e-4 m; a product with 1e-6 has a last digit of its own."""
    assert to_si(float(number), unit) == float(f"{number}e{POWERS_OF_TEN[unit]}")


@given(st.sampled_from(UNITS), st.floats(-1e9, 1e9))
def test_the_way_back_from_si_returns_the_number(unit, number):
    assert from_si(to_si(number, unit), unit) == pytest.approx(
        number, rel=1e-15, abs=1e-300
    )


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("convert", [to_si, from_si])
def test_an_array_converts_as_its_numbers_do(unit, convert):
    values = np.random.default_rng(0).normal(size=(3, 100))
    one_by_one = [[convert(float(value), unit) for value in row] for row in values]
    np.testing.assert_array_equal(convert(values, unit), one_by_one)
    assert convert(values.astype(np.float32), unit).dtype == np.float32
    assert convert(None, unit) is None
