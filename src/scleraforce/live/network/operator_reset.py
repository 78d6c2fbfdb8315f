"""The operator's reset: the token of programs, the code of operators, their checks, the
request from a terminal.

Over OpenIGTLink, a STRING `ForceReset` with the token requests a reset, and another
STRING answers.
"""

import hmac
import json
import os
import re
import secrets
import socket
import stat
from collections import deque
from hashlib import sha256
from math import inf
from pathlib import Path
from time import monotonic, time
from typing import BinaryIO

from scleraforce.base.errors import InputError, ProtocolError
from scleraforce.live.network.openigtlink import Decoder, Received, Text, encode

RESET_DEVICE = "ForceReset"
# wrong tokens, of all clients together
ANSWERED = 10
WITHIN_S = 10.0
CODE = re.compile(r"[0-9]{6}")
WRONG_CODES = 5
LOCKED_S = 60.0
ANSWER_S = 2.0
PIECE = 65536
MOST_SECRET = 200  # bytes
OTHERS = stat.S_IRWXG | stat.S_IRWXO
LOCKED = (
    f"{WRONG_CODES} wrong codes: none is accepted for {LOCKED_S:.0f} s; the token is"
)
TOO_MANY = (
    f"too many codes came: none is accepted within {WITHIN_S:.0f} s; the token is"
)


def token_digest(token: str) -> str:
    """Return the SHA-256 of a token, in hexadecimal digits: enough to check a token,
    not to make one.
    """
    return sha256(token.encode(errors="surrogatepass")).hexdigest()


class ResetToken:
    """Checks a token against the digest of the right one, and limits the answers to
    wrong ones.

    The right token is always accepted, however many wrong ones came: it is too long to
    be guessed, and a limit on guesses must not lock the operator out.
    """

    def __init__(self, digest: str) -> None:
        self._digest = digest
        self._answered_s = deque[float](maxlen=ANSWERED)

    def knows(self, token: str) -> bool:
        """Return whether a token is the right one, in a time that does not depend on
        how much of it is right.
        """
        return hmac.compare_digest(token_digest(token), self._digest)

    def answers_wrong(self, now_s: float) -> bool:
        """Count a wrong token; return whether to answer it: at most `ANSWERED` within
        `WITHIN_S` are.
        """
        if len(self._answered_s) == ANSWERED and now_s - self._answered_s[0] < WITHIN_S:
            return False
        self._answered_s.append(now_s)
        return True


class ResetCode:
    """The six digits that an operator types; `WRONG_CODES` wrong ones lock them for
    `LOCKED_S`.

    Five guesses a minute find it in 70 days, in the mean.
    """

    def __init__(self) -> None:
        self._wrong = 0
        self._locked_until_s = -inf
        self.renew()

    def renew(self) -> None:
        """Draw new digits: each code is for one reset."""
        self.digits = f"{secrets.randbelow(10**6):06d}"

    @property
    def line(self) -> str:
        """The line that gives it to the operator."""
        return f"code       {self.digits}, for the next reset by hand"

    def knows(self, code: str, now_s: float) -> bool:
        """Return whether a code is the right one and not locked; count a wrong one."""
        if self.locked(now_s) or not CODE.fullmatch(code):
            return False

        right = hmac.compare_digest(code, self.digits)
        self._wrong = 0 if right else self._wrong + 1
        if self._wrong == WRONG_CODES:
            self._wrong = 0
            self._locked_until_s = now_s + LOCKED_S

        return right

    def locked(self, now_s: float) -> bool:
        """Return whether no code is accepted now."""
        return now_s < self._locked_until_s


def secret_of_file(path: Path) -> str:
    """Return the token or code in a file; an InputError where others may read it.

    The descriptor is checked, not the name, which may point to another file by then.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    except (OSError, ValueError) as fault:
        reason = getattr(fault, "strerror", None) or str(fault)
        raise InputError(f"`token_file`: {str(path)!r}: {reason}") from fault

    with open(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise InputError(f"`token_file`: {path}: not a regular file")
        if found.st_uid != os.geteuid() or found.st_mode & OTHERS:
            raise InputError(
                f"`token_file`: {path}: mode {stat.S_IMODE(found.st_mode):o} of user"
                f" {found.st_uid}; it must be yours, and nobody else's to read:"
                " chmod 600"
            )

        return _secret_in(file.read(MOST_SECRET + 1), f"`token_file`: {path}")


def secret_of_stream(stream: BinaryIO) -> str:
    """Return the token or code in the first line of standard input."""
    return _secret_in(stream.readline(MOST_SECRET + 1), "standard input")


def _secret_in(data: bytes, place: str) -> str:
    text = data.decode("ascii", "replace").strip()
    if not text or len(data) > MOST_SECRET or not text.isprintable():
        raise InputError(
            f"{place}: expected one line with the token or the code that the monitor"
            " printed"
        )
    return text


def ask_reset(
    host: str, port: int, token: str, within_s: float = ANSWER_S
) -> tuple[bool, str]:
    """Ask a monitor to end a withdrawal; return whether it did, and its message, which
    must come within `within_s`.

    It raises InputError if no monitor answers at this address, or the token cannot be
    sent.
    """
    if not host.strip():
        raise InputError(
            "`host`: empty; give the address of the monitor, 127.0.0.1 for this machine"
        )
    if not token.isprintable():  # which covers what is not valid text
        raise InputError(
            "token: has characters that no token has; copy the token that the monitor"
            " printed"
        )

    try:
        with socket.create_connection((host, port), timeout=within_s) as link:
            link.sendall(encode(Text(token), RESET_DEVICE, time_s=time()))
            return _answer(link, monotonic() + within_s)
    except (OSError, UnicodeError, ProtocolError) as fault:
        reason = getattr(fault, "strerror", None) or str(fault)
        raise InputError(
            f"{host}:{port}: {reason}; is a monitor running there?"
        ) from fault


def _answer(link: socket.socket, end_s: float) -> tuple[bool, str]:
    """Wait for the answer among the STATUS messages that the monitor sends to all
    clients.
    """
    decoder = Decoder()
    while monotonic() < end_s and (data := link.recv(PIECE)):
        for event in decoder.feed(data):
            if (
                isinstance(event, Received)
                and event.header.device == RESET_DEVICE
                and isinstance(event.message, Text)
            ):
                answer = json.loads(event.message.text)
                return bool(answer["granted"]), str(answer["message"])

    raise OSError("no answer to the reset")
