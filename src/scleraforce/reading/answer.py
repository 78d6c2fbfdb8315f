"""The answer of a model to a frame, and the readings of its methods. A frame that
cannot be judged is of class 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from math import hypot, isfinite
from typing import Any

import numpy as np

from scleraforce.base.notebook_cards import data_frame, html_card
from scleraforce.base.optional_packages import package_for
from scleraforce.base.plain_json import finite_json
from scleraforce.base.units import from_si
from scleraforce.fit.one_frame import BoundaryFit
from scleraforce.fit.planes_of_a_moment import SpatialPlace
from scleraforce.fit.unknowns import LATERAL
from scleraforce.reading.force_trend import TimeToBound
from scleraforce.reading.needle_place import NOWHERE, NeedlePlace, PlaceValue
from scleraforce.records.needle import one_lean
from scleraforce.records.remark import Remark, sentences
from scleraforce.records.verdict import Verdict
from scleraforce.wall.needle_in_frame import SeenNeedle, needle_entry
from scleraforce.wall.wall import Segmentation

METHODS = ("network", "fit")
SHOWN = 20  # answers of a stack in a notebook
UNCHECKED = "the fit alone reads it, and nothing checks that"


@dataclass(frozen=True, kw_only=True)
class Reading:
    """The reading of one method: class probabilities, median force with its 90 %
    interval, and the contact's place.

    `contact_m` is the lateral place from the frame's middle, `contact_sd_m` its
    standard deviation where the method knows it; without a dent the fit can hardly
    locate the needle.
    """

    probabilities: tuple[float, ...]
    force_n: float
    interval_n: tuple[float, float]
    contact_m: float
    contact_sd_m: float = 0.0

    @property
    def predicted(self) -> int:
        """The most probable class."""
        return max(range(len(self.probabilities)), key=self.probabilities.__getitem__)

    @property
    def width_n(self) -> float:
        """Width of the interval."""
        return self.interval_n[1] - self.interval_n[0]

    @property
    def finite(self) -> bool:
        """True if all numbers are finite and the interval holds the force."""
        low, high = self.interval_n
        numbers = (
            *self.probabilities,
            self.force_n,
            low,
            high,
            self.contact_m,
            self.contact_sd_m,
        )

        return all(map(isfinite, numbers)) and low <= self.force_n <= high

    def spanning(self, check: "Reading") -> "Reading":
        """Return the reading with an interval that spans both intervals; a check that
        is not finite adds nothing.
        """
        low, high = self.interval_n
        other_low, other_high = (check if check.finite else self).interval_n
        return replace(self, interval_n=(min(low, other_low), max(high, other_high)))


def fit_reading(
    fit: BoundaryFit, bounds_n: tuple[float, ...], factor: float = 1.0
) -> Reading:
    """Return the reading of a fit, its distribution stretched about the median by a
    factor (`reading.interval_widths`).
    """
    least_n, *asked_n = unstretched(fit.force_n, (0.0, *bounds_n), factor)
    return Reading(
        probabilities=fit.probabilities(tuple(asked_n), least_n),
        force_n=fit.force_n,
        interval_n=stretched_interval(fit.force_n, fit.interval_n, factor),
        contact_m=fit.contact_m,
        contact_sd_m=float(fit.sd[LATERAL]),
    )


def disagreement(answer: Reading, check: Reading, names: tuple[str, str]) -> str | None:
    """Return a sentence if two methods differ by more than their intervals allow, else
    None.

    The intervals count as independent: their half widths towards each other add in
    squares. A check that is not finite is a disagreement.

    >>> import textwrap
    >>> from dataclasses import replace
    >>> near = Reading(
    ...     probabilities=(0, 1, 0),
    ...     force_n=0.010,
    ...     interval_n=(0.009, 0.011),
    ...     contact_m=0.0,
    ... )
    >>> far = replace(near, force_n=0.013, interval_n=(0.011, 0.015))
    >>> disagreement(near, near, ("network", "fit"))
    >>> print(textwrap.fill(disagreement(near, far, ("network", "fit")), 60))
    the network reads 10.0 mN, the fit 13.0 mN: they differ by
    more than their intervals allow
    """
    if not check.finite:
        return (
            f"the reading of the {names[1]} is not a number: nothing checks the"
            f" {names[0]}"
        )

    low, high = sorted((answer, check), key=lambda reading: reading.force_n)
    together = hypot(low.interval_n[1] - low.force_n, high.force_n - high.interval_n[0])
    if high.force_n - low.force_n <= together:
        return None

    return (
        f"the {names[0]} reads {from_si(answer.force_n, 'mn'):.1f} mN, the {names[1]}"
        f" {from_si(check.force_n, 'mn'):.1f} mN: they differ by more than their"
        " intervals allow"
    )


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The answer of a model to a frame.

    If the frame is not `usable`, `predicted` is the highest class (withdraw), `reason`
    says why, and there is no reading. A classifier has no `force_n`, no 90 %
    `interval_n` and no lateral place of the contact from the frame's middle,
    `contact_m`. `remarks` limit the answer, or say how it was read; `can_calibrate`:
    enough of the wall is in view to calibrate on the frame. `left_out` says why its
    plane is not in the fit of all planes, whose answer it has. `to_bound`: when the
    force reaches the highest class, by the moments before (`reading.force_trend`).
    `elastic_force_n`, of tissue that relaxes, is the force that makes such a dent at
    once; `force_n` is the force on the needle now, along it where `lean_rad` has the
    ends of its angle from the wall's normal. Where nothing says the lean, it is the
    part along the normal, or, of an eye that was calibrated so, along a needle that
    leans as it did then. `readings` holds the reading of each method by its name, and
    `fit` the wall of the library that fits the frame best; `places` says where the
    needle is, with intervals, and `place` the same in three dimensions, if several
    planes were read together. `segmentation` is the wall that was read. `model` and
    `class_bounds_n` are those of the model that answered (`model_folder.model_name`).
    """

    predicted: int
    probabilities: tuple[float, ...] | None
    usable: bool
    reason: str | None
    force_n: float | None = None
    interval_n: tuple[float, float] | None = None
    contact_m: float | None = None
    elastic_force_n: float | None = None
    lean_rad: tuple[float, float] | None = None
    remarks: tuple[Remark, ...] = ()
    can_calibrate: bool = False
    left_out: str | None = None
    to_bound: TimeToBound | None = None
    readings: tuple[tuple[str, Reading], ...] = ()
    fit: BoundaryFit | None = None
    places: NeedlePlace = NOWHERE
    place: SpatialPlace | None = None
    segmentation: Segmentation | None = field(default=None, compare=False, repr=False)
    model: str | None = field(default=None, compare=False)
    class_bounds_n: tuple[float, ...] = field(default=(), compare=False)

    def __repr__(self) -> str:
        if not self.usable:
            return (
                f"<Answer: class {self.predicted} (withdraw), not usable:"
                f" {self.reason}>"
            )
        return (
            "<Answer: class"
            f" {self.predicted}{self.force_words and ', '}{self.force_words}>"
        )

    def _repr_html_(self) -> str:
        """The frame with its wall, the force and its interval, for Jupyter."""
        facts = {
            "force": self.force_words,
            "class": str(self.predicted),
            "not usable": self.reason or "",
        }
        facts |= {
            f"{remark.severity} {number}": str(remark)
            for number, remark in enumerate(self.remarks, start=1)
        }
        shown = {name: words for name, words in facts.items() if words}

        return html_card(
            "Answer",
            shown,
            None if self.segmentation is None else self.segmentation.overlay,
        )

    @property
    def dent_force_n(self) -> float | None:
        """The force that makes such a dent at once; None without a force."""
        elastic_n = self.elastic_force_n
        return self.force_n if elastic_n is None else elastic_n

    @property
    def warnings(self) -> tuple[str, ...]:
        """The sentences of the remarks."""
        return sentences(self.remarks)

    @property
    def force_words(self) -> str:
        """The force with its interval, mN; empty without one."""
        if self.force_n is None or self.interval_n is None:
            return ""
        force, low, high = (
            f"{from_si(value, 'mn'):.1f}" for value in (self.force_n, *self.interval_n)
        )
        return f"{force} mN (90 %: {low} to {high})"

    @property
    def verdict(self) -> Verdict:
        """The part that the monitor decides on, sends and logs."""
        return Verdict(
            **{item.name: getattr(self, item.name) for item in fields(Verdict)}
        )

    @property
    def iop_at_dent_pa(self) -> float | None:
        """Pressure in the eye under the needle, from the fit; None if nothing was
        fitted or the frame is not usable.
        """
        return self.fit.iop_pa if self.fit is not None and self.usable else None

    @property
    def needle(self) -> SeenNeedle | None:
        """The needle that crosses the frame, usable or not."""
        return None if self.segmentation is None else self.segmentation.needle

    @property
    def conjunctiva_m(self) -> float | None:
        """Median thickness of a layer over the wall."""
        return None if self.segmentation is None else self.segmentation.conjunctiva_m

    @property
    def boundaries(self) -> str | None:
        """Which boundaries of the wall were read: "both" or "surface"; None without a
        wall.
        """
        return None if self.segmentation is None else self.segmentation.boundaries

    def to_dict(self) -> dict[str, Any]:
        """Return the answer's keys in the JSON of `read` and `evaluate`, as plain
        types.
        """
        median_ms, interval_ms = (
            (None, None) if self.to_bound is None else self.to_bound.as_ms()
        )
        places = self.places.as_json()
        if self.places.lean_rad is None:
            places["lean_deg"] = from_si(one_lean(self.lean_rad), "deg")

        found: dict[str, Any] = finite_json(
            {
                "model": self.model,
                "class_bounds_mn": [
                    from_si(bound_n, "mn") for bound_n in self.class_bounds_n
                ],
                "predicted": self.predicted,
                "probabilities": self.probabilities,
                "predicted_force_mn": from_si(self.force_n, "mn"),
                "interval_mn": (
                    None
                    if self.interval_n is None
                    else [from_si(end, "mn") for end in self.interval_n]
                ),
                "elastic_force_mn": from_si(self.elastic_force_n, "mn"),
                **places,
                "contact_mm": from_si(self.contact_m, "mm"),
                "time_to_bound_ms": median_ms,
                "time_to_bound_ms_interval": interval_ms,
                **_place_entry(self.place if self.usable else None),
                "pressure_pa": self.iop_at_dent_pa,
                "pressure_mmhg": from_si(self.iop_at_dent_pa, "mmhg"),
                "needle": needle_entry(self.needle),
                "wall": None if self.segmentation is None else self.segmentation.source,
                "boundaries": self.boundaries,
                "conjunctiva_um": from_si(self.conjunctiva_m, "um"),
                "usable": self.usable,
                "reason": self.reason,
                "warnings": self.warnings,
                "remarks": [remark.to_dict() for remark in self.remarks],
                "can_calibrate": self.can_calibrate,
            }
        )
        return found


