"""The library on disk: the same bytes for any number of workers and interruptions,
checked, and right.
"""

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import zarr
from analytic_library import no_solution, no_worker, solve_analytic, solve_slowly
from effects import contents
from small_models import rehash_store
from waiting import LIMIT_S, wait_until
from workers import Cluster

from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.worker_processes import cluster_workers
from scleraforce.library.library_plan import LibraryPlan, plan_library
from scleraforce.library.library_store import (
    build_library,
    cached_library,
    open_library,
    solve_path,
)
from scleraforce.mechanics.axisymmetric_wall import EvenWall, axisymmetric_path
from scleraforce.mechanics.load_path_tracing import PathEnd
from scleraforce.mechanics.meridian_elements import MeridianSize
from scleraforce.records.study import LibraryStudy, NeedleStudy, Study

# 4 stiffenings of 16 walls, and 16 walls with 8 other supports
UNITS = 4 * 16 + 8 * 16
GRID = "LibraryStudy(thicknesses=4, tensions=4, tips=6, elements=8, stiffenings=4)"
STUDY = Study(
    library=LibraryStudy(thicknesses=4, tensions=4, tips=6, elements=8, stiffenings=4)
)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A library made by one worker: the reference of the others."""
    path = tmp_path_factory.mktemp("made") / "library.zarr"
    build_library(STUDY, path, workers=1, solve=solve_analytic)
    return path


def interrupting(count, done):
    """A progress callback that interrupts after a number of paths."""

    def progress(paths):
        done.append(paths)
        if sum(done) == count:
            raise KeyboardInterrupt

    return progress


def script(folder, body):
    """A program of its own, and the environment in which it finds the analytic
    solver.
    """
    path = folder / "program.py"
    path.write_text(
        "import sys; from pathlib import Path; from analytic_library import"
        " SolvesSome, solve_slowly\nfrom scleraforce.library.library_store import build_library,"
        " cached_library\nfrom scleraforce.records.study import LibraryStudy, Study\nif"
        f" __name__ == '__main__':\n    {body}\n"
    )

    return path, os.environ | {"PYTHONPATH": str(Path(__file__).parents[1] / "support")}


def test_a_library_is_read_as_it_was_solved(made):
    library = open_library(made)
    plan = plan_library(STUDY)
    assert library.thickness_m == pytest.approx(plan.thickness_m)
    assert (library.radius_m, library.poisson_ratio, library.needle_radius_m) == (
        12e-3,
        0.45,
        0.35e-3,
    )
    assert library.contact_polar_rad == pytest.approx(np.radians(35.0))

    for number in (0, 7, 15, 18, 63):
        force_d, displaced_d, curves_dbnc = solve_analytic(plan, number)
        of_tissue = library.for_stiffening(plan.stiffening[number // 16])
        place = divmod(number % 16, 4)
        assert np.array_equal(of_tissue.force_ratio_tpd[place], force_d)
        assert np.array_equal(of_tissue.displaced_tpd[place], displaced_d)
        assert np.array_equal(of_tissue.curves_tpdbnc()[place], curves_dbnc)
        assert np.array_equal(of_tissue.undented_tpbnc[place], curves_dbnc[0])


@pytest.mark.slow
def test_two_workers_and_an_interruption_change_no_byte(made, tmp_path):
    path = tmp_path / "library.zarr"
    rest = []

    with pytest.raises(KeyboardInterrupt):
        build_library(
            STUDY, path, workers=2, progress=interrupting(3, []), solve=solve_analytic
        )

    assert not multiprocessing.active_children()
    with pytest.raises(InputError, match="not complete"):
        open_library(path)

    result = build_library(
        STUDY, path, workers=2, progress=rest.append, solve=solve_analytic
    )
    assert (result.paths, result.solved, sum(rest)) == (UNITS, UNITS - 3, UNITS)
    assert contents(path) == contents(made)


@pytest.mark.skipif(
    find_spec("distributed") is None, reason="the extra [cluster] is not installed"
)
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
@pytest.mark.slow
def test_a_worker_of_a_cluster_that_is_killed_changes_no_byte(made, tmp_path):
    cluster = Cluster(tmp_path)
    done = []
    victim = cluster.worker()
    _ = cluster.worker()

    def kill_half_way(count):
        done.append(count)
        if sum(done) == 8:
            victim.send_signal(signal.SIGKILL)

    workers = cluster_workers(cluster.address)
    result = build_library(
        STUDY,
        tmp_path / "library",
        workers=workers,
        progress=kill_half_way,
        solve=solve_slowly,
    )
    cluster.end()
    assert victim.wait() == -signal.SIGKILL
    assert result.solved == sum(done) == UNITS
    assert contents(tmp_path / "library") == contents(made)


@pytest.mark.slow
def test_a_build_killed_at_any_time_is_completed(made, tmp_path):
    """A second program is killed, several times, by SIGKILL; the same command continues
    its work.
    """
    path = tmp_path / "library.zarr"
    program, environment = script(
        tmp_path,
        f"build_library(Study(library={GRID}), Path(sys.argv[1]), workers=2,"
        " solve=SolvesSome("
        "Path(sys.argv[2]), int(sys.argv[3])))",
    )

    for wanted in (1, 6):
        begun = tmp_path / f"begun{wanted}"
        begun.mkdir()
        child = subprocess.Popen(
            [sys.executable, program, path, begun, str(wanted)],
            env=environment,
            start_new_session=True,
        )
        wait_until(lambda: len(list(path.glob("force_ratio/c/*/*/*"))) >= wanted)  # noqa: B023 - called at once
        os.killpg(child.pid, signal.SIGKILL)
        assert child.wait() == -signal.SIGKILL

    result = build_library(STUDY, path, workers=2, solve=solve_analytic)
    assert result.solved < UNITS - 5
    assert contents(path) == contents(made)


def test_a_damaged_chunk_is_found(made, tmp_path):
    path = Path(shutil.copytree(made, tmp_path / "copy"))
    chunk = path / "curves" / "c" / "1" / "2" / "3" / "0" / "0" / "0" / "0"
    content = bytearray(chunk.read_bytes())
    content[100] ^= 1
    chunk.write_bytes(content)

    with pytest.raises(InputError, match="curves/c/1/2/3/0/0/0/0: damaged"):
        open_library(path)


@pytest.fixture(scope="module")
def copy(made, tmp_path_factory):
    return Path(shutil.copytree(made, tmp_path_factory.mktemp("copy") / "library.zarr"))


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("force_ratio", np.nan, "not finite"),
        ("displaced_m3", np.inf, "not finite"),
        ("curves", np.inf, "not finite"),
        ("thickness_m", 1.0, "thickness_m: not the values of its plan"),
        ("stiffening", 1.0, "stiffening: not the values of its plan"),
    ],
)
def test_impossible_values_and_other_axes_are_refused_even_where_the_hashes_agree(
    copy, name, value, said
):
    array = zarr.open_array(copy / name, mode="r+")
    sound = array[1]
    array[1] = value
    rehash_store(copy)
    with pytest.raises(InputError, match=said):
        open_library(copy)
    array[1] = sound
    rehash_store(copy)


def test_other_things_are_neither_overwritten_nor_read(made, tmp_path):
    with pytest.raises(InputError, match="complete library"):
        build_library(STUDY, made, solve=solve_analytic)

    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match="something else"):
        build_library(STUDY, tmp_path / "folder", solve=solve_analytic)

    with pytest.raises(InputError, match="no such library"):
        open_library(tmp_path / "nothing")

    with pytest.raises(KeyboardInterrupt):
        build_library(
            STUDY,
            tmp_path / "begun",
            workers=1,
            progress=interrupting(0, []),
            solve=solve_analytic,
        )

    other = Study(needle=NeedleStudy(outer_diameter_m=0.8e-3), library=STUDY.library)
    with pytest.raises(InputError, match="begun with another plan"):
        build_library(other, tmp_path / "begun", solve=solve_analytic)

    with pytest.raises(InputError, match="workers: 0"):
        build_library(STUDY, tmp_path / "x", workers=0)


@pytest.mark.slow
def test_a_path_that_fails_and_a_worker_that_dies_end_the_build(tmp_path):
    for solve, said in (
        (no_solution, "path 0 of 192: no equilibrium"),
        (no_worker, "worker ended"),
    ):
        with pytest.raises(SolverError, match=said):
            build_library(STUDY, tmp_path / solve.__name__, workers=1, solve=solve)


def test_the_default_covers_what_it_says():
    plan = plan_library(Study())
    lowest = 0.5 * 133.322 / 0.8e6
    highest = 5.0 * 133.322 / 0.12e6
    lowest_tension = lowest * 12e-3 / plan.thickness_m[-1]
    highest_tension = highest * 12e-3 / plan.thickness_m[0]
    assert plan.tension[0] < lowest_tension < highest_tension < plan.tension[-1]
    assert plan.grid.max_force_ratio_m2 == pytest.approx(60e-3 / 0.12e6)
    assert (np.diff(plan.tip_m, 2) > 0.0).all()


@pytest.mark.parametrize("unit", [6, 3 * 16 + 6])
def test_a_path_is_that_of_the_axisymmetric_wall(unit):
    plan = plan_library(STUDY)
    force_d, displaced_d, curves_dbnc = solve_path(plan, unit)
    planned = plan.path(6)
    wall = EvenWall(
        12e-3,
        planned.thickness_m,
        0.45,
        0.35e-3,
        stiffening=float(plan.stiffening[unit // 16]),
        size=MeridianSize(8, 1),
    )
    end = PathEnd(tips_m=plan.tip_m[1:], max_force=1e-6)
    expected = axisymmetric_path(wall, planned.iop_ratio, end)
    solved = len(expected.tip_m)
    assert solved >= 3
    assert np.array_equal(force_d[:solved], expected.force_ratio_m2)
    assert np.array_equal(displaced_d[:solved], expected.displaced_m3)
    assert curves_dbnc[:solved] == pytest.approx(expected.curves_sbnc, abs=1e-9)


def places(folder):
    return sorted(path.suffix for path in folder.iterdir())


@pytest.mark.slow
def test_a_library_is_built_on_first_need_only(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "scleraforce" / "libraries"
    done = []
    first = cached_library(STUDY, workers=1, progress=done.append, solve=solve_analytic)
    assert sum(done) == UNITS
    again = cached_library(STUDY, progress=done.append)
    assert sum(done) == UNITS
    assert (first.curves_tpdbnc() == again.curves_tpdbnc()).all()
    assert places(folder) == [".lock", ".zarr"]
    monkeypatch.setattr(LibraryPlan, "key", "another code")
    cached_library(STUDY, workers=1, solve=solve_analytic)
    assert len(list(folder.glob("*.zarr"))) == 2


@pytest.mark.slow
def test_a_damaged_library_and_a_useless_beginning_are_made_again(tmp_path):
    cached_library(STUDY, folder=tmp_path, workers=1, solve=solve_analytic)
    (place,) = tmp_path.glob("*.zarr")
    shutil.rmtree(place / "curves" / "c" / "1")
    (place.with_suffix(".begun")).mkdir()
    (place.with_suffix(".begun") / "rubbish").write_text("")
    done = []
    cached_library(
        STUDY, folder=tmp_path, workers=1, progress=done.append, solve=solve_analytic
    )
    assert sum(done) == UNITS
    assert places(tmp_path) == [".lock", ".zarr"]


@pytest.mark.slow
def test_one_of_several_makers_builds(tmp_path):
    program, environment = script(
        tmp_path,
        f"done = []; library = cached_library(Study(library={GRID}), folder=Path(sys.argv[1]),"
        " workers=1, progress=done.append, solve=solve_slowly); print(sum(done),"
        " library.force_ratio_tpd.sum())",
    )
    command = [sys.executable, program, tmp_path / "cache"]
    makers = [
        subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    answers = [maker.communicate(timeout=LIMIT_S)[0].split() for maker in makers]
    assert sorted(int(built) for built, _ in answers) == [0, 0, UNITS]
    assert len({total for _, total in answers}) == 1


def test_a_cache_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="XDG_CACHE_HOME"):
        cached_library(STUDY, folder=tmp_path / "file" / "below", solve=solve_analytic)
