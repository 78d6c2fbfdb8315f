"""The error of a calibrated E beside its posterior, eye by eye, and the forces that are
read with it: the effective modulus of docs/calibration.md, "Accuracy".

Eyes are drawn as for `make figures`, with a seed of this study: in three dimensions at
finite strain, imaged, with declared values that are off as users' measurements are.
Each is calibrated on three frames and its other frames are read. `z` is the error of ln
E over its stated standard deviation. Doubtful eyes: so few intervals hold in one of a
hundred eyes whose intervals hold with 90 % each, independently.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from scipy.stats import binom

import scleraforce as sf
from figures.accuracy import ReadForces, joined, percent, rms
from figures.declared import declare
from figures.eyes import FigureEye
from figures.folder import FiguresFolder
from figures.groups import draw_eyes
from figures.printing import PATH, print_table, whole_number
from figures.readings import CALIBRATED_FRAMES
from figures.recordings import make_recordings, true_forces
from scleraforce.base.worker_processes import available_cores
from scleraforce.lab.virtual_eye import eye_name
from scleraforce.reading.reading_models import Reader
from scleraforce.records.study import Study

SEED = 6104  # of this study alone
HOLDS = 0.9  # of the intervals
DOUBTFUL = 0.01


@dataclass(frozen=True)
class CalibratedFigureEye:
    """One eye: the error of ln E, the stated standard deviation, and the forces that
    were read.
    """

    error: float
    sd: float
    forces: ReadForces

    @property
    def is_doubtful(self) -> bool:
        """Whether so few intervals hold by chance in 1 % of eyes at most."""
        holds = self.forces.holds
        return bool(binom.cdf(holds.sum(), len(holds), HOLDS) < DOUBTFUL)


def calibrate_eye(
    model: Reader, folder: FiguresFolder, eye: FigureEye
) -> CalibratedFigureEye | None:
    """Calibrate an eye and read its other frames; None if it is refused, or
    diverged.
    """
    recording = folder.recording(eye)
    try:
        calibration = sf.calibrate([recording], frames=CALIBRATED_FRAMES)
    except sf.InputError as fault:
        sys.stderr.write(f"{fault}\n")
        return None

    found = calibration.eyes[eye_name(eye.setup)]
    if found.status != "ok":
        return None

    frames = sf.evaluate(model, [recording], calibration).frames
    return CalibratedFigureEye(
        float(np.log(found.mean_pa / eye.setup.eye.modulus_pa)),
        found.sd_pa / found.mean_pa,
        true_forces(folder, eye, (frame for frame in frames if frame.scored)),
    )


def rows(
    groups: tuple[str, ...], count: int, folder: FiguresFolder, workers: int
) -> Iterator[list[str]]:
    """Yield a row for each group."""
    model = sf.load_model("default")
    for group in groups:
        drawn = draw_eyes(group, count, Study(), SEED)
        failed = make_recordings(folder, drawn, workers, lambda _: None)
        eyes = [eye for eye in drawn if eye_name(eye.setup) not in failed]
        told = declare(folder, eyes)
        each = [calibrate_eye(model, told, eye) for eye in eyes]
        found = [eye for eye in each if eye is not None]
        errors = np.array([eye.error for eye in found])
        z = errors / np.array([eye.sd for eye in found])
        forces = joined([eye.forces for eye in found])
        yield [
            f"{group}, {len(found)} of {count}",
            percent(errors.mean(), "+.1f"),
            percent(rms(errors), ".1f"),
            percent(float(np.median([eye.sd for eye in found])), ".1f"),
            f"{z.mean():+.2f}",
            f"{z.std():.2f}",
            percent(float(np.mean(np.abs(z) < 1.0))),
            percent(float(np.mean(np.abs(z) < 2.0))),
            f"{1e3 * np.abs(forces.errors_n).mean():.2f}",
            percent(forces.holds.mean(), ".1f"),
            f"{sum(eye.is_doubtful for eye in found)}",
        ]


@click.command(help=__doc__)
@click.option(
    "--groups", default="plain,harder,sealed", help="Groups of `make figures`."
)
@whole_number("--eyes", 200, "Eyes of each group.")
@whole_number("--workers", available_cores(), "Processes that compute the eyes.")
@click.option(
    "--out",
    type=PATH,
    default=Path("out/posterior"),
    help="Folder of the eyes, which another run reuses.",
)
def main(groups: str, eyes: int, workers: int, out: Path) -> None:
    """Print the table."""
    modulus = ["E off (mean), %", "rms, %", "stated sd, %", "z, mean", "z, sd"]
    within = ["within one sd, %", "within two, %"]
    force = ["force error, mN", "intervals hold, %", "doubtful eyes"]
    head = ["eyes", *modulus, *within, *force]
    named = tuple(groups.split(","))
    print_table(head, rows(named, eyes, FiguresFolder(out), workers))
