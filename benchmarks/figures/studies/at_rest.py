"""Forces read from real eyes without a needle, at scales that nobody checked: the scans
in ../shared/real-oct.

Each scan is read at drawn scales: frames 6 to 20 mm wide and 0.3 to 1 times as deep, of
optical or geometric depth. A third of the readings has a calibrated modulus and an IOP,
a third a thickness. Usable readings above the lowest class are wrong.
"""

from collections.abc import Iterator

import click
import cv2
import numpy as np

from figures.printing import print_table, whole_number
from figures.scans import REAL, real_scans
from scleraforce.reading.answer import Answer
from scleraforce.reading.load_model import load_reader
from scleraforce.reading.reading_models import Reader
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.frame import Pixels
from scleraforce.records.model_folder import SHIPPED_LIVING, SHIPPED_READER
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.study import draw

WIDTH_M = (6e-3, 20e-3)
DEPTH_RATIO = (0.3, 1.0)
INDICES = (1.0, 1.385)


def read_at_random(reader: Reader, frame: Pixels, rng: np.random.Generator) -> Answer:
    """Read a scan at a drawn scale, as an eye of which nothing, modulus and IOP, or the
    thickness is known.
    """
    width_m = rng.uniform(*WIDTH_M)
    ratio = rng.uniform(*DEPTH_RATIO)
    trained = reader.study.reader
    modulus = Modulus(
        mean_pa=draw(trained.youngs_modulus_pa, rng), sd_pa=0.0, source="own"
    )
    iop_pa = draw(trained.iop_pa, rng)
    thickness_m = draw(trained.thickness_m, rng)
    eyes = (Eye(), Eye(modulus=modulus, iop_pa=iop_pa), Eye(thickness_m=thickness_m))
    rows, columns = frame.shape
    scale = PixelScale(
        lateral_m=width_m / columns,
        depth_m=width_m * ratio / rows,
        refractive_index=float(rng.choice(INDICES)),
    )
    return reader.read(frame, scale, Setup(eye=eyes[rng.integers(len(eyes))]))


def model_rows(readings: int, seed: int) -> Iterator[list[object]]:
    """Yield each bundled reader's readings: all, usable, and wrong."""
    scans = [*real_scans(), *sorted((REAL / "dicom").glob("*.dcm"))]
    frames = [read_frame(scan) for scan in scans]

    for path in (SHIPPED_READER, SHIPPED_LIVING):
        reader = load_reader(path)
        rng = np.random.default_rng(seed)
        answers = [
            read_at_random(reader, frame, rng)
            for frame in frames
            for _ in range(readings)
        ]
        usable = [answer for answer in answers if answer.usable]
        bound_n = reader.study.classes.bounds_n[0]
        wrong = sum((answer.force_n or 0.0) > bound_n for answer in usable)
        yield [path.name, len(answers), len(usable), wrong]


@click.command(help=__doc__)
@whole_number("--readings", 120, "Readings of each scan by each reader.")
@whole_number("--seed", 3)
def main(readings: int, seed: int) -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    head = ["reader", "readings", "usable", "usable and above the lowest class"]
    print_table(head, model_rows(readings, seed))
