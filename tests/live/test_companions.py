"""The companions as the monitor sees them: their faults come and go, and one that says
nothing is one.
"""

from collections.abc import Iterator

import pytest
from msgspec.msgpack import encode as packb
from small_monitor import FakeCompanion, decision, verdict

from scleraforce.live.companions import process_messages
from scleraforce.live.companions.companion_processes import (
    BLACK_BOX,
    CONSOLE,
    OPINION,
    Companions,
)
from scleraforce.live.companions.process_channel import encode_message
from scleraforce.live.companions.process_messages import (
    Alive,
    CompanionMessage,
    Decided,
    Note,
    OpinionGiven,
    SelfReport,
)

OPINION_OF_3 = OpinionGiven(order=3, verdict=verdict(predicted=0))


@pytest.fixture
def children() -> Iterator[dict[str, FakeCompanion]]:
    children = {name: FakeCompanion() for name in (BLACK_BOX, CONSOLE, OPINION)}
    yield children
    for child in children.values():
        child.close()


@pytest.fixture
def companions(children: dict[str, FakeCompanion]) -> Companions:
    return Companions(children)


def hear(companions: Companions, name: str, now_s: float) -> list[CompanionMessage]:
    return list(companions.hear(name, now_s))


def test_a_black_box_that_says_nothing_for_five_seconds_is_at_fault_until_it_does(
    companions, children
):
    assert companions.faults(100.0) == ()
    assert companions.faults(129.0) == ()  # it may take so long to start
    assert companions.faults(130.1) == ("black box: it does not answer",)
    children[BLACK_BOX].says(Alive(faults=()))
    hear(companions, BLACK_BOX, 129.0)
    assert companions.faults(133.9) == ()
    children[OPINION].says(Alive(faults=()))  # speaks for itself only
    hear(companions, OPINION, 134.0)
    assert companions.faults(134.1) == ("black box: it does not answer",)
    children[BLACK_BOX].says(Alive(faults=()))
    hear(companions, BLACK_BOX, 135.0)
    assert companions.faults(135.0) == ()


@pytest.mark.parametrize("name", [BLACK_BOX, OPINION])
def test_one_that_is_needed_and_dies_is_at_fault_for_ever_by_its_last_words(
    companions, children, name
):
    children[name].says(SelfReport(detail="no model"))
    children[name].theirs.close()
    hear(companions, name, 1.0)
    hear(companions, name, 1.1)
    assert companions.dead(name)
    assert companions.faults(1.1) == (f"{name}: no model",)


def test_a_breach_or_the_death_of_a_console_is_not_a_fault(companions, children):
    children[CONSOLE].theirs.send_encoded(b"{}")
    assert hear(companions, CONSOLE, 0.5) == []
    assert companions.faults(0.5) == ()
    children[CONSOLE].theirs.close()
    hear(companions, CONSOLE, 1.0)
    assert companions.dead(CONSOLE)
    assert companions.faults(1.0) == ()


def test_one_that_takes_nothing_for_two_seconds_does_not_keep_up_until_it_does(
    companions, children
):
    message = Note(time_s=1.5, text="x" * 100_000)
    for _ in range(1000):
        companions.send(OPINION, message, 10.0)

    assert companions.faults(11.9) == ()
    assert companions.faults(12.1) == ("second opinion: it does not keep up",)
    children[OPINION].theirs.receive()
    companions.send(OPINION, message, 12.2)
    assert companions.faults(12.2) == ()


def test_decisions_wait_for_a_black_box_that_does_not_keep_up_and_go_before_all_else(
    companions, children
):
    for _ in range(5000):
        companions.send(
            BLACK_BOX,
            process_messages.ForceHeard(
                at_s=1.0, time_s=1.0, values=(0.0,), device="x" * 1000
            ),
            10.0,
        )

    for number in range(1, 501):
        companions.decided(Decided(entry=decision(number=number, message="x" * 1000)))
        companions.send(BLACK_BOX, Note(time_s=1.5, text=str(number)), 10.0)

    heard = []
    while some := children[BLACK_BOX].theirs.receive(50):
        heard += some
        companions.faults(10.1)

    assert [
        message.entry.number for message in heard if isinstance(message, Decided)
    ] == list(range(1, 501))
    assert not [message for message in heard if isinstance(message, Note)]
    companions.send(BLACK_BOX, Note(time_s=1.5, text="late"), 10.2)
    assert children[BLACK_BOX].theirs.receive() == [Note(time_s=1.5, text="late")]
    assert companions.faults(10.3) == ()


def test_a_black_box_that_loses_a_decision_is_at_fault_at_once(companions, children):
    for number in range(1, 200):
        companions.decided(Decided(entry=decision(number=number, message="x" * 1000)))

    assert companions.faults(10.1) == ()
    for number in range(200, 5000):
        companions.decided(Decided(entry=decision(number=number, message="x" * 1000)))

    assert companions.faults(10.1) == ("black box: it does not keep up",)
    while children[BLACK_BOX].theirs.receive(50):
        companions.faults(10.2)

    assert companions.faults(10.3) == ()


def test_what_one_says_of_the_frames_is_passed_on(companions, children):
    console = [
        process_messages.ResetAsked(request=1, token="t"),
        process_messages.ListensAt(url="u"),
        process_messages.WrongTokens(count=2),
    ]
    kept = process_messages.WithdrawalKept(folder="x")

    for name, said in (
        (OPINION, [OPINION_OF_3]),
        (BLACK_BOX, [kept]),
        (CONSOLE, console),
    ):
        for message in said:
            children[name].says(message)

        assert hear(companions, name, 1.0) == said

    assert companions.faults(1.0) == ()


@pytest.mark.parametrize(
    ("name", "said", "reason"),
    [
        (OPINION, packb({"type": "OpinionGiven"}), "order"),
        (BLACK_BOX, b"\xff", "not a message"),
        (
            BLACK_BOX,
            encode_message(process_messages.ResetAsked(request=1, token="t")),
            "a ResetAsked is not its to send",
        ),
        (
            OPINION,
            encode_message(process_messages.WithdrawalKept(folder="x")),
            "a WithdrawalKept is not its to send",
        ),
    ],
)
def test_one_that_does_not_keep_to_the_protocol_is_at_fault_for_good(
    companions, children, name, said, reason
):
    children[name].theirs.send_encoded(said)
    assert hear(companions, name, 1.0) == []
    children[name].says(Alive(faults=()))
    hear(companions, name, 1.5)
    (fault,) = companions.faults(1.5)
    assert fault.startswith(f"{name}: it does not keep to the protocol: ")
    assert reason in fault
    assert reason in companions.last_words(name)
    assert not companions.dead(name)
