"""A data set (paper sec. 2.3, 3.3): the plan of its samples, made before anything is
simulated, its slices, its store.

Slices come from linear mechanics or from the library, on all cores. The store is
written unit by unit and resumable: first the metadata of all samples, then one chunk of
`slices` for each unit of work. Reading checks that values are possible: forces of the
study, their classes, slices of wall and no wall.
"""

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.metadata import version
from itertools import pairwise
from math import lcm
from os import PathLike
from pathlib import Path
from time import perf_counter
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from scleraforce.base.arrays import Bytes, Flags, Floats, Places
from scleraforce.base.checked_store import CheckedStore, Layout, StoreKind, layout
from scleraforce.base.errors import DatasetError
from scleraforce.base.units import STANDARD_GRAVITY_M_S2, from_si
from scleraforce.base.worker_processes import (
    ClusterWorkers,
    available_cores,
    work_units,
)
from scleraforce.library import OUTER, Library
from scleraforce.library.plane_cut import Framing, draw_slices, highest_depths
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane
from scleraforce.mechanics.graded_mesh import study_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.mechanics.mesh_section import cut_sections, fill_section, slice_window
from scleraforce.records.calibration_file import CalibrationSummary
from scleraforce.records.study import (
    Choice,
    Sampled,
    Study,
    format_study,
    parse_study,
    refuse_unused,
    study_hash,
)

UNIT_IMAGES = 200  # about this many samples are simulated and stored together
DRAWS = ("force", "gap", "tilt", "direction", "framing_lateral", "framing_depth")


