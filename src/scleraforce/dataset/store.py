"""The data set on disk, written unit by unit, resumable, every array checked (`checked_store`).

The metadata of all samples is written first; a unit of work is one chunk of `slices`. What is read has to be possible:
forces that the study asks for, their classes, slices of wall and no wall.
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

from scleraforce.checked_store import CheckedStore, StoredArray
from scleraforce.dataset.modulus import CalibratedModulus
from scleraforce.dataset.plan import DatasetPlan, unit_images
from scleraforce.errors import DatasetError
from scleraforce.study import Study, format_study, parse_study, study_hash
from scleraforce.units import from_si

STORE = CheckedStore(
    noun="data set",
    command="generate",
    verb="generate",
    schema="scleraforce-dataset-2",
    required=frozenset({"complete", "study", "study_hash", "youngs_modulus_pa", "calibration", "versions"}),
    same=("study_hash", "youngs_modulus_pa", "mechanics", "calibration", "versions"),
    others={"scleraforce-library": "a response library and no data set; `train --kind reader` learns from it"},
    error=DatasetError,
)
SLICES = "slices"
MAX_MODULUS_PA = 1e12
SLACK = 1e-12
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
            DatasetError: there is no such array, a part of it is missing or damaged, or it has impossible values.
        """
        arrays = {array.name: array for array in _arrays(self.study)}
        if name not in arrays:
            raise DatasetError(f"{self.path}: no array {name!r}; there are {', '.join(arrays)}")
        values = STORE.read(self.path, self.attributes, arrays[name])
        if wrong := _impossible(name, values, self.study):
            raise DatasetError(f"{self.path / name}: {wrong}; generate the data set again")
        return values


def open_dataset(path: str | PathLike[str]) -> Dataset:
    """Open a data set that `generate_dataset` has completed.

    Raises:
        DatasetError: nothing there, not a data set, not complete, or not consistent.
        StudyError: its study cannot be used.

    >>> import scleraforce as sf
    >>> sf.open_dataset("dataset").images
    200
    """
    path = Path(path)
    attributes = STORE.complete_attributes(path)
    text, modulus_pa = attributes["study"], attributes["youngs_modulus_pa"]
    # Of the text as it was written: a later version may know more keys, and format the same study differently.
    if not isinstance(text, str) or sha256(text.encode()).hexdigest() != attributes["study_hash"]:
        raise DatasetError(f"{path}: its study does not match its hash: the store is damaged; generate it again")
    if isinstance(modulus_pa, bool) or not isinstance(modulus_pa, int | float) or not 0.0 < modulus_pa < MAX_MODULUS_PA:
        raise DatasetError(f"{path}: youngs_modulus_pa: {str(modulus_pa)[:60]}; must be a number of Pa above 0")
    study = parse_study(text, f"{path}: study")
    for array in _arrays(study):
        STORE.check_array(path, attributes, array)
    return Dataset(path, study, float(modulus_pa), attributes)


def _arrays(study: Study) -> tuple[StoredArray, ...]:
    """Return the arrays of a data set: the slices, a unit of work in each chunk, and the metadata of all samples."""
    images = sum(part.images for part in study.dataset.group)
    size = (study.slice.rows, study.slice.columns)
    slices = StoredArray(SLICES, (images, *size), (min(unit_images(study), images), *size), "uint8", compressed=True)
    return (slices, *(StoredArray(name, (images,), (images,), dtype) for name, dtype in DTYPES.items()))


def _impossible(name: str, values: NDArray[Any], study: Study) -> str | None:
    """Return what no sample of a study has; None where all is possible."""
    if name == SLICES:
        return "a pixel other than 0 (no wall) and 255 (wall)" if (values + np.uint8(1) > 1).any() else None
    if name == "validation":
        return "a value other than true and false" if (values.view(np.uint8) > 1).any() else None
    if name == "target":
        return f"a class above {len(study.classes.bounds_n)}" if values.max() > len(study.classes.bounds_n) else None
    if not np.isfinite(values).all():
        return "a value that is not finite"
    if name == "force_n":
        largest_n = max(group.max_force_n for group in study.dataset.group)
        if values.min() < 0.0 or values.max() > largest_n * (1.0 + SLACK):
            found = f"{from_si(values.min(), 'mn'):g} to {from_si(values.max(), 'mn'):g} mN"
            return f"{found}; its study asks for 0 to {from_si(largest_n, 'mn'):g} mN"
    return None


def create_dataset(
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
    described = _describe(study, youngs_modulus_pa, calibration, mechanics)
    STORE.begin(path, described, _arrays(study), plan.columns)


def missing_dataset_units(path: Path, plan: DatasetPlan, study: Study) -> list[int]:
    """Return the units of work whose slices are not in the store, or cannot be read there."""
    slices, *_ = _arrays(study)
    return [unit for unit in range(plan.units) if not STORE.is_readable(path, slices, (unit,))]


def write_dataset_unit(path: Path, plan: DatasetPlan, study: Study, unit: int, images: NDArray[np.uint8]) -> None:
    """Write the slices of one unit of work, shape (samples of the unit, rows, columns).

    Raises:
        DatasetError: the folder cannot be written to, or the disk is full.
    """
    slices, *_ = _arrays(study)
    STORE.write(path, slices, plan.unit(unit), images)


def complete_dataset(path: Path, plan: DatasetPlan, study: Study) -> None:
    """Mark the store as complete, and clear what killed runs have left beside their chunks.

    Raises:
        DatasetError: units are missing.
    """
    missing = len(missing_dataset_units(path, plan, study))
    STORE.finish(path, _arrays(study), missing, f"{plan.units} parts")


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
