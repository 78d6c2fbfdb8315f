"""A reproduction: finished stages are reused, foreign files left alone; framing,
readings, sections; the demo.
"""

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from poses import sample_pose
from side_stages import BESIDE_STEPS, beside, failing_beside
from small_recordings import evaluation_of, frame_answer

from scleraforce.base.errors import InputError, SolverError, StudyError
from scleraforce.calibration.evaluation import Evaluation
from scleraforce.front.paper import demo, run_folder
from scleraforce.front.paper.paper_page import _comparison, _coverage
from scleraforce.front.paper.run_folder import (
    Progress,
    Run,
    Stage,
    framed_for_laboratory,
    open_run,
    run_library,
    run_stages,
)
from scleraforce.mechanics.contact_and_section import Contact, ScanPlane
from scleraforce.mechanics.hexahedral_mesh import build_mesh
from scleraforce.mechanics.linear_wall import LinearWall
from scleraforce.mechanics.mesh_section import cut_sections
from scleraforce.reading.load_model import load_force_reader
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.records.calibration_file import read_calibration
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.study import NetworkStudy, Study, format_study, parse_study

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


def stage(
    name: str,
    work: Callable[[Run, Progress], None] | None = None,
    *,
    resumes: bool = False,
) -> Stage:
    """A stage that writes a folder of its name and ticks twice."""

    def write(run: Run, progress: Progress) -> None:
        (run.folder / name).mkdir(exist_ok=resumes)
        progress(1)
        progress(1)
        DONE.append(name)

    return Stage(
        name, lambda _: 2, work or write, lambda run: run.folder / name, resumes
    )


def run_in(
    folder: Path, *stages: Stage, say: Callable[[str], object] = lambda _: None
) -> dict[str, float]:
    return run_stages(open_run(folder, Study(), 1), stages, announce, say)


def test_a_run_does_the_stages_in_order_and_a_later_one_only_the_unfinished(
    tmp_path: Path,
) -> None:
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


def test_after_control_c_the_unfinished_stage_is_repeated_or_resumed(
    tmp_path: Path,
) -> None:
    for resumes in (False, True):
        with pytest.raises(KeyboardInterrupt):
            run_in(tmp_path / str(resumes), stage("a"), stage("b", interrupted))
        run_in(tmp_path / str(resumes), stage("a"), stage("b", resumes=resumes))
    assert DONE == ["a", "b"] * 2


def test_folders_of_others_and_of_another_study_are_left_alone(tmp_path: Path) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("mine")
    open_run(tmp_path / "out", Study(), 1)
    other = Study(network=NetworkStudy(seed=7))
    for folder, study, words in (
        (tmp_path, Study(), "not empty, and not made by `reproduce`"),
        (mine, Study(), r"mine\.txt"),
        (tmp_path / "out", other, "made from another study"),
    ):
        with pytest.raises(InputError, match=words):
            open_run(folder, study, 1)
    assert mine.read_text() == "mine"


def test_a_run_with_another_reader_repeats_only_what_depends_on_it(
    tmp_path: Path,
) -> None:
    stages = (stage("a"), replace(stage("b"), by_reader=True))
    for train in (False, True, True):
        run_stages(open_run(tmp_path, Study(), 1, train=train), stages, announce)
    assert DONE == ["a", "b", "b"]


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("[classes]\nbounds_mn = [4.0, 20.0]", "classes.bounds_mn"),
        ("[needle]\nouter_diameter_mm = 0.5", "needle.outer_diameter_mm"),
        ("[eye]\nradius_mm = 11.0", "eye.radius_mm"),
    ],
)
def test_the_bundled_reader_is_refused_for_a_study_that_it_was_not_trained_for(
    tmp_path: Path, text: str, key: str
) -> None:
    study = parse_study(text)
    out = tmp_path / "out"
    with pytest.raises(StudyError, match=f"study: {key}: .*`train`"):
        open_run(out, study, 1)
    assert open_run(out, study, 1, train=True).reader == out / "reader"


def test_the_bundled_reader_serves_the_papers_study_with_its_own_library(
    tmp_path: Path,
) -> None:
    run = open_run(tmp_path / "out", framed_for_laboratory(Study()), 1)
    assert run.reader == SHIPPED_READER
    shipped = load_force_reader(SHIPPED_READER).library
    np.testing.assert_array_equal(
        run_library(run).curves_tpdbnc(), shipped.curves_tpdbnc()
    )


@pytest.fixture(autouse=True)
def _own_sources() -> Iterator[None]:
    """Forget the sources of another test."""
    yield
    run_folder._sources.cache_clear()


