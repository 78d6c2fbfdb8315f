import json

import pytest

from scleraforce.service.companions.channel import MESSAGE_BYTES, Channel, ChannelClosedError


@pytest.fixture
def ends():
    ours, theirs = Channel.pair()
    yield ours, theirs
    ours.close()
    theirs.close()


def test_messages_arrive_whole_and_in_order_both_ways(ends):
    for sender, receiver in (ends, ends[::-1]):
        sent = [{"number": number, "text": "é\n" * number} for number in range(50)]
        assert all(sender.send(message) for message in sent)
        assert receiver.receive() == sent


def test_receiving_never_waits_and_takes_no_more_than_asked_for(ends):
    ours, theirs = ends
    assert theirs.receive() == []
    for number in range(5):
        ours.send({"number": number})
    assert [message["number"] for message in theirs.receive(3)] == [0, 1, 2]
    assert [message["number"] for message in theirs.receive(3)] == [3, 4]


def test_an_end_that_does_not_read_loses_messages_but_never_makes_the_other_wait(ends):
    ours, theirs = ends
    sent = 0
    while ours.send({"number": sent, "text": "x" * 4000}):
        sent += 1
    assert not ours.send({"number": -1, "text": "x" * 4000})
    numbers = []
    while messages := theirs.receive():
        numbers += [message["number"] for message in messages]
    assert numbers == list(range(sent))
    assert ours.send({"number": sent})


def test_what_an_end_sent_before_it_left_is_read_first_then_it_is_said(ends):
    ours, theirs = ends
    ours.send({"number": 1})
    ours.close()
    assert theirs.receive() == [{"number": 1}]
    with pytest.raises(ChannelClosedError):
        theirs.receive()


def test_an_end_that_left_without_reading_has_its_last_messages_read_all_the_same(ends):
    ours, theirs = ends
    theirs.send({"kind": "alive"})  # the kernel answers such a leaving with an error, once
    for number in range(3):
        ours.send({"number": number})
    ours.close()
    assert [message["number"] for message in theirs.receive()] == [0, 1, 2]
    for _ in range(2):
        with pytest.raises(ChannelClosedError):
            theirs.receive()


def test_sending_to_an_end_that_left_is_said(ends):
    ours, theirs = ends
    theirs.close()
    with pytest.raises(ChannelClosedError):
        ours.send({})


def test_the_largest_message_arrives_and_a_larger_one_is_refused_before_it_is_cut(ends):
    ours, theirs = ends
    text = json.dumps({"text": "x" * (MESSAGE_BYTES - 12)})
    assert len(text) == MESSAGE_BYTES
    assert ours.send_text(text)
    assert theirs.receive() == [json.loads(text)]
    with pytest.raises(ValueError, match="131073 bytes"):
        ours.send_text(text + " ")
    assert theirs.receive() == []
