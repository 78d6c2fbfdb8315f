"""`make bench`: what its page says is what was measured, and a quick run measures every row."""

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from itertools import combinations
from math import isfinite
from pathlib import Path
from time import sleep

import pytest

from provenance.stamps import read_stamps
from scleraforce.study import Study
from speed.lock import alone
from speed.page import as_markdown, table_lines
from speed.parts.reader_training import whole_seconds
from speed.picture import draw_solves
from speed.record import Results, Row, Table, failed_table, spread
from speed.run import Run, in_turns
from speed.solvers.problem import peak_mb

ROOT = Path(__file__).parents[2]
ROW = Row(
    what="ours, default",
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
    tables={"static_solve": Table("Solve", "In turns.", (ROW,)), "wire": failed_table("wire", "code 1")},
)
PARTS = (
    "static_solve", "another_load", "finite_strain", "axisymmetric", "dataset", "classifier", "reader_training",
    "frame", "network", "wire", "commands", "pipeline",
)  # fmt: skip


def test_a_row_says_value_spread_what_stands_beside_it_and_whether_the_goal_is_met() -> None:
    lines = table_lines(RESULTS.tables["static_solve"])
    assert lines[0] == "In turns."
    assert lines[2] == "|  | value | spread | beside it | ratio | goal | unknowns | error, % |"
    cells = "ours, default | 0.5 s | 0.4 to 0.75 | theirs: 0.25 s | 2 | 0.4 s, **missed** | 43,929 | -1"
    assert lines[4] == f"| {cells} |"
    assert lines[-1] == "- ours, default: one thread"


def test_columns_that_no_row_fills_are_left_out() -> None:
    bare = Row(what="a", value=2.0, unit="ms")
    assert table_lines(Table("", "", (bare,)))[2:] == ["|  | value |", "| --- | --- |", "| a | 2 ms |"]


@pytest.mark.parametrize(("value", "verdict"), [(0.4, True), (0.41, False), (None, None)])
def test_a_goal_is_met_up_to_its_value(value: float | None, verdict: bool | None) -> None:
    assert replace(ROW, value=value).goal_met is verdict
    assert replace(ROW, goal=None).goal_met is None


def test_what_is_not_of_the_run_is_marked_in_its_row_and_below() -> None:
    lines = table_lines(Table("", "", (replace(ROW, source="NUMBERS, another day"),)))
    assert "| 0.5 s (not of this run) |" in lines[4]
    assert lines[-1] == "- ours, default: one thread; not of this run: NUMBERS, another day"


def test_what_was_not_measured_has_no_ratio() -> None:
    row = replace(ROW, value=None)
    assert row.ratio is None
    assert "| - |" in table_lines(Table("", "", (row,)))[4]


def test_a_part_that_failed_is_named_on_the_page() -> None:
    page = as_markdown(RESULTS)
    assert "## Wire\n\n**This part failed**: code 1" in page
    assert "## Goals" in page
    assert "- the run took 1.5 minutes" in page


def test_results_are_read_back_from_their_json() -> None:
    found = Results.from_json(json.loads(json.dumps(RESULTS.as_json())))
    assert found == RESULTS
    assert as_markdown(found) == as_markdown(RESULTS)


def test_a_quick_run_says_so() -> None:
    assert "figures say only" in as_markdown(replace(RESULTS, quick=True))
    assert "figures say only" not in as_markdown(RESULTS)


def test_the_spread_leaves_a_tenth_on_either_side() -> None:
    found = spread([float(number) for number in range(11)])
    assert found == {"value": 5.0, "spread": (1.0, 9.0)}


def test_work_is_done_in_turns() -> None:
    done: list[str] = []
    taken = in_turns({"a": lambda: done.append("a"), "b": lambda: done.append("b")}, 2)
    assert done == ["a", "b", "a", "b"]
    assert [len(times) for times in taken.values()] == [2, 2]


def test_long_work_is_done_where_it_is_asked_for_and_in_a_quick_run(tmp_path: Path) -> None:
    assert [Run(quick, tmp_path, ("tests",)).full("reproduce") for quick in (True, False)] == [True, False]
    assert Run(False, tmp_path, ("tests",)).full("tests")


def test_errors_are_drawn_over_time_and_what_was_not_measured_is_not() -> None:
    axes = draw_solves([ROW, replace(ROW, value=None), replace(ROW, source="quoted")]).axes[0]
    assert [(line.get_xdata()[0], line.get_ydata()[0]) for line in axes.lines] == [(0.5, 1.0)] * 2
    assert [line.get_fillstyle() for line in axes.lines] == ["full", "none"]


def test_no_two_names_of_solves_overlap() -> None:
    near = [
        replace(ROW, what=f"{name}, {number}", value=0.5 + 0.01 * number)
        for number in (0, 1)
        for name in ("ours", "SOFA")
    ]
    figure = draw_solves([*near, replace(ROW, what="CalculiX C3D20", value=50.0)])
    boxes = [text.get_window_extent() for text in figure.axes[0].texts]
    assert len(boxes) == 5
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