@dataclass(frozen=True, eq=False, repr=False)
class Answers(Sequence[Answer]):
    """The answers to the frames of a stack, in their order."""

    each: tuple[Answer, ...]

    def __getitem__(self, place: Any) -> Any:
        """Return an answer, or the answers of a slice."""
        return (
            Answers(self.each[place]) if isinstance(place, slice) else self.each[place]
        )

    def __len__(self) -> int:
        return len(self.each)

    def __repr__(self) -> str:
        return (
            f"<Answers to {len(self)} frames, {sum(answer.usable for answer in self)}"
            " usable>"
        )

    def _repr_html_(self) -> str:
        """The first forces, for Jupyter."""
        facts = {
            f"frame {nth}": repr(answer)[9:-1]
            for nth, answer in enumerate(self.each[:SHOWN])
        }
        return html_card(repr(self)[1:-1], facts)

    def to_dict(self) -> dict[str, Any]:
        """Return the answers as plain types, in the key `frames`."""
        return {"frames": [answer.to_dict() for answer in self]}

    def to_dataframe(self) -> Any:
        """Return a table of pandas with a row for each frame, units in the names;
        raises `InputError` without it.
        """
        return data_frame(
            {"frame": nth, **answer.to_dict()} for nth, answer in enumerate(self)
        )

    def to_xarray(self) -> Any:
        """Return a Dataset of xarray over frames and columns: forces, N, and
        boundaries, rows; NaN where unknown.

        It raises `InputError` without xarray.
        """
        read = [
            (answer.force_n, *(answer.interval_n or (None, None)), answer.contact_m)
            for answer in self
        ]
        force_n, low_n, high_n, contact_m = (
            np.array(read, dtype=np.float64).reshape(-1, 4).T
        )
        walls = [
            answer.segmentation for answer in self if answer.segmentation is not None
        ]

        return package_for("xarray", "to_xarray", "tables").Dataset(
            {
                "force_n": ("frame", force_n, {"units": "N"}),
                "interval_n": (
                    ("frame", "end"),
                    np.stack([low_n, high_n], axis=1),
                    {"units": "N", "content": "90 %"},
                ),
                "contact_m": ("frame", contact_m, {"units": "m"}),
                "predicted": ("frame", [answer.predicted for answer in self]),
                "usable": ("frame", [answer.usable for answer in self]),
                "outer_row": (
                    ("frame", "column"),
                    np.array([wall.outer_row for wall in walls]),
                    {"units": "row"},
                ),
                "inner_row": (
                    ("frame", "column"),
                    np.array([wall.inner_row for wall in walls]),
                    {"units": "row"},
                ),
            },
            coords={"end": ["low", "high"]},
        )


