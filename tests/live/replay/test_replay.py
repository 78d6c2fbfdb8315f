"""A recording in a monitor: frames at their times, answers, a hung monitor, lost
connections.
"""

import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager

import numpy as np
import pytest
import waiting
from fake_monitor import ClockedClient, FakeMonitor, MonitorRule, fake_monitor
from small_recordings import write_small_recording
from waiting import FUSE_S

from scleraforce.base.errors import FrameError, LinkError
from scleraforce.front.cli.main import run
from scleraforce.live.network.openigtlink import (
    Image,
    Received,
    Sensor,
    Status,
    Text,
    Transform,
    encode,
)
from scleraforce.live.network.scanner_frame import FrameAssembler
from scleraforce.live.replay import scanner_player as module
from scleraforce.live.replay.scanner_player import (
    AnswerLog,
    Player,
    ScannerClient,
)
from scleraforce.recordings.recording_folder import read_recording

STATED_S = 0.05  # a delay that headers do not show


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for answers as long as it takes: the fake monitor may be held up."""
    monkeypatch.setattr(module, "ANSWER_S", 600.0)


def played(
    recording, capsys, *options: str, decide=lambda _: None, code: int = 0
) -> tuple[FakeMonitor, dict]:
    with fake_monitor(decide) as monitor:
        assert (
            run(
                [
                    "replay",
                    str(recording),
                    "--port",
                    str(monitor.port),
                    "--json",
                    *options,
                ]
            )
            == code
        )

    return monitor, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize("version", [1, 2, 3])
def test_every_frame_comes_in_order_with_its_pixels_size_and_time(
    tmp_path, capsys, version
):
    recording = read_recording(write_small_recording(tmp_path / "rec", frames=15))
    monitor, result = played(recording.path, capsys, "--version", str(version))
    came = monitor.received_of(Image)
    assert (result["frames_sent"], result["frames_answered"]) == (15, 15)

    for event, entry in zip(came, recording.frames, strict=True):
        frame = FrameAssembler().add(event.message)
        assert np.array_equal(frame.pixels, recording.frame(entry))
        assert (frame.lateral_m, frame.depth_m) == pytest.approx(
            (0.008 / 32, 0.003 / 24), rel=1e-6
        )

    assert {event.header.version for event in came} == {version}
    assert [event.message_id for event in came] == (
        [0] * 15 if version == 1 else list(range(1, 16))
    )
    beside_s = np.array([event.header.time_s for event in came]) - 0.01 * np.arange(15)
    # where other work keeps the replay from its time
    stated_late_s = max(0.0, result["latest_ms"] / 1e3 - STATED_S)
    assert np.ptp(beside_s) <= stated_late_s + 1e-6
    assert (
        result["latency_ms"]["median"]
        <= result["latency_ms"]["p99"]
        <= result["latency_ms"]["max"]
    )


def clocked_player(path, **settings) -> tuple[Player, ClockedClient]:
    """A player of a recording whose time passes only while it waits."""
    log = AnswerLog()
    client = ClockedClient(MonitorRule(), log.hear)
    return Player(read_recording(path), client, log, **settings), client


def test_every_frame_goes_out_at_its_time_and_no_delay_adds_up(tmp_path):
    path = write_small_recording(tmp_path / "rec", frames=40, log=False)
    went_s = []
    player, client = clocked_player(path, speed=2.0)

    def watch():
        went_s.append(player.log._last[1])
        client.now_s += 0.002  # which sending takes

    player.watch = watch
    player.play()
    # twice as fast
    assert np.array(went_s[:40]) - went_s[0] == pytest.approx(0.005 * np.arange(40))
    assert player.latest_s == 0.0


def test_a_replay_that_is_late_catches_up_at_twice_the_pace_and_in_no_burst(
    tmp_path,
):
    path = write_small_recording(tmp_path / "rec", frames=60, log=False)
    went_s = []
    player, client = clocked_player(path)

    def watch():
        went_s.append(player.log._last[1])
        if len(went_s) == 10:
            client.now_s += 0.15

    player.watch = watch
    player.play()
    steps_s = np.diff(went_s[:60])
    assert steps_s[:9] == pytest.approx(0.01)
    assert steps_s[9] == pytest.approx(0.15)
    assert steps_s[10:38] == pytest.approx(0.005)
    assert steps_s[38:] == pytest.approx(0.01)
    assert player.latest_s == pytest.approx(0.14)


def test_the_force_log_goes_along_in_its_time(tmp_path):
    path = write_small_recording(tmp_path / "rec", frames=30)
    player, client = clocked_player(path, version=2)
    player.play()
    came = client.monitor.received_of(Sensor)
    assert player.forces_sent == len(came) == 58  # every 5 ms, up to the last frame
    assert {event.header.device for event in came} == {"RobotForce"}
    log = player.recording.forces
    assert [event.message.values for event in came] == [
        tuple(row) for row in log.wrench_sc[:58].tolist()
    ]
    begin_s = client.monitor.received_of(Image)[0].header.time_s
    times_s = [event.header.time_s - begin_s for event in came]
    assert times_s == pytest.approx((log.time_s[:58] - 1.0).tolist(), abs=1e-6)
    order = [event.header.time_s for event in client.monitor.received]
    assert order == sorted(order)


def test_the_needles_travel_goes_out_just_before_its_frame(tmp_path):
    path = write_small_recording(tmp_path / "rec", frames=3)
    lines = (path / "frames.csv").read_text().splitlines()
    given = ("travel_m", "0.001", "", "0.0025")
    (path / "frames.csv").write_text(
        "\n".join(f"{line},{more}" for line, more in zip(lines, given, strict=True))
    )
    player, client = clocked_player(path, version=2)
    player.play()
    came = [
        event
        for event in client.monitor.received
        if not isinstance(event.message, Sensor)
    ]
    sent = [type(event.message).__name__ for event in came]
    assert sent == ["Transform", "Image", "Image", "Transform", "Image"]
    poses = [event for event in came if isinstance(event.message, Transform)]
    assert [event.message.travel_mm for event in poses] == pytest.approx([1.0, 2.5])
    assert {event.header.device for event in poses} == {"NeedlePose"}


def test_the_times_of_a_late_replay_show_its_delay_but_for_50_ms(tmp_path):
    """The monitor would take a larger one for the scanner's."""
    path = write_small_recording(tmp_path / "rec", frames=30)
    late_s = 0.2
    player, client = clocked_player(path, version=2)

    def watch():
        if player.log.frames_sent == 10 and player.latest_s < late_s:
            client.now_s += late_s

    player.watch = watch
    player.play()
    events = client.monitor.received
    times_s = (
        np.array([event.header.time_s for event in events]) - events[0].header.time_s
    )
    assert np.diff(times_s).min() > -1e-6  # nothing goes back in time
    log_s = np.concatenate(
        [player.recording.forces.time_s[:58] - 1.0, 0.01 * np.arange(30)]
    )
    assert np.sort(times_s)[:28] == pytest.approx(np.sort(log_s)[:28], abs=1e-6)
    assert (times_s - np.sort(log_s)).max() == pytest.approx(
        player.latest_s - STATED_S, abs=1e-6
    )


