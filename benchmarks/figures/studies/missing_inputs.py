"""What each missing input costs: the tables of docs/limits.md and, with `--sealed`, of
docs/reader.md, "Open or sealed".

Open, elastic eyes of the bundled reader's range, each with ten frames of 3 to 45 mN,
are read with one input left out at a time. Modulus, thickness, IOP, gap and globe are
the true ones, and the modulus is taken as known to 3 %. Sealed eyes have a rigidity of
0.01 to 0.05 mmHg^(1/3)/ul, which is not declared; they are read as sealed, with no
globe declared, and as open.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import click
import numpy as np

import scleraforce as sf
from figures.accuracy import ReadForces, joined, percent, read_forces
from figures.printing import print_table, whole_number
from scleraforce.base.units import to_si
from scleraforce.recordings.recording_folder import Recording

COARSE = "[mesh]\ncore = 4\nrings = 8\n"  # dents within 2 %, the same for every row
FORCES_N = (0.006, 0.012, 0.02, 0.003, 0.028, 0.036, 0.045, 0.009, 0.016, 0.032)
LEFT_OUT = ("nothing", "iop_pa", "thickness_m", "gap_m", "globe")
AS_OPEN = "the truth: declared open"
OF_SEALED = ("nothing", "globe", AS_OPEN)
RIGIDITIES = (0.01, 0.05)  # mmHg^(1/3)/ul


def virtual_eye(
    folder: Path, number: int, *, sealed: bool
) -> tuple[Recording, sf.Modulus]:
    """Make the recording of an eye with values of its own."""
    rng = np.random.default_rng(number)
    modulus = sf.Modulus.stated(rng.uniform(0.2e6, 0.5e6))
    eye = sf.Eye(
        f"eye-{number}",
        modulus=modulus,
        thickness_m=rng.uniform(0.45e-3, 0.8e-3),
        iop_pa=rng.uniform(150.0, 500.0),
        globe=sf.Globe.declared("open"),
    )
    gap_m = rng.uniform(0.4e-3, 0.9e-3)
    if sealed:
        rigidity = to_si(rng.uniform(*RIGIDITIES), "mmhg13_per_ul")
        eye = replace(eye, globe=sf.Globe.declared("sealed", rigidity))
    recording = sf.phantom(
        folder / f"eye-{number}",
        sf.parse_study(COARSE),
        forces_n=FORCES_N,
        eye=eye,
        needle=sf.Needle(gap_m=gap_m),
        mechanics="finite-strain",
        seed=number,
    )
    return recording, modulus


def read_without(name: str, recording: Recording, modulus: sf.Modulus) -> ReadForces:
    """Return the forces of the usable frames, read without the named input."""
    model = sf.load_model("default")
    info = recording.info
    eye = replace(info.eye, modulus=modulus, relaxation=None)
    needle = info.needle
    if name == "gap_m":
        needle = replace(needle, gap_m=None)
    elif name == AS_OPEN:
        eye = replace(eye, globe=sf.Globe.declared("open"))
    elif name != "nothing":
        missing: dict[str, Any] = {name: None}
        eye = replace(eye, **missing)

    scan = sf.Scan(
        width_m=info.scan.width_m,
        depth_m=info.scan.depth_m,
        refractive_index=info.scan.refractive_index,
        direction_rad=info.scan.direction_rad,
    )
    answers = (
        sf.read(model, recording.frame(entry), eye=eye, needle=needle, scan=scan)
        for entry in recording.frames
    )
    pairs = zip(answers, FORCES_N, strict=True)
    return read_forces((answer, true_n) for answer, true_n in pairs if answer.usable)


def rows(eyes: int, *, sealed: bool) -> Iterator[list[str]]:
    """Yield a row for each input."""
    with TemporaryDirectory() as folder:
        made = [
            virtual_eye(Path(folder), number, sealed=sealed) for number in range(eyes)
        ]
        for name in OF_SEALED if sealed else LEFT_OUT:
            read = joined([read_without(name, *eye) for eye in made])
            yield [
                name,
                f"{len(read.true_n)} of {eyes * len(FORCES_N)}",
                f"{1e3 * np.abs(read.errors_n).mean():.2f}",
                percent(read.holds.mean()),
                f"{1e3 * np.median(read.widths_n):.2f}",
            ]


@click.command(help=__doc__)
@whole_number("--eyes", 10)
@click.option("--sealed", is_flag=True, help="Read sealed eyes.")
def main(eyes: int, sealed: bool) -> None:
    """Print the table."""
    head = ["left out", "usable", "mean error, mN", "intervals that hold, %"]
    print_table([*head, "median width, mN"], rows(eyes, sealed=sealed))
