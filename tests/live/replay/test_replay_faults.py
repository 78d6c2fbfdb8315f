"""The faults that `replay` injects: what the monitor receives, and what is reported of
its reaction.
"""

import json
from contextlib import closing, suppress
from itertools import pairwise

import numpy as np
import pytest
from fake_monitor import ClockedClient, MonitorRule
from small_monitor import (
    FRAME_S,
    SCALE_M,
    Peer,
    TurnedClock,
    frame_of,
    serving,
)
from small_recordings import write_small_recording
from waiting import FUSE_S

from scleraforce.base.errors import InputError
from scleraforce.front.cli.main import run
from scleraforce.live.decision.events import Cause
from scleraforce.live.network.openigtlink import (
    BadChecksum,
    Image,
    Malformed,
    Received,
    Status,
    encode,
)
from scleraforce.live.replay import scanner_faults, scanner_player as player_module
from scleraforce.live.replay.scanner_faults import (
    FAULTS,
    FaultReport,
    draw_fault_time,
    inject,
    prepare,
)
from scleraforce.live.replay.scanner_player import (
    AnswerLog,
    Player,
    ScannerClient,
)
from scleraforce.reading.answer import Answer
from scleraforce.recordings.recording_folder import Recording, read_recording

FRAMES = 200
FORCES_N = np.concatenate([np.zeros(20), np.linspace(0.0, 0.04, FRAMES - 20)])
# frame 31 of 400 a second
AT_S = 1.3
SPEED = 4.0


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = write_small_recording(
        tmp_path_factory.mktemp("faults") / "rec", FRAMES, forces_mn=FORCES_N * 1e3
    )
    return read_recording(path)


def inject_through(
    client: ClockedClient,
    log: AnswerLog,
    recording,
    name: str,
    version: int = 2,
    seed: int = 0,
) -> FaultReport:
    player = Player(recording, client, log, speed=SPEED, version=version)
    rng = np.random.default_rng(seed)
    ready = prepare(
        name, recording, AT_S, rng, version=version, speed=SPEED, forces_n=FORCES_N
    )
    player.play(ready.time_s)

    return inject(player, ready)


def injected(
    recording, name: str, version: int, decide=lambda _: None, seed: int = 0
) -> tuple[MonitorRule, FaultReport]:
    monitor = MonitorRule(decide)
    log = AnswerLog()
    return monitor, inject_through(
        ClockedClient(monitor, log.hear), log, recording, name, version, seed
    )


def numbers(monitor: MonitorRule) -> list[int]:
    return [int(event.message.pixels[0, 0, 0]) for event in monitor.received_of(Image)]


class WithdrawsAfter:
    """Says EMERGENCY at the n-th event after the frames before the fault."""

    def __init__(self, events: int, sub_code: int) -> None:
        self.left = 30 + events
        self.status = Status(3, sub_code, "", "WITHDRAW: seen")

    def __call__(self, event) -> Status | None:
        counts = event is None or isinstance(event, BadChecksum | Malformed)
        counts = counts or (
            isinstance(event, Received) and isinstance(event.message, Image)
        )
        self.left -= counts
        return self.status if self.left == 0 and counts else None


@pytest.fixture(scope="module")
def speckled(tmp_path_factory) -> tuple[Recording, np.ndarray]:
    """Frames of 0.6 s, each with its own noise; and their pictures."""
    level_db = 10.0 * np.log10(
        np.random.default_rng(5).exponential(1.0, (60, 256, 320)) + 1e-3
    )
    pictures = np.clip(4095 * (level_db + 30.0) / 45.0, 0, 4095).astype(np.uint16)
    folder = tmp_path_factory.mktemp("speckled") / "rec"

    return read_recording(write_small_recording(folder, pictures=pictures)), pictures


