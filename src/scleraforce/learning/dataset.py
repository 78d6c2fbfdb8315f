"""A data set: the plan of its samples (paper sec. 2.3, 3.3), made before anything is simulated, and the checked store.

The store is written unit by unit and resumable: first the metadata of all samples, then one chunk of `slices` for each
unit of work. Reading checks that values are possible: forces of the study, their classes, slices of wall and no wall.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from math import lcm
from os import PathLike
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from scleraforce.arrays import Bytes, Flags, Floats, Places
from scleraforce.checked_store import CheckedStore, StoredArray, StoreKind
from scleraforce.errors import DatasetError
from scleraforce.known.calibration_file import CalibrationSummary
from scleraforce.study import Choice, Sampled, Study, format_study, parse_study, study_hash
from scleraforce.units import from_si

UNIT_IMAGES = 200  # about this many samples are simulated and stored together
DRAWS = ("force", "gap", "tilt", "direction", "framing_lateral", "framing_depth")


@dataclass(frozen=True)
class DatasetPlan:
    """Every sample's metadata, each of shape (samples,); the samples of a contact are neighbours.

    `contact` numbers the contacts through all groups. `validation` marks the samples of the contacts that training
    never sees. `seed` reproduces a sample's own draws (`DRAWS`, uniform).
    """

    force_n: Floats
    target: Bytes
    thickness_m: Floats
    contact: NDArray[np.int32]
    polar_rad: Floats
    azimuth_rad: Floats
    gap_m: Floats
    tilt_rad: Floats
    direction_rad: Floats
    framing_lateral_m: Floats
    framing_depth_m: Floats
    validation: Flags
    seed: NDArray[np.uint32]

    @property
    def images(self) -> int:
        """Number of samples."""
        return len(self.force_n)


def plan_dataset(study: Study) -> DatasetPlan:
    """Draw the samples of a study, in the order of groups, contacts, samples; the same study gives the same plan.

    For each group: `contacts` random contacts (fewer where there are fewer images), of which `validation_fraction`, but
    at least one, is kept for validation; the polar angle is drawn from the needle's range (uniform in angle), the
    azimuth uniformly around the eye. The images are spread evenly over the contacts. Each sample draws its own force,
    uniform from 0 to the group's largest, and its own gap, tilt, direction and framing.
    """
    draft = draft_plan(study)
    return draft.samples(slice(0, draft.images))


@dataclass(frozen=True)
class PlanDraft:
    """A plan without each sample's own draws: made fast, it gives any part of the plan.

    Of contacts (contact,): the number of the group, polar angle and azimuth, whether they validate; of samples
    (sample,): the number of the contact and the seed.
    """

    study: Study
    group: Places
    polar_rad: Floats
    azimuth_rad: Floats
    validation: Flags
    contact: Places
    seed: NDArray[np.uint32]

    @property
    def images(self) -> int:
        """Number of samples."""
        return len(self.seed)

    def unit(self, number: int) -> DatasetPlan:
        """Return the plan of the samples of a unit of work alone, numbered from 0."""
        return self.samples(unit_samples(self.study)[number])

    def samples(self, samples: slice) -> DatasetPlan:
        """Return the plan of consecutive samples alone, numbered from 0."""
        study, needle, seed, contact = self.study.dataset, self.study.needle, self.seed[samples], self.contact[samples]
        groups = [study.group[number] for number in self.group[contact]]
        uniform = np.array([np.random.default_rng(number).random(len(DRAWS)) for number in seed])
        draws = dict(zip(DRAWS, uniform.reshape(-1, len(DRAWS)).T, strict=True))
        force_n = np.array([group.max_force_n for group in groups]) * draws["force"]
        return DatasetPlan(
            force_n=force_n,
            target=np.array([self.study.classes.classify(force) for force in force_n], dtype=np.uint8),
            thickness_m=np.array([group.thickness_m for group in groups]),
            contact=contact.astype(np.int32),
            polar_rad=self.polar_rad[contact],
            azimuth_rad=self.azimuth_rad[contact],
            gap_m=np.full(len(seed), needle.gap_m) if study.gap_m is None else _at(study.gap_m, draws["gap"]),
            tilt_rad=_at(study.tilt_rad, draws["tilt"]),
            direction_rad=_at(study.direction_rad, draws["direction"]),
            framing_lateral_m=_at(study.framing_lateral_m, draws["framing_lateral"]),
            framing_depth_m=_at(study.framing_depth_m, draws["framing_depth"]),
            validation=self.validation[contact],
            seed=seed,
        )


def draft_plan(study: Study) -> PlanDraft:
    """Draw the contacts of a plan and the seeds of its samples."""
    rng, parts = np.random.default_rng(study.dataset.seed), []
    for number, group in enumerate(study.dataset.group):
        contacts = min(study.dataset.contacts, group.images)
        unseen = min(max(round(study.dataset.validation_fraction * contacts), 1), contacts - 1)  # both sets get some
        polar_rad = study.needle.polar_angle_rad.sample(rng, contacts)
        azimuth_rad = rng.uniform(0.0, 2.0 * np.pi, contacts)
        validation = rng.permutation(np.arange(contacts) < unseen)
        spread = group.images // contacts + (np.arange(contacts) < group.images % contacts)
        seed = rng.integers(0, 2**32, group.images, dtype=np.uint32)
        parts.append((np.full(contacts, number), polar_rad, azimuth_rad, validation, spread, seed))
    group_of, polar, azimuth, validates, spreads, seeds = (np.concatenate(each) for each in zip(*parts, strict=True))
    return PlanDraft(study, group_of, polar, azimuth, validates, np.repeat(np.arange(len(spreads)), spreads), seeds)


def _at(sampled: Sampled, uniform: Floats) -> Floats:
    """Map draws in [0, 1) to a sampled value: all of its choices are equally likely, or its range is uniform."""
    if isinstance(sampled, Choice):
        values = np.asarray(sampled.values, dtype=np.float64)
        return values[(uniform * len(values)).astype(np.intp)]
    return sampled.min + (sampled.max - sampled.min) * uniform


def unit_samples(study: Study) -> list[slice]:
    """Return the samples of each unit of work, which is a chunk of the store: equally many but for the last unit.

    It has whole contacts in every group if a common multiple near `UNIT_IMAGES` exists.
    """
    images = sum(group.images for group in study.dataset.group)
    whole = lcm(*(group.images // min(study.dataset.contacts, group.images) for group in study.dataset.group))
    size = whole * max(1, round(UNIT_IMAGES / whole)) if whole <= 2 * UNIT_IMAGES else UNIT_IMAGES
    return [slice(first, min(first + size, images)) for first in range(0, images, size)]


KIND = StoreKind(
    noun="data set",
    command="generate",
    verb="generate",
    parts="parts",
    schema="scleraforce-dataset-2",
    recipe="study",
    required=frozenset({"complete", "study", "study_hash", "youngs_modulus_pa", "calibration", "versions"}),
    same=("study_hash", "youngs_modulus_pa", "mechanics", "calibration", "versions"),
    others={"scleraforce-library": "a response library and no data set; `train --kind reader` learns from it"},
    error=DatasetError,
)
SLICES = "slices"
MAX_MODULUS_PA = 1e12
SLACK = 1e-12
# Floats is "numpy.ndarray[shape, numpy.dtype[numpy.float64]]" or, since NumPy 2.5, a name of its own.
DTYPES = {
    name: np.dtype(str(kind).rstrip("]").rpartition(".")[2]).name for name, kind in get_type_hints(DatasetPlan).items()
}


@dataclass(frozen=True)
class Dataset:
    """A complete data set, checked on opening; its arrays are read on first use.

    `attributes` are the store's (seed, versions, calibration ...); the modulus is that of the simulated walls.
    """

    path: Path
    study: Study
    youngs_modulus_pa: float
    attributes: Mapping[str, Any]

    @cached_property
    def slices(self) -> Bytes:
        """The slices, shape (samples, rows, columns), 255 = wall."""
        return self.read(SLICES)

    @cached_property
    def force_n(self) -> Floats:
        """The force of the needle, shape (samples,)."""
        return self.read("force_n")

    @cached_property
    def target(self) -> Bytes:
        """The class of the force, shape (samples,)."""
        return self.read("target")

    @property
    def images(self) -> int:
        """Number of samples."""
        return len(self.force_n)

    def split(self) -> tuple[Places, Places]:
        """Return the numbers of the training and of the validation samples; they share no contact."""
        validation = self.read("validation")
        return np.flatnonzero(~validation), np.flatnonzero(validation)

    def read(self, name: str) -> NDArray[Any]:
        """Read a whole array, `slices` or a metadata's name; raise a DatasetError if it is damaged or impossible."""
        store = CheckedStore(KIND, self.path, _arrays(self.study), attributes=self.attributes)
        if name not in store.arrays:
            raise DatasetError(f"{self.path}: no array {name!r}; there are {', '.join(store.arrays)}")
        values = store.read(name)
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
    attributes = KIND.complete_attributes(path)
    modulus_pa = attributes["youngs_modulus_pa"]
    if isinstance(modulus_pa, bool) or not isinstance(modulus_pa, int | float) or not 0.0 < modulus_pa < MAX_MODULUS_PA:
        raise DatasetError(f"{path}: youngs_modulus_pa: {str(modulus_pa)[:60]}; must be a number of Pa above 0")
    study = parse_study(attributes["study"], f"{path}: study")
    CheckedStore(KIND, path, _arrays(study), attributes=attributes).check()
    return Dataset(path, study, float(modulus_pa), attributes)


