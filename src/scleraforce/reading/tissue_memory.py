"""The force on the needle, F, from readings of the elastic force, Fe, that the dent
shows, in tissue that relaxes.

F = Fe - sum g_i m_i (`mechanics.tissue_material`). The m_i are normal, given the frames
so far: between two frames of a dense sequence Fe is nearly straight; in a longer gap of
such a sequence it may have been anything that an eye bears, which bounds the m_i. A
monitor knows nothing of the time before its first frame; its median then is that of
rest. Of single frames, m_i is as in the frames that calibrated the eye, which have a
mean and a spread (see `records.tissue_relaxation`), or, where the time since the push
is known, what a sudden push leaves and the usual memory before it. An error of g has no
effect at the history of the calibration, since E follows from it.

A dent shows the force N along the wall's normal. A needle that leans by an angle a and
sticks feels N / cos a. One that slides on friction mu, below tan a, is held from the
side, and feels N (cos a + mu sin a). The median takes the needle for sticking, the
interval spans both.

A leaking eye (`Leak`): its pressure without the needle changes with the volume that has
leaked. In a dense sequence the dent stays as it was from frame to frame. In a longer
gap nothing shows what the needle did: the second dent is taken to have been there for
half of it, or for the time since its push if that is known, and the first one for half
of the rest. Before the first frame nothing has leaked.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import erf, exp, hypot, isfinite, sqrt
from typing import TypeVar

import numpy as np

from scleraforce.base.arrays import Floats
from scleraforce.base.normal_distribution import NINETY_PERCENT
from scleraforce.fit.one_frame import positive_share
from scleraforce.mechanics.tissue_material import line_weights
from scleraforce.reading.answer import Answer, Reading
from scleraforce.reading.needle_lean import NeedleLean
from scleraforce.reading.needle_place import shaft_lean
from scleraforce.records.eye import Eye
from scleraforce.records.globe import PressureLaw
from scleraforce.records.setup import Setup
from scleraforce.records.tissue_relaxation import Relaxation

Given = TypeVar("Given", Answer, Reading)

DENSE_S = 0.3  # between frames: in longer gaps a needle may come and go
SERIES_ERROR = 0.07  # of the force that is lost: four time constants stand for any
# Of the difference from the force that is lost at the history of the calibration, which
# E absorbs. On fast pushes of 60 virtual eyes, calibrated after holds, 0.9 of the
# intervals then held F without any other error (0.5 without this).
OTHER_HISTORY_ERROR = 0.3
LONGEST_S = 1e9  # gap
LIGHT_N = 1e-3  # a shallower dent is noise: the needle has let go
NO_RELAXATION = Relaxation.declared(())


@dataclass(frozen=True)
class FeltForce:
    """F = slope Fe - lag, with a standard deviation beside that of Fe; forces in N.

    Beyond that, F may be up to `less_n` smaller and `more_n` larger.
    """

    slope: float
    lag_n: float
    sd_n: float
    less_n: float = 0.0
    more_n: float = 0.0

    def of(self, elastic: Given, bounds_n: tuple[float, ...]) -> Given:
        """Return a reading, or an answer, of F from one of Fe; F is taken for normal on
        either side of its median, without what is below 0.
        """
        assert elastic.force_n is not None
        assert elastic.interval_n is not None
        elastic_n = elastic.force_n
        force_n = max(self.slope * elastic.force_n - self.lag_n, 0.0)
        below_n, above_n = (
            hypot(self.slope * (end_n - elastic_n), NINETY_PERCENT * self.sd_n)
            + further_n
            for end_n, further_n in zip(
                elastic.interval_n, (self.less_n, self.more_n), strict=True
            )
        )
        under: list[float] = [
            _share_below(bound_n, force_n, below_n if bound_n < force_n else above_n)
            for bound_n in bounds_n
        ]

        return replace(
            elastic,
            probabilities=tuple(np.diff([0.0, *under, 1.0]).tolist()),
            force_n=force_n,
            interval_n=(max(force_n - below_n, 0.0), force_n + above_n),
        )

    def leaning(self, lean: "NeedleLean", elastic_n: float) -> "FeltForce":
        """Return the force along a needle that leans."""
        least, factor, most = lean.factors
        force_n = max(self.slope * elastic_n - self.lag_n, 0.0)
        less_n = factor * self.less_n + (factor - least) * force_n
        more_n = factor * self.more_n + (most - factor) * force_n
        sd_n = factor * hypot(self.sd_n, lean.sd * force_n)
        return FeltForce(factor * self.slope, factor * self.lag_n, sd_n, less_n, more_n)

    def answer(self, elastic: Answer, bounds_n: tuple[float, ...]) -> Answer:
        """Return the answer with F from one with Fe."""
        found = self.of(elastic, bounds_n)
        assert found.probabilities is not None
        predicted = int(np.argmax(found.probabilities))
        readings = tuple(
            (name, self.of(one, bounds_n)) for name, one in elastic.readings
        )

        return replace(found, predicted=predicted, readings=readings)


def _share_below(bound_n: float, force_n: float, side_n: float) -> float:
    """Return the share of forces below a bound, half of them below the median; `side_n`
    of it holds 45 % on the bound's side.
    """
    scale_n = sqrt(2.0) * max(side_n, 1e-9) / NINETY_PERCENT
    share = 0.5 + 0.5 * erf((bound_n - force_n) / scale_n)
    return positive_share(share, 0.5 - 0.5 * erf(force_n / scale_n))


@dataclass(frozen=True, eq=False)
class TissueMemory:
    """Memory of an eye's tissue after the frames so far: mean (term,) and covariance
    (term, term) of m_i, in N.

    `setup` has how the tissue relaxes (by default it is elastic) and the needle's lean.
    `most_n`: the largest elastic force that an eye bears. After gaps m_i may be up to
    `less_n` smaller and `more_n` larger, (term,). `time_s`, `elastic_n`: the last
    frame's, None before it; `dense`: it followed another one closely, or the sequence
    is a monitor's, which is always dense.
    """

    setup: Setup
    most_n: float
    mean_n: Floats
    covariance: Floats
    less_n: Floats
    more_n: Floats
    time_s: float | None = None
    elastic_n: float = 0.0
    dense: bool = False
    of_monitor: bool = False

    @property
    def relaxation(self) -> Relaxation:
        """The relaxation of the tissue."""
        return self.setup.eye.relaxation or NO_RELAXATION

    @classmethod
    def unknown(cls, setup: Setup, max_force_n: float) -> "TissueMemory":
        """Return the history of an eye before its first frame; `max_force_n`: the
        largest force on the needle.
        """
        relaxation = setup.eye.relaxation or NO_RELAXATION
        terms = len(relaxation.shares)
        most_n = max_force_n / (1.0 - sum(relaxation.shares))
        nothing_n = np.zeros(terms)

        return cls(
            setup, most_n, nothing_n, np.zeros((terms, terms)), nothing_n, nothing_n
        )

    @classmethod
    def monitored(cls, setup: Setup, max_force_n: float) -> "TissueMemory":
        """Return the history of an eye when a monitor starts: anything may have been
        before.
        """
        unknown = cls.unknown(setup, max_force_n)
        more_n = np.full_like(unknown.mean_n, unknown.most_n)
        return replace(unknown, more_n=more_n, dense=True, of_monitor=True)

    def read(
        self,
        elastic: Answer,
        bounds_n: tuple[float, ...],
        time_s: float | None = None,
        held_s: float | None = None,
    ) -> tuple[Answer, "TissueMemory"]:
        """Return the answer that gives F from one that gives Fe, and the history after
        it.

        `time_s`: of the frame, None if it is a single one; `held_s`: the time since its
        push, if it is known. An answer without a force is returned unchanged, and
        leaves a gap.
        """
        if (
            not elastic.usable
            or elastic.force_n is None
            or not isfinite(elastic.force_n)
        ):
            return elastic, self

        known = self.setup
        seen_rad = shaft_lean(elastic.fit, elastic.needle)

        # of several planes: the angle in space, above 0, turned away from any of them
        if elastic.place is not None:
            known = replace(known, needle=replace(known.needle, lean_azimuth_rad=None))
            seen_rad = elastic.place.lean_rad

        lean = NeedleLean.of(known, seen_rad)
        felt = FeltForce(1.0, 0.0, 0.0)
        after = self
        if self.relaxation.matters:
            felt, after = self._felt(elastic.force_n, time_s, held_s)

        answer = elastic
        if after is not self or lean.factors != (1.0, 1.0, 1.0):
            answer = felt.leaning(lean, elastic.force_n).answer(elastic, bounds_n)
        if after is not self:
            answer = replace(answer, elastic_force_n=lean.factors[1] * elastic.force_n)

        if lean.ends_rad is not None:
            answer = replace(
                answer,
                lean_rad=lean.ends_rad,
                remarks=(*answer.remarks, *lean.remarks),
            )

        return answer, after

    def _felt(
        self, force_n: float, time_s: float | None, held_s: float | None
    ) -> tuple[FeltForce, "TissueMemory"]:
        """Return the force along the normal from an elastic one, and the history after
        it.
        """
        known = self.relaxation
        shares = np.array(known.shares)
        held = np.array(known.held)
        error = np.array(known.covariance)
        after, grows = self._after(force_n, time_s, held_s)
        off_n = held * force_n + (1.0 - held) * np.array(known.before_n) - after.mean_n
        variance = float(shares @ after.covariance @ shares + off_n @ error @ off_n)
        slope = 1.0 - float(shares @ grows)
        lost_n = float(shares @ after.mean_n)
        variance += (SERIES_ERROR * lost_n) ** 2 + (
            OTHER_HISTORY_ERROR * float(shares @ off_n)
        ) ** 2
        lag_n = lost_n - (1.0 - slope) * force_n
        # what m_i has more, F has less
        less_n = float(shares @ after.more_n)
        more_n = float(shares @ after.less_n)
        other_n = self._other_n(off_n)
        less_n = max(less_n, less_n - other_n)
        more_n = max(more_n, more_n + other_n)

        return FeltForce(slope, lag_n, sqrt(variance), less_n, more_n), after

    def _other_n(self, off_n: Floats) -> float:
        """Return how much more force the other explanation of the calibration's holds
        reads; `off_n` (term,): how much less is remembered than in its frames.
        """
        known = self.relaxation
        if not known.other:
            return 0.0

        shares = np.array(known.shares)
        other = np.array(known.other)
        held = np.array(known.held)
        # the elastic forces of the same frames by the other explanation
        scale = (1.0 - shares @ held) / (1.0 - other @ held)
        return float((scale * other - shares) @ off_n)

    def _after(
        self, force_n: float, time_s: float | None, held_s: float | None
    ) -> tuple["TissueMemory", Floats]:
        """Return the history after a frame, and the part of each m_i that grows with
        its Fe.
        """
        known = self.relaxation
        elastic_n = min(force_n, self.most_n) if force_n > LIGHT_N else 0.0
        gap_s = (
            np.inf if time_s is None or self.time_s is None else time_s - self.time_s
        )
        gap_s = np.inf if gap_s < 0.0 else gap_s  # a list out of order
        close = gap_s <= DENSE_S
        dense = self.of_monitor or close
        less_n = np.zeros_like(self.mean_n)
        more_n = np.zeros_like(self.mean_n)

        if (close or self.dense) and held_s is None:
            gap_s = min(gap_s, LONGEST_S)
            old, kept, grows = line_weights(np.array([gap_s]), known.times_s)[0]
            come_n = old * self.elastic_n + grows * elastic_n
            if self.time_s is None:
                come_n = np.zeros_like(kept)
                kept = np.ones_like(kept)

            mean_n = come_n + kept * self.mean_n
            covariance = np.outer(kept, kept) * self.covariance
            less_n = kept * self.less_n
            more_n = kept * self.more_n

            if not close:  # Fe was anywhere from 0 to the most
                less_n = less_n + come_n
                more_n = more_n + (1.0 - kept) * self.most_n - come_n
                grows = np.zeros_like(grows)
        else:
            grows = np.array(known.held)
            spread = np.array(known.held_covariance)
            if held_s is not None:
                grows = -np.expm1(-held_s / np.array(known.times_s))
                spread = np.zeros_like(spread)

            before_n, before_n2 = self._before(gap_s, time_s is not None, held_s)
            mean_n = grows * force_n + (1.0 - grows) * before_n
            covariance = (
                spread * force_n**2 + np.outer(1.0 - grows, 1.0 - grows) * before_n2
            )

        now = replace(
            self, mean_n=mean_n, covariance=covariance, less_n=less_n, more_n=more_n
        )
        return replace(now, time_s=time_s, elastic_n=elastic_n, dense=dense), grows

    def _before(
        self, gap_s: float, follows: bool, held_s: float | None
    ) -> tuple[Floats, Floats]:
        """Return mean and covariance of the m_i when the push of a frame began;
        `follows`: others will, or did.
        """
        known = self.relaxation
        before_n = np.array(known.before_n)
        before_n2 = np.array(known.before_covariance_n2)

        if (
            np.isfinite(gap_s)
            and known.every_s is not None
            and known.held_s is not None
        ):
            times_s = np.array(known.times_s)
            left = np.exp(
                -max(gap_s - (known.held_s if held_s is None else held_s), 0.0)
                / times_s
            )
            late = np.exp(-max(gap_s - known.every_s, 0.0) / times_s)
            before_n = (
                left * self.mean_n + late * np.array(known.after) * self.elastic_n
            )
            before_n2 = np.outer(left, left) * self.covariance + np.array(
                known.after_covariance_n2
            )
        elif follows and self.time_s is None:
            # the first of a session, which may be the first push
            before_n2 = before_n2 + np.outer(before_n, before_n) / 4
            before_n = before_n / 2

        return before_n, before_n2


READINGS = 3  # of a frame after a longer gap, whose own dent decides on what has leaked


@dataclass(frozen=True)
class Leak:
    """The volume that has leaked from an eye by its last frame, at `time_s`, and its
    dent's, m^3.
    """

    leaked_m3: float = 0.0
    dent_m3: float = 0.0
    time_s: float | None = None

    def read(
        self,
        read: Callable[[Setup], tuple[Answer, ...]],
        setup: Setup,
        time_s: float | None,
        held_s: float | None,
    ) -> tuple[tuple[Answer, ...], "Leak"]:
        """Return the answers of one time, read at the resting pressure that the leak
        leaves, and the leak by then.

        A frame without a time is read as the first one. One that cannot be judged, or
        was not fitted, does not show the dent, and leaves the leak as it was.
        """
        eye = setup.eye
        law = leaking_law(eye)
        if law is None or eye.leak_time_s is None or eye.iop_pa is None:
            return read(setup), self

        gap_s = (
            0.0
            if self.time_s is None or time_s is None
            else max(time_s - self.time_s, 0.0)
        )
        dense = gap_s <= DENSE_S
        held_s = (
            gap_s if dense else min(0.5 * gap_s if held_s is None else held_s, gap_s)
        )
        left = exp(-0.5 * (gap_s - held_s) / eye.leak_time_s)
        kept = exp(-held_s / eye.leak_time_s)
        # first the old dent stays for a while, then there is none
        before_m3 = left * (self.dent_m3 + (self.leaked_m3 - self.dent_m3) * left)
        leak = self

        for _ in range(1 if dense else READINGS):
            leaked_m3 = leak.dent_m3 + (before_m3 - leak.dent_m3) * kept
            resting_pa = float(law.pressure(eye.iop_pa, -leaked_m3))
            answers = read(replace(setup, eye=replace(eye, iop_pa=resting_pa)))
            pressure_pa = answers[0].iop_at_dent_pa
            if pressure_pa is None:
                return answers, self

            dent_m3 = leaked_m3 + float(law.displaced_m3(eye.iop_pa, pressure_pa))
            leak = Leak(leaked_m3, dent_m3, time_s)

        return answers, leak

    def at_pressure(
        self,
        resting_pa: float,
        eye: Eye,
        answers: tuple[Answer, ...],
        time_s: float | None,
    ) -> "Leak":
        """Return the leak by a time whose pressure at rest is stated, and whose
        answers were read at it.
        """
        law = leaking_law(eye)
        pressure_pa = answers[0].iop_at_dent_pa
        if law is None or eye.iop_pa is None or pressure_pa is None:
            return self

        leaked_m3 = -float(law.displaced_m3(eye.iop_pa, resting_pa))
        dent_m3 = leaked_m3 + float(law.displaced_m3(eye.iop_pa, pressure_pa))
        return Leak(leaked_m3, dent_m3, time_s)


def leaking_law(eye: Eye) -> PressureLaw | None:
    """Return the pressure law of an eye that leaks; None of any other one."""
    globe = eye.globe
    if globe is None or globe.leak_time_s is None or globe.mean <= 0.0:
        return None
    return globe.pressure_law(globe.mean)
