"""The data set on disk: a Zarr 3 group, every array checked by CRC-32C, written unit by unit, and resumable.

The metadata of all samples is written first; a unit of work is one chunk of `slices`. Zarr writes a chunk to a
temporary name and renames it, so a chunk that exists is whole, and a killed run still has to do what is missing.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.abc.codec import BytesBytesCodec
from zarr.codecs import Crc32cCodec, ZstdCodec

from scleraforce.dataset.modulus import CalibratedModulus
from scleraforce.dataset.plan import DatasetPlan
from scleraforce.errors import DatasetError
from scleraforce.study import Study, format_study, parse_study, study_hash

__all__ = ["Dataset", "complete_store", "create_store", "missing_units", "open_dataset", "write_unit"]

SCHEMA = "scleraforce-dataset-1"
SLICES = "slices"
DTYPES = {
    "force_n": "float64",
    "target": "uint8",
    "thickness_m": "float64",
    "contact": "int32",
    "polar_rad": "float64",
    "azimuth_rad": "float64",
    "gap_m": "float64",
    "tilt_rad": "float64",
    "direction_rad": "float64",
    "framing_lateral_m": "float64",
    "framing_depth_m": "float64",
    "validation": "bool",
    "seed": "uint32",
}


@dataclass(frozen=True)
class Dataset:
    """A complete data set, checked on opening; its arrays are read on first use.

    Attributes:
        path: the store.
        study: the study that it was made from.
        youngs_modulus_pa: Young's modulus of the simulated walls.
        attributes: everything else that the store says about itself (seed, versions, calibration ...).
    """

    path: Path
    study: Study
    youngs_modulus_pa: float
    attributes: Mapping[str, Any]

    @cached_property
    def slices(self) -> NDArray[np.uint8]:
        """The slices, shape (samples, rows, columns), 255 = wall."""
        return self.read(SLICES)

    @cached_property
    def force_n(self) -> NDArray[np.float64]:
        """The force of the needle, shape (samples,)."""
        return self.read("force_n")

    @cached_property
    def target(self) -> NDArray[np.uint8]:
        """The class of the force, shape (samples,)."""
        return self.read("target")

    @property
    def images(self) -> int:
        """Number of samples."""
        return len(self.force_n)

    def split(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the numbers of the training and of the validation samples; they share no contact."""
        validation = self.read("validation")
        return np.flatnonzero(~validation), np.flatnonzero(validation)

    def read(self, name: str) -> NDArray[Any]:
        """Read a whole array: `slices` or a name of the metadata.

        Raises:
            DatasetError: there is no such array, or a part of it is missing or damaged.
        """
        return _read(_array(_open_group(self.path), self.path, name), self.path / name)


def open_dataset(path: Path) -> Dataset:
    """Open a data set that `generate_dataset` has completed.

    Raises:
        DatasetError: nothing there, not a data set, not complete, or not consistent.
    """
    group = _open_group(path)
    attributes = _attributes(group, path)
    if attributes["complete"] is not True:
        raise DatasetError(f"{path}: not complete; the same `scleraforce generate` completes it")
    study = parse_study(str(attributes["study"]), f"{path}: study")
    # Of the text as it was written: a later version may know more keys, and format the same study differently.
    if sha256(attributes["study"].encode()).hexdigest() != attributes["study_hash"]:
        raise DatasetError(f"{path}: its study does not match its hash: the store is damaged; generate it again")
    images = sum(part.images for part in study.dataset.group)
    shapes = {SLICES: (images, study.slice.rows, study.slice.columns)} | dict.fromkeys(DTYPES, (images,))
    for name, shape in shapes.items():
        _check_array(_array(group, path, name), shape, path / name)
    return Dataset(path, study, float(attributes["youngs_modulus_pa"]), attributes)