def _arrays(study: Study) -> dict[str, StoredArray]:
    """Return the arrays of a data set: the slices, a unit of work in each chunk, and the metadata of all samples."""
    units, size = unit_samples(study), (study.slice.rows, study.slice.columns)
    images = units[-1].stop
    slices = StoredArray(SLICES, (images, *size), (units[0].stop, *size), "uint8", compressed=True)
    return {SLICES: slices, **{name: StoredArray(name, (images,), (images,), dtype) for name, dtype in DTYPES.items()}}


def _impossible(name: str, values: NDArray[Any], study: Study) -> str | None:
    """Return a message if values of an array are impossible for a study, else None."""
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
    calibration: CalibrationSummary | None,
    plan: DatasetPlan,
    mechanics: str = "linear",
) -> CheckedStore:
    """Create the store with all metadata and no slices, or continue that of an interrupted run of the same study."""
    modulus = calibration and {
        "youngs_modulus_pa": calibration.population_mean_pa,
        **{name: getattr(calibration, name) for name in ("mechanics", "path", "sha256")},
    }
    packages = ("scleraforce", "numpy", "scipy", "opencv-python-headless", "zarr")
    described = {
        "study": format_study(study),
        "study_hash": study_hash(study),
        "seed": study.dataset.seed,
        "mechanics": mechanics,
        "youngs_modulus_pa": youngs_modulus_pa,
        "calibration": modulus,
        "versions": {name: version(name) for name in packages},
    }
    store = CheckedStore(KIND, path, _arrays(study), [{SLICES: (unit,)} for unit in range(len(unit_samples(study)))])
    store.begin(described, vars(plan))
    return store
