"""Sockets that listen at the user's address, or one line that says why they cannot."""

import socket
from errno import EADDRNOTAVAIL

from scleraforce.errors import InputError


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
