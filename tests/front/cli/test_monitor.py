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
import tempfile
import termios
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from io import StringIO
from itertools import chain, count
from math import radians
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
from commands import BINS, PACED, monitor_folder, started
from small_models import fixed_study
from small_monitor import Peer
from waiting import FUSE_S, wait_until
from websockets.sync.client import connect

from scleraforce.base.errors import InputError
from scleraforce.base.units import to_si
from scleraforce.calibration.evaluation import evaluate_recordings
from scleraforce.front.cli.main import run
from scleraforce.live.companions.decision_log import read_log
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.network.openigtlink import Image, Query, Sensor, Status
from scleraforce.live.network.operator_reset import ask_reset
from scleraforce.reading.load_model import load_reader
from scleraforce.recordings.recording_folder import read_recording, true_forces
from scleraforce.records.model_folder import SHIPPED_READER
from scleraforce.records.scan import Plane

pytest.importorskip("torch")

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
EYE = [
    "--eye",
    "mine",
    "--iop-mmhg",
    f"{IOP_PA / to_si(1.0, 'mmhg'):.4f}",
    "--gap-mm",
    f"{GAP_M * 1e3}",
]
EYE += ["--globe", "open"]


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
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    patient = partial(ask_reset, within_s=FUSE_S)
    monkeypatch.setattr("scleraforce.live.network.operator_reset.ask_reset", patient)
    kept = ["--black-box", str(tmp_path / "box"), "--record", str(tmp_path / "session")]
    first = len(SENT)

    with started(
        folder,
        "--calibration",
        str(folder / "calibration.json"),
        *EYE,
        *kept,
        script=PACED,
    ) as monitor:
        known = (
            f"0.300 MPa (calibrated), IOP 2.0 mmHg, {THICKNESS_M * 1e6:.0f} µm thick,"
            " gap 0.60 mm"
        )
        assert known in "".join(monitor.lines)
        assert any(line.split() == ["globe", "open"] for line in monitor.lines)

        with Peer(monitor.port, version=2) as scanner:
            scanner.say(Sensor((0.0, 0.0, -0.008, 0.0, 0.0, 0.0)), "RobotForce")
            scanner.hear(lambda peer: bool(peer.statuses()))
            assert scanner.statuses()[0].code == 13
            # which the network, always the same, does not see
            withdrawal = _pushed(scanner, 40)
            assert withdrawal.name in {"BOUND", "DANGEROUS_CLASS"}
            push(scanner, 8, 20)
            assert (
                run(["monitor-reset", "--port", str(monitor.port), *secret("wrong")])
                == 2
            )
            assert {status.code for status in scanner.statuses()[-5:]} == {3}
            (code,) = (
                line.split()[1].rstrip(",")
                for line in monitor.lines
                if line.startswith("code")
            )
            reset = ["monitor-reset", "--port", str(monitor.port), *secret(code)]
            assert run(reset) == 0
            assert run(reset) == 2  # each code is for one reset
            push(scanner, 8, 1)
            assert scanner.statuses()[-1].code == 1

        monitor.process.send_signal(signal.SIGINT)
        told, _ = monitor.process.communicate(timeout=FUSE_S)
        assert monitor.process.returncode == 0

    summary = json.loads(told)
    assert withdrawal.name in {one["cause"] for one in summary["withdrawals"]}
    session = read_recording(tmp_path / "session")
    assert (session.info.eye_name, session.info.eye.thickness_m) == (
        "mine",
        THICKNESS_M,
    )
    assert session.info.eye.globe.kind == "open"
    assert len(session.frames) == summary["frames"] - summary["lost"]
    assert (session.frame(session.frames[0]) == SENT[first]).all()
    withdrawn, *_ = sorted((tmp_path / "box" / "withdrawals").iterdir())
    assert read_recording(withdrawn).frames


