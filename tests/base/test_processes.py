"""Workers and machine code: units and their results, signals, faults; loops compiled
once and loaded.
"""

import json
import multiprocessing
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
from functools import partial
from multiprocessing import resource_tracker, spawn
from pathlib import Path

import pytest
import workers as tasks
from waiting import LIMIT_S, alive, wait_until
from workers import NEEDS_DASK, Cluster, large, no_preparation, tripled, waits_for_ever

import scleraforce
from scleraforce.base import worker_processes
from scleraforce.base.compiled_loops import compiled
from scleraforce.base.errors import InputError, SolverError
from scleraforce.base.worker_processes import (
    cluster_workers,
    work_in_order,
    work_units,
)

SOURCES = Path(scleraforce.__file__).parents[1]
HEAVY = partial(tripled, bytes(2**20))  # more than a pipe holds
SLOW = partial(tripled, late_s=0.2)

PROGRAM = """
from scleraforce.base.worker_processes import work_units

def double():
    return lambda unit: 2 * unit

if __name__ == "__main__":
    print(sorted(work_units(double, range(3), 1)))
"""
LEFT_ALONE = """
import sys
from functools import partial
from pathlib import Path
from workers import waits_for_ever
from scleraforce.base.worker_processes import work_units

if __name__ == "__main__":
    list(work_units(partial(waits_for_ever, Path(sys.argv[1])), range(3), 2))
"""


def on_cluster(test):
    for mark in (*NEEDS_DASK, pytest.mark.slow):
        test = mark(test)
    return test


def test_units_are_handed_out_from_the_first_on():
    assert list(work_units(tripled, range(5), 1)) == [(n, 3 * n) for n in range(5)]
    assert list(work_units(tripled, [7], 4)) == [(7, 21)]


@pytest.fixture
def no_interpreter():
    """Let no worker start, as if the interpreter could not be read."""
    resource_tracker.ensure_running()
    before = spawn.get_executable()
    spawn.set_executable("/bin/false")
    yield
    spawn.set_executable(before)


@pytest.mark.usefixtures("no_interpreter")
def test_workers_that_die_at_their_start_are_an_error_and_not_a_hang():
    for work in (work_units, partial(work_in_order, ahead=2)):
        with pytest.raises(SolverError, match=r"a worker (ended|could not be started)"):
            list(work(HEAVY, range(3), 2))
        assert not multiprocessing.active_children()


@pytest.mark.parametrize(
    ("prepare", "kind", "words"),
    [
        (no_preparation, InputError, "this eye is too small"),
        (tasks.fails_oddly, SolverError, "OddError in a worker: 7 and this"),
        (tasks.ends_its_process, SolverError, "a worker ended"),
    ],
)
def test_what_a_worker_raises_reaches_the_caller(prepare, kind, words):
    with pytest.raises(kind, match=words):
        list(work_units(prepare, [7], 1))


def test_results_come_in_the_order_of_the_units():
    assert list(work_in_order(HEAVY, range(5, 12), 2, ahead=3)) == [
        3 * unit for unit in range(5, 12)
    ]
    assert list(work_in_order(HEAVY, [], 2, ahead=3)) == []


def test_a_worker_continues_while_the_caller_has_a_result(tmp_path):
    results = work_in_order(
        partial(tasks.leave_a_mark_for_each, tmp_path), range(4), 1, ahead=2
    )
    for unit in results:
        if unit < 3:
            # before the caller comes back
            wait_until((tmp_path / str(unit + 1)).exists)


def test_workers_end_in_the_midst_of_a_unit_when_the_caller_leaves(tmp_path):
    results = work_units(partial(waits_for_ever, tmp_path), range(2), 2)
    next(results)
    results.close()
    assert not multiprocessing.active_children()


