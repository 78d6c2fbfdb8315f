"""A frame with its scale: what was told, what the recording beside it says, what its own tags say, in this order."""

import os
from dataclasses import dataclass
from pathlib import Path

from scleraforce.errors import FrameError
from scleraforce.recording.files import read_info
from scleraforce.recording.images import check_frame, read_frame_image
from scleraforce.recording.info import RecordingInfo
from scleraforce.recording.pixels import Pixels, PixelScale, Sourced
from scleraforce.units import from_si

LEAST_M, LARGEST_M = 1e-5, 0.1  # of a frame's width and depth, as in recording.toml


@dataclass(frozen=True, kw_only=True)
class Scanner:
    """Width and depth of frames in m, and by which index depth is stretched; None: not stated."""

    width_m: float | None = None
    depth_m: float | None = None
    refractive_index: float | None = None


@dataclass(frozen=True, eq=False)
class ScaledFrame:
    """A frame, `pixels` (rows: depth, columns: lateral), with its scale, and what its recording states (None: none).

    `notes` say what was done to its pixels, and which contradictions of its file an option settled.
    """

    pixels: Pixels
    width_m: Sourced
    depth_m: Sourced
    refractive_index: Sourced
    info: RecordingInfo | None
    notes: tuple[str, ...] = ()

    @property
    def scale(self) -> PixelScale:
        """Size of a pixel as stored, with the refractive index."""
        rows, columns = self.pixels.shape
        return PixelScale(
            lateral_m=self.width_m.value / columns,
            depth_m=self.depth_m.value / rows,
            refractive_index=self.refractive_index.value,
        )


def recording_of(path: Path) -> Path | None:
    """Return the recording folder whose frame a file is: `frames/` with a recording.toml beside it; None: none."""
    folder = path.parent.resolve()
    inside = folder.name == "frames" and os.path.isfile(folder.parent / "recording.toml")
    return folder.parent if inside else None


def read_scaled_frame(path: Path, told: Scanner, assumed: tuple[Scanner, str], transpose: bool = False) -> ScaledFrame:
    """Read one frame and find its scale.

    Args:
        path: of the image.
        told: what the user says; it comes first.
        assumed: what counts where nothing states it, and who assumes it.
        transpose: the image's depth runs along its rows.

    Raises:
        FrameError: the file cannot be read, is not what its recording says, or nothing knows its scale.
        RecordingError: the recording.toml beside it cannot be used.
    """
    image = read_frame_image(path)
    lateral_m, depth_m = image.lateral_pixel_m, image.depth_pixel_m
    pixels: Pixels = image.pixels.T if transpose else image.pixels
    if transpose:
        lateral_m, depth_m = depth_m, lateral_m
    rows, columns = pixels.shape
    recording = recording_of(path)
    info = None if recording is None else read_info(recording / "recording.toml")
    if info is not None:
        check_frame(pixels, info.oct.rows, info.oct.columns, info.oct.bits, str(path))
    file = Scanner(width_m=lateral_m and lateral_m * columns, depth_m=depth_m and depth_m * rows)
    stated = ((told, "option"), (_scanner(info), "recording.toml"), (file, "file"), assumed)
    width, depth, index = (
        next((Sourced(value, source) for scanner, source in stated if (value := getattr(scanner, name))), None)
        for name in ("width_m", "depth_m", "refractive_index")
    )
    if image.scale_fault and info is None and None in (told.width_m, told.depth_m):
        raise FrameError(f"{image.scale_fault}; give --width-mm and --depth-mm")
    if width is None or depth is None:
        raise FrameError(
            f"{path}: how large it is stands neither in it nor in a recording.toml; give --width-mm and --depth-mm"
        )
    _check_extent(path, "wide", "--width-mm", width)
    _check_extent(path, "deep", "--depth-mm", depth)
    notes = (*image.notes, *([image.scale_fault] if image.scale_fault else []))
    return ScaledFrame(pixels, width, depth, index or Sourced(1.0, "assumed"), info, notes)


def _scanner(info: RecordingInfo | None) -> Scanner:
    return (
        Scanner(width_m=info.oct.width_m, depth_m=info.oct.depth_m, refractive_index=info.oct.refractive_index)
        if info
        else Scanner()
    )


def _check_extent(path: Path, word: str, option: str, extent: Sourced) -> None:
    if not LEAST_M <= extent.value <= LARGEST_M:
        raise FrameError(
            f"{path}: {from_si(extent.value, 'mm'):.4g} mm {word} ({extent.source}); no B-scan is: tell its size "
            f"with {option}"
        )