@pytest.mark.slow
def test_a_push_in_two_planes_is_replayed_decided_on_recorded_and_evaluated(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = folder / "shipped" / "reader"
    model.parent.mkdir(exist_ok=True)
    with suppress(FileExistsError):
        model.symlink_to(SHIPPED_READER)

    push = tmp_path / "push"
    session = tmp_path / "session"
    eye = ["--thickness-um", "650", "--youngs-modulus-mpa", "0.3"]
    drawn = [
        "--mechanics",
        "finite-strain",
        "--rate-hz",
        "20",
        "--forces-mn",
        "12",
        "--hold-s",
        "0.5",
    ]
    quick = Path(__file__).parents[3] / "docs" / "quick.toml"
    assert (
        run(
            [
                "phantom",
                "--study",
                str(quick),
                "--out",
                str(push),
                *eye,
                *drawn,
                *CROSS,
                "--quiet",
            ]
        )
        == 0
    )
    known = [*eye, "--iop-mmhg", "2", "--globe", "open", *CROSS]
    kept = ["--black-box", str(tmp_path / "box"), "--record", str(session)]

    sent = read_recording(push).frames
    monkeypatch.setattr("scleraforce.live.replay.scanner_player.ANSWER_S", FUSE_S)
    monkeypatch.setattr("sys.stdin", StringIO("\n" * len(sent)))
    with started(model.parent, *known, *kept, script=PACED) as monitor:
        assert (
            run(["replay", str(push), "--port", str(monitor.port), "--step", "--quiet"])
            == 0
        )

    log = [part.record for part in read_log(tmp_path / "box" / "log") if part.record]
    read = [
        record["entry"]
        for record in log
        if record["kind"] == "entry" and record["entry"]["frame"]
    ]
    assert [entry["frame_id"] for entry in read] == [*range(1, len(sent) + 1)]
    true_n = list(true_forces(push).values())
    assert [entry["plane"] for entry in read] == [
        sent[entry["frame_id"] - 1].plane for entry in read
    ]
    assert read[0]["code"] == 13
    true_mn = [1e3 * true_n[entry["frame_id"] - 1] for entry in read]
    assert [entry["force_mn"] for entry in read] == pytest.approx(true_mn, abs=1.5)
    assert read[-1]["planes_force_mn"] == pytest.approx(12.0, abs=1.5)
    assert np.hypot(*read[-1]["contact_xyz_mm"][:2]) == pytest.approx(0.5, abs=0.15)
    recorded = read_recording(session)
    assert [entry.plane for entry in recorded.frames] == [
        entry["plane"] for entry in read
    ]
    held = [moment for moment in recorded.moments if len(moment) == 2][-3:]
    found = evaluate_recordings(
        load_reader("default"),
        [replace(recorded, frames=tuple(chain(*held)), forces=None)],
    )
    assert [frame.plane for frame in found.frames] == ["along", "across"] * 3
    # with no known E
    assert [frame.answer.force_n for frame in found.frames] == pytest.approx(
        [0.012] * 6, abs=4e-3
    )
    assert all(frame.answer.place for frame in found.frames)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "ends"), [(["--bound-mn", "20"], (3, "BOUND")), ([], (1, ""))]
)
def test_a_lower_bound_withdraws_from_a_force_below_the_bound_of_the_study(
    folder: Path, tmp_path: Path, options: list[str], ends: tuple[int, str]
) -> None:
    known = [
        *EYE,
        "--youngs-modulus-mpa",
        f"{MODULUS_PA / 1e6}",
        "--thickness-um",
        f"{THICKNESS_M * 1e6}",
    ]
    kept = ["--black-box", str(tmp_path / "box")]

    with (
        started(folder, *known, *options, *kept, script=PACED) as monitor,
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


CROSS = ["--plane", "along:0:0", "--plane", "across:0.1:90"]
MINE = ["--calibration", "calibration.json", "--eye", "mine"]


@pytest.fixture
def refused(folder: Path, monkeypatch: pytest.MonkeyPatch, shell):
    """Start a monitor that is refused; return the line."""
    monkeypatch.chdir(folder)

    def refuse(*options: object) -> str:
        error = shell.refused(
            "monitor", "./reader", "--port", 0, "--black-box", "box", *options
        )
        assert not Path("box").exists()
        return error

    return refuse


def test_a_session_that_cannot_be_served_is_refused_in_one_line(
    refused, tmp_path: Path
) -> None:
    of_mine = json.loads(Path("calibration.json").read_text())
    linear = tmp_path / "linear.json"
    linear.write_text(json.dumps({**of_mine, "mechanics": "linear"}))

    for options, words in (
        (["--calibration", str(linear), "--eye", "mine"], "mechanics: linear"),
        (MINE[:2], "--eye: missing"),
        ([*MINE, "--youngs-modulus-mpa", "0.3"], "--youngs-modulus-mpa"),
        ([*MINE, "--stiffening", "3"], "--stiffening: the calibration gives"),
        (["--stiffening", "99"], "stiffening 99 of the tissue"),
        (["--calibration", "nowhere.json", "--eye", "mine"], "nowhere.json"),
        (["--thickness-um", "2000"], "wall thickness 2000"),
        (["--thickness-um", "5000"], "5000 is above the largest allowed value 3000"),
        (["--thickness-um", "nan"], "nan"),
        (["--rigidity", "0.03"], "--rigidity: of a sealed globe"),
        (["--record", "box"], "the folder of the black box is there"),
        (
            ["--black-box", "calibration.json/box"],
            "--black-box calibration.json/box: Not a directory",
        ),
        (["--eye", "a\nb"], "--eye: 'a\\nb' has a line break"),
        (
            ["--eye", "\x1b[2J"],
            "--eye: '\\x1b[2J' has a line break or another unprintable",
        ),
        (["--eye", ""], "--eye: empty; give the eye a name"),
        (["--learn-eye"], "--learn-eye: --iop-mmhg is missing"),
        (
            [*MINE, *EYE[2:], "--learn-eye"],
            "--learn-eye: the calibration has this eye's own E",
        ),
        (
            [*EYE, "--learn-eye", "--youngs-modulus-mpa", "0.3"],
            "--learn-eye: E is given",
        ),
        (
            [*EYE, "--learn-eye", "--no-second-opinion"],
            "--learn-eye: needs the second opinion",
        ),
        (
            [*EYE, "--learn-eye", "--resume", "calibration.json"],
            "mine: no monitor has learned it",
        ),
        ([*EYE, "--resume", "calibration.json"], "--resume: needs --learn-eye"),
        (["--plane", "a:0:0"], "--plane: only one"),
        (
            ["--plane", "a:0:0", "--plane", "a:0:90"],
            "--plane: name: 'a' is there twice",
        ),
        (["--plane", "a"], "--plane: 'a' is not NAME:OFFSET_MM:DIRECTION_DEG"),
        (
            ["--plane", "\u00e4:0:0", "--plane", "b:0:90"],
            "--plane: '\u00e4' cannot name a device",
        ),
        ([*CROSS, "--gap-mm", "0.5"], "--gap-mm: several planes show their gaps"),
        (
            [*CROSS, "--eye", "mine", "--iop-mmhg", "2", "--learn-eye"],
            "--learn-eye: it learns from a single plane",
        ),
        (["--host", ""], "--host: empty"),
        (["--host", "no-such-host.invalid"], "--host 'no-such-host.invalid'"),
        (["--web-port", "0", "--web-host", ""], "--web-host: empty"),
        (["--web-port", "0", "--web-host", "203.0.113.7"], "--web-host '203.0.113.7'"),
        (["--web-port", "65536"], "--web-port"),
        (["--bound-mn", "1"], "must be below bound_n"),
        (["--host", "203.0.113.7"], "203.0.113.7"),
    ):
        assert words in refused(*options)


def test_a_model_that_reads_single_planes_serves_no_others(shell) -> None:
    error = shell.refused("monitor", "paper", "--port", 0, *CROSS)
    assert "is a classifier, which reads single planes" in error
    assert error.startswith("error: --plane: ")


@pytest.mark.slow
def test_a_session_that_cannot_be_recorded_is_refused_in_one_line(refused) -> None:
    assert "exists already" in refused("--record", ".")
    assert "calibration.json/session: Not a directory" in refused(
        "--record", "calibration.json/session"
    )


def test_a_model_that_was_changed_never_starts(
    folder: Path, tmp_path: Path, shell
) -> None:
    network = copytree(folder / "reader", tmp_path / "reader") / "model.onnx"
    network.write_bytes(network.read_bytes()[:-1] + b"\0")
    assert "model.onnx" in shell.refused("monitor", tmp_path / "reader", "--port", 0)


def test_a_port_that_is_taken_is_named(refused) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for option in ("--port", "--web-port"):
            assert (
                f"127.0.0.1:{port}: Address already in use; give another {option}"
                in refused(option, port)
            )


def secret(text: str) -> list[str]:
    """Return the option with a file that only its user may read."""
    descriptor, path = tempfile.mkstemp()
    with open(descriptor, "w", encoding="utf-8", errors="surrogateescape") as file:
        file.write(f"{text}\n")
    return ["--token-file", path]


def test_a_reset_that_cannot_be_sent_is_one_line(shell) -> None:
    for options in (
        ["--host", "", *secret("x")],
        ["--host", "x" * 64, *secret("x")],
        secret("\udcff"),
    ):
        shell.refused("monitor-reset", *options)

    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]

    assert f"127.0.0.1:{port}" in shell.refused(
        "monitor-reset", *secret("x"), "--port", port
    )