OLD_PICTURES = [
    name for name, fault in FAULTS.items() if fault.causes == (Cause.FROZEN,)
]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", [*OLD_PICTURES, "pixel-type"])
def test_old_pictures_are_withdrawn_from_although_their_reading_is_harmless(
    speckled, name, seed
):
    """A reader that finds 8 mN in every picture."""
    recording, pictures = speckled
    prepared = prepare(name, recording, 1.3, np.random.default_rng(seed), version=2)
    answer = Answer(
        predicted=1,
        probabilities=(0.0, 1.0, 0.0),
        usable=True,
        reason=None,
        force_n=8e-3,
        interval_n=(7e-3, 9e-3),
    )
    scale = recording.info.scan.scale
    clock = TurnedClock()
    size = {"size": (256, 320), "scale_m": (scale.lateral_m, scale.depth_m)}
    matrix = (1e3 * scale.lateral_m, *[0.0] * 3, 1e3 * scale.depth_m, *[0.0] * 7)

    with (
        serving(rule=lambda *_: answer, clock=clock, **size) as port,
        Peer(port, version=2, clock=clock) as scanner,
    ):

        def shown(number, data):
            scanner.link.sendall(data)
            scanner.hear_readings(number)
            return scanner.status.code

        for number, picture in enumerate(pictures[:30], 1):
            clock.turn(0.01)
            header = {"version": 2, "message_id": number, "time_s": clock()}
            data = encode(Image(picture[None], matrix), "Scanner", **header)
            assert shown(number, data) == 1

        for number, (sending,) in enumerate(prepared.acts[:12], 31):
            clock.turn(0.01)
            if shown(number, sending.message.stamped(clock())) == 3:
                break

        assert scanner.status.name in {cause.name for cause in FAULTS[name].causes}


@pytest.mark.parametrize("version", [1, 2])
def test_stale_sends_the_next_pictures_with_times_that_fall_behind(recording, version):
    monitor, report = injected(recording, "stale", version, WithdrawsAfter(12, 114))
    assert numbers(monitor)[:42] == list(range(42))
    times_s = [event.header.time_s for event in monitor.received_of(Image)][29:42]
    assert [b - a for a, b in pairwise(times_s)] == pytest.approx(
        [0.2 * 0.01 / SPEED] * 12, abs=1e-6
    )
    assert (report.cause, report.expected) == ("STALE", True)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("checksum", BadChecksum, "checksum"),
        ("nan", Malformed, "finite"),
        ("bad-image", Malformed, "bytes of pixels"),
    ],
)
def test_checksum_nan_and_bad_image_are_what_they_say_and_the_stream_continues(
    recording, name, kind, words, version
):
    monitor, report = injected(recording, name, version)
    (wrong,) = [one for one in monitor.received if not isinstance(one, Received)]
    assert isinstance(wrong, kind)
    assert words in wrong.reason
    assert numbers(monitor)[29:33] == [29, 31, 32, 33]
    assert report.delay_s is None
    assert report.message == "the monitor still says OK"


def test_unusable_is_noise_or_black_and_never_frozen(recording):
    kinds = set()
    for seed in range(6):
        monitor, report = injected(
            recording, "unusable", 2, WithdrawsAfter(1, 104), seed
        )
        assert report.expected
        wrong = monitor.received_of(Image)[30].message.pixels
        kinds.add(
            "noise" if wrong.max() > 3000 else "black" if wrong.max() <= 3 else "other"
        )
        assert not np.array_equal(wrong, monitor.received_of(Image)[29].message.pixels)

    assert kinds == {"noise", "black"}


@pytest.mark.parametrize("name", ["garbage", "disconnect"])
def test_the_robots_connection_tells_what_follows_a_broken_scanner(recording, name):
    def decide(event):
        return Status(3, 7, "SILENCE", "WITHDRAW: no frame") if event is None else None

    monitor, report = injected(recording, name, 2, decide)
    assert len(monitor.received_of(Image)) == 30
    assert (report.code, report.cause) == (3, "SILENCE")
    assert report.expected is (name == "disconnect")


def test_a_monitor_that_falls_silent_or_dies_is_a_withdrawal_by_the_robots_rule(
    recording,
):
    def fall_silent_or_die(event):
        client.monitor.answers = not (
            isinstance(event, Received) and len(client.monitor.received_of(Image)) >= 30
        )
        client.dropped = isinstance(event, BadChecksum)

    for name, message, least_s in (
        ("silence", "no STATUS for 150 ms", 0.1),
        ("checksum", "the connection is lost", 0.0),
    ):
        log = AnswerLog()
        client = ClockedClient(MonitorRule(fall_silent_or_die), log.hear)
        report = inject_through(client, log, recording, name)
        assert (report.code, report.cause) == (None, None)
        assert message in report.message
        assert least_s <= report.delay_s <= 0.15