def _place_entry(place: SpatialPlace | None) -> dict[str, Any]:
    """Return the keys of a contact in three dimensions, with intervals; null without
    planes that were read together.
    """
    if place is None:
        return dict.fromkeys(
            (
                "contact_xyz_mm",
                "contact_xyz_mm_interval",
                "tilt_deg",
                "tilt_deg_interval",
            )
        )

    contact = [
        one.in_unit("mm")
        for one in map(PlaceValue.of, place.contact_m, place.contact_sd_m)
    ]
    tilt = [
        one.in_unit("deg")
        for one in map(PlaceValue.of, place.tilt_rad, place.tilt_sd_rad)
    ]

    return {
        "contact_xyz_mm": [value for value, _ in contact],
        "contact_xyz_mm_interval": [ends for _, ends in contact],
        "tilt_deg": [value for value, _ in tilt],
        "tilt_deg_interval": [ends for _, ends in tilt],
    }


def joined_answers(answers: Sequence[Answer]) -> list[Answer]:
    """Return answers to planes that one fit has read: with one interval that spans all,
    and all remarks.

    A plane that nothing checks needs no remark if another one is checked.
    """
    ends = [answer.interval_n for answer in answers if answer.interval_n is not None]
    if len(ends) < len(answers):
        return list(answers)

    remarks = list(
        dict.fromkeys(remark for answer in answers for remark in answer.remarks)
    )
    unchecked = [remark for remark in remarks if remark.code == "fit-unchecked"]
    is_checked = any(len(answer.readings) > 1 for answer in answers)
    remarks = [
        remark
        for remark in remarks
        if remark not in unchecked[0 if is_checked else 1 :]
    ]
    interval_n = min(low for low, _ in ends), max(high for _, high in ends)

    return [
        replace(answer, interval_n=interval_n, remarks=tuple(remarks))
        for answer in answers
    ]


