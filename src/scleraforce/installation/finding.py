"""One line of what was looked at."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """What was found of one thing.

    Attributes:
        name: of the thing.
        state: "missing" is what one can do without, "failed" what one cannot.
        found: in a few words.
        remedy: what to do where it is not "ok"; may be empty.
    """

    name: str
    state: Literal["ok", "missing", "failed"]
    found: str
    remedy: str = ""