def test_a_log_of_one_axis_goes_along_as_the_contact_force_without_samples_that_have_none(
    tmp_path, capsys
):
    path = write_small_recording(tmp_path / "rec", frames=5)
    lines = [line.split(",") for line in (path / "forces.csv").read_text().splitlines()]
    kept = [
        f"{line[0]},{'nan' if number == 3 else line[3]}"
        for number, line in enumerate(lines)
    ]
    (path / "forces.csv").write_text("\n".join(kept) + "\n")
    monitor, _ = played(path, capsys)
    values = [event.message.values for event in monitor.received_of(Sensor)][:3]
    assert values == [pytest.approx((force_n,)) for force_n in (1.0, 1.005, 1.015)]


def test_a_fast_replay_sends_fewer_forces_but_all_frames(tmp_path, capsys):
    path = write_small_recording(tmp_path / "rec", frames=100)
    _, result = played(path, capsys, "--speed", "20")
    assert result["frames_sent"] == 100
    # every fourth: 200 a second, 20 times as fast, 1000 at most
    assert result["forces_sent"] == 50


def withdraws_at(number: int):
    seen = []

    def decide(event):
        if isinstance(event, Received) and isinstance(event.message, Image):
            seen.append(event)
        return (
            Status(3, 102, "BOUND", "WITHDRAW: up to 31 mN")
            if len(seen) == number
            else None
        )

    return decide


