"""The eyes of the figures, computed in three dimensions at finite strain and imaged by
the virtual laboratory.
"""

import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from figures.accuracy import ReadForces, read_forces
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.reuse import is_made, note_stale, remove, write_key
from figures.scans import renderer_of
from figures.sections import ROOM, compute_eye
from scleraforce.base.errors import ScleraforceError
from scleraforce.base.whole_files import renamed_when_whole, write_whole
from scleraforce.base.worker_processes import work_units
from scleraforce.calibration.evaluation import FrameAnswer
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.lab.virtual_recording import (
    PhantomFrame,
    plan_phantom,
    plan_sections,
    write_phantom,
)
from scleraforce.mechanics.contact_and_section import WallSection
from scleraforce.recordings.recording_folder import read_info
from scleraforce.records.decoder import format_record
from scleraforce.records.fields import declared
from scleraforce.records.needle import lean_ends
from scleraforce.records.study import Study


@dataclass(frozen=True, eq=False)
class MadeEye:
    """A computed eye: its frames in order.

    `forces_n` and `tips_m` (frame,): true force and depth of the dent. `lowest_m`
    (frame, boundary): the largest depth in the frame of the outer and the inner
    boundary, over the columns that show tissue.
    """

    files: tuple[str, ...]
    forces_n: NDArray[np.float64]
    tips_m: NDArray[np.float64]
    lowest_m: NDArray[np.float64]

    def in_window(self, depth_m: float) -> NDArray[np.bool_]:
        """Return whether the wall's surface stays within a frame of this depth,
        (frame,).
        """
        inside: NDArray[np.bool_] = self.lowest_m[:, 0] < depth_m
        return inside


def make_recordings(
    folder: FiguresFolder,
    eyes: Sequence[FigureEye],
    workers: int,
    progress: Callable[[int], object],
) -> tuple[str, ...]:
    """Compute and image the eyes that the folder lacks or has from other code.

    Args:
        folder: where they go.
        eyes: all eyes.
        workers: processes.
        progress: called with the number of eyes that are newly done, or found done.

    Returns:
        The names of the eyes that failed; their messages are on standard error.
    """
    missing = tuple(
        eye for eye in eyes if not is_made(folder.recording(eye), recording_key(eye))
    )
    for eye in missing:
        note_stale(folder.recording(eye))

    progress(len(eyes) - len(missing))
    failed = []
    units = work_units(partial(_making, folder, missing), range(len(missing)), workers)
    with closing(units) as made:
        for number, fault in made:
            if fault:
                failed.append(eye_name(missing[number].setup))
                print(f"{failed[-1]}: {fault}", file=sys.stderr)

            progress(1)

    return tuple(failed)


def _making(folder: FiguresFolder, eyes: Sequence[FigureEye]) -> Callable[[int], str]:
    """Return the function that makes an eye in a worker: its number -> the fault."""

    def work(number: int) -> str:
        try:
            make_eye(folder, eyes[number])
        except ScleraforceError as fault:
            return str(fault)
        return ""

    return work


def make_eye(folder: FiguresFolder, drawn: FigureEye) -> None:
    """Compute one eye and write its recording, which appears last, and beside it what
    is known of it.

    Raises:
        ScleraforceError: the eye cannot be computed.
    """
    computed = compute_eye(drawn)
    forces_n = drawn.forces_n(computed.largest_n)
    plan = plan_phantom(drawn.setup, forces_n, drawn.study, drawn.seed)

    deepest_n = max(plan.normal_n)
    if deepest_n > computed.largest_n:
        # dents of tissue that relaxes are deeper; elastic forces grow with all forces
        share = (1.0 - ROOM) * computed.largest_n / deepest_n
        plan = plan_phantom(
            drawn.setup,
            [share * force_n for force_n in forces_n],
            drawn.study,
            drawn.seed,
        )

    sections_at = computed.sections_at
    pairs = zip(plan.frames, plan_sections(plan, sections_at)[0], strict=True)
    made = MadeEye(
        files=tuple(frame.file for frame in plan.frames),
        forces_n=np.array(plan.forces_n),
        tips_m=np.array(computed.tips_m(plan.normal_n)),
        lowest_m=np.array(
            [lowest_m(frame, section, drawn.study) for frame, section in pairs]
        ),
    )
    _write_made(folder, drawn, made)
    recording = folder.recording(drawn)
    recording.parent.mkdir(parents=True, exist_ok=True)
    remove(recording)
    thickness_m = declared(drawn.setup.eye.thickness_m, "thickness_m")
    render = (
        None
        if drawn.scan is None
        else renderer_of(drawn.scan, thickness_m, drawn.study.oct)
    )
    write_phantom(
        recording,
        plan,
        sections_at,
        drawn.study,
        tell_globe=drawn.tell_globe,
        render=render,
    )

    if drawn.lean is not None:
        info = read_info(recording / "recording.toml")
        info = replace(
            info, needle=replace(info.needle, lean_rad=lean_ends(drawn.lean.angle_rad))
        )
        write_whole(format_record(info), recording / "recording.toml")

    write_key(recording, recording_key(drawn))


def recording_key(drawn: FigureEye) -> str:
    """Return the key of an eye's recording: a hash of all that is drawn of it."""
    return sha256(repr(drawn).encode()).hexdigest()


def lowest_m(
    frame: PhantomFrame, section: WallSection, study: Study
) -> tuple[float, float]:
    """Return how deep in the frame the outer and the inner boundary go in the columns
    between the black bands.
    """
    placed = frame.pose.place(section)
    half_m = study.oct.width_m / 2 - frame.optics.band_m
    outer, inner = (
        curve[np.abs(curve[:, 0]) < half_m, 1].max()
        for curve in (placed.outer, placed.inner)
    )

    return float(outer), float(inner)


def _write_made(folder: FiguresFolder, drawn: FigureEye, made: MadeEye) -> None:
    path = folder.made(drawn)
    path.parent.mkdir(parents=True, exist_ok=True)
    with renamed_when_whole(path) as part, part.open("wb") as file:
        np.savez(file, **vars(made))


def true_forces(
    folder: FiguresFolder, eye: FigureEye, frames: Iterable[FrameAnswer]
) -> ReadForces:
    """Return the forces that frames of an eye were read with, beside the true ones."""
    made = read_made(folder, eye)
    true_n = dict(zip(made.files, made.forces_n.tolist(), strict=True))
    return read_forces((frame.answer, true_n[frame.file]) for frame in frames)


def read_made(folder: FiguresFolder, drawn: FigureEye) -> MadeEye:
    """Return what is known of an eye that was made."""
    with np.load(folder.made(drawn)) as kept:
        return MadeEye(
            tuple(kept["files"].tolist()),
            kept["forces_n"],
            kept["tips_m"],
            kept["lowest_m"],
        )
