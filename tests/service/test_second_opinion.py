"""The second opinion's process: it reads frames from the ring with all that a model has, and says what it finds."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from select import select

import pytest
from analytic_frames import KNOWN, LIBRARY, SCALE, STUDY, image, tip_of, wall_section
from small_models import write_fixed_reader
from waiting import FUSE_S

from scleraforce.known.relaxation import KnownRelaxation
from scleraforce.service import messages
from scleraforce.service.channel import ChannelClosedError, Child
from scleraforce.service.frame_ring import FrameRing

pytest.importorskip("torch")

BINS, BIN = 64, 20  # what the network says always; the fit is the one that answers


class Reader:
    """The process, and the ring that it reads from."""

    def __init__(self, model: Path) -> None:
        self.ring = FrameRing.create(4, STUDY.oct.rows, STUDY.oct.columns)
        known = replace(KNOWN, relaxation=KnownRelaxation.declared([[0.2, 1.0]]))
        settings = messages.OpinionSettings(
            model=model, known=known, scale=SCALE, ring=self.ring.place, learns=None, record=None
        )
        self.child = Child("scleraforce.service.second_opinion", settings, [self.ring.place.descriptor])

    def ask(self, number: int, order: int, at_s: float = 0.0) -> None:
        assert self.child.channel.send(
            messages.OpinionAsked(number=number, order=order, at_s=at_s, teaches=False, pierced=False)
        )

    def hear(self, within_s: float = FUSE_S) -> messages.CompanionMessage:
        assert select([self.child.channel], [], [], within_s)[0], "no opinion came"
        (message,) = self.child.channel.receive()
        return message

    def opinion(self) -> messages.OpinionGiven:
        message = self.hear()
        assert isinstance(message, messages.OpinionGiven), message
        return message


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reader]:
    model = tmp_path_factory.mktemp("opinion") / "reader"
    write_fixed_reader(model, LIBRARY, [float(number == BIN) for number in range(BINS)])
    reader = Reader(model)
    assert reader.hear() == messages.Alive(faults=())  # it has read a frame of its own, and is ready
    yield reader
    assert reader.child.end(FUSE_S) == 0


def test_a_wall_is_read_with_its_force_by_the_fit(reader: Reader) -> None:
    reader.ring.put(1, image(wall_section(tip_of(0.015))))
    reader.ask(1, 71)
    opinion = reader.opinion()
    assert (opinion.order, opinion.verdict.usable, opinion.verdict.predicted) == (71, True, 1)
    assert opinion.verdict.force_n == pytest.approx(0.015, abs=1.2e-3)
    assert opinion.verdict.interval_n
    assert opinion.verdict.probabilities
    assert opinion.verdict.interval_n[0] < 0.015 < opinion.verdict.interval_n[1]
    assert sum(opinion.verdict.probabilities) == pytest.approx(1.0)


def test_of_frames_that_wait_the_newest_is_read_and_one_that_is_gone_is_left_out(reader: Reader) -> None:
    for number, force_n in ((3, 0.003), (4, 0.012), (5, 0.020)):
        reader.ring.put(number, image(wall_section(tip_of(force_n))))
    reader.ask(1, 80)  # gone: frame 5 took its place
    reader.ask(5, 85)
    assert reader.opinion().order == 85


def test_it_keeps_a_history_of_its_own_by_the_times_of_the_frames(reader: Reader) -> None:
    verdicts = []
    for turn in range(12):  # a hold of three seconds, after an unknown time
        reader.ring.put(10 + turn, image(wall_section(tip_of(0.015)), turn))
        reader.ask(10 + turn, 100 + turn, 100.0 + 0.25 * turn)
        verdicts.append(reader.opinion().verdict)
    assert [verdict.elastic_force_n for verdict in verdicts] == pytest.approx([0.015] * 12, abs=1.2e-3)
    assert verdicts[-1].force_n / verdicts[-1].elastic_force_n == pytest.approx(0.805, abs=0.01)
    assert verdicts[0].force_n - verdicts[0].interval_n[0] > 4 * (verdicts[-1].force_n - verdicts[-1].interval_n[0])


def test_a_model_that_cannot_be_read_is_said_before_the_process_ends(tmp_path: Path) -> None:
    broken = Reader(tmp_path / "nowhere")
    message = broken.hear()
    assert isinstance(message, messages.SelfReport)
    assert "nowhere" in message.detail
    assert broken.child.end(FUSE_S) == 1
    with pytest.raises(ChannelClosedError):
        broken.child.channel.send(messages.MonitorEnds())
