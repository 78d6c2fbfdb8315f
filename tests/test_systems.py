"""Only `service` uses functions of Linux alone: everything but the monitor can work on other systems.

The tests run on Linux: they search the sources for such functions, and run commands in a Python without them.
"""

import ast
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from analytic_frames import image, recording_toml, tip_of, wall_section
from sources import syntax_nodes

import scleraforce
from scleraforce.cli.main import run

ROOT = Path(scleraforce.__file__).parent
MODULES = {"fcntl", "grp", "nis", "posix", "pty", "pwd", "resource", "spwd", "syslog", "termios", "tty"}
OF_OS = {
    "O_CLOEXEC", "O_NONBLOCK", "eventfd", "fork", "getgid", "geteuid", "getuid", "mkfifo", "openpty", "memfd_create",
    "pipe2", "posix_fadvise", "posix_spawn", "register_at_fork", "sched_getaffinity", "sched_param",
    "sched_setaffinity", "sched_setscheduler", "sendfile", "set_blocking", "setpriority", "setsid", "statvfs",
    "sysconf", "uname", "SCHED_FIFO", "SCHED_RESET_ON_FORK",
}  # fmt: skip
OF_SIGNAL = {"SIGALRM", "SIGHUP", "SIGKILL", "SIGQUIT", "SIGTTOU", "SIGUSR1", "alarm", "pthread_sigmask", "setitimer"}
OF_SOCKET = {"AF_UNIX", "SO_REUSEPORT", "SCM_RIGHTS", "send_fds", "recv_fds"}
LINUX = {"os": OF_OS, "signal": OF_SIGNAL, "socket": OF_SOCKET}
# Module and name: used with hasattr, with its exception caught, or after the monitor has refused other systems.
GUARDED = {
    ("processes", "sched_getaffinity"), ("processes", "pthread_sigmask"), ("installation", "sysconf"),
    ("cli.monitor", "SIGHUP"), ("cli.monitor", "SIGQUIT"), ("cli.monitor", "SIGTTOU"),
}  # fmt: skip
SMALL = "[mesh]\ndivisions = 4\n[dataset]\ncontacts = 2\n[[dataset.group]]\nthickness_um = 500.0\nimages = 20\n"
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
from scleraforce.cli.main import run
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
            found |= {alias.name for alias in node.names} & LINUX.get(node.module or "", set())
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            found |= {node.attr} & LINUX.get(node.value.id, set())
    return found


def test_only_service_and_guarded_calls_need_linux() -> None:
    found = {
        (".".join(path.relative_to(ROOT).with_suffix("").parts), name)
        for path in ROOT.rglob("*.py")
        for name in used(path)
    }
    assert {one for one in found if not one[0].startswith("service")} == GUARDED
    assert {"sched_setscheduler", "SCHED_FIFO"} <= {name for _, name in found}


@pytest.fixture
def session(tmp_path: Path) -> Path:
    path = tmp_path / "session"
    (path / "frames").mkdir(parents=True)
    (path / "recording.toml").write_text(recording_toml("mine"))
    (path / "frames.csv").write_text("file,time_s\n1.png,1.0\n")
    cv2.imwrite(str(path / "frames" / "1.png"), image(wall_section(tip_of(0.020))))
    return path


def elsewhere(*arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a command without the functions of Linux alone."""
    call = [sys.executable, "-c", ELSEWHERE, *map(str, arguments)]
    return subprocess.run(call, capture_output=True, text=True, check=False)


def test_frames_are_read_without_functions_of_linux(session: Path) -> None:
    done = elsewhere("classify", "default", session / "frames" / "1.png", "--globe", "open")
    assert done.returncode == 0, done.stderr
    assert "mN (90 %:" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("command", ["phantom", "generate", "evaluate", "segment", "replay"])
def test_commands_run_without_functions_of_linux(command: str, session: Path, tmp_path: Path) -> None:
    study = tmp_path / "small.toml"
    study.write_text(SMALL)
    out = tmp_path / "out"
    words = {
        "phantom": ("--study", study, "--out", out, "--forces-mn", "2,20", "--thickness-um", 600),
        "generate": ("--study", study, "--out", out, "--workers", 1),
        "evaluate": ("default", session),
        "segment": (session, "--out", out),
        "replay": (session, "--port", 1),
    }[command]
    done = elsewhere(command, *words)
    if command == "replay":  # there is no monitor to play to
        assert done.stderr.startswith("error: 127.0.0.1:1: "), done.stderr
    else:
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("platform", ["darwin", "win32"])
def test_the_monitor_says_that_it_needs_linux(platform: str, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    monkeypatch.setattr(sys, "platform", platform)
    assert run(["monitor", "default"]) == 2
    assert (
        f"error: monitor: runs on Linux only, for its real-time priorities; this is {platform}"
        in capsys.readouterr().err
    )
