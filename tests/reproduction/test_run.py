"""A reproduction's folder: finished stages are reused, foreign files left alone; and its framing."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from poses import sample_pose

from scleraforce.errors import InputError, StudyError
from scleraforce.models import SHIPPED_READER
from scleraforce.reader import load_force_reader
from scleraforce.reproduction import run as reproduction
from scleraforce.reproduction.readings import run_library
from scleraforce.reproduction.run import Progress, Run, Stage, framed_for_laboratory, open_run, run_stages
from scleraforce.study import NetworkStudy, Study, format_study, parse_study

DONE: list[str] = []
BARS: list[tuple[str, int, int]] = []


@contextmanager
def announce(title: str, length: int) -> Iterator[Progress]:
    """Keep what a progress bar would show: its title, its length, how far it came."""
    count = 0

    def advance(steps: int) -> None:
        nonlocal count
        count += steps

    yield advance
    BARS.append((title, length, count))


@pytest.fixture(autouse=True)
def _clean() -> None:
    DONE.clear()
    BARS.clear()


def stage(name: str, work: Callable[[Run, Progress], None] | None = None, *, resumes: bool = False) -> Stage:
    """A stage that writes a folder of its name and ticks twice."""

    def write(run: Run, progress: Progress) -> None:
        (run.folder / name).mkdir(exist_ok=resumes)
        progress(1)
        progress(1)
        DONE.append(name)

    return Stage(name, lambda _: 2, work or write, lambda run: run.folder / name, resumes)


def run_in(folder: Path, *stages: Stage, say: Callable[[str], object] = lambda _: None) -> dict[str, float]:
    return run_stages(open_run(folder, Study(), 1), stages, announce, say)


def test_a_run_does_the_stages_in_order_and_a_later_one_only_the_unfinished(tmp_path: Path) -> None:
    first = run_in(tmp_path, stage("a"), stage("b"))
    assert BARS == [("1/2 a", 2, 2), ("2/2 b", 2, 2)]
    assert (tmp_path / "study.toml").exists()
    second = run_in(tmp_path, stage("a"), stage("b"), stage("c"))
    assert DONE == ["a", "b", "c"]
    assert list(second) == DONE
    assert {name: second[name] for name in first} == first
    (tmp_path / "a").rmdir()
    run_in(tmp_path, stage("a"))
    assert DONE == ["a", "b", "c", "a"]


def interrupted(run: Run, progress: Progress) -> None:
    """Half of a stage's result, then Ctrl-C."""
    progress(1)
    (run.folder / "b").mkdir()
    raise KeyboardInterrupt


def test_after_control_c_the_unfinished_stage_is_repeated_or_resumed(tmp_path: Path) -> None:
    for resumes in (False, True):
        with pytest.raises(KeyboardInterrupt):
            run_in(tmp_path / str(resumes), stage("a"), stage("b", interrupted))
        run_in(tmp_path / str(resumes), stage("a"), stage("b", resumes=resumes))
    assert DONE == ["a", "b"] * 2


def test_folders_of_others_and_of_another_study_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="not empty, and not made by `reproduce`"):
        open_run(tmp_path, Study(), 1)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    with pytest.raises(InputError, match=r"mine\.txt"):
        open_run(tmp_path / "mine.txt", Study(), 1)
    open_run(tmp_path / "out", Study(), 1)
    with pytest.raises(InputError, match="made from another study"):
        open_run(tmp_path / "out", Study(network=NetworkStudy(seed=7)), 1)


def test_a_run_with_another_reader_repeats_only_what_depends_on_it(tmp_path: Path) -> None:
    stages = (stage("a"), replace(stage("b"), by_reader=True))
    for train in (False, True, True):
        run_stages(open_run(tmp_path, Study(), 1, train=train), stages, announce)
    assert DONE == ["a", "b", "b"]


@pytest.mark.parametrize(
    "text", ["[classes]\nbounds_mn = [4.0, 20.0]", "[needle]\nouter_diameter_mm = 0.5", "[eye]\nradius_mm = 11.0"]
)
def test_the_bundled_reader_is_refused_for_a_study_that_it_was_not_trained_for(tmp_path: Path, text: str) -> None:
    study = parse_study(text)
    key = f"{text.split(']')[0][1:]}.{text.splitlines()[1].split()[0]}"
    with pytest.raises(StudyError, match=f"study: {key}: .*--train"):
        open_run(tmp_path / "out", study, 1)
    assert open_run(tmp_path / "out", study, 1, train=True).reader == tmp_path / "out" / "reader"


def test_the_bundled_reader_serves_the_papers_study_with_its_own_library(tmp_path: Path) -> None:
    run = open_run(tmp_path / "out", framed_for_laboratory(Study()), 1)
    assert run.reader == SHIPPED_READER
    np.testing.assert_array_equal(
        run_library(run).walls.values(), load_force_reader(SHIPPED_READER).library.walls.values()
    )


@pytest.fixture(autouse=True)
def _own_sources() -> Iterator[None]:
    """Forget the sources of another test."""
    yield
    reproduction._sources.cache_clear()


def test_results_of_other_code_are_made_again_once_and_one_line_says_so(tmp_path: Path, monkeypatch) -> None:
    stages, lines = (stage("a", resumes=True), stage("b")), []
    run_in(tmp_path, *stages, say=lines.append)
    (tmp_path / "a" / "old").write_text("")
    monkeypatch.setattr(reproduction, "hash_sources", lambda *_: "0" * 64)
    reproduction._sources.cache_clear()
    with pytest.raises(KeyboardInterrupt):
        run_in(tmp_path, stages[0], stage("b", interrupted), say=lines.append)
    run_in(tmp_path, *stages, say=lines.append)
    assert DONE == ["a", "b", "a", "b"]
    assert not (tmp_path / "a" / "old").exists()
    assert lines == [f"{tmp_path}: the code has changed since these results were made; all stages are done again"]


def test_a_broken_state_is_refused(tmp_path: Path) -> None:
    open_run(tmp_path, Study(), 1)
    for content in ("{", "[]", '{"seconds": 3}'):
        (tmp_path / "reproduce.json").write_text(content)
        with pytest.raises(InputError, match=r"reproduce\.json: cannot be read"):
            open_run(tmp_path, Study(), 1)


def test_every_pose_of_the_virtual_laboratory_lies_in_the_framing_of_the_data_set() -> None:
    study = framed_for_laboratory(Study())
    rng = np.random.default_rng(1)
    poses = [sample_pose(study.phantom, rng) for _ in range(500)]
    lateral, depth = study.dataset.framing_lateral_m.bounds, study.dataset.framing_depth_m.bounds
    offsets = [pose.depth_m - study.slice.margin_m for pose in poses]
    assert lateral[0] < min(pose.lateral_m for pose in poses)
    assert max(pose.lateral_m for pose in poses) < lateral[1]
    assert depth[0] < min(offsets)
    assert max(offsets) < depth[1]
    # ... and with little to spare: a pixel on both sides
    assert depth[1] - depth[0] < max(offsets) - min(offsets) + 0.3e-3
    assert parse_study(format_study(study)) == study
