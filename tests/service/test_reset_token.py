"""The token cannot be guessed; wrong ones are answered up to a bound, the right one is known always."""

from scleraforce.service.reset_token import ANSWERED, WITHIN_S, ResetToken, new_token, token_digest


def test_a_token_has_128_bits_and_is_never_the_same() -> None:
    tokens = {new_token() for _ in range(100)}
    assert len(tokens) == 100
    assert {len(bytes.fromhex(token)) for token in tokens} == {16}


def test_so_many_wrong_tokens_are_answered_in_so_many_seconds_and_the_right_one_is_known_meanwhile() -> None:
    token = ResetToken(token_digest("right"))
    answered = [token.answers_wrong(0.01 * number) for number in range(10 * ANSWERED)]
    assert answered == [True] * ANSWERED + [False] * 9 * ANSWERED
    assert token.knows("right")
    assert not token.knows("wrong")
    assert not token.knows("\ud800")
    assert token.answers_wrong(WITHIN_S)
