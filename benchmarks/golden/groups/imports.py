"""The shared files of other programs as recordings: frames, times, scale, forces and
notes, or the words that refuse them.
"""

import gzip
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any
from zlib import crc32

import cv2
import numpy as np

import scleraforce as sf
from golden.answers import Answers, Record, plain
from golden.inputs import SHARED

# What no format states; an import is refused, and its words are frozen, where more is
# missing.
STATED: dict[str, Any] = {
    "eye": "eye-1",
    "gauge": 22,
    "refractive_index": 1.38,
    "bits": 13,
    "gap_m": 0.6e-3,
    "width_m": 0.6e-3,
    "depth_m": 0.096e-3,
}
ALL = "shared"  # the only piece of work
RATE = {"rate_hz": 2.0}
SHARED_SCANS = ".dcm", ".tif", ".mha", ".mhd", ".mkv", ".bag", ".mcap", ".npz", ".db3"
SHARED_LOGS = ".csv", ".tsv", ".txt"
SENSOR = {"axis": "fz", "contact_sign": -1, "average_s": 0.2}
# What an import asks for, and the answer to it.
OPEN: Mapping[str, Mapping[str, Any]] = {
    "give `axes`": {"axes": "frame,depth,lateral"},
    "(`rate_hz`": RATE,
    "(`bits`)": {"bits": 16},
    "(`clock_offset_s`)": {"clock_offset_s": 0.0},
    "(`axis`)": SENSOR,
    "below the smallest allowed value": {"axes": "lateral,depth,frame"},
}
MOST_TIMES = 8  # of a recording that are kept


def answers(_name: str, _recordings: dict[str, Path], folder: Path) -> Answers:
    """Import each shared file that is a scan or a log, with answers to all that it may
    leave open.
    """
    place = folder / "imports-shared"
    place.mkdir()
    return dict(_shared(place))


def _shared(place: Path) -> Iterator[tuple[str, Record]]:
    folders = [SHARED / name for name in ("cases", "real-oct", "real-logs")]
    files = [
        path
        for folder in folders
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.parent.name != "tissue-surface"
    ]
    pictures = [place / f"scan-{number:02}.png" for number in range(5)]
    frames = np.arange(5 * 24 * 40, dtype=np.uint16).reshape(5, 24, 40)
    for picture, pixels in zip(pictures, frames, strict=True):
        assert cv2.imwrite(str(picture), pixels)
    for path in files:
        name = str(path.relative_to(SHARED))
        folder = place / name.replace("/", "-")
        folder.mkdir()
        source = _unpacked(path, folder)
        if source.suffix in SHARED_SCANS:
            arguments = STATED | {"bits": None}
            yield name, _answered([source], folder / "made", arguments)
        elif source.suffix in SHARED_LOGS:
            arguments = STATED | RATE | SENSOR | {"clock_offset_s": 0.0}
            yield name, _answered([*pictures, source], folder / "made", arguments)


def _answered(
    sources: Sequence[Path], out: Path, arguments: Mapping[str, Any]
) -> Record:
    """Import sources, and once more for each open point that `OPEN` settles."""
    found = _imported(sources, out, arguments)
    for words, settled in OPEN.items():
        if words in found.get("error", ""):
            arguments = {**arguments, **settled}
            found = _imported(sources, out, arguments)
    return found


def _unpacked(path: Path, folder: Path) -> Path:
    """Return a file, or what is in it where it is packed by gzip."""
    if path.suffix != ".gz":
        return path
    with gzip.open(path, "rb") as packed, (folder / path.stem).open("wb") as file:
        shutil.copyfileobj(packed, file)
    return folder / path.stem


def _in_records(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments with those of `ImportSettings` in one."""
    names = {item.name for item in fields(sf.ImportSettings)}
    of_settings = {name: one for name, one in arguments.items() if name in names}
    others = {name: one for name, one in arguments.items() if name not in names}
    return {**others, "settings": sf.ImportSettings(**of_settings)}


def _imported(
    sources: Sequence[Path], out: Path, arguments: Mapping[str, Any]
) -> Record:
    """Return what an import makes of sources; a value that they leave out is not given
    again.
    """
    try:
        recording = sf.import_recording(list(sources), out, **_in_records(arguments))
    except sf.InputError as fault:
        return {"error": str(fault)}
    frames = [recording.frame(frame) for frame in recording.frames]
    times_s = [frame.time_s for frame in recording.frames]
    made_from = json.loads((out / "import.json").read_text(encoding="utf-8"))
    scan = recording.info.scan
    record = {
        "frames": len(frames),
        "files": [frame.file for frame in recording.frames[:MOST_TIMES]],
        "times_s": times_s[:MOST_TIMES],
        "last_s": times_s[-1],
        "rows": scan.rows,
        "columns": scan.columns,
        "bits": scan.bits,
        "width_mm": 1e3 * scan.extent_m[0],
        "depth_mm": 1e3 * scan.extent_m[1],
        "mean_grey": float(np.mean([frame.mean() for frame in frames])),
        "pixels": crc32(
            b"".join(np.ascontiguousarray(frame).tobytes() for frame in frames)
        ),
        "values": sorted(f"{key}: {of}" for key, of in made_from["values"].items()),
        "grey": made_from["grey"],
        "notes": made_from["notes"],
        "log_columns": made_from["columns"],
    }
    record |= _forces(recording)
    return {name: plain(value) for name, value in record.items()}


def _forces(recording: Any) -> Record:
    """Return the size of a recording's force log, and means and ends of its columns."""
    log = recording.forces
    if log is None:
        return {"samples": 0}
    info = recording.info.force
    columns = np.asarray(log.wrench_sc, dtype=np.float64)
    return {
        "samples": len(log.time_s),
        "log_s": [float(log.time_s[0]), float(log.time_s[-1])],
        "axis": info.axis,
        "contact_sign": info.contact_sign,
        "missing": int(np.isnan(columns).any(axis=1).sum()),
        "means_mn": list(1e3 * np.nanmean(columns, axis=0)),
        "lowest_mn": list(1e3 * np.nanmin(columns, axis=0)),
        "highest_mn": list(1e3 * np.nanmax(columns, axis=0)),
        **_labels(recording),
    }


def _labels(recording: Any) -> Record:
    """Return the force under each frame, or the words that refuse the log."""
    try:
        frames = sf.evaluate(sf.load_model("default"), recording).frames
    except sf.InputError as fault:
        return {"labels_error": str(fault)}
    labels = [frame.measured_force_n for frame in frames]
    return {"labels_mn": [None if each is None else 1e3 * each for each in labels]}
