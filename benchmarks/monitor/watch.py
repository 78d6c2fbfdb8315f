"""One monitor without sockets: network, second opinion and decision, on frames that are
handed to it.
"""

from dataclasses import dataclass, replace

from monitor.needle_forces import FRAME_S
from monitor.pictures import Frame
from scleraforce.live.decision.decide import Decision, decide
from scleraforce.live.decision.events import (
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
from scleraforce.records.verdict import Verdict

# frames; the fit takes so long on a busy machine, and skips what comes then
OPINION_EVERY = 3
OPINION_AFTER_S = 0.025
RESET_AFTER_S = 1.0
WITHDRAW = State.WITHDRAW.value


@dataclass(frozen=True)
class Withdrawal:
    """Time of a withdrawal, s, and its cause."""

    at_s: float
    cause: str
    message: str


def limits_of(reader: ForceReader) -> MonitorLimits:
    """Return the limits of a monitor with a reader and a second opinion."""
    scanner = reader.study.oct
    scale = PixelScale.of(scanner)
    return MonitorLimits(
        bound_n=reader.study.classes.bounds_n[-1],
        size=(scanner.rows, scanner.columns),
        scale_m=(scale.lateral_m, scale.depth_m),
        expects_opinion=True,
    )


class Decisions:
    """What a monitor decides; second opinions come 25 ms later, and an operator asks
    for a reset each second of a withdrawal.

    Attributes:
        limits: of the decisions.
        last: the last decision.
        released: withdrawals that ended without a reset: none, or a claim of the
            monitor is wrong.
    """

    def __init__(self, limits: MonitorLimits) -> None:
        self.limits = limits
        self.last: Decision | None = None
        self.released = 0
        self._state = MonitorState()
        self._opinions: list[SecondOpinion] = []
        self._asked_s = 0.0

    @property
    def code(self) -> int | None:
        """The last answer to the robot."""
        return None if self.last is None else self.last.code

    def ask(self, verdict: Verdict, at_s: float, number: int) -> None:
        """Have a second opinion on a frame come later."""
        self._opinions.append(
            SecondOpinion(at_s=at_s + OPINION_AFTER_S, frame_id=number, verdict=verdict)
        )

    def hear(self, event: MonitorEvent, at_s: float) -> Withdrawal | None:
        """Decide on the opinions that have come, then on an event, then on a reset
        where one is due; return the withdrawal that begins.
        """
        due = [opinion for opinion in self._opinions if opinion.at_s <= at_s]
        self._opinions = self._opinions[len(due) :]
        events: list[MonitorEvent] = [*due, event]
        if self.code == WITHDRAW and at_s - self._asked_s >= RESET_AFTER_S:
            events.append(Reset(at_s))
            self._asked_s = at_s

        begun = [self._decide(each) for each in events]
        return next((withdrawal for withdrawal in begun if withdrawal), None)

    def _decide(self, event: MonitorEvent) -> Withdrawal | None:
        before = self.code
        self._state, decision = decide(self._state, event, self.limits)
        self.last = decision
        self.released += before == WITHDRAW != decision.code and not isinstance(
            event, Reset
        )

        if decision.code != WITHDRAW or before == WITHDRAW:
            return None

        self._asked_s = event.at_s
        return Withdrawal(
            event.at_s, decision.cause.name if decision.cause else "?", decision.message
        )


class Watch:
    """A monitor with one declaration of an eye."""

    def __init__(
        self, reader: ForceReader, setup: Setup, limits: MonitorLimits
    ) -> None:
        stiffness_n_m = reader.steepest_n_m(setup) or limits.stiffness_n_m
        self._setup = setup
        self.decisions = Decisions(replace(limits, stiffness_n_m=stiffness_n_m))
        self._reader = reader
        self._scale = PixelScale.of(reader.study.oct)
        self._live = EyeReader(reader, setup, by="network")
        self._memory = self._live.start(monitored=True)

    @property
    def code(self) -> int | None:
        """The last answer to the robot."""
        return self.decisions.code

    def lost(self, at_s: float) -> Withdrawal | None:
        """Hear that a frame was lost."""
        row = round(at_s / FRAME_S)
        loss = QueueLoss(at_s=at_s, lost=1, unread_s=FRAME_S, row=row)
        return self.decisions.hear(loss, at_s)

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
        withdrawal = self.decisions.hear(event, at_s)
        if number % OPINION_EVERY == 0:
            opinion = self._reader.read(frame, self._scale, self._setup)
            self.decisions.ask(opinion.verdict, at_s, number)

        return answer, withdrawal
