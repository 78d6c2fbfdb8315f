"""The whole pipeline in one folder: virtual eyes, slices, network, answers, page (the
paper from end to end).

Each stage leaves its result in the folder; `reproduce.json` lists the finished stages
and a hash of the code. A later run with the same study reuses what is finished and does
the rest, so Ctrl-C loses one stage at most. Results of other code or of another reader
are not reused. Beside the paper's own stages are readings of walls at finite strain, by
the paper's method and by the force reader.
"""

import json
import shutil
import tempfile
import time
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, wait
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, fields, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from scleraforce.base.errors import InputError, StudyError
from scleraforce.base.version import __version__
from scleraforce.base.whole_files import KINDS, hash_sources, read_text, write_whole
from scleraforce.base.worker_processes import finished_result, work_beside
from scleraforce.lab.virtual_eye import paper_eyes
from scleraforce.library import Library
from scleraforce.library.library_store import cached_library
from scleraforce.reading.load_model import load_force_reader
from scleraforce.records.fields import field_key
from scleraforce.records.model_folder import (
    SHIPPED_READER,
    folder_study,
    read_folder,
    sha256,
)
from scleraforce.records.setup import Setup
from scleraforce.records.study import Range, Study, format_study, study_hash

Progress = Callable[[int], None]
# title and length of a bar -> its progress
Announce = Callable[[str, int], AbstractContextManager[Progress]]

STATE_FILE = "reproduce.json"
# Sources that decide the stored results: an edit costs one run. The page is drawn in
# every run.
SOURCES = (
    *(f"base/{name}.py" for name in ("normal_distribution", "onnx_network", "units")),
    "calibration",
    "fit",
    "lab",
    "library",
    "mechanics",
    "reading",
    "recordings",
    "records",
    "wall",
    *(f"front/paper/{name}.py" for name in ("run_folder", "stages")),
)
# Values that a reader is trained for. The bundled reader serves a study that has its
# values here.
TRAINED_FOR = {
    "eye": ("radius_m", "poisson_ratio"),
    "needle": ("outer_diameter_m",),
    **dict.fromkeys(("slice", "classes", "library", "reader")),
}


class Run:
    """One reproduction: its folder, study and processes, and the place of each result.

    `train`: train the force reader in this run instead of using the bundled one.
    """

    def __init__(
        self, folder: Path, study: Study, workers: int, train: bool = False
    ) -> None:
        self.folder = folder
        self.study = study
        self.workers = workers
        self.train = train
        self.recordings = folder / "recordings"  # of the virtual eyes
        # with forces up to the classes' bounds
        self.recordings_to_the_bounds = folder / "recordings-to-the-bounds"
        self.calibration = folder / "calibration.json"
        self.dataset = folder / "dataset"
        self.model = folder / "model"  # the paper's network
        # The same for the eyes at finite strain: a calibration as the paper makes it,
        # one on three frames of each eye, and the paper's network for the linear
        # modulus.
        self.bent_recordings = folder / "bent" / "recordings"
        self.bent_calibrations = folder / "bent" / "calibrations"
        self.bent_linear = self.bent_calibrations / "linear.json"
        self.bent_finite_strain = self.bent_calibrations / "finite-strain.json"
        self.bent_model = folder / "bent" / "model"
        self.reader = folder / "reader" if train else SHIPPED_READER
        self.report = folder / "report.html"
        self.overview = folder / "overview.png"  # the result in one picture

    def with_workers(self, workers: int) -> "Run":
        """Return the run with another number of processes."""
        return Run(self.folder, self.study, workers, self.train)


@dataclass(frozen=True)
class Stage:
    """A step of the pipeline: its name, the length of its progress bar, and its
    function.

    `leaves` is the result that a later run reuses; None: it is always done again. A
    stage that `resumes` continues its own unfinished result. The result of one
    `by_reader` depends on the force reader or its library. A stage `beside` others may
    be done in a second process, once the stage `after` is finished ("": at once) and
    those beside before it; its function is one of a module.
    """

    name: str
    length: Callable[[Run], int]
    work: Callable[[Run, Progress], object]
    leaves: Callable[[Run], Path] | None = None
    resumes: bool = False
    by_reader: bool = False
    beside: bool = False
    after: str = ""


def open_run(folder: Path, study: Study, workers: int, *, train: bool = False) -> Run:
    """Make or continue the folder of a reproduction.

    It raises `InputError` if the folder holds something else or was made from another
    study, `StudyError` if the bundled reader was trained for other values than the
    study's.
    """
    if not train:
        _check_bundled(study)

    run = Run(folder, study, workers, train)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            if _read_state(folder)["made_from"].get("study") != study_hash(study):
                raise InputError(
                    f"{folder}: made from another study; remove it or give a new folder"
                )
        else:
            (folder / "study.toml").write_text(format_study(study), encoding="utf-8")
            _write_state(run, {})
    except OSError as fault:
        raise InputError(f"{folder}: {fault.strerror}") from fault

    return run


