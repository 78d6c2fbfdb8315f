"""`monitor` and `monitor-reset`: the service as a user starts it, refused sessions, and
its end.
"""

import io
import json
import os
import pty
import select
import signal
import socket
import sys
import termios
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from itertools import chain, count
from pathlib import Path
from shutil import copytree
from time import monotonic

import click
import numpy as np
import pytest
from analytic_frames import (
    GAP_M,
    IOP_PA,
    MODULUS_PA,
    SCALE,
    THICKNESS_M,
    image,
    tip_of,
    wall_section,
)
from commands import PACED, monitor_folder, started
from small_monitor import Peer
from waiting import FUSE_S, wait_until
from websockets.sync.client import connect

import scleraforce as sf
from scleraforce.base.errors import InputError
from scleraforce.base.units import to_si
from scleraforce.front.api.monitor_settings import prepare_monitor
from scleraforce.live.companions.decision_log import read_log
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.monitor_request import Address, MonitorRequest
from scleraforce.live.network.openigtlink import Image, Query, Sensor, Status
from scleraforce.live.network.operator_reset import ask_reset
from scleraforce.recordings.recording_folder import true_forces
from scleraforce.records.model_folder import SHIPPED_READER

pytest.importorskip("torch")

NONE = (0.0, 0.0, 0.0)
MATRIX = (1e3 * SCALE.lateral_m, *NONE, 1e3 * SCALE.depth_m, *NONE, 1.0, *NONE)
IOP_MMHG = IOP_PA / to_si(1.0, "mmhg")
EYE = f"--eye mine --iop-mmhg {IOP_MMHG:.4f} --gap-mm {1e3 * GAP_M} --globe open"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return monitor_folder(tmp_path_factory.mktemp("monitor"))


IDS = count(1)
SENT: list[np.ndarray] = []
# more frames than the monitor remembers: a live scanner never shows a picture again
SEEDS = range(60)


@cache
def usual_frames() -> dict[int, list[np.ndarray]]:
    return {
        force_mn: [image(wall_section(tip_of(force_mn / 1e3)), seed) for seed in SEEDS]
        for force_mn in (8, 24, 40)
    }


def push(scanner: Peer, force_mn: int, frames: int) -> None:
    """Send frames of a wall under a force, each when the last one was answered and its
    second opinion has come.
    """
    for _ in range(frames):
        serial = next(IDS)
        fresh = usual_frames()[force_mn][serial % len(SEEDS)]
        SENT.append(fresh)
        read = scanner.readings()
        scanner.say(Image(fresh[None], MATRIX), message_id=serial)
        scanner.hear(lambda peer: peer.readings() > read)  # noqa: B023 - called at once

    known = len(scanner.statuses())
    scanner.say(Query("STATUS"))
    scanner.hear(lambda peer: len(peer.statuses()) > known)


@pytest.mark.slow
def test_a_session_from_the_first_frame_to_the_reset_is_logged_and_recorded(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell, secret
) -> None:
    patient = partial(ask_reset, within_s=FUSE_S)
    monkeypatch.setattr("scleraforce.live.network.operator_reset.ask_reset", patient)
    kept = f"--black-box {tmp_path}/box --record {tmp_path}/session"
    given = f"--calibration {folder}/calibration.json {EYE} {kept}"
    first = len(SENT)

    with started(folder, *given.split(), script=PACED) as monitor:
        wall = f"IOP 2.0 mmHg, {THICKNESS_M * 1e6:.0f} µm thick, gap 0.60 mm"
        assert f"0.300 MPa (calibrated), {wall}" in "".join(monitor.lines)
        assert any(line.split() == ["globe", "open"] for line in monitor.lines)
        reset = f"monitor-reset --port {monitor.port}"

        with Peer(monitor.port, version=2) as scanner:
            scanner.say(Sensor((0.0, 0.0, -0.008, 0.0, 0.0, 0.0)), "RobotForce")
            scanner.hear(lambda peer: bool(peer.statuses()))
            assert scanner.statuses()[0].code == 13
            # which the network, always the same, does not see
            withdrawal = _pushed(scanner, 40)
            assert withdrawal.name in {"BOUND", "DANGEROUS_CLASS"}
            push(scanner, 8, 20)
            shell.run(reset, secret("wrong"), code=2)
            assert {status.code for status in scanner.statuses()[-5:]} == {3}
            (code,) = (
                line.split()[1].rstrip(",")
                for line in monitor.lines
                if line.startswith("code")
            )
            shell.run(reset, secret(code))
            shell.run(reset, secret(code), code=2)  # each code is for one reset
            push(scanner, 8, 1)
            assert scanner.statuses()[-1].code == 1

        monitor.process.send_signal(signal.SIGINT)
        told, _ = monitor.process.communicate(timeout=FUSE_S)
        assert monitor.process.returncode == 0

    summary = json.loads(told)
    assert withdrawal.name in {one["cause"] for one in summary["withdrawals"]}
    session = sf.read_recording(tmp_path / "session")
    eye = session.info.eye
    assert (eye.name, eye.thickness_m) == ("mine", THICKNESS_M)
    assert eye.globe.kind == "open"
    assert len(session.frames) == summary["frames"] - summary["lost"]
    assert (session.frame(session.frames[0]) == SENT[first]).all()
    withdrawn, *_ = sorted((tmp_path / "box" / "withdrawals").iterdir())
    assert sf.read_recording(withdrawn).frames


