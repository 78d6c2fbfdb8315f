"""The folders that a monitor writes, tried before it serves: what cannot be kept is to be known at the start."""

import os
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from scleraforce.errors import InputError
from scleraforce.service.black_box.decision_log import DecisionLog

__all__ = ["try_folders"]


def try_folders(black_box: Path, record: Path | None) -> None:
    """Make the folder of the black box, and try whether both can be written; the recording's is made later.

    Args:
        black_box: may exist.
        record: must not exist; None: there is none.

    Raises:
        InputError: a folder cannot be written, is used by another monitor, or is there although it must not.
    """
    if record is not None:
        _try_record(record.absolute(), black_box.absolute())
    try:
        DecisionLog(black_box / "log").close()
        withdrawals = black_box / "withdrawals"
        _try_write(withdrawals if withdrawals.exists() else black_box)
    except OSError as fault:
        raise InputError(f"--black-box {black_box}: {fault.strerror}; give another folder") from fault


def _try_record(record: Path, black_box: Path) -> None:
    try:
        if os.path.lexists(record):
            raise InputError(f"--record {record}: exists already; remove it or choose another name")
        if record == black_box or record in black_box.parents:
            raise InputError(f"--record {record}: the black box is to be there; choose another name")
        with suppress(FileNotFoundError):
            os.stat(record)  # a name may be too long
        _try_write(next(folder for folder in record.parents if os.path.lexists(folder)))
    except OSError as fault:
        raise InputError(f"--record {record}: {fault.strerror}; give another folder") from fault


def _try_write(folder: Path) -> None:
    """Write a file that has no name, and is gone when it is closed."""
    with TemporaryFile(dir=folder):
        pass
