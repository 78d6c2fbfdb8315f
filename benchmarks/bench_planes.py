"""A cross of two B-scans, with an unknown gap, against one plane, with the gap given
and without.

Computes virtual eyes in three dimensions at finite strain, images each moment in a
cross, and reads it with the bundled reader, with the true E: by both planes, by the
first one with its true gap, and by the first one alone. Prints the errors (rms) of
contact, gap, tilt, lean and force, and the share of the 90 % intervals that hold.

    python benchmarks/bench_planes.py [EYES]

`python benchmarks/bench_planes.py calibrate [EYES]` calibrates other such eyes instead,
on three moments of known force and on ten without forces: with the cross, and with its
first plane of a given gap, its median or 0.35 mm.
"""

import sys
from dataclasses import replace
from math import atan, cos, radians, tan
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import scleraforce as sf
from bench_without_force import POPULATION
from scleraforce.fit.unknowns import GAP
from scleraforce.lab.tissue_light import NeedleShaft
from scleraforce.lab.virtual_eye import BentSections, eye_name
from scleraforce.lab.virtual_recording import (
    in_planes,
    plan_phantom,
    plan_sections,
    render_frame,
    write_phantom,
)
from scleraforce.reading.reading_models import Reader
from scleraforce.recordings.recording_folder import Recording, read_recording
from scleraforce.records.eye import Eye, Modulus
from scleraforce.records.globe import OPEN
from scleraforce.records.needle import Needle
from scleraforce.records.scan import PixelScale, Plane, Scan
from scleraforce.records.setup import Setup
from scleraforce.records.study import MechanicsStudy, Range, Study, fixed
from virtual_eyes import changed, wall_of

SEED = 20261201
EYES = 12
MOMENTS = 8
CALIBRATED_SEED = 77431
TAKEN = 3
FORCES_N = (2e-3, *(np.linspace(0.12, 1.0, 9) * 54e-3).tolist())
PLANES = (Plane("along", 0.0, 0.0), Plane("across", 0.0, radians(90.0)))


def drawn_study() -> Study:
    """The study: tilted eyes, and needles that lean."""
    phantom = replace(
        Study().phantom,
        eye_tilt_rad=Range(min=radians(-3.0), max=radians(3.0)),
        needle_angle_rad=Range(min=radians(-25.0), max=radians(25.0)),
        needle_lean_rad=Range(min=radians(-25.0), max=radians(25.0)),
    )
    return replace(
        Study(), phantom=phantom, mechanics=MechanicsStudy(kind="finite-strain")
    )


def drawn_eye(number: int, rng: np.random.Generator) -> Setup:
    """One of the eyes."""
    return Setup(
        eye=Eye(
            f"cross-{number}",
            thickness_m=float(rng.uniform(0.45e-3, 0.8e-3)),
            modulus=Modulus.stated(float(rng.uniform(0.2e6, 0.4e6))),
            iop_pa=float(rng.uniform(150.0, 500.0)),
        ),
        needle=Needle(
            gap_m=float(rng.uniform(0.1e-3, 0.6e-3)),
            polar_rad=float(rng.uniform(radians(20.0), radians(45.0))),
            azimuth_rad=float(rng.uniform(0.0, 6.28)),
        ),
        scan=Scan(direction_rad=float(rng.uniform(-3.1, 3.1))),
    )


def read_eye(number: int, reader: Reader) -> list[dict[str, float]]:
    """The errors of each moment of an eye."""
    rng = np.random.default_rng([SEED, number])
    study = drawn_study()
    setup = drawn_eye(number, rng)

    if number % 3 == 2:  # a third shows the needle, in both planes
        setup = changed(setup, gap_m=0.05e-3)
        seen = replace(
            study.phantom,
            needle_count=fixed(1),
            eye_shift_m=Range(min=-0.05e-3, max=0.05e-3),
        )
        study = replace(study, phantom=seen)

    forces_n = rng.uniform(2e-3, 55e-3, MOMENTS).tolist()
    plan = in_planes(plan_phantom(setup, forces_n, study, SEED + number), PLANES, study)
    sections, _ = plan_sections(plan, BentSections(setup, study))
    scale = PixelScale.of(study.oct)
    known = Setup(
        eye=Eye(
            modulus=Modulus.stated(setup.eye.modulus_pa),
            iop_pa=wall_of(setup).iop_pa,
            thickness_m=wall_of(setup).thickness_m,
            globe=OPEN,
        ),
        needle=Needle(polar_rad=wall_of(setup).polar_rad),
        scan=Scan(direction_rad=setup.scan.direction_rad),
    )
    found = list[dict[str, float]]()
    pairs = list(zip(plan.frames, sections, plan.normal_n, strict=True))

    for (first, first_section, force_n), (second, second_section, _) in zip(
        pairs[::2], pairs[1::2], strict=True
    ):
        frames = [
            render_frame(frame, section, study).frame
            for frame, section in ((first, first_section), (second, second_section))
        ]
        assert first.cut is not None
        gap_m = first.cut.gap_m
        tilts = (first.pose.tilt_rad, first.cut.tilt_rad)
        both, _ = reader.read_together(frames, scale, known, PLANES)
        with_gap = reader.read(
            frames[0],
            scale,
            replace(known, needle=replace(known.needle, gap_m=abs(gap_m))),
        )
        alone = reader.read_together(frames[:1], scale, known, PLANES[:1])[0]
        row = {"force_n": force_n}

        for name, answer in (
            ("cross", both),
            ("gap given", with_gap),
            ("alone", alone),
        ):
            if answer.force_n is not None and answer.interval_n is not None:
                low_n, high_n = answer.interval_n
                row |= {
                    f"{name}: force": answer.force_n - force_n,
                    f"{name}: holds": float(low_n <= force_n <= high_n),
                }
                row |= {f"{name}: width": high_n - low_n}

        if both.usable and both.place is not None and both.fit is not None:
            place = both.place
            true = np.array([first.pose.lateral_m, -gap_m])
            row |= {
                "contact": float(
                    np.hypot(*(np.array(place.contact_m[:2]) - true)) / np.sqrt(2.0)
                )
            }
            row |= {"gap": float(both.fit.unknown[GAP]) - gap_m}
            row |= {"tilt": float(np.hypot(*(np.array(place.tilt_rad) - tilts)))}

            if first.optics.needle is not None and place.lean_rad is not None:
                row |= {"lean": place.lean_rad - true_lean(first.optics.needle)}

        found.append(row)

    return found


