"""Frames to decisions, over the wire: numbers, orders, bunches, what is counted, the
tissue's history.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import small_monitor as rule
from small_monitor import (
    READ_ENTRY,
    TICK_ENTRY,
    UNUSABLE,
    FakeCompanion,
    Peer,
    TurnedClock,
    frame_of,
    reset,
    serving,
    verdict,
)
from waiting import wait_until

from scleraforce.live.companions.companion_processes import BLACK_BOX, OPINION
from scleraforce.live.companions.process_messages import (
    Decided,
    Entry,
    EyeLearned,
    OpinionGiven,
)
from scleraforce.live.network.openigtlink import Image, Text, Transform
from scleraforce.reading.answer import Answer
from scleraforce.reading.tissue_memory import TissueMemory
from scleraforce.records.eye import Eye
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup
from scleraforce.records.tissue_relaxation import Relaxation

LIMITS = {"silence_s": 0.1, "lag_s": 0.1, "catch_up_s": 0.1}
CROSS = ("along", "across")


@contextmanager
def session(**settings: Any) -> Iterator[Peer]:
    """The scanner of a monitor with the limits of the command; the time is theirs."""
    clock = TurnedClock()
    with (
        serving(clock=clock, **{**LIMITS, **settings}) as port,
        Peer(port, version=2, clock=clock) as scanner,
    ):
        yield scanner


def numbered(scanner: Peer, *numbers: int) -> None:
    for number in numbers:
        scanner.read(10.0 + 0.001 * (number % 50), message_id=number)


def test_a_sender_that_counts_back_is_out_of_order_and_one_that_takes_over_counts_anew():
    clock = TurnedClock()
    with serving(clock=clock) as port:
        with Peer(port, version=2, clock=clock) as first:
            numbered(first, 70, 71, 80)
        with Peer(port, version=2, clock=clock) as second:
            numbered(second, 5, 6)
            assert second.status.code == 1
            numbered(second, 6)
            assert second.status.name == "OUT_OF_ORDER"
            assert "frame 81 after 82" not in second.status.message

    with session() as scanner:
        numbered(scanner, 71, 70)
        assert "frame 70 after 71" in scanner.status.message


def test_one_number_far_ahead_makes_no_later_frame_a_misfit():
    """A misfit is answered, and never waits while newer frames are read."""
    with session() as scanner:
        numbered(scanner, 70, 2**31, 71)
        assert scanner.status.name == "OUT_OF_ORDER"
        scanner.show_together(
            10.0, 10.01, headers=lambda place: {"message_id": 71 + place}
        )
        scanner.hear_readings(4)
        assert scanner.said()["overtaken"] == 1


@pytest.mark.parametrize(("learned_n_m", "code"), [(400.0, 1), (None, 3)])
def test_a_learned_eye_moves_the_stiffness_of_punctures(learned_n_m, code):
    """A withdrawal from a stiff wall explains a fall of 12 mN in 10 ms."""
    companions = {OPINION: FakeCompanion()}
    with session(companions=companions, learned_n_m=learned_n_m) as scanner:
        scanner.watch(24.0)
        companions[OPINION].says(EyeLearned(setup=Setup(), frames=7, fault=""))
        companions[OPINION].says(
            OpinionGiven(order=1, verdict=verdict(31.0, (30.0, 32.0)))
        )
        scanner.wait_for_code(3)  # it has heard both
        for _ in range(8):
            scanner.read(24.0)
        assert reset(scanner.port)[0] is True
        for force_mn in (24.0, 24.0, 12.0, 12.01):
            scanner.read(force_mn)
        assert scanner.status.code == code


def test_what_is_wrong_now_and_since_when_is_in_each_entry():
    with session() as scanner:
        scanner.read(10.0)
        assert scanner.said()["withdrawn_s"] is None
        scanner.clock.turn(0.2)
        scanner.wait_for_code(3)
        began_s = scanner.clock()
        scanner.read(10.0)
        scanner.read(39.0)
        said = scanner.said()
        assert (said["cause"], said["present_cause"]) == ("SILENCE", "DANGEROUS_CLASS")
        assert said["withdrawn_s"] == began_s
        scanner.read(10.0)
        said = scanner.said()
        assert (said["cause"], said["present_cause"]) == ("SILENCE", None)
        assert said["present"] == ""


def test_a_puncture_that_is_only_reported_does_not_count_as_a_withdrawal_and_a_later_cause_does():
    with session(reports_pierced=True) as scanner:
        for force_mn in (24.0, 24.001, 24.002, 7.0, 7.001):
            scanner.read(force_mn)

        said = scanner.said()
        assert (said["state"], said["code"], said["cause"]) == (
            "PIERCED",
            14,
            "PIERCED",
        )
        assert said["withdrawn_s"] is None
        scanner.clock.turn(0.2)
        assert scanner.wait_for_code(3).name == "SILENCE"
        began_s = scanner.clock()
        scanner.read(7.0)
        assert scanner.said()["withdrawn_s"] == began_s


@pytest.mark.parametrize(("back_mm", "code"), [(0.0, 3), (0.5, 1)])
def test_what_the_needle_went_back_explains_a_fall_or_not(back_mm, code):
    with session(retraction_m_s=0.05) as scanner:
        for number, force_mn in enumerate((24.0, 24.1, 24.2, 24.3, 7.0, 7.1)):
            travel_mm = 2.0 - back_mm * max(number - 3, 0)
            pose = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, travel_mm)
            with scanner.clock.held():  # pose and frame arrive at one time
                scanner.say(Transform(pose), "NeedlePose")
                scanner.show(force_mn)
                scanner.deliver()
            scanner.hear(lambda peer, read=number: peer.readings() > read)

        assert scanner.status.code == code


def test_a_frame_of_another_size_is_not_read():
    def read(pixels, scale):
        sizes.add(pixels.shape)
        return rule.read(pixels, scale)

    sizes = set()
    with session(rule=read) as scanner:
        scanner.read(10.0)
        scanner.read(10.0, np.zeros((rule.ROWS, rule.COLUMNS + 1), np.uint16))
        assert scanner.status.name == "SIZE"
        assert (rule.ROWS, rule.COLUMNS + 1) not in sizes


HEADER_S = {
    "as taken": lambda n: 5000.0 + 0.01 * n,
    "none": lambda _: 0.0,
    "in other units": lambda n: 5000.0 + 10.0 * n,
    "always the same": lambda _: 5000.0,
}


def bunch(
    scanner: Peer, forces_mn: Sequence[float], header_s: Callable[[int], float]
) -> None:
    """Show frames each 10 ms, then four that come at once, and wait until they are
    read.
    """

    def header(number: int) -> dict[str, Any]:
        return {"message_id": number, "time_s": header_s(number)}

    for number in range(1, 21):
        scanner.read(21.0 + 0.001 * (number % 3), **header(number))

    scanner.show_together(
        *forces_mn, within_s=0.04, headers=lambda place: header(20 + place)
    )
    scanner.hear_readings(21)


@pytest.mark.parametrize("header", HEADER_S)
def test_a_bunch_is_in_the_order_of_time_and_hides_no_puncture(header):
    """Four frames of 10 ms at once, none lost: the second one shows the fall."""
    patient = {"lag_s": 10.0, "catch_up_s": 0.5}
    with session(stiffness_n_m=30.0, **patient) as scanner:
        bunch(scanner, (21.002, 8.0, 8.01, 8.02), HEADER_S[header])
        assert scanner.said()["code"] == 1  # one frame may be wild
        scanner.hear(lambda peer: peer.status.code == 3)
        assert scanner.status.name == "PIERCED"


def test_a_bunch_of_a_fast_withdrawal_is_no_puncture():
    """All frames of the bunch came at one time, but were not taken at one."""
    forces_un = []

    def read(pixels, scale):
        forces_un.append(int(pixels[0, 0]))
        return rule.read(pixels, scale)

    with session(rule=read, stiffness_n_m=30.0, retraction_m_s=0.05) as scanner:
        bunch(scanner, (16.0, 11.0, 6.0, 3.0), HEADER_S["none"])
        wait_until(lambda: 6000 in forces_un)  # the last that was overtaken
        scanner.read(3.0, message_id=25, time_s=0.0)
        assert scanner.status.code == 1


def in_parts(scanner: Peer, number: int, apart_s: float) -> None:
    """Show a frame whose second half comes later."""
    pixels = frame_of(10_000, number)
    for begin in (0, 32):
        part = pixels[None, begin : begin + 32]
        size = (rule.COLUMNS, rule.ROWS, 1)
        image = Image(part, rule.MATRIX, size, (0, begin, 0))
        scanner.every_s = apart_s if begin else 0.0
        scanner.say(image, time_s=1.8e9, message_id=number)
        # its answer shows that the part was heard
        heard = len(scanner.texts("ForceReset"))
        scanner.say(Text("wrong"), "ForceReset")
        scanner.hear(lambda peer: len(peer.texts("ForceReset")) > heard)  # noqa: B023 - called at once


def test_a_frame_is_as_old_as_its_oldest_part():
    with session(silence_s=0.2) as scanner:
        for number in range(1, 6):
            scanner.read(10.0, message_id=number, time_s=1.8e9 - 0.05 + 0.01 * number)
        begun_s = scanner.clock()
        in_parts(scanner, 6, 0.04)
        scanner.hear_readings(6)
        scanner.clock.turn(begun_s + 0.199 - scanner.clock())
        heard = len(scanner.statuses())
        scanner.hear(lambda peer: len(peer.statuses()) > heard)
        assert scanner.status.code == 1
        scanner.clock.turn(0.0101)  # a tick
        assert scanner.wait_for_code(3).name == "SILENCE"

    with session() as scanner:
        in_parts(scanner, 1, 5.0)
        scanner.hear_readings(1)
        status = scanner.statuses()[-1]
        assert status.name == "STALE"
        assert "first part of the frame came 5000 ms before" in status.message


@pytest.mark.parametrize(
    ("before", "interval_s", "header_s", "frames", "lost", "code"),
    [
        (30, 0.02, None, 3, 2, 1),
        (30, 0.02, None, 4, 3, 3),
        (30, 0.01, None, 5, 4, 1),
        (30, 0.01, None, 6, 5, 3),
        (0, 0.01, 0.001, 5, 4, 1),  # 13 ms of a scanner of 1000 Hz
        (0, 0.01, 0.02, 5, 4, 3),
    ],
)
def test_frames_that_are_not_read_in_time_are_lost_and_stand_for_the_scanners_interval(
    before,
    interval_s,
    header_s,
    frames,
    lost,
    code,
):
    """A bunch of which the newest takes longer than there is to catch up; 40 ms in a
    row may be lost.
    """

    def read(pixels, scale):
        if int(pixels[0, 0]) == 10_100:
            scanner.clock.turn(LIMITS["catch_up_s"] + 0.001)
        return rule.read(pixels, scale)

    def header(place):
        time_s = 0.0 if header_s is None else 5.0 + place * header_s
        return {"message_id": before + place, "time_s": time_s}

    patient = {"rule": read, "silence_s": 0.5, "lag_s": 0.5}
    with session(**patient) as scanner:
        scanner.every_s = interval_s
        for number in range(1, before + 1):
            scanner.read(10.0, message_id=number, time_s=0.0)

        forces_mn = [*[10.0] * (frames - 1), 10.1]
        scanner.show_together(*forces_mn, headers=header)
        scanner.hear_readings(before + 1)
        scanner.read(10.0, message_id=before + 50, time_s=0.0)
        assert scanner.said()["lost"] == lost
        assert scanner.status.code == code
        assert code == 1 or scanner.status.name == "QUEUE_BEHIND"


def test_nan_and_infinity_are_null_everywhere():
    nan = float("nan")
    inf = float("inf")
    entry = replace(
        READ_ENTRY,
        verdict=verdict(nan, (-inf, 13.5), probabilities=(nan, inf, 0.5)),
        latency_ms=inf,
    )
    # NaN and Infinity are not JSON
    record = json.loads(json.dumps(entry.as_json()), parse_constant=pytest.fail)
    assert record["force_mn"] is record["latency_ms"] is None
    assert record["interval_mn"] == [None, 13.5]
    assert record["probabilities"] == [None, None, 0.5]


def test_a_frame_that_was_not_read_is_not_usable_and_another_event_is_neither():
    record = replace(READ_ENTRY, verdict=None).as_json()
    assert record["usable"] is False
    assert record["class"] is record["force_mn"] is None
    assert Entry.from_json(record) == replace(READ_ENTRY, verdict=None)
    assert TICK_ENTRY.as_json()["usable"] is None
    assert not {"plane", "contact_xyz_mm"} & record.keys()


TISSUE = Setup(eye=Eye(relaxation=Relaxation.declared([[0.3, 1.0]])))
CLASSES_N = (5e-3, 30e-3)


class Felt:
    """The force of frames by the tissue's memory alone."""

    def __init__(self) -> None:
        self.memory = TissueMemory.monitored(TISSUE, 60e-3)

    def read(self, force_un: int, at_s: float) -> Answer:
        scale = PixelScale(lateral_m=rule.SCALE_M[0], depth_m=rule.SCALE_M[1])
        elastic = rule.read(frame_of(force_un, 1), scale)
        answer, self.memory = self.memory.read(elastic, CLASSES_N, at_s)
        return answer


