"""Calibrate on logs whose force falls in each hold, and read: the table of
docs/calibration.md.

    python benchmarks/bench_hold_forces.py [--eyes 2] [--seed 7] [--holds 2 8 20]
        [--kinds needle,tissue] [--frames 1 3] [--keep FOLDER]

Eyes in three dimensions, imaged by the virtual laboratory. Who yields in a hold:

- needle: the walls are elastic, and the force falls by 12 % with 1.2 s while the dent
  follows it; each push begins anew;
- holder: the same, but the holder remembers the pushes before, as a spring beside a
  damper does;
- tissue: the dent stays, and the force falls by 12 % with 1.2 s and 15 % with 12 s;
- pork: by 27 % with 0.4 s and 33 % with 4.3 s;
- steady: nothing yields.

Each eye has two recordings of ten pushes. Three frames of the first one calibrate, and
its others are read; or all of them do, and the second one is read. Either is done with
nothing declared, and with the truth declared, whose intervals the last column compares
with. `--frames 3` has three frames in each hold. With `--keep` the recordings stay, for
another run.
"""

import argparse
import pickle
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import scleraforce as sf
from calibration_eyes import drawn_eye
from scleraforce.lab.needle_pushes import NeedlePath
from scleraforce.lab.virtual_eye import BentSections, eye_name, scan_plane
from scleraforce.lab.virtual_recording import (
    PhantomFrame,
    PhantomPlan,
    plan_phantom,
    write_phantom,
)
from scleraforce.mechanics.finite_strain_wall import bend_eye
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.tissue_material import PronySeries
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range, Study, TissueStudy, fixed
from scleraforce.records.tissue_relaxation import Relaxation
from virtual_eyes import changed, wall_of

FALL = PronySeries((0.12,), (1.2,))
ELASTIC = PronySeries((), ())
TISSUES = {
    "needle": FALL,
    "holder": FALL,
    "tissue": PronySeries((0.12, 0.15), (1.2, 12.0)),
    "pork": PronySeries((0.27, 0.33), (0.4, 4.3)),
    "steady": ELASTIC,
}
YIELDS = ("needle", "holder")  # kinds whose dent follows the force
PUSHES = 10
SHARES = (0.08, 1.0)  # of the largest force
LARGEST_N = 45e-3
BEYOND = 1.7  # times the largest force: the dents of pork
STEP_S = 0.05  # of the path of a needle that yields
# of a hold: in shorter ones, and near the ends of one, a label averages over less
SHORT_S = 4.0
SHORT_AVERAGE_S = 0.4


@dataclass(frozen=True)
class Case:
    """Who yields, how long a hold is, and how many frames it has."""

    kind: str
    hold_s: float
    frames: int


def case_study(case: Case) -> Study:
    """Return the study of a case: pushes 2 s apart, a frame in the middle of a hold."""
    study = Study()
    middle_s = 0.55 * min(case.hold_s, 8.0)
    phantom = replace(
        study.phantom,
        hold_s=Range(min=0.95 * case.hold_s, max=1.05 * case.hold_s),
        frame_delay_s=Range(min=0.9 * middle_s, max=1.1 * middle_s),
    )
    terms = () if case.kind in YIELDS else TISSUES[case.kind].terms
    tissue = TissueStudy(
        relaxation=tuple((fixed(share), fixed(time_s)) for share, time_s in terms)
    )
    return replace(study, phantom=phantom, tissue=tissue)


def planned(case: Case, setup: Setup, seed: int) -> PhantomPlan:
    """Draw a recording of a case."""
    rng = np.random.default_rng((seed, PUSHES))
    forces_n = LARGEST_N * rng.permutation(np.linspace(*SHARES, PUSHES))
    plan = plan_phantom(setup, tuple(forces_n.tolist()), case_study(case), seed)
    if case.kind in YIELDS:
        plan = replace(plan, path=yielding(plan, remembers=case.kind == "holder"))

    frames = (
        held
        for frame in plan.frames
        for held in (in_hold(frame, rng) if case.frames > 1 else (frame,))
    )
    named = (
        replace(frame, file=f"{number:04d}.png")
        for number, frame in enumerate(frames, start=1)
    )
    return replace(plan, frames=tuple(named))


def yielding(plan: PhantomPlan, *, remembers: bool) -> NeedlePath:
    """Return the path of a needle whose force falls in each hold, as the dent does.

    A force that relaxes under a held travel becomes the force of an elastic wall.
    """
    pushes = [frame.push for frame in plan.frames if frame.push is not None]
    times_s = np.arange(0.0, pushes[-1].corners_s[-1] + STEP_S, STEP_S)
    force_n = np.zeros_like(times_s)
    travel = (0.0, 1.0, 1.0, 0.0)

    for push in pushes:
        response = FALL.felt_along(push.corners_s, travel, times_s)
        frame_s = np.array([push.frame_s])
        at_frame = float(FALL.felt_along(push.corners_s, travel, frame_s)[0])
        if not remembers:
            response = np.where(times_s < push.corners_s[-1], response, 0.0)
        force_n += push.force_n / at_frame * response

    force_n = np.maximum(force_n, 0.0)
    return NeedlePath(tuple(times_s.tolist()), tuple(force_n.tolist()), ELASTIC)


def in_hold(frame: PhantomFrame, rng: np.random.Generator) -> Iterator[PhantomFrame]:
    """Yield three frames of a frame's hold: near its begin, in its middle, at its
    end; the eye shifts between them.
    """
    assert frame.push is not None
    _, stops_s, leaves_s, _ = frame.push.corners_s
    for number, share in enumerate((0.08, 0.4, 0.92)):
        time_s = round(stops_s + share * (leaves_s - stops_s), 4)
        pose = replace(frame.pose, lateral_m=rng.uniform(-2e-4, 2e-4))
        seed = (*frame.seed, number)
        yield replace(frame, time_s=time_s, pose=pose, seed=seed)


