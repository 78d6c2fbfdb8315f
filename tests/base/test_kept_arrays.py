"""Arrays in the user's cache: read again, and never believed where damaged."""

import os

import numpy as np
import pytest

from scleraforce.base.kept_arrays import ENDING, LEAST_VALUES, MOST_FILES, kept_array

SHAPE = (2, LEAST_VALUES // 2)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "scleraforce/arrays"


def array_of(value, origin="origin"):
    return kept_array((origin,), SHAPE, lambda: np.full(SHAPE, value, np.float32))


def test_an_array_is_computed_once_for_what_decides_it(folder):
    assert (array_of(1.0) == 1.0).all()
    again = array_of(2.0)
    assert (again == 1.0).all()
    assert again.flags.writeable
    assert again.flags.aligned
    assert again.shape == SHAPE
    assert (array_of(3.0, "another") == 3.0).all()
    assert folder.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("place", [0, 4, -1])
def test_a_damaged_file_is_not_believed_and_replaced(folder, place):
    array_of(1.0)
    (path,) = folder.glob(f"*{ENDING}")
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)
    assert (array_of(2.0) == 2.0).all()
    assert (array_of(3.0) == 2.0).all()


def test_half_a_file_is_not_believed(folder):
    array_of(1.0)
    (path,) = folder.glob(f"*{ENDING}")
    path.write_bytes(path.read_bytes()[:1000])
    assert (array_of(2.0) == 2.0).all()


@pytest.mark.skipif(os.name != "posix", reason="modes of Unix")
def test_nothing_is_read_where_others_write(folder):
    array_of(1.0)
    folder.chmod(0o777)
    assert (array_of(2.0) == 2.0).all()


def test_small_arrays_and_the_oldest_files_are_not_kept(folder):
    kept_array(("small",), (3,), lambda: np.zeros(3, np.float32))
    assert not folder.exists()

    for number in range(MOST_FILES + 2):
        array_of(0.0, str(number))
    assert len(list(folder.glob(f"*{ENDING}"))) == MOST_FILES


def test_an_array_that_cannot_be_kept_is_computed(folder):
    folder.parent.mkdir()
    folder.write_text("a file in the place of the folder")
    assert (array_of(1.0) == 1.0).all()
    assert (array_of(2.0) == 2.0).all()
