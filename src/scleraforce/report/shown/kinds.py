"""Which kind of thing lies under a name, and what is to be said of it."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from scleraforce.errors import InputError
from scleraforce.models import RECORD_FILE, SHIPPED, STUDY_FILE, model_folder
from scleraforce.plain_json import parse_json
from scleraforce.units import HumanUnit, from_si
from scleraforce.whole_files import KINDS, read_bytes


@dataclass(frozen=True, kw_only=True)
class Thing:
    """A thing that was looked at.

    Attributes:
        kind: what it is, "recording".
        facts: what is said of it as JSON; the names carry human units.
        rows: the same for people, a name and a sentence each.
        lines: what stands below the rows as it is, a table for instance.
        draw: makes its picture.
    """

    kind: str
    facts: Mapping[str, Any]
    rows: tuple[tuple[str, str], ...]
    lines: tuple[str, ...] = ()
    draw: Callable[[], Figure]


def span(values: Iterable[float], unit: HumanUnit, printed: str) -> str:
    """Return the range of some values in words.

    >>> span([4e-4, 8e-4], "um", "µm")
    '400 to 800 µm'
    >>> span([4e-4], "um", "µm")
    '400 µm'
    """
    ends = sorted({f"{from_si(value, unit):.4g}": value for value in values}.items(), key=lambda end: end[1])
    words = ends[0][0] if len(ends) == 1 else f"{ends[0][0]} to {ends[-1][0]}"
    return f"{words} {printed}"


def value_words(value: float | None, unit: HumanUnit, printed: str) -> str:
    """Return a value in words, or that it is not stated.

    >>> value_words(None, "mmhg", "mmHg")
    'not stated'
    """
    return "not stated" if value is None else f"{from_si(value, unit):.4g} {printed}"


# Kind -> the module and its function; each is imported when it is asked for, with the room that it speaks of.
SHOWS = {
    "study": "show_study",
    "library": "show_library",
    "dataset": "show_dataset",
    "model": "show_model",
    "recording": "show_recording",
    "calibration": "show_calibration",
    "black_box": "show_black_box",
}
KNOWN = (
    f"give a study, library, data set, model (one that ships: {', '.join(SHIPPED)}), recording, calibration or "
    "decision log"
)
LOG_FILES = "decisions-*.jsonl"
STORE_FILE = "zarr.json"
PARTS = {"recording.toml": "recording", RECORD_FILE: "model", STORE_FILE: "store"}  # whose folder is the thing


def thing_at(path: Path, model: Path | None = None) -> Thing:
    """Look at whatever lies under a name, or at the shipped model of that name.

    Args:
        path: the name.
        model: whose limits are held against a recording; None: the reader that ships.

    Raises:
        InputError: nothing is there, it is of no known kind, or it cannot be read; or a model for another thing.
    """
    found = model_folder(path)
    kind = _kind_of(found)
    if model is not None and kind != "recording":
        raise InputError(f"--model: {path} is a {kind.replace('_', ' ')}; a model reads recordings")
    show: Callable[..., Thing] = getattr(import_module(f"scleraforce.report.shown.{kind}"), SHOWS[kind])
    if model is not None:
        return show(found, model)
    return show(found / STUDY_FILE if kind == "study" and found.is_dir() else found)


def _kind_of(path: Path) -> str:
    """Return the kind of what lies under a name, a key of `SHOWS`; only names and a store's metadata are looked at.

    Raises:
        InputError: nothing is there, or it is of no known kind.
    """
    found = _kind_of_folder(path) if path.is_dir() else _kind_of_file(path)
    if found is None:
        raise InputError(f"{path}: {'' if path.exists() else 'no such file or folder; '}{KNOWN}")
    return found


def _kind_of_folder(path: Path) -> str | None:
    if (path / "recording.toml").exists():
        return "recording"
    if (path / RECORD_FILE).exists():
        return "model"
    if (path / STORE_FILE).exists():
        return _kind_of_store(path / STORE_FILE)
    if any(next(folder.glob(LOG_FILES), None) for folder in (path, path / "log")):
        return "black_box"
    return "study" if (path / STUDY_FILE).exists() else None


def _kind_of_file(path: Path) -> str | None:
    if path.name in PARTS and path.is_file():
        raise InputError(f"{path}: a part of a {PARTS[path.name]}; give its folder, {path.parent}")
    endings = {".toml": "study", ".json": "calibration", ".jsonl": "black_box", ".npz": "library"}
    return endings.get(path.suffix.lower()) if path.is_file() else None


def _kind_of_store(file: Path) -> str:
    """Return which store it is, by its schema; what that should be is checked when the store is opened."""
    try:
        content = parse_json(read_bytes(file, KINDS["store metadata"]))
    except ValueError as fault:
        raise InputError(f"{file}: {fault}") from fault
    attributes = content.get("attributes") if isinstance(content, dict) else None
    schema = attributes.get("schema") if isinstance(attributes, dict) else None
    return "dataset" if str(schema).startswith("scleraforce-dataset") else "library"
