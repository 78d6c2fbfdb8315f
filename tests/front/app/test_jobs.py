"""Jobs in worker processes: their progress, their results, their faults, and their
end.
"""

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from running_app import Client, spelled
from small_recordings import write_pushes, write_small_recording
from waiting import alive, wait_until

import scleraforce as sf
from scleraforce.base.errors import InputError
from scleraforce.base.kept_results import kept_result
from scleraforce.base.notebook_cards import tidy
from scleraforce.front.app import job_worker, running_jobs
from scleraforce.front.app.job_messages import (
    EvaluateJob,
    Failed,
    Finished,
    FromWorker,
    Noted,
    Progressed,
)
from scleraforce.front.app.running_jobs import RunningJob

# A worker in place of the real one: it takes the job, and `code` does the rest. It
# imports nothing of ours, which would take half a second: messages come pickled.
STAND_IN = """
import os, signal, sys, time
from multiprocessing.connection import Connection
connection = Connection(int(sys.argv[1]))
connection.recv_bytes()
"""
ANY_JOB = EvaluateJob(model="default", recordings=("small",))
Start = Callable[[str], RunningJob]


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Start]:
    jobs = list[RunningJob]()

    def start(code: str) -> RunningJob:
        command = (sys.executable, "-c", STAND_IN + code)
        monkeypatch.setattr(running_jobs, "WORKER", command)
        kept = tmp_path / "kept" / "evaluate.kept"
        words = ["evaluate", "default", "small"]
        jobs.append(RunningJob.started(ANY_JOB, words, tmp_path, kept, spelled()))
        return jobs[-1]

    yield start
    for job in jobs:
        job.cancel()
        wait_until(lambda job=job: job.done)


def sends(*messages: FromWorker) -> str:
    """Return the code of a worker that sends messages."""
    pickled = map(pickle.dumps, messages)
    return "".join(f"connection.send_bytes({message!r})\n" for message in pickled)


def ended(app: Client, **asked: Any) -> dict[str, Any]:
    """Run a job of the real worker to its end; return how it ended."""

    def job() -> dict[str, Any]:
        return app.json("GET", f"/api/state?tab={app.tab}")["job"]

    number = app.json("POST", "/api/run", asked)["job"]
    wait_until(lambda: job()["done"])
    assert job()["number"] == number
    return job()


# ---- what comes from a worker


def test_progress_notes_and_a_result_come_as_messages(
    started: Start, tmp_path: Path
) -> None:
    told = Finished({"notes": ["`gap_m` is missing"]}, ({"file": "a"},))
    first = sends(Progressed("frames", 1, 4), Noted("give `width_m`"))
    job = started(first + sends(Progressed("frames", 2, 4), told))
    wait_until(lambda: job.done)
    assert (job.title, job.share, job.fault) == ("frames", 0.5, None)
    assert job.as_json()["notes"] == ["give --width-mm"]
    kept = kept_result(tmp_path / "kept" / "evaluate.kept")
    assert kept["command"] == "scleraforce evaluate default small"
    assert kept["result"] == {"notes": ["--gap-mm is missing"]}
    assert (kept["rows"], kept["model"]) == ([{"file": "a"}], "default")
    assert kept["calibration"] is None


def test_a_fault_names_the_flags_of_its_command(started: Start) -> None:
    job = started(sends(Failed("calibration: give `gap_m`")) + "sys.exit(1)")
    wait_until(lambda: job.done)
    assert job.fault == "--calibration: give --gap-mm"


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("os.kill(os.getpid(), signal.SIGKILL)", "killed (SIGKILL), as systems do"),
        ("os.kill(os.getpid(), signal.SIGSEGV)", "crashed (SIGSEGV)"),
        ("sys.exit(3)", "exit code 3, without a result"),
        # in the middle of a message
        ("os.write(int(sys.argv[1]), b'\\x00\\x00\\x01\\x00half'); os._exit(4)", "4"),
    ],
)
def test_a_worker_that_dies_is_a_clear_fault(
    started: Start, tmp_path: Path, code: str, words: str
) -> None:
    job = started(code)
    wait_until(lambda: job.done)
    assert (job.fault or "").startswith("evaluate: its process ")
    assert words in (job.fault or "")
    assert not (tmp_path / "kept").exists()


