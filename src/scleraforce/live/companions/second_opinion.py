"""The second opinion: a process that reads the monitor's frames again, independently,
with the whole model.

The monitor answers with the network, in a few milliseconds. Here the whole chain runs
on the raw frame, including the fit to the response library, which takes several times
as long. The process reads the newest frame, at most 50 a second, skips frames that come
meanwhile, and takes no more than half of a core: it runs in real time, and where a
reading takes 20 ms, others would get nothing of that core. It is ready when it has read
a frame of its own: a first reading takes 0.3 s, and much longer where loops are
compiled, so the opinion of a real frame would be overdue. It keeps its own memory of
the eye. With `learns`, it also learns E (`live.companions.eye_learning`),
which its later readings use.

The frames of several planes are read together, and each gets its own opinion: the force
of all, unless that plane was left out of the fit. A plane without the wall of an eye
must not count as seen only because another one shows it.
"""

from contextlib import AbstractContextManager, nullcontext
from select import select
from time import monotonic, sleep
from typing import TYPE_CHECKING

from scleraforce.base.errors import MessageError
from scleraforce.live.companions.process_channel import Channel, run_companion
from scleraforce.live.companions.process_messages import (
    Alive,
    OpinionAsked,
    OpinionGiven,
    OpinionSettings,
)
from scleraforce.live.companions.shared_frames import FrameRing
from scleraforce.live.companions.watchdog import OPINION_PRIORITY, run_in_real_time
from scleraforce.reading.answer import Answer, unusable_answer
from scleraforce.reading.eye_reader import (
    EyeReader,
    MomentFrame,
    OpenedMoment,
    warming_frame,
)
from scleraforce.reading.load_model import load_reader
from scleraforce.reading.reading_models import ForceReader, Reader
from scleraforce.records.scan import Plane

if TYPE_CHECKING:
    from scleraforce.live.companions.eye_learning import EyeLearner

LEAST_S = 0.02  # from frame to frame


def run_second_opinion(channel: Channel, settings: OpinionSettings) -> None:
    """Read the frames that the monitor names, until its channel closes."""
    reader = load_reader(settings.model)
    with _learner(reader, settings, channel) as learner:
        _serve(channel, settings, reader, learner)


def _serve(
    channel: Channel,
    settings: OpinionSettings,
    reader: Reader,
    learner: "EyeLearner | None",
) -> None:
    ring = FrameRing(settings.ring)
    planes: tuple[Plane | None, ...] = settings.planes or (None,)
    eye_reader = EyeReader(reader, settings.setup)
    memory = eye_reader.start(monitored=True)
    drawn = warming_frame(
        ring.shape,
        settings.scale,
        reader.study.eye.radius_m,
        settings.setup.eye.thickness_m,
    )
    frames = tuple(MomentFrame(drawn, plane) for plane in planes)
    eye_reader.read(OpenedMoment(frames, settings.scale), memory)
    # not before: Linux pauses what leaves a core nothing for a second
    run_in_real_time(OPINION_PRIORITY)
    channel.send(Alive(faults=()))

    while True:
        select([channel], [], [])
        begun_s = monotonic()

        for asked in channel.receive():
            if not isinstance(asked, OpinionAsked):
                raise MessageError(
                    f"a {type(asked).__name__} came; the second opinion is asked about"
                    " frames only"
                )

            if learner:
                learner.hear(asked)

        assert isinstance(asked, OpinionAsked)
        of_plane = {name: (number, order) for name, number, order in asked.planes}
        asked_for = [
            (asked.number, asked.order) if plane is None else of_plane[plane.name]
            for plane in planes
        ]
        frames = tuple(
            MomentFrame(pixels, plane)
            for (number, _), plane in zip(asked_for, planes, strict=True)
            if (pixels := ring.get(number)) is not None
        )
        if len(frames) == len(asked_for):
            moment = OpenedMoment(frames, settings.scale, asked.at_s)
            answers, memory = eye_reader.read(moment, memory)

            for (_, order), answer, plane in zip(
                asked_for, answers, planes, strict=True
            ):
                channel.send(_opinion(answer, order, plane, reader.classes))

            if learner:
                learner.show(asked, answers[0], settings.scale)

        if learner and (learned := learner.learned(monotonic())):
            eye_reader = eye_reader.with_eye(learned.setup.eye)
            channel.send(learned)

        took_s = monotonic() - begun_s
        sleep(max(LEAST_S - took_s, took_s))


def _opinion(
    answer: Answer, order: int, plane: Plane | None, classes: int
) -> OpinionGiven:
    """Return the opinion on a frame; one of several planes that the fit left out cannot
    be judged.
    """
    if plane is None:
        return OpinionGiven(order=order, verdict=answer.verdict, remarks=answer.remarks)

    if answer.usable and answer.left_out is not None:
        answer = unusable_answer(classes, f"left out: {answer.left_out}")

    contact_m = None if answer.place is None else answer.place.contact_m
    return OpinionGiven(
        order=order,
        verdict=answer.verdict,
        remarks=answer.remarks,
        plane=plane.name,
        contact_m=contact_m,
    )


def _learner(
    reader: Reader, settings: OpinionSettings, channel: Channel
) -> "AbstractContextManager[EyeLearner | None]":
    """Start to learn the eye, if the settings ask for it."""
    if not settings.learns:
        return nullcontext()

    # 110 ms: the calibration, not unless an eye is learned
    from scleraforce.calibration.stiffness_from_shape import EyePosterior
    from scleraforce.live.companions.eye_learning import EyeFitting, learning

    assert isinstance(reader, ForceReader)
    begun = EyePosterior(
        setup=settings.setup,
        study=reader.study,
        library=reader.library_for(settings.setup),
    )

    return learning(EyeFitting(begun, settings.learns, settings.record), channel)


if __name__ == "__main__":
    run_companion(OpinionSettings, run_second_opinion)
