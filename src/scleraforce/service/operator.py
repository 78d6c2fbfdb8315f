"""The operator's side of a reset: a STRING `ForceReset` with the token requests it, another STRING answers."""

import json
import socket
from time import monotonic, time

from scleraforce.errors import InputError, ProtocolError
from scleraforce.openigtlink import Decoder, Received, Text, encode
from scleraforce.service.stamp import RESET_DEVICE

ANSWER_S = 2.0
PIECE = 65536


def ask_reset(host: str, port: int, token: str, within_s: float = ANSWER_S) -> tuple[bool, str]:
    """Ask a monitor to end a withdrawal; return whether it did, and its message, which must come within `within_s`.

    Raises:
        InputError: no monitor answers at this address, or the token cannot be sent.
    """
    if not host.strip():
        raise InputError("--host: empty; say where the monitor listens, 127.0.0.1 for this machine")
    if not token.isprintable():  # which covers what is not valid text
        raise InputError("--token: has characters that no token has; copy the token that the monitor printed")
    try:
        with socket.create_connection((host, port), timeout=within_s) as link:
            link.sendall(encode(Text(token), RESET_DEVICE, time_s=time()))
            return _answer(link, monotonic() + within_s)
    except (OSError, UnicodeError, ProtocolError) as fault:
        reason = getattr(fault, "strerror", None) or str(fault)
        raise InputError(f"{host}:{port}: {reason}; is a monitor running there?") from fault


def _answer(link: socket.socket, end_s: float) -> tuple[bool, str]:
    """Wait for the answer among the STATUS messages that the monitor sends to all clients."""
    decoder = Decoder()
    while monotonic() < end_s:
        data = link.recv(PIECE)
        if not data:
            break
        for event in decoder.feed(data):
            if isinstance(event, Received) and event.header.device == RESET_DEVICE and isinstance(event.message, Text):
                answer = json.loads(event.message.text)
                return bool(answer["granted"]), str(answer["message"])
    raise OSError("no answer to the reset")
