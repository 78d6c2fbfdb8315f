"""Resets: the token, and clients that do not know it."""

from contextlib import ExitStack

import pytest
from small_monitor import TOKEN, Peer, reset, serving

from scleraforce.live.network.openigtlink import Text, encode
from scleraforce.live.network.operator_reset import (
    LOCKED,
    ResetCode,
    ResetToken,
    token_digest,
)

ANSWERED = 10  # wrong tokens or codes, within ten seconds; five codes lock all
WITHIN_S = 10.0
LOCKED_S = 60.0


def answers(peer: Peer) -> int:
    return sum(device == "ForceReset" for device, _ in peer.heard)


def say_at_once(peer: Peer, tokens: list[str]) -> None:
    peer.link.sendall(
        b"".join(encode(Text(token), "ForceReset", time_s=2e9) for token in tokens)
    )


def test_after_three_wrong_tokens_the_right_one_in_the_same_bytes_is_not_obeyed():
    with serving() as port, Peer(port) as scanner, Peer(port) as guesser:
        scanner.withdraw()
        say_at_once(guesser, ["wrong"] * 3 + [TOKEN])
        guesser.hear()
        assert answers(guesser) == 3
        assert guesser.closed
        scanner.heard.clear()
        scanner.read(10.0)
        assert {status.code for status in scanner.statuses()} == {3}


@pytest.mark.slow
def test_wrong_tokens_of_many_are_counted_together_and_the_right_one_is_granted_all_the_same():
    with serving() as port, ExitStack() as stack, Peer(port) as scanner:
        guessers = [stack.enter_context(Peer(port)) for _ in range(ANSWERED)]
        for guesser in guessers:
            say_at_once(guesser, ["wrong"] * 2)

        for guesser in guessers:
            # or the end of its connection
            guesser.hear(lambda peer: answers(peer) == 2)

        assert sum(answers(guesser) for guesser in guessers) == ANSWERED
        scanner.withdraw()
        assert reset(port)[0] is True


def test_the_answers_to_wrong_tokens_are_limited_and_the_right_one_is_known_meanwhile():
    token = ResetToken(token_digest("right"))
    answered = [token.answers_wrong(0.01 * number) for number in range(10 * ANSWERED)]
    assert answered == [True] * ANSWERED + [False] * 9 * ANSWERED
    assert token.knows("right")
    assert not token.knows("wrong")
    assert not token.knows("\ud800")
    assert token.answers_wrong(WITHIN_S)


def test_five_wrong_codes_lock_the_right_one_for_a_minute_and_each_code_is_for_one_reset():
    code = ResetCode()
    wrong = f"{(int(code.digits) + 1) % 10**6:06d}"
    assert code.digits in code.line

    for _ in range(3):  # the right one forgives those before it
        assert not any(
            code.knows(guess, 0.0) for guess in [wrong] * 4 + ["", "12345", TOKEN]
        )
        assert code.knows(code.digits, 0.0)

    assert not any(code.knows(wrong, 1.0) for _ in range(5))
    assert code.locked(1.0 + 0.99 * LOCKED_S)
    assert not code.knows(code.digits, 1.0 + 0.99 * LOCKED_S)
    assert code.knows(code.digits, 1.0 + LOCKED_S)
    used = {code.digits}

    for _ in range(3):
        code.renew()
        used.add(code.digits)

    assert len(used) > 1


def test_codes_that_are_locked_are_called_locked_however_many_wrong_ones_came():
    """After ten wrong codes a right one got no answer."""
    with serving() as port, Peer(port) as scanner, ExitStack() as stack:
        scanner.withdraw()
        for _ in range(ANSWERED):
            guesser = stack.enter_context(Peer(port))
            say_at_once(guesser, ["000000"])
            guesser.hear(lambda peer: answers(peer) == 1)

        for _ in range(3):
            assert reset(port, "111111") == (False, LOCKED)
        assert reset(port)[0] is True
