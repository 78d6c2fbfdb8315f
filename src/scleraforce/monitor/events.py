"""What the monitor can meet: frozen records that carry their time (s, of a monotonic clock that the caller reads)."""

from dataclasses import dataclass

__all__ = [
    "BadImage",
    "ChecksumError",
    "Event",
    "Failure",
    "FrameRead",
    "OvertakenRead",
    "QueueLoss",
    "Reset",
    "SecondOpinion",
    "Tick",
]


@dataclass(frozen=True)
class FrameRead:
    """A frame and what was read in it.

    `size` is (rows, columns), `scale_m` (lateral, depth) of a pixel as stored. `shown_back` says how many frames ago
    its picture was shown last, 0 that it is new. `sent_s` is the time that its sender states, by the sender's own
    clock; None where it states none.
    Where the frame is not `usable`, `reason` says why and `predicted` counts for nothing. `force_n` and its
    `interval_n` are None with a classifier.
    """

    at_s: float
    frame_id: int
    predicted: int
    probabilities: tuple[float, ...] | None
    usable: bool
    reason: str | None
    force_n: float | None
    interval_n: tuple[float, float] | None
    shown_back: int
    size: tuple[int, int]
    scale_m: tuple[float, float]
    sent_s: float | None = None


@dataclass(frozen=True)
class SecondOpinion:
    """What another method says of a frame that was read already; it comes later and can only add a doubt.

    The fields are those of `FrameRead`; `at_s` is when it came, `frame_id` the frame that it speaks of.
    """

    at_s: float
    frame_id: int
    usable: bool
    reason: str | None
    predicted: int
    probabilities: tuple[float, ...] | None
    force_n: float | None
    interval_n: tuple[float, float] | None


@dataclass(frozen=True)
class OvertakenRead:
    """What was read, after newer frames, in one of those that they overtook; it can only add a doubt."""

    at_s: float
    read: FrameRead


@dataclass(frozen=True)
class Tick:
    """Time passes."""

    at_s: float


@dataclass(frozen=True)
class ChecksumError:
    """A message came whose checksum is wrong."""

    at_s: float
    detail: str


@dataclass(frozen=True)
class Failure:
    """An exception was raised, anywhere."""

    at_s: float
    detail: str


@dataclass(frozen=True)
class QueueLoss:
    """Frames were overtaken: newer ones came before their turn, and got the answer."""

    at_s: float
    lost: int


@dataclass(frozen=True)
class BadImage:
    """A client sent an image that is none (a body too short, pixels of an unknown type)."""

    at_s: float
    detail: str


@dataclass(frozen=True)
class Reset:
    """The operator asks to leave the withdrawal."""

    at_s: float


Event = FrameRead | SecondOpinion | OvertakenRead | Tick | ChecksumError | Failure | QueueLoss | BadImage | Reset
