"""How far a calibrated E is off: the table of docs/calibration.md, "Accuracy".

Virtual eyes: sections of the deformed mesh, boundaries with the roughness of speckle (5
um along the normal), eyes that shift by up to 0.2 mm between the frames, of 6 to 58 mN.
The contact's angle is not known. Linear eyes are calibrated by the filter with the
linear wall, bent ones (three-dimensional finite strain, half a minute each) on all
frames and forces at once with the response library of the user's cache.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import click
import numpy as np

from figures.accuracy import FoundModuli, found_moduli, percent, rms
from figures.printing import STUDY, print_table, whole_number
from ideal_boundaries import ideal_boundaries, virtual_sections
from scleraforce.calibration.filter.eye_filter import (
    FrameStep,
    assimilate,
    begin_with,
)
from scleraforce.calibration.filter.eye_parameters import polar_spread_rad
from scleraforce.calibration.filter.linear_sections import LinearEye, linear_eye
from scleraforce.calibration.start_of_an_eye import ForceFrame
from scleraforce.calibration.stiffness_from_forces import (
    eye_of_forces,
    search_stiffening,
)
from scleraforce.lab.tissue_light import Pose
from scleraforce.lab.virtual_eye import BentSections, SectionsAt
from scleraforce.library import Library
from scleraforce.library.library_store import cached_library
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study
from scleraforce.wall.wall_in_metres import Boundaries
from virtual_eyes import changed

Frame = tuple[Boundaries, float]  # and its force, N

ROUGHNESS_M = 5e-6
NO_ZERO = np.diag([1e-18, 1e-18])  # of a force sensor without offset and drift
FIRST = (3, 5)  # frames after which bent eyes are judged, beside all


def drawn_eye(number: int, rng: np.random.Generator) -> Setup:
    """Return one of many eyes: three thicknesses in turn, all else drawn."""
    return changed(
        Setup(),
        name=f"eye-{number}",
        thickness_m=(0.5e-3, 0.65e-3, 0.8e-3)[number % 3],
        youngs_modulus_pa=float(rng.uniform(0.2e6, 0.35e6)),
        iop_pa=float(rng.uniform(150.0, 400.0)),
        gap_m=float(rng.uniform(0.4e-3, 0.8e-3)),
        polar_rad=float(rng.uniform(0.436, 0.785)),
        azimuth_rad=float(rng.uniform(0.0, 6.28)),
    )


def bent_eye(number: int, rng: np.random.Generator) -> Setup:
    """Return an eye of the ranges that the force reader is judged on."""
    return changed(
        Setup(),
        name=f"bent-{number}",
        thickness_m=float(rng.uniform(0.45e-3, 0.85e-3)),
        youngs_modulus_pa=float(rng.uniform(0.2e6, 0.5e6)),
        iop_pa=float(rng.uniform(133.0, 533.0)),
        gap_m=float(rng.uniform(0.4e-3, 0.9e-3)),
        polar_rad=float(rng.uniform(0.436, 0.785)),
        direction_rad=float(rng.uniform(0.0, 6.28)),
    )


def stated(study: Study, setup: Setup) -> Setup:
    """Return what a recording would state; the contact's angle is not known."""
    low, high = study.needle.polar_angle_rad.bounds
    return Setup(
        eye=Eye(iop_pa=setup.eye.iop_pa, thickness_m=setup.eye.thickness_m, globe=OPEN),
        needle=Needle(gap_m=setup.needle.gap_m, polar_rad=(low + high) / 2),
        scan=Scan(direction_rad=setup.scan.direction_rad),
    )


@cache
def linear_wall(study: Study, thickness_m: float) -> LinearWall:
    """Return the factored wall of a thickness, at the study's mesh."""
    mesh = study.mesh
    sizes = mesh.divisions, mesh.level, mesh.layers, mesh.order
    built = build_mesh(study.eye.radius_m, thickness_m, *sizes)
    return LinearWall(built, study.eye.poisson_ratio)


def draw_frames(
    study: Study, count: int, rng: np.random.Generator, sections_at: SectionsAt
) -> Iterator[Frame]:
    """Yield the frames of a virtual eye."""
    forces_n = rng.uniform(6e-3, 58e-3, count).tolist()
    smoothing_m = study.calibration.surface_smoothing_m

    for force_n, section in zip(forces_n, sections_at(forces_n), strict=True):
        lateral_m, depth_m = rng.uniform(-0.2e-3, 0.2e-3, 2)
        pose = Pose(lateral_m=lateral_m, depth_m=0.5e-3 + depth_m)
        boundaries = ideal_boundaries(
            section, pose, study.oct, ROUGHNESS_M, rng, smoothing_m
        )
        yield boundaries, force_n