def test_a_token_that_others_may_see_is_not_taken(shell, tmp_path: Path) -> None:
    token = tmp_path / "token"
    token.write_text("c0ffee\n")
    for mode in (0o640, 0o604, 0o660):
        token.chmod(mode)
        assert f"mode {mode:o}" in shell.refused("monitor-reset", "--token-file", token)

    os.mkfifo(tmp_path / "pipe", 0o600)
    for name, words in (("pipe", "not a regular file"), ("no", "No such file")):
        assert words in shell.refused("monitor-reset", "--token-file", tmp_path / name)

    assert "--token" in shell.refused("monitor-reset", "--token", "c0ffee")
    token.chmod(0o600)
    for text in ("", "\n", "x" * 300, "a\x00b"):
        token.write_text(text)
        said = shell.refused("monitor-reset", "--token-file", token)
        assert "expected one line with the token or the code" in said


def test_a_token_comes_from_standard_input_or_from_a_question(
    monkeypatch: pytest.MonkeyPatch, shell
) -> None:
    """What is on a command line can be seen by all users."""
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


def test_another_eye_than_the_calibrations_and_narrow_frames_are_warned_of_at_the_start(
    folder: Path, tmp_path
) -> None:
    given = [
        "--calibration",
        str(folder / "calibration.json"),
        "--eye",
        "mein",
        "--iop-mmhg",
        "2",
        "--width-mm",
        "6",
    ]
    options = ["--no-second-opinion", "--black-box", str(tmp_path / "box")]
    with started(folder, *given, *options, "--web-port", "0") as monitor:
        warned = [line for line in monitor.lines if line.startswith("warning")]
        assert monitor.process.stderr
        said = iter(monitor.process.stderr.readline, "")
        address = next(line.split()[1] for line in said if line.startswith("console"))
        live = f"{address.replace('http', 'ws')}live"
        with connect(live, origin=address.rstrip("/"), open_timeout=FUSE_S) as page:
            hello = json.loads(page.recv(timeout=FUSE_S))

    assert "mein is not in" in warned[0]
    assert "(mine): read with the population's modulus" in warned[0]
    assert any("of the wall are visible; at least" in line for line in warned[1:])
    shown = [f"warning    {remark['words']}\n" for remark in hello["remarks"]]
    assert shown == warned