def test_a_withdrawal_is_reported_with_its_frame_cause_reading_and_true_force(
    tmp_path, capsys
):
    path = write_small_recording(
        tmp_path / "rec", frames=20, forces_mn=[float(n) for n in range(20)]
    )
    _, result = played(path, capsys, decide=withdraws_at(12))
    found = result["withdrawal"]
    expected = {
        "code": 3,
        "sub_code": 102,
        "cause": "BOUND",
        "frame": 12,
        "file": "0011.png",
        "true_force_mn": 11.0,
    }
    assert expected.items() <= found.items()
    assert found["message"] == "WITHDRAW: up to 31 mN"
    assert (found["force_mn"], found["interval_mn"]) == (1.5, [0.5, 2.5])
    assert [change["code"] for change in result["changes"]][-2:] == [1, 3]
    # since the first frame, sent earlier
    assert 0.0 < found["after_ms"] / 1e3 < found["at_s"] <= result["duration_s"]

    with fake_monitor(withdraws_at(12)) as monitor:
        assert run(["replay", str(path), "--port", str(monitor.port)]) == 0

    out, err = capsys.readouterr()
    lines = out.splitlines()
    assert err == ""
    assert any(
        "frame 12  code 3.102 BOUND  WITHDRAW: up to 31 mN" in line for line in lines
    )
    assert lines[-1].startswith("withdrawal at frame 12 (0011.png), ")
    said = (
        "BOUND: WITHDRAW: up to 31 mN; read 1.5 mN (0.5 to 2.5 mN); true force 11.0 mN"
    )
    assert lines[-1].endswith(f"after it was sent: {said}")


def test_with_preload_every_frame_is_read_before_the_first_goes_out(
    tmp_path, capsys, monkeypatch
):
    path = write_small_recording(tmp_path / "rec", frames=60, log=False)
    # frames sent, before each is read
    sent = []
    read = Player._read
    monkeypatch.setattr(
        Player,
        "_read",
        lambda self, *which: (sent.append(self.log.frames_sent), read(self, *which))[1],
    )
    played(path, capsys, "--preload", "--speed", "10")
    assert sent == [0] * 60
    played(path, capsys, "--speed", "10")
    assert max(sent[60:]) > 0


def test_a_frame_that_cannot_be_read_ends_it_with_the_files_name(tmp_path):
    path = write_small_recording(tmp_path / "rec", frames=10, log=False)
    (path / "frames" / "0006.png").write_bytes(b"no png")
    recording = read_recording(path)
    log = AnswerLog()

    with fake_monitor() as monitor:
        client = ScannerClient("127.0.0.1", monitor.port, log.hear)
        with pytest.raises(FrameError, match=r"0006\.png"):
            Player(recording, client, log).play()

        client.close()

    assert log.frames_sent == 6


def test_enter_sends_the_next_frame_and_its_answer_is_printed(
    tmp_path, capsys, monkeypatch
):
    path = write_small_recording(tmp_path / "rec", frames=5)
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n\n\n"))

    with fake_monitor() as monitor:
        assert run(["replay", str(path), "--port", str(monitor.port), "--step"]) == 0
        assert len(monitor.received_of(Image)) == 3
        assert not monitor.received_of(Sensor)

    out, err = capsys.readouterr()
    assert [
        line.split(", ")[0] for line in out.splitlines() if line.startswith("frame")
    ] == [
        "frame 1",
        "frame 2",
        "frame 3",
    ]
    assert "class 0, 1.5 mN" in out
    assert err.count("Enter sends") == 4
    assert "Enter sends 0003.png" in err


def test_nobody_there_is_exit_code_2_and_one_line(tmp_path, capsys):
    path = write_small_recording(tmp_path / "rec", frames=5)
    with fake_monitor() as monitor:
        port = monitor.port

    assert run(["replay", str(path), "--port", str(port)]) == 2
    assert (
        "Connection refused; start `scleraforce monitor` there"
        in capsys.readouterr().err
    )


