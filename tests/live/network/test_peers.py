"""Other programs understand our messages, and we theirs: pyigtl, OpenIGTLink's own
library.
"""

import json
import re
import shutil
import signal
import subprocess
from contextlib import closing
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import numpy as np
import pytest
from small_monitor import COLUMNS, ROWS, SCALE_M, Peer, frame_of, serving
from small_recordings import write_small_recording
from sources import EXAMPLES, example_module
from waiting import FUSE_S, wait_until

from scleraforce.live.network.openigtlink import (
    Decoder,
    Image,
    Received,
    Text,
    Transform,
    encode,
)
from scleraforce.live.network.scanner_frame import FrameAssembler
from scleraforce.live.replay.scanner_player import AnswerLog, Player, ScannerClient
from scleraforce.recordings.recording_folder import read_recording

pyigtl = pytest.importorskip("pyigtl")
messages = pytest.importorskip("pyigtl.messages")

VERSIONS = [1, 2]
MATRIX = np.array(
    [
        [0.0, -2.0, 0.0, 5.0],
        [1.0, 0.0, 0.0, -3.0],
        [0.0, 0.0, 4.0, 0.5],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def read_by_pyigtl(data: bytes):
    fields = messages.MessageBase.parse_header(data[:58])
    message = messages.MessageBase.create_message(fields["message_type"])
    assert fields["body_size"] == len(data) - 58
    message.unpack(fields, data[58:])
    return message


def written_by_pyigtl(message, version: int) -> Received:
    message.header_version = version
    if version > 1:
        message.message_id = 9
        message.metadata = {"eye": "left", "probe": "b"}

    (event,) = Decoder().feed(message.pack())
    assert isinstance(event, Received)  # its CRC is right
    assert event.header.version == version
    assert event.header.time_s == pytest.approx(1234.5, abs=1e-6)
    assert (event.message_id, event.metadata) == (
        (9, {"eye": "left", "probe": "b"}) if version > 1 else (0, {})
    )

    return event


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("dtype", [np.int8, np.uint8, np.int16, np.uint16])
def test_images_are_read_and_written(dtype, version):
    pixels = np.arange(60).reshape(1, 6, 10).astype(dtype)
    event = written_by_pyigtl(
        pyigtl.ImageMessage(pixels, timestamp=1234.5, device_name="Scanner"), version
    )
    assert isinstance(event.message, Image)
    assert np.array_equal(event.message.pixels, pixels)
    ours = encode(
        Image(pixels.astype(pixels.dtype.newbyteorder("="))), "Scanner", version=version
    )
    theirs = read_by_pyigtl(ours)
    assert theirs.image.dtype.itemsize == pixels.dtype.itemsize
    assert np.array_equal(theirs.image.reshape(pixels.shape), pixels)


def test_its_image_becomes_a_frame_with_the_pixels_of_its_matrix():
    """Columns 0.003 * 5 mm apart, rows 0.001 * 3 mm, in a plane that lies askew."""
    matrix = np.eye(4)
    matrix[:3, 0] = 0.003 * np.array([3.0, 0.0, 4.0])
    matrix[:3, 1] = 0.001 * np.array([1.0, -2.0, 2.0])
    pixels = np.arange(60, dtype=np.int16).reshape(1, 6, 10)
    message = pyigtl.ImageMessage(pixels, ijk_to_world_matrix=matrix, timestamp=1234.5)
    image = written_by_pyigtl(message, 1).message
    assert isinstance(image, Image)
    frame = FrameAssembler().add(image)
    assert frame is not None
    assert (frame.lateral_m, frame.depth_m) == pytest.approx((15e-6, 3e-6), rel=1e-6)
    assert frame.pixels.dtype == np.uint16
    assert np.array_equal(frame.pixels, pixels[0])


@pytest.mark.parametrize("version", VERSIONS)
def test_strings_and_transforms_are_read_and_written(version):
    assert written_by_pyigtl(
        pyigtl.StringMessage("force", timestamp=1234.5), version
    ).message == Text("force")
    assert read_by_pyigtl(encode(Text("force"), "M", version=version)).string == "force"
    found = written_by_pyigtl(
        pyigtl.TransformMessage(MATRIX, timestamp=1234.5), version
    ).message
    assert isinstance(found, Transform)
    assert np.array_equal(np.reshape(found.matrix, (4, 3)).T, MATRIX[:3])
    assert np.array_equal(
        read_by_pyigtl(encode(found, "M", version=version)).matrix, MATRIX
    )


def test_our_metadata_is_read():
    theirs = read_by_pyigtl(
        encode(
            Text("a"), "M", version=2, message_id=3, metadata={"eye": "left", "b": ""}
        )
    )
    assert (theirs.message_id, theirs.metadata) == (3, {"eye": "left", "b": ""})


HEADERS = Path("/usr/include/openigtlink")
DEBIANS = Path("/usr/share/doc/openigtlink-examples/examples")
SUPPORT = Path(__file__).parents[2] / "support"

compiled = pytest.mark.skipif(
    shutil.which("g++") is None or not HEADERS.is_dir(),
    reason="g++ or libopenigtlink-dev is not installed",
)
debians = pytest.mark.skipif(
    not DEBIANS.is_dir(), reason="openigtlink-examples is not installed"
)


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Compile a program; what it gives is the path of the program."""
    folder = tmp_path_factory.mktemp("peers")

    def compiled_program(source: Path) -> str:
        program = folder / source.stem
        command = [
            "g++",
            "-w",
            f"-I{HEADERS}",
            str(source),
            "-o",
            str(program),
            "-lOpenIGTLink",
            "-lpthread",
        ]
        subprocess.run(command, check=True)

        return str(program)

    return compiled_program


@compiled
@pytest.mark.slow
def test_a_scanner_in_cpp_is_answered_frame_by_frame_up_to_the_withdrawal(
    build,
):
    with serving() as port:
        size = [str(COLUMNS), str(ROWS), str(SCALE_M[0] * 1e3), str(SCALE_M[1] * 1e3)]
        forces_un = ["10000"] * 11 + ["45000"]
        command = [
            build(SUPPORT / "image_sender.cxx"),
            str(port),
            *size,
            "14",
            *forces_un,
        ]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=FUSE_S, check=True
        )

    lines = [line.split(" ", 3) for line in done.stdout.splitlines()]
    codes = [(int(code), int(sub_code)) for _, code, sub_code, _ in lines]
    assert codes[:11] == [(1, 0)] * 11
    assert [code for code, _ in codes[11:]] == [3, 3, 3]
    readings = [json.loads(text) for *_, text in lines]
    assert [reading["frame"] for reading in readings] == list(range(1, 15))
    assert [reading["force_mn"] for reading in readings[10:12]] == pytest.approx(
        [10.0, 45.0]
    )
    assert readings[11]["sub_code"] == codes[11][1] in (101, 102, 103)


def lines_until(child: "subprocess.Popen[str]", line: str) -> str:
    """Return what a program prints, up to a line."""
    assert child.stdout
    said = ""
    while not said.endswith(line):
        said += child.stdout.readline()
        assert child.poll() is None, said
    return said


@compiled
@debians
@pytest.mark.slow
def test_debians_receiver_prints_what_the_monitor_says(build):
    program = build(DEBIANS / "Receiver" / "ReceiveClient.cxx")
    with serving() as port, Peer(port) as scanner:
        child = subprocess.Popen(
            [program, "127.0.0.1", str(port)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        out = lines_until(child, " Code      : 13\n")
        scanner.watch(force_mn=10.0)
        scanner.read(45.0)
        out += lines_until(child, " Error Name: DANGEROUS_CLASS\n")
        child.kill()
        out += child.communicate()[0]

    assert " Code      : 1\n" in out
    assert " Code      : 3\n" in out
    assert out.index(" Code      : 1\n") < out.index(" Code      : 3\n")
    assert '"class": 1' in out
    assert " Error Name: DANGEROUS_CLASS\n" in out
    assert "WITHDRAW: " in out


def test_pyigtl_sends_frames_and_reads_what_is_said_of_them():
    with serving() as port, Peer(port) as robot:
        client = pyigtl.OpenIGTLinkClient("127.0.0.1", port)
        try:
            wait_until(client.is_connected)
            matrix = np.diag([SCALE_M[0] * 1e3, SCALE_M[1] * 1e3, 1.0, 1.0])

            for number in range(1, 9):
                pixels = frame_of(12_000, number)[None]
                message = pyigtl.ImageMessage(
                    pixels, ijk_to_world_matrix=matrix, device_name="PyScanner"
                )
                assert client.send_message(message)
                robot.hear_readings(number)

            reading = client.wait_for_message("ForceReading", timeout=FUSE_S)
            assert reading is not None
            said = json.loads(reading.string)
        finally:
            client.stop()

        assert (said["class"], said["state"], said["code"]) == (1, "WATCHING", 1)
        assert said["force_mn"] == pytest.approx(12.0)


@pytest.fixture
def pyigtl_client():
    """Load the example."""
    return example_module("pyigtl_client")


def test_pyigtl_drops_the_status_and_the_example_obeys_the_string(
    pyigtl_client, monkeypatch
):
    """A busy machine must not make it silent."""
    monkeypatch.setattr(pyigtl_client, "SILENCE_S", FUSE_S)
    monkeypatch.setattr(pyigtl_client, "OLD_S", FUSE_S)
    orders = []

    def tell(go_on, why):
        orders.append((go_on, why))

    patient = {"silence_s": FUSE_S, "lag_s": FUSE_S, "catch_up_s": FUSE_S}
    with serving(clock=None, **patient) as port, Peer(port) as scanner:
        watching = Thread(
            target=pyigtl_client.watch, args=("127.0.0.1", port, tell), daemon=True
        )
        watching.start()
        wait_until(lambda: (False, "NOT_READY: no good frame yet") in orders)
        scanner.watch(force_mn=10.0)
        wait_until(lambda: orders[-1][0])
        scanner.read(45.0)
        wait_until(lambda: not orders[-1][0])
        monkeypatch.setattr(pyigtl_client, "SILENCE_S", 0.0)
        watching.join(FUSE_S)

    assert not watching.is_alive()
    status = scanner.statuses()[-1]
    decision = json.loads(scanner.texts("ForceDecision")[-1].text)
    assert decision == {
        "code": status.code,
        "sub_code": status.subcode,
        "state": "WITHDRAW",
        "cause": status.name,
        "message": status.message,
    }
    assert orders[-2:] == [(False, status.message), (False, "no decision for 150 ms")]


START_S = 1000.0
GO_ON = (True, "WATCHING: class 0")
SILENT = (False, "no decision for 150 ms")


def said(code: object, at_s: float, text: str | None = None) -> SimpleNamespace:
    """A STRING as pyigtl hands it over."""
    words = {1: "WATCHING: class 0"}.get(code, "WITHDRAW: force")
    content = json.dumps({"code": code, "message": words}) if text is None else text
    return SimpleNamespace(
        device_name="ForceDecision", string=content, timestamp=START_S + at_s
    )


@pytest.fixture
def robot_orders(pyigtl_client, monkeypatch):
    """Let the example hear what arrives at a time (s); what it gives is its orders."""

    def run(arriving: list[tuple[float, SimpleNamespace]]) -> list[tuple[bool, str]]:
        now_s = START_S
        orders = list[tuple[bool, str]]()

        def sleep(by_s: float) -> None:
            nonlocal now_s
            now_s += by_s

        def latest() -> list[SimpleNamespace]:
            found = [m for at_s, m in arriving if START_S + at_s <= now_s]
            arriving[:] = arriving[len(found) :]
            return found

        client = SimpleNamespace(get_latest_messages=latest, stop=lambda: None)
        clock = SimpleNamespace(monotonic=lambda: now_s, sleep=sleep)
        library = SimpleNamespace(OpenIGTLinkClient=lambda *_: client)
        monkeypatch.setattr(pyigtl_client, "time", clock)
        monkeypatch.setattr(pyigtl_client, "pyigtl", library)
        pyigtl_client.watch("monitor", 18944, lambda *order: orders.append(order))

        return orders

    return run


@pytest.mark.parametrize(
    ("arriving", "orders"),
    [
        ([(0.01, said(1, 0.01)), (0.155, said(1, 0.155))], [GO_ON, GO_ON, SILENT]),
        ([(0.01, said(1, 0.01)), (0.165, said(1, 0.165))], [GO_ON, SILENT]),
        (
            [(0.01, said(1, 0.01)), (0.14, said(3, 0.14))],
            [GO_ON, (False, "WITHDRAW: force"), SILENT],
        ),
        ([(0.01, said(1, 0.01)), (0.14, said(1, 0.03))], [GO_ON, SILENT]),
        (
            [(0.01, said(1, 0.01)), (0.14, said(3, 0.03))],
            [GO_ON, (False, "WITHDRAW: force"), SILENT],
        ),
    ],
    ids=["in time", "silence", "withdrawal", "old OK", "old withdrawal"],
)
def test_the_pyigtl_example_keeps_the_rule(robot_orders, arriving, orders):
    assert robot_orders(arriving) == orders


def test_the_page_shows_the_example():
    page = (EXAMPLES.parent / "docs" / "howto" / "robot.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"^```text\n(def .*?)^```", page, re.DOTALL | re.MULTILINE)
    assert shown in (EXAMPLES / "pyigtl_client.py").read_text(encoding="utf-8")


@pytest.mark.parametrize("text", ["", "{", "{}", "[1]", '{"code": 3}', "null"])
def test_the_pyigtl_example_withdraws_on_what_it_cannot_read(robot_orders, text):
    orders = robot_orders([(0.01, said(1, 0.01)), (0.02, said(1, 0.02, text))])
    assert orders[0] == GO_ON
    assert [go_on for go_on, _ in orders[1:]] == [False]


@pytest.fixture
def _own_signals():
    """Give back the signals that a pyigtl server takes."""
    kept = {
        number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)
    }
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("_own_signals")
def test_a_pyigtl_server_receives_a_replay(tmp_path):
    recording = read_recording(write_small_recording(tmp_path / "rec", frames=20))
    server = pyigtl.OpenIGTLinkServer(port=0, local_server=True)
    port = server.server_address[1]
    log = AnswerLog()

    try:
        with closing(ScannerClient("127.0.0.1", port, log.hear)) as client:
            wait_until(server.is_connected)
            player = Player(recording, client, log, version=2)
            player.play(1.15)
            image = server.wait_for_message("Scanner", timeout=FUSE_S)
    finally:
        server.stop()

    assert image is not None
    sent = recording.frame(recording.frames[int(image.image[0, 0, 0])])
    assert np.array_equal(image.image.reshape(sent.shape), sent)
    spacing = np.linalg.norm(image.ijk_to_world_matrix[:3, :3], axis=0)
    assert spacing[:2] == pytest.approx([8.0 / 32, 3.0 / 24], rel=1e-6)
