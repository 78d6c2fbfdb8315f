"""The second opinion: a process that reads the monitor's frames again, independently, with the whole model.

The monitor answers with the network, in a few milliseconds. Here the whole chain runs on the raw frame, including the
fit to the response library, which takes several times as long. The process reads the newest frame, at most 50 a second,
skips frames that come meanwhile, and takes no more than half of a core: it runs in real time, and where a reading takes
20 ms, others would get nothing of that core. It is ready when it has read a frame of its own: a first reading takes
0.3 s, and much longer where loops are compiled, so the opinion of a real frame would be overdue. It keeps its own
history of tissue that relaxes.
"""

from select import select
from time import monotonic, sleep

from scleraforce.errors import MessageError
from scleraforce.reader import load_model
from scleraforce.reader.felt import History
from scleraforce.reader.model import warming_frame
from scleraforce.service.channel import Channel, run_companion
from scleraforce.service.frame_ring import FrameRing
from scleraforce.service.messages import Alive, OpinionAsked, OpinionGiven, OpinionSettings
from scleraforce.service.watchdog import OPINION_PRIORITY, run_in_real_time

LEAST_S = 0.02  # from frame to frame


def serve(channel: Channel, settings: OpinionSettings) -> None:
    """Read the frames that the monitor names, until its channel closes."""
    reader, ring = load_model(settings.model), FrameRing(settings.ring)
    frame = warming_frame(ring.shape, settings.scale, reader.study.eye.radius_m, settings.known.thickness_m)
    reader.read(frame, settings.scale, settings.known)
    history, study = History.monitored(settings.known, reader.study.needle.max_force_n), reader.study
    run_in_real_time(OPINION_PRIORITY)  # not before: Linux pauses what leaves a core nothing for a second
    channel.send(Alive(faults=()))
    while True:
        select([channel], [], [])
        begun_s = monotonic()
        asked = channel.receive()[-1]
        if not isinstance(asked, OpinionAsked):
            raise MessageError(f"a {type(asked).__name__} came; the second opinion is asked about frames only")
        pixels = ring.get(asked.number)
        if pixels is not None:
            elastic = reader.read(pixels, settings.scale, settings.known)
            answer, history = history.read(elastic, study.classes.bounds_n, asked.at_s)
            channel.send(OpinionGiven(order=asked.order, verdict=answer.verdict))
        took_s = monotonic() - begun_s
        sleep(max(LEAST_S - took_s, took_s))


if __name__ == "__main__":
    run_companion(OpinionSettings, serve)