def test_a_monitor_that_does_not_watch_shows_nothing(recording):
    with pytest.raises(
        InputError,
        match="was not watching when the fault was due; it said: WITHDRAW: seen",
    ):
        injected(recording, "silence", 2, WithdrawsAfter(-10, 102))


def test_the_time_of_a_fault_is_drawn_in_contact_and_clear_of_danger(recording):
    times_s = {
        draw_fault_time(recording, FORCES_N, np.random.default_rng(seed))
        for seed in range(200)
    }
    frames_s = np.array([entry.time_s for entry in recording.frames])
    forces_n = [
        FORCES_N[np.searchsorted(frames_s, time_s - 1e-9)] for time_s in times_s
    ]
    after_n = [FORCES_N[frames_s <= time_s + 0.5 - 1e-9][-1] for time_s in times_s]
    assert min(forces_n) > 4e-3
    assert max(after_n) <= 24.1e-3
    assert len(times_s) > 1
    slow_n = np.minimum(FORCES_N, 20e-3)
    bunches_s = {
        draw_fault_time(recording, slow_n, np.random.default_rng(seed), "bunch")
        for seed in range(200)
    }
    # a withdrawal could explain any smaller fall from one frame to the next
    least_n = FAULTS["bunch"].least_n(float(np.median(np.diff(frames_s))))
    before_n = [
        slow_n[np.searchsorted(frames_s, time_s - 1e-9) - 1] for time_s in bunches_s
    ]
    assert min(before_n) > least_n > 10e-3
    assert len(bunches_s) > 1
    # the needle lifts off again and again
    dipping_n = np.where(np.arange(FRAMES) % 20 < 10, 0.0, FORCES_N)

    for seed in range(50):
        time_s = draw_fault_time(recording, dipping_n, np.random.default_rng(seed))
        assert dipping_n[np.searchsorted(frames_s, time_s - 1e-9)] > 4e-3

    with pytest.raises(InputError, match="no room for a fault"):
        draw_fault_time(recording, np.zeros(FRAMES), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("name", "time_s", "forces_n", "message"),
    [
        ("gremlins", AT_S, FORCES_N, "choose one of: unusable, silence"),
        ("silence", 0.0, FORCES_N, "a fault at 0 s; frames are from 1.02"),
        ("silence", 99.0, FORCES_N, "a fault at 99 s"),
        ("rising", AT_S, FORCES_N / 2, "up to 20.0 mN; this fault needs 30 mN"),
        ("dangerous", AT_S, FORCES_N / 2, "up to 20.0 mN; this fault needs 33 mN"),
        ("dangerous", AT_S, None, "no force at its frames"),
        ("pause", AT_S, np.full(FRAMES, 4.5e-3), "4.5 mN at the fault.* from 4.7 mN"),
        ("bunch", AT_S, np.full(FRAMES, 8e-3), "8.0 mN at the fault.* from"),
    ],
)
def test_a_fault_that_cannot_be_is_one_clear_line(
    recording, name, time_s, forces_n, message
):
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match=message):
        prepare(name, recording, time_s, rng, forces_n=forces_n)


@pytest.fixture
def clocked(monkeypatch: pytest.MonkeyPatch):
    """Commands speak to this monitor at the time that their client keeps; gives it, and
    the clients.
    """
    monitor = MonitorRule()
    clients = []

    def client(_host: str, _port: int, hear, *, observed: bool) -> ClockedClient:
        assert observed
        clients.append(ClockedClient(monitor, hear))
        return clients[-1]

    monkeypatch.setattr("scleraforce.front.cli.replay_command.ScannerClient", client)
    return monitor, clients


