"""A library as one file: read as exactly as the file states; other files are
refused.
"""

import pickle
from dataclasses import fields, replace
from io import BytesIO
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
import pytest
from analytic_library import (
    analytic_library,
    draw_walls,
    made_up_library,
    with_walls,
)

from scleraforce.base.errors import InputError
from scleraforce.base.whole_files import KINDS
from scleraforce.library import load_library, save_library
from scleraforce.library.stiffened_walls import WholeCurves

REDUCED = ("walls", "stiffness_atpd")


@pytest.fixture
def library():
    return analytic_library(thicknesses=4, ratios=4, tips=5)


def test_a_library_survives_the_file_and_the_bytes_are_the_same_each_time(
    library, tmp_path
):
    for name in ("one.npz", "two.npz"):
        save_library(library, tmp_path / name)

    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    found = load_library(tmp_path / "one.npz")

    for item in (entry for entry in fields(library) if entry.init):
        values = getattr(found, item.name)
        known = getattr(library, item.name)
        assert item.name in REDUCED or np.array_equal(values, known), item.name
        assert type(values) is type(known)
        assert np.asarray(values).dtype == np.asarray(known).dtype

    assert found.curves_tpdbnc().dtype == np.float32


def rough(library):
    """Return a library whose reduced basis has many parts, of steps of all sizes, whose
    differences wrap around.
    """
    curves = library.walls.curves.whole()
    noise = np.random.default_rng(0).normal(size=curves.shape).astype(np.float32)
    return with_walls(library, curves=WholeCurves(curves + np.float32(2e-7) * noise))


@pytest.mark.parametrize("make", [replace, rough], ids=["smooth", "rough"])
def test_walls_and_factors_differ_by_the_file_s_stated_error_and_states_between_them_by_no_more(
    make, tmp_path
):
    whole = make(analytic_library(thicknesses=5, ratios=6, tips=30, nodes=41))
    path = tmp_path / "library.npz"
    saved = save_library(whole, path)
    found = load_library(path)

    with np.load(path) as entries:
        stated = float(entries["curves_error_m"]), float(entries["stiffness_error"])

    arrays = [
        (each.curves_tpdbnc().astype(np.float64), each.stiffness_atpd)
        for each in (found, whole)
    ]
    off = [np.abs(one - other).max() for one, other in zip(*arrays, strict=True)]

    for error, said, most in zip(off, stated, (0.02e-6, 1e-6), strict=True):
        assert 0.0 < error <= most
        assert said == pytest.approx(error, rel=0.1)  # another BLAS may round otherwise

    assert (saved.curves_m, saved.stiffness) == stated
    rng = np.random.default_rng(2)
    walls = *draw_walls(rng, 500), rng.uniform(0.0, 7.5e-3, 500)
    off_m = found.shapes(*walls).astype(np.float64) - whole.shapes(*walls)
    assert np.abs(off_m).max() <= 0.03e-6
    beside = np.radians(33.0)
    forces = whole.for_contact(beside).forces(*walls)
    assert np.abs(found.for_contact(beside).forces(*walls) / forces - 1.0).max() <= 2e-6
    assert found.displaced_m3(*walls) == pytest.approx(
        whole.displaced_m3(*walls), rel=1e-6
    )


@pytest.mark.parametrize("stiffening", [0.0, 0.5, 5.0, 18.0, 30.0])
def test_tissue_of_every_stiffening_survives_the_file(stiffening, tmp_path):
    """Between the stiffenings the weights of the stored errors, up to 0.02 um each, add
    up to no more than 1.64.
    """
    whole = made_up_library().within(4e-3)
    save_library(whole, tmp_path / "one.npz")
    found = load_library(tmp_path / "one.npz")
    np.testing.assert_array_equal(found.walls.stiffening, whole.walls.stiffening)
    one = found.for_stiffening(stiffening)
    other = whole.for_stiffening(stiffening)
    for name in ("force_ratio_tpd", "displaced_tpd", "undented_tpbnc"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))

    off_m = np.abs(one.curves_tpdbnc().astype(np.float64) - other.curves_tpdbnc())
    assert off_m.max() <= (0.02e-6 if stiffening in (0.0, 30.0) else 0.033e-6)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (30.0, "curves up to 0.379 would be off"),  # float32 rounds by more
        (1e4, "values up to 126 cannot"),  # the number of steps overflows
    ],
)
def test_a_library_that_cannot_be_stored_so_exactly_is_refused(library, times, message):
    curves = WholeCurves(np.float32(times) * library.walls.curves.whole())
    with pytest.raises(InputError, match=message):
        save_library(with_walls(library, curves=curves), BytesIO())


def test_a_library_that_is_too_large_is_refused(library, tmp_path, monkeypatch):
    save_library(library, tmp_path / "library.npz")
    small = replace(KINDS["model file"], max_bytes=2**16)
    monkeypatch.setitem(KINDS, "model file", small)

    with pytest.raises(InputError, match="make one of fewer thicknesses"):
        save_library(library, BytesIO())

    with pytest.raises(InputError, match="make one of fewer thicknesses"):
        load_library("library.npz", (tmp_path / "library.npz").read_bytes())