def create_store(
    path: Path,
    study: Study,
    youngs_modulus_pa: float,
    calibration: CalibratedModulus | None,
    plan: DatasetPlan,
    mechanics: str = "linear",
) -> None:
    """Create the store with all metadata and no slices, or take up what a killed run of the same study has left.

    Raises:
        DatasetError: `path` holds something else, another run, or a complete data set.
    """
    attributes = _describe(study, youngs_modulus_pa, calibration, mechanics)
    group = _continued(path, attributes) if _occupied(path) else _create_group(path, attributes)
    for name, values in plan.columns.items():  # the same bytes each time, so a run killed right here does no harm
        _create_array(group, name, values.shape, values.shape, [Crc32cCodec()])[:] = values
    if SLICES not in group:
        size = (study.slice.rows, study.slice.columns)
        chunk = (min(plan.unit_images, plan.images), *size)
        _create_array(group, SLICES, (plan.images, *size), chunk, [ZstdCodec(level=3), Crc32cCodec()])


def missing_units(path: Path, plan: DatasetPlan) -> list[int]:
    """Return the units of work whose slices are not in the store, or cannot be read there."""
    slices = _array(_open_group(path), path, SLICES)
    return [unit for unit in range(plan.units) if not (_chunk(path, unit).exists() and _readable(slices, plan, unit))]


def write_unit(path: Path, plan: DatasetPlan, unit: int, images: NDArray[np.uint8]) -> None:
    """Write the slices of one unit of work, shape (samples of the unit, rows, columns)."""
    slices = _array(zarr.open_group(path.absolute(), mode="r+", zarr_format=3), path, SLICES)
    slices.with_config({"write_empty_chunks": True})[plan.unit(unit)] = images  # what is missing is not done yet


def complete_store(path: Path, plan: DatasetPlan) -> None:
    """Mark the store as complete, and clear what killed runs have left beside their chunks.

    Raises:
        DatasetError: units are missing.
    """
    if missing := missing_units(path, plan):
        raise DatasetError(f"{path}: {len(missing)} of {plan.units} parts are missing; generate it again")
    for leftover in path.rglob("*.partial"):
        leftover.unlink(missing_ok=True)
    zarr.open_group(path.absolute(), mode="r+", zarr_format=3).attrs["complete"] = True


def _describe(
    study: Study, youngs_modulus_pa: float, calibration: CalibratedModulus | None, mechanics: str
) -> dict[str, Any]:
    packages = ("scleraforce", "numpy", "scipy", "opencv-python-headless", "zarr")
    return {
        "schema": SCHEMA,
        "complete": False,
        "study": format_study(study),
        "study_hash": study_hash(study),
        "seed": study.dataset.seed,
        "mechanics": mechanics,
        "youngs_modulus_pa": youngs_modulus_pa,
        "calibration": asdict(calibration) if calibration else None,
        "versions": {name: version(name) for name in packages},
    }


def _occupied(path: Path) -> bool:
    """Whether something stands at `path`; an empty directory, or one with a killed run's temporary file, is free."""
    if not path.exists():
        return False
    return not path.is_dir() or any(entry.suffix != ".partial" for entry in path.iterdir())


def _create_group(path: Path, attributes: dict[str, Any]) -> zarr.Group:
    try:
        path.mkdir(parents=True, exist_ok=True)
        return zarr.create_group(path.absolute(), zarr_format=3, attributes=attributes)
    except OSError as fault:
        raise DatasetError(f"{path}: {fault.strerror}") from fault


def _continued(path: Path, attributes: Mapping[str, Any]) -> zarr.Group:
    """Open the store of a killed run that the run of `attributes` may complete."""
    try:
        found = _attributes(_open_group(path), path)
    except DatasetError as fault:
        raise DatasetError(f"{path}: holds something else than a data set; choose another path") from fault
    if found["complete"]:
        raise DatasetError(f"{path}: a complete data set; remove it or choose another path")
    for name in ("study_hash", "youngs_modulus_pa", "mechanics", "calibration", "versions"):
        if found.get(name) != attributes[name]:
            raise DatasetError(f"{path}: begun with another {name}; remove it or choose another path")
    return zarr.open_group(path.absolute(), mode="r+", zarr_format=3)