def test_results_of_other_code_are_made_again_once_and_one_line_says_so(
    tmp_path: Path, monkeypatch
) -> None:
    stages = (stage("a", resumes=True), stage("b"))
    lines = []
    run_in(tmp_path, *stages, say=lines.append)
    (tmp_path / "a" / "old").write_text("")
    monkeypatch.setattr(run_folder, "hash_sources", lambda *_: "0" * 64)
    run_folder._sources.cache_clear()

    with pytest.raises(KeyboardInterrupt):
        run_in(tmp_path, stages[0], stage("b", interrupted), say=lines.append)

    run_in(tmp_path, *stages, say=lines.append)
    assert DONE == ["a", "b", "a", "b"]
    assert not (tmp_path / "a" / "old").exists()
    assert lines == [
        f"{tmp_path}: the code has changed since these results were made; all stages"
        " are done again"
    ]


@pytest.mark.parametrize("content", ["{", "[]", '{"seconds": 3}'])
def test_a_broken_state_is_refused(tmp_path: Path, content: str) -> None:
    open_run(tmp_path, Study(), 1)
    (tmp_path / "reproduce.json").write_text(content)
    with pytest.raises(InputError, match=r"reproduce\.json: cannot be read"):
        open_run(tmp_path, Study(), 1)


def test_every_pose_of_the_virtual_laboratory_lies_in_the_framing_of_the_data_set():
    study = framed_for_laboratory(Study())
    rng = np.random.default_rng(1)
    poses = [sample_pose(study.phantom, rng) for _ in range(500)]
    lateral = study.dataset.framing_lateral_m.bounds
    depth = study.dataset.framing_depth_m.bounds
    offsets = [pose.depth_m - study.slice.margin_m for pose in poses]
    assert lateral[0] < min(pose.lateral_m for pose in poses)
    assert max(pose.lateral_m for pose in poses) < lateral[1]
    assert depth[0] < min(offsets)
    assert max(offsets) < depth[1]
    # ... and with little to spare: a pixel on both sides
    assert depth[1] - depth[0] < max(offsets) - min(offsets) + 0.3e-3
    assert parse_study(format_study(study)) == study


def test_a_section_at_another_modulus_is_that_of_the_scaled_force_to_a_tenth_of_a_pixel():
    # Pressure and weight do not scale with the force; what they add is what the
    # relabelling neglects.
    mesh = build_mesh(12e-3, 0.6e-3, 8, 0, 1, 2)
    wall = LinearWall(mesh, 0.45)
    plane = ScanPlane(Contact(polar_rad=np.radians(35.0)), gap_m=0.5e-3)
    modes_knc = np.stack(
        [266.0 * wall.pressure_nc, wall.needle_cnc([plane.contact], 0.35e-3)[0]]
    )
    here = 0.25e6
    there = 0.28e6
    weights_fk = np.array([[1.0 / here, 0.03 / here], [1.0 / there, 0.03 / here]])
    one, other = cut_sections(mesh, [plane], modes_knc, weights_fk[None])[0]
    assert np.abs(one.outer - other.outer).max() < 1e-5
    assert np.abs(one.inner - other.inner).max() < 1e-5


def evaluation(folder: Path, kind: str, read_n: tuple[float | None, ...]) -> Evaluation:
    """Answers to two frames, the log 2 mN above the truth."""
    frames = tuple(
        frame_answer(
            recording=str(folder),
            eye="eye-1",
            file=f"{number}.png",
            measured_force_n=true_n + 2e-3,
            measured_force_sd_n=0.1e-3,
            true_force_n=true_n,
            force_n=force_n,
            interval_n=None if force_n is None else (force_n - 1e-3, force_n + 1e-3),
        )
        for number, (true_n, force_n) in enumerate(
            zip((10e-3, 20e-3), read_n, strict=True)
        )
    )
    return evaluation_of(frames, kind=kind)


def test_forces_are_compared_with_the_log_and_with_the_truth(tmp_path: Path) -> None:
    paper = evaluation(tmp_path, "classifier", (None, None))
    reader = evaluation(tmp_path, "reader", (10.5e-3, 19.5e-3))
    cells = {row[0]: row[1:] for row in _comparison(paper, reader).rows}
    assert cells["mean error of the force in mN"] == ["\N{EN DASH}", "2.00"]
    assert cells["the same against the true force"] == ["\N{EN DASH}", "0.50"]
    assert cells["labels that agree with their 90 % interval"][1].startswith("0.00")
    assert cells["true forces within their 90 % interval"][1].startswith("1.00")


