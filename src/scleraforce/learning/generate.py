"""From the plan of a data set to its slices (paper sec. 2.3), by linear mechanics or from the library, on all cores."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter

import numpy as np

from scleraforce.arrays import Bytes, Floats, Places
from scleraforce.errors import DatasetError
from scleraforce.known.calibration_file import CalibrationSummary
from scleraforce.learning import dataset
from scleraforce.library import OUTER, Library
from scleraforce.library.sections import Framing, draw_slices, highest_depths
from scleraforce.mechanics.contact import Contact, ScanPlane
from scleraforce.mechanics.graded import study_mesh
from scleraforce.mechanics.linear import LinearWall
from scleraforce.mechanics.section import cut_sections, fill_section, slice_window
from scleraforce.processes import ClusterWorkers, available_cores, work_units
from scleraforce.study import Study, format_study, parse_study, refuse_unused
from scleraforce.units import STANDARD_GRAVITY_M_S2


class SampleSimulator:
    """Simulates samples of plans; keeps the factored wall of the latest thickness.

    The mechanics is linear: displacement = (IOP u_p + rho g u_g)/E + F/E u_n, so a contact is solved once.
    """

    def __init__(self, study: Study, youngs_modulus_pa: float) -> None:
        """Make a simulator for walls of Young's modulus `youngs_modulus_pa`."""
        self._study, self._youngs_modulus_pa = study, youngs_modulus_pa
        self._wall: LinearWall | None = None

    def slices(self, plan: dataset.DatasetPlan) -> Bytes:
        """Return the slices of all samples of a plan of the study, shape (samples, rows, columns), 255 = wall."""
        walls = np.flatnonzero(np.diff(plan.thickness_m)) + 1
        return np.concatenate([self._of_one_wall(plan, part) for part in np.split(np.arange(plan.images), walls)])

    def _of_one_wall(self, plan: dataset.DatasetPlan, samples: Places) -> Bytes:
        """Slices of samples of one thickness."""
        thickness_m = float(plan.thickness_m[samples[0]])
        if self._wall is None or self._wall.mesh.thickness_m != thickness_m:
            self._wall = None  # frees the last factorisation before the next is made
            self._wall = LinearWall(study_mesh(self._study, thickness_m), self._study.eye.poisson_ratio)
        wall = self._wall
        of_contacts = np.split(samples, np.flatnonzero(np.diff(plan.contact[samples])) + 1)
        contacts = [_plane(plan, of_contact[0]).contact for of_contact in of_contacts]
        needles_cnc = wall.needle_cnc(contacts, 0.5 * self._study.needle.outer_diameter_m)
        images = [self._of_one_contact(wall, plan, *pair) for pair in zip(of_contacts, needles_cnc, strict=True)]
        return np.concatenate(images)

    def _of_one_contact(self, wall: LinearWall, plan: dataset.DatasetPlan, samples: Places, needle_nc: Floats) -> Bytes:
        """Slices of the samples of one contact; samples that share their plane are cut together."""
        eye = self._study.eye
        resting_nc = eye.iop_pa * wall.pressure_nc + eye.density_kg_m3 * STANDARD_GRAVITY_M_S2 * wall.gravity_nc
        modes_knc = np.stack([resting_nc, needle_nc]) / self._youngs_modulus_pa
        planes, forces_n = [_plane(plan, sample) for sample in samples], plan.force_n[samples]
        if all(plane == planes[0] for plane in planes):
            forces_pf = np.r_[0.0, forces_n][None]
            unloaded, *loaded = cut_sections(wall.mesh, planes[:1], modes_knc, _weights(forces_pf))[0]
            resting = [unloaded] * len(loaded)
        else:
            forces_pf = np.c_[np.zeros(len(samples)), forces_n]
            pairs = cut_sections(wall.mesh, planes, modes_knc, _weights(forces_pf))
            resting, loaded = ([pair[state] for pair in pairs] for state in (0, 1))
        tops_m = [float(section.outer[:, 1].min()) for section in resting]
        framings = plan.framing_lateral_m[samples], plan.framing_depth_m[samples]
        windows = [slice_window(self._study.slice, *placed) for placed in zip(tops_m, *framings, strict=True)]
        return np.stack([fill_section(*pair) for pair in zip(loaded, windows, strict=True)])


def _plane(plan: dataset.DatasetPlan, sample: int) -> ScanPlane:
    return ScanPlane(
        Contact(polar_rad=float(plan.polar_rad[sample]), azimuth_rad=float(plan.azimuth_rad[sample])),
        gap_m=float(plan.gap_m[sample]),
        direction_rad=float(plan.direction_rad[sample]),
        tilt_rad=float(plan.tilt_rad[sample]),
    )


def _weights(forces_pf: Floats) -> Floats:
    """Weights of the modes (resting wall, needle) for forces (plane, force)."""
    return np.stack([np.ones_like(forces_pf), forces_pf], axis=-1)


