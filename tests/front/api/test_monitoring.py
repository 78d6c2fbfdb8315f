"""A monitor for the time of a block: the real one, ended whatever the block does."""

import os
import pickle
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from math import radians
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from analytic_frames import GAP_M, IOP_PA, SCALE, frame_under
from commands import PACED, monitor_folder
from small_monitor import Peer
from waiting import FUSE_S, HANGS_S, alive, wait_until

import scleraforce as sf
from scleraforce.base.errors import InputError, LinkError
from scleraforce.base.units import to_si
from scleraforce.front.api import monitor_settings, monitoring
from scleraforce.front.api.monitor_settings import prepare_monitor
from scleraforce.front.api.monitoring import RunningMonitor
from scleraforce.live.companions.decision_log import read_log
from scleraforce.live.companions.process_channel import decode_message, encode_message
from scleraforce.live.companions.process_messages import OpinionSettings
from scleraforce.live.companions.shared_frames import RingPlace
from scleraforce.live.decision.events import Cause
from scleraforce.live.monitor_request import MonitorRequest, Refused
from scleraforce.live.network.openigtlink import Image
from scleraforce.records.eye import NO_DISCREPANCY
from scleraforce.records.fields import QUANTITIES
from scleraforce.records.needle import lean_ends

NONE = (0.0, 0.0, 0.0)


def matrix_of(lateral_m: float, depth_m: float) -> tuple[float, ...]:
    return (1e3 * lateral_m, *NONE, 1e3 * depth_m, *NONE, 1.0, *NONE)


MATRIX = matrix_of(SCALE.lateral_m, SCALE.depth_m)
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return monitor_folder(tmp_path_factory.mktemp("monitor"))


@pytest.mark.usefixtures("patient")
def test_a_robot_meets_the_monitor_of_the_command_and_it_ends_with_a_block_that_fails(
    folder: Path, tmp_path: Path
) -> None:
    meets = sf.monitor(
        folder / "reader",
        calibration=folder / "calibration.json",
        eye="mein",
        iop_pa=IOP_PA,
        gap_m=GAP_M,
        globe="open",
        needle=sf.Needle(diameter_m=0.9e-3),
        second_opinion=False,
        black_box=tmp_path / "box",
    )

    frame = frame_under(8e-3)[None]
    met = list[RunningMonitor]()

    def meet() -> None:
        with meets as running, Peer(running.port, version=2) as robot:
            met.append(running)
            assert f"gap {1e3 * GAP_M:.2f} mm" in "".join(running.lines)
            robot.hear(lambda peer: bool(peer.statuses()))
            assert robot.statuses()[0].code == 13
            robot.say(Image(frame, MATRIX), message_id=1)
            robot.hear(lambda peer: peer.statuses()[-1].code != 13)
            assert running.reset()[1]
            assert not replace(running, token="wrong").reset()[0]
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        meet()

    (running,) = met
    assert running.summary["frames"] >= 1
    assert running.lines[-1].startswith("ended after")
    with (
        pytest.raises(ConnectionRefusedError),
        socket.create_connection((running.host, running.port)),
    ):
        pass

    remarks = running.remarks
    codes = [remark.code for remark in remarks]
    assert codes == ["population-modulus", "outside-training"]
    lines = [line for line in running.lines if line.startswith("warning")]
    assert lines == [f"warning    {remark.words}" for remark in remarks]
    log = [part.record for part in read_log(tmp_path / "box" / "log") if part.record]
    notes = [record["text"] for record in log if record["kind"] == "note"]
    assert {f"{remark.code}: {remark}" for remark in remarks} <= {*notes}