def test_each_option_reaches_its_setting(
    folder: Path, tmp_path: Path, monkeypatch, shell
) -> None:
    import scleraforce.live.monitor_run as module

    taken: list[module.MonitorSettings] = []

    def take(
        _model: Path, _reader: object, settings: module.MonitorSettings, _note: object
    ) -> None:
        taken.append(settings)
        raise InputError("far enough")

    monkeypatch.setattr(module, "monitor_service", take)
    monitor = ["monitor", folder / "reader", "--black-box", tmp_path]
    shell.refused(*monitor)
    other = {
        "--host": "127.0.0.2",
        "--port": "1",
        "--web-port": "2",
        "--web-host": "127.0.0.3",
        "--eye": "yours",
        "--polar-angle-deg": "30",
        "--plane-direction-deg": "-120",
        "--columns": "400",
        "--rows": "300",
        "--width-mm": "8",
        "--depth-mm": "6",
        "--refractive-index": "1.3",
        "--withdraw-class": "1",
        "--bound-mn": "20",
        "--unusable-frames": "4",
        "--unusable-opinions": "5",
        "--reaction-ms": "70",
        "--unread-ms": "600",
        "--iop-mmhg": "3",
        "--thickness-um": "700",
        "--youngs-modulus-mpa": "0.3",
        "--gap-mm": "0.6",
        "--record": str(tmp_path / "session"),
    }
    words = (word for pair in other.items() for word in pair)
    assert "far enough" in shell.refused(*monitor, "--no-second-opinion", *words)
    shell.refused(*monitor, *CROSS, "--plane-direction-deg", "-120")
    plain, settings, crossed = taken
    along, across = crossed.scan.planes
    assert (along, across.name) == (Plane("along", 0.0, 0.0), "across")
    assert (across.offset_m, across.direction_rad) == pytest.approx(
        (1e-4, radians(90.0))
    )
    assert crossed.setup.needle.gap_m is None
    # as the loop and the second opinion see it
    turned = crossed.setup.turned(across.direction_rad)
    assert turned.scan.direction_rad == pytest.approx(radians(-30.0))
    limits = settings.limits
    study = fixed_study(BINS)
    assert (settings.address, settings.console) == (
        module.Address("127.0.0.2", 1),
        module.Address("127.0.0.3", 2),
    )
    assert (settings.eye, settings.record, settings.black_box) == (
        "yours",
        tmp_path / "session",
        tmp_path,
    )
    known = settings.setup
    scan = settings.scan
    assert (scan.columns, scan.rows, scan.bits, scan.refractive_index, scan.planes) == (
        400,
        300,
        16,
        1.3,
        (),
    )
    assert (scan.width_m, scan.depth_m, scan.direction_rad) == pytest.approx(
        (8e-3, 6e-3, radians(-120.0))
    )
    assert (known.needle.polar_rad, known.scan.direction_rad) == pytest.approx(
        (radians(30.0), radians(-120.0))
    )
    assert (
        known.eye.iop_pa,
        known.eye.thickness_m,
        known.needle.gap_m,
    ) == pytest.approx((to_si(3.0, "mmhg"), 700e-6, 0.6e-3))
    assert known.eye.modulus is not None
    assert known.eye.modulus.mean_pa == pytest.approx(0.3e6)
    assert (limits.size, limits.scale_m) == ((300, 400), pytest.approx((20e-6, 20e-6)))
    assert (
        limits.withdraw_class,
        limits.unusable_frames,
        limits.unusable_opinions,
    ) == (1, 4, 5)
    assert (limits.bound_n, limits.reaction_s) == (
        pytest.approx(0.02),
        pytest.approx(0.07),
    )
    assert limits.loss_in_window_s == pytest.approx(0.6)
    assert (limits.expects_opinion, limits.reads_force) == (False, True)
    assert settings.token != plain.token
    scale_m = (
        study.oct.width_m / study.oct.columns,
        study.oct.depth_m / study.oct.rows,
    )
    size = (study.oct.rows, study.oct.columns)
    assert plain.limits == MonitorLimits(
        size=size, scale_m=scale_m, expects_opinion=True
    )
    assert (plain.address, plain.console, plain.record) == (
        module.Address("127.0.0.1", 18944),
        None,
        None,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT]
)
def test_a_signal_ends_it_in_order_leaves_no_process_and_no_module_of_the_current_folder_has_run(
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

    options = ["--black-box", str(tmp_path / "box"), "--web-port", "0"]
    with (
        started(folder, *options, here=tmp_path, script=PACED) as monitor,
        Peer(monitor.port) as robot,
    ):
        assert monitor.process.stderr
        lines = iter(monitor.process.stderr.readline, "")
        # it has loaded all that it needs
        assert any(line.startswith("console    http://127.0.0.1:") for line in lines)
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
