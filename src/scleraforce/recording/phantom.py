"""The virtual laboratory: a recording folder of a virtual eye, as a scanner and a force sensor would write it.

Beside the recording's own files stands `truth.json`: every parameter that was drawn, the true force and the pose of
each frame, the seed and the versions.
"""

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from zlib import crc32

import cv2
import numpy as np
import scipy
from numpy.typing import NDArray

from scleraforce import __version__
from scleraforce.errors import RecordingError
from scleraforce.eye.form import thickness_factor
from scleraforce.imaging.bscan import Bscan, render_bscan
from scleraforce.imaging.optics import BscanOptics, Pose, sample_optics
from scleraforce.imaging.plane import Section
from scleraforce.recording.info import EyeInfo, ForceInfo, NeedleInfo, OctInfo, RecordingInfo, nearest_gauge
from scleraforce.recording.pushes import Push, Sensor, format_log, plan_pushes, sample_sensor, sense, true_force
from scleraforce.recording.virtual_eye import PhantomEye, SectionsAt
from scleraforce.study import Study, draw, study_hash
from scleraforce.study.toml import format_record

__all__ = ["PhantomFrame", "PhantomPlan", "plan_phantom", "true_forces", "write_phantom"]

AXIS, CONTACT_SIGN = "fz", -1
TAIL_S = 1.5  # of the log, after the last push

# Streams of random numbers of a recording.
OPTICS, PUSHES, SENSOR, NOISE, FRAME = range(5)


@dataclass(frozen=True)
class PhantomFrame:
    """One frame: its push, where the eye lies in it, its optics, and the key of its random numbers."""

    file: str
    push: Push
    pose: Pose
    optics: BscanOptics
    seed: tuple[int, ...]


@dataclass(frozen=True)
class PhantomPlan:
    """A virtual acquisition, before anything is computed: all that was drawn."""

    eye: PhantomEye
    frames: tuple[PhantomFrame, ...]
    sensor: Sensor
    seed: int

    @property
    def pushes(self) -> tuple[Push, ...]:
        """The pushes, in order."""
        return tuple(frame.push for frame in self.frames)

    @property
    def forces_n(self) -> list[float]:
        """The true force at each frame's time, in N."""
        times_s = np.array([push.frame_s for push in self.pushes])
        return [float(f"{force_n:.12g}") for force_n in true_force(self.pushes, times_s)]


def plan_phantom(eye: PhantomEye, forces_n: Sequence[float], study: Study, seed: int) -> PhantomPlan:
    """Draw a virtual acquisition.

    The scanner, the wall's optics, the eye's place in the frame, the sensor and the tissue's relaxation are drawn once;
    shift of the eye, signal over noise, mirror reflection, shadows, and timing for each frame anew.

    Raises:
        RecordingError: no force is given, or one is not a force.
    """
    if not forces_n or not all(np.isfinite(force_n) and force_n >= 0.0 for force_n in forces_n):
        raise RecordingError(f"eye {eye.id}: forces: {list(forces_n)}; give at least one, none negative")
    phantom = study.phantom
    rng = _generator(eye, seed, OPTICS)
    scanner = sample_optics(phantom, study.oct, rng)
    surface_m, tilt_rad = draw(phantom.surface_depth_m, rng), draw(phantom.eye_tilt_rad, rng)
    pushes = plan_pushes(tuple(forces_n), phantom, _generator(eye, seed, PUSHES))
    frames = []
    for index, push in enumerate(pushes):
        rng = _generator(eye, seed, FRAME, index)
        of_frame = sample_optics(phantom, study.oct, rng)
        optics = replace(
            scanner, snr_db=of_frame.snr_db, reflection_db=of_frame.reflection_db, shadows=of_frame.shadows
        )
        shift_m = draw(phantom.eye_shift_m, rng)
        pose = Pose(draw(phantom.eye_shift_m, rng), surface_m + shift_m, tilt_rad)
        frames.append(PhantomFrame(f"{index + 1:04d}.png", push, pose, optics, _key(eye, seed, FRAME, index, 1)))
    return PhantomPlan(eye, tuple(frames), sample_sensor(phantom, _generator(eye, seed, SENSOR)), seed)


def render_frame(frame: PhantomFrame, section: Section, study: Study) -> Bscan:
    """Form one frame of a plan, from the section under its force."""
    rng = np.random.default_rng(frame.seed)
    return render_bscan(frame.pose.place(section), study.oct, frame.optics, rng)


