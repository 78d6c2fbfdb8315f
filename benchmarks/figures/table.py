"""The tables of the figures, as Markdown and as JSON."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite, nan
from typing import Any

from figures.groups import GROUPS
from figures.readings import Method
from figures.scores import Scores
from scleraforce.reader.metrics import Proportion

__all__ = ["GroupResult", "ModulusErrors", "as_json", "as_markdown"]


@dataclass(frozen=True)
class ModulusErrors:
    """Relative errors of the eyes' calibrated E after a number of frames; `diverged` eyes are not among them."""

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
    """All that was found on a group of eyes.

    `deep` of its frames leave the window, the force log puts `mislabelled` into another class than the truth, and
    the load path of `capped` of its eyes ends before the largest force.
    """

    group: str
    eyes: int
    frames: int
    deep: int
    mislabelled: int
    capped: int
    scores: Mapping[Method, Scores]
    moduli: Sequence[ModulusErrors]


COLUMNS = (
    "class accuracy, all frames",
    "usable frames",
    "the same by the force log",
    "class 2 read as 0",
    "over 35 mN, read as below 30",
    "recall of class 2",
    "unusable, of those in the window",
    "force error, mN",
    "90 % intervals that hold",
    "the same for other eyes",
    "median width, mN",
    "width that would do, over it",
)
ASKED_MODULUS = "after 5 frames within 3 %, plain eyes"


def as_markdown(results: Sequence[GroupResult]) -> str:
    """Return the tables."""
    return "\n\n".join(["\n".join(_group(result)) for result in results] + ["\n".join(_moduli(results))]) + "\n"


def _group(result: GroupResult) -> list[str]:
    words = GROUPS[result.group].words
    title = f"**{result.group.capitalize()} eyes** ({words}): {result.eyes} eyes, {result.frames} frames"
    title += f"; in {result.deep} the dent leaves the window, and {result.mislabelled} are in another class by the log"
    if result.capped:
        title += f"; {result.capped} eyes are pushed with less than 60 mN, as far as their path goes"
    rows = [[method.title, *_cells(scores)] for method, scores in result.scores.items()]
    return [f"{title}.", "", *_table(["", *COLUMNS], [["asked for", *_asked(result.group)], *rows])]


def _asked(group: str) -> list[str]:
    """Return what is asked of a group, by column."""
    percent, error_mn = GROUPS[group].accuracy_percent, GROUPS[group].error_mn
    asked = {
        "class accuracy, all frames": "" if percent is None else f"{percent} % or more",
        "class 2 read as 0": "0",
        "over 35 mN, read as below 30": "0",
        "force error, mN": "" if error_mn is None else f"{error_mn:g} or less",
        "the same for other eyes": "90 % among them",
        "width that would do, over it": "0.5 to 2",
    }
    return [asked.get(column, "") for column in COLUMNS]


def _cells(scores: Scores) -> list[str]:
    return [
        _counted(scores.accuracy),
        _counted(scores.usable_accuracy),
        f"{_percent(scores.log_accuracy)}, {_percent(scores.log_usable_accuracy)}",
        str(scores.as_harmless),
        f"{scores.as_safe.hits} of {scores.as_safe.total}",
        _counted(scores.recall),
        _counted(scores.unusable) + (f"; whole eyes: {scores.refused_eyes}" if scores.refused_eyes else ""),
        f"{scores.mae_mn:.2f}" if isfinite(scores.mae_mn) else "-",
        _counted(scores.coverage),
        "-"
        if scores.coverage_band is None
        else "{:.0f} to {:.0f} %".format(*(100 * end for end in scores.coverage_band)),
        f"{scores.width_mn:.2f}" if isfinite(scores.width_mn) else "-",
        f"{scores.stretch:.2f}" if isfinite(scores.stretch) else "-",
    ]


def _moduli(results: Sequence[GroupResult]) -> list[str]:
    rows = [["asked for", "", ASKED_MODULUS, "", ""]]
    for result in results:
        for errors in result.moduli:
            found = [f"{100 * error:.1f} %" if isfinite(error) else "-" for error in (errors.mean, errors.largest)]
            rows.append([result.group, str(errors.frames), *found, str(errors.diverged)])
    return _table(["E of the eyes", "frames", "mean error", "largest", "diverged"], rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    rule = ["---"] * len(head)
    return [f"| {' | '.join(cells)} |" for cells in (head, rule, *rows)]


def _band(ends: tuple[float, float] | None) -> str:
    return "-" if ends is None else f"{100 * ends[0]:.0f} to {100 * ends[1]:.0f} %"


def _counted(share: Proportion) -> str:
    return f"{_percent(share)} ({share.hits} of {share.total})" if share.total else "-"


def _percent(share: Proportion) -> str:
    return f"{100 * share.value:.1f} %" if share.total else "-"


def as_json(results: Sequence[GroupResult]) -> dict[str, Any]:
    """Return the same as plain values."""
    return {result.group: _plain_values(result) for result in results}


def _plain_values(result: GroupResult) -> dict[str, Any]:
    return {
        "eyes": result.eyes,
        "frames": result.frames,
        "leaves_the_window": result.deep,
        "mislabelled": result.mislabelled,
        "capped_eyes": result.capped,
        "methods": {method.name: _of_scores(scores) for method, scores in result.scores.items()},
        "youngs_modulus_errors": [
            {**asdict(errors), "mean": _finite(errors.mean), "largest": _finite(errors.largest)}
            for errors in result.moduli
        ],
    }


def _of_scores(scores: Scores) -> dict[str, Any]:
    """Return scores as plain values: shares with their counts, what is not defined as None."""
    values: dict[str, Any] = {}
    for name, value in vars(scores).items():
        match value:
            case Proportion():
                values[name] = {"share": value.value if value.total else None, "hits": value.hits, "of": value.total}
            case float():
                values[name] = _finite(value)
            case _:
                values[name] = value
    return values


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