@dataclass(frozen=True)
class DatasetPlan:
    """Every sample's metadata, each of shape (samples,); the samples of a contact are
    neighbours.

    `contact` numbers the contacts through all groups. `validation` marks the samples of
    the contacts that training never sees. `seed` reproduces a sample's own draws
    (`DRAWS`, uniform).
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

    def __len__(self) -> int:
        return len(self.force_n)

    def part(self, samples: slice) -> "DatasetPlan":
        """Return the plan of some samples alone, numbered from 0."""
        return DatasetPlan(
            **{name: values[samples] for name, values in vars(self).items()}
        )


def plan_dataset(study: Study) -> DatasetPlan:
    """Draw the samples of a study, in the order of groups, contacts, samples; the same
    study gives the same plan.

    For each group: `contacts` random contacts (fewer where there are fewer images), of
    which `validation_fraction`, but at least one, is kept for validation; the polar
    angle is drawn from the needle's range (uniform in angle), the azimuth uniformly
    around the eye. The images are spread evenly over the contacts. Each sample draws
    its own force, uniform from 0 to the group's largest, and its own gap, tilt,
    direction and framing.
    """
    dataset = study.dataset
    needle = study.needle
    rng = np.random.default_rng(dataset.seed)
    parts = []

    for group in dataset.group:
        contacts = min(dataset.contacts, group.images)
        # both sets get some
        unseen = min(
            max(round(dataset.validation_fraction * contacts), 1), contacts - 1
        )
        polar_rad = needle.polar_angle_rad.sample(rng, contacts)
        azimuth_rad = rng.uniform(0.0, 2.0 * np.pi, contacts)
        validation = rng.permutation(np.arange(contacts) < unseen)
        spread = group.images // contacts + (
            np.arange(contacts) < group.images % contacts
        )
        parts.append(
            (
                polar_rad,
                azimuth_rad,
                validation,
                spread,
                rng.integers(0, 2**32, group.images, np.uint32),
            )
        )

    polar, azimuth, validates, spreads, seed = (
        np.concatenate(each) for each in zip(*parts, strict=True)
    )
    contact = np.repeat(np.arange(len(spreads)), spreads)
    images = [group.images for group in dataset.group]
    uniform = np.array(
        [np.random.default_rng(number).random(len(DRAWS)) for number in seed]
    )
    draws = dict(zip(DRAWS, uniform.T, strict=True))
    force_n = (
        np.repeat([group.max_force_n for group in dataset.group], images)
        * draws["force"]
    )

    return DatasetPlan(
        force_n=force_n,
        target=np.array(
            [study.classes.classify(force) for force in force_n], dtype=np.uint8
        ),
        thickness_m=np.repeat([group.thickness_m for group in dataset.group], images),
        contact=contact.astype(np.int32),
        polar_rad=polar[contact],
        azimuth_rad=azimuth[contact],
        gap_m=(
            np.full(len(seed), needle.gap_m)
            if dataset.gap_m is None
            else _at(dataset.gap_m, draws["gap"])
        ),
        tilt_rad=_at(dataset.tilt_rad, draws["tilt"]),
        direction_rad=_at(dataset.direction_rad, draws["direction"]),
        framing_lateral_m=_at(dataset.framing_lateral_m, draws["framing_lateral"]),
        framing_depth_m=_at(dataset.framing_depth_m, draws["framing_depth"]),
        validation=validates[contact],
        seed=seed,
    )


def _at(sampled: Sampled, uniform: Floats) -> Floats:
    """Map draws in [0, 1) to a sampled value: all of its choices are equally likely, or
    its range is uniform.
    """
    if isinstance(sampled, Choice):
        values = np.asarray(sampled.values, dtype=np.float64)
        return values[(uniform * len(values)).astype(np.intp)]
    return sampled.min + (sampled.max - sampled.min) * uniform


def unit_samples(study: Study) -> list[slice]:
    """Return the samples of each unit of work, which is a chunk of the store: equally
    many but for the last unit.

    It has whole contacts in every group if a common multiple near `UNIT_IMAGES` exists.
    """
    images = sum(group.images for group in study.dataset.group)
    whole = lcm(
        *(
            group.images // min(study.dataset.contacts, group.images)
            for group in study.dataset.group
        )
    )
    size = (
        whole * max(1, round(UNIT_IMAGES / whole))
        if whole <= 2 * UNIT_IMAGES
        else UNIT_IMAGES
    )

    return [slice(first, min(first + size, images)) for first in range(0, images, size)]


KIND = StoreKind(
    noun="data set",
    command="generate",
    parts="parts",
    schema="scleraforce-dataset-2",
    recipe="study",
    others={
        "scleraforce-library": (
            "a response library and no data set; `train kind=reader` learns from it"
        )
    },
    error=DatasetError,
)
SLICES = "slices"
MAX_MODULUS_PA = 1e12
SLACK = 1e-12
# Floats is "numpy.ndarray[shape, numpy.dtype[numpy.float64]]" or, since NumPy 2.5, a
# name of its own.
DTYPES = {
    name: np.dtype(str(kind).rstrip("]").rpartition(".")[2]).name
    for name, kind in get_type_hints(DatasetPlan).items()
}


@dataclass(frozen=True)
class Dataset:
    """A complete data set; its arrays are read, and checked, on first use.

    `attributes` are the store's (seed, versions, calibration ...); the modulus is that
    of the simulated walls.
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
        """Return the numbers of the training and of the validation samples; they share
        no contact.
        """
        validation = self.read("validation")
        return np.flatnonzero(~validation), np.flatnonzero(validation)

    def read(self, name: str) -> NDArray[Any]:
        """Read a whole array, `slices` or a metadata's name; raise a DatasetError if it
        is damaged or impossible.
        """
        layouts = _layouts(self.study)
        if name not in layouts:
            raise DatasetError(
                f"{self.path}: no array {name!r}; there are {', '.join(layouts)}"
            )

        values = CheckedStore(
            KIND, self.path, {name: layouts[name]}, attributes=self.attributes
        ).read(name)
        if wrong := _impossible(name, values, self.study):
            raise DatasetError(
                f"{self.path / name}: {wrong}; generate the data set again"
            )

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

    modulus_pa = attributes.get("youngs_modulus_pa")
    if (
        isinstance(modulus_pa, bool)
        or not isinstance(modulus_pa, int | float)
        or not 0.0 < modulus_pa < MAX_MODULUS_PA
    ):
        raise DatasetError(
            f"{path}: youngs_modulus_pa: {str(modulus_pa)[:60]}; must be a number of Pa"
            " above 0"
        )

    study = parse_study(attributes["study"], f"{path}: study")
    return Dataset(path, study, float(modulus_pa), attributes)