def test_a_low_coverage_is_explained_by_the_error_of_the_log(tmp_path: Path) -> None:
    found = _coverage(evaluation(tmp_path, "reader", (10.5e-3, 19.5e-3)))
    assert [found[name] for name in ("off_mn", "most_mn", "reach_mn")] == pytest.approx(
        [2.0, 2.0, 1.0]
    )
    assert [found[name] for name in ("agree", "label_mn", "hold")] == pytest.approx(
        [0.0, 0.1, 1.0]
    )
    assert found["by_eye"] == "2 of 2 of eye-1"
    assert _coverage(evaluation(tmp_path, "classifier", (None, None))) == {}


@pytest.mark.slow
def test_a_virtual_session_is_pushed_calibrated_read_and_shown(
    tmp_path: Path, shell
) -> None:
    out = tmp_path / "new" / "demo"
    told = shell.json("demo --out", out)
    assert told["page"] == str(out / "answers.html")
    assert "Model" in (out / "answers.html").read_text()
    frames = read_recording(out / "eye").frames
    assert len(frames) == told["frames"] == len(demo.FORCES_N)
    calibrated = read_calibration(out / "modulus.json").eyes["demo"].eye
    assert calibrated.modulus_pa == pytest.approx(0.3e6, rel=0.1)
    assert told["read"] == told["right"] == len(demo.FORCES_N) - demo.TAUGHT
    assert told["mae_mn"] < 1.0


def test_a_session_that_ends_early_leaves_nothing(
    tmp_path: Path, monkeypatch, shell
) -> None:
    def failing(out: Path, *_: object) -> None:
        out.mkdir(parents=True)
        raise SolverError("no equilibrium")

    monkeypatch.setattr(demo, "study_sections", lambda *_: lambda _: [])
    monkeypatch.setattr(demo, "write_phantom", failing)
    assert shell.refused("demo --out", tmp_path / "demo", codes=(1,)) == (
        "error: no equilibrium\n"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_there_stays(tmp_path: Path, shell) -> None:
    (tmp_path / "mine").write_text("mine")
    assert f"{tmp_path}: exists already" in shell.refused("demo --out", tmp_path)
    assert (tmp_path / "mine").read_text() == "mine"


def beside_stage(work: Callable[[Run, Progress], None], after: str = "") -> Stage:
    return Stage(
        "beside",
        lambda _: BESIDE_STEPS,
        work,
        lambda run: run.folder / "beside",
        beside=True,
        after=after,
    )


@pytest.mark.parametrize("workers", [1, 2, 5])
@pytest.mark.parametrize("after", ["", "a"])
def test_a_stage_beside_others_is_done_in_a_second_process_of_half_the_workers(
    tmp_path: Path, workers: int, after: str
) -> None:
    lines = list[str]()
    stages = (stage("a"), stage("b"), beside_stage(beside, after))
    run = open_run(tmp_path, Study(), workers)
    seconds = run_stages(run, stages, announce, note=lines.append)
    process, of_it = (tmp_path / "beside").read_text().split()
    assert (int(process) == os.getpid()) == (workers == 1)
    assert int(of_it) == max(1, workers // 2)
    assert list(seconds) == ["a", "b", "beside"]
    assert BARS[-1] == ("3/3 beside", BESIDE_STEPS, BESIDE_STEPS)
    titles = [title for title, *_ in BARS]
    for line, title in zip(lines, titles, strict=True):
        assert re.fullmatch(rf"{title}: \d+\.\d s", line)
    again = run_stages(run, stages, announce)
    assert again == seconds
    assert DONE == ["a", "b"]


def test_a_stage_that_is_interrupted_has_no_line(tmp_path: Path) -> None:
    def interrupted(_: Run, __: Progress) -> None:
        raise KeyboardInterrupt

    lines = list[str]()
    stages = (stage("a"), Stage("b", lambda _: 3, interrupted))
    with pytest.raises(KeyboardInterrupt):
        run_stages(open_run(tmp_path, Study(), 1), stages, announce, note=lines.append)
    assert len(lines) == 1
    assert lines[0].startswith("1/2 a: ")


def test_a_fault_of_a_stage_beside_others_is_raised_and_the_others_are_kept(
    tmp_path: Path,
) -> None:
    run = open_run(tmp_path, Study(), 2)
    with pytest.raises(SolverError, match="no equilibrium"):
        run_stages(run, (stage("a"), beside_stage(failing_beside)), announce)
    run_stages(run, (stage("a"), beside_stage(beside)), announce)
    assert DONE == ["a"]