def library_slices(study: Study, youngs_modulus_pa: float, plan: dataset.DatasetPlan, library: Library) -> Bytes:
    """Draw the samples of a plan from the library; return their slices (sample, row, column), 255 = wall.

    The wall of the library is even and bends the same all around the needle, and gravity is left out: samples differ by
    thickness, force, the contact's polar angle, plane and framing, not by azimuth or by the direction of the plane.
    `library` is a `near_library` of the whole plan.
    """
    slices, bounds = [], [0, *(np.flatnonzero(np.diff(plan.contact)) + 1), plan.images]
    for samples in (slice(*part) for part in pairwise(bounds)):  # of one contact
        beside = library.for_contact(float(plan.polar_rad[samples.start]))
        thickness_m, gap_m, tilt_rad = plan.thickness_m[samples], plan.gap_m[samples], plan.tilt_rad[samples]
        iop_ratio = np.full(len(thickness_m), study.eye.iop_pa / youngs_modulus_pa)
        resting = beside.at_tip(thickness_m, iop_ratio, np.zeros(len(thickness_m)))
        top_m = highest_depths(resting.curves_sbnc[:, OUTER], gap_m, tilt_rad)
        depth_m = study.slice.margin_m + plan.framing_depth_m[samples] - top_m
        framing = Framing.upright(plan.framing_lateral_m[samples], depth_m)
        loaded = beside.curves(thickness_m, iop_ratio, plan.force_n[samples] / youngs_modulus_pa)
        slices.append(draw_slices(loaded.curves_sbnc, gap_m, tilt_rad, framing, study.slice))
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
            raise DatasetError(f"library: {name} {found:g}, the study has {wanted:g}; make a library of this study")


def near_library(study: Study, plan: dataset.DatasetPlan, library: Library) -> Library:
    """Return the part of a library that all slices of a plan together may show."""
    check_library(library, study)
    lateral_m = 0.5 * study.slice.columns * study.slice.pixel_m + np.abs(plan.framing_lateral_m).max()
    depth_m = study.slice.rows * study.slice.pixel_m + study.eye.radius_m  # below what any tilt makes of it
    offset_m = plan.gap_m.max() + depth_m * np.abs(np.tan(plan.tilt_rad)).max()
    return library.within(float(np.hypot(lateral_m, offset_m)))


@dataclass(frozen=True)
class Generation:
    """The result of a run: samples in the data set, samples simulated by this run, its duration."""

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
    """Simulate the data set of a study, or the part of it that an interrupted run has left to do.

    The result is the same, byte for byte, for any number of workers and interruptions. The workers are spawned: a
    script that calls this keeps its own work under `if __name__ == "__main__"`.

    The modulus is by default that of `calibration`, else the study's. Without a library the mechanics is linear, by a
    process for each usable core; a library is drawn from by a cluster or here. `progress` is called with the number of
    samples that are newly done (or found done, at the start).
    """
    start = perf_counter()
    if workers is not None and workers < 1:
        raise DatasetError(f"workers: {workers}; must be at least 1")
    mechanics = "linear" if library is None else "finite-strain"
    refuse_unused(study, "generate", mechanics)
    modulus = youngs_modulus_pa or (calibration.population_mean_pa if calibration else study.eye.youngs_modulus_pa)
    report = progress or (lambda _: None)
    study = parse_study(format_study(study))  # as the store keeps it: rounded to 15 digits in human units
    plan = dataset.plan_dataset(study)
    store = dataset.create_dataset(out, study, modulus, calibration, plan, mechanics)
    todo = store.missing()
    units = dataset.unit_samples(study)
    missing = sum(units[number].stop - units[number].start for number in todo)
    report(plan.images - missing)
    workers = workers or available_cores()
    if library is None:
        results = work_units(partial(_simulating, study, modulus), todo, workers)
    else:
        prepare = partial(_drawing, study, modulus, near_library(study, plan, library))
        if isinstance(workers, ClusterWorkers):
            results = work_units(prepare, todo, workers)
        else:  # drawing takes less time than processes take to start
            draw = prepare()
            results = ((unit, draw(unit)) for unit in todo)
    with closing(results):
        for unit, images in results:
            store.write(unit, {dataset.SLICES: images})
            report(len(images))
    store.finish()
    return Generation(plan.images, missing, perf_counter() - start)


def _simulating(study: Study, youngs_modulus_pa: float) -> Callable[[int], Bytes]:
    """Return the worker's function from a unit's number to its simulated slices."""
    draft, simulator = dataset.draft_plan(study), SampleSimulator(study, youngs_modulus_pa)
    return lambda unit: simulator.slices(draft.unit(unit))


def _drawing(study: Study, youngs_modulus_pa: float, library: Library) -> Callable[[int], Bytes]:
    """Return the worker's function from a unit's number to its slices, drawn from the library."""
    draft = dataset.draft_plan(study)
    return lambda unit: library_slices(study, youngs_modulus_pa, draft.unit(unit), library)
