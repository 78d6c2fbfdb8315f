"""The black box: its log, its recordings, the forces of a robot."""

import os
import shutil
import signal
import time
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs
from small_monitor import INFO, READ_ENTRY, decision
from waiting import FUSE_S, wait_until

import scleraforce.live.companions.black_box as module
from scleraforce.live.companions import decision_log, process_messages
from scleraforce.live.companions.black_box import BlackBox, RobotForce
from scleraforce.live.companions.decision_log import DecisionLog, read_log
from scleraforce.live.companions.process_channel import Channel, Child, encode_message
from scleraforce.live.companions.process_messages import (
    Alive,
    Decided,
    ForceHeard,
    MonitorEnds,
    Note,
    SelfReport,
    WithdrawalKept,
)
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.recordings.forces_under_frames import label_frames
from scleraforce.recordings.recording_folder import read_recording
from scleraforce.recordings.recording_writer import RecordingWriter
from scleraforce.records.needle import Needle, gauge_diameter_m
from scleraforce.records.scan import Plane
from scleraforce.records.study import ClassesStudy

SHAPE = 24, 32
CAUSES = {"WITHDRAW": "FORCE_BOUND"}


def frame(number):
    return np.random.default_rng(number).integers(0, 2**16, SHAPE).astype(np.uint16)


def numbers_in(folder):
    """The numbers of the frames in a recording, each of which has its own pixels."""
    recording = read_recording(folder)
    numbers = [int(entry.file[:7]) for entry in recording.frames]
    for entry, number in zip(recording.frames, numbers, strict=True):
        assert (recording.frame(entry) == frame(number)).all()
    return numbers


def settings_of(folder, ring, record=None, info=INFO):
    return process_messages.BlackBoxSettings(
        folder=folder / "box", ring=ring.place, info=info, record=record, keep_s=10.0
    )


class Monitor:
    """Does as the monitor does, on a clock of its own: a frame and a tick each 10 ms;
    `box` is the other end.
    """

    def __init__(self, folder, record=None, ring_frames=1100, info=INFO):
        self.folder = folder
        self.ring = FrameRing.create(ring_frames, *SHAPE)
        settings = settings_of(folder, self.ring, record, info)
        self.channel, self.theirs = Channel.pair()
        ring = replace(settings.ring, descriptor=os.dup(self.ring.place.descriptor))
        self.box = BlackBox(self.theirs, structs.replace(settings, ring=ring))
        self.decisions = self.frames = 0
        self.at_s = 1000.0
        self.answers = []

    def decide(
        self, state="WATCHING", times=1, with_frame=True, turns=3, plane=None, **said
    ):
        for _ in range(times):
            self.at_s += 0.01
            self.decisions += 1
            if with_frame:
                self.frames += 1
                self.ring.put(self.frames, frame(self.frames))

            entry = decision(
                state,
                number=self.decisions,
                time_s=1.8e9 + self.at_s,
                at_s=self.at_s,
                cause=CAUSES.get(state),
                frame=self.frames if with_frame else None,
                plane=plane,
            )
            self.tell(Decided(entry=entry, **said), turns)

    def tell(self, message, turns=1):
        assert self.channel.send(message)
        for _ in range(turns):
            self.box.turn()

    def force(self, values, at_s=None, device="robot"):
        at_s = self.at_s if at_s is None else at_s
        self.tell(
            ForceHeard(
                at_s=at_s, time_s=1.8e9 + at_s, values=tuple(values), device=device
            )
        )

    def heard(self, kind):
        self.answers += self.channel.receive()
        return [answer for answer in self.answers if isinstance(answer, kind)]

    def wait_for(self, kind, count=1):
        def came():
            for _ in range(50):  # each writes a frame at most
                self.box.turn()
            return len(self.heard(kind)) >= count

        wait_until(came)
        return self.heard(kind)[-1]

    def end(self, planned=True):
        if planned:
            self.channel.send(MonitorEnds())
        else:
            self.channel.close()
        self.box.run()
        self.close()

    def close(self):
        self.channel.close()
        self.theirs.close()

    def records(self):
        return [part.record for part in read_log(self.folder / "box" / "log")]

    def notes(self):
        return [record["text"] for record in self.records() if record["kind"] == "note"]

    def noted(self, words):
        return sum(words in note for note in self.notes())

    def entries(self):
        return sum(record["kind"] == "entry" for record in self.records())

    def details(self):
        return [report.detail for report in self.heard(SelfReport)]

    def withdrawals(self):
        return sorted((self.folder / "box" / "withdrawals").iterdir())


