#!/usr/bin/env python3
"""B-scans of Heidelberg (.e2e), Topcon (.fda, .fds), Zeiss (.img) and Bioptigen (.OCT)
files as NumPy volumes.

OCT-Converter reads them. It brings an OpenCV of its own, which conflicts with
scleraforce's, and its Topcon readers need NumPy before 2.3; so this runs in an
environment of its own and imports nothing of scleraforce:

    python -m venv vendor && vendor/bin/pip install oct-converter==0.7.0 'numpy<2.3'
    vendor/bin/python examples/vendor_frames.py scan.e2e --out volumes
    scleraforce import volumes/scan-1.npy --axes frame,depth,lateral --out eye-1 ...

No scale is taken over: OCT-Converter fills in what it does not find (a Heidelberg pixel
is 0.01 mm wide in every file). What it says of the depth is printed, to be compared
with the scanner's own; tell width and depth to `import`.
"""

import argparse
import contextlib
import io
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

READERS = {".e2e": "E2E", ".fda": "FDA", ".fds": "FDS", ".img": "IMG", ".oct": "BOCT"}
# raw bytes: nothing in the file says how many rows and columns a frame has
OF_SIZE = ("IMG",)
# in `pixel_spacing`, mm; that of others is not known
DEPTH_AT = {
    "E2E": 1,
    "FDA": 2,
    "FDS": 2,
}


class ScanError(Exception):
    """A file cannot be taken over."""


def volumes_of(
    path: Path, size: tuple[int, int] | None
) -> list[tuple[np.ndarray, float | None]]:
    """Return the volumes of a file (frame, depth, lateral), each with the depth of a
    pixel, mm, where one is said.

    Raises:
        ScanError: it is damaged, of another kind, or its frames' size is open.
    """
    name = READERS.get(path.suffix.lower())
    if name is None:
        raise ScanError(f"{path}: of no kind that is read; give {', '.join(READERS)}")
    if (name in OF_SIZE) != (size is not None):
        given = (
            "has no header; give --rows and --columns"
            if size is None
            else "states its size; leave --rows out"
        )
        raise ScanError(f"{path}: {given}")

    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), warnings.catch_warnings():
            # of a Heidelberg file: a frame that would be missing
            warnings.simplefilter("error", UserWarning)
            found = _read(name, path, size)
    except (
        Exception
    ) as fault:  # the readers check nothing: any damage ends in any exception
        raise ScanError(
            f"{path}: {type(fault).__name__}: {' '.join(str(fault).split())}"
        ) from fault

    if (
        "Stopping load" in said.getvalue()
    ):  # of a Bioptigen file: the frames from here on are whatever was in memory
        raise ScanError(f"{path}: damaged: {' '.join(said.getvalue().split())}")

    stacks = [
        (_stack(path, volume.volume), _depth_mm(name, volume))
        for volume in found
        if volume is not None
    ]
    if not stacks:
        raise ScanError(f"{path}: no B-scans: {' '.join(said.getvalue().split())}")
    if name == "BOCT":  # A-scan after A-scan, and one volume for each time
        return [
            (np.concatenate([stack for stack, _ in stacks]).transpose(0, 2, 1), None)
        ]

    return stacks


def _read(name: str, path: Path, size: tuple[int, int] | None) -> list[Any]:
    import oct_converter.readers

    reader = getattr(oct_converter.readers, name)(path)
    found = (
        reader.read_oct_volume()
        if size is None
        else reader.read_oct_volume(rows=size[0], cols=size[1])
    )

    return found if isinstance(found, list) else [found]


def _stack(path: Path, frames: Any) -> np.ndarray:
    pictures = [np.asarray(frame) for frame in frames]
    if {picture.shape for picture in pictures} != {pictures[0].shape} or pictures[
        0
    ].ndim != 2:
        raise ScanError(
            f"{path}: frames of {sorted({picture.shape for picture in pictures})}; one"
            " size is needed"
        )

    return np.stack(pictures)


def _depth_mm(name: str, volume: Any) -> float | None:
    return (
        float(volume.pixel_spacing[DEPTH_AT[name]])
        if name in DEPTH_AT and volume.pixel_spacing
        else None
    )


def main(arguments: list[str]) -> int:
    """Write the volumes of a file; return the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument(
        "source", type=Path, help=f"a file that ends in {', '.join(READERS)}"
    )
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for the volumes; must not exist"
    )
    parser.add_argument("--rows", type=int, help="rows of a frame in a .img")
    parser.add_argument("--columns", type=int, help="columns of a frame in a .img")

    told = parser.parse_args(arguments)
    if (told.rows is None) != (told.columns is None):
        parser.error("--rows and --columns belong together")

    try:
        volumes = volumes_of(
            told.source, None if told.rows is None else (told.rows, told.columns)
        )
        told.out.mkdir(parents=True)
    except (ScanError, OSError) as fault:
        print(f"error: {fault}", file=sys.stderr)
        return 2

    for nth, (volume, depth_mm) in enumerate(volumes, start=1):
        out = told.out / f"{told.source.stem}-{nth}.npy"
        np.save(out, volume)
        frames, rows, columns = volume.shape
        print(
            f"wrote {out}: {frames} frames of {rows} x {columns} (depth x lateral),"
            f" {volume.dtype}"
        )

        if depth_mm is not None:
            print(
                f"  said of the depth: {depth_mm:.5g} mm a row, {depth_mm * rows:.4g}"
                " mm in all; check it"
            )

    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
