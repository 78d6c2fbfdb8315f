"""For how long frames stand that wait, and which of them are too many."""

import pytest
from small_monitor import SCALE_M, frame_of, verdict

from scleraforce.live.decision.events import FrameRead
from scleraforce.live.monitor_session import (
    MOST_FRAMES,
    DeferredFrames,
    FramePace,
    ReceivedFrame,
)
from scleraforce.live.network.scanner_frame import ScannerFrame
from scleraforce.reading.eye_reader import Memory
from scleraforce.reading.tissue_memory import Leak, TissueMemory
from scleraforce.records.setup import NOTHING_KNOWN

MEMORY = Memory(TissueMemory.monitored(NOTHING_KNOWN, 60e-3), Leak())


def deferred(number: int, at_s: float, interval_s: float = 0.01) -> ReceivedFrame:
    image = ScannerFrame(frame_of(0, number), lateral_m=SCALE_M[0], depth_m=SCALE_M[1])
    unread = FrameRead(
        at_s=at_s,
        frame_id=number,
        verdict=verdict(),
        shown_back=0,
        size=(1, 1),
        scale_m=SCALE_M,
    )
    return ReceivedFrame(
        number=number,
        sender_id=number,
        interval_s=interval_s,
        image=image,
        misfit=False,
        unread=unread,
        memory=MEMORY,
    )


def test_a_flood_is_a_loss_even_if_every_frame_is_read_at_once_and_a_steady_stream_is_not():
    flood = DeferredFrames(0.1)
    steady = DeferredFrames(0.1)
    lost = []

    for number in range(30):
        flood.add(deferred(number, 10.0 + 1e-4 * number), number // 10)
        lost += flood.lose(10.0 + 1e-4 * number)
        if len(flood):
            flood.take()

        steady.add(deferred(number, 10.0 + 0.01 * number), number)
        assert steady.lose(10.0 + 0.01 * number) == []
        steady.take()

    assert 19 <= sum(loss.lost for loss in lost) <= 20


def test_a_flood_of_frames_that_stand_for_no_time_fills_no_memory():
    waiting = DeferredFrames(0.1)
    for number in range(MOST_FRAMES + 7):
        waiting.add(deferred(number, 10.0, 1e-6), number // 5)
    losses = [(loss.row, loss.lost, loss.unread_s) for loss in waiting.lose(10.0)]
    assert losses == [(0, 5, pytest.approx(5e-6)), (1, 2, pytest.approx(2e-6))]
    assert (len(waiting), waiting.take().number) == (MOST_FRAMES, 7)


@pytest.mark.parametrize(
    ("sent_s", "intervals_s"),
    [
        ([7.0, 7.001, 7.002, 7.003], [0.01, 1e-3, 1e-3, 1e-3]),
        ([7.0, 7.4, 7.8, 8.2], [0.01, 0.01, 0.1, 0.1]),
        ([7.0, 7.06, 7.061, 7.062, 7.063], [0.01, 0.01, 0.01, 1e-3, 1e-3]),
        (
            [None, 7.0, 7.002, None, 7.1, 7.103, 7.104],
            [0.01, 0.01, 2e-3, 2e-3, 2e-3, 3e-3, 2e-3],
        ),
        ([7.0, 7.0, 6.0], [0.01] * 3),
        ([0.0, 1e-6, 2e-6], [0.01, 1e-3, 1e-3]),
    ],
    ids=["fast", "slow", "paused", "mixed", "wrong", "counted"],
)
def test_the_first_frames_stand_for_the_interval_of_the_times_in_their_headers(
    sent_s, intervals_s
):
    """They may come in one bunch, or after a pause of the scanner, so that their
    arrivals tell nothing.
    """
    pace = FramePace(0.1)
    assert [pace.arrived(5.0, at) for at in sent_s] == pytest.approx(intervals_s)


def test_a_pause_counts_as_a_silence_in_the_interval():
    pace = FramePace(0.1)
    for number in range(1, 101):
        pace.arrived(0.01 * number)
    pace.arrived(60.0)
    assert pace.arrived(60.01) == pytest.approx((99 * 0.01 + 0.1) / 100)