def test_a_worker_that_ends_while_it_passes_on_a_large_result_does_not_hang_the_caller(
    tmp_path,
):
    results = work_units(partial(large, tmp_path, 5 * 10**7), range(4), 2)
    done, _ = next(results)
    wait_until(lambda: {path.name for path in tmp_path.iterdir()} > {str(done)})
    results.close()
    assert not multiprocessing.active_children()


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="the system has no SIGKILL")
def test_workers_end_when_their_parent_is_killed(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(LEFT_ALONE)
    paths = os.environ | {
        "PYTHONPATH": str(Path(waits_for_ever.__code__.co_filename).parent)
    }
    parent = subprocess.Popen([sys.executable, str(program), str(tmp_path)], env=paths)
    marks = list[Path]()
    wait_until(
        lambda: (
            marks.extend(mark for mark in tmp_path.glob("pid*") if mark.read_text())
            or bool(marks)
        )
    )
    parent.kill()
    parent.wait()
    wait_until(lambda: not alive(int(marks[0].read_text())))


def test_no_module_of_the_current_folder_runs_in_a_worker(tmp_path):
    (tmp_path / "here").mkdir()
    for name in ("signal", "json", "numpy", "multiprocessing", "pickle", "struct"):
        (tmp_path / "here" / f"{name}.py").write_text(
            f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\n"
        )

    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    safe = {
        name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"
    }
    done = subprocess.run(
        [sys.executable, str(program)],
        cwd=tmp_path / "here",
        env=safe,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
    )
    assert (done.stdout, done.stderr) == ("[(0, 0), (1, 2), (2, 4)]\n", "")
    assert not (tmp_path / "ran").exists()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    """A cluster of two workers that come back after each death."""
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    made.worker("--nanny")
    made.worker("--nanny")
    yield made
    made.end()


@pytest.fixture
def mortal(tmp_path):
    """A cluster whose parts a test kills; it has no workers yet."""
    made = Cluster(tmp_path)
    yield made
    made.end()


@on_cluster
def test_a_cluster_does_each_unit_once_and_in_order_on_request(
    cluster,
):
    workers = cluster_workers(cluster.address)
    assert dict(work_units(SLOW, range(5, 12), workers)) == {
        unit: 3 * unit for unit in range(5, 12)
    }
    assert list(work_in_order(SLOW, range(12, 5, -1), workers, ahead=3)) == [
        36 - 3 * n for n in range(7)
    ]
    assert list(work_units(SLOW, [], workers)) == []
    assert list(work_in_order(SLOW, [], workers, ahead=3)) == []


@on_cluster
def test_a_cluster_drops_the_units_of_a_caller_that_leaves(cluster, tmp_path):
    gate = tmp_path / "gate"
    workers = cluster_workers(cluster.address)
    work = work_units(partial(tasks.waits_at, gate), range(10_000), workers)
    next(work)
    work.close()
    wait_until(lambda: cluster.tasks() == 0)
    gate.touch()
    assert dict(work_units(SLOW, [1], workers)) == {1: 3}


@on_cluster
def test_a_failure_on_a_cluster_reaches_the_caller(cluster, monkeypatch):
    workers = cluster_workers(cluster.address)
    with pytest.raises(InputError, match="this eye is too small"):
        list(work_units(no_preparation, range(3), workers))

    with pytest.raises(InputError, match="this eye is too small"):
        list(work_in_order(no_preparation, range(3), workers, ahead=2))

    with pytest.raises(SolverError, match="die one after the other"):
        list(work_units(tasks.ends_its_process, [7], workers))

    monkeypatch.setattr(worker_processes, "__version__", "0.0.1")
    with pytest.raises(
        InputError, match=r"a worker has scleraforce \d.*, this process 0\.0\.1"
    ):
        list(work_units(SLOW, [1], workers))


@on_cluster
def test_work_waits_for_workers_and_outlives_one(mortal):
    workers = cluster_workers(mortal.address)
    assert workers == 1
    victim = mortal.worker()
    _ = mortal.worker()
    results = []

    for result in work_in_order(SLOW, range(60), workers, ahead=20):
        results.append(result)
        if len(results) == 5:
            victim.send_signal(signal.SIGKILL)

    assert results == [3 * unit for unit in range(60)]
    assert victim.wait() == -signal.SIGKILL


@on_cluster
def test_a_scheduler_that_ends_is_one_clear_error(mortal):
    mortal.worker()
    done = work_units(SLOW, range(10_000), cluster_workers(mortal.address))
    next(done)
    mortal.scheduler.kill()
    with pytest.raises(SolverError, match="the scheduler has ended"):
        list(done)


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_no_scheduler_is_bad_input(monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(worker_processes, "CONNECT_S", 0.1)
    with pytest.raises(
        InputError, match=re.escape("no Dask scheduler answers at tcp://127.0.0.1:9")
    ):
        cluster_workers("tcp://127.0.0.1:9")


LOOPS = """
import numpy as np
from scleraforce.base.compiled_loops import compiled

@compiled
def square(x):
    return x * x

@compiled
def norm(values):
    total = 0.0
    for row in range(values.shape[0]):
        total += square(np.sin(values[row])) / 3.0
    return np.sqrt(total)

@compiled
def late(values):
    doubled = np.empty_like(values)
    for row in range(values.shape[0]):
        doubled[row] = 2.0 * values[row]
    return norm(doubled) + norm(values)
"""
CALL = """
import json, sys
import numpy as np
from loops import late, norm
values = np.linspace(0.1, 2.0, 101)
found = [norm(values).hex()]
if "late" in sys.argv:
    found += [late(values.astype(np.float32)).hex(), float(norm(values.astype(np.float32))).hex()]
imported = [name for name in ("numba.np.arraymath", "numba.np.arrayobj") if name in sys.modules]
print(json.dumps([found, imported]))
"""


def call(folder, *words):
    """Run the loops in a process: what they return, the modules of the compiler that
    they import, and what is said.
    """
    environment = {
        **os.environ,
        "XDG_CACHE_HOME": str(folder / "cache"),
        "PYTHONPATH": os.pathsep.join([str(folder), str(SOURCES)]),
    }
    done = subprocess.run(
        [sys.executable, "-c", CALL, *words],
        env=environment,
        cwd=folder,
        capture_output=True,
        check=True,
    )
    return *json.loads(done.stdout), done.stderr.decode()


@pytest.fixture(scope="module")
def once(tmp_path_factory):
    """A folder of loops that were compiled, and what the first call gave; settings in
    it that switch compiling off are not read.
    """
    folder = tmp_path_factory.mktemp("loops")
    (folder / "loops.py").write_text(LOOPS)
    (folder / ".numba_config.yaml").write_text("disable_jit: 1\n}{")
    return folder, call(folder)


@pytest.fixture
def loops(tmp_path, once):
    """A copy of the same sources and code, at another place and time."""
    shutil.copyfile(once[0] / "loops.py", tmp_path / "loops.py")
    shutil.copytree(once[0] / "cache", tmp_path / "cache")
    return tmp_path


def test_machine_code_is_compiled_once_and_anew_if_more_is_needed(once, loops):
    first, _, first_notice = once[1]
    assert "compiling, once" in first_notice
    with_late, _, notice = call(loops, "late")
    assert notice.count("compiling, once") == 1
    assert with_late[:1] == first
    # loaded, without an import of the compiler's modules
    assert call(loops, "late") == (with_late, [], "")


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "left"), [("nbi", 0), ("nbi", 20), ("nbc", 100)])
def test_cut_machine_code_is_compiled_anew(once, loops, suffix, left):
    (file,) = (loops / "cache").rglob(f"*norm*.{suffix}")
    file.write_bytes(file.read_bytes()[:left])
    found, _, notice = call(loops)
    assert (found, notice) == (once[1][0], "compiling, once: half a minute\n")