def full(*_):
    raise OSError(28, "No space left on device")


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(module, "ALIVE_S", 0.0)  # a turn need not wait
    monkeypatch.setattr(os, "fsync", lambda _: None)


@pytest.mark.slow
def test_a_withdrawal_keeps_the_last_ten_seconds_without_loss(tmp_path):
    monitor = Monitor(tmp_path)
    monitor.decide(times=1200, turns=1)
    monitor.decide("WITHDRAW", times=6)  # it latches: one withdrawal
    folder = monitor.wait_for(WithdrawalKept).folder
    monitor.end()
    assert [str(path) for path in monitor.withdrawals()] == [folder]
    assert folder.endswith("Z-force_bound")
    recording = read_recording(monitor.withdrawals()[0])
    assert recording.info == INFO
    assert numbers_in(folder) == list(range(201, 1202))
    assert [entry.time_s for entry in recording.frames] == pytest.approx(
        np.arange(200, 1201) * 0.01, abs=1e-6
    )
    decisions = [
        part.record["entry"]["number"]
        for part in read_log(monitor.withdrawals()[0] / "decisions.jsonl")
    ]
    assert decisions == list(range(201, 1202))
    assert recording.forces is None
    assert any(
        "1001 frames" in note and "0 were lost" in note for note in monitor.notes()
    )


def test_a_withdrawal_while_one_is_written_follows_it_and_only_the_latest_does(
    tmp_path,
):
    monitor = Monitor(tmp_path)
    monitor.decide(times=50)
    for state in ("WITHDRAW", "WATCHING", "WITHDRAW", "NOT_READY", "WITHDRAW"):
        monitor.decide(state, turns=1)

    monitor.wait_for(WithdrawalKept, 2)
    monitor.end()
    kept = [len(read_recording(folder).frames) for folder in monitor.withdrawals()]
    assert kept == [51, 55]
    assert monitor.noted("are not kept: more happened") == 1


def test_frames_that_were_overwritten_are_counted_and_never_mixed_up(tmp_path):
    session = Monitor(tmp_path / "session", record=tmp_path / "rec", ring_frames=10)
    session.decide(times=35, turns=0)
    session.end()
    assert numbers_in(tmp_path / "rec") == list(range(26, 36))
    assert session.noted("the disk does not keep up") == 1
    assert session.notes()[-1].endswith("; 25 were lost")
    monitor = Monitor(tmp_path, ring_frames=20)
    monitor.decide(times=60)
    monitor.decide("WITHDRAW", times=6, turns=0)
    monitor.wait_for(WithdrawalKept)
    monitor.end()
    assert numbers_in(monitor.withdrawals()[0]) == list(range(47, 62))
    assert any(
        "15 frames" in note and "5 were lost" in note for note in monitor.notes()
    )


def test_a_monitor_that_dies_is_noted_and_its_last_seconds_are_kept(tmp_path):
    monitor = Monitor(tmp_path)
    monitor.decide(times=29, turns=0)
    monitor.decisions += 3
    monitor.decide(turns=0)
    monitor.end(planned=False)
    assert monitor.notes()[:2] == [
        "decisions 30 to 32 never arrived",
        "the monitor ended without notice",
    ]
    (folder,) = monitor.withdrawals()
    assert folder.name.endswith("Z-monitor_died")
    assert len(read_recording(folder).frames) == 30


@pytest.mark.slow
def test_labels_of_a_withdrawal_are_the_force_although_the_needle_touched_long_before(
    tmp_path,
):
    """The sensor reads 50 mN without contact; contact of 20 mN begins 20 s before the
    withdrawal.
    """
    monitor = Monitor(tmp_path, ring_frames=300)
    for number in range(2500):
        pushed_n = 0.02 if number > 500 else 0.0
        monitor.force([0.0, 0.001, 0.05 - pushed_n], monitor.at_s + 0.005)
        monitor.decide(turns=0)

    monitor.decide("WITHDRAW")
    monitor.box._withdrawals._writing.due_s = 0.0
    for _ in range(30):
        monitor.force([0.0, 0.001, 0.03], monitor.at_s + 0.005)
        monitor.at_s += 0.01

    monitor.wait_for(WithdrawalKept)
    monitor.end()
    recording = read_recording(monitor.withdrawals()[0])
    assert recording.forces.columns == ("fx_n", "fy_n", "fz_n")
    trials = label_frames(recording, ClassesStudy())
    assert len(trials) > 90
    assert [trial.measured_force_n for trial in trials] == pytest.approx(
        [0.02] * len(trials), abs=1e-6
    )