def is_felt(scanner: Peer, felt: Felt, force_un: int, **header: Any) -> bool:
    """Show a frame; return whether it was read as by the memory alone."""
    scanner.read(force_un / 1e3, **header)
    expected = felt.read(force_un, scanner.clock())
    said = scanner.said()
    return said["force_mn"] == pytest.approx(1e3 * expected.force_n, abs=1e-9) and said[
        "interval_mn"
    ] == pytest.approx([1e3 * end_n for end_n in expected.interval_n], abs=1e-9)


def test_the_history_runs_on_through_a_withdrawal_and_a_reset_and_a_restart_has_none():
    felt = Felt()
    with session(setup=TISSUE) as scanner:
        for force_un in (*[0] * 5, *range(20_000, 20_100)):
            assert is_felt(scanner, felt, force_un)
        said = scanner.said()
        assert said["elastic_force_mn"] == pytest.approx(20.099)
        relaxed_mn = 20.0 * (1.0 - 0.3 * (1.0 - np.exp(-1.0)))
        assert said["force_mn"] == pytest.approx(relaxed_mn, rel=0.01)
        scanner.read(0, frame_of(UNUSABLE, 1))
        felt.read(UNUSABLE, scanner.clock())
        assert scanner.status.name == "UNUSABLE"
        for force_un in range(20_102, 20_112):
            assert is_felt(scanner, felt, force_un)
        assert reset(scanner.port)[0] is True
        assert is_felt(scanner, felt, 20_200)
        before = scanner.said()

    with session(setup=TISSUE) as scanner:
        scanner.read(20.2)
        restarted = scanner.said()

    assert np.ptp(restarted["interval_mn"]) > 1.5 * np.ptp(before["interval_mn"])
    assert restarted["force_mn"] > before["force_mn"]  # the safe side


