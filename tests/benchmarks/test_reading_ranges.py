"""README's box has the ranges of the bundled reader; a page without the box's marks is refused."""

import pytest

from reading_ranges import README, box, boxed


def test_the_box_has_the_ranges_of_the_bundled_reader() -> None:
    text = README.read_text(encoding="utf-8")
    assert box() in text, "run `make ranges`"
    assert boxed(text) == text


def test_a_page_without_the_marks_is_refused() -> None:
    with pytest.raises(ValueError, match="the marks"):
        boxed("# a page\n")
