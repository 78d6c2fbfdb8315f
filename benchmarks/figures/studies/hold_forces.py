"""Calibrate on logs whose force falls in each hold, and read: the table of
docs/calibration.md, "Tissue or needle".

Eyes in three dimensions, imaged by the virtual laboratory. Who yields in a hold:

- needle: the walls are elastic, and the force falls by 12 % with 1.2 s while the dent
  follows it; each push begins anew;

- tissue: the dent stays, and the force falls by 12 % with 1.2 s and 15 % with 12 s;

- pork: by 27 % with 0.4 s and 33 % with 4.3 s.

Each eye has two recordings of ten pushes. Three frames of the first one calibrate, and
its others are read; or all of them do, and the second one is read. Either is done with
nothing declared, and with the truth declared, whose intervals the last column compares
with. `--frames 3` has three frames in each hold.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np

import scleraforce as sf
from figures.accuracy import ReadForces, joined, percent
from figures.printing import print_table, whole_number
from figures.sections import bend
from figures.studies.calibration import drawn_eye
from scleraforce.lab.needle_pushes import NeedlePath
from scleraforce.lab.virtual_eye import BentSections, eye_name
from scleraforce.lab.virtual_recording import (
    PhantomFrame,
    PhantomPlan,
    plan_phantom,
    write_phantom,
)
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.tissue_material import PronySeries
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range, Study, TissueStudy, fixed
from scleraforce.records.tissue_relaxation import Relaxation
from virtual_eyes import changed

FALL = PronySeries((0.12,), (1.2,))  # of a needle that yields
ELASTIC = PronySeries((), ())
TISSUES = {
    "needle": ELASTIC,
    "tissue": PronySeries((0.12, 0.15), (1.2, 12.0)),
    "pork": PronySeries((0.27, 0.33), (0.4, 4.3)),
}
PUSHES = 10
SHARES = (0.08, 1.0)  # of the largest force
LARGEST_N = 45e-3
BEYOND = 1.7  # times the largest force: the dents of pork
STEP_S = 0.05  # of the path of a needle that yields
IN_HOLD = (0.08, 0.4, 0.92)  # of a hold with three frames
# of a hold: in shorter ones, and near the ends of one, a label averages over less
SHORT_S = 4.0
SHORT_AVERAGE_S = 0.4
SECOND = 1000  # added to the seed of an eye's second recording


@dataclass(frozen=True)
class Case:
    """Who yields, how long a hold is, and how many frames it has."""

    kind: str
    hold_s: float
    frames: int

    @property
    def study(self) -> Study:
        """Pushes 2 s apart, a frame in the middle of a hold."""
        study = Study()
        middle_s = 0.55 * min(self.hold_s, 8.0)
        phantom = replace(
            study.phantom,
            hold_s=Range(min=0.95 * self.hold_s, max=1.05 * self.hold_s),
            frame_delay_s=Range(min=0.9 * middle_s, max=1.1 * middle_s),
        )
        terms = TISSUES[self.kind].terms
        relaxation = tuple((fixed(share), fixed(time_s)) for share, time_s in terms)
        return replace(
            study, phantom=phantom, tissue=TissueStudy(relaxation=relaxation)
        )

    def plan(self, setup: Setup, seed: int) -> PhantomPlan:
        """Draw a recording."""
        rng = np.random.default_rng((seed, PUSHES))
        forces_n = LARGEST_N * rng.permutation(np.linspace(*SHARES, PUSHES))
        plan = plan_phantom(setup, tuple(forces_n.tolist()), self.study, seed)
        if self.kind == "needle":
            plan = replace(plan, path=yielding(plan))
        if self.frames == 1:
            return plan

        held = (one for frame in plan.frames for one in in_hold(frame, rng))
        named = (
            replace(frame, file=f"{number:04d}.png")
            for number, frame in enumerate(held, start=1)
        )
        return replace(plan, frames=tuple(named))


def yielding(plan: PhantomPlan) -> NeedlePath:
    """Return the path of a needle whose force falls in each hold, as the dent does.

    A force that relaxes under a held travel becomes the force of an elastic wall.
    """
    pushes = [frame.push for frame in plan.frames if frame.push is not None]
    times_s = np.arange(0.0, pushes[-1].corners_s[-1] + STEP_S, STEP_S)
    force_n = np.zeros_like(times_s)
    travel = (0.0, 1.0, 1.0, 0.0)

    for push in pushes:
        frame_s = np.array([push.frame_s])
        at_frame = float(FALL.felt_along(push.corners_s, travel, frame_s)[0])
        response = FALL.felt_along(push.corners_s, travel, times_s)
        response = np.where(times_s < push.corners_s[-1], response, 0.0)
        force_n += push.force_n / at_frame * response

    force_n = np.maximum(force_n, 0.0)
    return NeedlePath(tuple(times_s.tolist()), tuple(force_n.tolist()), ELASTIC)


def in_hold(frame: PhantomFrame, rng: np.random.Generator) -> Iterator[PhantomFrame]:
    """Yield three frames of a frame's hold; the eye shifts between them."""
    assert frame.push is not None
    _, stops_s, leaves_s, _ = frame.push.corners_s
    for number, share in enumerate(IN_HOLD):
        time_s = round(stops_s + share * (leaves_s - stops_s), 4)
        pose = replace(frame.pose, lateral_m=rng.uniform(-2e-4, 2e-4))
        seed = (*frame.seed, number)
        yield replace(frame, time_s=time_s, pose=pose, seed=seed)