def test_what_a_dead_worker_had_started_ends_too(
    started: Start, tmp_path: Path
) -> None:
    job = started(
        "import subprocess\n"
        "other = subprocess.Popen(['sleep', '600'])\n"
        "open('pid', 'w').write(str(other.pid))\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    wait_until(lambda: job.done)
    other = int((tmp_path / "pid").read_text())
    wait_until(lambda: not alive(other))


def test_a_result_that_cannot_be_kept_is_a_fault(
    started: Start, tmp_path: Path
) -> None:
    (tmp_path / "kept").write_text("a file in place of the folder")
    job = started(sends(Finished({})))
    wait_until(lambda: job.done)
    assert "kept" in (job.fault or "")


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (OSError(28, "No space left", "out/part"), "out/part: No space left"),
        (OSError(28, "No space left"), "No space left"),
        (MemoryError(), "not enough memory"),
        (InputError("a: b"), "a: b"),
        (KeyError("a"), "internal fault: KeyError"),
    ],
)
def test_each_fault_of_a_job_is_one_line(fault: BaseException, words: str) -> None:
    assert job_worker.fault_words(fault).startswith(words)


# ---- how a worker ends


BEGUN = sends(Progressed("frames", 0, 4))


def test_a_job_is_stopped_as_by_ctrl_c_and_once(started: Start, tmp_path: Path) -> None:
    job = started(
        f"try:\n    {BEGUN}    time.sleep(600)\n"
        "except KeyboardInterrupt:\n    open('cleaned', 'w')\n    sys.exit(130)"
    )
    wait_until(lambda: bool(job.title))
    job.cancel()
    job.cancel()
    wait_until(lambda: job.done)
    assert job.fault == "stopped"
    assert (tmp_path / "cleaned").exists()
    job.cancel()  # one that has ended already


def test_a_worker_that_does_not_stop_is_killed(
    started: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running_jobs, "KILL_S", 0.1)
    job = started(
        f"signal.signal(signal.SIGINT, signal.SIG_IGN)\n{BEGUN}time.sleep(600)"
    )
    wait_until(lambda: bool(job.title))
    job.cancel()
    wait_until(lambda: job.done)
    assert job.fault == "stopped"


@pytest.mark.slow
def test_a_worker_does_not_outlive_an_app_that_is_killed(tmp_path: Path) -> None:
    """The real worker, waiting in a recording's pipe; its app is another process."""
    recording = write_small_recording(tmp_path / "small", frames=2)
    (recording / "frames" / "0000.png").unlink()
    app = subprocess.Popen(
        [sys.executable, "-c", APP, str(tmp_path)],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parent,
    )
    assert app.stdout is not None
    try:
        worker = int(app.stdout.readline())
        assert app.stdout.readline() == "it works\n"
        assert alive(worker)
        app.send_signal(signal.SIGKILL)
        wait_until(lambda: not alive(worker))
        wait_until(lambda: not any(tmp_path.glob(".scleraforce-*.part")))
    finally:
        app.kill()
        app.wait()
        app.stdout.close()
        with suppress(ProcessLookupError):
            os.killpg(worker, signal.SIGKILL)


# It replaces the work by a sleep in a folder that is half-written.
APP = """
import sys, time
from pathlib import Path
from scleraforce.front.app import running_jobs
from scleraforce.front.app.asked_jobs import CommandWords
from scleraforce.front.app.job_messages import CalibrateJob
from scleraforce.front.app.running_jobs import RunningJob
SLOW = '''
import sys, time
from pathlib import Path
from scleraforce.base.whole_files import folder_when_whole
from scleraforce.front.app import job_worker
def slow(job, send, worded):
    with folder_when_whole(Path("out")) as part:
        part.mkdir()
        send(job_worker.Progressed("frames", 1, 2))
        time.sleep(600)
job_worker.finished = slow
sys.exit(job_worker.main())
'''
running_jobs.WORKER = (sys.executable, "-c", SLOW)
folder = Path(sys.argv[1])
asked = CalibrateJob(recordings=("small",), out="e.json")
words = CommandWords(str, str)
job = RunningJob.started(asked, ["calibrate"], folder, folder / "kept", words)
print(job._process.pid, flush=True)
while not job.title:
    time.sleep(0.01)
print("it works", flush=True)
time.sleep(600)
"""


