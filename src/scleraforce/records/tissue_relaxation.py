"""The relaxation of an eye's tissue, as far as it is known, and the histories that go
with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass
from math import inf
from typing import Any, Literal

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.errors import StudyError
from scleraforce.records.fields import TableForm, Unit, computed
from scleraforce.records.study_of_eye import check_relaxation

LONGEST_S = 1e6  # of a time constant or a hold, in a file
LARGEST = 1e3  # of another number in a file
TINY = 5e-324  # the smallest number above 0
Source = Literal["declared", "holds", "population"]
Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]
# who yields in the holds of a log, or why it says nothing
Cause = Literal["tissue", "needle", "both", "undecided", "steady", "no holds"]

# of each mean
MOMENTS = {
    "shares": "covariance",
    "held": "held_covariance",
    "before_n": "before_covariance_n2",
}
MOMENTS["after"] = "after_covariance_n2"
# Of tissue whose histories are not known: memory may be anything up to these, all terms
# alike.
MOST_HELD = 1.0
MOST_BEFORE_N = 15e-3
# standard deviation of such a memory over its largest value: 90 % reach from none to
# all
SPREAD = 1.0 / 3.0
ROUNDING = 1e-6  # of the largest entry: covariances are differences of large numbers


def _span(default: Any = MISSING) -> Any:
    return computed(0.0, LONGEST_S, default=default)


def _number(default: Any = MISSING) -> Any:
    return computed(-LARGEST, LARGEST, default=default)


@dataclass(frozen=True, kw_only=True)
class HoldFinding:
    """What the holds of a force log have shown of tissue and needle.

    `fall`: by which share the force falls in a hold of `hold_s`, the median one; None
    without holds. `chance`: of tissue that yields, by the log; a half where the dents
    of different pushes contradict it. `not_estimated_s` are time constants too long for
    the holds. `frames` in pairs of one hold give `tissue_share`, the tissue's part of
    that fall, with a standard deviation; the needle has the rest. None without such
    frames.
    """

    cause: Cause
    hold_s: float | None = _span(default=None)
    fall: float | None = _number(default=None)
    chance: float | None = _number(default=None)
    not_estimated_s: Vector = _number(default=())
    frames: int = computed(0, inf, default=0)
    tissue_share: float | None = _number(default=None)
    tissue_share_sd: float | None = _number(default=None)


@dataclass(frozen=True, kw_only=True)
class Relaxation:
    """The shares g_i of a Prony series (`mechanics.tissue_material`), (term,), with
    their covariance, (term, term).

    The force on the needle is F = Fe - sum g_i m_i, with the elastic force Fe, in N,
    and a memory m_i for each term. In a frame, m_i = held_i Fe + (1 - held_i) before_i:
    what this push has left, and the memory when it began. Means and covariances of
    `held` and `before_n` are those of the frames that calibrated the eye. E follows
    from these frames, so an error of g matters at other histories only.

    If the previous frame is known, before_i is the remainder of its m_i plus after_i
    times its Fe for the rest of its hold, with a covariance of its own. Frames follow
    each other in `every_s`, and their pushes in `held_s`, None of a single frame.

    `source`: declared, estimated from the holds of a force log, or of other tissue
    where the log shows no hold. Where nothing decides whether the tissue or the needle
    yields, intervals reach to the reading with `other` shares. `finding` says what the
    holds have shown; None if declared, and in early files.

    >>> import scleraforce as sf
    >>> sf.Relaxation.declared([(0.12, 1.2), (0.05, 30.0)]).shares
    (0.12, 0.05)
    """

    times_s: Vector = computed(TINY, LONGEST_S)
    shares: Vector = computed(0.0, 1.0)
    covariance: Matrix = _number()
    held: Vector = _number()
    held_covariance: Matrix = _number()
    before_n: Vector = _number()
    before_covariance_n2: Matrix = _number()
    after: Vector = _number()
    after_covariance_n2: Matrix = _number()
    every_s: float | None = _span()
    held_s: float | None = _span()
    source: Source
    other: Vector = computed(0.0, 1.0, default=())
    finding: HoldFinding | None = None

    def __post_init__(self) -> None:
        size = len(self.times_s)
        for mean, covariance in MOMENTS.items():
            rows = getattr(self, covariance)
            if {len(getattr(self, mean)), len(rows), *map(len, rows)} != {size}:
                raise StudyError(
                    f"{mean}: expected {size} numbers, and as many rows and columns of"
                    f" {covariance}: times_s has {size}"
                )
            if not _is_covariance(np.array(rows).reshape(size, size)):
                raise StudyError(
                    f"{covariance}: not a covariance matrix: expected a symmetric one"
                    f" without a negative variance, found {rows!r:.60}"
                )

        if len(self.other) not in (0, size):
            raise StudyError(f"other: expected {size} numbers, or none")

        for name in ("shares", "other"):
            share = sum(getattr(self, name))
            if not share < 1.0:
                raise StudyError(f"{name}: add up to {share:g}; expected less than 1")

    @property
    def terms(self) -> tuple[tuple[float, float], ...]:
        """The terms of the series: a share and its time constant, s."""
        return tuple(zip(self.shares, self.times_s, strict=True))

    @property
    def matters(self) -> bool:
        """False if the force on the needle is the elastic one for certain."""
        return any(self.shares) or any(self.other)

    @classmethod
    def of(
        cls,
        shares: Sequence[float],
        times_s: Sequence[float],
        covariance: Floats,
        source: Source,
    ) -> "Relaxation":
        """Return a relaxation of tissue of which no history is known."""
        terms = len(shares)
        return cls(
            times_s=tuple(times_s),
            shares=tuple(shares),
            covariance=matrix_rows(covariance),
            held=(MOST_HELD / 2,) * terms,
            held_covariance=matrix_rows(
                np.full((terms, terms), (SPREAD * MOST_HELD) ** 2)
            ),
            before_n=(MOST_BEFORE_N / 2,) * terms,
            before_covariance_n2=matrix_rows(
                np.full((terms, terms), (SPREAD * MOST_BEFORE_N) ** 2)
            ),
            after=(0.0,) * terms,
            after_covariance_n2=matrix_rows(np.zeros((terms, terms))),
            every_s=None,
            held_s=None,
            source=source,
        )

    @classmethod
    def declared(cls, terms: Sequence[Sequence[float]]) -> "Relaxation":
        """Return a declared relaxation: terms of a share and a time constant, s; no
        terms: the tissue is elastic.

        Raises:
            StudyError: the terms are impossible.
        """
        check_relaxation(terms)
        shares = [share for share, _ in terms]
        times_s = [time_s for _, time_s in terms]
        return cls.of(shares, times_s, np.zeros((len(terms), len(terms))), "declared")


def _is_covariance(matrix: Floats) -> bool:
    """Return whether a matrix is symmetric without negative eigenvalues, but for
    rounding.
    """
    size = float(np.abs(matrix).max(initial=0.0))
    if np.abs(matrix - matrix.T).max(initial=0.0) > ROUNDING * size:
        return False
    return bool((np.linalg.eigvalsh(matrix) >= -ROUNDING * size).all())


def matrix_rows(matrix: Floats) -> Matrix:
    """Return a matrix as tuples."""
    return tuple(tuple(row) for row in matrix.tolist())


TERMS_KEY = "relaxation"


def _read_terms(stated: Mapping[str, Any]) -> Relaxation | None:
    terms = stated.get(TERMS_KEY)
    return None if terms is None else Relaxation.declared(terms)


def _write_terms(relaxation: Relaxation | None) -> Mapping[str, Any]:
    if relaxation is None or relaxation.source != "declared":
        return {}
    return {TERMS_KEY: relaxation.terms}


# A recording states the terms of a measured relaxation: an empty list is elastic.
RELAXATION_FORM = TableForm(
    {TERMS_KEY: (tuple[tuple[float, ...], ...], Unit(low=0.0, high=1e5))},
    _read_terms,
    _write_terms,
)