def run_stages(
    run: Run,
    stages: tuple[Stage, ...],
    announce: Announce,
    tell: Callable[[str], object] = lambda _: None,
    note: Callable[[str], object] = lambda _: None,
) -> dict[str, float]:
    """Do the unfinished stages in order, or all of them if other code made the results
    in the folder.

    With two `workers` or more, half of them do the stages `beside` at the same time.
    `announce` opens a progress bar; `tell` is called with a line for the user if
    results of other code are removed, `note` with one for each stage that is done. It
    returns the seconds of each stage, for a finished stage from the run that did it.
    """
    made_from = _read_state(run.folder)["made_from"]
    if made_from.get("sources") != _sources():
        tell(
            f"{run.folder}: the code has changed since these results were made; all"
            " stages are done again"
        )
        _forget(run, stages, {})
    elif made_from.get("reader") != _reader_of(run):
        by_reader = {stage.name: stage for stage in stages if stage.by_reader}
        _forget(
            run,
            by_reader.values(),
            {
                n: value
                for n, value in seconds_so_far(run).items()
                if n not in by_reader
            },
        )

    seconds = seconds_so_far(run)
    unfinished = [
        stage
        for stage in stages
        if not (stage.name in seconds and stage.leaves and stage.leaves(run).exists())
    ]
    beside = [stage for stage in unfinished if stage.beside and run.workers > 1]
    half = run.workers // 2 if beside else 0
    here = run.with_workers(run.workers - half)

    def keep(taken_s: Mapping[str, float]) -> None:
        seconds.update((name, round(value, 2)) for name, value in taken_s.items())
        _write_state(run, seconds)

    with second_process(run.with_workers(half), beside) as second:
        try:
            for number, stage in enumerate(stages, start=1):
                if stage not in unfinished:
                    continue

                second.begin(seconds)
                title = f"{number}/{len(stages)} {stage.name}"
                with announce(title, stage.length(run)) as progress:
                    if stage in beside:
                        second.wait_for(stage, progress)
                    else:
                        keep({stage.name: _do(here, stage, progress)})

                keep(second.finished_s())
                note(f"{title}: {seconds[stage.name]:.1f} s")
        except KeyboardInterrupt:
            keep(second.finished_s())
            raise

    return {stage.name: seconds[stage.name] for stage in stages}


def _do(run: Run, stage: Stage, progress: Progress) -> float:
    """Do a stage; return the seconds that it took."""
    _clear(run, stage)
    start = time.perf_counter()
    stage.work(run, progress)
    return time.perf_counter() - start


def _clear(run: Run, stage: Stage) -> None:
    """Remove an unfinished result, unless the stage `resumes` it."""
    if stage.leaves and not stage.resumes:
        _remove(stage.leaves(run))


POLL_S = 0.2  # between two looks at the progress of the second process


class SecondProcess:
    """A process that does the stages `beside`, one after the other, while this one does
    the rest.

    Its progress is the size of a file for each stage: it grows by a byte a step.
    """

    def __init__(
        self,
        run: Run,
        stages: Sequence[Stage],
        submit: Callable[[int], "Future[float]"],
        steps: Path,
    ) -> None:
        self._run = run
        self._stages = stages
        self._submit = submit
        self._steps = steps
        self._begun: dict[str, Future[float]] = {}
        self._finished_s: dict[str, float] = {}

    def begin(self, finished: Container[str]) -> None:
        """Begin the stages in order, as far as they come `after` finished ones."""
        for number, stage in enumerate(self._stages):
            if stage.name in self._begun:
                continue
            if stage.after and stage.after not in finished:
                return

            _clear(self._run, stage)
            self._begun[stage.name] = self._submit(number)

    def wait_for(self, stage: Stage, progress: Progress) -> None:
        """Wait until a stage is finished; raise what it raised."""
        future = self._begun[stage.name]
        steps = self._steps / str(self._stages.index(stage))
        shown = 0
        finished = False

        while not finished:
            finished = bool(wait([future], POLL_S).done)
            count = steps.stat().st_size if steps.exists() else 0
            progress(count - shown)
            shown = count

        if fault := future.exception():
            raise fault

    def finished_s(self) -> dict[str, float]:
        """Return the seconds of the stages that have finished."""
        for name, future in self._begun.items():
            is_new = name not in self._finished_s and future.done()
            if is_new and not future.exception():
                self._finished_s[name] = finished_result(future)

        return self._finished_s


@contextmanager
def second_process(run: Run, stages: Sequence[Stage]) -> Iterator[SecondProcess]:
    """Give a process for stages, which ends with the block."""
    # its own processes may write there until they end
    with tempfile.TemporaryDirectory(
        prefix="scleraforce-", ignore_cleanup_errors=True
    ) as folder:
        works = [stage.work for stage in stages]
        # gives the function of a stage's number
        prepare = partial(partial, _do_beside, run, works, Path(folder))
        with work_beside(prepare) as submit:
            yield SecondProcess(run, stages, submit, Path(folder))


