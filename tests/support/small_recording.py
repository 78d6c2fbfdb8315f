"""A recording of small frames in a folder, for tests of what sends it: each frame is told by its first pixel."""

import json
from pathlib import Path

import cv2
import numpy as np

ROWS, COLUMNS = 24, 32


def write_small_recording(
    folder: Path, frames: int = 40, rate_hz: float = 100.0, forces_mn=None, log: bool = True
) -> Path:
    (folder / "frames").mkdir(parents=True)
    force = "[force]\naxis = 'fz'\ncontact_sign = -1\naverage_s = 0.1\n" if log else ""
    (folder / "recording.toml").write_text(
        "[eye]\nid = 'small'\n"
        f"[oct]\ncolumns = {COLUMNS}\nrows = {ROWS}\nbits = 12\nwidth_m = 0.008\ndepth_m = 0.003\n"
        f"[needle]\ngauge = 22\nslice_gap_m = 0.0005\n{force}"
    )
    rng = np.random.default_rng(0)
    lines = ["file,time_s"]
    for index in range(frames):
        pixels = rng.integers(0, 4096, (ROWS, COLUMNS), dtype=np.uint16)
        pixels[0, 0] = index
        assert cv2.imwrite(str(folder / "frames" / f"{index:04d}.png"), pixels)
        lines.append(f"{index:04d}.png,{1.0 + index / rate_hz:.4f}")
    (folder / "frames.csv").write_text("\n".join(lines) + "\n")
    if log:
        samples = np.arange(1.0, 1.0 + frames / rate_hz, 0.005)
        rows = [f"{time_s:.4f},0.001,0.002,{-time_s:.4f},0.1,0.2,0.3" for time_s in samples]
        (folder / "forces.csv").write_text("\n".join(["time_s,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm", *rows]) + "\n")
    if forces_mn is not None:
        truth = [{"file": f"{n:04d}.png", "force_n": force / 1e3} for n, force in enumerate(forces_mn)]
        (folder / "truth.json").write_text(json.dumps({"frames": truth}))
    return folder
