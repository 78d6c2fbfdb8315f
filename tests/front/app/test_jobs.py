"""Jobs in worker processes: their progress, their results, their faults, and their
end.
"""

import json
import os
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
from running_app import SPELLED
from small_recordings import write_pushes, write_small_recording
from waiting import alive, wait_until

import scleraforce as sf
from scleraforce.base.errors import InputError
from scleraforce.base.kept_results import kept_result
from scleraforce.base.notebook_cards import tidy
from scleraforce.front.app import job_worker, running_jobs
from scleraforce.front.app.asked_jobs import (
    OPTIONS,
    CommandRequest,
    job_of,
    words_of,
)
from scleraforce.front.app.job_messages import EvaluateJob
from scleraforce.front.app.running_jobs import RunningJob
from scleraforce.front.app.work_folder import Folder
from scleraforce.front.cli.main import run as run_command

# A worker in place of the real one: it takes the job, and `code` does the rest.
STAND_IN = """
import os, signal, sys, time
from multiprocessing.connection import Connection
from scleraforce.front.app.job_messages import *
connection = Connection(int(sys.argv[1]))
job, spelled = connection.recv()
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
        jobs.append(RunningJob.started(ANY_JOB, words, tmp_path, kept, SPELLED))
        return jobs[-1]

    yield start
    for job in jobs:
        job.cancel()
        wait_until(lambda job=job: job.done)


def ended(folder: Path, **asked: Any) -> RunningJob:
    """Run a job of the real worker in a folder to its end."""
    request = CommandRequest(**asked)
    job = RunningJob.started(
        job_of(request, Folder(folder.resolve())),
        words_of(request, SPELLED),
        folder,
        folder / ".scleraforce" / f"{request.command}.kept",
        SPELLED,
    )
    wait_until(lambda: job.done)
    return job


def printed(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    *words: str,
) -> Any:
    """Return what a command prints as JSON in a folder."""
    monkeypatch.chdir(folder)
    assert run_command([*words, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


# ---- what comes from a worker


def test_progress_notes_and_a_result_come_as_messages(
    started: Start, tmp_path: Path
) -> None:
    job = started(
        "connection.send(Progressed('frames', 1, 4))\n"
        "connection.send(Noted('give `width_m`'))\n"
        "connection.send(Progressed('frames', 2, 4))\n"
        "connection.send(Finished({'notes': ['`gap_m` is missing']}, ({'file': 'a'},)))"
    )
    wait_until(lambda: job.done)
    assert (job.title, job.share, job.fault) == ("frames", 0.5, None)
    assert job.as_json()["notes"] == ["give --width-mm"]
    kept = kept_result(tmp_path / "kept" / "evaluate.kept")
    assert kept["command"] == "scleraforce evaluate default small"
    assert kept["result"] == {"notes": ["--gap-mm is missing"]}
    assert (kept["rows"], kept["model"]) == ([{"file": "a"}], "default")
    assert kept["calibration"] is None


def test_a_fault_names_the_flags_of_its_command(started: Start) -> None:
    job = started("connection.send(Failed('calibration: give `gap_m`')); sys.exit(1)")
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
    job = started("connection.send(Finished({}))")
    wait_until(lambda: job.done)
    assert "kept" in (job.fault or "")


def test_a_full_disk_and_missing_memory_are_one_line_each() -> None:
    full = OSError(28, "No space left on device", "out/part")
    assert job_worker.fault_words(full) == "out/part: No space left on device"
    assert job_worker.fault_words(OSError(28, "No space left")) == "No space left"
    assert job_worker.fault_words(MemoryError()).startswith("not enough memory")
    assert job_worker.fault_words(InputError("a: b")) == "a: b"
    assert "internal fault: KeyError" in job_worker.fault_words(KeyError("a"))


# ---- how a worker ends


def test_a_job_is_stopped_as_by_ctrl_c_and_once(started: Start, tmp_path: Path) -> None:
    job = started(
        "try:\n"
        "    connection.send(Progressed('frames', 0, 4))\n"
        "    time.sleep(600)\n"
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
        "signal.signal(signal.SIGINT, signal.SIG_IGN)\n"
        "connection.send(Progressed('frames', 0, 4))\n"
        "time.sleep(600)"
    )
    wait_until(lambda: bool(job.title))
    job.cancel()
    wait_until(lambda: job.done)
    assert job.fault == "stopped"


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
from scleraforce.front.cli.field_flags import flag_of, json_in_flags
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
words = CommandWords(flag_of, json_in_flags)
job = RunningJob.started(asked, ["calibrate"], folder, folder / "kept", words)
print(job._process.pid, flush=True)
while not job.title:
    time.sleep(0.01)
print("it works", flush=True)
time.sleep(600)
"""