def test_a_force_log_that_gives_no_labels_leaves_a_recording_that_can_be_read(tmp_path):
    monitor = Monitor(tmp_path)
    for number in range(200):
        if number % 10 == 0:
            monitor.force([0.001])
        monitor.decide()

    monitor.decide("WITHDRAW")
    monitor.box._withdrawals._writing.due_s = 0.0
    monitor.wait_for(WithdrawalKept)
    monitor.end()
    (folder,) = monitor.withdrawals()
    assert read_recording(folder).forces is None
    lines = (folder / "robot_forces.csv").read_text().splitlines()
    assert [name.strip() for name in lines[0].split(",")] == ["time_s", "fz_n"]
    assert len(lines) == 1 + 19  # the last step may not be complete
    # positive along the needle; contact_sign is -1
    assert float(lines[1].split(",")[1]) == -0.001
    assert "fewer than 20 samples" in monitor.notes()[-1]


def test_forces_of_another_device_or_count_and_nan_are_noted_once_and_left_out(
    tmp_path,
):
    monitor = Monitor(tmp_path, record=tmp_path / "rec")
    monitor.decide()

    for _ in range(100):
        monitor.force([0.0, 0.0, 1.0])
        monitor.force([5.0], device="other")
        monitor.force([5.0, 5.0])
        monitor.force([0.0, 0.0, float("nan")])
        monitor.decide()

    monitor.end()
    forces = read_recording(tmp_path / "rec").forces
    assert (forces.wrench_sc == [0.0, 0.0, 1.0]).all()
    assert forces.sample_rate_hz == pytest.approx(100.0)
    assert monitor.noted("is not kept") == 1


def test_a_session_is_recorded_frame_by_frame_and_can_be_read_at_any_time(tmp_path):
    monitor = Monitor(tmp_path, record=tmp_path / "rec")
    for number in range(1, 150):
        monitor.force([0.0, 0.0, -0.01])
        monitor.decide(
            "WITHDRAW" if 50 < number < 75 else "WATCHING", with_frame=number % 3
        )

        if number % 25 == 0:
            assert numbers_in(tmp_path / "rec")

    monitor.end()
    assert numbers_in(tmp_path / "rec") == list(range(1, monitor.frames + 1))
    assert read_recording(tmp_path / "rec").forces.wrench_sc.shape == (147, 3)
    assert (
        f"recorded {monitor.frames} frames in {tmp_path / 'rec'}; 0 were lost"
        in monitor.notes()
    )


def test_a_session_keeps_the_travel_and_marks_what_comes_after_a_puncture(tmp_path):
    monitor = Monitor(tmp_path, record=tmp_path / "rec")
    for travel_m, pierced in (
        (None, False),
        (1.5e-3, False),
        (2.0, False),
        (-2e-3, True),
    ):
        # 2 m: no recording has it
        monitor.decide(
            "WITHDRAW" if pierced else "WATCHING", travel_m=travel_m, pierced=pierced
        )

    monitor.wait_for(WithdrawalKept)
    monitor.end()

    for folder in (tmp_path / "rec", *monitor.withdrawals()):
        recording = read_recording(folder)
        assert [entry.travel_m for entry in recording.frames] == [
            None,
            1.5e-3,
            None,
            -2e-3,
        ]
        assert [entry.pierced for entry in recording.frames] == [None, None, None, True]


def test_a_frame_that_is_named_twice_is_recorded_once_and_two_at_one_time_stay_apart(
    tmp_path,
):
    monitor = Monitor(tmp_path, record=tmp_path / "rec")
    monitor.decide()
    monitor.frames -= 1
    monitor.decide()  # a second opinion on frame 1
    monitor.at_s -= 0.01
    monitor.decide()
    monitor.at_s -= 0.01
    monitor.decide()
    monitor.end()
    recording = read_recording(tmp_path / "rec")
    assert numbers_in(tmp_path / "rec") == [1, 2, 3]
    assert np.diff([entry.time_s for entry in recording.frames])[1] == pytest.approx(
        1e-6
    )