def _do_beside(
    run: Run,
    works: Sequence[Callable[[Run, Progress], object]],
    steps: Path,
    number: int,
) -> float:
    """Do a stage in the second process; return its seconds."""
    # it ends at once where this block is left: only the first process can remove files
    tempfile.tempdir = str(steps)
    with (steps / str(number)).open("ab", buffering=0) as file:

        def progress(count: int) -> None:
            file.write(bytes(count))

        start = time.perf_counter()
        works[number](run, progress)
        return time.perf_counter() - start


def _forget(run: Run, stages: Iterable[Stage], seconds: Mapping[str, float]) -> None:
    """Remove the results of stages, and keep the seconds of others; the last page stays
    until there is a new one.
    """
    for stage in stages:
        if stage.leaves:
            _remove(stage.leaves(run))
    _write_state(run, seconds)


def seconds_so_far(run: Run) -> dict[str, float]:
    """Return the seconds that each finished stage took."""
    return _read_state(run.folder)["seconds"]


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@cache
def _sources() -> str:
    return hash_sources(*SOURCES)


def _read_state(folder: Path) -> dict[str, dict[str, Any]]:
    path = folder / STATE_FILE
    if not path.exists():
        raise InputError(
            f"{folder}: not empty, and not made by `reproduce`; give a new folder"
        )

    try:
        state: dict[str, dict[str, Any]] = json.loads(read_text(path, KINDS["result"]))
        return {
            "seconds": dict(state["seconds"]),
            "made_from": dict(state["made_from"]),
        }
    except (ValueError, KeyError, TypeError) as fault:
        raise InputError(
            f"{path}: cannot be read; remove {folder} or give a new folder"
        ) from fault


def _write_state(run: Run, seconds: Mapping[str, float]) -> None:
    made_from = {
        "study": study_hash(run.study),
        "sources": _sources(),
        "reader": _reader_of(run),
    }
    content = {
        "made_from": made_from | {"version of scleraforce": __version__},
        "seconds": seconds,
    }
    write_whole(json.dumps(content, indent=2) + "\n", run.folder / STATE_FILE)


def _reader_of(run: Run) -> str:
    """Return "trained", or the hash of the bundled reader's record."""
    return (
        "trained" if run.train else sha256((SHIPPED_READER / "model.json").read_bytes())
    )


def _check_bundled(study: Study) -> None:
    bundled = folder_study(read_folder(SHIPPED_READER))
    for section, names in TRAINED_FOR.items():
        mine = getattr(study, section)
        its = getattr(bundled, section)

        for item in fields(mine):
            if (names is None or item.name in names) and getattr(
                mine, item.name
            ) != getattr(its, item.name):
                fault = (
                    "the bundled reader was trained for another value; `train` trains"
                    " one for this study"
                )
                raise StudyError(f"study: {section}.{field_key(item)}: {fault}")


def framed_for_laboratory(study: Study) -> Study:
    """Open the data set's framing ranges to where the study's virtual laboratory may
    put the eye.

    The paper proposes it as its next step (sec. 4, "randomly cropping each simulated
    image"). A pixel of the slice is left on every side: the unloaded wall of the data
    set is pressurised, which lifts it by up to that much.

    >>> framed_for_laboratory(Study()).dataset.framing_lateral_m
    Range(min=-0.0003, max=0.0003)
    """
    shift = study.phantom.eye_shift_m.bounds
    surface = study.phantom.surface_depth_m.bounds
    room = study.slice.pixel_m
    lateral, depth = (
        # Free of the last bits' rounding, so that the range's TOML reads back to the
        # same.
        Range(min=round(low - room, 9), max=round(high + room, 9))
        for low, high in (
            shift,
            (surface[side] + shift[side] - study.slice.margin_m for side in (0, 1)),
        )
    )

    return replace(
        study,
        dataset=replace(
            study.dataset, framing_lateral_m=lateral, framing_depth_m=depth
        ),
    )


CALIBRATED_EYES = 4  # of the five eyes, as in the paper (sec. 3.2, Table 2)
# forces of the pushes before the trials, up to the bound of danger
CALIBRATION_FORCES_N = (
    10e-3,
    20e-3,
    30e-3,
)


def bent_trials(study: Study) -> tuple[tuple[Setup, tuple[float, ...]], ...]:
    """Return the eyes of the paper's design with the forces of their calibration, then
    of their trials.
    """
    return tuple(
        (eye, (*CALIBRATION_FORCES_N, *forces_n)) for eye, forces_n in paper_eyes(study)
    )


def run_library(run: Run, progress: Progress | None = None) -> Library:
    """Return the bundled reader's library; if the run trains, the user's cached one
    (`progress` counts paths).
    """
    if not run.train:
        return load_force_reader(run.reader).library
    return cached_library(run.study, workers=run.workers, progress=progress)
