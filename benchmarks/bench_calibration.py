"""The figures of a calibration: step time, errors of what is stated wrongly, honesty over 50 eyes.

    python benchmarks/bench_calibration.py [EYES]

The eyes are virtual: sections of the deformed mesh, boundaries with the roughness of speckle (5 um along the normal),
eyes that shift by up to 0.2 mm between 24 frames of 6 to 58 mN.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from scleraforce.calibration.assimilation import FrameInput, FrameStep, assimilate, eye_filter, first_state
from scleraforce.calibration.eye_model import EyeConstants, EyeModel
from scleraforce.calibration.linear_eye import linear_eye
from scleraforce.calibration.virtual import ideal_boundaries, virtual_sections
from scleraforce.eye.mesh import build_mesh
from scleraforce.imaging.optics import Pose
from scleraforce.mechanics.linear import LinearWall
from scleraforce.recording.virtual_eye import PhantomEye
from scleraforce.study import Study

STUDY = Study()
FRAMES = 24


@cache
def wall(thickness_m: float) -> LinearWall:
    """Return the factored wall of a thickness, at the study's mesh."""
    mesh = STUDY.mesh
    built = build_mesh(STUDY.eye.radius_m, thickness_m, mesh.divisions, mesh.level, mesh.layers, mesh.order)
    return LinearWall(built, STUDY.eye.poisson_ratio)


def frames(eye: PhantomEye, rng: np.random.Generator) -> list[FrameInput]:
    """Return the frames of a virtual eye."""
    forces = rng.uniform(6e-3, 58e-3, FRAMES).tolist()
    made = []
    for force_n, section in zip(forces, virtual_sections(wall(eye.thickness_m), eye, forces, STUDY), strict=True):
        lateral_m, depth_m = rng.uniform(-0.2e-3, 0.2e-3, 2)
        pose, smoothing_m = Pose(lateral_m, 0.5e-3 + depth_m), STUDY.calibration.surface_smoothing_m
        boundaries = ideal_boundaries(section, pose, STUDY.oct, 5e-6, rng, smoothing_m)
        made.append(FrameInput(boundaries, force_n, 0.0, np.diag([1e-18, 1e-18])))
    return made


def stated(eye: PhantomEye) -> EyeConstants:
    """Return what a recording would state; the contact's angle is not known."""
    low, high = STUDY.needle.polar_angle_rad.bounds
    return EyeConstants(eye.iop_pa, eye.thickness_m, eye.gap_m, (low + high) / 2, (high - low) / 12**0.5)


def calibrated(model: EyeModel, inputs: list[FrameInput]) -> tuple[float, float, list[float]]:
    """Return mean and standard deviation of E, and the time of each step in s."""
    filtered = eye_filter(model, STUDY.calibration)
    state, mean, sd, seconds = first_state(filtered), np.nan, np.nan, []
    for frame in inputs:
        start = time.perf_counter()
        step = assimilate(filtered, state, frame)
        seconds.append(time.perf_counter() - start)
        if isinstance(step, FrameStep):
            state, mean, sd = step.state, float(step.moments[0][0]), float(step.moments[1][0])
    return mean, sd, seconds


def print_step_time(model: EyeModel, inputs: list[FrameInput]) -> None:
    """Print the time of a step: registration, observation, two sigma points, correction."""
    seconds = np.array(calibrated(model, inputs)[2][1:])
    print(f"step (one frame): {1e3 * seconds.min():.1f} ms at best, {1e3 * np.median(seconds):.1f} ms in the median")


def print_wrong_statements(eye: PhantomEye, right: EyeConstants, inputs: list[FrameInput]) -> None:
    """Print what E becomes where thickness, gap or IOP are stated 10 % wrong."""
    changes: dict[str, Callable[[float], EyeConstants]] = {
        "thickness": lambda share: replace(right, thickness_m=share * right.thickness_m),
        "gap": lambda share: replace(right, gap_m=share * right.gap_m),
        "IOP": lambda share: replace(right, iop_pa=share * right.iop_pa),
        "contact angle": lambda share: replace(right, polar_rad=share * right.polar_rad, polar_sd_rad=0.0),
    }
    print(
        f"\nE of an eye of {eye.youngs_modulus_pa / 1e6:.2f} MPa, {eye.thickness_m * 1e6:.0f} um, where stated wrong:"
    )
    print(f"{'':<16}{'-10 %':>10}{'+10 %':>10}")
    for name, change in changes.items():
        errors = [
            calibrated(linear_eye(STUDY, change(share)), inputs)[0] / eye.youngs_modulus_pa - 1
            for share in (0.9, 1.1)
        ]
        print(f"{name:<16}" + "".join(f"{100 * error:>+9.1f}%" for error in errors))


def print_honesty(count: int) -> None:
    """Print how far E is off over many eyes, and how often it lies within what the posterior says."""
    rng, errors, scores, sds = np.random.default_rng(0), [], [], []
    for number in range(count):
        eye = PhantomEye(
            f"eye-{number}",
            (0.5e-3, 0.65e-3, 0.8e-3)[number % 3],
            float(rng.uniform(0.2e6, 0.35e6)),
            float(rng.uniform(150.0, 400.0)),
            float(rng.uniform(0.4e-3, 0.8e-3)),
            float(rng.uniform(0.436, 0.785)),
            float(rng.uniform(0.0, 6.28)),
        )
        mean, sd, _ = calibrated(linear_eye(STUDY, stated(eye)), frames(eye, rng))
        errors.append(mean / eye.youngs_modulus_pa - 1)
        scores.append(abs(mean - eye.youngs_modulus_pa) / sd)
        sds.append(sd)
    print(f"\n{count} eyes, {FRAMES} frames each, contact angle unknown (25 to 45 degrees):")
    rms, largest = np.sqrt(np.mean(np.square(errors))), np.abs(errors).max()
    print(f"error of E: mean {100 * np.mean(errors):+.2f} %, rms {100 * rms:.2f} %, largest {100 * largest:.2f} %")
    honest = np.mean(np.array(scores) < 2)
    print(f"posterior sd: largest {max(sds) / 1e3:.1f} kPa; true E within two sd: {100 * honest:.0f} %")


def main() -> None:
    """Print all figures."""
    eye = PhantomEye("eye-1", 0.8e-3, 0.27e6, 266.6, 0.5e-3, 0.611, 1.0)
    inputs = frames(eye, np.random.default_rng(1))
    right = replace(stated(eye), polar_rad=eye.polar_rad)
    model = linear_eye(STUDY, right)
    print_step_time(model, inputs)
    print_wrong_statements(eye, right, inputs)
    print_honesty(int(sys.argv[1]) if len(sys.argv) > 1 else 50)


if __name__ == "__main__":
    main()
