"""Sockets that listen where the user says, or one line that says why they cannot."""

import socket
from errno import EADDRNOTAVAIL

from scleraforce.errors import InputError

__all__ = ["listen"]


def listen(host: str, port: int, prefix: str = "", backlog: int = 256) -> socket.socket:
    """Return a socket that listens; port 0 takes a free one.

    Args:
        host: an address of this machine, or a name of one.
        port: of it.
        prefix: of the options that say so: "web-" for `--web-host` and `--web-port`.
        backlog: how many may wait to be taken in.

    Raises:
        InputError: nobody can listen there.
    """
    if not host.strip():
        raise InputError(f"--{prefix}host: empty; 127.0.0.1 serves this machine alone, 0.0.0.0 every network of it")
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
