"""The `[library]` section of a study: which load paths the response library holds.

The radius and Poisson's ratio are those of `[eye]`, the needle is that of `[needle]`.
"""

from dataclasses import dataclass

from scleraforce.errors import StudyError
from scleraforce.study.fields import check_fields, quantity
from scleraforce.study.sampled import Range, Sampled

LEAST_STIFFENINGS = 4  # that cubic splines run through


@dataclass(frozen=True, kw_only=True)
class LibraryStudy:
    """Ranges of the library and how finely it covers them; `docs/library.md` says what the interpolation is worth.

    `thicknesses` values are spread evenly in their logarithm between the ends of `thickness_m`, and `tensions` between
    those of `tension`, which is p R/(E t): likewise where it is low, denser towards the one at which the wall bursts
    (0.416 with a Poisson's ratio of 0.45). Sealed eyes rise far above their pressure at rest. Each path has `tips`
    states up to `max_tip_m`, denser at small dents. `stiffenings` values of b (`mechanics.stiffening`) are spread
    evenly in ln(1 + 5 b) between the ends of `stiffening`; one: all tissue is as the lower end says. No force above
    `max_force_ratio_m2` (F/E) is asked for. `elements` and `layers` are those of the wall's meridian.
    """

    thickness_m: Sampled = quantity(Range(min=350.0, max=900.0), "um", 100.0, 3000.0)
    thicknesses: int = quantity(10, None, 4, 1000)
    tension: Sampled = quantity(Range(min=2e-4, max=0.35), None, 1e-7, 1.0)
    tensions: int = quantity(16, None, 4, 1000)
    max_tip_m: float = quantity(10.0, "mm", 0.1, 50.0)
    tips: int = quantity(56, None, 4, 10_000)
    stiffening: Sampled = quantity(Range(min=0.0, max=30.0), None, 0.0, 200.0)
    stiffenings: int = quantity(5, None, 1, 1000)
    max_force_ratio_m2: float = quantity(0.5, "mm2", 1e-4, 100.0)
    elements: int = quantity(64, None, 8, 2000)
    layers: int = quantity(1, None, 1, 20)

    @property
    def stiffening_ends(self) -> tuple[float, float]:
        """The least and the largest stiffening that a library of it holds."""
        low, high = self.stiffening.bounds
        return low, high if self.stiffenings > 1 else low

    def __post_init__(self) -> None:
        check_fields(self)
        for key, bounds in (("thickness_um", self.thickness_m.bounds), ("tension", self.tension.bounds)):
            if bounds[0] == bounds[1]:
                raise StudyError(f"{key}: a range has to be given, like {{ min = ..., max = ... }}")
        low, high = self.stiffening.bounds
        if self.stiffenings > 1 and low == high:
            raise StudyError("stiffening: a range has to be given, like { min = ..., max = ... }; or stiffenings = 1")
        if 1 < self.stiffenings < LEAST_STIFFENINGS:
            raise StudyError(f"stiffenings: {self.stiffenings}; give 1, or at least {LEAST_STIFFENINGS}")
