"""A cross of two B-scans, whose gap is not given, beside its first plane alone: the
figures of docs/reader.md and docs/calibration.md, "Several planes".

Virtual eyes in three dimensions at finite strain are imaged in a cross and read by the
bundled reader, with the true E: by both planes, by the first one with its true gap, and
by the first one without. With `--calibrate` other such eyes are calibrated on three
moments of known force and on ten without forces: with the cross, and with its first
plane of a given gap, its median or 0.35 mm.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np

import scleraforce as sf
from figures.accuracy import found_moduli, percent, read_forces, rms
from figures.printing import print_table, whole_number
from figures.studies.without_force import BY_SHAPE
from scleraforce.fit.unknowns import GAP
from scleraforce.lab.virtual_eye import BentSections, eye_name
from scleraforce.lab.virtual_recording import (
    PhantomPlan,
    in_planes,
    plan_phantom,
    plan_sections,
    render_frame,
    write_phantom,
)
from scleraforce.reading.answer import Answer
from scleraforce.reading.reading_models import Reader
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.globe import OPEN
from scleraforce.records.scan import PixelScale, Plane
from scleraforce.records.setup import Setup
from scleraforce.records.study import MechanicsStudy, Range, Study, fixed
from virtual_eyes import changed

SEED = 20261201
MOMENTS = 8
CALIBRATED_SEED = 77431
TAKEN = 3
FORCES_N = (2e-3, *(np.linspace(0.12, 1.0, 9) * 54e-3).tolist())
PLANES = (Plane("along", 0.0, 0.0), Plane("across", 0.0, radians(90.0)))
WAYS = ("cross", "first plane, gap given", "first plane, no gap")


@dataclass(frozen=True)
class ReadMoment:
    """One moment: its force, the answer of each of `WAYS`, and errors of the contact,
    the gap (m) and the tilt (rad) that the cross shows; None: not usable.
    """

    force_n: float
    answers: tuple[Answer, ...]
    place_errors: tuple[float, float, float] | None


def drawn_study(needles_deg: float) -> Study:
    """Return the study: tilted eyes, and needles that lean up to an angle."""
    tilt = Range(min=radians(-3.0), max=radians(3.0))
    lean = (
        Range(min=radians(-needles_deg), max=radians(needles_deg))
        if needles_deg
        else fixed(0.0)
    )
    phantom = replace(
        Study().phantom, eye_tilt_rad=tilt, needle_angle_rad=lean, needle_lean_rad=lean
    )
    finite = MechanicsStudy(kind="finite-strain")
    return replace(Study(), phantom=phantom, mechanics=finite)


def drawn_eye(number: int, rng: np.random.Generator) -> Setup:
    """Return one of the eyes."""
    return changed(
        Setup(),
        name=f"cross-{number}",
        thickness_m=float(rng.uniform(0.45e-3, 0.8e-3)),
        youngs_modulus_pa=float(rng.uniform(0.2e6, 0.4e6)),
        iop_pa=float(rng.uniform(150.0, 500.0)),
        gap_m=float(rng.uniform(0.1e-3, 0.6e-3)),
        polar_rad=float(rng.uniform(radians(20.0), radians(45.0))),
        azimuth_rad=float(rng.uniform(0.0, 6.28)),
        direction_rad=float(rng.uniform(-3.1, 3.1)),
    )


def crossed(
    setup: Setup, forces_n: Sequence[float], study: Study, seed: int
) -> PhantomPlan:
    """Plan a recording in a cross."""
    return in_planes(plan_phantom(setup, forces_n, study, seed), PLANES, study)


def read_eye(number: int, reader: Reader) -> Iterator[ReadMoment]:
    """Read each moment of an eye."""
    rng = np.random.default_rng([SEED, number])
    study = drawn_study(25.0)
    setup = drawn_eye(number, rng)

    if number % 3 == 2:  # a third shows the needle, in both planes
        setup = changed(setup, gap_m=0.05e-3)
        shift = Range(min=-0.05e-3, max=0.05e-3)
        phantom = replace(study.phantom, needle_count=fixed(1), eye_shift_m=shift)
        study = replace(study, phantom=phantom)

    forces_n = rng.uniform(2e-3, 55e-3, MOMENTS).tolist()
    plan = crossed(setup, forces_n, study, SEED + number)
    sections, _ = plan_sections(plan, BentSections(setup, study))
    scale = PixelScale.of(study.oct)
    known = changed(setup, name=None, globe=OPEN, gap_m=None, azimuth_rad=None)
    pixels = [
        render_frame(frame, section, study).frame
        for frame, section in zip(plan.frames, sections, strict=True)
    ]

    for moment, first in enumerate(plan.frames[::2]):
        pair = pixels[2 * moment : 2 * moment + 2]
        assert first.cut is not None
        gap_m = first.cut.gap_m
        both = reader.read_together(pair, scale, known, PLANES)[0]
        with_gap = reader.read(pair[0], scale, changed(known, gap_m=abs(gap_m)))
        alone = reader.read_together(pair[:1], scale, known, PLANES[:1])[0]
        errors = None

        if both.usable and both.place is not None and both.fit is not None:
            true_m = np.array([first.pose.lateral_m, -gap_m])
            true_rad = np.array([first.pose.tilt_rad, first.cut.tilt_rad])
            errors = (
                rms(np.array(both.place.contact_m[:2]) - true_m),
                float(both.fit.unknown[GAP]) - gap_m,
                float(np.hypot(*(np.array(both.place.tilt_rad) - true_rad))),
            )

        force_n = plan.normal_n[2 * moment]
        yield ReadMoment(force_n, (both, with_gap, alone), errors)


def first_plane(recording: Recording, gap_m: float) -> Recording:
    """Return the frames of the first plane as a recording of a single one, of a given
    gap.
    """
    info = recording.info
    scan = replace(info.scan, planes=())
    needle = replace(info.needle, gap_m=gap_m)
    frames = tuple(
        replace(frame, plane=None)
        for frame in recording.frames
        if frame.plane == PLANES[0].name
    )
    return replace(
        recording, info=replace(info, scan=scan, needle=needle), frames=frames
    )


def calibrate_eye(number: int, folder: Path) -> dict[str, tuple[float, float]]:
    """Return the error of ln E and its standard deviation, by way of calibrating."""
    rng = np.random.default_rng([CALIBRATED_SEED, number])
    study = drawn_study(0.0)
    setup = drawn_eye(number, rng)
    forces_n = list(FORCES_N)
    rng.shuffle(forces_n)
    plan = crossed(setup, forces_n, study, CALIBRATED_SEED + number)
    write_phantom(folder, plan, BentSections(setup, study), study)
    recording = read_recording(folder)
    gaps_m = [abs(frame.cut.gap_m) for frame in plan.frames[::2] if frame.cut]
    recordings = {
        "cross": recording,
        "median gap": first_plane(recording, float(np.median(gaps_m))),
        "0.35 mm": first_plane(recording, 0.35e-3),
    }
    found = {}

    for name, shown in recordings.items():
        for way, summary in (
            ("by force", sf.calibrate(shown, frames=TAKEN)),
            ("by shape", sf.calibrate(shown, method=BY_SHAPE)),
        ):
            eye = summary.eyes[eye_name(setup)]
            error = float(np.log(eye.mean_pa / setup.eye.modulus_pa))
            found[f"{name}, {way}"] = error, eye.sd_pa / eye.mean_pa

    return found


def calibration_rows(eyes: int) -> Iterator[list[str]]:
    """Yield E by each way of calibrating."""
    with TemporaryDirectory() as folder:
        found = [
            calibrate_eye(number, Path(folder, str(number))) for number in range(eyes)
        ]

    for name in found[0]:
        moduli = found_moduli(eye[name] for eye in found)
        error = percent(rms(moduli.errors), ".1f")
        yield [name, error, percent(moduli.sds.mean(), ".1f"), moduli.within_two_sd]


@click.command(help=__doc__)
@whole_number("--eyes", 12)
@click.option("--calibrate", is_flag=True, help="Calibrate eyes instead.")
def main(eyes: int, calibrate: bool) -> None:
    """Print the tables."""
    if calibrate:
        head = ["E from", "error (rms), %", "stated sd, %", "within two sd"]
        print_table(head, calibration_rows(eyes))
        return

    reader = sf.load_model("default")
    moments = [moment for eye in range(eyes) for moment in read_eye(eye, reader)]
    ways = {
        name: read_forces((moment.answers[way], moment.force_n) for moment in moments)
        for way, name in enumerate(WAYS)
    }
    head = ["force read from", "moments", "error (rms), mN", "intervals hold, %"]
    print_table(
        [*head, "width (rms), mN"],
        (
            [
                name,
                len(read.true_n),
                f"{1e3 * rms(read.errors_n):.3f}",
                percent(read.holds.mean(), ".1f"),
                f"{1e3 * rms(read.widths_n):.2f}",
            ]
            for name, read in ways.items()
        ),
    )
    places = [moment.place_errors for moment in moments if moment.place_errors]
    contact_m, gap_m, tilt_rad = (rms(column) for column in np.transpose(places))
    print(
        f"\nThe cross shows contact and gap {1e3 * contact_m:.4f} and"
        f" {1e3 * gap_m:.4f} mm off, the tilt {np.degrees(tilt_rad):.3f} deg (rms)"
    )
