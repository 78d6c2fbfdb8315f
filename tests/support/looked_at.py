"""Frames that were answered and looked at again, from a recording that is drawn here."""

from pathlib import Path

import cv2
import numpy as np
from frame_answers import frame_answer

from scleraforce.recording.folder import read_recording
from scleraforce.recording.pixels import PixelScale
from scleraforce.report.frames import AnsweredFrame, look_at_all
from scleraforce.segmentation.wall import find_wall

__all__ = ["looked_at_frames"]

ROWS, COLUMNS = 256, 300
INFO = f"""[eye]
id = "eye"
[oct]
columns = {COLUMNS}
rows = {ROWS}
bits = 12
width_m = 15e-3
depth_m = 4e-3
[needle]
gauge = 22
slice_gap_m = 5e-4
"""


def looked_at_frames(folder: Path, count: int) -> tuple[AnsweredFrame, ...]:
    """Return frames of a wall 0.6 mm thick, each read as it was measured: 20 mN, class 1."""
    (folder / "frames").mkdir(parents=True)
    (folder / "recording.toml").write_text(INFO)
    names = [f"{number:04d}.png" for number in range(1, count + 1)]
    (folder / "frames.csv").write_text("\n".join(["file,time_s", *(f"{name},{n}" for n, name in enumerate(names))]))
    rng = np.random.default_rng(7)
    for name in names:
        cv2.imwrite(str(folder / "frames" / name), _wall(rng))
    recording = read_recording(folder)
    scale = PixelScale.of(recording.info.oct)
    return look_at_all(
        frame_answer(recording=str(folder), file=entry.file, segmentation=find_wall(recording.frame(entry), scale))
        for entry in recording.frames
    )


def _wall(rng: np.random.Generator) -> np.ndarray:
    lateral_m = (np.arange(COLUMNS) + 0.5) / COLUMNS * 15e-3 - 7.5e-3
    top_m = 0.5e-3 + 12e-3 - np.sqrt(12e-3**2 - lateral_m**2) + 0.6e-3 * np.exp(-((lateral_m / 2e-3) ** 2))
    depth_m = (np.arange(ROWS)[:, None] + 0.5) / ROWS * 4e-3
    wall = (depth_m >= top_m) & (depth_m < top_m + 0.6e-3)
    return np.clip(rng.normal(np.where(wall, 2400.0, 600.0), 150.0), 0, 4095).astype(np.uint16)
