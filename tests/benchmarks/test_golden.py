"""Golden answers: a move is reported with its size."""

import json
from pathlib import Path

import pytest

from golden import __main__ as command
from golden.answers import FROZEN, compared, frozen_text, plain, read_frozen
from golden.computing import GROUPS
from golden.released import (
    GROUP,
    RELEASED,
    changes,
    read_released,
    released_text,
    table_of,
)
from golden.tables import group_table, move_lines

ANSWER = {
    "class": 1,
    "usable": True,
    "reason": None,
    "force_mn": 12.0,
    "interval_mn": [11.0, 13.0],
}
FROZEN_ANSWERS = {"eye/1.png": ANSWER, "eye/2.png": ANSWER}


def changed(**values):
    """The frozen answers, of which the first has other values."""
    now = {name: dict(record) for name, record in FROZEN_ANSWERS.items()}
    now["eye/1.png"] |= values
    return now


@pytest.mark.parametrize(
    ("values", "unit", "size"),
    [
        ({"force_mn": 12.012}, "mN", 0.012),
        ({"interval_mn": [11.0, 12.5]}, "mN", -0.5),
        ({"class": 2}, "count", 1),
        ({"usable": False}, "words", None),
        ({"reason": "no wall"}, "words", None),
        ({"force_mn": None}, "words", None),
        ({"interval_mn": [11.0]}, "words", None),
    ],
)
def test_a_moved_value_is_reported_with_its_size(values, unit, size):
    found = compared(FROZEN_ANSWERS, changed(**values))
    (move,) = found.moves
    assert (move.answer, move.value, move.unit) == (
        "eye/1.png",
        *values,
        unit,
    )
    assert move.size == pytest.approx(size)
    assert not found.is_empty


@pytest.mark.parametrize(
    "values", [{}, {"force_mn": 12.0009}, {"interval_mn": [11.0009, 13.0]}]
)
def test_a_value_within_its_tolerance_has_not_moved(values):
    assert compared(FROZEN_ANSWERS, changed(**values)).is_empty


def test_answers_and_values_that_only_one_side_has_are_reported():
    now = changed()
    del now["eye/2.png"]
    del now["eye/1.png"]["reason"]
    now["eye/3.png"] = ANSWER
    found = compared(FROZEN_ANSWERS, now)
    assert found.missing == ("eye/2.png",)
    assert found.new == ("eye/3.png",)
    assert [(move.value, move.unit) for move in found.moves] == [("reason", "presence")]
    lines = list(move_lines("readings", found))
    assert "readings: eye/2.png: missing" in lines
    assert "readings: eye/3.png: new" in lines


def test_the_table_has_the_largest_move_of_each_unit():
    now = changed(force_mn=12.5, reason="no wall")
    now["eye/2.png"]["force_mn"] = 11.9
    table = group_table({"readings": (now, compared(FROZEN_ANSWERS, now))})
    row = table.splitlines()[-1]
    assert row.startswith("| readings | 2 | 2 | 0 | 0 | ")
    assert "+0.5 mN (eye/1.png force_mn)" in row
    assert "1 of words (eye/1.png reason)" in row


def test_frozen_answers_come_back_from_their_file(tmp_path: Path):
    path = tmp_path / "answers.json"
    groups = {"readings": FROZEN_ANSWERS, "walls": {}}
    path.write_text(frozen_text({"commit": "c0ffee"}, groups))
    assert read_frozen(path) == ({"commit": "c0ffee"}, groups)


def test_numbers_are_kept_as_json_holds_them():
    assert plain({"a": (1.23456789012, float("nan"), 3, None)}) == {
        "a": [1.23456789, None, 3, None]
    }


def test_the_frozen_file_has_every_group():
    made, groups = read_frozen(FROZEN)
    assert made["commit"]
    assert set(groups) == set(GROUPS)
    assert all(groups.values())
    assert len(groups["readings"]) > 400
    sessions = {name.rpartition("/")[0] for name in groups["sessions"]}
    assert len(sessions) == 60
    assert FROZEN.stat().st_size < 600_000


@pytest.mark.slow
def test_a_group_repeats_itself_but_for_what_was_changed(tmp_path: Path, capsys):
    path = tmp_path / "answers.json"
    words = ["--only", "walls", "--of", "plain", "--frozen", str(path), "--strict"]
    assert command.main([*words, "--freeze"]) == 0

    content = json.loads(path.read_text())
    content["answers"]["walls"]["plain/0001.png"]["wall_pixels"] -= 2
    path.write_text(json.dumps(content))
    assert command.main(words) == 1
    move = "+2 count (plain/0001.png wall_pixels)"
    assert f"| walls | 8 | 1 | 0 | 0 | {move} |" in capsys.readouterr().out


RELEASED_COUNTS = {
    "read": {"modules": 100, "loops compiled": 0, "passes": 5},
    "bend": {"solves": 90},
}


def test_a_count_is_worse_where_it_grew_by_more_than_a_tenth():
    now = {
        "read": {"modules": 110, "loops compiled": 1, "passes": 6, "peak_kib": 7},
        "bend": {"solves": 80},
    }
    found = list(changes(RELEASED_COUNTS, now))
    worse = {change.what: change.is_worse for change in found}
    assert worse == {
        "modules": False,
        "loops compiled": True,
        "passes": True,
        "peak_kib": False,
        "solves": False,
    }
    assert "| read | passes | 5 | 6 | **worse** |" in table_of(found)
    assert "| read | peak_kib | - | 7 | new |" in table_of(found)
    assert "| bend | solves | 90 | 80 |  |" in table_of(found)


def test_counts_that_are_as_they_were_released_are_no_change():
    assert not list(changes(RELEASED_COUNTS, RELEASED_COUNTS))


def test_counts_of_a_release_come_back_from_their_file(tmp_path: Path):
    path = tmp_path / "released.json"
    path.write_text(released_text("0.1.0", RELEASED_COUNTS))
    assert read_released(path) == ("0.1.0", RELEASED_COUNTS)


def test_the_release_has_each_count_of_the_golden_answers():
    counted = read_frozen(FROZEN)[1][GROUP]
    released = read_released(RELEASED)[1]
    for work, counts in counted.items():
        assert counts.keys() == released[work].keys()
