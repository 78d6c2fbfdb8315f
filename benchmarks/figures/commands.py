"""The released commands, run in order; the result of a finished one is reused while its
key is the same.

The key of a result is a hash of its command's words and inputs, stored in a hidden file
beside the result. A result with another key, or none, is made again. If the code's
behaviour has changed since the folder was begun, all keys are removed.
"""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from provenance.fingerprint import Fingerprint, moved
from scleraforce.base.errors import ScleraforceError
from scleraforce.base.whole_files import write_whole


class CommandError(ScleraforceError):
    """A command of this project failed; the message is its own."""


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


def made_by(out: Path, command: Sequence[str | Path]) -> Path:
    """Return what a command writes, see `made`.

    Args:
        out: the file or folder.
        command: name and arguments of a command; `--out OUT` is appended.

    Raises:
        CommandError: it failed.
    """
    return made(
        out, _command_key(command), lambda part: _run([*command, "--out", part])
    )


def answers(out: Path, command: Sequence[str | Path]) -> dict[str, Any]:
    """Return what a command prints with `--json`, kept in `out`, see `made`.

    Raises:
        CommandError: it failed.
    """
    made(
        out,
        _command_key(command),
        lambda part: write_whole(_run([*command, "--json"]), part),
    )
    found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))

    return found


def content_key(path: Path) -> str:
    """Return the key of an input: the stored one, or else a hash of its content."""
    if _note(path).exists():
        return _note(path).read_text(encoding="utf-8")

    files = (
        sorted(file for file in path.rglob("*") if file.is_file())
        if path.is_dir()
        else [path]
    )
    digest = sha256()

    for file in filter(Path.is_file, files):
        digest.update(
            f"{file.relative_to(path)}\0".encode() + sha256(file.read_bytes()).digest()
        )

    return digest.hexdigest()


def remove(path: Path) -> None:
    """Remove a file or folder and its key."""
    _note(path).unlink(missing_ok=True)
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _command_key(command: Sequence[str | Path]) -> str:
    words = [
        f"{word.name} {content_key(word)}" if isinstance(word, Path) else word
        for word in command
    ]
    return sha256("\0".join(words).encode()).hexdigest()


def _note(out: Path) -> Path:
    return out.with_name(f".{out.name}.key")


def _run(command: Sequence[str | Path]) -> str:
    """Return the standard output of `scleraforce COMMAND`; its progress bar goes where
    ours go.
    """
    words = [str(word) for word in command]
    done = subprocess.run(
        [Path(sys.executable).with_name("scleraforce"), *words],
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise CommandError(
            f"scleraforce {' '.join(words[:1])}: exit code {done.returncode}; its"
            " message is above"
        )

    return done.stdout
