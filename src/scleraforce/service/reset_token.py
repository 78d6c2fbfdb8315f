"""The token of the operator's reset: how it is checked, and how many wrong ones are answered."""

import hmac
from collections import deque
from hashlib import sha256
from secrets import token_hex

TOKEN_BYTES = 16
ANSWERED, WITHIN_S = 10, 10.0  # wrong tokens, of all clients together


def new_token() -> str:
    """Return a token that cannot be guessed: 128 bits as 32 hexadecimal digits."""
    return token_hex(TOKEN_BYTES)


def token_digest(token: str) -> str:
    """Return the SHA-256 of a token, in hexadecimal digits: enough to check a token, not to make one."""
    return sha256(token.encode(errors="surrogatepass")).hexdigest()


class ResetToken:
    """Checks a token against the digest of the right one, and counts wrong ones.

    The right token is always accepted, however many wrong ones came: it is too long to be guessed, and a limit on
    guesses must not lock the operator out.

    >>> token = ResetToken(token_digest("right"))
    >>> token.knows("right"), token.knows("wrong")
    (True, False)
    """

    def __init__(self, digest: str) -> None:
        self._digest = digest
        self._answered_s = deque[float](maxlen=ANSWERED)

    def knows(self, token: str) -> bool:
        """Return whether a token is the right one, in a time that does not depend on how much of it is right."""
        return hmac.compare_digest(token_digest(token), self._digest)

    def answers_wrong(self, now_s: float) -> bool:
        """Count a wrong token; return whether to answer it: at most `ANSWERED` within `WITHIN_S` are."""
        if len(self._answered_s) == ANSWERED and now_s - self._answered_s[0] < WITHIN_S:
            return False
        self._answered_s.append(now_s)
        return True