@pytest.mark.slow
def test_a_push_in_two_planes_is_replayed_decided_on_recorded_and_evaluated(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, shell
) -> None:
    model = folder / "shipped" / "reader"
    model.parent.mkdir(exist_ok=True)
    with suppress(FileExistsError):
        model.symlink_to(SHIPPED_READER)

    push = tmp_path / "push"
    eye = "--thickness-um 650 --youngs-modulus-mpa 0.3"
    motion = "--mechanics finite-strain --rate-hz 20 --forces-mn 12 --hold-s 0.5"
    quick = Path(__file__).parents[3] / "docs" / "quick.toml"
    shell.run("phantom --study", quick, "--out", push, eye, motion, CROSS, "--quiet")
    known = f"{eye} --iop-mmhg 2 --globe open {CROSS}"
    kept = f"--black-box {tmp_path}/box --record {tmp_path}/session"

    sent = sf.read_recording(push).frames
    monkeypatch.setattr("scleraforce.live.replay.scanner_player.ANSWER_S", FUSE_S)
    monkeypatch.setattr("sys.stdin", io.StringIO("\n" * len(sent)))
    with started(model.parent, *f"{known} {kept}".split(), script=PACED) as monitor:
        shell.run("replay", push, f"--port {monitor.port} --step --quiet")

    log = [part.record for part in read_log(tmp_path / "box" / "log") if part.record]
    read = [
        record["entry"]
        for record in log
        if record["kind"] == "entry" and record["entry"]["frame"]
    ]
    assert [entry["frame_id"] for entry in read] == [*range(1, len(sent) + 1)]
    true_n = list(true_forces(push).values())
    planes = [entry["plane"] for entry in read]
    assert planes == [sent[entry["frame_id"] - 1].plane for entry in read]
    assert read[0]["code"] == 13
    true_mn = [1e3 * true_n[entry["frame_id"] - 1] for entry in read]
    assert [entry["force_mn"] for entry in read] == pytest.approx(true_mn, abs=1.5)
    assert read[-1]["planes_force_mn"] == pytest.approx(12.0, abs=1.5)
    assert np.hypot(*read[-1]["contact_xyz_mm"][:2]) == pytest.approx(0.5, abs=0.15)
    recorded = sf.read_recording(tmp_path / "session")
    assert [entry.plane for entry in recorded.frames] == planes
    held = [moment for moment in recorded.moments if len(moment) == 2][-3:]
    found = sf.evaluate(
        "default", replace(recorded, frames=tuple(chain(*held)), forces=None)
    )
    assert [frame.plane for frame in found.frames] == ["along", "across"] * 3
    # with no known E
    forces_n = [frame.answer.force_n for frame in found.frames]
    assert forces_n == pytest.approx([0.012] * 6, abs=4e-3)
    assert all(frame.answer.place for frame in found.frames)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "ends"), [("--bound-mn 20", (3, "BOUND")), ("", (1, ""))]
)
def test_a_lower_bound_withdraws_from_a_force_below_the_bound_of_the_study(
    folder: Path, tmp_path: Path, options: str, ends: tuple[int, str]
) -> None:
    known = f"--youngs-modulus-mpa {MODULUS_PA / 1e6} --thickness-um 650"
    given = f"{EYE} {known} {options} --black-box {tmp_path}/box"
    with (
        started(folder, *given.split(), script=PACED) as monitor,
        Peer(monitor.port, version=2) as scanner,
    ):
        last = _pushed(scanner, 24)

    assert (last.code, last.name) == ends, last