def test_old_pictures_leave_gaps_in_the_history():
    felt = Felt()
    with session(setup=TISSUE) as scanner:
        for force_un in range(20_000, 20_050):
            assert is_felt(scanner, felt, force_un)
        old = frame_of(20_049, 1)
        scanner.read(0, old)
        felt.read(20_049, scanner.clock())
        scanner.read(0, old)
        assert is_felt(scanner, felt, 20_052)


def test_tissue_that_relaxes_has_a_history_in_each_plane():
    felt = {plane: Felt() for plane in CROSS}
    with session(setup=TISSUE, planes=CROSS) as scanner:
        for number in range(1, 60):
            for plane, force_un in (("along", 12_000), ("across", 20_000)):
                header = {"device": plane, "message_id": number}
                assert is_felt(scanner, felt[plane], force_un, **header)
        assert scanner.status.code == 1


@pytest.mark.parametrize("step", [1, 2], ids=["alone", "together"])
def test_planes_may_count_their_frames_alone_or_together_and_each_has_its_own_pace_and_queue(
    step,
):
    """Fifteen frames of each come at once, and two of each are answered, as the server
    takes sixteen at a time: thirteen are 130 ms, of which 100 may wait.
    """

    def header(place):
        turn, plane = divmod(place - 1, 2)
        return {"device": CROSS[plane], "message_id": 1000 + 2 * turn + step * plane}

    with session(planes=CROSS, size=(16, 16)) as scanner:
        scanner.size = (16, 16)
        scanner.every_s = 0.005
        for turn in range(120):
            for place, plane in enumerate(CROSS):
                number = 1 + 2 * turn + (step - 1) * place
                scanner.read(10.0, device=plane, message_id=number)

        assert scanner.status.code == 1
        scanner.show_together(*[10.0] * 30, headers=header)
        scanner.hear_readings(244)
        assert scanner.said()["lost"] == 6