@pytest.mark.slow
def test_loops_run_where_no_machine_code_can_be_kept(once, loops):
    shutil.rmtree(loops / "cache")
    (loops / "cache").write_bytes(b"")
    found, _, notice = call(loops)
    assert found == once[1][0]
    assert notice.count("note: ") == 1


@pytest.mark.slow
def test_a_numba_whose_private_parts_are_not_known_compiles_and_keeps_by_itself(
    once, loops
):
    shutil.rmtree(loops / "cache")
    newer = "import numba; numba.__version__ = '99.0.0'\n"
    (loops / "loops.py").write_text(newer + LOOPS)
    kept = []
    for _ in range(2):
        found, _, notice = call(loops)
        assert found == once[1][0]
        assert notice.startswith("note: Numba 99.0.0: loops compile in minutes")
        codes = (loops / "cache").rglob("*.nbc")
        kept.append({code: code.stat().st_mtime_ns for code in codes})
    assert kept[0] == kept[1] != {}


def planted(folder, marker):
    """Put a pickle that makes a folder into each file of machine code."""

    class Bomb:
        def __reduce__(self):
            return os.mkdir, (str(marker),)

    for code in [*folder.rglob("*.nbi"), *folder.rglob("*.nbc")]:
        code.write_bytes(pickle.dumps(Bomb()))