def test_a_monitor_that_leaves_is_exit_code_1_and_the_summary_so_far(tmp_path, capsys):
    path = write_small_recording(tmp_path / "rec", frames=60)

    def leave(_event):
        if len(monitor.received_of(Image)) == 20:
            monitor.drop()

    with fake_monitor() as monitor:
        monitor.decide = leave
        assert run(["replay", str(path), "--port", str(monitor.port)]) == 1

    out, err = capsys.readouterr()
    assert err.startswith("error: 127.0.0.1:")
    assert err.count("\n") == 1
    assert " frames sent, " in out


@pytest.mark.parametrize(
    "options",
    ["--step --speed 2", "--fault-at-s 3", "--fault gremlins", "--version 4"],
)
def test_wrong_usage_is_exit_code_2(tmp_path, capsys, options):
    path = write_small_recording(tmp_path / "rec", frames=5)
    assert run(["replay", str(path), *options.split()]) == 2
    assert capsys.readouterr().err.startswith("error: ")


@pytest.mark.slow
def test_control_c_is_exit_code_130_with_the_summary_so_far(tmp_path):
    path = write_small_recording(tmp_path / "rec", frames=300, log=False)
    with fake_monitor() as monitor:
        code = "from scleraforce.front.cli.main import main; main()"
        command = [
            sys.executable,
            "-c",
            code,
            "replay",
            str(path),
            "--port",
            str(monitor.port),
            "--json",
        ]
        command += ["--speed", "0.1"]  # half a minute, whatever holds this test up
        child = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ,
        )

        while (
            len(monitor.received_of(Image)) < 6
        ):  # the last one may not have been counted yet
            assert child.poll() is None

        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=FUSE_S)

    assert child.returncode == 130
    assert err.strip() == "error: interrupted"
    assert 5 <= json.loads(out)["frames_sent"] < 300


@contextmanager
def connected(hear, **settings) -> Iterator[tuple[FakeMonitor, ScannerClient]]:
    with (
        fake_monitor() as monitor,
        closing(ScannerClient("127.0.0.1", monitor.port, hear, **settings)) as client,
    ):
        yield monitor, client


def wait_until(client: ScannerClient, done) -> None:
    client.listen(time.monotonic() + waiting.FUSE_S, done)
    assert done()


@pytest.mark.parametrize("observed", [False, True])
def test_what_the_monitor_says_is_heard_with_its_time(observed):
    log = AnswerLog()
    with connected(log.hear, observed=observed) as (_, client):
        wait_until(client, lambda: log.status is not None)
        image = Image(np.zeros((1, 24, 32), np.uint16))
        before_s = time.monotonic()
        sent_s = client.send(encode(image, "Scanner", version=2, message_id=7))
        log.sent(7, 7, sent_s)
        wait_until(client, lambda: log.answered == 7)
        assert before_s <= sent_s <= time.monotonic()
        assert log.ok
        assert 0.0 <= log.answers[0].took_s <= time.monotonic() - sent_s


def test_the_robots_connection_hears_on_when_the_scanners_is_closed():
    log = AnswerLog()
    with connected(log.hear, observed=True) as (monitor, client):
        wait_until(client, lambda: log.status is not None)
        client.disconnect()
        wait_until(client, lambda: None in monitor.received)
        monitor.say(Status(3, 7, "SILENCE", "no frame"))
        wait_until(client, lambda: log.first_doubt(0.0, (3,)) is not None)

        with pytest.raises(LinkError, match="closed the connection"):
            client.send(b"x")


def test_a_message_that_comes_through_both_connections_is_heard_once(
    monkeypatch,
):
    heard = []
    with connected(lambda *said: heard.append(said), observed=True) as (
        monitor,
        client,
    ):
        monitor.answers = False
        waiting.wait_until(lambda: len(monitor._peers) == 2)
        receive = client._receive

        def note(link, heard):
            came.add(link)
            receive(link, heard)

        def texts():
            return sum(isinstance(message, Text) for _, _, message in heard)

        monkeypatch.setattr(client, "_receive", note)
        for number in range(1, 4):
            came = set()
            monitor.say_bytes(encode(Text("once"), "ForceReading"))
            wait_until(client, lambda: len(came) == 2 and texts() >= number)  # noqa: B023 - called at once

        assert texts() == 3


