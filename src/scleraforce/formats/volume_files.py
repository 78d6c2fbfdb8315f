"""What files of volumes have in common: their spacing, files of pixels beside a header, sequences of PLUS.

PLUS (PlusToolkit) writes times, states and the orientation of ultrasound frames as fields of MetaImage or NRRD.
"""

import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePath

import numpy as np

from scleraforce.errors import FrameError
from scleraforce.recording.pixels import Sourced
from scleraforce.recording.scan import Scan, Times, rising

Axes = tuple[str, ...] | None

GZIP_OR_ZLIB = zlib.MAX_WBITS | 32
SAME = 1e-3  # spacings that differ by less are rounded
ORIENTATION = re.compile("[UMFNAD]{2,3}", re.IGNORECASE)  # XX: not known
SEQUENCE = "Seq_Frame(\\d+)_{}"


def stated_steps(steps: Sequence[float], units_m: Sequence[float | None], source: str) -> tuple[Sourced | None, ...]:
    """Return the step along each axis, None where it is not known."""
    if all(step in (0.0, 1.0) or not np.isfinite(step) for step in steps[:3]):
        return tuple(None for _ in steps)
    return tuple(
        Sourced(step * unit_m, source) if unit_m is not None and np.isfinite(step) and step > 0.0 else None
        for step, unit_m in zip(steps, units_m, strict=True)
    )


def listed(values: Sequence[float]) -> str:
    """Return numbers as a message has them, like 0.0125 x 0.004."""
    return " x ".join(f"{value:.6g}" for value in values)


def data_file(path: Path, named: str) -> Path:
    """Return the file that holds the pixels of a header: its own where it names none, else one beside it.

    Raises:
        FrameError: it names one elsewhere.
    """
    if not named:
        return path
    if PurePath(named).name != named:
        raise FrameError(f"{path}: its pixels are said to be in {named!r}; import it where they lie beside it")
    return path.with_name(named)


def unpacked(path: Path, packed: bytes, most: int) -> bytes:
    """Return what a zlib or gzip stream holds.

    Raises:
        FrameError: it holds more bytes than its header says.
    """
    stream = zlib.decompressobj(GZIP_OR_ZLIB)
    data = stream.decompress(packed, most + 1)
    if len(data) > most:
        raise FrameError(f"{path}: damaged: more is packed in it than its header says")
    return data


def check_orientation(path: Path, orientation: str, axes: Axes) -> None:
    """Check that depth runs away from the probe along the axis that is named depth (PLUS).

    Raises:
        FrameError: it does not.
    """
    letters = orientation.upper() if ORIENTATION.fullmatch(orientation) else ""
    if "N" in letters:
        raise FrameError(
            f"{path}: UltrasoundImageOrientation = {orientation}: depth runs towards the probe; write it as MF "
            "(PlusToolkit: EditSequenceFile --operation=..., or flip the rows)"
        )
    if axes is not None and "F" in letters and letters.index("F") < len(axes) and axes[letters.index("F")] != "depth":
        raise FrameError(
            f"{path}: UltrasoundImageOrientation = {orientation}: depth is axis {letters.index('F') + 1}; --axes names "
            f"{','.join(axes)}"
        )


def plus_sequence(path: Path, scan: Scan, fields: Mapping[str, str]) -> Scan:
    """Return a sequence of PLUS with the times that it states, in s, and without its invalid frames.

    Raises:
        FrameError: the fields are not those of the frames, or no frame is valid.
    """
    stated = {
        field: {int(match[1]): value for name, value in fields.items() if (match := re.fullmatch(pattern, name, re.I))}
        for field in ("Timestamp", "ImageStatus")
        for pattern in [SEQUENCE.format(field)]
    }
    times, states = stated["Timestamp"], stated["ImageStatus"]
    count = len(scan.names)
    for name, values in stated.items():
        if values and sorted(values) != list(range(count)):
            raise FrameError(
                f"{path}: Seq_FrameNNNN_{name} of {len(values)} frames, {min(values)} to {max(values)}, and {count} "
                "frames along the axis named frame; write the sequence again, or name the axes as they are"
            )
    kept = [nth for nth in range(count) if states.get(nth, "OK").upper() != "INVALID"]
    if not kept:
        raise FrameError(
            f"{path}: Seq_FrameNNNN_ImageStatus = INVALID for all {count} frames; there is nothing to read"
        )
    if len(kept) < count:
        left_out = ", ".join(str(nth) for nth in range(count) if nth not in kept)
        note = f"{path}: ImageStatus = INVALID: frames {left_out} (from 0) are left out"
        pictures = scan.pictures
        scan = replace(
            scan,
            names=tuple(scan.names[nth] for nth in kept),
            pictures=lambda: (picture for nth, picture in enumerate(pictures()) if nth in set(kept)),
            notes=(*scan.notes, note),
        )
    if not times:
        return scan
    time_s = np.array([float(times[nth]) for nth in kept])
    if not rising(time_s):
        at = next(nth for nth in range(len(kept)) if not rising(time_s[: nth + 1]))
        pair = " and ".join(f"{times[nth]} (frame {nth})" for nth in kept[max(0, at - 1) : at + 1])
        return replace(scan, notes=(*scan.notes, f"{path}: Seq_FrameNNNN_Timestamp does not rise: {pair}; not used"))
    return replace(scan, times=Times(time_s, "Seq_Frame Timestamp"))
