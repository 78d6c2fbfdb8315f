"""What a model says about a frame: the readings of its methods, and one answer.

A frame that cannot be judged is of class 2 (withdraw).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import hypot, isfinite
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from scleraforce.fitting.library_fit import BoundaryFit
from scleraforce.fitting.unknowns import LATERAL
from scleraforce.known.eye import NOTHING_KNOWN, Known
from scleraforce.monitor.events import Verdict
from scleraforce.recording.folder import OctInfo
from scleraforce.recording.pixels import Pixels, PixelScale
from scleraforce.segmentation.found import Segmentation
from scleraforce.segmentation.needle import SeenNeedle
from scleraforce.study import Study
from scleraforce.units import from_si

METHODS = ("network", "fit")


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Class probabilities, force (median) with its 90 % interval, and the contact's place from the frame's middle.

    `contact_sd_m` is how sure that place is where the method knows it (a standard deviation); without a dent the fit
    can hardly tell where the needle is.
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
        """Whether every number is one, and the interval holds the force."""
        low, high = self.interval_n
        numbers = (*self.probabilities, self.force_n, low, high, self.contact_m, self.contact_sd_m)
        return all(map(isfinite, numbers)) and low <= self.force_n <= high


def fit_reading(fit: BoundaryFit, bounds_n: tuple[float, ...], factor: float = 1.0) -> Reading:
    """Return what a fit says, its uncertainty stretched about the median by a factor (`interval_factors`)."""
    return Reading(
        probabilities=fit.probabilities(unstretched(fit.force_n, bounds_n, factor)),
        force_n=fit.force_n,
        interval_n=stretched_interval(fit.force_n, fit.interval_n, factor),
        contact_m=fit.contact_m,
        contact_sd_m=float(fit.sd[LATERAL]),
    )


def disagreement(answer: Reading, check: Reading, names: tuple[str, str]) -> str | None:
    """Return a sentence where two methods differ by more than their intervals together, None where they agree.

    The intervals count as independent: their half widths towards each other add in squares. A check that is no number
    is no agreement.

    >>> from dataclasses import replace
    >>> near = Reading(probabilities=(0, 1, 0), force_n=0.010, interval_n=(0.009, 0.011), contact_m=0.0)
    >>> far = replace(near, force_n=0.013, interval_n=(0.011, 0.015))
    >>> disagreement(near, near, ("network", "fit"))
    >>> disagreement(near, far, ("network", "fit"))
    'the network reads 10.0 mN, the fit 13.0 mN: more apart than their intervals allow'
    """
    if not check.finite:
        return f"what the {names[1]} reads is no number: nothing checks the {names[0]}"
    low, high = sorted((answer, check), key=lambda reading: reading.force_n)
    together = hypot(low.interval_n[1] - low.force_n, high.force_n - high.interval_n[0])
    if high.force_n - low.force_n <= together:
        return None
    return (
        f"the {names[0]} reads {from_si(answer.force_n, 'mn'):.1f} mN, "
        f"the {names[1]} {from_si(check.force_n, 'mn'):.1f} mN: more apart than their intervals allow"
    )


def spanned_interval(answer: Reading, check: Reading) -> tuple[float, float]:
    """Return the interval from the lower end of both to the higher one; a check that is no number has none.

    >>> near = Reading(probabilities=(0, 1, 0), force_n=0.010, interval_n=(0.009, 0.011), contact_m=0.0)
    >>> far = Reading(probabilities=(0, 1, 0), force_n=0.013, interval_n=(0.012, 0.015), contact_m=0.0)
    >>> spanned_interval(near, far)
    (0.009, 0.015)
    """
    if not check.finite:
        return answer.interval_n
    (low, high), (other_low, other_high) = answer.interval_n, check.interval_n
    return min(low, other_low), max(high, other_high)


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a model says about a frame.

    Where the frame is not `usable`, `predicted` is the highest class (withdraw) and `reason` says why; what was read
    all the same is None. `force_n`, its 90 % `interval_n` and the contact's lateral place `contact_m`, from the
    frame's middle, are None with a classifier. `warnings` are sentences that limit the answer; `can_calibrate` says
    whether enough of the wall is in view to calibrate on the frame. `readings` has what each method read, by its name,
    and `fit` the wall of the library that lies best on the frame, where they were made. `needle` is the one seen in
    the frame, usable or not, and `conjunctiva_m` the median thickness of a layer over the wall. `segmentation` is the
    wall that was read, and what a page draws.
    """

    predicted: int
    probabilities: tuple[float, ...] | None
    usable: bool
    reason: str | None
    force_n: float | None = None
    interval_n: tuple[float, float] | None = None
    contact_m: float | None = None
    warnings: tuple[str, ...] = ()
    can_calibrate: bool = False
    readings: tuple[tuple[str, Reading], ...] = ()
    fit: BoundaryFit | None = None
    needle: SeenNeedle | None = None
    conjunctiva_m: float | None = None
    segmentation: Segmentation | None = field(default=None, compare=False, repr=False)

    @property
    def verdict(self) -> Verdict:
        """The part that the monitor decides on, sends and logs."""
        return Verdict(
            predicted=self.predicted,
            probabilities=self.probabilities,
            usable=self.usable,
            reason=self.reason,
            force_n=self.force_n,
            interval_n=self.interval_n,
        )

    @property
    def iop_at_dent_pa(self) -> float | None:
        """Pressure in the eye under the needle, as the fit has it; None where nothing was fitted or is usable."""
        return self.fit.iop_pa if self.fit is not None and self.usable else None


