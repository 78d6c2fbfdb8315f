"""Why the robot must withdraw, in a sentence for the operator."""

import re

SENTENCES = {
    "SILENCE": "No frame came from the scanner for too long.",
    "CHECKSUM": "A message arrived damaged: its checksum is wrong.",
    "DANGEROUS_CLASS": "The force is in the dangerous class.",
    "BOUND": "The force may have reached the bound.",
    "RISING": "The force rises so fast that the bound would be reached before the robot reacts.",
    "UNUSABLE": "The frame cannot be judged while the needle touches the eye.",
    "FROZEN": "The scanner sends old pictures again.",
    "OUT_OF_ORDER": "Frames or times came out of order.",
    "SIZE": "A frame has another size than the model was made for.",
    "SCALE": "A frame has pixels of another size than the model was made for.",
    "NO_NUMBER": "A reading is not a number, or contradicts itself.",
    "QUEUE_BEHIND": "Frames come faster than they can be read: too many were lost.",
    "BAD_IMAGE": "The scanner sent something that is not an image.",
    "EXCEPTION": "A part of the monitor failed.",
    "NO_OPINION": "The second reader has not answered for too long.",
    "STALE": "Frames arrive too long after they were taken.",
    "PIXEL_TYPE": "The scanner has changed the type of its pixels.",
    "WATCHDOG": "The monitor hung or died, and the watchdog ended it.",
}

READING = re.compile(r"; class \d+(; -?[\d.]+ mN)?(; .*)?$", re.DOTALL)


def sentence_of(cause: str) -> str:
    """Return the sentence of a cause, by its name."""
    return SENTENCES.get(cause, f"Cause: {cause}.")


def detail_of(message: str, state: str) -> str:
    """Return the reason within a decision's message: without the state before it and the last reading after it.

    >>> detail_of("WITHDRAW: up to 31.2 mN, the bound is 30.0 mN; class 1; 28.9 mN", "WITHDRAW")
    'up to 31.2 mN, the bound is 30.0 mN'
    >>> detail_of("WATCHING: class 0; 2.1 mN", "WATCHING")
    ''
    """
    reason = message.removeprefix(state).removeprefix(": ")
    if state == "WATCHING":  # there need not be a reason
        reason = f"; {reason}"
    return READING.sub("", reason).removeprefix("; ")