@pytest.mark.slow
@pytest.mark.usefixtures("patient")
def test_a_block_ends_with_its_monitor_though_a_client_stays(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The watchdog of a monitor that died stays until its clients have left."""
    monitors: list[subprocess.Popen[bytes]] = []
    await_start = monitoring._await_start

    def remember(
        link: Connection, process: "subprocess.Popen[bytes]", running: RunningMonitor
    ) -> None:
        monitors.append(process)
        await_start(link, process, running)

    monkeypatch.setattr(monitoring, "_await_start", remember)
    with ExitStack() as clients:
        with sf.monitor(folder / "reader", second_opinion=False) as running:
            robot = clients.enter_context(Peer(running.port))
            robot.hear(lambda peer: bool(peer.statuses()))
            monitors[0].kill()
            robot.hear(lambda peer: peer.statuses()[-1].code == 3)

        assert running.summary == {}
        assert not robot.closed


# Says what it was asked for, and refuses it.
ASKED = """
import sys
from multiprocessing.connection import Connection

link = Connection(int(sys.argv[1]))
open({file!r}, "wb").write(link.recv_bytes())
link.send_bytes({refusal!r})
"""


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Return the request that reaches the process of a monitor."""
    file = tmp_path / "request"
    refusal = pickle.dumps(Refused("far enough"))
    code = ASKED.format(file=str(file), refusal=refusal)
    monkeypatch.setattr(monitoring, "COMMAND", (sys.executable, "-P", "-c", code))

    def ask(*given: Any, **named: Any) -> MonitorRequest:
        with (
            pytest.raises(InputError, match="far enough"),
            sf.monitor(*given, **named),
        ):
            pass

        request: MonitorRequest = pickle.loads(file.read_bytes())
        return request

    return ask


@pytest.fixture
def of_command(monkeypatch: pytest.MonkeyPatch, shell) -> Callable[[str], Any]:
    """Return the request of the command."""

    def ask(words: str) -> MonitorRequest:
        requests = list[MonitorRequest]()

        def take(request: MonitorRequest) -> None:
            requests.append(request)
            raise InputError("far enough")

        monkeypatch.setattr(monitor_settings, "prepare_monitor", take)
        shell.refused("monitor", words)
        return requests[0]

    return ask


MMHG = to_si(1.0, "mmhg")
RIGIDITY = QUANTITIES["rigidity"].to_si(0.03)
RAD_30 = QUANTITIES["polar_angle"].to_si(30.0)
ANY_LEAN = (0.0, radians(45.0))
ACROSS = sf.Plane("across", 1e-4, radians(90.0))


@pytest.mark.parametrize(
    ("named", "words"),
    [
        ({}, ""),
        ({"eye": "mine"}, "--eye mine"),
        (
            {"eye": sf.Eye("mine", iop_pa=2 * MMHG, globe=sf.Globe.declared("open"))},
            "--eye mine --iop-mmhg 2 --globe open",
        ),
        (
            {"iop_pa": 2 * MMHG, "thickness_m": 650e-6, "youngs_modulus_pa": 0.3e6},
            "--iop-mmhg 2 --thickness-um 650 --youngs-modulus-mpa 0.3",
        ),
        (
            {"eye": sf.Eye(globe=sf.Globe.declared("sealed", RIGIDITY))},
            "--globe sealed --rigidity 0.03",
        ),
        ({"eye": sf.Eye(stiffening=3.0)}, "--stiffening 3"),
        (
            {"needle": sf.Needle(gap_m=0.5e-3, polar_rad=RAD_30, lean_rad=ANY_LEAN)},
            "--gap-mm 0.5 --polar-angle-deg 30 --lean-deg unknown",
        ),
        (
            {"needle": sf.Needle(lean_rad=lean_ends(QUANTITIES["lean"].to_si(9.0)))},
            "--lean-deg 9",
        ),
        (
            {
                "scan": sf.Scan(columns=400, rows=300, direction_rad=radians(40.0)),
                "width_m": 8e-3,
                "depth_m": 6e-3,
                "refractive_index": 1.3,
            },
            "--columns 400 --rows 300 --plane-direction-deg 40 --width-mm 8"
            " --depth-mm 6 --refractive-index 1.3",
        ),
        (
            {"scan": sf.Scan(planes=(sf.Plane("along", 0.0, 0.0), ACROSS))},
            "--plane along:0:0 --plane across:0.1:90",
        ),
        (
            {"calibration": "c.json", "record": "session", "second_opinion": False},
            "--calibration c.json --record session --no-second-opinion",
        ),
    ],
)
def test_the_command_and_the_function_ask_for_the_same_monitor(
    named: dict[str, Any],
    words: str,
    asked: Callable[..., MonitorRequest],
    of_command: Callable[[str], MonitorRequest],
) -> None:
    request = asked("default", black_box="box", **named)
    assert request == of_command(f"default --port 0 --black-box box {words}")


OWN = sf.Eye(
    "mine",
    modulus=sf.Modulus(mean_pa=3e5, sd_pa=2e4, source="own"),
    iop_pa=300.0,
    iop_sd_pa=np.float32(20.0),
    thickness_m=6e-4,
    thickness_sd_m=1e-5,
    radius_m=12.2e-3,
    radius_sd_m=1e-4,
    globe=sf.Globe.declared("sealed", 1.5e8, "logarithmic"),
    relaxation=sf.Relaxation.declared([(0.12, 1.2), (0.15, 12.0)]),
    discrepancy=NO_DISCREPANCY,
    calibrated_lean_rad=0.1,
    stiffening=2.0,
)
LEANING = sf.Needle(
    diameter_m=0.7e-3,
    gap_m=0.4e-3,
    polar_rad=0.5,
    lean_rad=(0.1, 0.2),
    lean_azimuth_rad=0.3,
)
SCANNED = sf.Scan(columns=400, rows=300, bits=16, direction_rad=0.2, tilt_rad=0.1)


def test_all_that_is_declared_reaches_the_readers_of_a_monitor(
    asked: Callable[..., MonitorRequest],
) -> None:
    request = asked("default", eye=OWN, needle=LEANING, scan=SCANNED)
    _, settings = prepare_monitor(request)
    assert settings.setup.eye == OWN
    assert settings.setup.needle == LEANING
    assert settings.setup.scan == sf.Scan(direction_rad=0.2)
    study = sf.load_model("default").study.oct
    assert settings.scan == replace(
        SCANNED,
        width_m=study.width_m,
        depth_m=study.depth_m,
        refractive_index=study.refractive_index,
    )
    opinion = OpinionSettings(
        model=request.model,
        setup=settings.setup,
        scale=settings.scan.scale,
        ring=RingPlace(descriptor=5, frames=1, rows=300, columns=400),
        learns=None,
        record=None,
    )
    assert decode_message(encode_message(opinion)) == opinion


FAILS = """
import scleraforce.front.api.monitor_child as child
child.prepare_monitor = lambda request: request.model / 0
child.main()
"""


def test_a_monitor_that_cannot_start_is_one_clear_line() -> None:
    with pytest.raises(InputError, match="gone") as fault, sf.monitor("./gone"):
        pass
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("raise SystemExit(3)", "it died at its start, exit code 3"),
        (FAILS, "it failed at its start: TypeError: unsupported operand"),
    ],
)
def test_a_monitor_that_dies_or_fails_at_its_start_says_so(
    monkeypatch: pytest.MonkeyPatch, code: str, words: str
) -> None:
    monkeypatch.setattr(monitoring, "COMMAND", (sys.executable, "-P", "-c", code))
    with pytest.raises(LinkError, match=f"^monitor: {words}"), sf.monitor("default"):
        pass


