"""README's box of ranges is of the reader that ships; a page without the place of the box is refused."""

import pytest

from reading_ranges import README, box, boxed


def test_the_box_is_of_the_reader_that_ships() -> None:
    text = README.read_text(encoding="utf-8")
    assert box() in text, "run `make ranges`"
    assert boxed(text) == text


def test_a_page_without_the_marks_is_refused() -> None:
    with pytest.raises(ValueError, match="the marks"):
        boxed("# a page\n")