def _pushed(scanner: Peer, force_mn: int) -> Status:
    """Wait for the monitor to watch, then return the STATUS after 20 frames of a
    force.
    """
    push(scanner, min(usual_frames()), 10)
    assert scanner.statuses()[-1].code == 1
    push(scanner, force_mn, 20)
    return scanner.statuses()[-1]


CROSS = "--plane along:0:0 --plane across:0.1:90"
MINE = "--calibration calibration.json --eye mine"
KNOWN = "--eye mine --iop-mmhg 2 --learn-eye"


@pytest.fixture
def refused(folder: Path, monkeypatch: pytest.MonkeyPatch, shell):
    """Start a monitor that is refused; return the line."""
    monkeypatch.chdir(folder)

    def refuse(*options: object) -> str:
        line = "monitor ./reader --port 0 --black-box box"
        error = shell.refused(line, *options)
        assert not Path("box").exists()
        return error

    return refuse


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--calibration linear.json --eye mine", "mechanics: linear"),
        ("--calibration calibration.json", "--eye: missing"),
        (f"{MINE} --youngs-modulus-mpa 0.3", "--youngs-modulus-mpa"),
        (f"{MINE} --stiffening 3", "--stiffening: the calibration gives"),
        ("--stiffening 99", "stiffening 99 of the tissue"),
        ("--calibration nowhere.json --eye mine", "nowhere.json"),
        ("--thickness-um 2000", "wall thickness 2000"),
        ("--rigidity 0.03", "--rigidity: of a sealed globe"),
        ("--record box", "the folder of the black box is there"),
        ("--record .", "exists already"),
        ("--record calibration.json/session", ": Not a directory"),
        ("--black-box calibration.json/box", "calibration.json/box: Not a directory"),
        ("--eye 'a\nb'", "--eye: 'a\\nb' has a line break"),
        ("--eye '\x1b[2J'", "--eye: '\\x1b[2J' has a line break or another"),
        ("--eye ''", "--eye: empty; give the eye a name"),
        ("--learn-eye", "--learn-eye: --iop-mmhg is missing"),
        (f"{MINE} {KNOWN}", "--learn-eye: the calibration has this eye's own E"),
        (f"{KNOWN} --youngs-modulus-mpa 0.3", "--learn-eye: E is given"),
        (f"{KNOWN} --no-second-opinion", "--learn-eye: needs the second opinion"),
        (f"{KNOWN} --resume calibration.json", "mine: no monitor has learned it"),
        ("--resume calibration.json", "--resume: needs --learn-eye"),
        ("--plane a", "--plane: 'a' is not NAME:OFFSET_MM:DIRECTION_DEG"),
        ("--plane a:0:0", "--plane: only one"),
        ("--plane \u00e4:0:0 --plane b:0:90", "'\u00e4' cannot name a device"),
        (f"{CROSS} --gap-mm 0.5", "--gap-mm: several planes show their gaps"),
        (f"{CROSS} {KNOWN}", "--learn-eye: it learns from a single plane"),
        ("--host ''", "--host: empty"),
        ("--host no-such-host.invalid", "--host 'no-such-host.invalid'"),
        ("--host 203.0.113.7", "203.0.113.7"),
        ("--web-port 0 --web-host ''", "--web-host: empty"),
        ("--web-port 0 --web-host 203.0.113.7", "--web-host '203.0.113.7'"),
        ("--bound-mn 1", "must be below bound_n"),
    ],
)
def test_a_session_that_cannot_be_served_is_refused_in_one_line(
    refused, options: str, words: str
) -> None:
    if "linear" in options:
        calibration = json.loads(Path("calibration.json").read_text())
        calibration["mechanics"] = "linear"
        Path("linear.json").write_text(json.dumps(calibration))
    assert words in refused(options)


def test_a_model_that_reads_single_planes_serves_no_others(shell) -> None:
    error = shell.refused("monitor paper --port 0", CROSS)
    assert error.startswith("error: --plane: ")


