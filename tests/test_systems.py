"""Effects of processes: functions of Linux in service only, no other host, no place but
outputs and our folders.
"""

import ast
import subprocess
import sys
from ipaddress import ip_address
from pathlib import Path

import pytest
from analytic_frames import recording_toml, write_one_frame
from analytic_library import analytic_library
from effects import STRACE, fresh_home, traced
from small_models import write_fixed_reader
from sources import syntax_nodes

import scleraforce
from scleraforce.front.cli.main import run

ROOT = Path(scleraforce.__file__).parent
MODULES = {
    "fcntl",
    "grp",
    "nis",
    "posix",
    "pty",
    "pwd",
    "resource",
    "spwd",
    "syslog",
    "termios",
    "tty",
}
OF_OS = {
    "O_CLOEXEC",
    "O_NONBLOCK",
    "eventfd",
    "fork",
    "getgid",
    "geteuid",
    "getuid",
    "mkfifo",
    "openpty",
    "memfd_create",
    "pipe2",
    "posix_fadvise",
    "posix_spawn",
    "register_at_fork",
    "sched_getaffinity",
    "sched_param",
    "sched_setaffinity",
    "sched_setscheduler",
    "sendfile",
    "set_blocking",
    "setpriority",
    "setsid",
    "statvfs",
    "sysconf",
    "uname",
    "SCHED_FIFO",
    "SCHED_RESET_ON_FORK",
}
OF_SIGNAL = {
    "SIGALRM",
    "SIGHUP",
    "SIGKILL",
    "SIGQUIT",
    "SIGTTOU",
    "SIGUSR1",
    "alarm",
    "pthread_sigmask",
    "setitimer",
}
OF_SOCKET = {"AF_UNIX", "SO_REUSEPORT", "SCM_RIGHTS", "send_fds", "recv_fds"}
LINUX = {"os": OF_OS, "signal": OF_SIGNAL, "socket": OF_SOCKET}
# Module and name: used with hasattr, with its exception caught, or after the monitor
# has refused other systems.
GUARDED = {
    ("base.worker_processes", "sched_getaffinity"),
    ("base.worker_processes", "pthread_sigmask"),
    ("front.cli.installation_checks", "sysconf"),
    ("front.app.job_worker", "SIGKILL"),  # the app refuses other systems, too
    ("front.app.running_jobs", "SIGKILL"),
    ("base.private_folder", "geteuid"),
}
SMALL = (
    "[mesh]\ndivisions = 4\n[dataset]\ncontacts = 2\n[[dataset.group]]\nthickness_um ="
    " 500.0\nimages = 20\n"
)
# Run in a Python, it removes the functions of Linux alone.
ELSEWHERE = f"""
import os, signal, sys
class Block:
    def find_spec(self, name, path=None, target=None):
        if name in {sorted(MODULES - {"posix"})!r}:
            raise ModuleNotFoundError("not on this system", name=name)
import multiprocessing, subprocess, numpy, cv2, onnxruntime, click, numba, platformdirs  # before the block
for name in {sorted(MODULES - {"posix"})!r}:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Block())
for module, names in ((os, {sorted(OF_OS)!r}), (signal, {sorted(OF_SIGNAL)!r})):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
from scleraforce.front.cli.main import run
sys.exit(run(sys.argv[1:]))
"""


def used(path: Path) -> set[str]:
    """Return the functions of Linux or Unix alone that a file imports or looks up."""
    found: set[str] = set()
    for node in syntax_nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & MODULES
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module or ""} & MODULES
            found |= {alias.name for alias in node.names} & LINUX.get(
                node.module or "", set()
            )
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found |= {node.attr} & LINUX.get(node.value.id, set())

    return found


def test_only_service_and_guarded_calls_need_linux() -> None:
    places = {
        path: ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in ROOT.rglob("*.py")
    }
    found = {(place, name) for path, place in places.items() for name in used(path)}
    assert {one for one in found if not one[0].startswith("live")} == GUARDED
    assert {"sched_setscheduler", "SCHED_FIFO"} <= {name for _, name in found}


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return write_one_frame(tmp_path / "session", recording_toml("mine")).parents[1]


