"""A library as one file: read as exactly as the file states; other files are
refused.
"""

from dataclasses import fields, replace
from io import BytesIO
from zipfile import ZIP_DEFLATED, ZIP_STORED, ZipFile

import numpy as np
import pytest
from analytic_library import (
    analytic_library,
    draw_walls,
    made_up_library,
    solved_library,
    with_walls,
)

from scleraforce.base.errors import InputError
from scleraforce.base.whole_files import KINDS
from scleraforce.library import load_library, save_library
from scleraforce.library.library_file import _differences, _summed
from scleraforce.library.stiffened_walls import STEP_TYPES, WholeCurves, reduce_rows
from scleraforce.records.study import LibraryStudy, Range

REDUCED = ("walls", "stiffness_atpd")
GRID = LibraryStudy(
    thickness_m=Range(min=0.5e-3, max=0.8e-3),
    thicknesses=4,
    tension=Range(min=8e-3, max=6e-2),
    tensions=4,
    max_tip_m=3e-3,
    tips=8,
    elements=24,
)


@pytest.fixture
def library():
    return analytic_library(thicknesses=4, ratios=4, tips=5)


@pytest.fixture(scope="module")
def whole():
    return analytic_library(thicknesses=5, ratios=6, tips=30)


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


def test_walls_and_factors_differ_by_the_file_s_stated_error_and_states_between_them_by_no_more(
    whole, tmp_path
):
    path = tmp_path / "library.npz"
    saved = save_library(whole, path)
    found = load_library(path)
    rng = np.random.default_rng(2)

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
    walls = *draw_walls(rng, 500), rng.uniform(0.0, 7.5e-3, 500)
    assert (
        np.abs(found.shapes(*walls).astype(np.float64) - whole.shapes(*walls)).max()
        <= 0.02e-6
    )
    beside = np.radians(33.0)
    forces = whole.for_contact(beside).forces(*walls)
    assert np.abs(found.for_contact(beside).forces(*walls) / forces - 1.0).max() <= 2e-6
    assert found.displaced_m3(*walls) == pytest.approx(
        whole.displaced_m3(*walls), rel=1e-6
    )


@pytest.mark.parametrize("nodes", ["all", "near"])
def test_tissue_of_every_stiffening_survives_the_file(nodes, tmp_path):
    """Between the stiffenings the weights of the stored errors, up to 0.02 um each, add
    up to no more than 1.64.
    """
    whole = (
        solved_library(GRID) if nodes == "all" else solved_library(GRID).within(4e-3)
    )
    save_library(whole, tmp_path / "one.npz")
    found = load_library(tmp_path / "one.npz")
    np.testing.assert_array_equal(found.walls.stiffening, whole.walls.stiffening)

    for stiffening in (*whole.walls.stiffening.tolist(), 0.5, 5.0, 18.0):
        one = found.for_stiffening(stiffening)
        other = whole.for_stiffening(stiffening)
        for name in ("force_ratio_tpd", "displaced_tpd", "undented_tpbnc"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))

        assert one.curves_tpdbnc().dtype == np.float32
        off_m = np.abs(
            one.curves_tpdbnc().astype(np.float64) - other.curves_tpdbnc()
        ).max()
        assert off_m <= (0.02e-6 if stiffening in whole.walls.stiffening else 0.033e-6)

    off_m = np.abs(
        found.walls.curves.whole().astype(np.float64) - whole.walls.curves.whole()
    ).max()
    assert 0.0 < off_m <= 0.02e-6


def test_rounding_at_many_parts_of_a_reduced_basis_does_not_add_up():
    rng = np.random.default_rng(0)
    rows = (
        rng.normal(size=(150, 70))
        * np.geomspace(1.0, 1e-6, 70)
        @ np.linalg.qr(rng.normal(size=(70, 70)))[0]
    )
    reduced = reduce_rows(rows, 1e-5)
    assert len(reduced.basis_kv) > 50
    assert np.abs(reduced.rows() - rows).max() <= 1e-5


@pytest.mark.parametrize("kind", STEP_TYPES)
def test_no_step_of_any_size_is_lost_by_differences_that_wrap_around(kind):
    ends = np.iinfo(kind)
    rng = np.random.default_rng(3)
    steps = rng.integers(ends.min, ends.max, (5 * 7 * 2, 6), dtype=kind, endpoint=True)
    steps[::3] = rng.choice(
        np.array([ends.min, -1, 0, 1, ends.max], dtype=kind), steps[::3].shape
    )

    for along in (1, 2, 7):
        stored = _differences(steps, along)
        assert (stored.shape, stored.dtype) == (
            (6, len(steps) // along, along),
            steps.dtype,
        )
        found = _summed(stored)
        assert found.dtype == steps.dtype
        np.testing.assert_array_equal(found, steps)


def test_a_library_that_is_too_large_or_cannot_be_stored_so_exactly_is_refused(
    library, tmp_path, monkeypatch
):
    for times in (30.0, 1e4):  # float32 rounds by more; the number of steps overflows
        with pytest.raises(
            InputError,
            match=(
                r"^(library: curves up to 0.379 would be off|values up to 126 cannot)"
            ),
        ):
            save_library(
                with_walls(
                    library,
                    curves=WholeCurves(
                        np.float32(times) * library.walls.curves.whole()
                    ),
                ),
                BytesIO(),
            )

    save_library(library, tmp_path / "library.npz")
    monkeypatch.setitem(
        KINDS, "model file", replace(KINDS["model file"], max_bytes=2**16)
    )

    with pytest.raises(InputError, match="make one of fewer thicknesses"):
        save_library(library, BytesIO())

    with pytest.raises(
        InputError, match=r"not a response library.*make one of fewer thicknesses"
    ):
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


def test_a_library_whose_steps_are_of_fewer_stiffenings_is_refused(tmp_path):
    path = tmp_path / "library.npz"
    save_library(made_up_library(), path)
    names = ("force_ratio_btpd", "displaced_btpd", "undented_btpbnc")
    again = {
        name: lambda values: np.concatenate([values, values[-1:]]) for name in names
    }
    edited(path, stiffening=lambda values: np.append(values, 60.0), **again)
    refused(path, "curves: steps")


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


def test_a_reduced_basis_that_does_not_fit_is_refused_in_one_line(library, tmp_path):
    path = tmp_path / "library.npz"
    cases = {
        "curves_error_m: 0.001": {
            "curves_error_m": lambda error: np.full_like(error, 1e-3)
        },
        "stiffness_error: nan": {
            "stiffness_error": lambda error: np.full_like(error, np.nan)
        },
        "curves_basis": {"curves_basis": lambda _: None},
        "curves_int16: int32": {"curves_int16": lambda steps: steps.astype(np.int32)},
        "curves: steps": {"curves_int8": lambda steps: steps[:-1]},
        "stiffness: steps": {"stiffness_basis": lambda basis: basis[1:]},
        "MiB": {
            name: lambda array: np.zeros(
                (0, 2**40, 1, 1) if array.ndim == 4 else (0, 16, 5), array.dtype
            )
            for name in ("curves_basis", "curves_int32", "curves_int16", "curves_int8")
        },
        "not finite": {"curves_basis": lambda basis: np.full_like(basis, 3e38)},
    }

    for said, changes in cases.items():
        save_library(library, path)
        edited(path, **changes)
        refused(path, said)