def sections(setup: Setup, keep: Path) -> BentSections:
    """Return an eye's sections; its load path is kept."""
    study = Study()
    kept = keep / f"{eye_name(setup)}.path"
    if not kept.exists():
        path = bend_eye(
            study,
            scan_plane(setup).contact,
            PathEnd(max_force=BEYOND * LARGEST_N, as_far_as_found=True),
            thickness_m=wall_of(setup).thickness_m,
            youngs_modulus_pa=setup.eye.modulus_pa,
            iop_pa=wall_of(setup).iop_pa,
        )
        kept.write_bytes(pickle.dumps(path))

    return BentSections(setup, study, bent=pickle.loads(kept.read_bytes()))


def recorded(case: Case, setup: Setup, seed: int, keep: Path) -> Recording:
    """Return a recording of a case, which is made unless it is kept."""
    folder = (
        keep / f"{eye_name(setup)}-{case.kind}-{case.hold_s:g}s-{case.frames}-{seed}"
    )
    if not folder.exists():
        plan = planned(case, setup, seed)
        write_phantom(folder, plan, sections(setup, keep), case_study(case))

    recording = read_recording(folder)
    if case.hold_s >= SHORT_S and case.frames == 1:
        return recording

    assert recording.info.force is not None
    force = replace(recording.info.force, average_s=SHORT_AVERAGE_S)
    return replace(recording, info=replace(recording.info, force=force))


def with_truth(recording: Recording, kind: str) -> Recording:
    """Return a recording that declares how its tissue relaxes."""
    terms = () if kind in YIELDS else tuple(TISSUES[kind].terms)
    eye = replace(recording.info.eye, relaxation=Relaxation.declared(terms))
    return replace(recording, info=replace(recording.info, eye=eye))


@dataclass(frozen=True)
class Reading:
    """Errors and widths of the frames that were read, N, and whether the interval
    holds; (frame,).
    """

    error_n: np.ndarray
    width_n: np.ndarray
    holds: np.ndarray


def read(calibrating: Recording, read_one: Recording, frames: int | None) -> Reading:
    """Calibrate on a recording and read one, against the true forces."""
    calibration = sf.calibrate(calibrating, frames=frames)
    found = sf.evaluate(sf.load_model("default"), read_one, calibration=calibration)
    trials = found.true_forces
    low_n, high_n = np.array([one.interval_n for one in trials]).T
    true_n = np.array([one.measured_n for one in trials])
    read_n = np.array([one.read_n for one in trials])
    holds = (low_n <= true_n) & (true_n <= high_n)
    return Reading(np.abs(read_n - true_n), high_n - low_n, holds)


def joined(readings: list[Reading]) -> Reading:
    """Return the readings of several recordings as one."""
    return Reading(
        *(
            np.concatenate([getattr(one, name) for one in readings])
            for name in ("error_n", "width_n", "holds")
        )
    )


def print_rows(case: Case, eyes: list[Setup], seed: int, keep: Path) -> None:
    """Print what is read of a case, with nothing and with the truth declared."""
    pairs = [
        [recorded(case, eye, one, keep) for one in (seed, seed + 1000)] for eye in eyes
    ]

    for frames in (3, None):
        found = list[Reading]()
        declared = list[Reading]()
        row = f"| {case.kind} | {case.hold_s:g} | {case.frames} | {frames or 'all'}"
        try:
            for first, second in pairs:
                other = first if frames else second
                found.append(read(first, other, frames))
                stated = with_truth(first, case.kind), with_truth(other, case.kind)
                declared.append(read(*stated, frames))
        except sf.InputError as refusal:
            print(f"{row} | refused: {refusal} | | | |", flush=True)
            continue

        unknown = joined(found)
        known = joined(declared)
        width_mn = 1e3 * float(np.median(unknown.width_n))
        known_mn = 1e3 * float(np.median(known.width_n))
        print(
            f"{row} | {1e3 * unknown.error_n.mean():.2f},"
            f" {1e3 * known.error_n.mean():.2f}"
            f" | {unknown.holds.mean():.0%}, {known.holds.mean():.0%}"
            f" | {width_mn:.2f} | {width_mn / known_mn:.2f} |",
            flush=True,
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument("--eyes", type=int, default=2)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--holds", type=float, nargs="+", default=[2.0, 8.0, 20.0])
    parser.add_argument("--kinds", default=",".join(TISSUES))
    parser.add_argument("--frames", type=int, nargs="+", default=[1, 3])
    parser.add_argument("--keep", type=Path, help="folder of the recordings")
    given = parser.parse_args()
    print(
        "| who yields | hold, s | frames in it | calibrated on | read off by, mN (and"
        " declared) | intervals hold (and declared) | median width, mN | over declared"
        " |"
    )
    print("|---|---|---|---|---|---|---|---|")

    with ExitStack() as stack:
        keep = given.keep or Path(stack.enter_context(TemporaryDirectory()))
        keep.mkdir(parents=True, exist_ok=True)
        eyes = [
            changed(
                drawn_eye(number, np.random.default_rng((given.seed, number))),
                name=f"eye-{given.seed}-{number}",
            )
            for number in range(given.eyes)
        ]
        cases = product(given.kinds.split(","), given.holds, given.frames)
        for kind, hold_s, frames in cases:
            print_rows(Case(kind, hold_s, frames), eyes, given.seed, keep)


if __name__ == "__main__":
    main()
