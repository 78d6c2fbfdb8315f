"""The end of `monitor`: by Ctrl-C, by signals, with its terminal; and no foreign code runs until then."""

import json
import os
import pty
import select
import signal
import socket
import sys
import termios
from pathlib import Path
from time import monotonic

import pytest
from commands import monitor_folder, program, started
from small_monitor import Peer
from waiting import FUSE_S, wait_until

from scleraforce.service.decision_log import read_log

pytest.importorskip("torch")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return monitor_folder(tmp_path_factory.mktemp("monitor"))


@pytest.mark.slow
def test_ctrl_c_is_its_end_and_no_module_of_the_current_folder_has_run(folder: Path, tmp_path: Path) -> None:
    for name in ("numpy", "signal", "json", "socket", "scleraforce", "fastapi", "cv2", "onnxruntime"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\n")
    options = ["--black-box", str(tmp_path / "box"), "--web-port", "0"]
    with started(folder, *options, here=tmp_path) as monitor, Peer(monitor.port) as robot:
        assert monitor.process.stderr
        lines = iter(monitor.process.stderr.readline, "")
        assert any(line.startswith("console    http://127.0.0.1:") for line in lines)  # it has loaded all that it needs
        monitor.process.send_signal(signal.SIGINT)
        told, said = monitor.process.communicate(timeout=FUSE_S)
        assert monitor.process.returncode == 0
        assert "the monitor ends" in robot.wait_for_code(3).message
    assert said.splitlines()[-1].startswith("ended after 0 frames")  # a busy machine may cause a withdrawal
    assert json.loads(told)["frames"] == 0
    assert not (tmp_path / "ran").exists()


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_other_signals_end_it_in_order_and_leave_no_process(
    folder: Path, tmp_path: Path, number: signal.Signals
) -> None:
    with started(folder, "--black-box", str(tmp_path / "box")) as monitor, Peer(monitor.port) as robot:
        robot.hear(lambda peer: bool(peer.statuses()))  # it has been let in, not only queued by the system
        children = children_of(monitor.process.pid)
        assert len(children) == 3  # black box, second opinion, watchdog
        os.kill(monitor.process.pid, number)
        os.kill(monitor.process.pid, number)  # a shell and the system may both say so
        assert "the monitor ends" in robot.wait_for_code(3).message
        assert monitor.process.wait(FUSE_S) == 0
    wait_until(lambda: not any(os.path.exists(f"/proc/{child}") for child in children))


def children_of(pid: int) -> list[int]:
    return list(map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split()))


@pytest.mark.slow
@pytest.mark.parametrize("how", ["closed", "stopped"])
def test_a_terminal_that_is_closed_ends_it_in_order_and_one_that_is_stopped_keeps_it_from_nothing(
    folder: Path, tmp_path: Path, how: str
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    script = program(folder)
    pid, terminal = pty.fork()  # the monitor leads the terminal's session
    if pid == 0:
        command = ["monitor", str(folder / "reader"), "--port", str(port), "--black-box", str(tmp_path / "box")]
        os.execv(sys.executable, [sys.executable, str(script), *command])
    read_until(terminal, "monitor-reset")
    with Peer(port) as robot:
        robot.hear(lambda peer: bool(peer.statuses()))
        if how == "closed":
            os.close(terminal)
        else:
            termios.tcflow(terminal, termios.TCIOFF)
            slave = os.open(f"/proc/{pid}/fd/2", os.O_RDWR | os.O_NOCTTY)
            termios.tcflow(slave, termios.TCOOFF)
            os.close(slave)
            os.kill(pid, signal.SIGTERM)
        status = robot.wait_for_code(3)
        assert "the monitor ends" in status.message
    assert os.waitstatus_to_exitcode(waited(pid)) == 0
    if how == "stopped":
        os.close(terminal)
    texts = [part.record.get("text", "") for part in read_log(tmp_path / "box" / "log") if part.record]
    assert not any("without notice" in text for text in texts)


@pytest.mark.slow
@pytest.mark.parametrize("sent", ["Ctrl-Z", "kill"])
def test_a_monitor_that_is_stopped_in_its_terminal_is_ended_by_its_watchdog(
    folder: Path, tmp_path: Path, sent: str
) -> None:
    """Ctrl-Z stops all processes of a terminal's session; the watchdog and the black box have their own."""
    with started(folder, "--black-box", str(tmp_path / "box")) as monitor, Peer(monitor.port) as robot:
        robot.hear(lambda peer: bool(peer.statuses()))  # the monitor has taken the connection
        children = children_of(monitor.process.pid)
        assert {os.getsid(child) for child in children} == set(children)
        os.kill(monitor.process.pid, signal.SIGSTOP if sent == "Ctrl-Z" else signal.SIGKILL)
        assert robot.wait_for_code(3).name == "WATCHDOG"
        robot.link.close()
        assert monitor.process.wait(FUSE_S) == -signal.SIGKILL
        wait_until(lambda: not any(os.path.exists(f"/proc/{child}") for child in children))


def read_until(terminal: int, word: str, within_s: float = FUSE_S) -> None:
    said, end_s = "", monotonic() + within_s
    while word not in said:
        assert select.select([terminal], [], [], max(0.0, end_s - monotonic()))[0], said
        said += os.read(terminal, 4096).decode()


def waited(pid: int) -> int:
    """Return the status with which a child ended."""
    found: list[int] = []

    def ended() -> bool:
        done, status = os.waitpid(pid, os.WNOHANG)
        found.append(status)
        return done == pid

    wait_until(ended)
    return found[-1]