@dataclass(frozen=True, eq=False)
class LiveReading:
    """The answer to a frame, and the wall's boundaries in rows of it, (column,), NaN where there is none."""

    answer: Answer
    outer_row: NDArray[np.float64]
    inner_row: NDArray[np.float64]


def unusable(classes: int, reason: str) -> Answer:
    """Return the answer to a frame that cannot be judged, of a model of so many classes: withdraw.

    >>> unusable(3, "no wall was found").predicted
    2
    """
    return Answer(predicted=classes - 1, probabilities=None, usable=False, reason=reason)


class Reader(Protocol):
    """A trained model that answers to raw frames: `Classifier`, `ForceReader`, `RawReader`. Made by `load_model`."""

    @property
    def kind(self) -> str:
        """What the model's folder calls it: "classifier", "reader" or "raw-reader"."""

    @property
    def path(self) -> Path:
        """The model's folder."""

    @property
    def study(self) -> Study:
        """What it was trained with."""

    @property
    def record(self) -> Mapping[str, Any]:
        """The content of `model.json`."""

    @property
    def provenance(self) -> Mapping[str, str]:
        """What `model.onnx` says about its making."""

    @property
    def classes(self) -> int:
        """Number of force classes."""

    @property
    def reads_force(self) -> bool:
        """Whether its answers have a force with its interval, not the class alone."""

    @property
    def serves_loop(self) -> bool:
        """Whether it may serve the control loop."""

    @property
    def fixed_modulus_pa(self) -> float | None:
        """Young's modulus that it reads every eye with; None: it takes each eye's own."""

    def read(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> Answer:
        """Read one raw frame with all that the model has.

        Args:
            frame: raw B-scan (row, column).
            scale: size of a pixel as stored, with the refractive index.
            known: of the eye; a model with a fixed modulus takes no notice of it.

        Raises:
            ValueError: no such frame (see `find_wall`).
            ModelError: the network cannot be run.
        """

    def read_live(self, frame: Pixels, scale: PixelScale, known: Known = NOTHING_KNOWN) -> LiveReading:
        """Read one raw frame within a millisecond or two: without the fit, and not asking `can_calibrate`.

        Arguments and errors are those of `read`.
        """

    def refusal(self, known: Known) -> str | None:
        """Return why the model cannot read an eye of which so much is known; None where it can."""

    def limits(self, known: Known, scan: OctInfo, gauge: int | None = None) -> tuple[str, ...]:
        """Return a sentence for each known quantity of an eye, its B-scans and its needle that the training lacked."""


def stretched_interval(median_n: float, interval_n: tuple[float, float], factor: float) -> tuple[float, float]:
    """Return an interval whose distribution is stretched about its median by a factor; no force is below 0."""
    low_n, high_n = (max(median_n + factor * (end_n - median_n), 0.0) for end_n in interval_n)
    return low_n, high_n


def unstretched(median_n: float, forces_n: tuple[float, ...], factor: float) -> tuple[float, ...]:
    """Return the forces of which a distribution says what the one that is stretched by a factor says of `forces_n`.

    >>> unstretched(10.0, (16.0, 1.0), 2.0)
    (13.0, 5.5)
    """
    return tuple(max(median_n + (force_n - median_n) / factor, 0.0) for force_n in forces_n)
