"""The data set on disk, made by processes: identical, resumable, checked, and right."""

import multiprocessing
import os
import shutil
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import zarr
from effects import contents
from numcodecs import Zstd
from numcodecs.checksum32 import CRC32C
from small_models import rehash_store

from reference_walls import cut_section
from scleraforce.errors import DatasetError, SolverError
from scleraforce.learning.dataset import (
    CalibratedModulus,
    complete_dataset,
    create_dataset,
    missing_dataset_units,
    open_dataset,
    plan_dataset,
    write_dataset_unit,
)
from scleraforce.learning.generate import _simulating, generate_dataset
from scleraforce.mechanics.contact import Contact, ScanPlane
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.mesh import build_mesh
from scleraforce.mechanics.slices import fill_section, slice_window
from scleraforce.processes import work_units
from scleraforce.study import DatasetGroup, MeshStudy, Range, Study, format_study, parse_study

MODULUS_PA = 0.3e6


def small_study(seed=0):
    """Two thicknesses, 5 contacts each, every range open, units that split contacts and thicknesses."""
    study = Study(mesh=MeshStudy(divisions=4, level=1))
    dataset = replace(
        study.dataset,
        seed=seed,
        contacts=5,
        gap_m=Range(min=0.35e-3, max=1e-3),
        tilt_rad=Range(min=-0.1, max=0.1),
        direction_rad=Range(min=-1.0, max=1.0),
        framing_lateral_m=Range(min=-5e-4, max=5e-4),
        framing_depth_m=Range(min=-2e-4, max=2e-4),
        group=(
            DatasetGroup(thickness_m=5e-4, images=253, max_force_n=45e-3),
            DatasetGroup(thickness_m=8e-4, images=212, max_force_n=60e-3),
        ),
    )
    return parse_study(format_study(replace(study, dataset=dataset)))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A data set made by one worker."""
    path = tmp_path_factory.mktemp("made") / "dataset.zarr"
    done = []
    result = generate_dataset(small_study(), path, youngs_modulus_pa=MODULUS_PA, workers=1, progress=done.append)
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
        generate_dataset(small_study(), path, youngs_modulus_pa=MODULUS_PA, workers=2, progress=interrupt)
    assert not multiprocessing.active_children()
    kept = len(list((path / "slices" / "c").iterdir()))
    assert kept == 1
    with pytest.raises(DatasetError, match="not complete"):
        open_dataset(path)
    result = generate_dataset(small_study(), path, youngs_modulus_pa=MODULUS_PA, workers=2)
    assert result.simulated in (465 - 200, 465 - 65)
    assert contents(path) == contents(made)


@pytest.mark.slow
def test_a_sample_can_be_made_again_from_its_metadata_the_slow_way(made):
    dataset = open_dataset(made)
    study, columns = dataset.study, {name: dataset.read(name) for name in plan_dataset(dataset.study).columns}
    for sample in (0, 130, 252, 253, 464):
        row = {name: values[sample] for name, values in columns.items()}
        mesh = build_mesh(study.eye.radius_m, row["thickness_m"], 4, 1, 1, 2)
        wall = LinearWall(mesh, study.eye.poisson_ratio)
        contact = Contact(polar_rad=row["polar_rad"], azimuth_rad=row["azimuth_rad"])
        needle = wall.needle_cnc([contact], 0.35e-3)[0]
        plane = ScanPlane(contact, gap_m=row["gap_m"], direction_rad=row["direction_rad"], tilt_rad=row["tilt_rad"])
        loads = {"youngs_modulus_pa": MODULUS_PA, "iop_pa": study.eye.iop_pa, "density_kg_m3": 1100.0}
        resting, pushed = (
            cut_section(mesh, plane, wall.displacement(needle, force, **loads)) for force in (0.0, row["force_n"])
        )
        window = slice_window(study.slice, resting.outer[:, 1].min(), row["framing_lateral_m"], row["framing_depth_m"])
        wrong = np.count_nonzero(fill_section(pushed, window) != dataset.slices[sample])
        assert wrong <= 3  # pixels whose centres the curve passes within the micrometres between two sets of stations


def test_metadata_is_complete_and_is_the_plan(made):
    dataset = open_dataset(made)
    assert dataset.study == small_study()
    assert dataset.youngs_modulus_pa == MODULUS_PA
    assert dataset.attributes["seed"] == 0
    assert set(dataset.attributes["versions"]) >= {"scleraforce", "numpy", "zarr"}
    for name, values in plan_dataset(small_study()).columns.items():
        np.testing.assert_array_equal(dataset.read(name), values)
    training, validation = dataset.split()
    np.testing.assert_array_equal(np.sort(np.r_[training, validation]), np.arange(dataset.images))
    assert dataset.slices.shape == (465, 40, 140)
    assert set(np.unique(dataset.slices)) == {0, 255}


def test_every_array_is_zarr_3_with_crc(made):
    for array in made.glob("*/zarr.json"):
        text = array.read_text()
        assert '"zarr_format": 3' in text
        assert '"crc32c"' in text


@pytest.mark.parametrize("file", ["slices/c/1/0/0", "force_n/c/0", "validation/c/0"])
@pytest.mark.parametrize("where", [0, -1])
def test_a_flipped_byte_is_found_and_named(copy, file, where):
    chunk = copy / file
    data = bytearray(chunk.read_bytes())
    data[where] ^= 4
    chunk.write_bytes(data)
    with pytest.raises(DatasetError, match=str(chunk)):
        open_dataset(copy).read(file.split("/")[0])


def test_chunks_in_each_others_place_are_found(copy):
    swap(copy / "slices/c/0/0/0", copy / "slices/c/1/0/0")
    with pytest.raises(DatasetError, match="slices/c/0/0/0: damaged"):
        _ = open_dataset(copy).slices


@pytest.mark.parametrize(("one", "other"), [("gap_m", "force_n"), ("tilt_rad", "framing_depth_m")])
def test_arrays_in_each_others_place_are_found(copy, one, other):
    swap(copy / one, copy / other)
    with pytest.raises(DatasetError, match=f"{one}/c/0: damaged"):
        open_dataset(copy).read(one)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("force_n", np.nan, "not finite"),
        ("force_n", -1e-3, "-1 to .* mN; its study asks for 0 to 60 mN"),
        ("force_n", 0.1, "100 mN; its study asks for 0 to 60 mN"),
        ("thickness_m", np.inf, "not finite"),
        ("target", 3, "a class above 2"),
        ("slices", 128, "a pixel other than 0"),
    ],
)
def test_values_that_no_study_asks_for_are_refused_even_where_the_hashes_agree(copy, name, value, message):
    zarr.open_array(copy / name, mode="r+")[7] = value
    rehash_store(copy)
    with pytest.raises(DatasetError, match=f"{name}: .*{message}"):
        open_dataset(copy).read(name)


@pytest.mark.parametrize("file", ["zarr.json", "force_n/zarr.json", "slices/c/1/0/0"])
def test_a_pipe_or_a_device_within_a_data_set_is_refused(copy, file):
    (copy / file).unlink()
    os.mkfifo(copy / file)
    with pytest.raises(DatasetError, match=f"{file}: a named pipe"):
        _ = open_dataset(copy).slices
    (copy / file).unlink()
    (copy / file).symlink_to("/dev/zero")
    with pytest.raises(DatasetError, match=f"{file}: a device"):
        _ = open_dataset(copy).slices


def test_a_pipe_in_what_a_kill_has_left_is_refused(tmp_path):
    partial_store(tmp_path / "d")
    os.mkfifo(tmp_path / "d" / "slices" / "c")
    with pytest.raises(DatasetError, match="slices/c: neither a regular file nor a folder"):
        partial_store(tmp_path / "d")


def test_a_chunk_that_would_decode_to_more_than_a_chunk_takes_no_memory(copy):
    bomb = CRC32C(location="end").encode(Zstd().encode(np.zeros(2**28, np.uint8)))
    (copy / "slices/c/1/0/0").write_bytes(bomb)
    rehash_store(copy)
    with pytest.raises(DatasetError, match=r"slices/c/1/0/0: damaged .*would decode to 268435456"):
        _ = open_dataset(copy).slices


def swap(one, other):
    between = one.with_name("between")
    one.rename(between)
    other.rename(one)
    between.rename(other)


def test_a_missing_chunk_is_found(copy):
    (copy / "slices" / "c" / "2" / "0" / "0").unlink()
    with pytest.raises(DatasetError, match="slices: 1 of 3 chunks are missing"):
        open_dataset(copy)


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("zarr.json", '"complete": true', '"complete": false', "not complete"),
        ("zarr.json", "max_force_mn = 45.0", "max_force_mn = 46.0", "hash"),
        ("zarr.json", "scleraforce-dataset-2", "scleraforce-dataset-9", "schema"),
        ("zarr.json", "{", "", "not a data set"),
        ("force_n/zarr.json", "float64", "float32", "float32"),
        ("force_n/zarr.json", "{", "", "force_n"),
    ],
)
def test_a_store_that_is_not_what_it_says_is_refused(copy, file, old, new, message):
    text = (copy / file).read_text()
    assert old in text
    (copy / file).write_text(text.replace(old, new, 1))
    with pytest.raises(DatasetError, match=message):
        open_dataset(copy)


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


def partial_store(path, study=None, youngs_modulus_pa=MODULUS_PA, calibration=None):
    study = study or small_study()
    plan = plan_dataset(study)
    create_dataset(path, study, youngs_modulus_pa, calibration, plan)
    return plan


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"study": small_study(seed=1)}, "study_hash"),
        ({"youngs_modulus_pa": 0.31e6}, "youngs_modulus_pa"),
        ({"calibration": CalibratedModulus(MODULUS_PA, "linear", "c.json", "0" * 64)}, "calibration"),
    ],
)
def test_a_run_does_not_continue_another(tmp_path, change, message):
    partial_store(tmp_path / "d")
    with pytest.raises(DatasetError, match=message):
        partial_store(tmp_path / "d", **change)


def test_what_a_kill_leaves_is_taken_up(tmp_path):
    path = tmp_path / "d"
    plan = partial_store(path)
    for unit in range(plan.units):
        write_dataset_unit(
            path, plan, small_study(), unit, np.zeros((len(plan.force_n[plan.unit(unit)]), 40, 140), np.uint8)
        )
    chunk = path / "slices" / "c" / "1" / "0" / "0"
    chunk.write_bytes(chunk.read_bytes()[:50])  # a disk that lost power
    chunk.with_suffix(".1234.partial").write_bytes(b"half")
    shutil.rmtree(path / "force_n")  # killed while the metadata was written
    assert partial_store(path).units == plan.units
    assert missing_dataset_units(path, plan, small_study()) == [1]
    with pytest.raises(DatasetError, match="1 of 3 parts"):
        complete_dataset(path, plan, small_study())
    write_dataset_unit(path, plan, small_study(), 1, np.zeros((200, 40, 140), np.uint8))
    complete_dataset(path, plan, small_study())
    assert not list(path.rglob("*.partial"))
    assert open_dataset(path).images == 465


def test_a_calibration_is_recorded(tmp_path):
    path = tmp_path / "d"
    partial_store(path, calibration=CalibratedModulus(MODULUS_PA, "linear", "eyes.json", "ab" * 32))
    assert zarr.open_group(path, mode="r").attrs["calibration"] == {
        "youngs_modulus_pa": MODULUS_PA,
        "mechanics": "linear",
        "path": "eyes.json",
        "sha256": "ab" * 32,
    }


@pytest.mark.slow
def test_a_fault_in_a_worker_reaches_the_caller():
    study = small_study()
    steep = replace(
        study, needle=replace(study.needle, outer_diameter_m=5e-3, polar_angle_rad=Range(min=1.39, max=1.396))
    )
    with (
        closing(work_units(partial(_simulating, steep, MODULUS_PA), [0], 1)) as results,
        pytest.raises(Exception, match="over the base"),
    ):
        next(results)


@pytest.mark.slow
def test_a_worker_that_dies_is_an_error_and_not_a_hang():
    with closing(work_units(partial(_simulating, small_study(), MODULUS_PA), [0, 1], 1)) as results:
        next(results)
        multiprocessing.active_children()[0].kill()
        with pytest.raises(SolverError, match="worker ended"):
            next(results)


def test_a_relative_path_may_be_named_like_an_array(made, tmp_path, monkeypatch):
    shutil.copytree(made, tmp_path / "slices")
    monkeypatch.chdir(tmp_path)
    assert open_dataset(Path("slices")).slices.shape == open_dataset(made).slices.shape
