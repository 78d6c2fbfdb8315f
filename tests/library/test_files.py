"""A library as one file: what is read is what was written, and nothing else is read."""

from dataclasses import fields
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest
from analytic_library import analytic_library

from scleraforce.errors import InputError
from scleraforce.library import load_library, save_library


@pytest.fixture
def library():
    return analytic_library(thicknesses=4, ratios=4, tips=5)


def test_a_library_survives_the_file_and_the_bytes_are_the_same_each_time(library, tmp_path):
    for name in ("one.npz", "two.npz"):
        save_library(library, tmp_path / name)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    found = load_library(tmp_path / "one.npz")
    for item in (entry for entry in fields(library) if entry.init):
        assert np.array_equal(getattr(found, item.name), getattr(library, item.name)), item.name
        assert type(getattr(found, item.name)) is type(getattr(library, item.name))


def test_other_files_are_refused(library, tmp_path):
    path = tmp_path / "library.npz"
    for content in (None, b"", b"no zip"):
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(InputError, match=r"library\.npz: "):
            load_library(path)
    np.savez(path, thickness_m=library.thickness_m)
    with pytest.raises(InputError, match="tension"):
        load_library(path)
    save_library(library, path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"library\.npz"):
        load_library(path)


def rewritten(path, change):
    """The archive with every entry changed."""
    with ZipFile(path) as archive:
        entries = [(entry, archive.read(entry)) for entry in archive.infolist()]
    with ZipFile(path, "w") as archive:
        for entry, data in entries:
            archive.writestr(*change(entry, data))


def test_an_archive_that_is_compressed_encrypted_or_says_wrong_sizes_takes_no_memory(library, tmp_path):
    path = tmp_path / "library.npz"

    def compressed(entry, data):
        return entry.filename, data, ZIP_DEFLATED

    def bombs(entry, data):
        return entry.filename, data.replace(b"'shape': (4,", b"'shape': (4000000000000,")

    for change in (compressed, bombs):
        save_library(library, path)
        rewritten(path, change)
        with pytest.raises(InputError, match="not a response library"):
            load_library(path)
    for place, value in ((8, 1), (10, 99)):  # flags of an entry in the central directory; its method
        save_library(library, path)
        content = bytearray(path.read_bytes())
        content[content.index(b"PK\1\2") + place] = value
        path.write_bytes(content)
        with pytest.raises(InputError, match="compressed, encrypted"):
            load_library(path)