def test_the_command_injects_at_a_drawn_time_and_says_what_followed(
    recording, capsys, clocked
):
    monitor, _ = clocked
    monitor.decide = lambda event: (
        Status(3, 9, "", "WITHDRAW: checksum")
        if isinstance(event, BadChecksum)
        else None
    )
    assert run(["replay", str(recording.path), "--fault", "checksum", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    fault = result["fault"]
    assert (fault["name"], fault["withdraws"], fault["cause"], fault["code"]) == (
        "checksum",
        True,
        "CHECKSUM",
        3,
    )
    assert fault["cause_is_of_the_fault"] is True
    assert fault["delay_ms"] == 0.0  # this monitor answers at once
    frames_s = [entry.time_s for entry in recording.frames]
    drawn_s = draw_fault_time(recording, FORCES_N, np.random.default_rng(0))
    assert result["frames_sent"] == frames_s.index(drawn_s)
    assert fault["at_s"] == pytest.approx(drawn_s - frames_s[0])


def test_a_fault_that_nobody_notices_is_exit_code_1(recording, capsys, clocked):
    assert (
        run(
            [
                "replay",
                str(recording.path),
                "--fault",
                "scale",
                "--fault-at-s",
                "1.3",
                "--speed",
                "4",
            ]
        )
        == 1
    )
    (client,) = clocked[1]
    # half a second after the fault
    assert client.now_s == pytest.approx(1000.0 + 0.3 / 4 + 0.5, abs=0.01)
    out, err = capsys.readouterr()
    assert "no withdrawal after the fault scale" in err
    assert "the robot continues: the monitor still says OK" in out


# The faults against the monitor's own server with its decision. Its reader takes any
# picture for a frame of some force, so noise is not unusable to it; its frames have no
# texture that shows a changed picture, and it bears more delay than the stale frames of
# so short a recording have. Other tests have these.
# The zeros at the end are what a fall shows: enough of them that none comes twice, and
# that a stalled server, which reads the newest frame alone, still finds the force low.
RULED_N = np.concatenate(
    [np.zeros(10), np.full(60, 16e-3), np.linspace(16e-3, 40e-3, 60), np.zeros(60)]
)
FAULT_S = 1.4  # frame 41, in contact
CHANGED = (
    "burned-in-clock",
    "dark-level",
    "moved",
    "half-frozen",
    "ghost",
    "persistence",
)
SEEN = [name for name in FAULTS if name not in ("unusable", "stale", *CHANGED)]


@pytest.fixture(scope="module")
def ruled(tmp_path_factory) -> Recording:
    pictures = [
        frame_of(round(force_n * 1e6), index)
        for index, force_n in enumerate(RULED_N, start=1)
    ]
    folder = tmp_path_factory.mktemp("ruled") / "rec"

    return read_recording(
        write_small_recording(folder, pictures=pictures, bits=16, pixel_m=SCALE_M)
    )


def injected_into_a_server(ruled: Recording, name: str, version: int) -> FaultReport:
    log = AnswerLog()
    with (
        serving(
            clock=None, catch_up_s=0.1
        ) as port,  # 100 frames are not a flood for a server with time to catch up
        closing(ScannerClient("127.0.0.1", port, log.hear, observed=True)) as client,
    ):
        player = Player(ruled, client, log, version=version)
        ready = prepare(
            name,
            ruled,
            FAULT_S,
            np.random.default_rng(0),
            version=version,
            forces_n=RULED_N,
        )
        player.play(ready.time_s)

        return inject(player, ready)


@pytest.mark.slow
@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("name", SEEN)
def test_the_monitor_withdraws_for_the_faults_own_cause(
    ruled, monkeypatch, name, version
):
    for name_of_limit in (
        "WITHIN_S",
        "SILENT_S",
    ):
        # the monitor's server may be held up
        monkeypatch.setattr(scanner_faults, name_of_limit, FUSE_S)

    found = []
    # a machine that stalls makes frames late or lost, which are causes too: then once
    # more
    for _ in range(5):
        with suppress(InputError):
            report = injected_into_a_server(ruled, name, version)
            assert report.code == 3
            found.append(report.cause)
            if report.expected:
                return

    raise AssertionError(found)


def test_a_whole_recording_is_answered_and_withdrawn_at_its_force(ruled, monkeypatch):
    monkeypatch.setattr(player_module, "ANSWER_S", FUSE_S)
    clock = TurnedClock()
    log = AnswerLog()

    with (
        serving(clock=clock) as port,
        closing(ScannerClient("127.0.0.1", port, log.hear)) as client,
    ):
        Player(ruled, client, log, version=2, wall_clock=clock).step(
            lambda _: clock.turn(FRAME_S) or True
        )

    withdrawal = log.first_doubt(0.0, (3,))
    assert withdrawal is not None
    assert len(log.answers) == len(RULED_N)
    assert withdrawal.cause == "RISING"
    assert withdrawal.answers
    assert 20e-3 < RULED_N[withdrawal.frame - 1] < 30e-3
