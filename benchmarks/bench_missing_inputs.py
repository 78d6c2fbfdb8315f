"""Read virtual eyes with one input left out at a time: what each missing input costs.

    python benchmarks/bench_missing_inputs.py [--eyes 10]

Open, elastic eyes of the bundled reader's range, each with ten frames of 3 to 45 mN.
Modulus, thickness, IOP, gap and globe are the true ones, and the modulus is taken as
known to 3 %.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import scleraforce as sf
from scleraforce.recordings.recording_folder import Recording

COARSE = "[mesh]\ncore = 4\nrings = 8\n"  # dents within 2 %, the same for every row
FORCES_N = (0.006, 0.012, 0.02, 0.003, 0.028, 0.036, 0.045, 0.009, 0.016, 0.032)
LEFT_OUT = ("nothing", "iop_pa", "thickness_m", "gap_m", "globe")


def virtual_eye(folder: Path, number: int) -> Recording:
    """Make the recording of an eye with values of its own."""
    rng = np.random.default_rng(number)
    eye = sf.Eye(
        f"eye-{number}",
        modulus=sf.Modulus.stated(rng.uniform(0.2e6, 0.5e6)),
        thickness_m=rng.uniform(0.45e-3, 0.8e-3),
        iop_pa=rng.uniform(150.0, 500.0),
        globe=sf.Globe.declared("open"),
    )
    needle = sf.Needle(gap_m=rng.uniform(0.4e-3, 0.9e-3))
    study = sf.parse_study(COARSE)
    return sf.phantom(
        folder / f"eye-{number}",
        study,
        forces_n=FORCES_N,
        eye=eye,
        needle=needle,
        mechanics="finite-strain",
        seed=number,
    )


def answers_without(
    name: str, recording: Recording, modulus: sf.Modulus
) -> list[tuple[float, float, float]]:
    """Return error and width of the interval, mN, and whether it holds, of each usable
    frame, read without the named input.
    """
    model = sf.load_model("default")
    info = recording.info
    eye = replace(info.eye, modulus=modulus, relaxation=None)
    needle = info.needle
    if name == "gap_m":
        needle = replace(needle, gap_m=None)
    else:
        eye = replace(
            eye,
            iop_pa=None if name == "iop_pa" else eye.iop_pa,
            thickness_m=None if name == "thickness_m" else eye.thickness_m,
            globe=None if name == "globe" else eye.globe,
        )

    scan = sf.Scan(
        width_m=info.scan.width_m,
        depth_m=info.scan.depth_m,
        refractive_index=info.scan.refractive_index,
        direction_rad=info.scan.direction_rad,
    )
    found = []
    for entry, force_n in zip(recording.frames, FORCES_N, strict=True):
        frame = recording.frame(entry)
        answer = sf.read(model, frame, eye=eye, needle=needle, scan=scan)
        if answer.usable and answer.force_n is not None and answer.interval_n:
            low, high = answer.interval_n
            holds = float(low <= force_n <= high)
            error = 1e3 * abs(answer.force_n - force_n)
            found.append((error, 1e3 * (high - low), holds))

    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--eyes", type=int, default=10)
    eyes = parser.parse_args().eyes
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in LEFT_OUT}

    with TemporaryDirectory() as folder:
        for number in range(eyes):
            recording = virtual_eye(Path(folder), number)
            rng = np.random.default_rng(number)
            modulus = sf.Modulus.stated(rng.uniform(0.2e6, 0.5e6))
            for name, answers in found.items():
                answers += answers_without(name, recording, modulus)

    frames = eyes * len(FORCES_N)
    print("left out       usable   error/mN   hold   width/mN")
    for name, answers in found.items():
        error, width, holds = np.array(answers).T
        print(
            f"{name:<14}{len(answers):>4} of {frames:<4}{error.mean():>8.2f}"
            f"{100 * holds.mean():>6.0f} %{np.median(width):>9.2f}"
        )


if __name__ == "__main__":
    main()
