"""Measure a calibration: time of a step, effect of wrongly declared inputs, coverage
over many eyes.

    python benchmarks/bench_calibration.py [LINEAR EYES, 50] [BENT EYES, 5]
        [--frames 24] [--study FILE]

The eyes are virtual: sections of the deformed mesh, boundaries with the roughness of
speckle (5 um along the normal), eyes that shift by up to 0.2 mm between the frames, of
6 to 58 mN. Linear eyes are calibrated with the linear wall, bent ones
(three-dimensional finite strain, half a minute each) with the response library of the
user's cache.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from calibration_eyes import drawn_eye, stated
from ideal_boundaries import ideal_boundaries, virtual_sections
from scleraforce.calibration.filter.eye_filter import (
    EyeSession,
    FrameStep,
    assimilate,
    begin_with,
)
from scleraforce.calibration.filter.eye_parameters import polar_spread_rad
from scleraforce.calibration.filter.library_sections import LibrarySections, library_eye
from scleraforce.calibration.filter.linear_sections import LinearEye, linear_eye
from scleraforce.lab.tissue_light import Pose
from scleraforce.lab.virtual_eye import BentSections, SectionsAt
from scleraforce.library.library_store import cached_library
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.needle import Needle
from scleraforce.records.scan import Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import Study, read_study
from scleraforce.wall.wall_in_metres import Boundaries
from virtual_eyes import changed, wall_of

EyeModel = LibrarySections | LinearEye


@cache
def wall(study: Study, thickness_m: float) -> LinearWall:
    """Return the factored wall of a thickness, at the study's mesh."""
    mesh = study.mesh
    built = build_mesh(
        study.eye.radius_m,
        thickness_m,
        mesh.divisions,
        mesh.level,
        mesh.layers,
        mesh.order,
    )

    return LinearWall(built, study.eye.poisson_ratio)


Frame = tuple[Boundaries, float]  # and its force, N
NO_ZERO = np.diag([1e-18, 1e-18])  # of a force sensor without offset and drift


def frames(
    study: Study, count: int, rng: np.random.Generator, sections_at: SectionsAt
) -> list[Frame]:
    """Return the frames of a virtual eye."""
    forces = rng.uniform(6e-3, 58e-3, count).tolist()
    made = []

    for force_n, section in zip(forces, sections_at(forces), strict=True):
        lateral_m, depth_m = rng.uniform(-0.2e-3, 0.2e-3, 2)
        pose = Pose(lateral_m=lateral_m, depth_m=0.5e-3 + depth_m)
        smoothing_m = study.calibration.surface_smoothing_m
        boundaries = ideal_boundaries(section, pose, study.oct, 5e-6, rng, smoothing_m)
        made.append((boundaries, force_n))

    return made


def linear_frames(
    study: Study, count: int, setup: Setup, rng: np.random.Generator
) -> list[Frame]:
    """Return the frames of an eye of linear mechanics, whose wall may serve several."""
    built = wall(study, wall_of(setup).thickness_m)
    return frames(
        study, count, rng, lambda forces: virtual_sections(built, setup, forces, study)
    )


def calibrated(
    study: Study, model: EyeModel, inputs: list[Frame]
) -> tuple[float, float, list[float]]:
    """Return mean and standard deviation of E, and the time of each step in s."""
    session = begun(study, model)
    seconds = []

    for frame in inputs:
        start = time.perf_counter()
        step = assimilate(session, *frame)
        seconds.append(time.perf_counter() - start)
        if isinstance(step, FrameStep):
            session = replace(session, state=step.state)

    modulus = session.modulus
    return (
        (modulus.mean_pa, modulus.sd_pa, seconds)
        if session.updates
        else (np.nan, np.nan, seconds)
    )


def begun(study: Study, model: EyeModel) -> EyeSession:
    """Return an eye before its first frame."""
    return begin_with(model, study.calibration, zero_covariance=NO_ZERO)


def print_step_time(study: Study, model: EyeModel, inputs: list[Frame]) -> None:
    """Print the time of a step: registration, observation, two sigma points,
    correction.
    """
    seconds = np.array(calibrated(study, model, inputs)[2][1:])
    print(
        f"step (one frame): {1e3 * seconds.min():.1f} ms at best,"
        f" {1e3 * np.median(seconds):.1f} ms in the median"
    )


