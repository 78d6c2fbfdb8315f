"""The model folder: network, study, card, a reader's library, and `model.json` with
their SHA-256; the bundled ones.

Reading refuses a file that does not match `model.json`, so that a network never runs
beside another one's study.
"""

import hashlib
import json
import os
import reprlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from os import PathLike
from pathlib import Path
from tempfile import mkdtemp
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from scleraforce.base.errors import ModelError, StudyError
from scleraforce.base.onnx_network import network_session
from scleraforce.base.plain_json import parse_json
from scleraforce.base.whole_files import KINDS, read_bytes, write_whole_folder
from scleraforce.records.study import Study, parse_study

if TYPE_CHECKING:
    from onnxruntime import InferenceSession  # type: ignore[import-untyped]  # it ships no types


FOLDER = Path(__file__).parents[1] / "shipped"
SHIPPED_READER = FOLDER / "default"
SHIPPED_LIVING = FOLDER / "living"
SHIPPED_PAPER = FOLDER / "paper"
SHIPPED_WALL_FINDER = FOLDER / "wall_finder"
SHIPPED = {
    "default": SHIPPED_READER,
    "living": SHIPPED_LIVING,
    "paper": SHIPPED_PAPER,
    "wall-finder": SHIPPED_WALL_FINDER,
}


def path_or_bundled(given: str | PathLike[str]) -> Path:
    """Return the folder of a bundled model for its name, whatever the current folder
    holds; a path for anything else.

    A path that would read like the name of a bundled model becomes absolute.

    >>> path_or_bundled("default") == SHIPPED_READER
    True
    >>> path_or_bundled("./default") == Path("default").absolute()
    True
    """
    text = os.fspath(given)
    path = Path(text)
    if text in SHIPPED:
        return SHIPPED[text]
    return path.absolute() if str(path) in SHIPPED else path


def model_folder(given: str | PathLike[str]) -> Path:
    """Return the folder of MODEL: that of the bundled model of this name, else a path.

    Text without a separator is a name; a `Path` is a path unless it is the name of a
    bundled model. Raises `ModelError` for a name that no bundled model has.

    >>> model_folder("default") == SHIPPED_READER
    True
    >>> model_folder("./mine"), model_folder(Path("mine"))
    (PosixPath('mine'), PosixPath('mine'))
    """
    is_name = isinstance(given, str) and not (
        given in (os.curdir, os.pardir)
        or any(separator in given for separator in (os.sep, os.altsep) if separator)
    )
    if is_name and given not in SHIPPED:
        bundled = ", ".join(SHIPPED)
        raise ModelError(
            f"{given}: not a bundled model ({bundled}); a folder of your own is a path:"
            f" {os.path.join(os.curdir, given)}"
        )

    return path_or_bundled(given)


def model_name(folder: Path) -> str:
    """Return MODEL for a folder: the name of a bundled model, wherever it is installed,
    or a path.

    >>> model_name(SHIPPED_READER), model_name(Path("mine"))
    ('default', './mine')
    """
    path = str(folder)
    return next(
        (name for name, shipped in SHIPPED.items() if shipped == folder),
        os.path.join(os.curdir, path) if len(folder.parts) == 1 else path,
    )


MODEL_FORMAT = 1
NETWORK_FILE = "model.onnx"
STUDY_FILE = "study.toml"
CARD_FILE = "card.md"
RECORD_FILE = "model.json"
LIBRARY_FILE = "library.npz"
COMMON_FILES = (NETWORK_FILE, STUDY_FILE, CARD_FILE)
WALL_FINDER = "wall-finder"
# Of each kind, beside model.json.
FILES: dict[str, tuple[str, ...]] = dict.fromkeys(
    ("classifier", "reader", "raw-reader", WALL_FINDER), COMMON_FILES
)
FILES["reader"] = (*COMMON_FILES, LIBRARY_FILE)


Files = Mapping[str, bytes]  # contents by name


@dataclass(frozen=True)
class ModelFolder:
    """The checked content of a model folder: the bytes of its files by name, and
    `model.json`.
    """

    path: Path
    files: Files
    record: Mapping[str, Any]


@dataclass(frozen=True)
class Origin:
    """The folder of a loaded model (its name, if it is bundled), and the SHA-256 of its
    record, which has those of its files. Pickles of models hold no more.
    """

    place: str
    is_bundled: bool
    record_sha256: str
    threads: int


def origin_of(folder: ModelFolder, threads: int) -> Origin:
    """Return the origin of a model that is loaded from a folder."""
    name = model_name(folder.path)
    bundled = SHIPPED.get(name) == folder.path
    place = name if bundled else str(folder.path.absolute())
    return Origin(place, bundled, _record_sha256(folder.record), threads)


def origin_folder(origin: Origin) -> Path:
    """Return the folder of an origin, after a check that its record is the same; raises
    `ModelError`.
    """
    path = SHIPPED[origin.place] if origin.is_bundled else Path(origin.place)
    if not path.is_dir():
        raise ModelError(
            f"{path}: no such folder, and a pickled model needs its own: keep it where"
            " it was, or call load_model where it is used"
        )
    if _record_sha256(_read_record(path / RECORD_FILE)) != origin.record_sha256:
        raise ModelError(
            f"{path / RECORD_FILE}: not the model that was pickled; pickle the one that"
            " is in the folder now"
        )

    return path


def _record_sha256(record: Mapping[str, Any]) -> str:
    return sha256(json.dumps(dict(record), sort_keys=True).encode())


