import tomllib

import pytest
from drawn_eyes import drawn_eyes

from scleraforce.scanner.measure import MeasuredScanner, measure_scanner, study_text
from scleraforce.study import PhantomStudy, parse_study


@pytest.fixture(scope="module")
def scanner() -> MeasuredScanner:
    return measure_scanner(drawn_eyes(range(7600, 7602), choroid_level_db=-60.0))


def test_the_text_is_a_study_with_the_scanners_size_and_ranges(scanner: MeasuredScanner) -> None:
    text = study_text(scanner, ["a.png", "b.png"], "2026-11-23", "1.2.3")
    study = parse_study(text)
    assert (study.oct.columns, study.oct.rows) == (512, 512)
    assert study.phantom == scanner.phantom()
    assert set(tomllib.loads(text)) == {"oct", "phantom"}


def test_the_text_says_where_it_came_from_and_what_is_missing(scanner: MeasuredScanner) -> None:
    text = study_text(scanner, ['evil"\n[eye]\nradius_mm = 1', *["b.png"] * 30], "2026-11-23", "1.2.3")
    assert "1.2.3 on 2026-11-23, on 31 frame(s)" in text
    assert "and 11 more" in text
    assert parse_study(text).eye == parse_study("").eye
    assert "# choroid_level_db: not measured, as in the paper's study: " in text
    assert parse_study(text).phantom.choroid_level_db == PhantomStudy().choroid_level_db