# A program with a monitor: says its process, waits for its own death.
PROGRAM = """
import os, sys, time
import scleraforce as sf
from scleraforce.front.api import monitoring

def listens(link, process, running):
    print(process.pid, flush=True)
    {await_start}

await_start = monitoring._await_start
monitoring._await_start = listens
with sf.monitor(sys.argv[1], second_opinion=False, black_box=sys.argv[2]) as running:
    {then}
    print(running.port, flush=True)
    time.sleep({hangs})
"""


@pytest.mark.parametrize(
    ("await_start", "then"),
    [
        ("time.sleep(3600)", ""),
        pytest.param("await_start(link, process, running)", "", marks=pytest.mark.slow),
        pytest.param(
            "await_start(link, process, running)",
            "os.fork() or (os.close(1), time.sleep(3600))",
            marks=pytest.mark.slow,
        ),
    ],
    ids=["starting", "serving", "with a fork that holds its pipe"],
)
def test_a_monitor_ends_in_order_when_its_program_is_killed(
    await_start: str, then: str, folder: Path, tmp_path: Path
) -> None:
    code = PROGRAM.format(await_start=await_start, then=then, hangs=HANGS_S)
    program = subprocess.Popen(
        [sys.executable, "-c", code, str(folder / "reader"), str(tmp_path / "box")],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "TMPDIR": str(tmp_path)},  # it cannot tidy up
    )
    try:
        assert program.stdout
        child = int(program.stdout.readline())
        serves = "await_start(" in await_start
        if serves:
            assert int(program.stdout.readline()) > 0

        program.kill()
        program.wait()
        wait_until(lambda: not alive(child))
    finally:
        with suppress(ProcessLookupError):
            os.killpg(program.pid, signal.SIGKILL)
        program.stdout.close()

    if serves:
        texts = [
            part.record.get("text", "")
            for part in read_log(tmp_path / "box" / "log")
            if part.record
        ]
        assert texts
        assert not any("without notice" in text for text in texts)


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
    scale = matrix_of(15e-3 / 512, 4e-3 / 512)  # of the default model's study
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
                robot.say(Image(frame[None], scale))
            robot.hear(lambda peer, since=answered: len(peer.statuses()) > since)

        assert any(status.code == 3 for status in robot.statuses())
        causes = {status.name for status in robot.statuses()}
        assert Cause.WATCHDOG.name not in causes

    assert running.summary["frames"] >= BACKLOGS
    assert running.lines[-1].startswith("ended after")
