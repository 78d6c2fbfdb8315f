"""Answers to frames, as an evaluation has them."""

from dataclasses import replace
from typing import Any

from scleraforce.reader.evaluate import FrameAnswer

__all__ = ["frame_answer", "refused_frame"]

RIGHT = FrameAnswer(
    recording="rec", eye="eye", file="0000.png", measured_force_n=0.020, target=1, predicted=1,
    probabilities=(0.0, 1.0, 0.0), usable=True,
)  # fmt: skip


def frame_answer(**said: Any) -> FrameAnswer:
    """The answer to a frame, 20 mN that is read as class 1, but for what is said: its attributes."""
    return replace(RIGHT, **said)


def refused_frame(**said: Any) -> FrameAnswer:
    """The answer to a frame that cannot be judged, of the highest class, but for what is said."""
    return frame_answer(**{"predicted": 2, "probabilities": None, "usable": False, **said})