@cache
def sections(setup: Setup) -> BentSections:
    """Return an eye's sections, for all its recordings."""
    study = Study()
    end = PathEnd(max_force=BEYOND * LARGEST_N, as_far_as_found=True)
    return BentSections(setup, study, bent=bend(setup, study, end))


def recorded(case: Case, setup: Setup, seed: int, folder: Path) -> Recording:
    """Make a recording of a case."""
    name = f"{eye_name(setup)}-{case.kind}-{case.hold_s:g}s-{case.frames}-{seed}"
    write_phantom(folder / name, case.plan(setup, seed), sections(setup), case.study)
    recording = read_recording(folder / name)
    if case.hold_s >= SHORT_S and case.frames == 1:
        return recording

    assert recording.info.force is not None
    force = replace(recording.info.force, average_s=SHORT_AVERAGE_S)
    return replace(recording, info=replace(recording.info, force=force))


def with_truth(recording: Recording, kind: str) -> Recording:
    """Return a recording that declares how its tissue relaxes."""
    relaxation = Relaxation.declared(tuple(TISSUES[kind].terms))
    eye = replace(recording.info.eye, relaxation=relaxation)
    return replace(recording, info=replace(recording.info, eye=eye))


def read(calibrating: Recording, other: Recording, frames: int | None) -> ReadForces:
    """Calibrate on a recording and read another, against the true forces."""
    calibration = sf.calibrate(calibrating, frames=frames)
    found = sf.evaluate(sf.load_model("default"), other, calibration=calibration)
    trials = found.true_forces
    return ReadForces(
        np.array([trial.measured_n for trial in trials]),
        np.array([trial.read_n for trial in trials]),
        np.array([trial.interval_n for trial in trials]),
    )


def case_rows(
    case: Case, eyes: list[Setup], seed: int, folder: Path
) -> Iterator[list[object]]:
    """Yield what is read of a case, with nothing and with the truth declared."""
    pairs = [
        [recorded(case, eye, one, folder) for one in (seed, seed + SECOND)]
        for eye in eyes
    ]
    for frames in (3, None):
        name = [case.kind, f"{case.hold_s:g}", case.frames, frames or "all"]
        told = [(first, first if frames else second) for first, second in pairs]
        truth = [
            (with_truth(first, case.kind), with_truth(other, case.kind))
            for first, other in told
        ]
        try:
            found = joined([read(*pair, frames) for pair in told])
            known = joined([read(*pair, frames) for pair in truth])
        except sf.InputError as refusal:
            yield [*name, f"refused: {refusal}", "", "", ""]
            continue

        both = found, known
        errors = (f"{1e3 * np.abs(one.errors_n).mean():.2f}" for one in both)
        holds = (percent(one.holds.mean()) for one in both)
        width_n, known_n = (float(np.median(one.widths_n)) for one in both)
        cells = ", ".join(errors), ", ".join(holds), f"{1e3 * width_n:.2f}"
        yield [*name, *cells, f"{width_n / known_n:.2f}"]


@click.command(help=__doc__)
@whole_number("--eyes", 2)
@whole_number("--seed", 7)
@click.option("--holds", default=(2.0, 8.0, 20.0), multiple=True, help="Seconds.")
@click.option("--kinds", default=",".join(TISSUES), help="Who yields.")
@click.option("--frames", default=(1, 3), multiple=True, help="Frames in a hold.")
def main(
    eyes: int,
    seed: int,
    holds: tuple[float, ...],
    kinds: str,
    frames: tuple[int, ...],
) -> None:
    """Print the table."""
    setups = [
        changed(
            drawn_eye(number, np.random.default_rng((seed, number))),
            name=f"eye-{seed}-{number}",
        )
        for number in range(eyes)
    ]
    head = ["who yields", "hold, s", "frames in it", "calibrated on"]
    found = ["read off by, mN (declared)", "intervals hold, % (declared)"]
    cases = (Case(*case) for case in product(kinds.split(","), holds, frames))

    with TemporaryDirectory() as folder:
        rows = (
            row for case in cases for row in case_rows(case, setups, seed, Path(folder))
        )
        print_table([*head, *found, "median width, mN", "over declared"], rows)