def true_lean(needle: NeedleShaft) -> float:
    """The angle between a shaft and the wall's normal."""
    up = np.array(
        [tan(needle.angle_rad), -tan(needle.lean_rad) / cos(needle.angle_rad)]
    )
    return atan(float(np.hypot(*up)))


def first_plane(recording: Recording, gap_m: float) -> Recording:
    """The frames of the first plane as a recording of a single one, of a given gap."""
    info = recording.info
    first = recording.info.scan.planes[0].name
    info = replace(
        info,
        scan=replace(info.scan, planes=()),
        needle=replace(info.needle, gap_m=gap_m),
    )
    shown = (
        replace(frame, plane=None) for frame in recording.frames if frame.plane == first
    )

    return replace(recording, info=info, frames=tuple(shown))


def calibrate_eye(number: int, folder: Path) -> dict[str, tuple[float, float]]:
    """Errors of ln E and its standard deviation, by the way of calibrating."""
    rng = np.random.default_rng([CALIBRATED_SEED, number])
    study = drawn_study()
    phantom = replace(
        study.phantom, needle_angle_rad=fixed(0.0), needle_lean_rad=fixed(0.0)
    )
    study = replace(study, phantom=phantom)
    setup = drawn_eye(number, rng)
    forces_n = list(FORCES_N)
    rng.shuffle(forces_n)
    plan = in_planes(
        plan_phantom(setup, forces_n, study, CALIBRATED_SEED + number), PLANES, study
    )
    write_phantom(folder, plan, BentSections(setup, study), study)
    recording = read_recording(folder)
    found = dict[str, tuple[float, float]]()
    gap_m = float(
        np.median(
            [abs(frame.cut.gap_m) for frame in plan.frames[:: len(PLANES)] if frame.cut]
        )
    )
    alone = {
        "median gap": first_plane(recording, gap_m),
        "0.35 mm": first_plane(recording, 0.35e-3),
    }

    by_shape = sf.CalibrationMethod(without_force=True, prior=POPULATION)
    for name, shown in {"cross": recording, **alone}.items():
        for way, given in (
            ("by force", {"frames": TAKEN}),
            ("by shape", {"method": by_shape}),
        ):
            one = sf.calibrate(shown, **given).eyes[eye_name(setup)]
            found[f"{name}, {way}"] = (
                float(np.log(one.mean_pa / setup.eye.modulus_pa)),
                one.sd_pa / one.mean_pa,
            )

    return found


def main_calibrate(count: int) -> None:
    """Print the table of calibrations."""
    rows = list[dict[str, tuple[float, float]]]()
    with TemporaryDirectory() as folder:
        for number in range(count):
            rows.append(calibrate_eye(number, Path(folder) / str(number)))
            print(number, rows[-1], file=sys.stderr)

    for name in rows[0]:
        off, sd = np.array([row[name] for row in rows]).T
        within = int((np.abs(off) < 2.0 * sd).sum())
        rms = 100 * np.sqrt((off**2).mean())
        sure = 100 * sd.mean()
        print(
            f"{name:22s} rms {rms:5.1f} %, sd {sure:5.1f} %, {within} of {count}"
            " within two"
        )


def main() -> None:
    """Print the table."""
    if sys.argv[1:2] == ["calibrate"]:
        main_calibrate(int([*sys.argv, "10"][2]))
        return

    reader = sf.load_model("default")
    rows = [
        row
        for number in range(int([*sys.argv, str(EYES)][1]))
        for row in read_eye(number, reader)
    ]

    for name in sorted({key for row in rows for key in row} - {"force_n"}):
        values = np.array([row[name] for row in rows if name in row])
        clear = np.array(
            [row[name] for row in rows if name in row and row["force_n"] > 5e-3]
        )
        summary = (
            f"mean {values.mean():.3f}"
            if name.endswith("holds")
            else f"rms {np.sqrt((values**2).mean()):.3e}"
        )
        more = (
            ""
            if name.endswith("holds")
            else f", above 5 mN {np.sqrt((clear**2).mean()):.3e}"
        )
        print(f"{name:20s} {summary}{more}, {len(values)} of {len(rows)}")


if __name__ == "__main__":
    main()
