"""A line beside generated figures: what made them, from which commit, and when.

*Made by `make figures` on commit `9eebcdd` of 22 November 2026.*
"""

import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

ROOT = Path(__file__).parents[2]
LINE = re.compile(
    r"\*Made by `(?P<made_by>[^`]+)` on commit `(?P<commit>\w+)`(?P<changed> with"
    r" changes)? of "
    r"(?P<day>\d+ \w+ \d{4})\.\*"
)


@dataclass(frozen=True, kw_only=True)
class Stamp:
    """Origin of figures.

    Attributes:
        made_by: the command.
        commit: short, of the code that ran; `changed` if files differed from it.

        day: of the run, like "22 November 2026".
    """

    made_by: str
    commit: str
    changed: bool
    day: str

    def __str__(self) -> str:
        """Return the line."""
        changed = " with changes" if self.changed else ""
        return (
            f"*Made by `{self.made_by}` on commit `{self.commit}`{changed} of"
            f" {self.day}.*"
        )


def new_stamp(made_by: str) -> Stamp:
    """Return the stamp of figures that a command makes now, with today's code."""
    commit = _git("rev-parse", "--short", "HEAD") or "unknown"
    changed = bool(_git("status", "--porcelain", "--untracked-files=no"))
    today = date.today()
    return Stamp(
        made_by=made_by,
        commit=commit,
        changed=changed,
        day=f"{today.day} {today:%B %Y}",
    )


def read_stamps(page: Path) -> Iterator[Stamp]:
    """Yield the stamps of a page."""
    for found in LINE.finditer(page.read_text(encoding="utf-8")):
        made_by, commit, day = found.group("made_by", "commit", "day")
        yield Stamp(
            made_by=made_by, commit=commit, changed=bool(found["changed"]), day=day
        )


def _git(*words: str) -> str:
    done = subprocess.run(
        ["git", *words], cwd=ROOT, capture_output=True, text=True, check=False
    )
    return done.stdout.strip()