def unstated_polar_rad(study: Study) -> float:
    """Return the standard deviation of a polar angle that is not stated."""
    return polar_spread_rad(Needle(), study)


def print_wrong_statements(
    study: Study, setup: Setup, right: Setup, inputs: list[Frame]
) -> None:
    """Print what E becomes where thickness, gap or IOP are stated 10 % wrong."""
    changes: dict[str, Callable[[float], Setup]] = {
        "thickness": lambda share: changed(
            right, thickness_m=share * wall_of(right).thickness_m
        ),
        "gap": lambda share: changed(right, gap_m=share * wall_of(right).gap_m),
        "IOP": lambda share: changed(right, iop_pa=share * wall_of(right).iop_pa),
        "contact angle": lambda share: changed(
            right, polar_rad=share * wall_of(right).polar_rad
        ),
    }
    print(
        f"\nE of an eye of {setup.eye.modulus_pa / 1e6:.2f} MPa,"
        f" {wall_of(setup).thickness_m * 1e6:.0f} um, where stated wrong:"
    )
    print(f"{'':<16}{'-10 %':>10}{'+10 %':>10}")

    for name, change in changes.items():
        # an angle that is stated, as far as it is wrong
        spread_rad = 0.0 if name == "contact angle" else unstated_polar_rad(study)
        models = (
            linear_eye(study, change(share), polar_sd_rad=spread_rad)
            for share in (0.9, 1.1)
        )
        errors = [
            calibrated(study, model, inputs)[0] / setup.eye.modulus_pa - 1
            for model in models
        ]
        print(f"{name:<16}" + "".join(f"{100 * error:>+9.1f}%" for error in errors))


def print_honesty(study: Study, count: int, frame_count: int) -> None:
    """Print how far E is off over many eyes, and how often it lies within what the
    posterior says.
    """
    rng = np.random.default_rng(0)
    errors = []
    scores = []
    sds = []

    for number in range(count):
        setup = drawn_eye(number, rng)
        mean, sd, _ = calibrated(
            study,
            linear_eye(
                study, stated(study, setup), polar_sd_rad=unstated_polar_rad(study)
            ),
            linear_frames(study, frame_count, setup, rng),
        )
        errors.append(mean / setup.eye.modulus_pa - 1)
        scores.append(abs(mean - setup.eye.modulus_pa) / sd)
        sds.append(sd)

    print(
        f"\n{count} eyes, {frame_count} frames each, contact angle unknown (25 to 45"
        " degrees):"
    )
    rms = np.sqrt(np.mean(np.square(errors)))
    largest = np.abs(errors).max()
    print(
        f"error of E: mean {100 * np.mean(errors):+.2f} %, rms {100 * rms:.2f} %,"
        f" largest {100 * largest:.2f} %"
    )
    honest = np.mean(np.array(scores) < 2)
    print(
        f"posterior sd: largest {max(sds) / 1e3:.1f} kPa; true E within two sd:"
        f" {100 * honest:.0f} %"
    )


def draw_bent_eye(number: int, rng: np.random.Generator) -> Setup:
    """Return an eye of the ranges that the force reader is judged on."""
    return Setup(
        eye=Eye(
            f"bent-{number}",
            thickness_m=float(rng.uniform(0.45e-3, 0.85e-3)),
            modulus=Modulus.stated(float(rng.uniform(0.2e6, 0.5e6))),
            iop_pa=float(rng.uniform(133.0, 533.0)),
        ),
        needle=Needle(
            gap_m=float(rng.uniform(0.4e-3, 0.9e-3)),
            polar_rad=float(rng.uniform(0.436, 0.785)),
        ),
        scan=Scan(direction_rad=float(rng.uniform(0.0, 6.28))),
    )


