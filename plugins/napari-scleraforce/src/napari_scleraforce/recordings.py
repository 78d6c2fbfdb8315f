"""A recording folder as a stack of frames that are read when they are shown."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import dask.array as da
from dask.delayed import delayed

import scleraforce as sf

MM = 1e3  # per m
RECORDING = "recording"  # key of the metadata of layers: the folder
LayerData = tuple[Any, dict[str, Any], str]


def reader_of(
    path: str | Sequence[str],
) -> Callable[[str | Sequence[str]], list[LayerData]] | None:
    """Return the reader of recording folders (npe2), None for other paths."""
    paths = [path] if isinstance(path, str) else path
    return (
        layers
        if all((Path(each) / "recording.toml").is_file() for each in paths)
        else None
    )


def layers(path: str | Sequence[str]) -> list[LayerData]:
    """Return an image layer (frame, row, column) for each recording folder.

    Raises:
        InputError: the recording cannot be read.
    """
    return [_stack(Path(each)) for each in ([path] if isinstance(path, str) else path)]


def _stack(path: Path) -> LayerData:
    recording = sf.read_recording(path)
    scan = recording.info.scan
    rows, columns = scan.shape
    width_m, depth_m = scan.extent_m
    dtype = recording.frame(recording.frames[0]).dtype
    frames = [
        da.from_delayed(delayed(recording.frame)(entry), (rows, columns), dtype)
        for entry in recording.frames
    ]
    scale = (1.0, depth_m * MM / rows, width_m * MM / columns)
    described = {
        "name": recording.info.eye_name,
        "scale": scale,
        "units": ("pixel", "mm", "mm"),
        "axis_labels": ("frame", "depth", "lateral"),
        "contrast_limits": (0, 2**scan.pixel_bits - 1),
        "metadata": {RECORDING: str(path.absolute())},
    }

    return da.stack(frames), described, "image"
