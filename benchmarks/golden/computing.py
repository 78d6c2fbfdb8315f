"""The pieces of work of all groups, computed in a few processes."""

import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from golden.answers import Answers
from golden.groups import calibrations, counts, imports, readings, sessions, walls
from golden.inputs import (
    ROOT,
    SHARED,
    VIRTUAL_EYES,
    make_recording,
    shared_recordings,
)

# Each number is computed in the same way whatever the machine's cores are.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
QUICK_MEMORY = ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_")

Task = tuple[str, str]  # a group, and the name of a piece of its work
Worker = Callable[[str, dict[str, Path], Path], Answers]

WORKER_OF: Mapping[str, Worker] = {
    "counts": counts.answers,
    "readings": readings.answers,
    "calibrations": calibrations.answers,
    "walls": walls.answers,
    "imports": imports.answers,
    "sessions": sessions.answers,
}
GROUPS = tuple(WORKER_OF)


def compute(
    groups: tuple[str, ...], workers: int, only_of: tuple[str, ...] = ()
) -> tuple[dict[str, Answers], list[str]]:
    """Return the answers of groups, all or of these eyes only, and what could not be
    computed.
    """
    for name in ONE_THREAD:
        os.environ[name] = "1"
    for name in QUICK_MEMORY:
        os.environ.setdefault(name, "1000000000")
    if not SHARED.is_dir():
        print(f"{SHARED}: absent; its recordings are left out", file=sys.stderr)
    context = multiprocessing.get_context("spawn")
    with (
        TemporaryDirectory(prefix="golden-") as place,
        ProcessPoolExecutor(workers, mp_context=context) as pool,
    ):
        folder = Path(place)
        recordings, failed = _recordings(pool, folder, groups, only_of)
        if failed:
            return {}, failed
        tasks = [
            (group, name)
            for group in groups
            for name in _names(group, recordings)
            if not only_of or name in only_of
        ]
        return _answers(pool, folder, tasks, recordings)


def _recordings(
    pool: ProcessPoolExecutor,
    folder: Path,
    groups: tuple[str, ...],
    only_of: tuple[str, ...],
) -> tuple[dict[str, Path], list[str]]:
    """Make the virtual recordings that groups need; add the shared ones."""
    of_recordings = {"counts", "readings", "calibrations", "walls"} & set(groups)
    if not of_recordings:
        return {}, []
    if of_recordings == {"counts"}:
        only_of = (counts.EYE,)
    several = calibrations.SEVERAL if calibrations.TOGETHER in only_of else ()
    of_eyes = {*several, *(name.partition(" ")[0] for name in only_of)}
    names = [name for name in VIRTUAL_EYES if not only_of or name in of_eyes]
    made = {pool.submit(make_recording, name, folder / name): name for name in names}
    failed = []
    for done in as_completed(made):
        _say(f"recording {made[done]}")
        if (fault := done.exception()) is not None:
            failed.append(f"recording {made[done]}: {fault}")
    return {name: folder / name for name in names} | shared_recordings(), failed


def _answers(
    pool: ProcessPoolExecutor,
    folder: Path,
    tasks: list[Task],
    recordings: dict[str, Path],
) -> tuple[dict[str, Answers], list[str]]:
    submitted = {pool.submit(work, task, recordings, folder): task for task in tasks}
    found: dict[str, Answers] = {group: {} for group, _ in tasks}
    failed = []
    for number, done in enumerate(as_completed(submitted), start=1):
        group, name = submitted[done]
        if (fault := done.exception()) is not None:
            failed.append(f"{group} of {name}: {fault!r}")
            _say(f"{number} of {len(tasks)}: {failed[-1]}")
        else:
            answers, seconds = done.result()
            found[group] |= answers
            _say(f"{number} of {len(tasks)}: {group} of {name}, {seconds:.0f} s")
    return found, failed


def _names(group: str, recordings: Mapping[str, Path]) -> list[str]:
    """Return the names of a group's pieces of work, the longest first."""
    shared = SHARED.is_dir()
    return {
        "counts": [counts.EYE],
        "readings": readings.names(recordings, VIRTUAL_EYES),
        "calibrations": [calibrations.TOGETHER, *recordings],
        "walls": [*([walls.REAL] if shared else []), *recordings],
        "imports": [imports.ALL] if shared else [],
        "sessions": sessions.names(),
    }[group]


def work(
    task: Task, recordings: dict[str, Path], folder: Path
) -> tuple[Answers, float]:
    """Compute one piece of work; return its answers, without this run's folders in any
    words, and the seconds.
    """
    start_s = perf_counter()
    group, name = task
    answers = WORKER_OF[group](name, recordings, folder)
    text = json.dumps(answers)
    for path, words in ((folder, ""), (SHARED, "shared"), (ROOT, "")):
        text = text.replace(f"{path}/", f"{words}/").replace(str(path), words)
    clean: dict[str, Any] = json.loads(text)
    return clean, perf_counter() - start_s


def _say(words: str) -> None:
    print(words, file=sys.stderr, flush=True)
