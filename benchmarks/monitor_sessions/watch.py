"""One monitor without sockets: network, second opinion and decision, on frames that are
handed to it.
"""

from dataclasses import dataclass, replace

from monitor_sessions.forces import FRAME_S
from monitor_sessions.frames import Frame
from scleraforce.live.companions.eye_learning import EyeLearner
from scleraforce.live.companions.process_messages import OpinionAsked
from scleraforce.live.decision.decide import Decision, decide
from scleraforce.live.decision.events import (
    Cause,
    FrameRead,
    MonitorEvent,
    QueueLoss,
    Reset,
    SecondOpinion,
    State,
)
from scleraforce.live.decision.limits import MonitorLimits
from scleraforce.live.decision.state import MonitorState
from scleraforce.reading.answer import Answer
from scleraforce.reading.eye_reader import EyeReader, MomentFrame, OpenedMoment
from scleraforce.reading.reading_models import ForceReader
from scleraforce.records.scan import PixelScale
from scleraforce.records.setup import Setup

# frames; the fit takes so long on a busy machine, and skips what comes then
OPINION_EVERY = 3
OPINION_AFTER_S = 0.025
RESET_AFTER_S = 1.0
WITHDRAW = 3


@dataclass(frozen=True)
class Withdrawal:
    """Time of a withdrawal, s, and its cause."""

    at_s: float
    cause: str
    message: str


class Watch:
    """A monitor with one declaration of an eye, which it may learn.

    `released` counts the withdrawals that ended without a reset: none, or a claim of
    the monitor is wrong.
    """

    def __init__(
        self,
        reader: ForceReader,
        setup: Setup,
        limits: MonitorLimits,
        learner: EyeLearner | None = None,
        opinion_every: int = OPINION_EVERY,
    ) -> None:
        stiffness_n_m = reader.steepest_n_m(setup) or limits.stiffness_n_m
        self.setup = setup
        self.limits = replace(limits, stiffness_n_m=stiffness_n_m)
        self.released = 0
        self._reader = reader
        self._learner = learner
        self._opinion_every = opinion_every
        self._scale = PixelScale.of(reader.study.oct)
        self._live = EyeReader(reader, setup, by="network")
        self._memory = self._live.start(monitored=True)
        self._state = MonitorState()
        self._decision: Decision | None = None
        self._pending: list[SecondOpinion] = []
        self._asked_s = 0.0

    @property
    def code(self) -> int | None:
        """The last answer to the robot."""
        return None if self._decision is None else self._decision.code

    def lost(self, at_s: float) -> Withdrawal | None:
        """Hear that a frame was lost."""
        return self._hear(
            [QueueLoss(at_s=at_s, lost=1, unread_s=FRAME_S, row=round(at_s / FRAME_S))],
            at_s,
        )

    def read(
        self, frame: Frame, at_s: float, number: int, shown_back: int
    ) -> tuple[Answer, Withdrawal | None]:
        """Read a frame; return the network's answer, and the withdrawal where one
        begins.
        """
        moment = OpenedMoment((MomentFrame(frame),), self._scale, at_s)
        (answer,), self._memory = self._live.read(moment, self._memory)
        event = FrameRead(
            at_s=at_s,
            frame_id=number,
            verdict=answer.verdict,
            size=frame.shape[:2],
            scale_m=(self._scale.lateral_m, self._scale.depth_m),
            shown_back=shown_back,
        )
        withdrawal = self._hear([event], at_s)
        opinion = None

        if number % self._opinion_every == 0:
            opinion = self._reader.read(frame, self._scale, self.setup)
            due_s = at_s + OPINION_AFTER_S
            self._pending.append(
                SecondOpinion(at_s=due_s, frame_id=number, verdict=opinion.verdict)
            )

        if self._learner:
            self._learn(
                self._learner, answer.usable and shown_back == 0, opinion, at_s, number
            )

        return answer, withdrawal

    def _learn(
        self,
        learner: EyeLearner,
        usable: bool,
        opinion: Answer | None,
        at_s: float,
        number: int,
    ) -> None:
        """Tell the learner of a frame, as the service does; read later frames with the
        E that it has learned.
        """
        assert self._decision is not None
        pierced = Cause.PIERCED in (self._decision.cause, self._decision.present_cause)
        teaches = usable and self._decision.state is State.WATCHING
        asked = OpinionAsked(
            number=number, order=number, at_s=at_s, teaches=teaches, pierced=pierced
        )
        learner.hear(asked)

        if opinion:
            learner.show(asked, opinion, self._scale)

        if learned := learner.learned(at_s):
            adopted = self._live.with_eye(learned.setup.eye)
            if adopted is self._live:
                return
            self._live = adopted
            self.setup = learned.setup
            stiffness_n_m = self._reader.steepest_n_m(learned.setup)
            if stiffness_n_m is not None:
                self.limits = replace(self.limits, stiffness_n_m=stiffness_n_m)

    def _hear(self, events: list[MonitorEvent], at_s: float) -> Withdrawal | None:
        """Decide on the opinions that have come, then on these events, then on a reset
        where one is due.
        """
        due = [opinion for opinion in self._pending if opinion.at_s <= at_s]
        self._pending = self._pending[len(due) :]
        if self.code == WITHDRAW and at_s - self._asked_s >= RESET_AFTER_S:
            events = [*events, Reset(at_s)]
            self._asked_s = at_s

        begun = [self._decide(event) for event in [*due, *events]]
        return next((withdrawal for withdrawal in begun if withdrawal), None)

    def _decide(self, event: MonitorEvent) -> Withdrawal | None:
        before = self.code
        self._state, decision = decide(self._state, event, self.limits)
        self._decision = decision
        self.released += before == WITHDRAW != decision.code and not isinstance(
            event, Reset
        )

        if decision.code != WITHDRAW or before == WITHDRAW:
            return None

        self._asked_s = event.at_s
        return Withdrawal(
            event.at_s, decision.cause.name if decision.cause else "?", decision.message
        )
