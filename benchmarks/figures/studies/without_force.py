"""E of virtual eyes from pictures alone, and their forces read with it: the figures of
docs/calibration.md, "Without force", of plain and uneven eyes, with and without travel.

Eyes are drawn as for `make figures`, with a seed of this study, in three dimensions, 20
frames each up to 60 mN; globe, IOP, thickness and gap are given, no force. The prior of
E is a population of 0.35 +- 0.087 MPa, from which they are drawn.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import click
import numpy as np

import scleraforce as sf
from figures.accuracy import (
    ReadForces,
    found_moduli,
    joined,
    percent,
    rms,
)
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.groups import draw_eyes
from figures.printing import PATH, print_table, whole_number
from figures.recordings import make_recordings, read_made, true_forces
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.calibration_file import CalibratedEye, CalibrationSummary
from scleraforce.records.globe import OPEN
from scleraforce.records.study import Study

SEED = 4343  # of this study alone
WORKERS = 2
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
BY_SHAPE = sf.CalibrationMethod(without_force=True, prior=POPULATION)


@dataclass(frozen=True)
class ReadEye:
    """One eye: error of ln E and its standard deviation, its forces, and whether the
    class of each frame is right.
    """

    modulus: tuple[float, float]
    forces: ReadForces
    right: tuple[bool, ...]


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
    noise_m = TRAVEL_SD_M * rng.standard_normal(len(made.tips_m))
    travel_m = made.tips_m + made.forces_n / stiffness + shift_m + noise_m
    by_file = dict(zip(made.files, travel_m.tolist(), strict=True))
    frames = (replace(one, travel_m=by_file[one.file]) for one in recording.frames)
    return replace(recording, frames=tuple(frames))


def read_eye(folder: FiguresFolder, eye: FigureEye, *, travel: bool) -> ReadEye:
    """Calibrate an eye without its forces, and read all its frames."""
    recording = read_recording(folder.recording(eye))
    shown = with_travel(recording, folder, eye) if travel else recording
    summary = sf.calibrate(shown, method=BY_SHAPE)
    found = summary.eyes[eye_name(eye.setup)]
    evaluation = sf.evaluate(sf.load_model("default"), recording, summary)
    trials = [frame for frame in evaluation.frames if frame.scored]
    error = float(np.log(found.mean_pa / eye.setup.eye.modulus_pa))

    return ReadEye(
        (error, found.sd_pa / found.mean_pa),
        true_forces(folder, eye, trials),
        tuple(not frame.misread for frame in trials),
    )


def rows(count: int, folder: FiguresFolder) -> Iterator[list[str]]:
    """Yield a row for each group and way."""
    for group in ("plain", "harder"):
        eyes = draw_eyes(group, count, Study(), SEED)
        failed = make_recordings(folder, eyes, WORKERS, lambda _: None)
        made = [eye for eye in eyes if eye_name(eye.setup) not in failed]

        for travel in (False, True):
            read = [read_eye(folder, eye, travel=travel) for eye in made]
            moduli = found_moduli(eye.modulus for eye in read)
            forces = joined([eye.forces for eye in read])
            right = [flag for eye in read for flag in eye.right]
            yield [
                f"{group}{', with travel' * travel}",
                percent(rms(moduli.errors), ".1f"),
                percent(moduli.errors.mean(), "+.1f"),
                percent(moduli.sds.mean(), ".1f"),
                moduli.within_two_sd,
                f"{1e3 * np.abs(forces.errors_n).mean():.2f}",
                percent(float(np.mean(right)), ".1f"),
                percent(forces.holds.mean(), ".1f"),
            ]


@click.command(help=__doc__)
@whole_number("--eyes", 10, "Eyes of each group.")
@click.option(
    "--out",
    type=PATH,
    default=Path("out/without-force"),
    help="Folder of the eyes, which another run reuses.",
)
def main(eyes: int, out: Path) -> None:
    """Print the table."""
    modulus = ["E off (rms), %", "bias, %", "stated sd, %", "within two sd"]
    force = ["force error, mN", "right class, %", "intervals hold, %"]
    print_table(["eyes", *modulus, *force], rows(eyes, FiguresFolder(out)))