# ---- the same as the commands


@pytest.fixture
def same(
    served: Client,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    shell,
    undrawn,  # noqa: ARG001 - the worker draws the picture of an import
):
    """Run a job, and the command that it shows, with another output; assert that both
    give the same, and return what is kept.
    """

    def run(pages: str = "", **asked: Any) -> Any:
        line = served.json("POST", "/api/words", asked)["command"]
        assert ended(served, **asked)["fault"] is None
        kept = kept_result(tmp_path / ".scleraforce" / f"{asked['command']}.kept")
        words = line.removeprefix("scleraforce ").replace(pages, "")
        monkeypatch.chdir(tmp_path)
        printed = shell.json(words.replace("--out=ours", "--out=theirs"))
        for name in {"recording", "preview"} & {*printed}:
            printed[name] = printed[name].replace("theirs", "ours")
        assert kept["result"] == printed
        return kept

    return run


def write_scan(folder: Path) -> None:
    """Write a stack and a log that state little."""
    stack = np.random.default_rng(0).integers(0, 4096, (5, 32, 48), dtype=np.uint16)
    tifffile.imwrite(folder / "scan.tif", stack, photometric="minisblack")
    time_s = np.arange(0.0, 3.0, 0.01)
    log = np.column_stack([time_s, 0.02 * np.sin(time_s) ** 2])
    np.savetxt(folder / "log.csv", log, "%.4f", ",", header="time_s,pull", comments="")


OF_SCAN = {
    "command": "import",
    "operands": ["scan.tif", "log.csv"],
    "out": "ours",
    "columns": ["fz=pull:N"],
}
ANSWERS = {
    "width_mm": 15.0,
    "depth_mm": 4.0,
    "bits": 12,
    "rate_hz": 2.0,
    "clock_offset_s": 0,
    "axis": "fz",
    "contact_sign": "1",
    "average_s": 0.1,
}
OF_EYE = {
    "eye": "mine",
    "gauge": 22,
    "gap_mm": 0.5,
    "refractive_index": 1.0,
    "thickness_um": 650.0,
    "iop_mmhg": 15.0,
    "globe": "open",
    "polar_angle_deg": 10.0,
    "relaxation": "none",
    "range_n": 2.0,
    "first_frame": 2,
    "last_frame": 4,
    "flip": "rows",
}


@pytest.mark.slow
def test_an_import_gives_what_the_command_prints(same, tmp_path: Path) -> None:
    write_scan(tmp_path)
    same(**OF_SCAN, options=ANSWERS | OF_EYE)
    ours, theirs = (sf.read_recording(tmp_path / name) for name in ("ours", "theirs"))
    assert (ours.info, ours.frames) == (theirs.info, theirs.frames)
    assert len(ours.frames) == 3
    assert (ours.info.eye.name, ours.info.force.range_n) == ("mine", 2.0)
    assert ours.info.eye.thickness_m == pytest.approx(650e-6)


def test_a_job_that_fails_leaves_nothing_and_runs_no_module_of_the_folder(
    served: Client, tmp_path: Path
) -> None:
    write_scan(tmp_path)
    for name in ("click", "pydantic", "cv2"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w')")
    before = sorted(tmp_path.iterdir())
    job = ended(served, **OF_SCAN, options=ANSWERS)
    assert "--refractive-index" in job["fault"]
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.slow
def test_calibration_and_evaluation_give_what_the_commands_print(
    same, tmp_path: Path
) -> None:
    write_pushes(tmp_path / "mine", "eye-a")
    calibrated = {"command": "calibrate", "operands": ["mine"]}
    options = {"frames": 2, "parameters": "e", "thickness_um": 640}
    same(**calibrated, out="ours.json", options=options)
    without_force = {"calibration": "ours.json", "without_force": True}
    same(**calibrated, out="ours-2.json", options={"frames": 2, **without_force})
    kept = same(
        " --html=page.html",
        command="evaluate",
        operands=["default", "mine"],
        options={"calibration": "ours.json", "html": "page.html"},
    )
    times = [entry.time_s for entry in sf.read_recording(tmp_path / "mine").frames]
    assert [row["time_s"] for row in tidy(kept["rows"])] == times
    assert (tmp_path / "page.html").read_text().startswith("<!DOCTYPE html>")