def print_bent(study: Study, count: int, frame_count: int) -> None:
    """Print how far E of bent eyes is off after 3, 5 and all frames, and what low and
    high forces say on their own.
    """
    library = cached_library(study)
    rng = np.random.default_rng(0)
    print(
        f"\n{count} eyes of three-dimensional finite strain, contact angle unknown;"
        " error of E in % (sd):"
    )
    print(
        f"{'t/um':>6}{'E/MPa':>7}{'mmHg':>6}{'angle':>6}"
        + "".join(f"{n:>16}" for n in ("3 frames", "5", "all"))
        + f"{'below 20 mN':>14}{'above 35 mN':>13}{'step/ms':>9}"
    )
    found = []

    for number in range(count):
        setup = draw_bent_eye(number, rng)
        inputs = frames(study, frame_count, rng, BentSections(setup, study))
        model = library_eye(
            study, stated(study, setup), library, unstated_polar_rad(study)
        )
        runs = [calibrated(study, model, inputs[:used]) for used in (3, 5, frame_count)]
        found.append(
            [
                ((mean / setup.eye.modulus_pa - 1), sd / setup.eye.modulus_pa)
                for mean, sd, _ in runs
            ]
        )
        low, high = own_moduli(study, model, inputs, setup)
        true_wall = wall_of(setup)
        print(
            f"{true_wall.thickness_m * 1e6:>6.0f}"
            f"{true_wall.youngs_modulus_pa / 1e6:>7.3f}"
            f"{true_wall.iop_pa / 133.3:>6.1f}{np.degrees(true_wall.polar_rad):>6.0f}"
            + "".join(
                f"{100 * error:>+9.2f} ({100 * sd:.1f})" for error, sd in found[-1]
            )
            + f"{_percent(low):>14}{_percent(high):>13}"
            f"{1e3 * np.median(runs[-1][2][1:]):>9.1f}",
            flush=True,
        )

    errors = np.array(found)
    for used, (error, sd) in zip(
        (3, 5, frame_count), np.moveaxis(errors, 0, 2), strict=True
    ):
        honest = 100 * np.mean(np.abs(error) < 2 * sd)
        rms = np.sqrt(np.mean(error**2))
        largest = np.abs(error).max()
        print(
            f"after {used} frames: mean {100 * error.mean():+.2f} %, rms"
            f" {100 * rms:.2f} %, largest {100 * largest:.2f} %; within two sd:"
            f" {honest:.0f} %"
        )


def own_moduli(
    study: Study, model: EyeModel, inputs: list[Frame], setup: Setup
) -> tuple[list[float], list[float]]:
    """Return the errors of E from single frames, below 20 mN and above 35 mN."""
    session = begun(study, model)
    alone = []

    for boundaries, force_n in inputs:
        step = assimilate(session, boundaries, force_n)
        if isinstance(step, FrameStep):
            session = replace(session, state=step.state)
            alone.append(
                (
                    force_n,
                    step.registered.wall.youngs_modulus_pa / setup.eye.modulus_pa - 1,
                )
            )

    low = [error for force_n, error in alone if force_n < 20e-3]
    high = [error for force_n, error in alone if force_n > 35e-3]
    return low, high


def _percent(errors: list[float]) -> str:
    """Return the median of errors; of none, a dash."""
    return f"{100 * np.median(errors):+.1f}" if errors else "-"


def print_linear(study: Study, count: int, frame_count: int) -> None:
    """Print the figures of the linear wall."""
    setup = Setup(
        eye=Eye(
            "eye-1", thickness_m=0.8e-3, modulus=Modulus.stated(0.27e6), iop_pa=266.6
        ),
        needle=Needle(gap_m=0.5e-3, polar_rad=0.611, azimuth_rad=1.0),
    )
    inputs = linear_frames(study, frame_count, setup, np.random.default_rng(1))
    right = changed(stated(study, setup), polar_rad=wall_of(setup).polar_rad)
    model = linear_eye(study, right, polar_sd_rad=unstated_polar_rad(study))
    print_step_time(study, model, inputs)
    print_wrong_statements(study, setup, right, inputs)
    print_honesty(study, count, frame_count)


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("linear_eyes", type=int, nargs="?", default=50)
    parser.add_argument("bent_eyes", type=int, nargs="?", default=5)
    parser.add_argument("--frames", type=int, default=24, help="of each eye")
    parser.add_argument("--study", type=Path, help="the paper's where none is given")
    given = parser.parse_args()
    study = read_study(given.study) if given.study else Study()

    if given.linear_eyes:
        print_linear(study, given.linear_eyes, given.frames)
    if given.bent_eyes:
        print_bent(study, given.bent_eyes, given.frames)


if __name__ == "__main__":
    main()
