"""`make bench`: its page shows the measured figures, and a quick run measures every
row.
"""

import json
import os
import subprocess
import sys
from dataclasses import replace
from math import isfinite
from pathlib import Path

import click
import pytest

from provenance.stamps import read_stamps
from scleraforce.base.errors import InputError
from scleraforce.records.study import Study
from speed.__main__ import RELEASED, main, read_results
from speed.lock import alone
from speed.page import as_markdown
from speed.parts.reader_training import Course
from speed.record import Results, Row, Table, failed_table, spread
from speed.run import in_turns

ROOT = Path(__file__).parents[2]
ROW = Row(
    what="ours, of this test",
    value=0.5,
    unit="s",
    spread=(0.4, 0.75),
    beside="theirs",
    beside_value=0.25,
    goal=0.4,
    settings="one thread",
    more={"unknowns": 43929.0, "error, %": -1.0},
)
RESULTS = Results(
    made="*Made by hand.*",
    quick=False,
    machine={"cores": "2"},
    seconds=90.0,
    tables={
        "static_solve": Table("Solve", "In turns.", (ROW,)),
        "wire": failed_table("wire", "code 1"),
    },
)
PARTS = (
    "static_solve",
    "another_load",
    "finite_strain",
    "axisymmetric",
    "dataset",
    "classifier",
    "reader_training",
    "frame",
    "wire",
    "commands",
)


def test_a_page_has_each_row_beside_its_goal_and_names_a_failed_part(
    tmp_path: Path,
) -> None:
    (tmp_path / "results.json").write_text(json.dumps(RESULTS.as_json()))
    main(["--render", "--out", str(tmp_path)], standalone_mode=False)
    page = (tmp_path / "RESULTS.md").read_text(encoding="utf-8")
    assert (
        "| ours, of this test | 0.5 s | 0.4 to 0.75 | theirs: 0.25 s | 2 | 0.4 s, **missed**"
        " | 43,929 | -1 |" in page
    )
    assert "## Wire\n\n**This part failed**: code 1" in page
    pages = (page, as_markdown(replace(RESULTS, quick=True)))
    assert ["figures say only" in each for each in pages] == [False, True]
    assert "| 0.5 s (not of this run) |" in as_markdown(
        with_row(replace(ROW, source="NUMBERS, another day"))
    )
    assert "| - |" in as_markdown(with_row(replace(ROW, value=None)))


def test_a_page_says_by_what_factor_a_row_is_less_than_at_the_last_release() -> None:
    """A ratio of 2 that was 3 is less by 1.5, whatever the seconds; without a ratio
    seconds count.
    """
    before = with_row(replace(ROW, value=6.0, beside_value=2.0))
    head = "goal | last release | factor | unknowns"
    assert head not in as_markdown(RESULTS)
    page = as_markdown(RESULTS, before)
    assert head in page
    assert "| 0.4 s, **missed** | 3 | 1.5 | 43,929 |" in page

    alone_now = with_row(replace(ROW, beside="", beside_value=None))
    assert "| 6 s | 12 |" in as_markdown(alone_now, before)
    other = with_row(replace(ROW, what="another row"))
    assert head not in as_markdown(other, before)


def with_row(row: Row) -> Results:
    return replace(
        RESULTS, tables={"static_solve": Table("Solve", "In turns.", (row,))}
    )


def test_invalid_requests_are_refused(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text('{"tables": 3}')
    for words, said in (
        (["nothing"], "'nothing' is not one of 'static_solve'"),
        (["wire", "--out", "somewhere"], "PARTs are printed, and nothing is written"),
        (["--render", "--out", "nowhere"], "nowhere/results.json: No such file"),
        (
            ["--render", "--out", str(tmp_path)],
            "results.json: not the figures of a run",
        ),
    ):
        with pytest.raises((click.UsageError, InputError), match=said):
            main(words, standalone_mode=False)

    assert not (tmp_path / "RESULTS.md").exists()


def test_work_is_done_in_turns_and_its_spread_leaves_a_tenth_on_either_side() -> None:
    done: list[str] = []
    taken = in_turns({"a": lambda: done.append("a"), "b": lambda: done.append("b")}, 2)
    assert done == ["a", "b", "a", "b"]
    assert [len(times) for times in taken.values()] == [2, 2]
    assert spread([float(number) for number in range(11)]) == {
        "value": 5.0,
        "spread": (1.0, 9.0),
    }


def test_the_time_of_a_whole_training_follows_from_a_part_of_it() -> None:
    """5 s once, 2 s an epoch, 1 s an eye: three of ten epochs and two of four eyes are
    timed.
    """
    reader = replace(Study().reader, epochs=10, interval_eyes=4)
    course = Course(100.0, [103.0, 105.0, 107.0], [110.0, 111.0], 113.0)
    assert course.whole_s(reader) == pytest.approx(29.0)


def test_the_page_is_rendered_from_the_stored_figures() -> None:
    plain = json.loads(
        (ROOT / "benchmarks" / "results.json").read_text(encoding="utf-8")
    )
    page = (ROOT / "benchmarks" / "RESULTS.md").read_text(encoding="utf-8")
    assert page == as_markdown(Results.from_json(plain), read_results(RELEASED)), (
        "after a change of the page: python -m speed --render"
    )
    assert tuple(plain["tables"]) == PARTS


def test_another_benchmark_waits_until_the_first_is_done(tmp_path: Path) -> None:
    child = (
        "import sys; from speed.lock import alone\nwith alone(): open(sys.argv[1],"
        " 'w').close()"
    )
    mark = tmp_path / "mark"

    with alone():
        waiting = subprocess.Popen(
            [sys.executable, "-c", child, str(mark)],
            env=environment(tmp_path),
            stderr=subprocess.PIPE,
            text=True,
        )
        assert waiting.stderr
        assert waiting.stderr.readline() == "waiting for another benchmark to end\n"
        assert not mark.exists()

    assert waiting.wait(300.0) == 0
    waiting.stderr.close()
    assert mark.exists()


@pytest.mark.slow
@pytest.mark.long
def test_a_quick_run_measures_every_row(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    command = [sys.executable, "-m", "speed", "--quick", "--out", str(tmp_path / "out")]
    given = {"env": environment(tmp_path), "timeout": 900}
    done = subprocess.run(command, capture_output=True, text=True, check=False, **given)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "out" / "RESULTS.md").read_text(encoding="utf-8")
    plain = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert tuple(plain["tables"]) == PARTS
    rows = [row for table in plain["tables"].values() for row in table["rows"]]

    for row in rows:
        absent = "is not installed" in row["settings"]
        assert absent or (
            row["value"] is not None and isfinite(row["value"]) and row["value"] > 0.0
        ), row
        assert all(
            value is not None and isfinite(value) for value in row["more"].values()
        ), row

    assert sum(row["goal"] is not None for row in rows) == 23
    assert page == as_markdown(Results.from_json(plain), read_results(RELEASED))
    (stamp,) = read_stamps(tmp_path / "out" / "RESULTS.md")
    assert stamp.made_by == "make bench"


def environment(folder: Path) -> dict[str, str]:
    """Return an environment with the benchmarks' modules and a cache of its own."""
    paths = [
        str(ROOT / "benchmarks"),
        str(ROOT / "src"),
        os.environ.get("PYTHONPATH", ""),
    ]
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
        "XDG_CACHE_HOME": str(folder / "cache"),
    }