def test_a_session_whose_disk_fails_ends_and_is_reported_once(tmp_path, monkeypatch):
    monitor = Monitor(tmp_path, record=tmp_path / "rec")
    monitor.decide(times=5)
    with monkeypatch.context() as disk:
        disk.setattr(RecordingWriter, "add", full)
        monitor.decide()

    monitor.decide(times=5)
    assert monitor.details() == ["session: [Errno 28] No space left on device"]
    monitor.end()
    assert len(read_recording(tmp_path / "rec").frames) == 5
    assert monitor.noted("recorded 5 frames") == 1


def test_a_folder_that_exists_is_never_written_into(tmp_path):
    (tmp_path / "rec").mkdir()
    (tmp_path / "rec" / "mine").write_text("precious")
    monitor = Monitor(tmp_path, record=tmp_path / "rec")
    monitor.decide()
    assert "session" in monitor.heard(SelfReport)[0].detail
    monitor.end()
    assert [path.name for path in (tmp_path / "rec").iterdir()] == ["mine"]


def test_below_a_gigabyte_nothing_is_kept_the_monitor_hears_it_and_the_log_continues(
    tmp_path, monkeypatch
):
    """Its signs of life say so until there is room again; the log goes on."""
    monkeypatch.setattr(decision_log, "CHECK_S", 0.0)
    monitor = Monitor(tmp_path, record=tmp_path / "rec")
    monitor.decide(times=10)
    assert monitor.heard(Alive)[-1].faults == ()
    usage = shutil.disk_usage(tmp_path)

    with monkeypatch.context() as disk:
        left = usage._replace(free=999_999_999)
        disk.setattr(shutil, "disk_usage", lambda _: left)
        monitor.decide(times=10)
        monitor.decide("WITHDRAW")
        details = monitor.details()
        assert [detail.partition(": ")[0] for detail in sorted(details)] == [
            "disk",
            "session",
            "withdrawal",
        ]
        assert all("1.00 GB free" in detail for detail in details[:2])
        faults = {fault.partition(": ")[0] for fault in monitor.heard(Alive)[-1].faults}
        assert faults >= {"disk", "withdrawal"}

    monitor.decide()
    faults = [fault.partition(": ")[0] for fault in monitor.heard(Alive)[-1].faults]
    assert faults == ["session"]  # which has ended for good
    monitor.end()
    assert len(read_recording(tmp_path / "rec").frames) == 10
    assert not (tmp_path / "box" / "withdrawals").exists()
    assert monitor.entries() == 22


def test_a_disk_that_fills_while_a_withdrawal_is_written_is_reported_and_leaves_nothing_half(
    tmp_path, monkeypatch
):
    monitor = Monitor(tmp_path)
    monitor.decide(times=20)
    monitor.decide("WITHDRAW", turns=5)
    write = os.write

    def write_elsewhere(file, data):
        within = os.readlink(f"/proc/self/fd/{file}").startswith(
            str(tmp_path / "box" / "withdrawals")
        )
        return full() if within else write(file, data)

    monkeypatch.setattr(os, "write", write_elsewhere)
    assert "No space left" in monitor.wait_for(SelfReport).detail
    monitor.wait_for(WithdrawalKept)
    monkeypatch.undo()
    monitor.end()
    assert 0 < len(numbers_in(monitor.withdrawals()[0])) < 21
    assert [
        path
        for path in (tmp_path / "box" / "withdrawals").iterdir()
        if path.name.startswith(".")
    ] == []


def test_a_log_that_cannot_be_written_is_reported_once_until_it_can(
    tmp_path, monkeypatch
):
    monitor = Monitor(tmp_path)
    for _ in range(2):
        with monkeypatch.context() as disk:
            disk.setattr(DecisionLog, "append", full)
            monitor.decide(times=5)
        monitor.decide()

    assert monitor.details() == ["log: [Errno 28] No space left on device"] * 2
    monitor.end()
    assert monitor.entries() == 2


def test_a_log_whose_folder_is_gone_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(decision_log, "CHECK_S", 0.0)
    monitor = Monitor(tmp_path)
    monitor.decide()
    (tmp_path / "box").rename(tmp_path / "gone")
    assert "decisions-000001.jsonl" in monitor.wait_for(SelfReport).detail
    monitor.end()