def _layouts(study: Study) -> dict[str, Layout]:
    """Return the layouts of a data set's arrays: slices, a unit of work in each chunk,
    and the metadata of samples.
    """
    units = unit_samples(study)
    size = (study.slice.rows, study.slice.columns)
    images = units[-1].stop
    slices = layout((images, *size), (units[0].stop, *size), "uint8", compressed=True)

    return {
        SLICES: slices,
        **{name: layout((images,), (images,), dtype) for name, dtype in DTYPES.items()},
    }


def _impossible(name: str, values: NDArray[Any], study: Study) -> str | None:
    """Return a message if values of an array are impossible for a study, else None."""
    if name == SLICES:
        return (
            "a pixel other than 0 (no wall) and 255 (wall)"
            if (values + np.uint8(1) > 1).any()
            else None
        )
    if name == "validation":
        return (
            "a value other than true and false"
            if (values.view(np.uint8) > 1).any()
            else None
        )
    if name == "target":
        return (
            f"a class above {len(study.classes.bounds_n)}"
            if values.max() > len(study.classes.bounds_n)
            else None
        )
    if not np.isfinite(values).all():
        return "a value that is not finite"

    if name == "force_n":
        largest_n = max(group.max_force_n for group in study.dataset.group)
        if values.min() < 0.0 or values.max() > largest_n * (1.0 + SLACK):
            found = (
                f"{from_si(values.min(), 'mn'):g} to {from_si(values.max(), 'mn'):g} mN"
            )
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
    """Create the store with all metadata and no slices, or continue that of an
    interrupted run of the same study.
    """
    modulus = calibration and {
        "youngs_modulus_pa": calibration.population_mean_pa,
        **{
            name: getattr(calibration, name) for name in ("mechanics", "path", "sha256")
        },
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
    store = CheckedStore(
        KIND,
        path,
        _layouts(study),
        [{SLICES: (unit,)} for unit in range(len(unit_samples(study)))],
    )
    store.begin(described, vars(plan))

    return store


class SampleSimulator:
    """Simulates samples of plans; keeps the factored wall of the latest thickness.

    The mechanics is linear: displacement = (IOP u_p + rho g u_g)/E + F/E u_n, so a
    contact is solved once.
    """

    def __init__(self, study: Study, youngs_modulus_pa: float) -> None:
        """Make a simulator for walls of Young's modulus `youngs_modulus_pa`."""
        self._study = study
        self._youngs_modulus_pa = youngs_modulus_pa
        self._wall: LinearWall | None = None

    def slices(self, plan: DatasetPlan) -> Bytes:
        """Return the slices of all samples of a plan of the study, shape (samples,
        rows, columns), 255 = wall.
        """
        walls = np.flatnonzero(np.diff(plan.thickness_m)) + 1
        return np.concatenate(
            [
                self._of_one_wall(plan, part)
                for part in np.split(np.arange(len(plan)), walls)
            ]
        )

    def _of_one_wall(self, plan: DatasetPlan, samples: Places) -> Bytes:
        """Slices of samples of one thickness."""
        thickness_m = float(plan.thickness_m[samples[0]])
        if self._wall is None or self._wall.mesh.thickness_m != thickness_m:
            self._wall = None  # frees the last factorisation before the next is made
            self._wall = LinearWall(
                study_mesh(self._study, thickness_m), self._study.eye.poisson_ratio
            )

        wall = self._wall
        of_contacts = np.split(
            samples, np.flatnonzero(np.diff(plan.contact[samples])) + 1
        )
        contacts = [_plane(plan, of_contact[0]).contact for of_contact in of_contacts]
        needles_cnc = wall.needle_cnc(
            contacts, 0.5 * self._study.needle.outer_diameter_m
        )
        images = [
            self._of_one_contact(wall, plan, *pair)
            for pair in zip(of_contacts, needles_cnc, strict=True)
        ]

        return np.concatenate(images)

    def _of_one_contact(
        self, wall: LinearWall, plan: DatasetPlan, samples: Places, needle_nc: Floats
    ) -> Bytes:
        """Slices of the samples of one contact; samples that share their plane are cut
        together.
        """
        eye = self._study.eye
        resting_nc = (
            eye.iop_pa * wall.pressure_nc
            + eye.density_kg_m3 * STANDARD_GRAVITY_M_S2 * wall.gravity_nc
        )
        modes_knc = np.stack([resting_nc, needle_nc]) / self._youngs_modulus_pa
        planes = [_plane(plan, sample) for sample in samples]
        forces_n = plan.force_n[samples]

        if all(plane == planes[0] for plane in planes):
            forces_pf = np.r_[0.0, forces_n][None]
            unloaded, *loaded = cut_sections(
                wall.mesh, planes[:1], modes_knc, _weights(forces_pf)
            )[0]
            resting = [unloaded] * len(loaded)
        else:
            forces_pf = np.c_[np.zeros(len(samples)), forces_n]
            pairs = cut_sections(wall.mesh, planes, modes_knc, _weights(forces_pf))
            resting, loaded = ([pair[state] for pair in pairs] for state in (0, 1))

        tops_m = [float(section.outer[:, 1].min()) for section in resting]
        framings = plan.framing_lateral_m[samples], plan.framing_depth_m[samples]
        windows = [
            slice_window(self._study.slice, *placed)
            for placed in zip(tops_m, *framings, strict=True)
        ]

        return np.stack(
            [fill_section(*pair) for pair in zip(loaded, windows, strict=True)]
        )


def _plane(plan: DatasetPlan, sample: int) -> ScanPlane:
    return ScanPlane(
        Contact(
            polar_rad=float(plan.polar_rad[sample]),
            azimuth_rad=float(plan.azimuth_rad[sample]),
        ),
        gap_m=float(plan.gap_m[sample]),
        direction_rad=float(plan.direction_rad[sample]),
        tilt_rad=float(plan.tilt_rad[sample]),
    )


def _weights(forces_pf: Floats) -> Floats:
    """Weights of the modes (resting wall, needle) for forces (plane, force)."""
    return np.stack([np.ones_like(forces_pf), forces_pf], axis=-1)


def library_slices(
    study: Study, youngs_modulus_pa: float, plan: DatasetPlan, library: Library
) -> Bytes:
    """Draw the samples of a plan from the library; return their slices (sample, row,
    column), 255 = wall.

    The wall of the library is even and bends the same all around the needle, and
    gravity is left out: samples differ by thickness, force, the contact's polar angle,
    plane and framing, not by azimuth or by the direction of the plane. `library` is a
    `near_library` of the whole plan.
    """
    slices = []
    bounds = [0, *(np.flatnonzero(np.diff(plan.contact)) + 1), len(plan)]

    for samples in (slice(*part) for part in pairwise(bounds)):  # of one contact
        beside = library.for_contact(float(plan.polar_rad[samples.start]))
        thickness_m = plan.thickness_m[samples]
        gap_m = plan.gap_m[samples]
        tilt_rad = plan.tilt_rad[samples]
        iop_ratio = np.full(len(thickness_m), study.eye.iop_pa / youngs_modulus_pa)
        resting = beside.at_tip(thickness_m, iop_ratio, np.zeros(len(thickness_m)))
        top_m = highest_depths(resting.curves_sbnc[:, OUTER], gap_m, tilt_rad)
        depth_m = study.slice.margin_m + plan.framing_depth_m[samples] - top_m
        framing = Framing.upright(plan.framing_lateral_m[samples], depth_m)
        loaded = beside.curves(
            thickness_m, iop_ratio, plan.force_n[samples] / youngs_modulus_pa
        )
        slices.append(
            draw_slices(loaded.curves_sbnc, gap_m, tilt_rad, framing, study.slice)
        )

    return np.concatenate(slices)


def check_library(library: Library, study: Study) -> None:
    """Refuse a library of other eyes: its walls would be wrong without a sign of it."""
    compared = (
        ("radius", library.radius_m, study.eye.radius_m),
        ("Poisson's ratio", library.poisson_ratio, study.eye.poisson_ratio),
        ("needle radius", library.needle_radius_m, study.needle.outer_diameter_m / 2),
    )
    for name, found, wanted in compared:
        if not np.isclose(found, wanted, rtol=1e-9, atol=0.0):
            raise DatasetError(
                f"library: {name} {found:g}, the study has {wanted:g}; make a library"
                " of this study"
            )


def near_library(study: Study, plan: DatasetPlan, library: Library) -> Library:
    """Return the part of a library that all slices of a plan together may show."""
    check_library(library, study)
    lateral_m = (
        0.5 * study.slice.columns * study.slice.pixel_m
        + np.abs(plan.framing_lateral_m).max()
    )
    # below what any tilt makes of it
    depth_m = study.slice.rows * study.slice.pixel_m + study.eye.radius_m
    offset_m = plan.gap_m.max() + depth_m * np.abs(np.tan(plan.tilt_rad)).max()

    return library.within(float(np.hypot(lateral_m, offset_m)))


@dataclass(frozen=True)
class Generation:
    """The result of a run: samples in the data set, samples simulated by this run, its
    duration.
    """

    images: int
    simulated: int
    seconds: float

    @property
    def images_per_second(self) -> float:
        """Rate of this run."""
        return self.simulated / self.seconds


def generate_dataset(
    study: Study,
    out: Path,
    *,
    youngs_modulus_pa: float | None = None,
    calibration: CalibrationSummary | None = None,
    library: Library | None = None,
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Generation:
    """Simulate the data set of a study, or the part of it that an interrupted run has
    left to do.

    The result is the same, byte for byte, for any number of workers and interruptions.
    The workers are spawned: a script that calls this keeps its own work under `if
    __name__ == "__main__"`.

    The modulus is by default that of `calibration`, else the study's. Without a library
    the mechanics is linear, by a process for each usable core; a library is drawn from
    by a cluster or here. `progress` is called with the number of samples that are newly
    done (or found done, at the start).
    """
    start = perf_counter()
    if workers is not None and workers < 1:
        raise DatasetError(f"workers: {workers}; must be at least 1")

    mechanics = "linear" if library is None else "finite-strain"
    refuse_unused(study, "generate", mechanics)
    modulus = youngs_modulus_pa or (
        calibration.population_mean_pa if calibration else study.eye.youngs_modulus_pa
    )
    report = progress or (lambda _: None)
    # as the store keeps it: rounded to 15 digits in human units
    study = parse_study(format_study(study))
    plan = plan_dataset(study)
    near = None if library is None else near_library(study, plan, library)
    store = create_dataset(out, study, modulus, calibration, plan, mechanics)
    todo = store.missing()
    units = unit_samples(study)
    missing = sum(units[number].stop - units[number].start for number in todo)
    report(len(plan) - missing)
    workers = workers or available_cores()
    prepare = partial(_making, study, modulus, near, plan)

    if near is None or isinstance(workers, ClusterWorkers):
        results = work_units(prepare, todo, workers)
    else:  # drawing takes less time than processes take to start
        draw = prepare()
        results = ((unit, draw(unit)) for unit in todo)

    with closing(results):
        for unit, images in results:
            store.write(unit, {SLICES: images})
            report(len(images))

    store.finish()
    return Generation(len(plan), missing, perf_counter() - start)


def _making(
    study: Study, youngs_modulus_pa: float, library: Library | None, plan: DatasetPlan
) -> Callable[[int], Bytes]:
    """Return the worker's function from a unit's number to its slices, drawn from the
    library or simulated.
    """
    units = unit_samples(study)
    simulator = SampleSimulator(study, youngs_modulus_pa)
    if library is None:
        return lambda unit: simulator.slices(plan.part(units[unit]))

    return lambda unit: library_slices(
        study, youngs_modulus_pa, plan.part(units[unit]), library
    )
