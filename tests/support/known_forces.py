"""A recording of the analytic wall under known forces, and what evaluations of it need."""

from pathlib import Path

import cv2
import numpy as np
from analytic_frames import GAP_M, MODULUS_PA, SMALL_LIBRARY, THICKNESS_M, image, recording_toml, tip_of, wall_section
from calibration_file import calibration_text
from fixed_reader import write_fixed_reader

from scleraforce.recording.folder import frame_digest
from scleraforce.recording.images import read_frame

__all__ = ["FORCES_N", "FORCE_TOML", "write_places", "write_recording"]

FORCES_N = (0.002, 0.012, 0.022, 0.036)
FORCE_TOML = '[force]\naxis = "fz"\ncontact_sign = -1'


def write_recording(path: Path, eye: str, gap_m: float = GAP_M, seed: int = 0) -> Path:
    """Four frames of the analytic wall under known forces, and one that shows nothing."""
    (path / "frames").mkdir(parents=True)
    (path / "recording.toml").write_text(recording_toml(eye, gap_m, more=FORCE_TOML))
    forces_n = (*FORCES_N, 0.010)
    images = [image(wall_section(tip_of(force_n)), seed + k) for k, force_n in enumerate(FORCES_N)]
    images.append(np.full_like(images[0], 600))
    for number, pixels in enumerate(images):
        cv2.imwrite(str(path / "frames" / f"{number}.png"), pixels)
    lines = ["file,time_s", *(f"{number}.png,{5 + 6 * number}" for number in range(len(images)))]
    (path / "frames.csv").write_text("\n".join(lines) + "\n")
    time_s = np.arange(0.0, 40.0, 0.01)
    log = np.zeros((len(time_s), 7))
    log[:, 0] = time_s
    log[:, 3] = 0.1 - sum(f * (np.abs(time_s - 5 - 6 * n) < 2.0) for n, f in enumerate(forces_n))
    header = "time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm"
    np.savetxt(path / "forces.csv", log, fmt="%.6f", delimiter=",", header=header, comments="")
    return path


def write_places(folder: Path) -> dict[str, Path]:
    """Write a model, calibrations and recordings of three eyes."""
    write_fixed_reader(folder / "model", SMALL_LIBRARY, (0.125,) * 8)
    mpa = MODULUS_PA / 1e6
    mine = write_recording(folder / "mine", "mine")
    used = [{"file": "1.png", "sha256": frame_digest(read_frame(mine / "frames" / "1.png"))}]
    eyes = {"mine": {"mean_mpa": mpa, "sd_mpa": 0.01 * mpa, "thickness_um": THICKNESS_M * 1e6, "frames": used}}
    population = {"mean_mpa": 1.1 * mpa, "sd_mpa": 0.05}
    (folder / "calibration.json").write_text(calibration_text(eyes=eyes, population=population))
    (folder / "linear.json").write_text(calibration_text(mechanics="linear"))
    return {
        "model": folder / "model",
        "calibration": folder / "calibration.json",
        "linear": folder / "linear.json",
        "mine": mine,
        "other": write_recording(folder / "other", "stranger", seed=100),
        "far": write_recording(folder / "far", "far", gap_m=1.5e-3),
    }
