"""The second opinion: a process that reads the monitor's frames again, independently, with the whole model.

The monitor answers with the network, in a few milliseconds. Here the whole chain runs on the raw frame, including the
fit to the response library, which takes several times as long. The process reads the newest frame, at most 50 a second,
skips frames that come meanwhile, and takes no more than half of a core: it runs in real time, and where a reading takes
20 ms, others would get nothing of that core. It is ready when it has read a frame of its own: a first reading takes
0.3 s, and much longer where loops are compiled, so the opinion of a real frame would be overdue. It keeps its own
history of tissue that relaxes. With `learns`, it also learns E (`service.learning`), which its later readings use.
"""

from contextlib import AbstractContextManager, nullcontext
from select import select
from time import monotonic, sleep
from typing import TYPE_CHECKING

from scleraforce.errors import MessageError
from scleraforce.reader import Reader, load_model
from scleraforce.reader.felt import History
from scleraforce.reader.model import warming_frame
from scleraforce.service.channel import Channel, run_companion
from scleraforce.service.frame_ring import FrameRing
from scleraforce.service.messages import Alive, OpinionAsked, OpinionGiven, OpinionSettings
from scleraforce.service.watchdog import OPINION_PRIORITY, run_in_real_time

if TYPE_CHECKING:
    from scleraforce.service.learning import EyeLearner

LEAST_S = 0.02  # from frame to frame


def serve(channel: Channel, settings: OpinionSettings) -> None:
    """Read the frames that the monitor names, until its channel closes."""
    reader = load_model(settings.model)
    with _learner(reader, settings, channel) as learner:
        _serve(channel, settings, reader, learner)


def _serve(channel: Channel, settings: OpinionSettings, reader: Reader, learner: "EyeLearner | None") -> None:
    ring, known = FrameRing(settings.ring), settings.known
    frame = warming_frame(ring.shape, settings.scale, reader.study.eye.radius_m, settings.known.thickness_m)
    reader.read(frame, settings.scale, settings.known)
    history, study = History.monitored(settings.known, reader.study.needle.max_force_n), reader.study
    run_in_real_time(OPINION_PRIORITY)  # not before: Linux pauses what leaves a core nothing for a second
    channel.send(Alive(faults=()))
    while True:
        select([channel], [], [])
        begun_s = monotonic()
        for asked in channel.receive():
            if not isinstance(asked, OpinionAsked):
                raise MessageError(f"a {type(asked).__name__} came; the second opinion is asked about frames only")
            if learner:
                learner.hear(asked)
        assert isinstance(asked, OpinionAsked)
        pixels = ring.get(asked.number)
        if pixels is not None:
            elastic = reader.read(pixels, settings.scale, known)
            answer, history = history.read(elastic, study.classes.bounds_n, asked.at_s)
            channel.send(OpinionGiven(order=asked.order, verdict=answer.verdict))
            if learner:
                learner.show(asked, elastic, settings.scale)
        if learner and (learned := learner.learned(monotonic())):
            known = learned.known if reader.refusal(learned.known) is None else known
            channel.send(learned)
        took_s = monotonic() - begun_s
        sleep(max(LEAST_S - took_s, took_s))


def _learner(
    reader: Reader, settings: OpinionSettings, channel: Channel
) -> "AbstractContextManager[EyeLearner | None]":
    """Start to learn the eye, if the settings ask for it. What this imports, nothing else here needs."""
    if not settings.learns:
        return nullcontext()
    from scleraforce.calibration.eye_posterior import EyePosterior
    from scleraforce.reader.kinds import ForceReader
    from scleraforce.service.learning import Fitting, learning

    assert isinstance(reader, ForceReader)
    begun = EyePosterior(known=settings.known, study=reader.study, library=reader.library_for(settings.known))
    return learning(Fitting(begun, settings.learns, settings.record), channel)


if __name__ == "__main__":
    run_companion(OpinionSettings, serve)
