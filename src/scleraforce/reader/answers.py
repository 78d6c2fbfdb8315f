"""What a model answers to one frame; what cannot be judged is class 2 (withdraw)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scleraforce.fitting.library_fit import BoundaryFit
from scleraforce.reader.readings import Reading
from scleraforce.segmentation.needle import SeenNeedle


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a model says about a frame.

    Where the frame is not `usable`, `predicted` is the highest class (withdraw) and `reason` says why; what was read
    all the same is None. `force_n`, its 90 % `interval_n` and the contact's lateral place `contact_m`, from the
    frame's middle, are None with a classifier. `warnings` are sentences that limit the answer; `can_calibrate` says
    whether enough of the wall is in view to calibrate on the frame. `readings` has what each method read, by its name,
    and `fit` the wall of the library that lies best on the frame, where they were made. `needle` is the one seen in
    the frame, usable or not, and `conjunctiva_m` the median thickness of a layer over the wall.
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