def test_other_files_are_refused(library, tmp_path):
    path = tmp_path / "library.npz"
    for content in (None, b"", b"no zip"):
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(InputError, match=r"library\.npz: "):
            load_library(path)

    np.savez_compressed(path, thickness_m=library.thickness_m)
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


def test_an_archive_that_is_not_deflated_encrypted_or_too_large_is_refused(
    library, tmp_path, monkeypatch
):
    """Deflated entries are small: their stated size is checked before they are read."""
    path = tmp_path / "library.npz"
    most = 2**22

    def plain(entry, data):
        return entry.filename, data, ZIP_STORED

    def bombs(entry, data):
        return (
            entry.filename,
            data.replace(b"'shape': (4,", b"'shape': (4000000000000,"),
            ZIP_DEFLATED,
        )

    for change in (plain, bombs):
        save_library(library, path)
        rewritten(path, change)
        with pytest.raises(InputError, match="not a response library"):
            load_library(path)

    for place, value in (
        (8, 1),
        (10, 99),
    ):
        # flags of an entry in the central directory; its method
        save_library(library, path)
        content = bytearray(path.read_bytes())
        content[content.index(b"PK\1\2") + place] = value
        path.write_bytes(content)

        with pytest.raises(InputError, match="not deflated, encrypted"):
            load_library(path)

    save_library(library, path)
    monkeypatch.setitem(
        KINDS, "model file", replace(KINDS["model file"], max_bytes=most)
    )
    assert load_library(path).stiffening == 0.0

    with ZipFile(path, "a", ZIP_DEFLATED) as archive:
        archive.writestr("more.npy", bytes(most))

    assert path.stat().st_size < most // 10
    with pytest.raises(
        InputError, match=r"more\.npy: not deflated, encrypted, or too large"
    ):
        load_library(path)


def refused(path, said):
    with pytest.raises(
        InputError,
        match=(
            rf"^.*library\.npz: not a response library.*{said}.*; train the model"
            r" again$"
        ),
    ):
        load_library(path)


def edited(path, **changes):
    """Write the entries again, some of them changed; an entry that becomes None is left
    out.
    """
    with np.load(path) as entries:
        arrays = {
            name: changes.get(name, lambda array: array)(array)
            for name, array in entries.items()
        }

    np.savez_compressed(
        path, **{name: array for name, array in arrays.items() if array is not None}
    )


def doubled(values):
    return np.concatenate([values, values[-1:]])


def emptied(array):
    return np.zeros((0, 2**40, 1, 1) if array.ndim == 4 else (0, 16, 5), array.dtype)


@pytest.mark.parametrize(
    ("said", "changes"),
    [
        ("curves_error_m: 0.001", {"curves_error_m": lambda e: np.full_like(e, 1e-3)}),
        (
            "stiffness_error: nan",
            {"stiffness_error": lambda e: np.full_like(e, np.nan)},
        ),
        ("curves_basis", {"curves_basis": lambda _: None}),
        ("curves_int16: int32", {"curves_int16": lambda steps: steps.astype(np.int32)}),
        ("curves: steps", {"curves_int8": lambda steps: steps[:-1]}),
        ("stiffness: steps", {"stiffness_basis": lambda basis: basis[1:]}),
        (
            "MiB",
            dict.fromkeys(
                ("curves_basis", "curves_int32", "curves_int16", "curves_int8"), emptied
            ),
        ),
        ("not finite", {"curves_basis": lambda basis: np.full_like(basis, 3e38)}),
        (
            "curves: steps",
            {"stiffening": lambda values: np.append(values, 60.0)}
            | dict.fromkeys(
                ("force_ratio_btpd", "displaced_btpd", "undented_btpbnc"), doubled
            ),
        ),
    ],
)
def test_a_reduced_basis_that_does_not_fit_is_refused_in_one_line(
    library, tmp_path, said, changes
):
    path = tmp_path / "library.npz"
    save_library(library, path)
    edited(path, **changes)
    refused(path, said)


def test_the_steps_of_checked_bytes_are_inflated_at_the_first_need(library, tmp_path):
    path = tmp_path / "library.npz"
    save_library(library, path)
    late = load_library("library.npz", path.read_bytes())
    again = pickle.loads(pickle.dumps(late))
    for found in (late, again):
        np.testing.assert_array_equal(
            found.curves_tpdbnc(), load_library(path).curves_tpdbnc()
        )


def test_checked_bytes_with_damaged_steps_are_refused_where_these_are_needed(
    tmp_path,
):
    path = tmp_path / "library.npz"
    large = rough(analytic_library(thicknesses=5, ratios=6, tips=30, nodes=41))
    save_library(large, path)
    with ZipFile(path) as archive:
        steps = [each for each in archive.infolist() if "curves_int" in each.filename]
    entry = max(steps, key=lambda each: each.file_size)
    content = bytearray(path.read_bytes())
    content[entry.header_offset + entry.compress_size] ^= 0xFF  # near its end

    damaged = load_library("library.npz", bytes(content))
    with pytest.raises(InputError, match="its curves cannot be read"):
        damaged.curves_tpdbnc()