def code_folder(cache):
    (folder,) = {code.parent for code in cache.rglob("*.nbc")}
    return folder


def linked_elsewhere(folder):
    folder.rename(folder.parent / "moved")
    folder.symlink_to(folder.parent / "moved")


def links_for_files(folder):
    (folder / "real").mkdir()
    for file in [*folder.glob("*.nb?")]:
        file.rename(folder / "real" / file.name)
        file.symlink_to(folder / "real" / file.name)


STRANGER = 54321  # a user's number


def given_away(path):
    os.chown(path, STRANGER, -1)


as_root = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away"
)


of_unix = pytest.mark.skipif(os.name != "posix", reason="modes of Unix")


@of_unix
@pytest.mark.parametrize(
    ("spoil", "noted"),
    [
        (lambda folder: folder.chmod(0o777), "others can write to it"),
        pytest.param(
            lambda folder: [given_away(file) for file in folder.iterdir()],
            "compiling, once",
            marks=[as_root, pytest.mark.slow],
        ),
        pytest.param(links_for_files, "compiling, once", marks=pytest.mark.slow),
    ],
)
def test_machine_code_that_others_could_have_written_is_not_loaded(
    once, loops, spoil, noted
):
    folder = code_folder(loops / "cache")
    assert folder.stat().st_mode & 0o777 == 0o700
    planted(folder, loops / "owned")
    spoil(folder)
    again, _, notice = call(loops)
    assert again == once[1][0]
    assert not (loops / "owned").exists()
    assert noted in notice


@of_unix
@pytest.mark.parametrize(
    ("spoil", "fault"),
    [
        (lambda folder: folder.chmod(0o770), "others can write to it"),
        (lambda folder: folder.parent.chmod(0o777), "everybody can replace"),
        (lambda folder: folder.parents[2].chmod(0o777), "everybody can replace"),
        (linked_elsewhere, "not a folder"),
        pytest.param(given_away, "belongs to another user", marks=as_root),
    ],
    ids=range(5),
)
def test_a_folder_that_others_could_write_to_is_named(
    loops, monkeypatch, capsys, request, spoil, fault
):
    """The first case of the test above shows that code of such a folder is not
    loaded.
    """

    def square(x):
        return x * x

    square.__module__ = f"squares{request.node.callspec.id}"  # looked up once each
    monkeypatch.setenv("XDG_CACHE_HOME", str(loops / "cache"))
    folder = code_folder(loops / "cache")
    own = folder.with_name(folder.name.replace("loops", square.__module__))
    spoil(folder.rename(own))
    compiled(square)
    assert f"{own}: {fault}" in capsys.readouterr().err


@pytest.mark.slow
def test_machine_code_of_the_user_is_loaded(loops):
    """The bomb of the test above goes off where its file is the user's own."""
    planted(code_folder(loops / "cache"), loops / "owned")
    call(loops)
    assert (loops / "owned").exists()


@pytest.mark.slow
def test_settings_of_plots_in_the_current_folder_are_not_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "matplotlibrc").write_bytes(b"font.size: 3\n\xff")
    draw = "from scleraforce.front.cli.main import main; main()"
    words = ["show", "paper", "--plot", "paper.svg"]
    subprocess.run([sys.executable, "-P", "-c", draw, *words], check=True)
    assert (tmp_path / "paper.svg").exists()