@pytest.mark.parametrize(
    ("stamped", "apart_s", "lost", "apart"),
    [
        (True, 0.0, 0, 0),
        (True, 0.009, 0, 0),
        (False, 0.001, 0, 0),
        (False, 0.005, 0, 1),
        (False, 0.0099, 0, 1),
        (True, 0.0, 41, 0),
        (False, 0.0, 41, 0),
    ],
)
def test_a_moment_is_one_time_stamp_or_less_than_one_interval(
    stamped, apart_s, lost, apart
):
    """Frames of two planes, one of which may be lost; the frames of a moment are as
    many turns `apart`.
    """
    box = FakeCompanion()
    with session(companions={BLACK_BOX: box}, planes=CROSS) as scanner:
        begun_s = scanner.clock()
        for number in range(1, 80):
            turn, place = divmod(number, 2)
            at_s = begun_s + 0.01 * turn + apart_s * place
            scanner.every_s = at_s - scanner.clock()
            if number != lost:
                time_s = begun_s + 0.01 * turn if stamped else 0.0
                plane = CROSS[place]
                scanner.read(10.0, device=plane, message_id=number, time_s=time_s)

        decided = [one for one in box.told(Decided) if one.entry.frame is not None]

    sent = {one.entry.frame: one.entry.frame_id // 2 for one in decided}
    together = [
        abs(sent[one.entry.frame] - sent[one.moment])
        for one in decided
        if one.moment != one.entry.frame
    ]
    assert set(together[-20:]) == {apart}
    assert len(together) >= 35


def test_a_picture_under_two_names_is_frozen():
    with session(planes=CROSS) as scanner:
        for number in range(1, 4):
            for plane in CROSS:
                pixels = frame_of(10_000, number)
                scanner.read(0, pixels, device=plane, message_id=number)
            assert (scanner.status.code == 3) == (number >= 2)

        status = scanner.statuses()[-1]
        assert status.name == "FROZEN"
        assert "plane across: a picture of 2 frames ago" in status.message
