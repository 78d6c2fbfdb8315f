"""A calibration file: each eye's modulus, the population's, and what the frames say of the wall."""

from pathlib import Path

from scleraforce.calibration.result import Calibration, EyeCalibration, found_words, parse_calibration
from scleraforce.known.calibration_file import open_calibration
from scleraforce.plain_text import wrapped
from scleraforce.report.calibration_figures import draw_calibration
from scleraforce.report.shown.kinds import Thing
from scleraforce.units import from_si

BENDS_OTHERWISE = 0.1  # by how much moduli of low and high forces differ that are worth a remark


def show_calibration(path: Path) -> Thing:
    """Look at a calibration file.

    Raises:
        CalibrationError: it cannot be read.
    """
    calibration = parse_calibration(open_calibration(path))
    mean_pa, sd_pa = calibration.population
    used = sum(len(eye.used) for eye in calibration.eyes.values())
    rows = (
        ("eyes", f"{len(calibration.eyes)}, on {used} frames"),
        ("mechanics", calibration.mechanics),
        ("study, SHA-256", calibration.study_sha256),
    )
    facts = {
        "mechanics": calibration.mechanics,
        "study_sha256": calibration.study_sha256,
        "population": {"mean_mpa": from_si(mean_pa, "mpa"), "sd_mpa": from_si(sd_pa, "mpa")},
        "eyes": {
            name: {
                "mean_mpa": from_si(eye.mean_pa, "mpa"),
                "sd_mpa": from_si(eye.sd_pa, "mpa"),
                "frames": len(eye.used),
                "status": eye.status,
            }
            for name, eye in calibration.eyes.items()
        },
    }
    return Thing(
        kind="calibration",
        facts=facts,
        rows=rows,
        lines=tuple(calibration_lines(calibration)),
        draw=lambda: draw_calibration(calibration),
    )


def calibration_lines(calibration: Calibration) -> list[str]:
    """Return a table of the eyes, the population below, and a note for each doubt about a recording."""
    lines = [f"{'eye':<16}{'E/MPa':>8}{'sd/MPa':>9}{'updates':>9}  remark"]
    lines += [_line(name, eye, calibration.bounds_n) for name, eye in calibration.eyes.items()]
    notes = [wrapped(f"{entry.path}: {doubt}", "note: ") for eye in calibration.eyes.values()
             for entry in eye.recordings for doubt in entry.doubts]  # fmt: skip
    mean_pa, sd_pa = calibration.population
    population = f"{'population':<16}{from_si(mean_pa, 'mpa'):>8.3f}"
    if sd_pa is None:
        population = wrapped("one eye says nothing of how eyes differ", f"{population}{'-':>9}{'':>9}  ")
    else:
        population += f"{from_si(sd_pa, 'mpa'):>9.4f}"
    return [*lines, population, *notes]


def _line(name: str, eye: EyeCalibration, bounds_n: tuple[float, ...]) -> str:
    gated = sum(len(frame.gated) for frame in eye.used)
    remarks = [
        f"{gated} outlying points left out" if gated else "",
        "" if eye.status == "ok" else eye.status,
        _softening(eye, bounds_n),
        *found_words(eye),
    ]
    text = "; ".join(remark for remark in remarks if remark)
    modulus = f"{from_si(eye.mean_pa, 'mpa'):>8.3f}{from_si(eye.sd_pa, 'mpa'):>9.4f}"
    return wrapped(text, f"{name:<16}{modulus}{eye.state.posterior.updates:>9}  ")


def _softening(eye: EyeCalibration, bounds_n: tuple[float, ...]) -> str:
    """Return a remark where low and high forces do not agree on E; a frame alone cannot tell E from a rigidity."""
    _, low, high = eye.by_class(bounds_n)
    if eye.globe.can_be_sealed or low is None or high is None or abs(high / low - 1) < BENDS_OTHERWISE:
        return ""
    force = f"{from_si(bounds_n[-1], 'mn'):g} mN"
    moduli = f"{from_si(low, 'mpa'):.3f} MPa below {force} and {from_si(high, 'mpa'):.3f} above"
    return f"E is {moduli}: the wall bends otherwise than the model"