def not_below(answer: Answer, unlearned: Answer) -> Answer:
    """Return the answer for a learned eye, nowhere less careful than that for the eye
    before: not usable if either is not, and with the higher class and the higher upper
    end of both.
    """
    if not answer.usable:
        return answer
    if not unlearned.usable:
        return unlearned

    if unlearned.predicted > answer.predicted:
        answer = replace(
            answer,
            predicted=unlearned.predicted,
            probabilities=unlearned.probabilities,
        )
    if answer.interval_n is None or unlearned.interval_n is None:
        return answer

    low_n, high_n = answer.interval_n
    return replace(answer, interval_n=(low_n, max(high_n, unlearned.interval_n[1])))


def unusable_answer(classes: int, reason: str) -> Answer:
    """Return the answer of a model with n classes to a frame that cannot be judged:
    withdraw.
    """
    return Answer(
        predicted=classes - 1, probabilities=None, usable=False, reason=reason
    )


def stretched_interval(
    median_n: float, interval_n: tuple[float, float], factor: float
) -> tuple[float, float]:
    """Return an interval whose distribution is stretched about its median by a factor;
    forces stay at or above 0.
    """
    low_n, high_n = (
        max(median_n + factor * (end_n - median_n), 0.0) for end_n in interval_n
    )
    return low_n, high_n


def unstretched(
    median_n: float, forces_n: tuple[float, ...], factor: float
) -> tuple[float, ...]:
    """Return the forces at which a distribution has the quantiles that the stretched
    one has at `forces_n`; they may be below 0.
    """
    return tuple(median_n + (force_n - median_n) / factor for force_n in forces_n)
