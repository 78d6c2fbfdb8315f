"""A monitor for the time of a block: the real one, ended whatever the block does."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from analytic_frames import GAP_M, IOP_PA, SCALE, image, tip_of, wall_section
from commands import PACED, monitor_folder
from small_monitor import Peer
from waiting import FUSE_S

import scleraforce as sf
from scleraforce.base.errors import InputError
from scleraforce.front.api import monitoring
from scleraforce.front.api.monitoring import RunningMonitor
from scleraforce.live.decision.events import Cause
from scleraforce.live.network.openigtlink import Image

MATRIX = (
    SCALE.lateral_m * 1e3,
    0.0,
    0.0,
    0.0,
    SCALE.depth_m * 1e3,
    0.0,
    0.0,
    0.0,
    1.0,
    0.0,
    0.0,
    0.0,
)
# the scale of the default model's study
DEFAULT_MATRIX = (15.0 / 512, 0.0, 0.0, 0.0, 4.0 / 512, *MATRIX[5:])
PACED_CHILD = PACED.with_name("paced_child.py")
pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="the monitor runs on Linux only"
)


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no busy machine make the watchdog or the operator impatient."""
    monkeypatch.setattr(monitoring, "COMMAND", (sys.executable, str(PACED_CHILD)))
    ask = partial(monitoring.ask_reset, within_s=FUSE_S)
    monkeypatch.setattr(monitoring, "ask_reset", ask)


@pytest.mark.usefixtures("patient")
def test_a_robot_meets_the_monitor_of_the_command_and_it_ends_with_the_block(
    tmp_path: Path,
) -> None:
    folder = monitor_folder(tmp_path)
    given = {
        "calibration": folder / "calibration.json",
        "eye": "mine",
        "iop_pa": IOP_PA,
        "gap_m": GAP_M,
    }
    meets = sf.monitor(
        folder / "reader",
        **given,
        globe="open",
        second_opinion=False,
        black_box=tmp_path / "box",
    )

    with meets as running, Peer(running.port, version=2) as robot:
        assert f"gap {1e3 * GAP_M:.2f} mm" in "".join(running.lines)
        robot.hear(lambda peer: bool(peer.statuses()))
        assert robot.statuses()[0].code == 13
        robot.say(Image(image(wall_section(tip_of(8e-3)))[None], MATRIX), message_id=1)
        robot.hear(lambda peer: peer.statuses()[-1].code != 13)
        assert running.reset()[1]
        assert not replace(running, token="wrong").reset()[0]

    assert running.summary["frames"] >= 1
    assert running.lines[-1].startswith("ended after")
    assert (tmp_path / "box" / "log").is_dir()

    with (
        pytest.raises(ConnectionRefusedError),
        socket.create_connection((running.host, running.port)),
    ):
        pass


def test_a_monitor_that_cannot_start_is_one_clear_line(tmp_path: Path) -> None:
    for model, given, words in (
        (tmp_path / "gone", {}, "gone"),
        ("default", {"iop_pa": -5.0}, "iop_pa: -5 is below"),
        ("default", {"globe": "shut"}, "shut"),
    ):
        with (
            pytest.raises(InputError, match=words) as fault,
            sf.monitor(model, **given),
        ):
            pass

        assert "\n" not in str(fault.value)


@pytest.mark.usefixtures("patient")
def test_a_block_that_fails_ends_its_monitor(tmp_path: Path) -> None:
    folder = monitor_folder(tmp_path)
    seen = []

    def fail() -> None:
        with sf.monitor(folder / "reader", second_opinion=False) as running:
            seen.append(running)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()

    assert seen[0].lines[-1].startswith("ended after")


@pytest.mark.usefixtures("patient")
def test_a_block_ends_with_its_monitor_though_a_client_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The watchdog of a monitor that died stays until its clients have left."""
    folder = monitor_folder(tmp_path)
    monitors: list[subprocess.Popen[str]] = []
    await_start = monitoring._await_start

    def remember(process: "subprocess.Popen[str]", running: RunningMonitor) -> Thread:
        monitors.append(process)
        return await_start(process, running)

    monkeypatch.setattr(monitoring, "_await_start", remember)
    with ExitStack() as clients:
        with sf.monitor(folder / "reader", second_opinion=False) as running:
            robot = clients.enter_context(Peer(running.port))
            robot.hear(lambda peer: bool(peer.statuses()))
            monitors[0].kill()
            robot.hear(lambda peer: peer.statuses()[-1].code == 3)

        assert running.summary == {}
        assert not robot.closed


BUSY_LOOPS = 2 * len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 0
# a backlog as a delay of 160 ms leaves it, at 100 frames a second
BACKLOG = 16
BACKLOGS = 30
UNPRIVILEGED = ("setpriv", "--bounding-set=-sys_nice")


@contextmanager
def busy_loops(number: int) -> Iterator[None]:
    """Run programs that take all the processor time they get."""
    with ExitStack() as stack:
        for _ in range(number):
            loop = stack.enter_context(
                subprocess.Popen(
                    [sys.executable, "-c", "while True: pass"], start_new_session=True
                )
            )
            stack.callback(loop.kill)
        yield


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give up a right")
def test_the_watchdog_spares_a_monitor_beside_busy_loops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without real-time rights, while withdrawals and the session are written."""
    monkeypatch.setattr(monitoring, "COMMAND", (*UNPRIVILEGED, *monitoring.COMMAND))
    meets = sf.monitor(
        "default",
        youngs_modulus_pa=0.3e6,
        globe="open",
        second_opinion=False,
        record=tmp_path / "session",
    )
    rng = np.random.default_rng(1)
    frames = rng.integers(0, 2000, (BACKLOG, 512, 512), dtype=np.uint16)

    with (
        meets as running,
        busy_loops(BUSY_LOOPS),
        Peer(running.port, version=2) as robot,
    ):
        for _ in range(BACKLOGS):
            answered = len(robot.statuses())
            for frame in frames:
                robot.say(Image(frame[None], DEFAULT_MATRIX))
            robot.hear(lambda peer, since=answered: len(peer.statuses()) > since)

        assert any(status.code == 3 for status in robot.statuses())
        causes = {status.name for status in robot.statuses()}
        assert Cause.WATCHDOG.name not in causes

    assert running.summary["frames"] >= BACKLOGS
    assert running.lines[-1].startswith("ended after")
