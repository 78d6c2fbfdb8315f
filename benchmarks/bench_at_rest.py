"""Forces read from real eyes without a needle at scales that nobody checked: the scans
in ../shared/real-oct.

    python benchmarks/bench_at_rest.py [MODEL ...] [--readings 120] [--seed 3]
        [--sheet FILE]

MODELs are readers, the two bundled ones by default. Each scan is read at drawn scales:
frames 6 to 20 mm wide and 0.3 to 1 times as deep, of optical or geometric depth. A
third of the readings has a calibrated modulus and an IOP, a third a thickness. Printed
are the usable readings above the lowest class; `--sheet` writes their walls (red) and
fits (white) as a PNG.
"""

import argparse
from collections import Counter
from pathlib import Path

import cv2
import numpy as np

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
from scleraforce.wall.wall import draw_overlay

REAL = Path(__file__).resolve().parents[2] / "shared" / "real-oct"
WIDTH_M = (6e-3, 20e-3)
DEPTH_RATIO = (0.3, 1.0)
INDICES = (1.0, 1.385)
CELL = (300, 420)  # rows and columns of a picture in the sheet


def read_at_random(
    model: Reader, frame: Pixels, rng: np.random.Generator
) -> tuple[Answer, PixelScale]:
    """Read a scan at a drawn scale, as an eye of which nothing, modulus and IOP, or the
    thickness is known.
    """
    width_m = rng.uniform(*WIDTH_M)
    ratio = rng.uniform(*DEPTH_RATIO)
    trained = model.study.reader
    modulus = Modulus(
        mean_pa=draw(trained.youngs_modulus_pa, rng), sd_pa=0.0, source="own"
    )
    iop_pa = draw(trained.iop_pa, rng)
    thickness_m = draw(trained.thickness_m, rng)
    eyes = (
        Setup(),
        Setup(eye=Eye(modulus=modulus, iop_pa=iop_pa)),
        Setup(eye=Eye(thickness_m=thickness_m)),
    )
    rows, columns = frame.shape
    scale = PixelScale(
        lateral_m=width_m / columns,
        depth_m=width_m * ratio / rows,
        refractive_index=float(rng.choice(INDICES)),
    )

    return model.read(frame, scale, eyes[rng.integers(len(eyes))]), scale


def picture(frame: Pixels, answer: Answer, scale: PixelScale) -> np.ndarray:
    """Return a scan with its wall, and the fitted surface in white."""
    assert answer.segmentation is not None
    drawn = draw_overlay(frame, answer.segmentation, CELL)

    if answer.fit is not None:
        rows, columns = frame.shape
        place = answer.fit.wall_bmc[0] / (scale.lateral_m, scale.depth_m) + (
            columns / 2,
            0.0,
        )
        cv2.polylines(
            drawn,
            [np.rint(place * (CELL[1] / columns, CELL[0] / rows)).astype(int)],
            False,
            (255,) * 3,
        )

    return drawn


def main() -> None:
    """Print the usable readings above the lowest class, and why the others are not
    usable.
    """
    parser = argparse.ArgumentParser(
        description=__doc__.split("\n\n")[0] if __doc__ else ""
    )
    parser.add_argument(
        "models", nargs="*", type=Path, default=[SHIPPED_READER, SHIPPED_LIVING]
    )
    parser.add_argument(
        "--readings", type=int, default=120, help="of each scan by each model"
    )
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument(
        "--sheet", type=Path, help="PNG of the scans that are read as under a force"
    )
    given = parser.parse_args()
    files = sorted((REAL / "anterior-segment").glob("*.jp*g")) + sorted(
        (REAL / "dicom").glob("*.dcm")
    )
    cv2.setNumThreads(1)
    cells = []

    for path in given.models:
        model = load_reader(path)
        rng = np.random.default_rng(given.seed)
        bound_n = model.study.classes.bounds_n[0]
        reasons = Counter[str]()
        wrong = 0

        for file in files:
            frame = read_frame(file)
            for _ in range(given.readings):
                answer, scale = read_at_random(model, frame, rng)
                reasons[(answer.reason or "usable")[:19]] += 1

                if (
                    not answer.usable
                    or answer.force_n is None
                    or answer.force_n <= bound_n
                ):
                    continue

                wrong += 1
                rows, columns = frame.shape
                size = (
                    f"{scale.lateral_m * columns * 1e3:.1f} x"
                    f" {scale.depth_m * rows * 1e3:.1f} mm"
                )
                print(
                    f"{model.path.name:9}{file.name:22}{size:18}"
                    f"{answer.force_n * 1e3:6.1f} mN"
                )
                cells.append(picture(frame, answer, scale))
                cv2.putText(
                    cells[-1],
                    f"{file.stem} {size}",
                    (6, 20),
                    cv2.FONT_HERSHEY_SIMPLEX,
                    0.5,
                    (0, 255, 255),
                )

        print(
            f"{model.path.name}: {wrong} of {reasons.total()} readings usable and above"
            f" {bound_n * 1e3:.0f} mN"
        )
        for reason, count in reasons.most_common(12):
            print(f"{count:9} {reason}")

    if given.sheet and cells:
        cells += [np.zeros_like(cells[0])] * (-len(cells) % 4)
        cv2.imwrite(
            str(given.sheet),
            np.vstack([np.hstack(cells[n : n + 4]) for n in range(0, len(cells), 4)]),
        )


if __name__ == "__main__":
    main()