def test_a_monitor_that_stops_reading_is_an_error_and_no_hang_and_is_heard_meanwhile():
    heard = []
    with fake_monitor() as monitor:
        client = ScannerClient(
            "127.0.0.1",
            monitor.port,
            lambda *said: heard.append(said),
            clock=lambda: 2.0 * len(heard),
        )
        monitor.reads = False

        with pytest.raises(LinkError, match="has read nothing for 5 s"):
            client.send(
                encode(Image(np.zeros((1, 2048, 2048), np.uint16)), "Scanner") * 8
            )

        # heartbeats, of which each is two seconds of the client's clock
        assert len(heard) >= 3
        client.close()


HTTP = b"HTTP/1.1 400 Bad Request\r\n" + b"\r\n" * 30


def test_a_peer_that_does_not_speak_openigtlink_is_an_error():
    with connected(lambda *_: None) as (monitor, client):
        monitor.answers = False
        waiting.wait_until(lambda: bool(monitor._peers))
        monitor.say_bytes(HTTP)
        with pytest.raises(
            LinkError, match="does not send OpenIGTLink: header version"
        ):
            client.listen(time.monotonic() + waiting.FUSE_S)


def reading(frame_id: int) -> Text:
    return Text(json.dumps({"event": "frame", "frame_id": frame_id, "class": 1}))


def test_the_status_before_a_reading_is_that_frames_answer():
    log = AnswerLog()
    log.sent(1, 101, 10.000)
    log.sent(2, 102, 10.010)
    log.hear(10.002, "ForceMonitor", Status(1))
    log.hear(10.003, "ForceReading", reading(101))
    log.hear(10.011, "ForceMonitor", Status(1))  # a heartbeat
    log.sent(3, 103, 10.0125)  # before frame 2 is answered
    log.hear(10.013, "ForceMonitor", Status(3, 102, "BOUND", "too much"))
    log.hear(10.014, "ForceReading", reading(102))
    assert [answer.took_s for answer in log.answers] == pytest.approx([0.002, 0.003])
    assert log.longest_silence_s == pytest.approx(0.009)
    change = log.first_doubt(0.0)
    assert change is not None
    assert (change.code, change.cause, change.frame, change.answers) == (
        3,
        "BOUND",
        2,
        True,
    )
    assert change.after_s == pytest.approx(0.003)
    assert [entry.code for entry in log.changes] == [1, 3]
    assert not log.ok


def test_of_answers_that_come_together_the_first_that_changes_has_the_frame():
    log = AnswerLog()
    for number in (1, 2, 3):
        log.sent(number, 100 + number, 10.0 + 0.01 * number)

    for number, code in ((1, 1), (2, 3), (3, 3)):
        log.hear(10.05, "ForceMonitor", Status(code))
        log.hear(10.05, "ForceReading", reading(100 + number))

    assert [(change.code, change.frame) for change in log.changes] == [(1, 1), (3, 2)]


def test_a_change_without_a_reading_is_of_no_frame_that_is_answered_later():
    log = AnswerLog()
    log.sent(1, 101, 10.0)
    log.hear(10.1, "ForceMonitor", Status(3, 7, "SILENCE", "no frame"))
    log.sent(2, 102, 10.2)
    log.hear(10.1, "ForceMonitor", Status(3, 7, "SILENCE", "no frame"))
    log.hear(10.1, "ForceReading", reading(102))
    (change,) = log.changes
    assert (change.frame, change.answers) == (1, False)


def test_what_answers_no_frame_is_not_taken_for_an_answer():
    log = AnswerLog()
    log.hear(9.0, "ForceMonitor", Status(13))
    log.sent(1, 101, 10.0)
    for text in ("no json", "[1]", '{"frame_id": null}', '{"frame_id": 999}'):
        log.hear(10.1, "ForceReading", Text(text))

    log.hear(10.1, "Other", Status(3))
    log.hear(10.1, "ForceMonitor", Sensor((1.0,)))
    assert log.answers == []
    assert log.answered is None
    assert [(change.code, change.frame) for change in log.changes] == [(13, None)]
    assert log.first_doubt(9.5) is None


def test_the_oldest_frames_that_are_never_answered_are_forgotten():
    log = AnswerLog()
    for number in range(3000):
        log.sent(number, number, 10.0)

    log.hear(10.1, "ForceMonitor", Status(1))
    for number in (0, 1999, 2000, 2999):
        log.hear(10.1, "ForceReading", reading(number))

    assert len(log.answers) == 2