def _create_array(
    group: zarr.Group, name: str, shape: tuple[int, ...], chunks: tuple[int, ...], codecs: list[BytesBytesCodec]
) -> zarr.Array[Any]:
    return group.create_array(
        name,
        shape=shape,
        chunks=chunks,
        dtype=DTYPES.get(name, "uint8"),
        filters=None,
        compressors=codecs,
        config={"write_empty_chunks": True},
        overwrite=True,
    )


def _open_group(path: Path) -> zarr.Group:
    if not path.is_dir():
        raise DatasetError(f"{path}: no such data set; `scleraforce generate --out {path}` makes one")
    try:
        return zarr.open_group(path.absolute(), mode="r", zarr_format=3)
    except (OSError, ValueError, KeyError, TypeError) as fault:
        raise DatasetError(f"{path}: not a data set of scleraforce: {fault}") from fault


def _attributes(group: zarr.Group, path: Path) -> dict[str, Any]:
    attributes = dict(group.attrs)
    if attributes.get("schema") != SCHEMA:
        raise DatasetError(f"{path}: schema {attributes.get('schema')!r}; this version reads {SCHEMA!r}")
    wanted = {"complete", "study", "study_hash", "youngs_modulus_pa", "calibration", "versions"}
    if missing := wanted - attributes.keys():
        raise DatasetError(f"{path}: attributes {', '.join(sorted(missing))} are missing; generate it again")
    return attributes


def _array(group: zarr.Group, path: Path, name: str) -> zarr.Array[Any]:
    try:
        array = group[name]
    except (OSError, ValueError, KeyError, TypeError) as fault:
        raise DatasetError(f"{path / name}: the array is missing or its zarr.json is damaged") from fault
    if not isinstance(array, zarr.Array):
        raise DatasetError(f"{path / name}: not an array")
    return array


def _check_array(array: zarr.Array[Any], shape: tuple[int, ...], place: Path) -> None:
    """Check shape, type, checksums and that no chunk is missing (Zarr would read it as zeros)."""
    dtype = DTYPES.get(place.name, "uint8")
    if array.shape != shape or array.dtype != np.dtype(dtype):
        raise DatasetError(f"{place}: {array.dtype} {array.shape}, expected {dtype} {shape}")
    if not any(isinstance(codec, Crc32cCodec) for codec in array.compressors):
        raise DatasetError(f"{place}: without checksums; generate it again")
    if array.nchunks_initialized != array.nchunks:
        missing = array.nchunks - array.nchunks_initialized
        raise DatasetError(f"{place}: {missing} of {array.nchunks} chunks are missing; generate it again")


def _read(array: zarr.Array[Any], place: Path) -> NDArray[Any]:
    try:
        return np.asarray(array[:])
    except Exception as fault:  # whatever a codec raises, the array cannot be read
        raise DatasetError(f"{_damaged(array, place)}: damaged ({fault}); generate the data set again") from fault


def _damaged(array: zarr.Array[Any], place: Path) -> Path:
    """Return the file of the first chunk that cannot be read."""
    for chunk in range(array.nchunks):
        try:
            array[chunk * array.chunks[0] : (chunk + 1) * array.chunks[0]]
        except Exception:  # as above
            return place.joinpath("c", str(chunk), *["0"] * (array.ndim - 1))
    return place


def _chunk(path: Path, unit: int) -> Path:
    """File of a unit's chunk (Zarr 3 specification, default chunk keys)."""
    return path / SLICES / "c" / str(unit) / "0" / "0"


def _readable(slices: zarr.Array[Any], plan: DatasetPlan, unit: int) -> bool:
    try:
        slices[plan.unit(unit)]
    except Exception:  # whatever a codec raises, the unit has to be made again
        return False
    return True
