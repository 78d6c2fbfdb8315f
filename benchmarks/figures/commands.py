"""The commands that anyone would type, run in order: what a finished one has left is taken up."""

import json
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scleraforce.errors import ScleraforceError
from scleraforce.whole_files import write_whole

__all__ = ["answers", "made_by"]


class CommandError(ScleraforceError):
    """A command of this project failed; the message is its own."""


def made_by(out: Path, command: Sequence[str | Path]) -> Path:
    """Run a command that writes `out`, where that is not there yet; what it left unfinished is removed first.

    Args:
        out: the file or folder.
        command: name and arguments of a command; `--out OUT` is appended.

    Raises:
        CommandError: it failed.
    """
    if not out.exists():
        part = out.with_name(f".{out.name}.partial")
        _remove(part)
        out.parent.mkdir(parents=True, exist_ok=True)
        _run([*command, "--out", part])
        part.rename(out)
    return out


def answers(out: Path, command: Sequence[str | Path]) -> dict[str, Any]:
    """Return what a command prints with `--json`, kept in `out`.

    Raises:
        CommandError: it failed.
    """
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        write_whole(_run([*command, "--json"]), out)
    found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return found


def _run(command: Sequence[str | Path]) -> str:
    """Return the standard output of `scleraforce COMMAND`; its progress bar goes where ours go."""
    words = [str(word) for word in command]
    done = subprocess.run(
        [Path(sys.executable).with_name("scleraforce"), *words], stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode != 0:
        raise CommandError(f"scleraforce {' '.join(words[:1])}: exit code {done.returncode}; its message stands above")
    return done.stdout


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
