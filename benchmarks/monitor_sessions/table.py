"""Results of the sessions as Markdown tables: ramps, sessions below the highest force,
and differences.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from statistics import median

import numpy as np

from monitor_sessions.declarations import DECLARATIONS
from monitor_sessions.eyes import KINDS
from monitor_sessions.play import Outcome, Ramp
from scleraforce.base.units import from_si

BOUND_N = 30e-3
REFERENCE = "declared"
Found = Mapping[str, Mapping[str, Outcome]]  # kind -> declaration


def ramp_table(found: Found) -> str:
    """Return, for each kind of eyes and declaration, the ramps stopped in time and
    their true force.
    """
    rates = sorted(
        {
            ramp.rate_n_s
            for of in found.values()
            for one in of.values()
            for ramp in one.ramps
        }
    )
    head = [
        "eyes",
        "globe",
        "stopped below 30 mN",
        *(f"at {from_si(rate, 'mn'):g} mN/s" for rate in rates),
        "earlier than declared, mN",
        "causes",
    ]
    rows = [
        [
            words,
            DECLARATIONS[name],
            f"{sum(_in_time(ramp) for ramp in outcome.ramps)} of {len(outcome.ramps)}",
            *(
                _spread(
                    [ramp.force_n for ramp in outcome.ramps if ramp.rate_n_s == rate]
                )
                for rate in rates
            ),
            _earlier(outcome.ramps, of[REFERENCE].ramps),
            ", ".join(
                f"{count} {cause}"
                for cause, count in Counter(_causes(outcome.ramps)).most_common()
            ),
        ]
        for words, of in _by_words(found)
        for name, outcome in of.items()
    ]

    return _markdown(head, rows)


def session_table(found: Found) -> str:
    """Return, for each kind of eyes and declaration, the withdrawals from harmless
    sessions.
    """
    head = [
        "eyes",
        "globe",
        "frames",
        "answered OK",
        "withdrawals",
        "at a true force of, mN",
        "read off by, mN",
        "90 % intervals hold, from 1 mN on",
    ]
    rows = [
        [
            words,
            DECLARATIONS[name],
            f"{outcome.frames:,}",
            _share(outcome.ok, outcome.frames),
            str(len(outcome.withdrawn_n)),
            _spread(outcome.withdrawn_n),
            _off(outcome.errors_n),
            _share(outcome.inside, outcome.touching),
        ]
        for words, of in _by_words(found)
        for name, outcome in of.items()
        if outcome.frames
    ]

    return _markdown(head, rows)


def _by_words(found: Found) -> list[tuple[str, Mapping[str, Outcome]]]:
    return [(KINDS[kind].words, of) for kind, of in found.items()]


def _in_time(ramp: Ramp) -> bool:
    return ramp.force_n is not None and ramp.force_n < BOUND_N


def _causes(ramps: Sequence[Ramp]) -> list[str]:
    return [f"`{ramp.cause}`" if ramp.cause else "never" for ramp in ramps]


def _earlier(ramps: Sequence[Ramp], told: Sequence[Ramp]) -> str:
    """Return the median and largest difference in mN by which ramps were stopped
    earlier than with a declared globe.
    """
    if ramps is told:
        return ""

    same = {(ramp.eye, ramp.rate_n_s): ramp.force_n for ramp in told}
    pairs = [(same[ramp.eye, ramp.rate_n_s], ramp.force_n) for ramp in ramps]
    return _of_spread(
        [first - own for first, own in pairs if first is not None and own is not None],
        [median, max],
    )


def _spread(forces_n: Sequence[float | None]) -> str:
    """Return least, median and largest of the forces, mN."""
    return _of_spread(
        [force_n for force_n in forces_n if force_n is not None], [min, median, max]
    )


def _of_spread(
    forces_n: Sequence[float], by: Sequence[Callable[[Sequence[float]], float]]
) -> str:
    return (
        " / ".join(f"{from_si(each(forces_n), 'mn'):.1f}" for each in by)
        if forces_n
        else "-"
    )


def _off(errors_n: Sequence[float]) -> str:
    """Return mean and standard deviation of errors, mN."""
    if not errors_n:
        return "-"
    off_mn = np.array([from_si(error_n, "mn") for error_n in errors_n])
    return f"{off_mn.mean():+.2f} ± {off_mn.std():.2f}"


def _share(hits: int, total: int) -> str:
    return f"{100.0 * hits / total:.1f} %" if total else "-"


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
