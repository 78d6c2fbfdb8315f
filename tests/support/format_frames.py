"""Frames that tests write in the formats of other programs: no two pixels that could be mistaken for each other."""

from pathlib import Path

import numpy as np

ROWS, COLUMNS, COUNT = 24, 40, 5
FRAMES = np.arange(COUNT * ROWS * COLUMNS, dtype=np.uint16).reshape(COUNT, ROWS, COLUMNS)  # below 2**13
DEPTH_M, LATERAL_M = 4e-6, 15e-6  # of a pixel


def pictures_of(scan) -> np.ndarray:
    """All frames of a scan; its names and its size are those of its pixels."""
    found = np.stack([np.asarray(picture) for picture in scan.pictures()])
    assert found.shape == (len(scan.names), scan.rows, scan.columns)
    return found


def told(*options: object) -> list[str]:
    """Options that answer what no file states, and `options`."""
    needle = ["--eye", "eye-1", "--gauge", "22", "--gap-mm", "0.6"]
    return [*needle, "--refractive-index", "1.38", *map(str, options)]


def with_log(recording: Path) -> Path:
    """Give a small recording a log that begins before its frames and ends after them."""
    time_s = np.arange(0.0, 3.0, 0.005)
    lines = [f"{t:.3f},{-0.02 * np.clip(t - 0.5, 0.0, 0.5):.6f}" for t in time_s]
    (recording / "forces.csv").write_text("\n".join(["time_s,fz_n", *lines]) + "\n")
    return recording


def write_log(path: Path, seconds: float = 6.0, rate_hz: float = 200.0) -> np.ndarray:
    """Write a log of a push after two seconds in columns of its own, mN against ms; return the force in N."""
    time_s = np.arange(0.0, seconds, 1.0 / rate_hz)
    force_n = -0.02 * np.clip(time_s - 2.0, 0.0, 1.0)
    lines = [f"{t * 1e3:.3f},{n * 1e3:.4f}" for t, n in zip(time_s, force_n, strict=True)]
    path.write_text("\n".join(["Time (ms),Force_Z [mN]", *lines]) + "\n")
    return force_n