def test_a_part_of_a_training_stands_for_the_whole_with_what_is_done_once() -> None:
    """5 s once, 2 s an epoch, 1 s an eye: three epochs and two eyes are seen of ten and four."""
    study = replace(Study(), reader=replace(Study().reader, epochs=10, interval_eyes=4))
    assert whole_seconds(study, 100.0, [103.0, 105.0, 107.0], [110.0, 111.0], 113.0) == pytest.approx(29.0)


def test_the_page_of_the_last_run_is_that_of_its_figures() -> None:
    plain = json.loads((ROOT / "benchmarks" / "results.json").read_text(encoding="utf-8"))
    page = (ROOT / "benchmarks" / "RESULTS.md").read_text(encoding="utf-8")
    assert page == as_markdown(Results.from_json(plain)), "after a change of the page: python -m speed --render"
    assert tuple(plain["tables"]) == PARTS


def test_a_page_is_rendered_anew_from_its_figures(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text(json.dumps(RESULTS.as_json()))
    done = speed("--render", "--out", str(tmp_path), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "RESULTS.md").read_text(encoding="utf-8") == as_markdown(RESULTS)
    assert (tmp_path / "static_solves.png").stat().st_size > 10_000


def test_another_benchmark_waits_until_the_first_is_done(tmp_path: Path) -> None:
    child = "import sys; from speed.lock import alone\nwith alone(): open(sys.argv[1], 'w').close()"
    mark = tmp_path / "mark"
    with alone():
        waiting = subprocess.Popen(
            [sys.executable, "-c", child, str(mark)], env=environment(tmp_path), stderr=subprocess.PIPE, text=True
        )
        assert waiting.stderr
        assert waiting.stderr.readline() == "waiting for another benchmark to end\n"
        assert not mark.exists()
    assert waiting.wait(300.0) == 0
    waiting.stderr.close()
    assert mark.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nothing"], "'nothing' is not one of 'static_solve'"),
        (["wire", "--out", "somewhere"], "PARTs are printed, and nothing is written"),
        (["--render", "--out", "nowhere"], "error: nowhere/results.json: No such file"),
    ],
)
def test_what_cannot_be_done_is_refused_in_a_line(words: list[str], said: str, tmp_path: Path) -> None:
    done = speed(*words, folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_figures_that_are_none_are_refused(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text('{"tables": 3}')
    done = speed("--render", "--out", str(tmp_path), folder=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "results.json: not the figures of a run" in done.stderr
    assert not (tmp_path / "RESULTS.md").exists()


@pytest.mark.slow
def test_an_interrupted_run_writes_nothing(tmp_path: Path) -> None:
    words = ["--quick", "--out", str(tmp_path / "out")]
    process = subprocess.Popen(
        [sys.executable, "-m", "speed", *words],
        env=environment(tmp_path) | {"TMPDIR": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not list(tmp_path.glob("bench-*")):
        sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=300.0)
    assert process.returncode == 130
    assert said.endswith("interrupted; nothing was written\n")
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.glob("bench-*"))


@pytest.mark.slow
@pytest.mark.long
def test_a_quick_run_measures_every_row_and_its_page_is_that_of_its_figures(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    done = speed("--quick", "--out", str(tmp_path / "out"), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "out" / "RESULTS.md").read_text(encoding="utf-8")
    plain = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert tuple(plain["tables"]) == PARTS
    rows = [row for table in plain["tables"].values() for row in table["rows"]]
    for row in rows:
        absent = "is not installed" in row["settings"]
        assert absent or (row["value"] is not None and isfinite(row["value"]) and row["value"] > 0.0), row
        assert all(value is not None and isfinite(value) for value in row["more"].values()), row
    assert sum(row["goal"] is not None for row in rows) == 17
    assert page == as_markdown(Results.from_json(plain))
    assert (tmp_path / "out" / "static_solves.png").stat().st_size > 10_000
    (stamp,) = read_stamps(tmp_path / "out" / "RESULTS.md")
    assert stamp.made_by == "make bench"


def environment(folder: Path) -> dict[str, str]:
    """Where a run finds its modules, and a cache that is a test's own."""
    paths = [str(ROOT / "benchmarks"), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths)), "XDG_CACHE_HOME": str(folder / "cache")}


def speed(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "speed", *words],
        env=environment(folder),
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
    )


def test_a_program_that_has_ended_holds_no_memory_until_it_is_waited_for() -> None:
    waits = [sys.executable, "-c", "print(flush=True); input()"]
    with subprocess.Popen(waits, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as program:
        assert program.stdout is not None
        program.stdout.readline()  # right after its start it holds nothing yet
        assert peak_mb(program.pid) > 1.0
        program.kill()
        os.waitid(os.P_PID, program.pid, os.WEXITED | os.WNOWAIT)  # it has ended, and is left to be waited for
        assert peak_mb(program.pid) == 0.0
