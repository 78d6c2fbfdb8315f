"""Results that are kept beside a user's data, where others may write: each is believed,
and deleted, only if this user's program wrote it.

The key is in the user's own state folder. The first line of a file is its code
(HMAC-SHA256), the second one the result, as JSON.
"""

import hmac
import json
import os
import secrets
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from platformdirs import user_state_path

from scleraforce.base.errors import InputError
from scleraforce.base.plain_json import parse_json
from scleraforce.base.private_folder import folder_fault, make_private, read_own
from scleraforce.base.whole_files import write_whole

ENDING = ".kept"
KEY_BYTES = 32
MOST_BYTES = 256 * 2**20  # of a result


def keep_result(result: Any, path: Path) -> None:
    """Write a result whole or not at all; one of that name is replaced."""
    text = json.dumps(result, allow_nan=False)
    write_whole(f"{_code(text)}\n{text}\n", path)


def kept_result(path: Path) -> Any:
    """Return a result; None if there is none, or none that this user's program
    wrote.
    """
    try:
        code, text, end = read_own(path, MOST_BYTES).decode().split("\n")
    except (OSError, ValueError):
        return None

    if end or not hmac.compare_digest(code.encode(), _code(text).encode()):
        return None
    return parse_json(text)


def check_folder(folder: Path) -> None:
    """Raise an `InputError` for a folder of results that is a link or no folder."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise InputError(f"{folder}: a link or no folder; remove it")


def _code(text: str) -> str:
    return hmac.new(_key(), text.encode(), sha256).hexdigest()


@cache
def _key() -> bytes:
    """Return the user's key, made on first need; one for this process alone, so that
    nothing is resumed, where no file of it would be safe.
    """
    folder = user_state_path("scleraforce") / "keys"
    path = folder / "results"
    with suppress(OSError):
        make_private(folder)
        if folder_fault(folder) is None:
            _make(path)
            key = read_own(path, KEY_BYTES)
            if len(key) == KEY_BYTES:
                return key

    return secrets.token_bytes(KEY_BYTES)


def _make(path: Path) -> None:
    """Write a new key whole, unless there is one."""
    if os.path.lexists(path):
        return

    part = path.with_name(f".{secrets.token_hex(8)}")
    part.touch(mode=0o600, exist_ok=False)
    try:
        part.write_bytes(secrets.token_bytes(KEY_BYTES))
        with suppress(FileExistsError):  # another process was first
            os.link(part, path)
    finally:
        part.unlink()
