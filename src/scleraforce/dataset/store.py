"""The data set on disk, written unit by unit, resumable, every array checked (`checked_store`).

The metadata of all samples is written first; a unit of work is one chunk of `slices`.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from hashlib import sha256
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from zarr.codecs import ZstdCodec

from scleraforce.checked_store import CheckedStore, create_array, is_readable
from scleraforce.dataset.modulus import CalibratedModulus
from scleraforce.dataset.plan import DatasetPlan
from scleraforce.errors import DatasetError
from scleraforce.study import Study, format_study, parse_study, study_hash

__all__ = ["Dataset", "complete_store", "create_store", "missing_units", "open_dataset", "write_unit"]

STORE = CheckedStore(
    noun="data set",
    command="generate",
    verb="generate",
    schema="scleraforce-dataset-1",
    required=frozenset({"complete", "study", "study_hash", "youngs_modulus_pa", "calibration", "versions"}),
    same=("study_hash", "youngs_modulus_pa", "mechanics", "calibration", "versions"),
    error=DatasetError,
)
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
        return STORE.read(STORE.array(STORE.open_group(self.path), self.path, name), self.path / name)


def open_dataset(path: str | PathLike[str]) -> Dataset:
    """Open a data set that `generate_dataset` has completed.

    Raises:
        DatasetError: nothing there, not a data set, not complete, or not consistent.
    """
    path = Path(path)
    group = STORE.open_group(path)
    attributes = STORE.complete_attributes(group, path)
    study = parse_study(str(attributes["study"]), f"{path}: study")
    # Of the text as it was written: a later version may know more keys, and format the same study differently.
    if sha256(attributes["study"].encode()).hexdigest() != attributes["study_hash"]:
        raise DatasetError(f"{path}: its study does not match its hash: the store is damaged; generate it again")
    images = sum(part.images for part in study.dataset.group)
    shapes = {SLICES: (images, study.slice.rows, study.slice.columns)} | dict.fromkeys(DTYPES, (images,))
    for name, shape in shapes.items():
        array = STORE.whole_array(group, path, name)
        dtype = DTYPES.get(name, "uint8")
        if array.shape != shape or array.dtype != np.dtype(dtype):
            raise DatasetError(f"{path / name}: {array.dtype} {array.shape}, expected {dtype} {shape}")
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
    group = STORE.begin(path, _describe(study, youngs_modulus_pa, calibration, mechanics))
    for name, values in plan.columns.items():  # the same bytes each time, so a run killed right here does no harm
        create_array(group, name, values.shape, values.shape, DTYPES[name])[:] = values
    if SLICES not in group:
        size = (study.slice.rows, study.slice.columns)
        chunk = (min(plan.unit_images, plan.images), *size)
        create_array(group, SLICES, (plan.images, *size), chunk, "uint8", ZstdCodec(level=3))


def missing_units(path: Path, plan: DatasetPlan) -> list[int]:
    """Return the units of work whose slices are not in the store, or cannot be read there."""
    slices, place = STORE.array(STORE.open_group(path), path, SLICES), path / SLICES
    return [unit for unit in range(plan.units) if not is_readable(slices, place, (unit,), plan.unit(unit))]


def write_unit(path: Path, plan: DatasetPlan, unit: int, images: NDArray[np.uint8]) -> None:
    """Write the slices of one unit of work, shape (samples of the unit, rows, columns)."""
    slices = STORE.array(STORE.open_group(path, "r+"), path, SLICES)
    slices.with_config({"write_empty_chunks": True})[plan.unit(unit)] = images  # what is missing is not done yet


def complete_store(path: Path, plan: DatasetPlan) -> None:
    """Mark the store as complete, and clear what killed runs have left beside their chunks.

    Raises:
        DatasetError: units are missing.
    """
    if missing := missing_units(path, plan):
        raise DatasetError(f"{path}: {len(missing)} of {plan.units} parts are missing; generate it again")
    STORE.finish(path)


def _describe(
    study: Study, youngs_modulus_pa: float, calibration: CalibratedModulus | None, mechanics: str
) -> dict[str, Any]:
    packages = ("scleraforce", "numpy", "scipy", "opencv-python-headless", "zarr")
    return {
        "study": format_study(study),
        "study_hash": study_hash(study),
        "seed": study.dataset.seed,
        "mechanics": mechanics,
        "youngs_modulus_pa": youngs_modulus_pa,
        "calibration": asdict(calibration) if calibration else None,
        "versions": {name: version(name) for name in packages},
    }
