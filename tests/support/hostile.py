"""Damaged and hostile files: a whole file of each kind, seeded mutations, and a judge
of the reading.

Started as `PYTHONPATH=benchmarks python tests/support/hostile.py FOLDER KIND FIRST
LAST`: prints a JSON line for every seed and every fault. Reading may end well or in an
`InputError`, within some seconds and some memory, and writes nothing.
"""

import json
import os
import random
import re
import resource
import shutil
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from analytic_library import analytic_library, solve_analytic
from foreign_files import write_dicom
from small_models import rehash_model, rehash_store, write_fixed_reader
from small_recordings import calibration_text, write_small_recording

from scleraforce.base.errors import InputError
from scleraforce.calibration.calibration import parse_calibration
from scleraforce.lab.training.slice_dataset import (
    DTYPES,
    SLICES,
    create_dataset,
    open_dataset,
    plan_dataset,
    unit_samples,
)
from scleraforce.library.library_store import build_library, open_library
from scleraforce.reading.load_model import load_force_reader
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.formats.image_files import read_frame
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.calibration_file import open_calibration, read_calibration
from scleraforce.records.setup import Setup
from scleraforce.records.study import (
    DatasetGroup,
    DatasetStudy,
    LibraryStudy,
    SliceStudy,
    Study,
    format_study,
    read_study,
)

SECONDS = 20
MEMORY = 3 * 2**30
SPECIAL: dict[str, Callable[[Path], object]] = {
    "pipe": os.mkfifo,
    "endless": lambda path: path.symlink_to("/dev/zero"),
    "folder": Path.mkdir,
    "empty": Path.touch,
    "nothing": lambda _: None,
}
SMALL_LIBRARY = LibraryStudy(thicknesses=4, tensions=4, tips=6, elements=16)
NASTY = [
    "1e308",
    "-1e308",
    "1e999",
    "nan",
    "inf",
    "-1",
    "0",
    "1_000",
    "9" * 5000,
    "",
    "null",
    "true",
    "[]",
    "{}",
    '"x"',
    "[" * 3000,
    '{"a":' * 3000,
    "\x00",
    "\ufeff",
    "١٢",
    "1000000000",
    "../../etc/passwd",
    "/dev/zero",
]
VALUES: list[Any] = [
    None,
    True,
    -1,
    0,
    10**30,
    1e308,
    float("nan"),
    float("inf"),
    "",
    "x",
    "/dev/zero",
    [],
    {},
    [[]],
    {"a": {}},
    [1, 2, 3],
    "9" * 5000,
]


def write_whole_ones(folder: Path) -> None:
    """Write a file or folder of every kind."""
    (folder / "study.toml").write_text(format_study(Study()))
    write_small_recording(folder / "recording", frames=4)
    (folder / "calibration.json").write_text(calibration_text(eyes={"eye-1": {}}))
    picture = np.random.default_rng(0).integers(0, 255, (24, 32), dtype=np.uint8)
    (folder / "frames").mkdir()

    for suffix in ("png", "tif", "jpg"):
        cv2.imwrite(str(folder / "frames" / f"frame.{suffix}"), picture)

    write_dicom(folder / "frames" / "frame.dcm", picture, PixelSpacing=[0.01, 0.01])
    group = DatasetGroup(images=20)
    study = Study(
        slice=SliceStudy(rows=8, columns=10),
        dataset=DatasetStudy(contacts=2, group=(group,)),
    )
    write_fixed_reader(
        folder / "model", analytic_library(thicknesses=4, ratios=4, tips=5), [1.0] * 8
    )
    plan = plan_dataset(study)
    store = create_dataset(folder / "dataset", study, 3e5, None, plan)
    rows = np.arange(8)[:, None] > np.arange(10) // 2

    for unit in range(len(unit_samples(study))):
        store.write(unit, {SLICES: np.repeat(np.uint8(255) * rows[None], 20, axis=0)})

    store.finish()
    build_library(
        Study(library=SMALL_LIBRARY),
        folder / "library",
        workers=1,
        solve=solve_analytic,
    )


def _read_recording(folder: Path) -> object:
    return label_frames(read_recording(folder / "recording"), Study().classes)


def _read_frames(folder: Path) -> object:
    return [read_frame(path) for path in sorted((folder / "frames").iterdir())]


def _read_calibration(folder: Path) -> object:
    path = folder / "calibration.json"
    return read_calibration(path), parse_calibration(open_calibration(path))


def _read_dataset(folder: Path) -> object:
    return [open_dataset(folder / "dataset").read(name) for name in ("slices", *DTYPES)]


def _read_model(folder: Path) -> object:
    model = load_force_reader(folder / "model")
    return model.network.read(
        np.zeros((1, model.study.slice.rows, model.study.slice.columns), np.uint8),
        Setup(),
    )


# Of each kind: the file, or the files of which a seed takes one; what reads it; what
# makes hashes agree.
KINDS: dict[
    str, tuple[str, Callable[[Path], object], Callable[[Path], None] | None]
] = {
    "study": ("study.toml", lambda folder: read_study(folder / "study.toml"), None),
    "recording": ("recording/recording.toml", _read_recording, None),
    "frame list": ("recording/frames.csv", _read_recording, None),
    "force log": ("recording/forces.csv", _read_recording, None),
    "png": ("frames/frame.png", _read_frames, None),
    "tiff": ("frames/frame.tif", _read_frames, None),
    "jpeg": ("frames/frame.jpg", _read_frames, None),
    "dicom": ("frames/frame.dcm", _read_frames, None),
    "calibration": ("calibration.json", _read_calibration, None),
    "model record": ("model/model.json", _read_model, None),
    "network": (
        "model/model.onnx",
        _read_model,
        lambda folder: rehash_model(folder / "model", "model.onnx"),
    ),
    "npz": (
        "model/library.npz",
        _read_model,
        lambda folder: rehash_model(folder / "model", "library.npz"),
    ),
    "dataset": (
        "dataset/**/*",
        _read_dataset,
        lambda folder: rehash_store(folder / "dataset"),
    ),
    "library": (
        "library/**/*",
        lambda folder: open_library(folder / "library"),
        lambda f: rehash_store(f / "library"),
    ),
}


