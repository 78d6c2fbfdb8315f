"""Write a model folder: all of it or nothing."""

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from tempfile import mkdtemp
from types import MappingProxyType
from typing import Any

from scleraforce.errors import ModelError
from scleraforce.models.folder import CARD_FILE, MODEL_FORMAT, NETWORK_FILE, RECORD_FILE, STUDY_FILE, sha256


def check_place(out: Path) -> None:
    """Check, before any work is done, that a model folder can be made.

    Raises:
        ModelError: `out` exists, or the folder that it is to stand in cannot be written to.
    """
    if out.exists() or out.is_symlink():
        raise ModelError(f"{out}: exists already; remove it or choose another folder")
    above = next(folder for folder in out.absolute().parents if folder.exists())
    try:
        Path(mkdtemp(prefix=".scleraforce-", dir=above)).rmdir()  # permissions alone do not tell, for some file systems
    except OSError as fault:
        raise ModelError(f"{out}: cannot be made: {above}: {fault.strerror}; choose another folder") from fault


def write_folder(
    out: Path,
    network: bytes,
    study_toml: str,
    card: str,
    record: Mapping[str, Any],
    more: Mapping[str, bytes] = MappingProxyType({}),
) -> None:
    """Write a model folder under a temporary name beside `out`, then rename it.

    Args:
        out: the folder to make.
        network: the ONNX model.
        study_toml: the study, in canonical form.
        card: the model card.
        record: what `model.json` keeps besides format and hashes.
        more: further files by name.

    Raises:
        ModelError: `out` exists, or cannot be written.
    """
    check_place(out)
    files = {NETWORK_FILE: network, STUDY_FILE: study_toml.encode(), CARD_FILE: card.encode(), **more}
    hashes = {name: sha256(content) for name, content in files.items()}
    record_json = json.dumps({"format": MODEL_FORMAT, **record, "files": hashes}, indent=2, allow_nan=False)
    partial = out.with_name(f".{out.name}.partial-{os.getpid()}")
    try:
        partial.mkdir(parents=True)
        for name, content in {**files, RECORD_FILE: (record_json + "\n").encode()}.items():
            (partial / name).write_bytes(content)
        partial.rename(out)
    except OSError as fault:
        raise ModelError(f"{out}: {fault.strerror}") from fault
    finally:
        shutil.rmtree(partial, ignore_errors=True)
