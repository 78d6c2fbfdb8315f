"""Data sets: the plan, the store, slices of linear mechanics and of the library."""

import hashlib
import multiprocessing
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zarr
from analytic_library import analytic_library
from effects import contents, less_than
from numcodecs import Zstd
from numcodecs.checksum32 import CRC32C
from scipy import stats
from small_models import rehash_store
from small_recordings import calibration_text

from reference_walls import cut_section
from scleraforce.base.errors import DatasetError, InputError, StudyError
from scleraforce.base.whole_files import MIB
from scleraforce.lab.training.slice_dataset import (
    SLICES,
    create_dataset,
    generate_dataset,
    open_dataset,
    plan_dataset,
    unit_samples,
)
from scleraforce.library.plane_cut import cut_surfaces
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.mechanics.mesh_section import fill_section, slice_window
from scleraforce.records import study as st
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.study import Range, Study, format_study, parse_study

RANGES = (
    Range(min=0.35e-3, max=1e-3),
    Range(min=-0.1, max=0.1),
    Range(min=-2e-4, max=2e-4),
)
OPEN = dict(zip(("gap_m", "tilt_rad", "framing_depth_m"), RANGES, strict=True))
PAPER = Study()


def with_dataset(study=PAPER, **changes):
    return replace(study, dataset=replace(study.dataset, **changes))


@pytest.fixture(scope="module")
def paper():
    return plan_dataset(Study())


def test_every_thickness_has_200_contacts_of_its_own_and_a_tenth_of_them_for_validation(
    paper,
):
    assert not set(paper.contact[paper.validation]) & set(
        paper.contact[~paper.validation]
    )
    for thickness in np.unique(paper.thickness_m):
        of_wall = paper.thickness_m == thickness
        assert len(np.unique(paper.contact[of_wall])) == 200
        assert paper.validation[of_wall].mean() == pytest.approx(0.1)

    starts = np.flatnonzero(np.diff(paper.contact, prepend=-1))
    assert len(starts) == 1000
    assert all(unit.start in starts for unit in unit_samples(Study()))


def test_forces_and_contacts_are_uniform_and_targets_are_the_classes_of_the_forces(
    paper,
):
    for thickness, largest in [(4e-4, 45e-3), (5e-4, 60e-3), (8e-4, 60e-3)]:
        force = paper.force_n[np.isclose(paper.thickness_m, thickness)]
        assert stats.kstest(force / largest, "uniform").pvalue > 0.01

    _, first = np.unique(paper.contact, return_index=True)
    polar = (np.rad2deg(paper.polar_rad[first]) - 25.0) / 20.0
    assert stats.kstest(polar, "uniform").pvalue > 0.01
    assert stats.kstest(paper.azimuth_rad[first] / (2 * np.pi), "uniform").pvalue > 0.01
    expected = np.where(paper.force_n < 5e-3, 0, np.where(paper.force_n > 30e-3, 2, 1))
    np.testing.assert_array_equal(paper.target, expected)
    assert set(paper.gap_m) == {0.5e-3}
    assert not np.any(paper.framing_lateral_m)


MODULUS_PA = 0.3e6