def damage(folder: Path, kind: str, seed: int | str) -> Path:
    """Damage a file of a kind: as the seed has it, or by putting something special in
    its place. Return it.
    """
    rng = random.Random(f"{kind} {seed}")
    pattern, _, rehash = KINDS[kind]
    path = rng.choice(sorted(file for file in folder.glob(pattern) if file.is_file()))

    if isinstance(seed, str):
        path.unlink()
        SPECIAL[seed](path)
        return path

    content = path.read_bytes()
    if path.suffix == ".json" and rng.random() < 0.5:
        path.write_text(json.dumps(_changed(json.loads(content), rng)))
    else:
        for _ in range(rng.choice((1, 1, 2, 5))):
            content = _mutated(content, rng)

        path.write_bytes(content)

    if rehash and rng.random() < 0.7:
        try:
            rehash(folder)
        except (ValueError, KeyError, TypeError, AttributeError):
            return path  # the hashes themselves are damaged

    return path


def _changed(value: Any, rng: random.Random) -> Any:
    """Put a nasty value in some place of a JSON value."""
    if isinstance(value, dict | list) and value and rng.random() < 0.85:
        keys = list(value) if isinstance(value, dict) else list(range(len(value)))
        key = rng.choice(keys)

        if rng.random() < 0.1:
            del value[key]
        else:
            value[key] = _changed(value[key], rng)

        return value

    return rng.choice(VALUES)


def _mutated(content: bytes, rng: random.Random) -> bytes:
    """Flip a bit, cut or double a part, insert or overwrite bytes, or replace a word or
    number.
    """
    low, high = sorted(rng.randrange(len(content) + 1) for _ in range(2))
    tokens = list(re.finditer(rb"[A-Za-z0-9_.+-]+", content[:100_000]))

    match rng.choice(
        ("flip", "flip", "cut", "double", "insert", "overwrite", "token", "token")
    ):
        case "flip" if content:
            at = rng.randrange(len(content))
            return (
                content[:at]
                + bytes([content[at] ^ (1 << rng.randrange(8))])
                + content[at + 1 :]
            )
        case "cut":
            return content[:low] + content[high:]
        case "double":
            return content[:high] + content[low:]
        case "overwrite":
            return (
                content[:low]
                + rng.choice([b"\xff" * 4, bytes(4), rng.randbytes(4)])
                + content[low + 4 :]
            )
        case "token" if tokens:
            token = rng.choice(tokens)
            return (
                content[: token.start()]
                + rng.choice(NASTY).encode()
                + content[token.end() :]
            )
        case _:
            inserted = rng.choice(
                [rng.choice(NASTY).encode(), rng.randbytes(8), b"\xff" * 8]
            )
            return content[:low] + inserted + content[low:]


def judge(folder: Path, kind: str) -> str | None:
    """Read the damaged file; return the fault of the reading, or None."""
    before = _listing(folder)
    signal.signal(signal.SIGALRM, _too_long)
    signal.alarm(SECONDS)

    try:
        KINDS[kind][1](folder)
    except InputError:
        pass
    except Exception as fault:
        return f"{type(fault).__name__}: {str(fault)[:200]}"
    finally:
        signal.alarm(0)

    return None if _listing(folder) == before else "something was written"


def _too_long(*_: object) -> None:
    raise TimeoutError(f"more than {SECONDS} s")


def _listing(folder: Path) -> list[tuple[str, int]]:
    return sorted((str(path), path.lstat().st_mtime_ns) for path in folder.rglob("*"))


def main() -> None:
    whole = Path(sys.argv[1])
    kind = sys.argv[2]
    first = int(sys.argv[3])
    last = int(sys.argv[4])
    copy = whole.with_name(f"{whole.name}-{kind.replace(' ', '-')}-{last}")
    top = KINDS[kind][0].partition("/")[0]
    copy.mkdir()
    (shutil.copytree if (whole / top).is_dir() else shutil.copyfile)(
        whole / top, copy / top
    )
    assert judge(copy, kind) is None, "what is whole cannot be read"
    address_space = (
        int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    )
    resource.setrlimit(resource.RLIMIT_AS, (address_space + MEMORY,) * 2)

    for seed in (*SPECIAL, *range(first, last)):
        print(json.dumps([seed, None, None]), flush=True)  # noqa: T201 - the last printed seed is the one that crashed
        path = damage(copy, kind, seed)
        if found := judge(copy, kind):
            print(json.dumps([seed, str(path.relative_to(copy)), found]), flush=True)  # noqa: T201 - as above

        beside = {
            copy / top / name
            for name in ("zarr.json", "model.json")
            if (whole / top / name).exists()
        }
        for changed in {path} | beside:
            _restore(whole / changed.relative_to(copy), changed)


def _restore(whole: Path, path: Path) -> None:
    if path.is_dir():
        path.rmdir()
    path.unlink(missing_ok=True)
    if whole.exists():
        shutil.copyfile(whole, path)


if __name__ == "__main__":
    main()