def test_a_wrong_message_is_reported_for_good_and_the_log_continues(tmp_path):
    monitor = Monitor(tmp_path)
    monitor.decide()
    assert monitor.channel.send_encoded(encode_message(Note(time_s=1.5, text="x"))[:-1])
    assert monitor.channel.send(
        process_messages.OpinionAsked(
            number=1, order=1, at_s=0.0, teaches=False, pierced=False
        )
    )
    monitor.decide(times=3)
    (report,) = monitor.heard(SelfReport)
    assert report.detail.startswith("message: not a message: ")
    assert monitor.heard(Alive)[-1].faults == (report.detail,)
    monitor.end()
    assert monitor.entries() == 4


class Process:
    """A black box of its own process."""

    def __init__(self, folder, record=None):
        self.folder = folder
        self.ring = FrameRing.create(200, *SHAPE)
        settings = settings_of(folder, self.ring, record)
        self.child = Child(
            "scleraforce.live.companions.black_box",
            settings,
            [self.ring.place.descriptor],
        )

    def frames(self, numbers, state="WATCHING"):
        for number in numbers:
            self.ring.put(number, frame(number))
            now = {"time_s": time.time(), "at_s": time.monotonic()}
            entry = decision(
                state, number=number, cause=CAUSES.get(state), frame=number, **now
            )
            assert self.child.channel.send(Decided(entry=entry))

    def wait_for(self, kind):
        heard = []
        wait_until(
            lambda: (
                heard.extend(
                    one for one in self.child.channel.receive() if isinstance(one, kind)
                )
                or heard
            )
        )

        return heard[0]


def test_the_process_keeps_a_withdrawal_ignores_sigterm_and_ends_with_the_monitor(
    tmp_path,
):
    process = Process(tmp_path)
    process.wait_for(Alive)
    os.kill(process.child.process.pid, signal.SIGTERM)
    assert os.getpriority(os.PRIO_PROCESS, process.child.process.pid) == min(
        os.nice(0) + 5, 19
    )
    process.frames(range(1, 100))
    process.frames([100], "WITHDRAW")
    folder = process.wait_for(WithdrawalKept).folder
    assert process.child.process.poll() is None
    process.child.channel.send(MonitorEnds())
    assert process.child.end(FUSE_S) == 0
    assert len(read_recording(tmp_path / "box" / "withdrawals" / folder).frames) == 100


@pytest.mark.slow
def test_what_the_process_writes_is_readable_by_its_owner_only(tmp_path):
    (tmp_path / "box" / "log").mkdir(parents=True)
    # of an earlier version
    (tmp_path / "box" / "log" / "decisions-000001.jsonl").touch(mode=0o644)
    process = Process(tmp_path, tmp_path / "rec")
    process.wait_for(Alive)

    for number in range(1, 20):
        for step in range(3):
            at_s = time.monotonic() + 0.03 * number + 0.01 * step
            force = ForceHeard(
                at_s=at_s, time_s=time.time(), values=(0.01,), device="Robot"
            )
            process.child.channel.send(force)

        process.frames([number])

    process.frames([20], "WITHDRAW")
    process.wait_for(WithdrawalKept)
    process.child.channel.send(MonitorEnds())
    assert process.child.end(FUSE_S) == 0
    inside = [
        *(tmp_path / "box").rglob("*"),
        tmp_path / "rec",
        *(tmp_path / "rec").rglob("*"),
    ]
    inside.remove(tmp_path / "box" / "log")  # made before
    assert {"frames.csv", "decisions.jsonl", "forces.csv", "0000020.png"} <= {
        path.name for path in inside
    }
    assert {path: oct(path.stat().st_mode & 0o077) for path in inside} == dict.fromkeys(
        inside, "0o0"
    )


def test_a_black_box_that_is_killed_leaves_a_session_and_a_log_that_can_be_read(
    tmp_path,
):
    process = Process(tmp_path, tmp_path / "rec")
    process.wait_for(Alive)
    process.frames(range(1, 150))
    wait_until((tmp_path / "rec" / "frames" / "0000020.png").exists)
    os.kill(process.child.process.pid, signal.SIGKILL)
    assert process.child.end(FUSE_S) == -signal.SIGKILL
    numbers = numbers_in(tmp_path / "rec")
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) >= 19
    assert all(part.record for part in read_log(tmp_path / "box" / "log"))


