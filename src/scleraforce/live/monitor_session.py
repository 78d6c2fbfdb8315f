"""One session of the monitor without its connections: frames and events in, decisions
out; deferred frames.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import inf
from statistics import median_low
from time import monotonic, time
from typing import Any

from scleraforce.base.units import from_si
from scleraforce.live.companions.process_messages import Entry
from scleraforce.live.decision import events
from scleraforce.live.decision.decide import PlanesState, decide, decide_planes
from scleraforce.live.decision.events import Cause, FrameRead, MonitorEvent, State
from scleraforce.live.decision.limits import MonitorLimits, of_scale
from scleraforce.live.decision.state import MonitorState
from scleraforce.live.network.scanner_frame import ScannerFrame
from scleraforce.live.repeated_pictures import ShownPictures
from scleraforce.reading.answer import Answer, unusable_answer
from scleraforce.reading.eye_reader import EyeReader, Memory, MomentFrame, OpenedMoment
from scleraforce.records.eye import Eye
from scleraforce.records.frame import Pixels
from scleraforce.records.verdict import Verdict

# maximum number of waiting frames: those of 0.1 s at 1000 a second, 52 MB of 512 x 512
# pixels
MOST_FRAMES = 100
FIRST_INTERVAL_S = 0.01  # until frames show another
LEAST_SENT_S = 0.001  # between two headers: they may count in anything
# a flood hardly counts in their mean
KNOWN_FRAMES = 1000
ENOUGH_FRAMES = 10
SETTLED_FRAMES = 100  # a pause at the start hardly counts in their mean
# pictures ago: a picture that another plane has shown is never the one before
OTHER_PLANE = 2


class FramePace:
    """The interval of a scanner: the mean over its last frames, in which a pause counts
    up to `most_s`.

    The first frames may come in bunches or after a pause: until `SETTLED_FRAMES` have
    come, the interval is the median of the gaps between the times in their headers, if
    they have any.
    """

    def __init__(self, most_s: float) -> None:
        self._most_s = most_s
        self._gaps_s: deque[float] = deque(maxlen=KNOWN_FRAMES)
        self._last_s: float | None = None
        self._sent_gaps_s = [FIRST_INTERVAL_S]
        self._last_sent_s: float | None = None

    def arrived(self, at_s: float, sent_s: float | None = None) -> float:
        """Take the times of a frame, its completion's and its header's; return the
        interval.
        """
        if len(self._gaps_s) < SETTLED_FRAMES:
            if (
                sent_s is not None
                and self._last_sent_s is not None
                and sent_s > self._last_sent_s
            ):
                self._sent_gaps_s.append(
                    min(max(sent_s - self._last_sent_s, LEAST_SENT_S), self._most_s)
                )

            self._last_sent_s = sent_s

        enough = len(self._gaps_s) >= (
            ENOUGH_FRAMES if len(self._sent_gaps_s) == 1 else SETTLED_FRAMES
        )
        interval_s = (
            sum(self._gaps_s) / len(self._gaps_s)
            if enough
            else median_low(self._sent_gaps_s)
        )

        if self._last_s is not None:
            self._gaps_s.append(min(max(at_s - self._last_s, 0.0), self._most_s))

        self._last_s = at_s
        return interval_s


@dataclass(frozen=True, eq=False, kw_only=True)
class ReceivedFrame:
    """A received frame: its `number` in this session, the sender's `sender_id`, and its
    record for the decision.

    `misfit`: its size, scale, pixel type or order is wrong, known before it is read;
    such a frame is never skipped. `interval_s`: the time that it stands for, the
    scanner's mean interval. `unread` has the time of its last byte, a `frame_id` that
    rises with `sender_id` and keeps rising where another sender starts to count anew,
    and the verdict on a frame of another size, and its plane. `memory`: what the
    reader of its plane remembered before this frame and the frames that came with it.
    """

    number: int
    sender_id: int
    interval_s: float
    image: ScannerFrame
    misfit: bool
    unread: FrameRead
    memory: Memory

    @property
    def plane(self) -> str | None:
        """The name of its plane; None of the only one."""
        return self.unread.plane


class DeferredFrames:
    """A queue of deferred frames: none waits longer than `most_s`, and no bunch stands
    for more than that.

    A bunch lasts as long as its frames stand for, however quickly they are read. The
    queue holds at most `most` frames of one plane, however short the time is that they
    stand for.
    """

    def __init__(self, most_s: float, most: int = MOST_FRAMES) -> None:
        self._most_s = most_s
        self._most = most
        self._waiting: deque[tuple[ReceivedFrame, int]] = deque()
        self._bunch_s = 0.0
        self._last_s = float("-inf")

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, frame: ReceivedFrame, row: int) -> None:
        """Enqueue a frame; the frame of number `row` overtook it."""
        self._waiting.append((frame, row))
        self._bunch_s = (
            max(0.0, self._bunch_s - (frame.unread.at_s - self._last_s))
            + frame.interval_s
        )
        self._last_s = frame.unread.at_s

    @property
    def oldest(self) -> int:
        """Number of the frame that has waited longest."""
        return self._waiting[0][0].number

    def take(self) -> ReceivedFrame:
        """Dequeue the frame that has waited longest."""
        return self._waiting.popleft()[0]

    def lose(self, now_s: float) -> list[events.QueueLoss]:
        """Drop the frames beyond the limits, oldest first; return the loss of each
        row.
        """
        rows: dict[int, tuple[int, float]] = {}
        while self._waiting and self._too_much(now_s):
            frame, row = self._waiting.popleft()
            lost, unread_s = rows.get(row, (0, 0.0))
            rows[row] = lost + 1, unread_s + frame.interval_s
            self._bunch_s = max(0.0, self._bunch_s - frame.interval_s)

        each = rows.items()
        return [
            events.QueueLoss(at_s=now_s, lost=lost, unread_s=unread_s, row=row)
            for row, (lost, unread_s) in each
        ]

    def _too_much(self, now_s: float) -> bool:
        late = now_s - self._waiting[0][0].unread.at_s > self._most_s
        return (
            late
            or self._bunch_s > self._most_s + events.SLACK_S
            or len(self._waiting) > self._most
        )


class _Stream:
    """The frames of one plane, their reader, and all that compares a frame with those
    before it.
    """

    def __init__(self, reader: EyeReader, limits: MonitorLimits, planes: int) -> None:
        self.reader = reader
        self.memory = reader.start(monitored=True)
        self.sender = self.offset = self.order = 0
        self.sent_type: str | None = None
        self.shown = ShownPictures(limits.shown_frames)
        self.pace = FramePace(limits.silence_s)
        self.deferred = DeferredFrames(limits.catch_up_s, MOST_FRAMES // planes)
        self.answered_s = -inf
        # number of the newest frame of the last bunch, and its frames
        self.bunch = (0, 0)


class MonitorSession:
    """The state of the monitor and its decisions; its methods never raise.

    `reader` reads frames of the size in `limits`, of several planes each plane's, by
    name; an exception in it is a cause of a withdrawal. Its memory continues through
    withdrawals and resets, on each plane by itself. `clock` is monotonic, `wall_clock`
    counts seconds since 1970. `answer` is the reading of the last frame; None if it was
    not read. `withdrawals` has frame, time, first cause and message of each, for the
    summary.
    """

    def __init__(
        self,
        reader: EyeReader | Mapping[str, EyeReader],
        limits: MonitorLimits,
        clock: Callable[[], float] = monotonic,
        wall_clock: Callable[[], float] = time,
    ) -> None:
        self.limits = limits
        self.clock = clock
        self.wall_clock = wall_clock
        self.withdrawals: list[dict[str, Any]] = []
        self._beside = dict[str, Any]()
        readers: dict[str | None, EyeReader] = (
            {None: reader} if isinstance(reader, EyeReader) else dict(reader.items())
        )
        self.planes = tuple(name for name in readers if name is not None)
        self._streams = {
            name: _Stream(one, limits, len(readers)) for name, one in readers.items()
        }
        self._of_all = (
            ShownPictures(len(readers) * limits.shown_frames) if self.planes else None
        )
        self._state: MonitorState | PlanesState = (
            PlanesState.of(self.planes) if self.planes else MonitorState()
        )
        self._moment = dict[str | None, ReceivedFrame]()
        self.frames = self._entries = 0  # since the start
        self._decide(events.Tick(clock()))
        self.answer: Answer | None = None
        self._overtaken = 0
        self._travel = (0.0, -inf)
        self._other_size = unusable_answer(
            limits.withdraw_class + 1, "another size"
        ).verdict

    @property
    def lost(self) -> int:
        """Frames since the start that newer ones overtook and that were never read."""
        return self._state.lost

    @property
    def behind(self) -> bool:
        """True while frames wait that newer ones overtook."""
        return any(stream.deferred for stream in self._streams.values())

    def take(self, event: MonitorEvent) -> bool:
        """Decide on an event; return whether the decision has changed."""
        before = self.decision
        self._decide(event)

        now = self.decision
        if now.cause and State.WITHDRAW is now.state is not before.state:
            begun = {
                "frame": self.frames,
                "time_s": self.wall_clock(),
                "cause": now.cause.name,
                "message": now.message,
            }
            self.withdrawals.append(begun)

        return now != before

    def _decide(self, event: MonitorEvent) -> None:
        state = self._state
        if isinstance(state, MonitorState):
            self._state, self.decision = decide(state, event, self.limits)
        else:
            self._state, self.decision = decide_planes(state, event, self.limits)

    @property
    def teaches(self) -> bool:
        """True if the eye may be learned from the last frame: it is usable and
        harmless, and so was all before it.
        """
        return (
            self.decision.state is State.WATCHING
            and self.answer is not None
            and self.answer.usable
        )

    @property
    def pierced(self) -> bool:
        """True while a puncture is what is wrong."""
        return Cause.PIERCED in (self.decision.cause, self.decision.present_cause)

    def learned(self, eye: Eye, frames: int) -> None:
        """Take what was learned of the eye: later frames are read with it, and
        punctures are found by its stiffness.
        """
        for stream in self._streams.values():
            adopted = stream.reader.with_eye(eye)
            if adopted is stream.reader:
                continue
            stream.reader = adopted
            stiffness_n_m = adopted.model.steepest_n_m(adopted.setup)
            if stiffness_n_m is not None:
                self.limits = replace(self.limits, stiffness_n_m=stiffness_n_m)

        if eye.modulus is not None:
            mean_mpa = from_si(eye.modulus.mean_pa, "mpa")
            sd_mpa = from_si(eye.modulus.sd_pa, "mpa")
            self._beside |= {
                "modulus_mpa": mean_mpa,
                "modulus_sd_mpa": sd_mpa,
                "modulus_frames": frames,
            }

    def read_together(
        self, verdict: Verdict, contact_m: tuple[float, ...] | None
    ) -> None:
        """Take what all planes of a moment show together: the force, and the contact in
        three dimensions.
        """
        interval_n = verdict.interval_n
        self._beside |= {
            "planes_force_mn": from_si(verdict.force_n, "mn"),
            "planes_interval_mn": (
                interval_n and tuple(from_si(end_n, "mn") for end_n in interval_n)
            ),
            "contact_xyz_mm": (
                contact_m and tuple(from_si(place_m, "mm") for place_m in contact_m)
            ),
        }

    def travelled(self, travel_m: float, at_s: float) -> None:
        """Take the needle's travel along its axis at a time: frames until the next one
        have it.
        """
        self._travel = travel_m, at_s

    def frame(
        self,
        image: ScannerFrame,
        sender_id: int,
        sender: int,
        at_s: float,
        sent_s: float | None = None,
        plane: str | None = None,
    ) -> ReceivedFrame:
        """Number a frame that was complete at `at_s`, from connection number `sender`;
        its header states `sent_s`.
        """
        self.frames += 1
        stream = self._streams[plane]
        if sender != stream.sender:
            stream.offset = stream.order + 1 - sender_id if stream.sender else 0
            stream.sender = sender

        order = stream.offset + sender_id
        misfit = order <= stream.order or not self._fits(image, stream.sent_type)
        stream.order = order
        stream.sent_type = image.sent_type
        age_s = at_s - self._travel[1]
        is_fresh = 0.0 <= age_s < self.limits.silence_s
        unread = FrameRead(
            at_s=at_s,
            frame_id=order,
            verdict=self._other_size,
            shown_back=self._back(stream, image.pixels),
            size=(image.pixels.shape[0], image.pixels.shape[1]),
            scale_m=(image.lateral_m, image.depth_m),
            sent_s=sent_s,
            pixel_type=image.sent_type,
            travel_m=self._travel[0] if is_fresh else None,
            travel_age_s=age_s if is_fresh else 0.0,
            plane=plane,
            taken_s=image.begun_s,
        )

        return ReceivedFrame(
            number=self.frames,
            sender_id=sender_id,
            interval_s=stream.pace.arrived(at_s, sent_s),
            image=image,
            misfit=misfit,
            unread=unread,
            memory=stream.memory,
        )

    def _back(self, stream: _Stream, pixels: Pixels) -> int:
        """Return how many pictures ago a plane has shown a picture, 0 if it is new;
        another plane's is not new.
        """
        back = stream.shown.back(pixels)
        elsewhere = self._of_all is not None and self._of_all.back(pixels) > 0
        return back or (OTHER_PLANE if elsewhere else 0)

    def moment(self, frame: ReceivedFrame) -> tuple[ReceivedFrame, ...]:
        """Return the frames of a frame's moment so far, oldest first: of one time
        stamp, or within one interval.

        Planes that a scanner takes in turns are less than an interval apart, frames of
        two moments a whole one.
        """
        within_s = (1.0 - 0.5 / len(self._streams)) * frame.interval_s
        others = {
            plane: other
            for plane, other in self._moment.items()
            if plane != frame.plane
        }
        stamped = {
            plane: other
            for plane, other in others.items()
            if other.unread.sent_s == frame.unread.sent_s
        }
        first = next(iter(others.values()), frame)
        close = (
            len(others) == len(self._moment)
            and frame.unread.at_s - first.unread.at_s < within_s
        )
        self._moment = (
            stamped
            if stamped and frame.unread.sent_s is not None
            else others
            if close
            else {}
        )
        self._moment[frame.plane] = frame

        return tuple(self._moment.values())

    def _fits(self, image: ScannerFrame, sent_type: str | None) -> bool:
        limits = self.limits
        scale_m = (image.lateral_m, image.depth_m)
        same_type = sent_type in (None, image.sent_type)
        return (
            same_type
            and image.pixels.shape == limits.size
            and of_scale(scale_m, limits.scale_m or scale_m, limits)
        )

    def take_frame(self, frame: ReceivedFrame) -> None:
        """Read a frame and decide on it."""
        self.answer = None
        self._streams[frame.plane].answered_s = frame.unread.at_s
        try:
            self.answer, read, memory = self._read_frame(frame)
        except Exception as fault:  # the frame was not read
            self.take(_failure(frame, fault, frame.unread.at_s))
        else:
            if not frame.misfit and frame.unread.shown_back == 0:  # others are gaps
                self._streams[frame.plane].memory = memory
            self.take(read)

    def defer(self, frame: ReceivedFrame, newest: ReceivedFrame) -> None:
        """Defer a frame, which `newest` overtook, until no newer one waits."""
        self._overtaken += 1
        stream = self._streams[frame.plane]
        if stream.bunch[0] != newest.number:
            stream.bunch = newest.number, newest.number - frame.number + 1

        if frame.unread.taken_s is None:
            since_s = newest.unread.at_s - stream.answered_s
            taken_s = _place_in_bunch(frame, newest, since_s, stream.bunch[1])
            unread = replace(frame.unread, taken_s=taken_s)
            frame = replace(frame, unread=unread)

        stream.deferred.add(frame, newest.number)

    def losses(self, now_s: float) -> list[events.QueueLoss]:
        """Return the events of the deferred frames that are lost by now."""
        each = self._streams.items()
        return [
            replace(loss, plane=plane)
            for plane, stream in each
            for loss in stream.deferred.lose(now_s)
        ]

    def catch_up(self) -> MonitorEvent:
        """Read the deferred frame that has waited longest; return the event to decide
        on.
        """
        waiting = [
            stream.deferred for stream in self._streams.values() if stream.deferred
        ]
        frame = min(waiting, key=lambda deferred: deferred.oldest).take()

        try:
            _, read, _ = self._read_frame(frame)
        except Exception as fault:
            return _failure(frame, fault, self.clock())

        return events.OvertakenRead(self.clock(), read)

    def _read_frame(
        self, frame: ReceivedFrame
    ) -> tuple[Answer | None, FrameRead, Memory]:
        """Read a frame if it has the study's size; the decision handles frames of
        another size or scale.

        The memory after the frame is returned as well.
        """
        image = frame.image
        unread = frame.unread
        if unread.size != self.limits.size:
            return None, unread, frame.memory

        reader = self._streams[frame.plane].reader
        moment = OpenedMoment(
            (MomentFrame(image.pixels),),
            reader.scale_of(image.lateral_m, image.depth_m),
            unread.at_s,
        )
        (answer,), memory = reader.read(moment, frame.memory)
        # 3 µs; `replace` takes 8
        read = FrameRead(**vars(unread) | {"verdict": answer.verdict})

        return answer, read, memory

    def summary(self) -> dict[str, Any]:
        """Return a summary so far, for JSON."""
        # the end of the monitor adds one, which is not the session's
        withdrawals = [*self.withdrawals]
        return {
            "frames": self.frames,
            "overtaken": self._overtaken,
            "lost": self.lost,
            "withdrawals": withdrawals,
        }

    def entry(
        self,
        event: str,
        at_s: float,
        frame: ReceivedFrame | None = None,
        latency_s: float | None = None,
    ) -> Entry:
        """Return the last decision as a new entry, with the reading if it was made on a
        frame.

        The event "again" repeats the decision with its number, for a receiver that may
        have missed it.
        """
        self._entries += event != "again"
        answer = self.answer if frame else None
        decision = self.decision
        to_bound = (
            decision.to_bound.as_ms() if frame and decision.to_bound else (None, None)
        )

        return Entry(
            number=self._entries,
            time_s=self.wall_clock(),
            at_s=at_s,
            event=event,
            state=decision.state.name,
            code=decision.code,
            sub_code=decision.sub_code,
            cause=decision.cause.name if decision.cause else None,
            message=decision.message,
            withdrawn_s=(
                self.withdrawals[-1]["time_s"]
                if decision.state is State.WITHDRAW
                else None
            ),
            present_cause=(
                decision.present_cause.name if decision.present_cause else None
            ),
            present=decision.present,
            frame=frame.number if frame else None,
            frame_id=frame.sender_id if frame else None,
            plane=frame.plane if frame else None,
            verdict=answer.verdict if answer else None,
            latency_ms=from_si(latency_s, "ms"),
            time_to_bound_ms=to_bound[0],
            time_to_bound_ms_interval=to_bound[1],
            overtaken=self._overtaken,
            lost=self.lost,
            **self._beside,
        )


def _place_in_bunch(
    frame: ReceivedFrame, newest: ReceivedFrame, since_s: float, frames: int
) -> float:
    """Return when an overtaken frame was taken, s: before the newest of its bunch of so
    many frames, and after the one answered `since_s` before that.

    The times in the headers say it if they fit; otherwise the scanner's interval does.
    """
    sent_s = frame.unread.sent_s
    newest_sent_s = newest.unread.sent_s

    if sent_s is not None and newest_sent_s is not None:
        before_s = newest_sent_s - sent_s
        if LEAST_SENT_S <= before_s < since_s:
            return newest.unread.at_s - before_s

    interval_s = min(newest.interval_s, since_s / frames)
    return newest.unread.at_s - interval_s * (newest.number - frame.number)


def _failure(frame: ReceivedFrame, fault: Exception, at_s: float) -> MonitorEvent:
    return events.Fault(
        at_s, Cause.EXCEPTION, f"frame {frame.number}: {type(fault).__name__}: {fault}"
    )
