"""The benchmarks of the monitor: their arithmetic (`test_benchmarks.py` runs each
part).
"""

import json
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from monitor_service.monitors import Resources
from monitor_service.scanner import Answers, Frames
from monitor_service.soak import Sample, grown
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.network.openigtlink import Status, Text


def test_growth_differs_from_a_level() -> None:
    samples = [
        Sample(
            frames,
            {
                "grows": Resources(5000 + frames // 10, 7, 9, 4),
                "stays": Resources(600, 6, 8, 3),
            },
        )
        for frames in range(0, 10_000, 100)
    ]
    assert grown(samples, "grows")["rss"] == [
        pytest.approx(5045),
        pytest.approx(5945),
        pytest.approx(100.0),
    ]
    assert grown(samples, "stays")["rss"] == [600, 600, pytest.approx(0.0, abs=1e-9)]
    assert grown(samples, "stays")["descriptors"] == 3
    assert grown(samples, "nobody") == {}


def test_a_heartbeat_is_not_taken_for_the_answer_to_a_frame() -> None:
    answers = Answers()

    def tell(at_s: float, code: int, frame_id: int | None = None) -> None:
        answers.hear(at_s, "ForceMonitor", Status(code, 0, "", ""))
        if frame_id:
            text = json.dumps({"frame_id": frame_id, "latency_ms": 1.5, "cause": None})
            answers.hear(at_s + 1e-4, "ForceReading", Text(text))

    answers.sent(7, 7, 1.000)
    tell(1.001, 1)
    assert answers.last is None
    tell(1.003, 3, frame_id=7)
    assert answers.last is not None
    assert (answers.last.took_s, answers.last.code) == (pytest.approx(3e-3), 3)
    answers.sent(8, 8, 1.010)
    assert answers.last is None
    answers.sent(9, 9, 1.020)
    tell(1.021, 3, frame_id=9)
    tell(1.500, 3, frame_id=8)
    assert [answer.took_s for answer in answers.answers] == pytest.approx(
        [3e-3, 1e-3, 0.49]
    )
    assert answers.withdrawn_s == 1.003


@pytest.mark.slow
def test_the_way_to_and_fro_takes_steps_of_one_frame_and_shows_no_picture_again_soon(
    folder: Path,
) -> None:
    frames = Frames(folder / "eye", most=40)
    way = list(islice(frames.to_and_fro(), 200))
    assert set(np.abs(np.diff([place % len(frames.force_n) for place in way]))) == {1}
    remembered = MonitorLimits().shown_frames
    assert all(
        place not in way[max(now - remembered, 0) : now]
        for now, place in enumerate(way)
    )
    pictures = {frames.messages[place].stamped(0.0)[-1000:].hex() for place in way}
    assert len(pictures) == len(set(way))