def sha256(content: bytes) -> str:
    """Return the SHA-256 of bytes, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def read_folder(
    path: str | PathLike[str], kinds: tuple[str, ...] = tuple(FILES)
) -> ModelFolder:
    """Read a model folder of some kinds, or the shipped one of that name, and check its
    files; raises `ModelError`.
    """
    path = model_folder(path)
    if not path.is_dir():
        bundled = ", ".join(SHIPPED)
        makes = "`scleraforce train DATASET out=MODEL` makes a folder"
        raise ModelError(
            f"{path}: no such folder; give one, or a bundled model ({bundled}); {makes}"
        )

    record = _read_record(path / RECORD_FILE)
    if record["kind"] not in kinds:
        raise ModelError(
            f"{path}: kind: found {record['kind']!r}, a {' or '.join(kinds)} is needed"
            " here"
        )

    places = {name: path / name for name in FILES[record["kind"]]}
    hashes = record["files"]

    if path == SHIPPED_LIVING:
        # the libraries of both bundled readers are large, and equal but for rounding
        places[LIBRARY_FILE] = SHIPPED_READER / LIBRARY_FILE
        hashes = {
            **hashes,
            LIBRARY_FILE: (
                _read_record(SHIPPED_READER / RECORD_FILE)["files"].get(LIBRARY_FILE)
            ),
        }

    files = {
        name: read_bytes(place, KINDS["model file"]) for name, place in places.items()
    }
    for name, content in files.items():
        expected = hashes.get(name)
        found = sha256(content)
        if expected != found:
            wrong = (
                f"SHA-256 {found[:12]}… is not the {str(expected)[:12]}… of"
                f" {path / RECORD_FILE}"
            )
            raise ModelError(
                f"{places[name]}: {wrong}; the file was changed after training: train"
                " the model again"
            )

    return ModelFolder(path, MappingProxyType(files), MappingProxyType(record))


def _read_record(path: Path) -> dict[str, Any]:
    try:
        record = parse_json(read_bytes(path, KINDS["model record"]))
    except ValueError as fault:
        raise ModelError(f"{path}: {fault}") from fault

    if not isinstance(record, dict) or record.get("format") != MODEL_FORMAT:
        found = reprlib.repr(record.get("format") if isinstance(record, dict) else None)
        raise ModelError(
            f"{path}: format: found {found}, this version reads {MODEL_FORMAT}; train"
            " the model again"
        )
    if record.get("kind") not in list(FILES):
        found = reprlib.repr(record.get("kind"))
        raise ModelError(
            f"{path}: kind: found {found}, this version reads {', '.join(FILES)}"
        )
    if not isinstance(record.get("files"), dict):
        raise ModelError(f"{path}: files: expected the SHA-256 of each file by name")

    return record


def check_place(out: Path) -> None:
    """Check, before any work is done, that a model folder can be made; raises
    `ModelError`.
    """
    if out.exists() or out.is_symlink():
        raise ModelError(f"{out}: exists already; remove it or choose another folder")

    above = next(folder for folder in out.absolute().parents if folder.exists())
    try:
        Path(
            mkdtemp(prefix=".scleraforce-", dir=above)
        ).rmdir()  # permissions alone do not tell, for some file systems
    except OSError as fault:
        raise ModelError(
            f"{out}: cannot be made: {above}: {fault.strerror}; choose another folder"
        ) from fault


def write_folder(
    out: Path,
    network: bytes,
    study_toml: str,
    card: str,
    record: Mapping[str, Any],
    more: Files = MappingProxyType({}),
) -> None:
    """Write a model folder whole or not at all; raises `ModelError`, or `InputError` if
    the disk refuses it.
    """
    check_place(out)
    files = {
        NETWORK_FILE: network,
        STUDY_FILE: study_toml.encode(),
        CARD_FILE: card.encode(),
        **more,
    }
    hashes = {name: sha256(content) for name, content in files.items()}
    record_json = json.dumps(
        {"format": MODEL_FORMAT, **record, "files": hashes}, indent=2, allow_nan=False
    )
    write_whole_folder({**files, RECORD_FILE: (record_json + "\n").encode()}, out)


def folder_study(folder: ModelFolder) -> Study:
    """Return the study of a model folder; raises `ModelError`."""
    place = str(folder.path / STUDY_FILE)
    try:
        text = folder.files[STUDY_FILE].decode()
        with suppress(StudyError):
            return _study_of(text)
        return parse_study(text, place)  # raises, and names the file
    except (StudyError, UnicodeDecodeError) as fault:
        raise ModelError(str(fault)) from fault


@lru_cache(maxsize=4)
def _study_of(text: str) -> Study:
    """Return the study of a text; a reader and its wall finder often have the same one,
    and 15 ms are saved.
    """
    return parse_study(text)


def folder_session(
    folder: ModelFolder, threads: int
) -> tuple["InferenceSession", dict[str, str]]:
    """Return a session of a folder's network and the network's metadata; raises
    `ModelError`.
    """
    place = str(folder.path / NETWORK_FILE)
    session = network_session(folder.files[NETWORK_FILE], place, threads)

    try:
        metadata: dict[str, str] = session.get_modelmeta().custom_metadata_map
    except ValueError as fault:  # names that are not text
        raise ModelError(f"{place}: metadata: {fault}") from fault

    return session, metadata


def check_provenance(folder: ModelFolder, metadata: Mapping[str, str]) -> None:
    """Check that the network was made with the study beside it; raises `ModelError`."""
    stated = metadata.get("study_sha256")
    if stated != sha256(folder.files[STUDY_FILE]):
        place = folder.path / NETWORK_FILE
        raise ModelError(
            f"{place}: study_sha256: {stated} is not the study in {STUDY_FILE}; train"
            " the model again"
        )