def write_phantom(
    out: Path,
    plan: PhantomPlan,
    sections_at: SectionsAt,
    study: Study,
    progress: Callable[[int], object] | None = None,
) -> None:
    """Write a virtual acquisition as a recording folder with `truth.json`; equal plans give equal bytes.

    Args:
        out: the folder; it appears when it is complete, and must not exist yet (an empty one may).
        plan: what to acquire.
        sections_at: the eye's sections for needle forces in N (`study_sections`).
        study: frame size, classes, needle; the one that the plan was drawn from.
        progress: called with 1 after each frame.

    Raises:
        RecordingError: `out` exists, or cannot be written.
    """
    if out.exists() and not (out.is_dir() and not any(out.iterdir())):
        raise RecordingError(f"{out}: exists already; remove it or choose another folder")
    partial = out.parent / f".{out.name}.partial"
    try:
        shutil.rmtree(partial, ignore_errors=True)
        (partial / "frames").mkdir(parents=True)
        _write_tables(partial, plan, study)
        for frame, section in zip(plan.frames, sections_at(plan.forces_n), strict=True):
            (partial / "frames" / frame.file).write_bytes(_png(render_frame(frame, section, study).frame))
            if progress is not None:
                progress(1)
        partial.rename(out)
    except OSError as fault:
        raise RecordingError(f"{fault.filename or out}: {fault.strerror}") from fault
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def true_forces(recording: Path) -> dict[str, float]:
    """Return the true force at each frame of a virtual acquisition, N, by the frame's file.

    Raises:
        RecordingError: the recording has no `truth.json`, or it cannot be read.
    """
    path = recording / "truth.json"
    try:
        frames = json.loads(path.read_text(encoding="utf-8"))["frames"]
        return {frame["file"]: float(frame["force_n"]) for frame in frames}
    except OSError as fault:
        raise RecordingError(f"{path}: {fault.strerror}; virtual acquisitions have it") from fault
    except (ValueError, KeyError, TypeError) as fault:
        raise RecordingError(f"{path}: not the truth of a virtual acquisition: {fault}") from fault


def _write_tables(folder: Path, plan: PhantomPlan, study: Study) -> None:
    comment = f"# A virtual acquisition, made by scleraforce {__version__}; truth.json has all its parameters.\n\n"
    (folder / "recording.toml").write_text(comment + format_record(_info(plan.eye, study)), encoding="utf-8")
    lines = [f"{frame.file},{frame.push.frame_s:.4f}" for frame in plan.frames]
    (folder / "frames.csv").write_text("\n".join(["file,time_s", *lines]) + "\n", encoding="utf-8")
    axis = ("fx", "fy", "fz").index(AXIS)
    noise = _generator(plan.eye, plan.seed, NOISE)
    log = sense(plan.pushes, plan.sensor, axis, CONTACT_SIGN, plan.pushes[-1].end_s + TAIL_S, noise)
    (folder / "forces.csv").write_text(format_log(log), encoding="utf-8")
    truth = json.dumps(_truth(plan, study), indent=1, allow_nan=False)
    (folder / "truth.json").write_text(truth + "\n", encoding="utf-8")


def _info(eye: PhantomEye, study: Study) -> RecordingInfo:
    scanner = study.oct
    return RecordingInfo(
        EyeInfo(eye.id, eye.thickness_m, eye.iop_pa),
        OctInfo(
            scanner.columns,
            scanner.rows,
            scanner.bits,
            scanner.width_m,
            scanner.depth_m,
            eye.direction_rad,
            eye.tilt_rad,
            scanner.refractive_index,
        ),
        NeedleInfo(nearest_gauge(study.needle.outer_diameter_m), eye.gap_m, eye.polar_rad),
        ForceInfo(AXIS, CONTACT_SIGN),
    )


def _truth(plan: PhantomPlan, study: Study) -> dict[str, Any]:
    versions = {
        "scleraforce": __version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "opencv": cv2.__version__,
    }
    return {
        "simulated": True,
        "versions": versions,
        "study_hash": study_hash(study),
        "seed": plan.seed,
        "mechanics": asdict(study.mechanics),
        "eye": asdict(plan.eye),
        "form": asdict(study.form),
        "thickness_at_contact_m": _thickness_at_contact(plan.eye, study),
        "needle": asdict(study.needle),
        "sensor": asdict(plan.sensor),
        "frames": [
            {
                "file": frame.file,
                "time_s": frame.push.frame_s,
                "force_n": force_n,
                "target": study.classes.classify(force_n),
                "push": asdict(frame.push),
                "pose": asdict(frame.pose),
                "optics": asdict(frame.optics),
                "seed": list(frame.seed),
            }
            for frame, force_n in zip(plan.frames, plan.forces_n, strict=True)
        ],
    }


def _thickness_at_contact(eye: PhantomEye, study: Study) -> float:
    return eye.thickness_m * float(thickness_factor(study.form, eye.plane.contact.normal))


def _png(frame: NDArray[np.uint16]) -> bytes:
    done, data = cv2.imencode(".png", frame)
    assert done
    return bytes(data)


def _key(eye: PhantomEye, seed: int, *stream: int) -> tuple[int, ...]:
    """Return the entropy of a stream: eyes of different names differ, also under one seed."""
    return seed, crc32(eye.id.encode()), *stream


def _generator(eye: PhantomEye, seed: int, *stream: int) -> np.random.Generator:
    return np.random.default_rng(_key(eye, seed, *stream))