def test_modules_in_the_folder_of_data_are_not_imported(tmp_path: Path) -> None:
    write_small_recording(tmp_path / "small", frames=2)
    for name in ("click", "pydantic", "cv2"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w')")
    job = ended(tmp_path, command="calibrate", operands=["small"], out="e.json")
    assert "small" in (job.fault or "")
    assert not (tmp_path / "ran").exists()


# ---- what reaches the public functions


def asked(folder: Path, **request: Any) -> Any:
    return job_of(CommandRequest(**request), Folder(folder.resolve()))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_small_recording(tmp_path / "small", frames=2)
    (tmp_path / "other.json").write_text("{}")
    (tmp_path / "times.csv").write_text("file,time_s\n")
    return tmp_path


@pytest.mark.parametrize(
    ("option", "given", "found"),
    [
        ("frames", 3, {"frames": 3}),
        ("without_force", True, {"method.without_force": True}),
        (
            "parameters",
            "e, Thickness",
            {"method.parameters": ("e", "thickness"), "method.prior": None},
        ),
        ("thickness_um", 650, {"eye.thickness_m": 650e-6}),
        (
            "calibration",
            "other.json",
            {"method.prior": "other.json", "method.without_force": True},
        ),
    ],
)
def test_each_option_of_calibrate_reaches_the_api(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    option: str,
    given: Any,
    found: dict[str, Any],
) -> None:
    called = dict[str, Any]()

    class Calibrated:
        def to_dict(self) -> dict[str, Any]:
            return {"eyes": {}}

    def calibrate(recordings: Any, **keywords: Any) -> Calibrated:
        called.update(keywords, recordings=recordings)
        keywords["note"]("`width_m`")
        with keywords["progress"].bar("frames", 2) as advance:
            advance(2)
        return Calibrated()

    monkeypatch.setattr(job_worker, "calibrate", calibrate)
    options = {option: given}
    if option == "calibration":
        options["without_force"] = True
    job = asked(
        folder, command="calibrate", operands=["small"], out="e.json", options=options
    )
    sent = list[Any]()
    end = job_worker.finished(job, sent.append, str)
    assert end.result == {"eyes": {}, "notes": ["`width_m`"]}
    assert [vars(message) for message in sent] == [
        {"words": "`width_m`"},
        {"title": "frames", "done": 0, "total": 2},
        {"title": "frames", "done": 2, "total": 2},
    ]
    assert (called["recordings"], called["out"]) == (("small",), "e.json")
    for place, value in found.items():
        name, _, attribute = place.partition(".")
        reached = called[name]
        assert (getattr(reached, attribute) if attribute else reached) == value


def test_each_option_of_evaluate_reaches_the_api(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called = list[Any]()

    class Evaluated:
        def to_dict(self) -> dict[str, Any]:
            return {"frames": []}

        def rows(self) -> list[dict[str, Any]]:
            return [{"time_s": 1.0}]

    def evaluate(*given: Any, progress: Any) -> Evaluated:
        with progress.bar("frames", 1) as advance:
            advance(1)
        called.extend(given)
        return Evaluated()

    monkeypatch.setattr(job_worker, "load_model", lambda name: f"model {name}")
    monkeypatch.setattr(job_worker, "evaluate", evaluate)
    monkeypatch.setattr(
        "scleraforce.front.report.evaluation_page.write_answers_page",
        lambda _, path, worded: called.extend([path, worded("x")]),
    )
    job = asked(
        folder,
        command="evaluate",
        operands=["default", "small"],
        options={"calibration": "other.json", "html": "page.html"},
    )
    sent = list[Any]()
    end = job_worker.finished(job, sent.append, str.upper)
    assert end.rows == ({"time_s": 1.0},)
    assert [(message.done, message.total) for message in sent] == [(0, 1), (1, 1)]
    assert called == [
        "model default",
        ("small",),
        "other.json",
        Path("page.html"),
        "X",
    ]


IMPORT_VALUES = {
    "axes": "frame,depth,lateral",
    "flip": "rows",
    "array": "scan",
    "width_mm": 15.0,
    "depth_mm": 4.0,
    "refractive_index": 1.0,
    "bits": 12,
    "first_frame": 1,
    "last_frame": 2,
    "rate_hz": 2.0,
    "times": "times.csv",
    "frames_by": "order",
    "clock_offset_s": 0.5,
    "axis": "fz",
    "contact_sign": "-1",
    "average_s": 0.5,
    "range_n": 2.0,
    "image_topic": "/a",
    "force_topic": "/b",
    "by_arrival": True,
    "eye": "mine",
    "thickness_um": 650.0,
    "iop_mmhg": 15.0,
    "globe": "open",
    "gauge": 22,
    "gap_mm": 0.5,
    "polar_angle_deg": 10.0,
    "relaxation": "none",
}


def test_every_option_of_an_import_reaches_the_api(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert IMPORT_VALUES.keys() == OPTIONS["import"]
    requests = list[Any]()
    monkeypatch.setattr(
        job_worker, "write_imported", lambda request, _: requests.append(request)
    )
    monkeypatch.setattr(job_worker, "import_result", lambda *_: {})
    job = asked(
        folder,
        command="import",
        operands=["small", "times.csv"],
        out="eye",
        options=IMPORT_VALUES,
        columns=["fz=Pull:mN"],
        planes={"small": "across:0:90"},
    )
    assert job_worker.finished(job, print, str).result == {}
    [request] = requests
    reached = vars(request.answers)
    for name, value in IMPORT_VALUES.items():
        assert reached[name] == (Path(value) if name == "times" else value), name
    assert reached["columns"] == ("fz=Pull:mN",)
    assert request.origins.keys() == {*IMPORT_VALUES, "columns"}
    assert [str(source) for source in request.sources] == ["times.csv", "small"]
    assert [plane and plane.name for plane in request.planes] == [None, "across"]


@pytest.mark.parametrize(
    ("command", "options", "fault"),
    [
        ("calibrate", {"frames": 1.5}, "frames: Expected `int"),
        ("calibrate", {"frames": 0}, "frames: 0; give at least 1"),
        ("calibrate", {"thickness_um": 0.65}, "thickness_um: 0.65 .* mean 650 µm"),
        ("import", {"width_mm": 0}, "width_mm: 0 is below"),
        ("import", {"first_frame": 0}, "first_frame: 0; give at least 1"),
        ("calibrate", {"thickness_um": "thick"}, "thickness_um: Expected `float"),
        ("calibrate", {"without_force": 1}, "without_force: Expected `bool"),
        ("evaluate", {"frames": 3}, "frames: not an option of evaluate"),
    ],
)
def test_options_of_another_name_or_type_are_refused(
    folder: Path, command: str, options: dict[str, Any], fault: str
) -> None:
    operands = ["default", "small"] if command == "evaluate" else ["small"]
    with pytest.raises(InputError, match=fault):
        asked(folder, command=command, operands=operands, out="e", options=options)


# ---- the same as the commands


@pytest.mark.parametrize(
    "options",
    [{}, {"eye": "mine", "gauge": 22, "gap_mm": 0.5, "refractive_index": 1.0}],
)
def test_an_import_gives_what_the_command_prints(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    options: dict[str, Any],
) -> None:
    stack = np.random.default_rng(0).integers(0, 4096, (5, 32, 48), dtype=np.uint16)
    tifffile.imwrite(tmp_path / "scan.tif", stack, photometric="minisblack")
    time_s = np.arange(0.0, 3.0, 0.01)
    log = np.column_stack([time_s, 0.02 * np.sin(time_s) ** 2])
    np.savetxt(
        tmp_path / "log.csv", log, "%.4f", ",", header="time_s,pull", comments=""
    )
    more = {"width_mm": 15.0, "depth_mm": 4.0, "bits": 12, "rate_hz": 2.0}
    more |= {"clock_offset_s": 0, "axis": "fz", "contact_sign": "1", "average_s": 0.1}
    job = ended(
        tmp_path,
        command="import",
        operands=["scan.tif", "log.csv"],
        out="ours",
        options=options | more,
        columns=["fz=pull:N"],
    )
    if not options:
        assert job.fault is not None
        assert "--refractive-index" in job.fault
        assert not list(tmp_path.glob("*ours*"))
        return

    assert job.fault is None
    kept = kept_result(tmp_path / ".scleraforce" / "import.kept")
    words = job.line.replace("ours", "theirs").split()[1:]
    theirs = printed(tmp_path, capsys, monkeypatch, *words)
    named = {"recording": "ours", "preview": "ours/preview.png"}
    assert kept["result"] == theirs | named
    assert sf.read_recording(tmp_path / "ours").info.eye_name == "mine"


@pytest.mark.slow
def test_calibration_and_evaluation_give_what_the_commands_print(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    write_pushes(tmp_path / "mine", "eye-a")
    job = ended(
        tmp_path,
        command="calibrate",
        operands=["mine"],
        out="ours.json",
        options={"frames": 2},
    )
    assert job.fault is None, job.fault
    kept = kept_result(tmp_path / ".scleraforce" / "calibrate.kept")
    words = job.line.replace("ours", "theirs").split()[1:]
    assert kept["result"] == printed(tmp_path, capsys, monkeypatch, *words)

    job = ended(
        tmp_path,
        command="evaluate",
        operands=["default", "mine"],
        options={"calibration": "ours.json", "html": "page.html"},
    )
    assert job.fault is None, job.fault
    kept = kept_result(tmp_path / ".scleraforce" / "evaluate.kept")
    words = job.line.replace(" --html=page.html", "").split()[1:]
    assert kept["result"] == printed(tmp_path, capsys, monkeypatch, *words)
    times = [entry.time_s for entry in sf.read_recording(tmp_path / "mine").frames]
    assert [row["time_s"] for row in tidy(kept["rows"])] == times
    assert (tmp_path / "page.html").read_text().startswith("<!DOCTYPE html>")
