"""One monitor without sockets: network, second opinion and decision, on frames that are handed to it."""

from dataclasses import dataclass

from monitor_sessions.forces import FRAME_S
from monitor_sessions.frames import Frame
from scleraforce.known import Known
from scleraforce.monitor import Decision, MonitorLimits, MonitorState, decide
from scleraforce.monitor.events import FrameRead, MonitorEvent, QueueLoss, Reset, SecondOpinion
from scleraforce.reader.answer import Answer
from scleraforce.reader.kinds import ForceReader
from scleraforce.reader.model import LiveReader
from scleraforce.recording.pixels import PixelScale

OPINION_EVERY, OPINION_AFTER_S = 3, 0.025  # frames; the fit takes so long on a busy machine, and skips what comes then
RESET_AFTER_S = 1.0
WITHDRAW = 3


@dataclass(frozen=True)
class Withdrawal:
    """Time of a withdrawal, s, and its cause."""

    at_s: float
    cause: str
    message: str


class Watch:
    """A monitor with one declaration of an eye."""

    def __init__(self, reader: ForceReader, known: Known, limits: MonitorLimits) -> None:
        self._reader, self._known, self._limits = reader, known, limits
        self._scale = PixelScale.of(reader.study.oct)
        self._live = LiveReader(reader, known, 1.0)
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
        return self._hear([QueueLoss(at_s=at_s, lost=1, unread_s=FRAME_S, row=round(at_s / FRAME_S))], at_s)

    def read(self, frame: Frame, at_s: float, number: int, shown_back: int) -> tuple[Answer, Withdrawal | None]:
        """Read a frame; return the network's answer, and the withdrawal where one begins."""
        answer = self._live.read(frame, self._scale)
        event = FrameRead(
            at_s=at_s,
            frame_id=number,
            verdict=answer.verdict,
            size=frame.shape[:2],
            scale_m=(self._scale.lateral_m, self._scale.depth_m),
            shown_back=shown_back,
        )
        if number % OPINION_EVERY == 0:
            opinion = self._reader.read(frame, self._scale, self._known).verdict
            self._pending.append(SecondOpinion(at_s=at_s + OPINION_AFTER_S, frame_id=number, verdict=opinion))
        return answer, self._hear([event], at_s)

    def _hear(self, events: list[MonitorEvent], at_s: float) -> Withdrawal | None:
        """Decide on the opinions that have come, then on these events, then on a reset where one is due."""
        due = [opinion for opinion in self._pending if opinion.at_s <= at_s]
        self._pending = self._pending[len(due) :]
        if self.code == WITHDRAW and at_s - self._asked_s >= RESET_AFTER_S:
            events = [*events, Reset(at_s)]
            self._asked_s = at_s
        begun = [self._decide(event) for event in [*due, *events]]
        return next((withdrawal for withdrawal in begun if withdrawal), None)

    def _decide(self, event: MonitorEvent) -> Withdrawal | None:
        before = self.code
        self._state, decision = decide(self._state, event, self._limits)
        self._decision = decision
        if decision.code != WITHDRAW or before == WITHDRAW:
            return None
        self._asked_s = event.at_s
        return Withdrawal(event.at_s, decision.cause.name if decision.cause else "?", decision.message)