def test_a_process_whose_log_cannot_be_opened_says_so_and_ends(tmp_path, capfd):
    (tmp_path / "box").write_text("a file")
    process = Process(tmp_path)
    assert "Not a directory" in process.wait_for(SelfReport).detail
    assert process.child.end(FUSE_S) == 1
    assert "Traceback" in capfd.readouterr().err


def test_the_lines_of_the_log_keep_their_keys_order_and_values(tmp_path):
    """The keys, their order and the values of the log are a contract
    (docs/black_box.md).
    """
    monitor = Monitor(tmp_path)
    monitor.tell(Decided(entry=READ_ENTRY))
    monitor.tell(Note(time_s=1.5, text="robot came"))
    monitor.end()
    assert (
        (tmp_path / "box" / "log" / "decisions-000001.jsonl").read_bytes()
        == b'{"kind": "entry", "entry": {"number": 3, "time_s": 1800000000.0, "at_s": 12.5, "event": "frame", "state": "WATCHING", "code": 1, "sub_code": 0, "cause": null, "message": "OK:\\n\\u201c12 mN\\u201d", "frame": 3, "frame_id": 77, "probabilities": [0.0, 0.75, 0.25], "force_mn": 12.5, "interval_mn": [11.0, 13.5], "usable": true, "reason": null, "latency_ms": 0.75, "lost": 2, "overtaken": 0, "withdrawn_s": null, "present_cause": null, "present": "", "time_to_bound_ms": 900.0, "time_to_bound_ms_interval": [310.5, null], "modulus_mpa": null, "modulus_sd_mpa": null, "modulus_frames": null, "class": 1, "elastic_force_mn": null}, "crc32": "a07f1381"}\n{"kind": "note", "time_s": 1.5, "text": "robot came", "crc32": "1130c359"}\n'
    )


@pytest.mark.parametrize("rate_hz", [30.0, 100.0, 731.0])
def test_samples_are_the_means_over_each_hundredth_of_a_second(rate_hz):
    rng = np.random.default_rng(0)
    at_s = 50.0 + np.cumsum(rng.exponential(1 / rate_hz, 500))
    values = rng.standard_normal((500, 6))
    force = RobotForce(INFO.force)
    returned = [
        force.add(float(time_s), row.tolist(), "robot")
        for time_s, row in zip(at_s, values, strict=True)
    ]
    steps = np.floor(at_s / 0.01).astype(int)
    past = np.unique(steps)[:-1]
    means = [values[steps == step].mean(axis=0) for step in past]
    assert [sample for sample in returned if sample] == list(force.samples)
    times_s, found = zip(*force.samples, strict=True)
    assert times_s == pytest.approx((past + 0.5) * 0.01)
    assert np.allclose(found, means)
    assert force.columns == ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")


def test_memory_is_that_of_ten_minutes():
    force = RobotForce(INFO.force)
    for step in range(70_000):
        force.add(step * 0.01 + 0.005, [1.0], "robot")
    assert len(force.samples) == 60_000
    assert force.samples[-1][0] - force.samples[0][0] == pytest.approx(599.99)


def test_frames_of_several_planes_are_recorded_by_moments_and_those_alone_stay(
    tmp_path,
):
    planes = (Plane("along", 0.0, 0.0), Plane("across", 0.0, 1.5708))
    info = replace(
        INFO,
        scan=replace(INFO.scan, planes=planes),
        needle=Needle(diameter_m=gauge_diameter_m(22)),
    )
    monitor = Monitor(tmp_path, record=tmp_path / "session", info=info)

    for moment in (1, 3, 5):
        monitor.decide(plane="along", moment=moment)
        monitor.decide(plane="across", moment=moment, pierced=moment == 5)

    monitor.decide(plane="across", moment=7)  # the other one falls silent
    monitor.decide("WITHDRAW", with_frame=False)
    monitor.end()

    for folder in (tmp_path / "session", monitor.withdrawals()[0]):
        assert numbers_in(folder) == [*range(1, 8)]
        recording = read_recording(folder)
        assert recording.info.scan.planes == planes
        moments = [
            [(entry.plane, bool(entry.pierced)) for entry in moment]
            for moment in recording.moments
        ]
        together = [("along", False), ("across", False)]
        pierced = [("along", True), ("across", True)]  # there is one needle
        assert moments == [together, together, pierced, [("across", False)]]
