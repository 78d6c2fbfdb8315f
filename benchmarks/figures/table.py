"""The tables of the figures, as Markdown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan

from figures.groups import GROUPS
from figures.readings import Method
from figures.scores import Scores
from markdown_tables import lines
from scleraforce.calibration.answer_metrics import Proportion


@dataclass(frozen=True)
class ModulusErrors:
    """Relative errors of the eyes' calibrated E after a number of frames; `diverged`
    eyes are not among them.
    """

    frames: int
    errors: tuple[float, ...]
    diverged: int

    @property
    def mean(self) -> float:
        """Mean absolute error."""
        return sum(map(abs, self.errors)) / len(self.errors) if self.errors else nan

    @property
    def largest(self) -> float:
        """Largest absolute error."""
        return max(map(abs, self.errors), default=nan)


@dataclass(frozen=True)
class GroupResult:
    """All that was found on a group of eyes."""

    group: str
    eyes: int
    frames: int
    scores: Mapping[Method, Scores]
    moduli: Sequence[ModulusErrors]


COLUMNS = (
    "eyes, frames",
    "right class, %",
    "class 2 read as 0",
    "above 35 mN read below 30",
    "not usable, %",
    "force error, mN",
    "intervals hold, %",
    "other eyes, %",
    "median width, mN",
    "factor",
)


def as_markdown(results: Sequence[GroupResult]) -> str:
    """Return one table for each method, a row a group, the first with the goals; and
    one of the errors of E.
    """
    titles = dict.fromkeys(
        method.title for result in results for method in result.scores
    )
    tables = [
        "\n".join(
            [
                f"**{title[0].upper()}{title[1:]}**",
                "",
                *_method(results, title, goals=number == 0),
            ]
        )
        for number, title in enumerate(titles)
    ]

    return "\n\n".join([*tables, "\n".join(_moduli(results))]) + "\n"


def _method(results: Sequence[GroupResult], title: str, *, goals: bool) -> list[str]:
    """Return the table of a method, without the columns that it has no figures for."""
    found = (
        (result, scores)
        for result in results
        for method, scores in result.scores.items()
        if method.title == title
    )
    rows = [
        [result.group, *_cells(result, scores, goals=goals)] for result, scores in found
    ]
    columns = [
        cells
        for cells in zip(["", *COLUMNS], *rows, strict=True)
        if set(cells[1:]) != {"-"}
    ]
    head, *rows = map(list, zip(*columns, strict=True))

    return list(lines(head, rows))


def _cells(result: GroupResult, scores: Scores, *, goals: bool) -> list[str]:
    goal = GROUPS[result.group]
    percent, error_mn = (
        (goal.accuracy_percent, goal.error_mn) if goals else (None, None)
    )

    return [
        f"{result.eyes}, {result.frames}" if goals else "-",
        _percent(scores.accuracy) + ("" if percent is None else f" (goal {percent})"),
        str(scores.as_harmless),
        f"{scores.as_safe.hits} of {scores.as_safe.total}",
        _percent(scores.unusable)
        + (f", {scores.refused_eyes} whole eyes" if scores.refused_eyes else ""),
        _fixed(scores.mae_mn) + ("" if error_mn is None else f" (goal {error_mn:g})"),
        _percent(scores.coverage),
        (
            "-"
            if scores.coverage_band is None
            else "{:.0f} to {:.0f}".format(*(100 * end for end in scores.coverage_band))
        ),
        _fixed(scores.width_mn),
        _fixed(scores.stretch),
    ]


def _moduli(results: Sequence[GroupResult]) -> list[str]:
    rows = [
        [
            result.group,
            str(errors.frames),
            *(_fixed(100 * e, 1) for e in (errors.mean, errors.largest)),
            str(errors.diverged),
        ]
        for result in results
        for errors in result.moduli
    ]
    head = ["error of E", "frames", "mean, %", "largest, %", "diverged"]
    return list(lines(head, rows))


def _percent(share: Proportion) -> str:
    return f"{100 * share.value:.1f}" if share.total else "-"


def _fixed(value: float, digits: int = 2) -> str:
    return f"{value:.{digits}f}" if isfinite(value) else "-"
