import pytest

from scleraforce.errors import MessageError
from scleraforce.service.companions.channel import Channel, ChannelClosedError
from scleraforce.service.companions.codec import MESSAGE_BYTES, encode_message
from scleraforce.service.companions.messages import Note


def note(number, text=""):
    return Note(time_s=float(number), text=text)


def numbers_of(messages):
    return [message.time_s for message in messages]


@pytest.fixture
def ends():
    ours, theirs = Channel.pair()
    yield ours, theirs
    ours.close()
    theirs.close()


def test_messages_arrive_whole_and_in_order_both_ways(ends):
    for sender, receiver in (ends, ends[::-1]):
        sent = [note(number, "é\n" * number) for number in range(50)]
        assert all(sender.send(message) for message in sent)
        assert receiver.receive() == sent


def test_receiving_never_waits_and_takes_no_more_than_asked_for(ends):
    ours, theirs = ends
    assert theirs.receive() == []
    for number in range(5):
        ours.send(note(number))
    assert numbers_of(theirs.receive(3)) == [0, 1, 2]
    assert numbers_of(theirs.receive(3)) == [3, 4]


def test_an_end_that_does_not_read_loses_messages_but_never_makes_the_other_wait(ends):
    ours, theirs = ends
    sent = 0
    while ours.send(note(sent, "x" * 4000)):
        sent += 1
    assert not ours.send(note(-1, "x" * 4000))
    numbers = []
    while messages := theirs.receive():
        numbers += numbers_of(messages)
    assert numbers == list(range(sent))
    assert ours.send(note(sent))


def test_what_an_end_sent_before_it_left_is_read_first_then_it_is_said(ends):
    ours, theirs = ends
    ours.send(note(1))
    ours.close()
    assert theirs.receive() == [note(1)]
    with pytest.raises(ChannelClosedError):
        theirs.receive()


def test_an_end_that_left_without_reading_has_its_last_messages_read_all_the_same(ends):
    ours, theirs = ends
    theirs.send(note(0))  # the kernel answers such a leaving with an error, once
    for number in range(3):
        ours.send(note(number))
    ours.close()
    assert numbers_of(theirs.receive()) == [0, 1, 2]
    for _ in range(2):
        with pytest.raises(ChannelClosedError):
            theirs.receive()


def test_sending_to_an_end_that_left_is_said(ends):
    ours, theirs = ends
    theirs.close()
    with pytest.raises(ChannelClosedError):
        ours.send(note(0))


def test_the_largest_message_arrives_and_a_larger_one_is_refused_before_and_after_it_is_cut(ends):
    ours, theirs = ends
    largest = note(1, "x" * (MESSAGE_BYTES - len(encode_message(note(1)))))
    assert ours.send(largest)
    assert theirs.receive() == [largest]
    with pytest.raises(MessageError, match="131073 bytes"):
        ours.send(note(1, largest.text + "x"))
    assert theirs.receive() == []
    assert ours.send_encoded(encode_message(largest) + b" " * 1000)  # JSON all the same, if it were cut
    with pytest.raises(MessageError, match="131073 bytes"):
        theirs.receive()


def test_after_what_is_no_message_the_next_ones_can_be_read(ends):
    ours, theirs = ends
    ours.send_encoded(b"{}")
    ours.send(note(1))
    with pytest.raises(MessageError):
        theirs.receive()
    assert theirs.receive() == [note(1)]