def filtered(
    study: Study, model: LinearEye, frames: list[Frame], true_pa: float
) -> tuple[float, float]:
    """Return error and standard deviation of E after the filter, both over the true
    one.
    """
    session = begin_with(model, study.calibration, zero_covariance=NO_ZERO)
    for boundaries, force_n in frames:
        step = assimilate(session, boundaries, force_n)
        if isinstance(step, FrameStep):
            session = replace(session, state=step.state)

    return compared(session.modulus, true_pa)


def calibrated(
    study: Study, setup: Setup, library: Library, frames: list[Frame], true_pa: float
) -> tuple[float, float]:
    """Return error and standard deviation of E from the problem of all frames and their
    forces, both over the true one.
    """
    seen = [
        ForceFrame(wall=boundaries, force_n=force_n) for boundaries, force_n in frames
    ]
    found = search_stiffening(
        library,
        lambda of_tissue, before: eye_of_forces(setup, seen, of_tissue, study, before),
    )
    assert found is not None  # the library has these eyes
    _, (known, _) = found
    assert known.eye.modulus is not None
    return compared(known.eye.modulus, true_pa)


def compared(modulus: Modulus, true_pa: float) -> tuple[float, float]:
    """Return error and standard deviation of a modulus, both over the true one."""
    return modulus.mean_pa / true_pa - 1.0, modulus.sd_pa / true_pa


def linear_moduli(study: Study, eyes: int, count: int) -> FoundModuli:
    """Return E of linear eyes after all frames."""
    rng = np.random.default_rng(0)
    spread_rad = polar_spread_rad(Needle(), study)

    def found(number: int) -> tuple[float, float]:
        setup = drawn_eye(number, rng)
        assert setup.eye.thickness_m is not None
        wall = linear_wall(study, setup.eye.thickness_m)
        model = linear_eye(study, stated(study, setup), polar_sd_rad=spread_rad)
        frames = draw_frames(
            study,
            count,
            rng,
            lambda forces_n: virtual_sections(wall, setup, forces_n, study),
        )
        return filtered(study, model, list(frames), setup.eye.modulus_pa)

    return found_moduli(map(found, range(eyes)))


def bent_moduli(study: Study, eyes: int, count: int) -> dict[int, FoundModuli]:
    """Return E of eyes bent in 3-D after some and all of the frames."""
    rng = np.random.default_rng(0)
    library = cached_library(study)
    found: dict[int, list[tuple[float, float]]] = {used: [] for used in (*FIRST, count)}

    for number in range(eyes):
        setup = bent_eye(number, rng)
        frames = list(draw_frames(study, count, rng, BentSections(setup, study)))
        known = stated(study, setup)
        for used, pairs in found.items():
            true_pa = setup.eye.modulus_pa
            pairs.append(calibrated(study, known, library, frames[:used], true_pa))

    return {used: found_moduli(pairs) for used, pairs in found.items()}


def rows(study: Study, linear: int, bent: int, frames: int) -> Iterator[list[str]]:
    """Yield the rows of the table."""

    def row(name: str, found: FoundModuli) -> list[str]:
        errors = found.errors
        numbers = errors.mean(), rms(errors), np.abs(errors).max()
        return [
            name,
            *(percent(value, "+.2f") for value in numbers),
            found.within_two_sd,
        ]

    if linear:
        found = linear_moduli(study, linear, frames)
        yield row(f"linear, {linear} eyes, {frames} frames", found)
    if bent:
        for used, found in bent_moduli(study, bent, frames).items():
            yield row(f"finite strain, {bent} eyes, {used} frames", found)


@click.command(help=__doc__)
@whole_number("--linear", 50, "Linear eyes.")
@whole_number("--bent", 6, "Eyes of finite strain.")
@whole_number("--frames", 24, "Frames of each eye.")
@STUDY
def main(linear: int, bent: int, frames: int, study: Study) -> None:
    """Print the table."""
    head = ["error of E", "mean, %", "rms, %", "largest, %", "within two sd"]
    print_table(head, rows(study, linear, bent, frames))
