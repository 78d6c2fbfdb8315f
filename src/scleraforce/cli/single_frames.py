"""What the commands that read single frames share: the options of their scale, and what happens to a bad file."""

import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from scleraforce.cli.main import fail
from scleraforce.cli.output import progress_bar
from scleraforce.cli.quantities import Possible
from scleraforce.cli.wall_finder_option import finder_folder
from scleraforce.errors import InputError
from scleraforce.units import from_si, to_si

if TYPE_CHECKING:
    from scleraforce.recording.folder import ScaledFrame, Scanner
    from scleraforce.segmentation.steps import Segmentation
    from scleraforce.segmentation.wall_finder import WallFinder

Command = TypeVar("Command", bound=Callable[..., Any])
Item = TypeVar("Item")
Result = TypeVar("Result")

ASSUMED = "assumed"  # the source of a value that nobody states
OPTIONS = (
    click.option("--width-mm", type=Possible("width_mm"), help="Width of the frames; by default their "
                 "recording's or their own (DICOM, TIFF)."),
    click.option("--depth-mm", type=Possible("depth_mm"), help="Depth of the frames, as stored; by default likewise."),
    click.option("--refractive-index", type=click.FloatRange(1.0, 2.0),
                 help="By which depth is stretched (1: corrected already); by default the recording's, else "
                 "that of the model's study (classify) or 1."),
    click.option("--transpose", is_flag=True, help="The frames' depth runs along their rows, from left to right."),
)  # fmt: skip


def scanner_options(command: Command) -> Command:
    """Add the options to a command: the arguments of `told_scanner`, and `transpose`."""
    for option in reversed(OPTIONS):
        command = option(command)
    return command


def told_scanner(width_mm: float | None, depth_mm: float | None, refractive_index: float | None) -> "Scanner":
    """Return what the options say of the frames."""
    from scleraforce.recording.folder import Scanner

    return Scanner(
        width_m=to_si(width_mm, "mm"),
        depth_m=to_si(depth_mm, "mm"),
        refractive_index=refractive_index,
    )


def asked_wall_finder(finder: Path | None) -> "WallFinder | None":
    """Return the wall finder that `--wall-finder` asks for; None: none.

    Raises:
        ModelError: it cannot be loaded.
    """
    folder = finder_folder(finder)
    if folder is None:
        return None
    # Imported here: ONNX Runtime takes longer to import than frames to segment.
    from scleraforce.reader.model import load_wall_finder

    return load_wall_finder(folder)


def wall_in(frame: "ScaledFrame", finder: "WallFinder | None", thickness_m: float | None = None) -> "Segmentation":
    """Return the wall in a frame: by both ways, or without a wall finder by the classical one alone."""
    if finder is None:
        from scleraforce.segmentation.sclera import find_sclera

        return find_sclera(frame.pixels, frame.scale, thickness_m)
    from scleraforce.segmentation.checked_wall import find_checked_wall

    return find_checked_wall(frame.pixels, frame.scale, finder, thickness_m)


def each_of(items: Iterable[Item], read: Callable[[Item], Result]) -> Iterator[tuple[Item, Result | InputError]]:
    """Read one frame after the other, behind a progress bar: a bad one is an error in its place, the others go on."""
    for item in progress_bar(items, "frames"):
        try:
            yield item, read(item)
        except InputError as fault:
            yield item, fault
        except OSError as fault:  # a name that is too long, a disk that is full
            yield item, InputError(f"{fault.filename}: {fault.strerror}")


def end_with_faults(found: Iterable[object]) -> None:
    """Tell the errors that stand among results, a line each, and end the command with code 2 where there is one."""
    faults = [fault for fault in found if isinstance(fault, InputError)]
    for fault in faults:
        fail(str(fault), 2)
    if faults:
        raise click.exceptions.Exit(2)


def is_folder(path: Path) -> bool:
    """Return whether a folder is there; a name that no file can have is none."""
    return os.path.isdir(path)


def scale_entry(frame: "ScaledFrame") -> dict[str, Any]:
    """Return the scale that a frame was read with, and who states it, for JSON."""
    width, depth, index = frame.width_m, frame.depth_m, frame.refractive_index
    return {
        "width_mm": {"value": from_si(width.value, "mm"), "source": width.source},
        "depth_mm": {"value": from_si(depth.value, "mm"), "source": depth.source},
        "refractive_index": {"value": index.value, "source": index.source},
    }


def size_words(frame: "ScaledFrame") -> str:
    """Return the same for people.

    Sources that are alike stand once: "15 x 4 mm (recording.toml), refractive index 1 (option)".
    """
    width, depth, index = frame.width_m, frame.depth_m, frame.refractive_index
    mm = [f"{from_si(extent.value, 'mm'):.4g}" for extent in (width, depth)]
    sizes = (
        f"{mm[0]} x {mm[1]} mm ({width.source})"
        if width.source == depth.source
        else f"{mm[0]} mm ({width.source}) x {mm[1]} mm ({depth.source})"
    )
    return f"{sizes}, refractive index {index.value:g} ({index.source})"
