"""The limit on open files: raised where that is allowed, and refused in one line where it is not."""

import resource

import pytest

from scleraforce.errors import InputError
from scleraforce.service.startup import allow_files


@pytest.fixture
def limits(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """The limits of a process; the last ones count."""
    found = [(256, 1024)]
    monkeypatch.setattr(resource, "getrlimit", lambda _: found[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, both: found.append(both))
    return found


def test_a_low_limit_is_raised_and_a_high_one_is_left_alone(limits: list[tuple[int, int]]) -> None:
    allow_files(200)
    assert limits == [(256, 1024)]
    allow_files(384)
    assert limits[-1] == (384, 1024)


def test_a_hard_limit_below_the_need_is_refused_with_both_numbers(limits: list[tuple[int, int]]) -> None:
    with pytest.raises(InputError, match=r"at most 1024 .* needs 1025"):
        allow_files(1025)
    assert limits == [(256, 1024)]
