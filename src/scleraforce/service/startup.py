"""Checks before a monitor serves: its addresses, its folders, the number of open files."""

import os
import resource
import socket
from contextlib import suppress
from errno import EADDRNOTAVAIL
from pathlib import Path
from tempfile import TemporaryFile

from scleraforce.errors import InputError
from scleraforce.service.black_box.decision_log import DecisionLog


def listen(host: str, port: int, prefix: str = "", backlog: int = 256) -> socket.socket:
    """Return a socket that listens; port 0 takes a free one.

    Args:
        host: an address of this machine, or its name.
        port: the TCP port.
        prefix: of the options, for messages: "web-" for `--web-host` and `--web-port`.
        backlog: how many connections may wait to be accepted.

    Raises:
        InputError: the address cannot be listened on.
    """
    if not host.strip():
        raise InputError(f"--{prefix}host: empty; use 127.0.0.1 for this machine alone, 0.0.0.0 for all its networks")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        (*_, address), *_ = socket.getaddrinfo(host, port, family, socket.SOCK_STREAM)
        return socket.create_server(address[:2], family=family, backlog=backlog)
    except (socket.gaierror, UnicodeError) as fault:  # a name of more than 63 letters is no Unicode for Python
        reason = getattr(fault, "strerror", None) or str(fault)
    except OSError as fault:
        reason = str(fault.strerror).partition(" (while")[0]
        if fault.errno != EADDRNOTAVAIL:
            raise InputError(
                f"{host}:{port}: {reason}; give another --{prefix}port, or end what listens there"
            ) from fault
    raise InputError(f"--{prefix}host {host!r}: {reason}; give an address of this machine")


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


def allow_files(needed: int) -> None:
    """Allow this process, and those that it starts, to open so many files and sockets.

    Args:
        needed: how many; the soft limit is raised to it, never lowered.

    Raises:
        InputError: the hard limit is lower.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY or soft >= needed:
        return
    if hard != resource.RLIM_INFINITY and hard < needed:
        raise InputError(
            f"open files: at most {hard} are allowed (ulimit -Hn), the monitor needs {needed} so that neither the "
            "scanner nor the operator is locked out; raise the limit `nofile` in /etc/security/limits.conf"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))
