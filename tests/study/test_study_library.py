"""The stiffenings of the `[library]` section: none or enough for splines, over a range."""

import pytest

from scleraforce.errors import StudyError
from scleraforce.study import LibraryStudy, Range, fixed


def test_fewer_stiffenings_than_a_spline_needs_are_refused() -> None:
    for count in [2, 3]:
        with pytest.raises(StudyError, match=rf"^stiffenings: {count}; give 1, or at least 4$"):
            LibraryStudy(stiffenings=count)


def test_several_stiffenings_need_a_range() -> None:
    with pytest.raises(StudyError, match=r"^stiffening: a range has to be given.*stiffenings = 1$"):
        LibraryStudy(stiffening=fixed(5.0))
    assert LibraryStudy(stiffening=fixed(5.0), stiffenings=1).stiffening_ends == (5.0, 5.0)


def test_one_stiffening_is_the_lower_end() -> None:
    held = Range(min=2.0, max=20.0)
    assert LibraryStudy(stiffening=held).stiffening_ends == (2.0, 20.0)
    assert LibraryStudy(stiffening=held, stiffenings=1).stiffening_ends == (2.0, 2.0)
