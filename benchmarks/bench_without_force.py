"""E of virtual eyes from pictures alone, and their forces read with it: plain and
uneven eyes, with and without travel.

`python benchmarks/bench_without_force.py [EYES] [FOLDER]`: eyes a group (10), and where
they are kept. They are drawn as for `figures`, with a seed of this benchmark, in three
dimensions, 20 frames each up to 60 mN; globe, IOP, thickness and gap are given, no
force. The prior of E is a population of 0.35 +- 0.087 MPa, from which they are drawn.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import scleraforce as sf
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.groups import draw_eyes
from figures.recordings import make_recordings, read_made
from scleraforce.base.units import from_si
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import CalibratedEye, CalibrationSummary
from scleraforce.records.globe import OPEN
from scleraforce.records.study import Study

SEED = 4343  # of this benchmark alone
# of the beds, the travels and their noise
STIFFNESS_N_PER_M = (30.0, 150.0)
SHIFT_M = 0.5e-3
TRAVEL_SD_M = 5e-6
POPULATION = CalibrationSummary(
    eyes={
        "others": CalibratedEye(
            eye=sf.Eye(
                modulus=sf.Modulus(mean_pa=0.35e6, sd_pa=5e3, source="own"),
                thickness_m=0.65e-3,
                globe=OPEN,
                stiffening=0.0,
            ),
            frames=(),
        )
    },
    population_mean_pa=0.35e6,
    population_sd_pa=0.087e6,
    population_stiffening=0.0,
    mechanics="finite-strain",
    path="a population",
    sha256="",
)


@dataclass(frozen=True)
class Score:
    """One eye: errors of ln E and its standard deviation, of forces (N), and shares of
    right classes and intervals.
    """

    off: float
    sd: float
    errors_n: tuple[float, ...]
    right: tuple[bool, ...]
    held: tuple[bool, ...]


def with_travel(
    recording: Recording, folder: FiguresFolder, eye: FigureEye
) -> Recording:
    """Return the recording with the needle's travel: the dent, the give of a bed, a
    shift, and noise.
    """
    made = read_made(folder, eye)
    rng = np.random.default_rng((SEED, eye.seed))
    stiffness = np.exp(rng.uniform(*np.log(STIFFNESS_N_PER_M)))
    shift_m = rng.uniform(-SHIFT_M, SHIFT_M)
    gone_m = (
        made.tips_m
        + made.forces_n / stiffness
        + shift_m
        + TRAVEL_SD_M * rng.standard_normal(len(made.tips_m))
    )
    by_file = dict(zip(made.files, gone_m.tolist(), strict=True))

    return replace(
        recording,
        frames=tuple(
            replace(one, travel_m=by_file[one.file]) for one in recording.frames
        ),
    )


def score(folder: FiguresFolder, eye: FigureEye, travel: bool) -> Score:
    """Calibrate an eye without its forces, read all its frames, and compare."""
    recording = read_recording(folder.recording(eye))
    shown = with_travel(recording, folder, eye) if travel else recording
    found = sf.calibrate(
        shown, method=sf.CalibrationMethod(without_force=True, prior=POPULATION)
    )
    one = found.eyes[eye_name(eye.setup)]
    evaluation = sf.evaluate(sf.load_model("default"), recording, found)
    trials = [frame for frame in evaluation.frames if frame.scored]
    truth = dict(
        zip(
            read_made(folder, eye).files,
            read_made(folder, eye).forces_n.tolist(),
            strict=True,
        )
    )
    read = [
        (frame.answer, truth[frame.file])
        for frame in trials
        if frame.answer.force_n is not None
    ]
    held = (
        answer.interval_n is not None
        and answer.interval_n[0] <= n <= answer.interval_n[1]
        for answer, n in read
    )

    return Score(
        off=float(np.log(one.mean_pa / eye.setup.eye.modulus_pa)),
        sd=one.sd_pa / one.mean_pa,
        errors_n=tuple(
            answer.force_n - n for answer, n in read if answer.force_n is not None
        ),
        right=tuple(not frame.misread for frame in trials),
        held=tuple(held),
    )


def line(name: str, scores: list[Score]) -> str:
    """Return the row of a group."""
    off = np.array([one.off for one in scores])
    sd = np.array([one.sd for one in scores])
    errors = np.concatenate([one.errors_n for one in scores])
    right, held = (
        np.concatenate([getattr(one, part) for one in scores])
        for part in ("right", "held")
    )
    rms, bias, sure = (
        from_si(float(value), "percent")
        for value in (np.sqrt((off**2).mean()), off.mean(), sd.mean())
    )
    within = int((np.abs(off) < 2.0 * sd).sum())
    force_mn = from_si(float(np.abs(errors).mean()), "mn")
    numbers = f"{rms:7.1f} {bias:+7.1f} {sure:7.1f} {within:5d} of {len(scores)}"

    return (
        f"{name:24}{numbers} {force_mn:8.2f} {100 * right.mean():8.1f}"
        f" {100 * held.mean():8.1f}"
    )


def main(count: int, folder: FiguresFolder) -> None:
    """Print the table."""
    print(f"{'':24}rms E,%  bias,%    sd,%  in 2 sd  error,mN  classes,%  held,%")
    for group in ("plain", "harder"):
        eyes = draw_eyes(group, count, Study(), SEED)
        failed = make_recordings(folder, eyes, 2, lambda _: None)

        for travel in (False, True):
            scores = list[Score]()
            for eye in eyes:
                name = eye_name(eye.setup)
                if name not in failed:
                    scores.append(score(folder, eye, travel))
                    print(
                        f"  {name}: {scores[-1].off:+.3f} ± {scores[-1].sd:.3f}",
                        file=sys.stderr,
                    )

            print(line(f"{group}{', with travel' * travel}", scores), flush=True)


if __name__ == "__main__":
    given = sys.argv[1:]
    main(
        int(given[0]) if given else 10,
        FiguresFolder(Path(given[1] if len(given) > 1 else "without-force")),
    )
