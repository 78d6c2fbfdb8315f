"""A line beside generated figures: what made them, from which commit, when, and a hash of the deciding sources.

*Made by `make figures` on commit `9eebcdd` of 22 November 2026; sources of `figures.__main__`: `8a8c2e7ff1e4`.*
"""

import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from scleraforce.source_hash import hash_sources

__all__ = ["ROOT", "Stamp", "new_stamp", "read_stamps"]

ROOT = Path(__file__).parents[2]
PACKAGES = {path.name: path for path in (ROOT / "benchmarks").iterdir() if (path / "__init__.py").exists()}
DIGITS = 12  # of the hash, that are shown
LINE = re.compile(
    r"\*Made by `(?P<made_by>[^`]+)` on commit `(?P<commit>\w+)`(?P<changed> with changes)? of (?P<day>\d+ \w+ \d{4}); "
    r"sources of (?P<modules>`[\w.]+`(?:, `[\w.]+`)*): `(?P<sources>[0-9a-f]{12})`\.\*"
)


@dataclass(frozen=True, kw_only=True)
class Stamp:
    """Where figures are from.

    Attributes:
        made_by: the command.
        commit: short, of the code that ran; `changed` says that files differed from it.
        day: of the run, like "22 November 2026".
        modules: full names; their sources, and those of all that they import, decide the figures.
        sources: first digits of the hash of these.
    """

    made_by: str
    commit: str
    changed: bool
    day: str
    modules: tuple[str, ...]
    sources: str

    def __str__(self) -> str:
        """Return the line."""
        changed = " with changes" if self.changed else ""
        modules = ", ".join(f"`{module}`" for module in self.modules)
        return (
            f"*Made by `{self.made_by}` on commit `{self.commit}`{changed} of {self.day}; "
            f"sources of {modules}: `{self.sources}`.*"
        )

    @property
    def current(self) -> bool:
        """Whether the sources are still those that made the figures; False where a module has gone."""
        try:
            return _sources(self.modules) == self.sources
        except ValueError:
            return False


def new_stamp(made_by: str, *modules: str) -> Stamp:
    """Return the stamp of figures that a command makes now, with the code as it is."""
    commit = _git("rev-parse", "--short", "HEAD") or "unknown"
    changed = bool(_git("status", "--porcelain", "--untracked-files=no"))
    today = date.today()
    return Stamp(
        made_by=made_by,
        commit=commit,
        changed=changed,
        day=f"{today.day} {today:%B %Y}",
        modules=modules,
        sources=_sources(modules),
    )


def read_stamps(page: Path) -> Iterator[Stamp]:
    """Yield the stamps of a page."""
    for found in LINE.finditer(page.read_text(encoding="utf-8")):
        modules = tuple(name.strip("`") for name in found["modules"].split(", "))
        yield Stamp(
            made_by=found["made_by"],
            commit=found["commit"],
            changed=bool(found["changed"]),
            day=found["day"],
            modules=modules,
            sources=found["sources"],
        )


def _sources(modules: tuple[str, ...]) -> str:
    return hash_sources(*modules, packages=PACKAGES)[:DIGITS]


def _git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip()