def elsewhere(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command without the functions of Linux alone."""
    call = [sys.executable, "-c", ELSEWHERE, *map(str, arguments)]
    return subprocess.run(call, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "command", ["phantom", "generate", "classify", "evaluate", "segment", "replay"]
)
def test_commands_run_without_functions_of_linux(
    command: str, session: Path, tmp_path: Path
) -> None:
    study = tmp_path / "small.toml"
    study.write_text(SMALL)
    out = tmp_path / "out"
    words = {
        "phantom": (
            "--study",
            study,
            "--out",
            out,
            "--forces-mn",
            "2,20",
            "--thickness-um",
            600,
        ),
        "generate": ("--study", study, "--out", out, "--workers", 1),
        "classify": ("default", session / "frames" / "1.png", "--globe", "open"),
        "evaluate": ("default", session),
        "segment": (session, "--out", out),
        "replay": (session, "--port", 1),
    }[command]
    done = elsewhere(command, *words)

    if command == "replay":  # there is no monitor to play to
        assert done.stderr.startswith("error: 127.0.0.1:1: "), done.stderr
    else:
        assert done.returncode == 0, done.stderr
        assert command != "classify" or "mN (90 %:" in done.stdout


@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_the_monitor_says_that_it_needs_linux(
    platform: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.setattr(sys, "platform", platform)
    assert run(["monitor", "default"]) == 2
    assert (
        "error: monitor: runs on Linux only, for its real-time priorities; this is"
        f" {platform}" in capsys.readouterr().err
    )


DEVICES = ("/dev/null", "/dev/tty", "/dev/shm", "/proc")
OURS = {
    Path(".cache/scleraforce"),
    Path(".local/state/scleraforce"),
    Path(".cache/matplotlib"),
    Path(".config"),
}


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A model folder of kind "reader"."""
    pytest.importorskip("torch")
    path = tmp_path_factory.mktemp("silence") / "reader"
    write_fixed_reader(
        path, analytic_library(thicknesses=4, ratios=4, tips=5), [1.0] * 8
    )
    return path


def test_onnx_runtime_keeps_no_device_id_and_no_events_here_or_in_processes_that_we_start(
    reader: Path, tmp_path: Path
) -> None:
    """In a notebook, too, which makes a session of its own, and in processes that it
    starts: our import is enough.
    """
    environment = fresh_home(tmp_path) | {"ORT_DISABLE_TELEMETRY": "0"}
    script = (
        "import os, sys, scleraforce, onnxruntime;"
        " onnxruntime.InferenceSession(sys.argv[1] + '/model.onnx'); assert"
        " os.environ['ORT_DISABLE_TELEMETRY'] == '1'"
    )
    subprocess.run([sys.executable, "-c", script, reader], env=environment, check=True)
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []


@pytest.mark.slow
@pytest.mark.skipif(STRACE is None, reason="strace is not installed")
def test_no_command_speaks_to_another_host_or_writes_outside_its_outputs(
    reader: Path, tmp_path: Path
) -> None:
    (tmp_path / "study.toml").write_text(
        f"{SMALL}[network]\nhidden = [8]\nepochs = 1\n"
    )
    frame = ("eye/frames/0001.png", "--width-mm", "15", "--depth-mm", "4")
    commands = [
        ("phantom", "--study", "study.toml", "--out", "eye", "--forces-mn", "5,30"),
        ("segment", "eye", "--out", "masks", "--overlay"),
        ("generate", "--study", "study.toml", "--out", "data.zarr", "--workers", "1"),
        ("train", "data.zarr", "--out", "classifier"),
        ("classify", "./classifier", *frame),
        ("classify", reader, *frame),
        ("evaluate", reader, "eye", "--html", "page.html"),
        ("monitor", reader, "--port", "0", "--web-port", "0"),
    ]

    for command in commands:
        monitor = command[0] == "monitor"
        done = traced(
            tmp_path,
            *command,
            until=(lambda line: line.startswith("reset")) if monitor else None,
        )
        # Ctrl-C ends the monitor
        assert done.code in ((0, 130) if monitor else (0,)), (
            command,
            done.err,
        )
        assert [
            name for name in done.addresses if not ip_address(name).is_loopback
        ] == [], command
        outside = [
            str(file) for file in done.written if not file.is_relative_to(tmp_path)
        ]
        assert [name for name in outside if not name.startswith(DEVICES)] == [], command

    home = tmp_path / "home"
    kept = {file.relative_to(home) for file in home.rglob("*") if file.is_file()}
    assert [
        file for file in kept if not any(file.is_relative_to(ours) for ours in OURS)
    ] == []
    assert [
        file for file in (tmp_path / "temporary").rglob("*") if file.is_file()
    ] == []
