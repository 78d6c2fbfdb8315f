"""Golden answers: a move is reported with its size, and every door is compared with
`evaluate`.
"""

import json
from pathlib import Path

import pytest

from golden import __main__ as command
from golden.answers import FROZEN, compared, frozen_text, plain, read_frozen
from golden.computing import GROUPS
from golden.tables import door_differences, door_table, group_table, move_lines

ANSWER = {
    "class": 1,
    "usable": True,
    "reason": None,
    "force_mn": 12.0,
    "interval_mn": [11.0, 13.0],
}
FROZEN_ANSWERS = {"eye/1.png/evaluate": ANSWER, "eye/2.png/evaluate": ANSWER}


def changed(**values):
    """The frozen answers, of which the first has other values."""
    now = {name: dict(record) for name, record in FROZEN_ANSWERS.items()}
    now["eye/1.png/evaluate"] |= values
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
        "eye/1.png/evaluate",
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
    del now["eye/2.png/evaluate"]
    del now["eye/1.png/evaluate"]["reason"]
    now["eye/3.png/evaluate"] = ANSWER
    found = compared(FROZEN_ANSWERS, now)
    assert found.missing == ("eye/2.png/evaluate",)
    assert found.new == ("eye/3.png/evaluate",)
    assert [(move.value, move.unit) for move in found.moves] == [("reason", "presence")]
    lines = list(move_lines("doors", found))
    assert "doors: eye/2.png/evaluate: missing" in lines
    assert "doors: eye/3.png/evaluate: new" in lines


def test_the_table_has_the_largest_move_of_each_unit():
    now = changed(force_mn=12.5, reason="no wall")
    now["eye/2.png/evaluate"]["force_mn"] = 11.9
    table = group_table({"doors": (now, compared(FROZEN_ANSWERS, now))})
    row = table.splitlines()[-1]
    assert row.startswith("| doors | 2 | 2 | 0 | 0 | ")
    assert "+0.5 mN (eye/1.png/evaluate force_mn)" in row
    assert "1 of words (eye/1.png/evaluate reason)" in row


def test_doors_are_compared_with_evaluate_over_the_frames_that_both_answer():
    answers = {
        "eye/1.png/evaluate": ANSWER,
        "eye/1.png/read": ANSWER | {"force_mn": 12.25, "interval_mn": [11.0, 13.75]},
        "eye/2.png/evaluate": ANSWER,
        "eye/2.png/read": ANSWER | {"force_mn": 11.5, "class": 0},
        "eye/3.png/evaluate": ANSWER,
        "eye/3.png/read": ANSWER
        | {"force_mn": None, "usable": False, "reason": "dark"},
        "eye/4.png/read": ANSWER | {"force_mn": 99.0},
        "eye/metrics": {"accuracy_share": 1.0},
    }
    (read,) = door_differences(answers)
    assert (read.door, read.frames) == ("read", 3)
    assert (read.force_mn, read.force_frame) == (-0.5, "eye/2.png")
    assert read.interval_mn == 0.75
    assert (read.forces, read.classes, read.usable, read.reasons) == (1, 1, 1, 1)
    before = {name: record | {} for name, record in answers.items()}
    before["eye/2.png/read"] = ANSWER
    row = door_table(answers, before).splitlines()[-1]
    assert row.startswith("| read | 3 | -0.5000 | +0.2500 | eye/2.png |")


def test_frozen_answers_come_back_from_their_file(tmp_path: Path):
    path = tmp_path / "answers.json"
    groups = {"doors": FROZEN_ANSWERS, "walls": {}}
    path.write_text(frozen_text({"commit": "c0ffee"}, groups))
    assert read_frozen(path) == ({"commit": "c0ffee"}, groups)


def test_numbers_are_kept_as_json_holds_them():
    assert plain({"a": (1.23456789012, float("nan"), 3, None)}) == {
        "a": [1.23456789, None, 3, None]
    }


def test_the_frozen_file_has_every_group_and_every_door():
    made, groups = read_frozen(FROZEN)
    assert made["commit"]
    assert set(groups) == set(GROUPS)
    assert all(groups.values())
    doors = {one.door: one.frames for one in door_differences(groups["doors"])}
    assert set(doors) == {"read", "sf.read", "monitor", "second opinion"}
    assert min(doors.values()) > 50
    sessions = {name.rpartition("/")[0] for name in groups["sessions"]}
    assert len(sessions) == 60
    assert FROZEN.stat().st_size < 1_250_000


@pytest.mark.slow
@pytest.mark.timeout(900)  # twenty-six processes, on a machine that may be busy
def test_a_group_repeats_itself_but_for_what_was_changed(tmp_path: Path, capsys):
    path = tmp_path / "answers.json"
    words = ["--only", "counts", "--frozen", str(path), "--strict"]
    assert command.main([*words, "--freeze"]) == 0

    content = json.loads(path.read_text())
    content["answers"]["counts"]["import scleraforce"]["modules"] -= 2
    path.write_text(json.dumps(content))
    assert command.main(words) == 1
    move = "+2 count (import scleraforce modules)"
    assert f"| counts | 13 | 1 | 0 | 0 | {move} |" in capsys.readouterr().out