def test_a_model_that_was_changed_never_starts(
    folder: Path, tmp_path: Path, shell
) -> None:
    network = copytree(folder / "reader", tmp_path / "reader") / "model.onnx"
    network.write_bytes(network.read_bytes()[:-1] + b"\0")
    assert "model.onnx" in shell.refused("monitor", tmp_path / "reader", "--port 0")


@pytest.mark.parametrize("option", ["--port", "--web-port"])
def test_a_port_that_is_taken_is_named(refused, option: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        error = refused(option, port)
    assert f"127.0.0.1:{port}: Address already in use; give another {option}" in error


@pytest.fixture
def secret(tmp_path: Path):
    """Return the option with a file that only its user may read."""

    def written(text: str) -> str:
        path = tmp_path / "secret"
        path.touch(mode=0o600)
        path.write_text(text, encoding="utf-8", errors="surrogateescape")
        return f"--token-file {path}"

    return written


@pytest.mark.parametrize(
    ("host", "token"), [("''", "x"), ("x" * 64, "x"), ("127.0.0.1", "\udcff")]
)
def test_a_reset_that_cannot_be_sent_is_one_line(
    shell, secret, host: str, token: str
) -> None:
    shell.refused(f"monitor-reset --host {host}", secret(token))


def test_a_reset_where_nobody_listens_names_the_address(shell, secret) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    error = shell.refused("monitor-reset", secret("x"), "--port", port)
    assert f"127.0.0.1:{port}" in error


@pytest.mark.parametrize(
    ("mode", "text", "words"),
    [
        (0o640, "c0ffee", "mode 640"),
        (0o604, "c0ffee", "mode 604"),
        (0o660, "c0ffee", "mode 660"),
        (0o600, "", "expected one line"),
        (0o600, "\n", "expected one line"),
        (0o600, "x" * 300, "expected one line"),
        (0o600, "a\x00b", "expected one line"),
    ],
)
def test_a_token_that_others_may_see_or_that_is_none_is_not_taken(
    shell, secret, tmp_path: Path, mode: int, text: str, words: str
) -> None:
    option = secret(text)
    (tmp_path / "secret").chmod(mode)
    assert words in shell.refused("monitor-reset", option)


def test_a_token_comes_from_no_pipe_and_from_no_command_line(
    shell, tmp_path: Path
) -> None:
    """What is on a command line can be seen by all users."""
    os.mkfifo(tmp_path / "pipe", 0o600)
    for name, words in (("pipe", "not a regular file"), ("no", "No such file")):
        error = shell.refused("monitor-reset --token-file", tmp_path / name)
        assert words in error
    assert "--token" in shell.refused("monitor-reset --token c0ffee")


def test_a_token_comes_from_standard_input_or_from_a_question(
    monkeypatch: pytest.MonkeyPatch, shell
) -> None:
    asked = list[str]()

    def ask_reset(host: str, port: int, token: str) -> tuple[bool, str]:
        asked.append(token)
        return True, f"{host}:{port}"

    monkeypatch.setattr("scleraforce.live.network.operator_reset.ask_reset", ask_reset)
    piped = io.TextIOWrapper(io.BytesIO(b"123456\nmore"))
    monkeypatch.setattr(sys, "stdin", piped)
    shell.run("monitor-reset")
    hidden = list[object]()

    def prompt(_: str, **how: object) -> str:
        hidden.append(how["hide_input"])
        return " c0ffee "

    monkeypatch.setattr(click, "prompt", prompt)
    monkeypatch.setattr(piped, "isatty", lambda: True)
    shell.run("monitor-reset")
    assert (asked, hidden) == (["123456", "c0ffee"], [True])


def test_the_options_of_the_service_and_of_its_limits_reach_the_monitor(
    tmp_path: Path, monkeypatch, shell
) -> None:
    requests = list[MonitorRequest]()

    def take(request: MonitorRequest) -> None:
        requests.append(request)
        raise InputError("far enough")

    monkeypatch.setattr("scleraforce.front.api.monitor_settings.prepare_monitor", take)
    where = f"--black-box {tmp_path}"
    service = "--host 127.0.0.2 --port 1 --web-port 2 --web-host 127.0.0.3"
    limits = "--withdraw-class 1 --bound-mn 20 --unusable-frames 4 --unread-ms 600"
    more = "--unusable-opinions 5 --reaction-ms 70"
    shell.refused("monitor default", where)
    shell.refused("monitor default", where, service, limits, more)
    (_, plain), (_, settings) = map(prepare_monitor, requests)
    assert (plain.address, plain.console) == (Address("127.0.0.1", 18944), None)
    assert settings.address == Address("127.0.0.2", 1)
    assert settings.console == Address("127.0.0.3", 2)
    assert settings.black_box == tmp_path
    assert settings.token != plain.token
    stated = {
        "withdraw_class": 1,
        "bound_n": 0.02,
        "unusable_frames": 4,
        "unusable_opinions": 5,
        "reaction_s": 0.07,
        "loss_in_window_s": 0.6,
    }
    reached = {name: getattr(settings.limits, name) for name in stated}
    assert reached == pytest.approx(stated)
    study = sf.load_model("default").study.oct
    scale_m = (study.width_m / study.columns, study.depth_m / study.rows)
    assert plain.limits == MonitorLimits(
        size=(study.rows, study.columns), scale_m=scale_m, expects_opinion=True
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]
)
def test_a_signal_ends_a_monitor_whose_warnings_its_console_shows_and_no_module_of_the_current_folder_has_run(
    folder: Path, tmp_path: Path, number: signal.Signals
) -> None:
    for name in (
        "numpy",
        "signal",
        "json",
        "socket",
        "scleraforce",
        "fastapi",
        "cv2",
        "onnxruntime",
    ):
        (tmp_path / f"{name}.py").write_text(
            f"open({str(tmp_path / 'ran')!r}, 'a').write({name!r})\n"
        )

    eye = f"--calibration {folder}/calibration.json --eye mein --iop-mmhg 2"
    options = f"{eye} --width-mm 6 --black-box {tmp_path}/box --web-port 0"
    with (
        started(folder, *options.split(), here=tmp_path, script=PACED) as monitor,
        Peer(monitor.port) as robot,
    ):
        assert monitor.process.stderr
        said = iter(monitor.process.stderr.readline, "")
        # it has loaded all that it needs
        address = next(line.split()[1] for line in said if line.startswith("console"))
        live = f"{address.replace('http', 'ws')}live"
        with connect(live, origin=address.rstrip("/"), open_timeout=FUSE_S) as page:
            hello = json.loads(page.recv(timeout=FUSE_S))
        warned = [line for line in monitor.lines if line.startswith("warning")]
        assert "mein is not in" in warned[0]
        assert "of the wall are visible; at least" in warned[1]
        shown = [f"warning    {remark['words']}\n" for remark in hello["remarks"]]
        assert shown == warned

        # it has been let in, not only queued by the system
        robot.hear(lambda peer: bool(peer.statuses()))
        children = children_of(monitor.process.pid)
        assert len(children) == 4  # black box, second opinion, watchdog, console

        for _ in range(1 if number is signal.SIGINT else 2):
            # a shell and the system may both say so
            os.kill(monitor.process.pid, number)

        told, said = monitor.process.communicate(timeout=FUSE_S)
        assert monitor.process.returncode == 0
        assert "the monitor ends" in robot.wait_for_code(3).message

    assert said.splitlines()[-1].startswith("ended after 0 frames")
    assert json.loads(told)["frames"] == 0
    assert not (tmp_path / "ran").exists()
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

    pid, terminal = pty.fork()  # the monitor leads the terminal's session
    if pid == 0:
        command = [
            "monitor",
            str(folder / "reader"),
            "--port",
            str(port),
            "--black-box",
            str(tmp_path / "box"),
        ]
        os.execv(sys.executable, [sys.executable, str(PACED), *command])

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

    texts = [
        part.record.get("text", "")
        for part in read_log(tmp_path / "box" / "log")
        if part.record
    ]
    assert not any("without notice" in text for text in texts)


def read_until(terminal: int, word: str, within_s: float = FUSE_S) -> None:
    said = ""
    end_s = monotonic() + within_s
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "words"),
    [(".", "exists already"), ("calibration.json/session", ": Not a directory")],
)
def test_a_session_that_cannot_be_recorded_is_refused_in_one_line(
    refused, place: str, words: str
):
    assert words in refused("--record", place)
