"""Results of an earlier run: one is reused while its key is the same.

The key of a result is a hash of its inputs, stored in a hidden file beside the result.
A result with another key, or none, is made again. If the code's behaviour has changed
since the folder was begun, all keys are removed.
"""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

from provenance.fingerprint import Fingerprint, moved
from scleraforce.base.whole_files import write_whole


def take_up(folder: Path, now: Fingerprint) -> None:
    """Store the behaviour that a folder's results are made with; remove the keys if it
    has changed.
    """
    note = folder / "behaviour.json"
    if not note.exists() or moved(json.loads(note.read_text(encoding="utf-8")), now):
        for key in folder.rglob(".*.key"):
            key.unlink()
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(json.dumps(now, indent=1) + "\n", note)


def is_made(out: Path, key: str) -> bool:
    """Return whether a result is there, made under this key."""
    note = _note(out)
    return out.exists() and note.exists() and note.read_text(encoding="utf-8") == key


def note_stale(out: Path) -> None:
    """Report that an existing result is made again."""
    if out.exists():
        print(
            f"{out}: made by other code or from other inputs; made again",
            file=sys.stderr,
        )


def write_key(out: Path, key: str) -> None:
    """Note the key of a result."""
    write_whole(key, _note(out))


def made(out: Path, key: str, make: Callable[[Path], object]) -> Path:
    """Return a file or folder that `make` writes, unless it exists with the same key.

    A result with another key, or an unfinished one, is removed first.
    """
    if not is_made(out, key):
        part = out.with_name(f".{out.name}.partial")
        note_stale(out)
        remove(part)
        remove(out)
        out.parent.mkdir(parents=True, exist_ok=True)
        make(part)
        part.rename(out)
        write_key(out, key)

    return out


def remove(path: Path) -> None:
    """Remove a file or folder and its key."""
    _note(path).unlink(missing_ok=True)
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _note(out: Path) -> Path:
    return out.with_name(f".{out.name}.key")
