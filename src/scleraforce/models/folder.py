"""The model folder: `model.onnx`, `study.toml`, `card.md`, and `model.json` with their SHA-256.

A model of kind "reader" has the response library beside them, `library.npz`.

Reading checks every file against `model.json` and refuses what does not match, so that a network is never run beside a
study that it was not trained with.
"""

import hashlib
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from scleraforce.errors import ModelError
from scleraforce.models.shipped import SHIPPED, model_folder
from scleraforce.plain_json import parse_json
from scleraforce.whole_files import KINDS, read_bytes

MODEL_FORMAT = 1
NETWORK_FILE, STUDY_FILE, CARD_FILE, RECORD_FILE = "model.onnx", "study.toml", "card.md", "model.json"
LIBRARY_FILE = "library.npz"
COMMON_FILES = (NETWORK_FILE, STUDY_FILE, CARD_FILE)
WALL_FINDER = "wall-finder"
# Of each kind, beside model.json.
FILES = {
    "classifier": COMMON_FILES,
    "reader": (*COMMON_FILES, LIBRARY_FILE),
    "raw-reader": COMMON_FILES,
    WALL_FINDER: COMMON_FILES,
}


@dataclass(frozen=True)
class ModelFolder:
    """The checked content of a model folder: the bytes of its files by name, and `model.json`."""

    path: Path
    files: Mapping[str, bytes]
    record: Mapping[str, Any]


def sha256(content: bytes) -> str:
    """Return the SHA-256 of bytes, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def read_folder(path: Path) -> ModelFolder:
    """Read a model folder, or the shipped one of that name, and check the hashes of its files.

    Raises:
        ModelError: a file is missing or does not match `model.json`, or `model.json` cannot be used.
    """
    path = model_folder(path)
    if not path.is_dir():
        raise ModelError(
            f"{path}: no such folder, and no model that ships with scleraforce ({', '.join(SHIPPED)}); "
            "`scleraforce train DATASET --out MODEL` makes a folder"
        )
    record = _read_record(path / RECORD_FILE)
    files = {name: read_bytes(path / name, KINDS["model file"]) for name in FILES[record["kind"]]}
    for name, content in files.items():
        _check_hash(path, name, content, record["files"])
    return ModelFolder(path, MappingProxyType(files), MappingProxyType(record))


def _read_record(path: Path) -> dict[str, Any]:
    try:
        record = parse_json(read_bytes(path, KINDS["model record"]))
    except ValueError as fault:
        raise ModelError(f"{path}: {fault}") from fault
    if not isinstance(record, dict) or record.get("format") != MODEL_FORMAT:
        found = reprlib.repr(record.get("format") if isinstance(record, dict) else None)
        raise ModelError(f"{path}: format: found {found}, this version reads {MODEL_FORMAT}; train the model again")
    if record.get("kind") not in list(FILES):
        found = reprlib.repr(record.get("kind"))
        raise ModelError(f"{path}: kind: found {found}, this version reads {', '.join(FILES)}")
    if not isinstance(record.get("files"), dict):
        raise ModelError(f"{path}: files: expected the SHA-256 of each file by name")
    return record


def _check_hash(path: Path, name: str, content: bytes, hashes: Mapping[str, Any]) -> None:
    expected, found = hashes.get(name), sha256(content)
    if expected != found:
        raise ModelError(
            f"{path / name}: SHA-256 {found[:12]}… is not the {str(expected)[:12]}… of {path / RECORD_FILE}; the file "
            "was changed after training: train the model again"
        )
