"""The folders that a monitor writes to, tested before it serves: a fault is reported at the start."""

import os
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

from scleraforce.errors import InputError
from scleraforce.service.black_box.decision_log import DecisionLog


def try_folders(black_box: Path, record: Path | None) -> None:
    """Make the folder of the black box, and test whether both folders can be written; the recording's is made later.

    Args:
        black_box: folder of the black box; may exist.
        record: folder of the recording, which must not exist; None for no recording.

    Raises:
        InputError: a folder cannot be written or is in use by another monitor, or `record` exists.
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
            raise InputError(f"--record {record}: the folder of the black box is there; choose another name")
        with suppress(FileNotFoundError):
            os.stat(record)  # a name may be too long
        _try_write(next(folder for folder in record.parents if os.path.lexists(folder)))
    except OSError as fault:
        raise InputError(f"--record {record}: {fault.strerror}; give another folder") from fault


def _try_write(folder: Path) -> None:
    """Write a file without a name, which is gone when it is closed."""
    with TemporaryFile(dir=folder):
        pass