def small_study(seed=0):
    """Two thicknesses, 5 contacts each, every range open, units that split contacts and
    thicknesses.
    """
    study = with_dataset(
        Study(mesh=st.MeshStudy(divisions=4, level=1)),
        seed=seed,
        contacts=5,
        direction_rad=Range(min=-1.0, max=1.0),
        framing_lateral_m=Range(min=-5e-4, max=5e-4),
        group=(
            st.DatasetGroup(thickness_m=5e-4, images=253, max_force_n=45e-3),
            st.DatasetGroup(thickness_m=8e-4, images=212, max_force_n=60e-3),
        ),
        **OPEN,
    )
    return parse_study(format_study(study))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A data set made by one worker."""
    path = tmp_path_factory.mktemp("made") / "dataset.zarr"
    done = []
    result = generate_dataset(
        small_study(),
        path,
        youngs_modulus_pa=MODULUS_PA,
        workers=1,
        progress=done.append,
    )
    assert (result.images, result.simulated, sum(done)) == (465, 465, 465)

    return path


@pytest.fixture
def copy(made, tmp_path):
    """A data set that a test may damage."""
    return Path(shutil.copytree(made, tmp_path / "copy"))


@pytest.mark.slow
def test_two_workers_and_an_interruption_change_no_byte(made, tmp_path):
    path = tmp_path / "dataset.zarr"

    def interrupt(done: int) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        generate_dataset(
            small_study(),
            path,
            youngs_modulus_pa=MODULUS_PA,
            workers=2,
            progress=interrupt,
        )

    assert not multiprocessing.active_children()
    kept = len(list((path / "slices" / "c").iterdir()))
    assert kept == 1
    with pytest.raises(DatasetError, match="not complete"):
        open_dataset(path)

    result = generate_dataset(
        small_study(), path, youngs_modulus_pa=MODULUS_PA, workers=2
    )
    assert result.simulated in (465 - 200, 465 - 65)
    assert contents(path) == contents(made)


PLANNED = (
    "thickness_m",
    "polar_rad",
    "azimuth_rad",
    "direction_rad",
    "gap_m",
    "tilt_rad",
    "force_n",
    "framing_lateral_m",
    "framing_depth_m",
)


@pytest.mark.slow
@pytest.mark.parametrize("sample", [0, 130, 252, 253, 464])
def test_a_sample_can_be_made_again_from_its_metadata_the_slow_way(made, sample):
    dataset = open_dataset(made)
    study = dataset.study
    row = {name: dataset.read(name)[sample] for name in PLANNED}
    mesh = build_mesh(study.eye.radius_m, row["thickness_m"], 4, 1, 1, 2)
    wall = LinearWall(mesh, study.eye.poisson_ratio)
    contact = Contact(polar_rad=row["polar_rad"], azimuth_rad=row["azimuth_rad"])
    needle = wall.needle_cnc([contact], 0.35e-3)[0]
    place = {name: row[name] for name in ("gap_m", "direction_rad", "tilt_rad")}
    loads = {
        "youngs_modulus_pa": MODULUS_PA,
        "iop_pa": study.eye.iop_pa,
        "density_kg_m3": 1100.0,
    }
    resting, pushed = (
        cut_section(
            mesh,
            ScanPlane(contact, **place),
            wall.displacement(needle, force_n, **loads),
        )
        for force_n in (0.0, row["force_n"])
    )
    window = slice_window(
        study.slice,
        resting.outer[:, 1].min(),
        row["framing_lateral_m"],
        row["framing_depth_m"],
    )
    wrong = np.count_nonzero(fill_section(pushed, window) != dataset.slices[sample])
    # pixels whose centres the curve passes within the micrometres between two sets of
    # stations
    assert wrong <= 3


def test_metadata_is_complete_and_is_the_plan(made):
    dataset = open_dataset(made)
    found = dataset.study, dataset.youngs_modulus_pa, dataset.attributes["seed"]
    assert found == (small_study(), MODULUS_PA, 0)

    for name, values in vars(plan_dataset(small_study())).items():
        np.testing.assert_array_equal(dataset.read(name), values)

    training, validation = dataset.split()
    assert len(validation) * 4 == len(training)  # a contact of five
    np.testing.assert_array_equal(
        np.sort(np.r_[training, validation]), np.arange(dataset.images)
    )


def flipped(content: bytes, place: int) -> bytes:
    return content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :]


@pytest.mark.parametrize(
    ("file", "damaged", "message"),
    [
        ("slices/c/1/0/0", lambda held: flipped(held, 0), "slices/c/1/0/0"),
        ("validation/c/0", lambda held: flipped(held, len(held) - 2), "validation/c/0"),
        (
            "zarr.json",
            lambda held: held.replace(b'"complete": true', b'"complete": false'),
            "not complete",
        ),
        (
            "zarr.json",
            lambda held: held.replace(b"max_force_mn = 45.0", b"max_force_mn = 46.0"),
            "hash",
        ),
        (
            "zarr.json",
            lambda held: held.replace(b"dataset-2", b"dataset-9"),
            "schema",
        ),
        ("zarr.json", lambda held: held[1:], "not a data set"),
        ("slices/c/2/0/0", None, "slices/c/2/0/0: No such file"),
    ],
)
def test_a_damaged_store_is_refused_and_the_damage_named(copy, file, damaged, message):
    held = (copy / file).read_bytes()
    (copy / file).unlink()
    if damaged is not None:
        (copy / file).write_bytes(damaged(held))

    with pytest.raises(DatasetError, match=message):
        read_all(copy)


def read_all(path):
    dataset = open_dataset(path)
    return [dataset.read(name) for name in sorted(zarr.open_group(path, mode="r"))]


@pytest.mark.parametrize(
    ("one", "other"), [("slices/c/0/0/0", "slices/c/1/0/0"), ("gap_m", "force_n")]
)
def test_chunks_and_arrays_in_each_others_place_are_found(copy, one, other):
    between = (copy / one).rename(copy / "between")
    (copy / other).rename(copy / one)
    between.rename(copy / other)
    with pytest.raises(DatasetError, match=f"({one}|{other}).*: damaged"):
        read_all(copy)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("force_n", np.nan, "not finite"),
        ("force_n", -1e-3, "-1 to .* mN; its study asks for 0 to 60 mN"),
        ("thickness_m", np.inf, "not finite"),
        ("target", 3, "a class above 2"),
        ("slices", 128, "a pixel other than 0"),
    ],
)
def test_impossible_values_are_refused_even_where_the_hashes_agree(
    copy, name, value, message
):
    zarr.open_array(copy / name, mode="r+")[7] = value
    rehash_store(copy)
    with pytest.raises(DatasetError, match=f"{name}: .*{message}"):
        open_dataset(copy).read(name)


def test_a_special_file_within_a_begun_data_set_is_refused(tmp_path):
    partial_store(tmp_path / "d")
    os.mkfifo(tmp_path / "d" / "slices" / "c")
    with pytest.raises(DatasetError, match="slices/c/0/0/0: "):
        partial_store(tmp_path / "d").write(0, blank(200))


@pytest.mark.parametrize(
    ("bomb", "damage"),
    [
        (Zstd().encode(np.zeros(2**28, np.uint8)), "at least 268435456, got 1120000"),
        (
            240 * bytes(Zstd().encode(np.zeros((200, 40, 140), np.uint8))),
            "at least 268800000, got 1120000",
        ),
        # 2**17 zeros, 2048 times; it states no size
        (
            bytes.fromhex("28b52ffd0058" + 2047 * "02001000" + "03001000"),
            "buffer is too small",
        ),
    ],
    ids=["one", "many", "no size"],
)
def test_a_chunk_that_would_decode_to_more_than_a_chunk_takes_no_memory(
    copy, bomb, damage
):
    (copy / "slices/c/1/0/0").write_bytes(CRC32C(location="end").encode(bomb))
    rehash_store(copy)
    with (
        less_than(32 * MIB),
        pytest.raises(DatasetError, match=rf"slices/c/1/0/0: damaged .*{damage}"),
    ):
        _ = open_dataset(copy).slices


def test_no_store_another_thing_and_a_complete_store_are_refused(made, tmp_path):
    with pytest.raises(DatasetError, match="no such data set"):
        open_dataset(tmp_path / "nothing")

    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "todo.txt").write_text("x")
    with pytest.raises(DatasetError, match="something else"):
        generate_dataset(small_study(), tmp_path / "notes")

    before = contents(made)
    with pytest.raises(DatasetError, match="complete data set"):
        generate_dataset(small_study(), made, youngs_modulus_pa=MODULUS_PA)

    assert contents(made) == before


def blank(count):
    return {SLICES: np.zeros((count, 40, 140), np.uint8)}


def partial_store(path, study=None, youngs_modulus_pa=MODULUS_PA, calibration=None):
    study = study or small_study()
    return create_dataset(
        path, study, youngs_modulus_pa, calibration, plan_dataset(study)
    )


def test_a_run_does_not_continue_another_and_records_its_calibration(tmp_path):
    file = tmp_path / "calibration.json"
    file.write_text(calibration_text(0.27, mechanics="linear"))
    calibration = read_calibration(file)
    partial_store(tmp_path / "d", calibration=calibration)
    assert zarr.open_group(tmp_path / "d", mode="r").attrs["calibration"] == {
        "youngs_modulus_pa": pytest.approx(0.27e6),
        "mechanics": "linear",
        "path": str(file),
        "sha256": hashlib.sha256(file.read_bytes()).hexdigest(),
    }

    for name, other in {
        "study": small_study(seed=1),
        "youngs_modulus_pa": 0.31e6,
        "calibration": None,
    }.items():
        with pytest.raises(DatasetError, match=f"another {name}"):
            partial_store(tmp_path / "d", **{"calibration": calibration, name: other})


def test_the_units_before_a_kill_are_reused(tmp_path):
    path = tmp_path / "d"
    store = partial_store(path)

    for unit, samples in enumerate(unit_samples(small_study())):
        store.write(unit, blank(samples.stop - samples.start))

    chunk = path / "slices" / "c" / "1" / "0" / "0"
    chunk.write_bytes(chunk.read_bytes()[:50])  # a disk that lost power
    chunk.with_suffix(".1234.part").write_bytes(b"half")
    shutil.rmtree(path / "force_n")  # killed while the metadata was written
    store = partial_store(path)
    assert store.missing() == [1]

    with pytest.raises(DatasetError, match="1 of 3 parts"):
        store.finish()

    store.write(1, blank(200))
    store.finish()
    assert not list(path.rglob("*.part"))
    assert open_dataset(path).images == 465


@pytest.fixture(scope="module")
def library():
    return analytic_library()


@pytest.fixture(scope="module")
def study():
    walls = (5e-4, 250, 30e-3), (8e-4, 200, 50e-3)
    group = tuple(
        st.DatasetGroup(thickness_m=t, images=n, max_force_n=most_n)
        for t, n, most_n in walls
    )
    lateral_m = Range(min=-1e-3, max=1e-3)

    return parse_study(
        format_study(
            with_dataset(contacts=5, framing_lateral_m=lateral_m, group=group, **OPEN)
        )
    )


def one_by_one(dataset, library, sample):
    """Cut and fill one sample as a section is cut and filled anywhere else."""
    study = dataset.study
    row = {name: float(dataset.read(name)[sample]) for name in PLANNED}
    beside = library.for_contact(row["polar_rad"])
    walls = np.array([[row["thickness_m"]], [study.eye.iop_pa / MODULUS_PA]])
    resting, loaded = (
        cut_surfaces(
            beside.curves(*walls, np.array([force_n / MODULUS_PA])).curves_sbnc[0],
            row["gap_m"],
            row["tilt_rad"],
        )
        for force_n in (0.0, row["force_n"])
    )
    window = slice_window(
        study.slice,
        float(resting.outer[:, 1].min()),
        row["framing_lateral_m"],
        row["framing_depth_m"],
    )
    return fill_section(loaded, window)


@pytest.mark.slow
def test_slices_equal_cutting_and_filling_one_by_one(study, library, tmp_path):
    made = {"youngs_modulus_pa": MODULUS_PA, "library": library}
    generate_dataset(study, tmp_path / "d", **made)
    dataset = open_dataset(tmp_path / "d")
    differing = [
        int((dataset.slices[sample] != one_by_one(dataset, library, sample)).sum())
        for sample in range(200, 225)
    ]
    assert max(differing) <= 2  # pixels of 5,600: centres on a boundary, to 2 um
    assert np.mean(differing) < 0.4


def test_slices_of_a_library_are_stored_with_their_mechanics(study, library, tmp_path):
    made = {"youngs_modulus_pa": MODULUS_PA, "library": library}
    result = generate_dataset(study, tmp_path / "d", **made)
    dataset = open_dataset(tmp_path / "d")
    assert (result.images, result.simulated) == (450, 450)
    assert dataset.attributes["mechanics"] == "finite-strain"
    assert dataset.slices.any(axis=(1, 2)).all()


@pytest.mark.parametrize(
    ("changes", "error", "said"),
    [
        ({"eye": st.EyeStudy(radius_m=11e-3)}, DatasetError, "library: radius"),
        (
            {"globe": st.GlobeStudy("sealed")},
            StudyError,
            "globe.kind: not used by `generate` with finite-strain mechanics",
        ),
    ],
)
def test_a_library_of_another_eye_and_other_mechanics_are_refused(
    study, library, tmp_path, changes, error, said
):
    with pytest.raises(error, match=said):
        generate_dataset(replace(study, **changes), tmp_path / "d", library=library)

    assert not list(tmp_path.iterdir())


def test_a_force_beyond_the_library_is_named(study, library, tmp_path):
    soft = {"youngs_modulus_pa": 0.05e6, "library": library}
    with pytest.raises(
        InputError,
        match=r"F/E: .* mm\^2 is outside the library's range, 0 to 0\.5 mm\^2",
    ):
        generate_dataset(study, tmp_path / "d", **soft)
